"""PPO of RLlib on a Ray cluster: workers step whole batches of robots, one learner updates the policy.

The run folder, evaluations, checkpoints and policy files are as in `training.train`, for all commands.
"""
