"""A training configuration for tests."""

#: A configuration that trains for a second: every part of a run, at the smallest size.
TINY_CONFIG = """\
env_id = "ballbot/Balance-v0"
algorithm = "PPO"
total_timesteps = 768
num_envs = 8
num_threads = 1

[env]
model = "spatial"
max_episode_steps = 60

[evaluation]
every_timesteps = 256
episodes = 4

[algorithm_arguments]
n_steps = 32
batch_size = 64
n_epochs = 1
learning_rate = 1e-3

[schedule]
learning_rate = "linear"

[policy]
net_arch = [8]
"""
