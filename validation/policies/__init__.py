"""Policies that come with the package: training, tests in three engines, and transfer."""
