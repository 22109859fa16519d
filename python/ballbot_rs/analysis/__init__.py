"""Rollouts and their results: comparisons over episodes, recovery maps, trajectories."""
