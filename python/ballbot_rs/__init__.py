"""A fast, verified simulator of a robot that balances on a ball.

The physics is in Rust; this package exposes it to Python: single robots (`Ballbot`), robots that touch each other
(`Crowd`), batches (`Batch`), closed-form models (`SpatialModel`, `PlanarModel`, `LinearModel`), controllers
(`Controller`, `Pid`, `Lqr`) and the motions that they follow (`Reference`), simulations of one robot (`simulate`),
environments for reinforcement learning, the comparison of controllers and policies (`compare`), the identification of
parameters from logs (`identify`), linear models about any state (`linearize`), and optimal motions
(`optimize_trajectory`).
Importing it registers every task with Gymnasium, among them `ballbot/Balance-v0`.
SI units and radians throughout; quaternions are `[w, x, y, z]`.
"""

from typing import TYPE_CHECKING, Any

from ballbot_rs import _start  # noqa: F401
from ballbot_rs._core import (
    PAPER_BALL_VISCOUS_FRICTION,
    Ballbot,
    Batch,
    Contacts,
    Controller,
    Crowd,
    Estimator,
    Jacobian,
    Jacobians,
    LinearModel,
    Lqr,
    MotionJacobians,
    Params,
    Pid,
    PlanarModel,
    Reference,
    Renderer,
    SpatialModel,
    State,
    Terrain,
    __version__,
    load_actuators,
    load_events,
    load_sensors,
    obstacle_kinds,
    terrain_kinds,
    virtual_to_wheel_torques,
    wheel_to_virtual_torques,
)
from ballbot_rs._errors import BallbotError, ControllerError, DivergedError, InvalidInputError, UrdfError
from ballbot_rs.analysis.dataset import Dataset, record_dataset
from ballbot_rs.analysis.episodes import compare, evaluate
from ballbot_rs.analysis.metrics import Metrics
from ballbot_rs.analysis.pushes import Force, Push
from ballbot_rs.analysis.result import Result
from ballbot_rs.analysis.robots import Rollout, rollout
from ballbot_rs.analysis.simulate import simulate
from ballbot_rs.analysis.study import Study
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.control.catalog import ControllerInfo, controllers, make_controller
from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.control.state_feedback import StateFeedback
from ballbot_rs.deployment.native import NativeLaw
from ballbot_rs.deployment.supervised import Supervised
from ballbot_rs.envs.costs import CostInfo, SafetyEnv
from ballbot_rs.envs.grouped import GroupedObservations, GroupedVectorObservations
from ballbot_rs.envs.gymnasium_env import BallbotEnv
from ballbot_rs.envs.own import Robots, Task
from ballbot_rs.envs.registration import register, register_environments
from ballbot_rs.envs.tasks import (
    BalanceEnv,
    BalanceVectorEnv,
    CarryEnv,
    CarryVectorEnv,
    GoalEnv,
    GoalVectorEnv,
    NavigateEnv,
    NavigateVectorEnv,
    OpenBallBotEnv,
    OpenBallBotVectorEnv,
    PathEnv,
    PathVectorEnv,
    PushEnv,
    PushVectorEnv,
    RideEnv,
    RideVectorEnv,
    TerrainEnv,
    TerrainVectorEnv,
    VelocityEnv,
    VelocityVectorEnv,
)
from ballbot_rs.envs.vector_env import BallbotVectorEnv
from ballbot_rs.identification.excitation import record_log
from ballbot_rs.identification.fit import identify
from ballbot_rs.identification.logs.log import SensorLog
from ballbot_rs.identification.replay import Replay, replay
from ballbot_rs.identification.result import IdentifiedParams
from ballbot_rs.link.estimated import EstimatedController
from ballbot_rs.link.faults import LinkFaults
from ballbot_rs.link.link import Link
from ballbot_rs.link.peer import LinkPeer
from ballbot_rs.media.robot_files import write_urdf
from ballbot_rs.media.terrain_files import read_terrain, write_terrain
from ballbot_rs.optimal.law import TimeVaryingLqr
from ballbot_rs.optimal.linear import linearize
from ballbot_rs.optimal.result import OptimizedTrajectory
from ballbot_rs.optimal.trajectory import optimize_trajectory
from ballbot_rs.scenarios.outcome import Outcome
from ballbot_rs.scenarios.run import run_scenarios
from ballbot_rs.scenarios.scale import Scale
from ballbot_rs.scenarios.scenario import Scenario
from ballbot_rs.scenarios.scenario import load as load_scenarios
from ballbot_rs.scenarios.tune import Tuned, tune

