"""Output of `tools/generate.py`, one module for each kind."""
