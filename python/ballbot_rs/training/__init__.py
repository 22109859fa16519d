"""Training of policies with Stable-Baselines3: configuration, the run and its files, evaluation."""
