"""The Rust core. SI units and radians; quaternions are `[w, x, y, z]` and map body to inertial."""

from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, final

import numpy as np
import numpy.typing as npt
from typing_extensions import Self, disjoint_base

__all__ = [
    "LABELS",
    "MODELS",
    "OBSERVATION",
    "PAPER_BALL_VISCOUS_FRICTION",
    "TERMINATIONS",
    "Ballbot",
    "Batch",
    "Contacts",
    "DivergedError",
    "Lqr",
    "Params",
    "Pid",
    "PlanarModel",
    "Renderer",
    "SpatialModel",
    "State",
    "UrdfError",
    "__version__",
    "virtual_to_wheel_torques",
    "wheel_to_virtual_torques",
]

__version__: str
PAPER_BALL_VISCOUS_FRICTION: float
MODELS: list[str]
OBSERVATION: list[tuple[str, str, float]]
TERMINATIONS: list[str | None]
LABELS: list[str]

_Array = npt.NDArray[np.float64]
_Model = Literal["planar", "spatial", "contact", "rigid"]

class DivergedError(ArithmeticError):
    """The simulation left the range in which its numbers mean anything."""

class UrdfError(ValueError):
    """A URDF is malformed, or describes something that is no ballbot."""

@final
class Params:
    """Physical parameters of a ballbot. Immutable; scalars are floats, vectors tuples of three.

    `body_*` describe everything above the ball: the wheels' mass counts, their inertia about their axles does not.
    Without default: `ball_mass` (kg), `ball_inertia` (about a diameter, kg·m²), `ball_radius` (m), `body_mass` (kg),
    `body_inertia` (three moments about the body's CoM, kg·m²), `body_com_height` (above the ball centre, m),
    `wheel_mass` (kg), `wheel_inertia` (about the axle, kg·m²), `wheel_radius` (m), `wheel_zenith` (rad).
    With default: `wheel_azimuths` (0, 120, 240 deg), `max_wheel_torque` (5 N·m), `gravity` (9.81 m/s²),
    `ball_viscous_friction` (0 N/(m/s)), `wheel_viscous_friction` (0 N·m/(rad/s)), `wheel_coulomb_friction` (0 N·m),
    `wheel_static_friction` (1.1), `wheel_dynamic_friction` (1.0), `floor_static_friction` (1.1),
    `floor_dynamic_friction` (1.05), `friction_critical_velocity` (0.1 m/s).

    Raises:
        ValueError: a value is missing, not known, not finite, or out of range; the message has value and limit.
    """

    def __new__(cls, **fields: float | npt.ArrayLike) -> Self: ...
    @property
    def ball_mass(self) -> float:
        """M_k, kg."""
    @property
    def ball_inertia(self) -> float:
        """J_k about any diameter, kg·m²."""
    @property
    def ball_radius(self) -> float:
        """r_k, m."""
    @property
    def body_mass(self) -> float:
        """M_b, body and wheels, kg."""
    @property
    def body_inertia(self) -> tuple[float, float, float]:
        """(J_b, J_b, J_z) about the body's CoM, kg·m²."""
    @property
    def body_com_height(self) -> float:
        """l, from the ball centre, m."""
    @property
    def wheel_mass(self) -> float:
        """Of one wheel, kg."""
    @property
    def wheel_inertia(self) -> float:
        """J_w about the axle, kg·m²."""
    @property
    def wheel_radius(self) -> float:
        """r_w, m."""
    @property
    def wheel_zenith(self) -> float:
        """α, rad."""
    @property
    def wheel_azimuths(self) -> tuple[float, float, float]:
        """β_i, rad."""
    @property
    def max_wheel_torque(self) -> float:
        """Of one motor, N·m."""
    @property
    def gravity(self) -> float:
        """m/s²."""
    @property
    def ball_viscous_friction(self) -> float:
        """B_vk, N/(m/s)."""
    @property
    def wheel_viscous_friction(self) -> float:
        """B_vm, N·m/(rad/s)."""
    @property
    def wheel_coulomb_friction(self) -> float:
        """Dry friction of a wheel joint, N·m."""
    @property
    def wheel_static_friction(self) -> float:
        """Of wheel on ball, along the drive direction."""
    @property
    def wheel_dynamic_friction(self) -> float:
        """Of wheel on ball, along the drive direction."""
    @property
    def floor_static_friction(self) -> float:
        """Of the floor."""
    @property
    def floor_dynamic_friction(self) -> float:
        """Of the floor."""
    @property
    def friction_critical_velocity(self) -> float:
        """Between static and dynamic friction, m/s."""
    @staticmethod
    def paper() -> Params:
        """The robot of the paper, Table II."""
    @staticmethod
    def preset(name: str) -> Params:
        """A published robot by name. Raises ValueError for a name not in `preset_names()`."""
    @staticmethod
    def preset_names() -> list[str]:
        """Names of the published robots."""
    @staticmethod
    def from_toml(text_or_path: str | PathLike[str]) -> Params:
        """Parameters from TOML, one key a parameter. A string of one line that ends in ".toml" is a path.

        Raises:
            ValueError: malformed, or as the constructor; the message has the file, the key and the value.
            OSError: the file cannot be read.
        """
    def to_toml(self) -> str:
        """All values as TOML text, which `from_toml` reads back to the last bit."""
    @staticmethod
    def from_urdf(bot_path: str | PathLike[str], ball_path: str | PathLike[str]) -> Params:
        """Parameters of a ballbot described by two URDFs.

        Raises:
            UrdfError: malformed, or no ballbot; the message says why.
            OSError: a file cannot be read.
        """
    def replace(self, **changes: float | npt.ArrayLike) -> Params:
        """A copy with some values changed. Raises ValueError as the constructor."""
    def to_dict(self) -> dict[str, float | tuple[float, ...]]:
        """All values by name."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __getnewargs_ex__(self) -> tuple[tuple[()], dict[str, float | tuple[float, ...]]]: ...

@final
class State:
    """Position, attitude and velocities of ball, body and wheels. Immutable; attributes are fresh float64 arrays.

    Body rates are in the body frame, everything else in the inertial frame (z up, floor at z = 0). Velocities and rates
    default to zero, attitudes to identity, `body_position` (origin of the body frame) to the ball's, likewise
    `body_velocity`.

    Raises:
        ValueError: a wrong shape, a number that is not finite, a quaternion whose length is not 1.
    """

    def __new__(
        cls,
        ball_position: npt.ArrayLike,
        ball_velocity: npt.ArrayLike | None = None,
        ball_angular_velocity: npt.ArrayLike | None = None,
        body_quaternion: npt.ArrayLike | None = None,
        body_angular_velocity: npt.ArrayLike | None = None,
        wheel_speeds: npt.ArrayLike | None = None,
        *,
        ball_quaternion: npt.ArrayLike | None = None,
        wheel_angles: npt.ArrayLike | None = None,
        body_position: npt.ArrayLike | None = None,
        body_velocity: npt.ArrayLike | None = None,
    ) -> Self: ...
    @staticmethod
    def upright(params: Params, tilt: npt.ArrayLike | None = None, yaw: float = 0.0) -> State:
        """At rest on the floor at the origin: turned by `yaw`, then tilted by the rotation vector (x, y, 0)."""
    @staticmethod
    def rolling(
        params: Params,
        ball_velocity: npt.ArrayLike,
        body_quaternion: npt.ArrayLike | None = None,
        body_angular_velocity: npt.ArrayLike | None = None,
        ball_spin: float = 0.0,
    ) -> State:
        """Rolling without slip with the ball's velocity (x, y): ball and wheel rates follow from it."""
    @staticmethod
    def from_array(values: npt.ArrayLike) -> State:
        """The inverse of `to_array`."""
    def to_array(self) -> _Array:
        """32 numbers: ball position, quaternion, velocity, rate; the body's likewise; wheel angles and speeds."""
    def replace(self, **changes: npt.ArrayLike) -> State:
        """A copy with some fields changed."""
    @property
    def ball_position(self) -> _Array:
        """Ball centre, m."""
    @property
    def ball_quaternion(self) -> _Array:
        """Attitude of the ball."""
    @property
    def ball_velocity(self) -> _Array:
        """m/s."""
    @property
    def ball_angular_velocity(self) -> _Array:
        """Inertial frame, rad/s."""
    @property
    def body_position(self) -> _Array:
        """Origin of the body frame, m; the ball centre unless a wheel has lifted off."""
    @property
    def body_quaternion(self) -> _Array:
        """Attitude of the body."""
    @property
    def body_velocity(self) -> _Array:
        """Velocity of the body frame's origin, m/s."""
    @property
    def body_angular_velocity(self) -> _Array:
        """Body frame, rad/s."""
    @property
    def wheel_angles(self) -> _Array:
        """Relative to the body, rad."""
    @property
    def wheel_speeds(self) -> _Array:
        """Relative to the body (what encoders read), rad/s."""
    @property
    def tilt(self) -> float:
        """Angle between the mast and the vertical, rad."""
    @property
    def tilt_components(self) -> _Array:
        """Rotation vector (x, y) that takes the vertical to the mast, rad."""
    @property
    def yaw(self) -> float:
        """Heading, rad."""
    def __eq__(self, other: object, /) -> bool: ...
    def __ne__(self, other: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Any, tuple[_Array]]: ...

