"""User tasks in Python: observations, rewards and ends of episodes as arrays over all robots."""

from ballbot_rs.envs.own.robots import Robots
from ballbot_rs.envs.own.task import Task

__all__ = ["Robots", "Task"]
