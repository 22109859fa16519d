"""One benchmark of this simulator, MuJoCo and PyBullet: the same robot, the same task, the same run."""
