"""Training of policies with Stable-Baselines3 or by evolution: configuration, the run and its files, evaluation."""
