"""Identification of a robot's parameters from a log of its torques and sensors."""
