"""Figures. Needs matplotlib."""
