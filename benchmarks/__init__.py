"""One benchmark of this simulator and its peers: the same robot, the same task, the same run."""
