"""Rollouts and what is read from them: comparisons over episodes, recovery maps, trajectories."""
