"""Environments: the front ends for Gymnasium and Stable-Baselines3, and what they share."""
