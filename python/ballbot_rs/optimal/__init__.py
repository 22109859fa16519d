"""Optimal motions: linear models about any state, trajectory optimization, and the law that follows its result."""
