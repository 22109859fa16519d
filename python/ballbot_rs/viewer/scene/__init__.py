"""What is drawn: robots, ground, forces, commands."""