@final
class Contacts:
    """Forces at the contacts during the last step. Attributes are fresh float64 arrays."""

    @property
    def wheel_normal_forces(self) -> _Array:
        """Load of each wheel on the ball, N."""
    @property
    def wheel_tractions(self) -> _Array:
        """Drive friction of each wheel on the ball along its drive direction, N."""
    @property
    def wheel_slip_speeds(self) -> _Array:
        """Wheel surface relative to the ball along the drive direction, m/s."""
    @property
    def floor_force(self) -> _Array:
        """Force of the floor on the ball, inertial frame, N."""
    @property
    def floor_slip_velocity(self) -> _Array:
        """Velocity (x, y) of the ball's lowest point, m/s."""
    @property
    def bot_on_floor(self) -> bool:
        """Whether the body or a wheel touches the floor."""
    @property
    def friction_utilization(self) -> _Array:
        """Share of the dynamic friction limit in use, three wheels and floor; above 1, no-slip models fail."""

@disjoint_base
class Ballbot:
    """A simulated robot: sense (`state`, `contacts`), actuate (`step`), push, set joint dynamics.

    Args:
        params: the robot, the name of a preset, or the path of a TOML file; None is `Params.paper()`.
        model: "rigid" (rapier3d), "contact" (contacts and friction on a flat floor, specialised), "spatial" (coupled
            3D without slip) or "planar" (eqs. (1)-(7) of the paper).
        sim_dt: time step, s.

    Raises:
        ValueError: an unknown model, or a number out of range.
    """

    def __new__(
        cls, params: Params | str | PathLike[str] | None = None, model: _Model | str = "rigid", sim_dt: float = 0.001
    ) -> Self: ...
    def reset(self, state: State | None = None, tilt: npt.ArrayLike | None = None, yaw: float | None = None) -> None:
        """Starts anew from `state`, or at rest with a tilt (two components) and a yaw.

        Raises:
            ValueError: a state out of bounds, below the floor, or with slip where the model has none.
            TypeError: both a state and a tilt or yaw.
        """
    def step(self, wheel_torques: npt.ArrayLike, steps: int = 1) -> None:
        """Advances by `steps` time steps under constant motor torques (three, N·m).

        Raises:
            ValueError: a torque that is not finite or beyond `params.max_wheel_torque`; nothing has moved then.
            DivergedError: the state has left the simulation's bounds.
        """
    def push(self, impulse: npt.ArrayLike, point: npt.ArrayLike | None = None) -> None:
        """Gives the body an impulse (inertial frame, N·s) at `point` (body frame, m; None is its CoM).

        The models `contact` and `rigid` spread it over their next time step.
        """
    def set_joint_dynamics(self, viscous_friction: float | None = None, coulomb_friction: float | None = None) -> None:
        """Changes the wheel joints' viscous (N·m/(rad/s)) or dry (N·m) friction; it outlives a reset."""
    @property
    def joint_dynamics(self) -> dict[str, float]:
        """`viscous_friction` and `coulomb_friction` of the wheel joints, as `set_joint_dynamics` takes them."""
    @property
    def state(self) -> State:
        """The present state."""
    @property
    def contacts(self) -> Contacts:
        """Contact forces of the last step; `contact` and `rigid` know none before their first."""
    @property
    def energy(self) -> float:
        """Kinetic plus potential energy, J; the latter is zero with the body's CoM at the ball centre's height."""
    @property
    def time(self) -> float:
        """Simulated time since the reset, s."""
    @property
    def params(self) -> Params:
        """The robot's parameters."""
    @property
    def model(self) -> str:
        """The model's name."""
    @property
    def sim_dt(self) -> float:
        """Time step, s."""
    def snapshot(self) -> bytes:
        """Everything that the future depends on, for `restore`."""
    def restore(self, snapshot: bytes) -> None:
        """Continues, to the last bit, from a snapshot of a robot with the same arguments."""
    def __getnewargs__(self) -> tuple[Params, str, float]: ...
    def __getstate__(self) -> bytes: ...
    def __setstate__(self, snapshot: bytes) -> None: ...

