"""Other engines for the robots of a task."""
