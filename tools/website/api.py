"""Pages of the API: the public names in groups, described by their docstrings."""

import inspect

import ballbot_rs
from ballbot_rs.optimal.differentiable import DifferentiableRobots

#: Every name of `ballbot_rs.__all__` is in one group; a test checks this.
GROUPS: dict[str, tuple[str, tuple[str, ...]]] = {
    "simulator": (
        "Simulator",
        (
            "Ballbot",
            "Crowd",
            "State",
            "Contacts",
            "Params",
            "Terrain",
            "terrain_kinds",
            "obstacle_kinds",
            "read_terrain",
            "write_terrain",
            "write_urdf",
            "load_actuators",
            "load_sensors",
            "load_events",
            "Renderer",
            "virtual_to_wheel_torques",
            "wheel_to_virtual_torques",
            "PAPER_BALL_VISCOUS_FRICTION",
            "__version__",
        ),
    ),
    "models": ("Models in closed form", ("SpatialModel", "PlanarModel", "LinearModel")),
    "derivatives": ("Derivatives", ("Jacobian", "Jacobians", "MotionJacobians")),
    "environments": (
        "Environments",
        (
            "Batch",
            "BallbotEnv",
            "BallbotVectorEnv",
            "BallbotVecEnv",
            "Task",
            "Robots",
            "register",
            "GroupedObservations",
            "GroupedVectorObservations",
            "GroupedVecEnv",
            "CostInfo",
            "SafetyEnv",
        ),
    ),
    "tasks": (
        "Environments of the tasks",
        (
            "BalanceEnv",
            "BalanceVectorEnv",
            "VelocityEnv",
            "VelocityVectorEnv",
            "GoalEnv",
            "GoalVectorEnv",
            "PathEnv",
            "PathVectorEnv",
            "PushEnv",
            "PushVectorEnv",
            "CarryEnv",
            "CarryVectorEnv",
            "NavigateEnv",
            "NavigateVectorEnv",
            "RideEnv",
            "RideVectorEnv",
            "TerrainEnv",
            "TerrainVectorEnv",
            "OpenBallBotEnv",
            "OpenBallBotVectorEnv",
        ),
    ),
    "controllers": (
        "Controllers and references",
        (
            "Controller",
            "Lqr",
            "Pid",
            "OnnxPolicy",
            "controllers",
            "ControllerInfo",
            "make_controller",
            "Reference",
            "Setpoint",
            "save",
            "Link",
            "LinkFaults",
            "LinkPeer",
            "EstimatedController",
            "Estimator",
            "Supervised",
            "StateFeedback",
            "NativeLaw",
        ),
    ),
    "analysis": (
        "Simulations, comparisons and tuning",
        (
            "simulate",
            "Trajectory",
            "rollout",
            "Rollout",
            "record_dataset",
            "Dataset",
            "show",
            "Page",
            "show_crowd",
            "CrowdPage",
            "Push",
            "Force",
            "Metrics",
            "evaluate",
            "compare",
            "Result",
            "Study",
            "run_scenarios",
            "load_scenarios",
            "Scenario",
            "Scale",
            "Outcome",
            "tune",
            "Tuned",
        ),
    ),
    "optimal": (
        "Linear models and optimal motions",
        (
            "linearize",
            "optimize_trajectory",
            "OptimizedTrajectory",
            "TimeVaryingLqr",
            "DifferentiableBatch",
            "DifferentiableJaxBatch",
        ),
    ),
    "identification": (
        "Identification",
        ("identify", "IdentifiedParams", "SensorLog", "record_log", "replay", "Replay"),
    ),
    "errors": ("Errors", ("BallbotError", "InvalidInputError", "UrdfError", "DivergedError", "ControllerError")),
}


def pages(has_rust: bool) -> dict[str, str]:
    """The text of every page by its file's name, in the order of the menu."""
    written = {f"{name}.rst": _page(title, names) for name, (title, names) in GROUPS.items()}
    written["deployment.rst"] = _deployment()
    return {**written, "rust.md": _RUST} if has_rust else written


def _titled(title: str) -> str:
    return f"{title}\n{'=' * len(title)}\n\n"


def _page(title: str, names: tuple[str, ...]) -> str:
    return _titled(f"API: {title[0].lower()}{title[1:]}") + "\n".join(_directive(name) for name in names)


def _directive(name: str) -> str:
    thing = getattr(ballbot_rs, name)
    if not inspect.isclass(thing):
        kind = "function" if callable(thing) else "data"
        return f".. auto{kind}:: ballbot_rs.{name}\n"
    kind = "exception" if issubclass(thing, Exception) else "class"
    # Bases of the others are of other libraries, or have their own entry.
    inherited = "   :inherited-members:\n" if issubclass(thing, DifferentiableRobots) else ""
    return f".. auto{kind}:: ballbot_rs.{name}\n   :members:\n{inherited}"


def _deployment() -> str:
    return _titled("API: deployment") + ".. automodule:: ballbot_rs.deployment\n   :members:\n   :imported-members:\n"


_RUST = """# The Rust core

The simulator itself is a crate, `ballbot-core`: [its documentation](rust:ballbot_core/index.html), made by `cargo doc`,
has every type, trait and function with its source. The Python classes of these pages are conversions of it.
"""