@final
class SpatialModel:
    """Equations of motion of the coupled 3D robot without slip (Kane's method).

    Generalised velocity: ball velocity x, y (inertial), body angular velocity (body frame) and, with
    `ball_spins_about_vertical`, the ball's spin about the vertical: 5 or 6 numbers. `absolute_wheel_spin=False` is the
    paper's wheel energy, in which a wheel's spin counts relative to the body.
    """

    def __new__(
        cls, params: Params, absolute_wheel_spin: bool = True, ball_spins_about_vertical: bool = True
    ) -> Self: ...
    def accelerations(
        self,
        body_quaternion: npt.ArrayLike,
        generalized_velocity: npt.ArrayLike,
        wheel_torques: npt.ArrayLike,
    ) -> _Array:
        """Derivative of the generalised velocity."""
    def wheel_speeds(self, body_quaternion: npt.ArrayLike, generalized_velocity: npt.ArrayLike) -> _Array:
        """Encoder rates, rad/s."""
    def energy(self, body_quaternion: npt.ArrayLike, generalized_velocity: npt.ArrayLike) -> float:
        """Kinetic plus potential energy, J."""
    def contacts(
        self,
        body_quaternion: npt.ArrayLike,
        generalized_velocity: npt.ArrayLike,
        wheel_torques: npt.ArrayLike,
    ) -> Contacts:
        """Forces that the contacts must carry for the motion to be free of slip."""

