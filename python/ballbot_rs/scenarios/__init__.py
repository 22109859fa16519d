"""Scenarios: what robots are asked for, and how controllers stand beside each other."""