if TYPE_CHECKING:
    from ballbot_rs.control.sb3_policy import save
    from ballbot_rs.envs.sb3 import BallbotVecEnv
    from ballbot_rs.envs.sb3_grouped import GroupedVecEnv
    from ballbot_rs.optimal.differentiable_jax import DifferentiableJaxBatch
    from ballbot_rs.optimal.differentiable_torch import DifferentiableBatch
    from ballbot_rs.viewer.crowd import CrowdPage, show_crowd
    from ballbot_rs.viewer.show import Page, show

__all__ = [
    "PAPER_BALL_VISCOUS_FRICTION",
    "BalanceEnv",
    "BalanceVectorEnv",
    "Ballbot",
    "BallbotEnv",
    "BallbotError",
    "BallbotVecEnv",
    "BallbotVectorEnv",
    "Batch",
    "CarryEnv",
    "CarryVectorEnv",
    "Contacts",
    "Controller",
    "ControllerError",
    "ControllerInfo",
    "CostInfo",
    "Crowd",
    "CrowdPage",
    "Dataset",
    "DifferentiableBatch",
    "DifferentiableJaxBatch",
    "DivergedError",
    "EstimatedController",
    "Estimator",
    "Force",
    "GoalEnv",
    "GoalVectorEnv",
    "GroupedObservations",
    "GroupedVecEnv",
    "GroupedVectorObservations",
    "IdentifiedParams",
    "InvalidInputError",
    "Jacobian",
    "Jacobians",
    "LinearModel",
    "Link",
    "LinkFaults",
    "LinkPeer",
    "Lqr",
    "Metrics",
    "MotionJacobians",
    "NativeLaw",
    "NavigateEnv",
    "NavigateVectorEnv",
    "OnnxPolicy",
    "OpenBallBotEnv",
    "OpenBallBotVectorEnv",
    "OptimizedTrajectory",
    "Outcome",
    "Page",
    "Params",
    "PathEnv",
    "PathVectorEnv",
    "Pid",
    "PlanarModel",
    "Push",
    "PushEnv",
    "PushVectorEnv",
    "Reference",
    "Renderer",
    "Replay",
    "Result",
    "RideEnv",
    "RideVectorEnv",
    "Robots",
    "Rollout",
    "SafetyEnv",
    "Scale",
    "Scenario",
    "SensorLog",
    "Setpoint",
    "SpatialModel",
    "State",
    "StateFeedback",
    "Study",
    "Supervised",
    "Task",
    "Terrain",
    "TerrainEnv",
    "TerrainVectorEnv",
    "TimeVaryingLqr",
    "Trajectory",
    "Tuned",
    "UrdfError",
    "VelocityEnv",
    "VelocityVectorEnv",
    "__version__",
    "compare",
    "controllers",
    "evaluate",
    "identify",
    "linearize",
    "load_actuators",
    "load_events",
    "load_scenarios",
    "load_sensors",
    "make_controller",
    "obstacle_kinds",
    "optimize_trajectory",
    "read_terrain",
    "record_dataset",
    "record_log",
    "register",
    "replay",
    "rollout",
    "run_scenarios",
    "save",
    "show",
    "show_crowd",
    "simulate",
    "terrain_kinds",
    "tune",
    "virtual_to_wheel_torques",
    "wheel_to_virtual_torques",
    "write_terrain",
    "write_urdf",
]

#: Names whose modules import PyTorch, JAX or viser, loaded at their first use, and the extra that they need.
_LEARNING = {
    "BallbotVecEnv": ("ballbot_rs.envs.sb3", "train"),
    "DifferentiableBatch": ("ballbot_rs.optimal.differentiable_torch", "train"),
    "DifferentiableJaxBatch": ("ballbot_rs.optimal.differentiable_jax", "jax"),
    "GroupedVecEnv": ("ballbot_rs.envs.sb3_grouped", "train"),
    "CrowdPage": ("ballbot_rs.viewer.crowd", "view"),
    "Page": ("ballbot_rs.viewer.show", "view"),
    "save": ("ballbot_rs.control.sb3_policy", "train"),
    "show": ("ballbot_rs.viewer.show", "view"),
    "show_crowd": ("ballbot_rs.viewer.crowd", "view"),
}

register_environments()


def __getattr__(name: str) -> Any:
    if name == "run":
        raise AttributeError("bb.run is now bb.simulate, for the same start with tilt=(0.05, 0.0)")
    if name not in _LEARNING:
        raise AttributeError(f"module 'ballbot_rs' has no attribute '{name}'")
    import importlib

    from ballbot_rs._extras import require

    module, extra = _LEARNING[name]
    with require(name, extra):
        return getattr(importlib.import_module(module), name)


def __dir__() -> list[str]:
    return __all__