@final
class PlanarModel:
    """The paper's planar model, eqs. (1)-(7), of q = (position, tilt towards positive position).

    Args:
        params: the robot.
        wheel_inertia: "as_printed" (J_w of one wheel) or "three_wheels" ((3/2) cos² α J_w, what three amount to).
        plane: "yz" or "xz".
    """

    def __new__(
        cls,
        params: Params,
        wheel_inertia: Literal["as_printed", "three_wheels"] | str = "as_printed",
        plane: Literal["yz", "xz"] | str = "yz",
    ) -> Self: ...
    def accelerations(self, q: npt.ArrayLike, q_dot: npt.ArrayLike, virtual_torque: float) -> _Array:
        """q̈ under a virtual torque (N·m), eq. (1)."""
    def energy(self, q: npt.ArrayLike, q_dot: npt.ArrayLike) -> float:
        """Kinetic plus potential energy, J."""
    def yaw_acceleration(self, virtual_torque: float) -> float:
        """θ̈_z under a virtual torque (N·m), eq. (7)."""
    def linearize(self) -> tuple[_Array, _Array]:
        """A (4×4) and B (4) of x = (position, tilt, their rates) about rest upright."""

def virtual_to_wheel_torques(
    params: Params,
    virtual_torques: npt.ArrayLike,
    mapping: Literal["consistent", "as_printed"] | str = "consistent",
) -> _Array:
    """Wheel torques (N·m) of virtual torques (τ_x, τ_y, τ_z) in the body frame, in the sign of the paper's eq. (8).

    "consistent" keeps the power; "as_printed" is eq. (8), whose tilt and yaw torques come out too large.
    """

