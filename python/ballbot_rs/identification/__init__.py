"""Parameters of a robot from a log of its torques and sensors."""
