"""Robots linked to a controller in another process or on a board."""
