"""The paper's experiments, repeated: printed beside found, and why they differ."""
