"""Training of policies with Stable-Baselines3: configuration, the run and what it leaves behind, evaluation."""