def wheel_to_virtual_torques(params: Params, wheel_torques: npt.ArrayLike) -> _Array:
    """The inverse of the consistent map."""

@disjoint_base
class Pid:
    """The paper's PID with filtered derivative, on both tilt components; it holds neither position nor heading.

    Torques are scaled down together to within `max_torque` (None: 0.9 of the
    torque at which a wheel of the upright robot slips).
    """

    def __new__(
        cls,
        params: Params | str | PathLike[str] | None = None,
        control_dt: float = 0.01,
        *,
        proportional: float = 20.39,
        integral: float = 56.57,
        derivative: float = 1.34,
        filter_coefficient: float = 327.0,
        mapping: Literal["consistent", "as_printed"] | str = "consistent",
        max_torque: float | None = None,
    ) -> Self: ...
    def __call__(
        self,
        state: State,
        *,
        position: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        yaw: float = 0.0,
        tilt: npt.ArrayLike | None = None,
    ) -> _Array:
        """Wheel torques for the next `control_dt`, N·m; `tilt` is the setpoint in the heading frame."""
    def reset(self) -> None:
        """Forgets the past."""
    @property
    def control_dt(self) -> float:
        """Time between two calls, in seconds."""

@disjoint_base
class Lqr:
    """A discrete linear-quadratic regulator of position, tilt and heading, from the linear model of any robot.

    Weights are deviations that cost the same: `position` (0.15 m), `velocity` (0.4 m/s), `tilt` (0.1 rad),
    `tilt_rate` (1 rad/s), `yaw` (0.5 rad), `yaw_rate` (2 rad/s), `torque` (0.2 N·m). Torques as in `Pid`.
    """

    def __new__(
        cls,
        params: Params | str | PathLike[str] | None = None,
        control_dt: float = 0.01,
        *,
        max_torque: float | None = None,
        **weights: float,
    ) -> Self: ...
    def __call__(
        self,
        state: State,
        *,
        position: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        yaw: float = 0.0,
        tilt: npt.ArrayLike | None = None,
    ) -> _Array:
        """Wheel torques for the next `control_dt`, N·m."""
    def reset(self) -> None:
        """Does nothing: the regulator has no memory."""
    @property
    def control_dt(self) -> float:
        """Time between two calls, in seconds."""
    def deviation(
        self,
        state: State,
        *,
        position: npt.ArrayLike | None = None,
        velocity: npt.ArrayLike | None = None,
        yaw: float = 0.0,
    ) -> _Array:
        """What the regulator multiplies and weighs (10), in the heading frame, m, rad, m/s, rad/s.

        Position error (x, y), tilt (x, y), yaw error, then their rates.
        """
    @property
    def gain(self) -> _Array:
        """K (3×10): the torques are −K x of the deviation x, before they are limited."""
    @property
    def cost(self) -> _Array:
        """P (10×10): the sum of xᵀQx + uᵀRu over all steps from the deviation x is xᵀPx."""
    @property
    def residual(self) -> float:
        """Relative residual of the Riccati equation."""

