"""The fastest settings of MuJoCo with which the robot still works, as the probes show."""

from ballbot_rs.engines.mujoco_robot import Setup
from validation.engines.steps import SIM_DT

#: A loose tolerance, but MuJoCo's full line search, without which the growth rate is wrong.
FAST = Setup(SIM_DT, 'integrator="Euler" iterations="10" ls_iterations="50" tolerance="1e-4"')
