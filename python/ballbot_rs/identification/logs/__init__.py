"""Logs of robots: CSV, npz and MCAP files, their columns, units and clocks."""
