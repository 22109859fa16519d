"""Other engines that the robots of a task can move in."""
