"""Controllers, estimator, supervisor, policies and link as C99 for the computer of a robot, without any dependency."""

from ballbot_rs.deployment.controller import CONTROLLERS_IN_C, controller_header
from ballbot_rs.deployment.estimator import estimator_header
from ballbot_rs.deployment.link import link_header
from ballbot_rs.deployment.policy import policy_header
from ballbot_rs.deployment.supervisor import supervisor_header

__all__ = [
    "CONTROLLERS_IN_C",
    "controller_header",
    "estimator_header",
    "link_header",
    "policy_header",
    "supervisor_header",
]