@final
class Batch:
    """Environments of the balance task that are stepped together; what the front ends are made of."""

    def __new__(
        cls, num_envs: int, autoreset: str, num_threads: int | None = None, seed: int = 0, **options: Any
    ) -> Self: ...
    @property
    def num_envs(self) -> int: ...
    @property
    def num_threads(self) -> int: ...
    @property
    def params(self) -> Params: ...
    @property
    def model(self) -> str: ...
    @property
    def sim_dt(self) -> float: ...
    @property
    def control_dt(self) -> float: ...
    @property
    def max_wheel_torque(self) -> float: ...
    @property
    def setpoint(self) -> list[float]: ...
    @property
    def max_episode_steps(self) -> int: ...
    def reset(
        self,
        mask: npt.ArrayLike | None = None,
        seeds: Sequence[int | None] | None = None,
        starts: Sequence[State | None] | None = None,
    ) -> npt.NDArray[np.float32]:
        """Observations of all environments; checks everything before it changes anything."""
    def stagger(self) -> None: ...
    def step(
        self, actions: npt.ArrayLike
    ) -> tuple[
        npt.NDArray[np.float32],
        npt.NDArray[np.float32],
        npt.NDArray[np.bool_],
        npt.NDArray[np.bool_],
    ]:
        """Observations, rewards, terminated and truncated; all fresh."""
    def last_observations(self) -> npt.NDArray[np.float32]:
        """Last observations of the episodes that the last step ended and reset; other rows mean nothing."""
    def infos(self) -> list[dict[str, Any]]:
        """Infos of the last step as Stable-Baselines3 wants them, one for each environment.

        An info is empty unless its episode ended. No dict is one that a caller still holds or wrote into.
        """
    def endings(self) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.uint8]]:
        """Whether the last step of each environment is a success if it ends there, and why it was terminated.

        The reasons are indices into `TERMINATIONS`.
        """
    def ending(self, index: int) -> tuple[bool, str | None]:
        """Whether the last step of environment `index` is a success if it ends there, and why it was terminated."""
    def reward_terms(self, index: int) -> dict[str, float]: ...
    def state(self, index: int) -> State: ...
    def states(self) -> _Array: ...
    def push(self, index: int, impulse: npt.ArrayLike, point: npt.ArrayLike | None = None) -> None: ...
    def set_joint_dynamics(
        self, index: int, viscous_friction: float | None = None, coulomb_friction: float | None = None
    ) -> None: ...
    def snapshot(self, index: int) -> bytes: ...
    def restore(self, index: int, snapshot: bytes) -> None: ...

@final
class Renderer:
    """Takes pictures of a robot without GPU or display, by rays.

    Args:
        params: the robot, the name of a preset, or the path of a TOML file; None is `Params.paper()`.
        urdf: (bot, ball), two files whose visual shapes are shown in place of shapes made from `params`.
        width, height: of the picture, pixels.
        samples: colour samples a pixel, 1, 2 or 4.
        camera: `target` (three, m), `distance` (m), `azimuth` (rad, counter-clockwise from x), `elevation` (rad),
            `field_of_view` (vertical, rad) and `follows` (the ball; then `target` is relative to its point of
            contact) change the default, which follows the robot.
        num_threads: threads that cast rays; None takes all cores. Pictures do not depend on it.

    Raises:
        ValueError: a number out of range. TypeError: an unknown camera setting.
        UrdfError, OSError: a file that cannot be read.
    """

    def __new__(
        cls,
        params: Params | str | PathLike[str] | None = None,
        *,
        urdf: tuple[str | PathLike[str], str | PathLike[str]] | None = None,
        width: int = 640,
        height: int = 480,
        samples: int = 1,
        camera: dict[str, Any] | None = None,
        num_threads: int | None = None,
    ) -> Self: ...
    def render(
        self, state: State, contacts: Contacts | None = None, arrows: npt.ArrayLike | None = None
    ) -> npt.NDArray[np.uint8]:
        """The robot in a state, shape (height, width, 3), uint8.

        `contacts` adds arrows: loads (blue) and tractions (green) of the wheels, the floor's horizontal force (red).
        `arrows` adds others, (from, to) in m, inertial frame: shape (n, 2, 3).
        """
    def depth(self, state: State) -> npt.NDArray[np.float32]:
        """Distances along the camera's axis, shape (height, width), float32, m; infinite in the sky."""
    def labels(self, state: State) -> npt.NDArray[np.uint8]:
        """What each pixel shows, shape (height, width), uint8: `LABELS[value]` names it."""
    def render_batch(self, states: npt.ArrayLike) -> npt.NDArray[np.uint8]:
        """Robots in states (rows as `State.to_array`, shape (n, 32)): shape (n, height, width, 3), uint8."""
    @property
    def width(self) -> int:
        """Of the picture, pixels."""
    @property
    def height(self) -> int:
        """Of the picture, pixels."""
