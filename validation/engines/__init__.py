"""Adapters: the robot of `ballbot_rs.Params` in our models, MuJoCo and PyBullet, and probes of it."""
