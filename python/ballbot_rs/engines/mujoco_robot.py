"""The robot in MuJoCo: its MJCF, and a robot that is stepped explicitly."""

import dataclasses
from typing import Any

import mujoco
import numpy as np

from ballbot_rs import _state_rows as rows
from ballbot_rs._checks import check_no_obstacles
from ballbot_rs._core import Params, State, Terrain
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._payloads import Payload, payloads_of
from ballbot_rs.engines.moving_floor import contact_plane
from ballbot_rs.engines.robot_geometry import Array, RobotGeometry, without_payloads

#: Positions of the parts in qpos (17) and qvel (15): ball, body, three wheels; payloads (3 each) come after them.
BALL_POSITION, BALL_QUATERNION, BODY_POSITION = slice(0, 3), slice(3, 7), slice(7, 10)
BODY_QUATERNION, WHEEL_ANGLES = slice(10, 14), slice(14, 17)
BALL_VELOCITY, BALL_RATE, BODY_VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)
BODY_RATE, WHEEL_SPEEDS = slice(9, 12), slice(12, 15)
PAYLOADS = slice(17, None)

#: Index of the wheel's drive direction among a contact's two friction directions, where the robot faces along x.
#: MuJoCo derives them from the normal and the world's axes, not from the wheel.
_DRIVE_SLOT = (0, 1, 1)
#: Sum of positions and speeds beyond which a state has diverged.
DIVERGED = 1e6
#: Inertia of a point mass, kg·m²: MuJoCo requires some.
_POINT = 1e-12
#: Friction across the drive direction: an omniwheel's rollers are free.
_FREE = 1e-5

#: Disabled features: all that are not used; joint friction also where it is zero.
_UNUSED = (
    "equality", "limit", "clampctrl", "sensor", "midphase", "eulerdamp", "island",
    # A diverged state must stay visible as such.
    "autoreset",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Setup:
    """How MuJoCo steps: time step (s), solver attributes, and whether contact frames are aligned with the wheels.

    Cones are elliptic, as a pyramid cannot be this thin; contacts are as stiff as the time step allows.
    """

    sim_dt: float
    solver: str
    turned: bool = False

    def options(self, params: Params) -> str:
        """The MJCF element."""
        used = {
            "frictionloss": params.wheel_coulomb_friction != 0.0,
            "damper": params.wheel_viscous_friction != 0.0 or params.has_payload,
            "spring": params.has_payload,
        }
        unused = [*_UNUSED, *(flag for flag, is_used in used.items() if not is_used)]
        flags = " ".join(f'{flag}="disable"' for flag in unused)
        return (
            f'<option timestep="{self.sim_dt}" cone="elliptic" solver="Newton" {self.solver}><flag {flags}/></option>'
        )

    @property
    def stiffness(self) -> str:
        """Attributes of a contact pair."""
        return f'solref="{2 * self.sim_dt} 1" solimp="0.95 0.99 0.0001"'


def accurate(sim_dt: float = 1e-3, *, turned: bool = True) -> Setup:
    """Contacts solved to convergence, with their frames aligned with the wheels or, as in stock MuJoCo, not."""
    return Setup(sim_dt, 'integrator="Euler" iterations="100" ls_iterations="100" tolerance="1e-12"', turned)


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def _inertial(mass: float, com: Array, inertia: Array) -> str:
    i = inertia
    full = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    return f'<inertial mass="{mass:.17g}" pos="{_numbers(com)}" fullinertia="{_numbers(full)}"/>'


def _payload(p: Params, payload: Payload) -> str:
    """MJCF of a payload on the body: three slides whose springs hold it at its place in equilibrium."""
    if any(payload.amplitude):
        name = f"{payload.name}_amplitude"
        raise InvalidInputError(f"MuJoCo does not simulate {name} = {payload.amplitude}: it must be zeros")
    com = np.array(p.body_com)
    hold = payload.mass * p.gravity * com / np.linalg.norm(com)
    slides = "".join(
        f'<joint type="slide" axis="{_numbers(axis)}" stiffness="{k:.17g}" damping="{c:.17g}" '
        f'springref="{f / k:.17g}"/>'
        for axis, k, c, f in zip(np.eye(3), payload.stiffness, payload.damping, hold, strict=True)
    )
    mass = f'<inertial mass="{payload.mass:.17g}" pos="0 0 0" diaginertia="{_numbers([_POINT] * 3)}"/>'
    return f'<body pos="{_numbers(payload.position)}">{mass}{slides}</body>'


def mjcf(robot: RobotGeometry, setup: Setup, *, moving_floor: bool = False) -> str:
    """MJCF of the robot on a floor, minimal: four contact pairs, three motors, no other collision.

    A moving floor is a mocap body. A preload of the wheels is a fourth actuator, without control.

    Raises:
        ValueError: inclined rollers without turned contacts.
    """
    p = robot.params
    if p.roller_angle != 0.0 and not setup.turned:
        raise InvalidInputError(
            f"MuJoCo's own contact frames are not along inclined rollers: roller_angle = {p.roller_angle} must be 0"
        )
    stiffness = setup.stiffness
    friction = f'damping="{p.wheel_viscous_friction:.17g}" frictionloss="{p.wheel_coulomb_friction:.17g}"'
    wheels, pairs, motors = "", "", ""
    for i in range(3):
        wheels += (
            f'<body pos="{_numbers(robot.centers[i])}">'
            f"{_inertial(p.wheel_mass, np.zeros(3), robot.wheel_inertias[i])}"
            f'<joint name="wheel{i}" type="hinge" axis="{_numbers(robot.axles[i])}" {friction}/>'
            f'<geom name="wheel{i}" type="sphere" size="{p.wheel_radius:.17g}"/></body>'
        )
        slots = [_FREE, _FREE]
        slots[0 if setup.turned else _DRIVE_SLOT[i]] = p.wheel_dynamic_friction
        pairs += (
            f'<pair geom1="wheel{i}" geom2="ball" condim="3" friction="{_numbers([*slots, 0, 0, 0])}" {stiffness}/>'
        )
        motors += f'<motor joint="wheel{i}"/>'
    ball_site, body_site = "", ""
    if p.wheel_preload > 0.0:
        # A constant force along the body's z axis between the ball's center and the origin of the body frame.
        ball_site, body_site = '<site name="ball"/>', '<site name="body"/>'
        motors += (
            '<general site="ball" refsite="body" gear="0 0 1 0 0 0" gainprm="0" biastype="affine" '
            f'biasprm="{p.wheel_preload:.17g}"/>'
        )
    body = without_payloads(robot.body, p)
    payloads = "".join(_payload(p, payload) for payload in payloads_of(p))
    floor = _numbers([p.floor_dynamic_friction, p.floor_dynamic_friction, 0, 0, 0])
    plane = '<geom name="floor" type="plane" size="0 0 1"/>'
    if moving_floor:
        plane = f'<body mocap="true">{plane}</body>'
    at = f'pos="0 0 {p.ball_radius:.17g}"'
    return f"""<mujoco>
  <compiler angle="radian" inertiafromgeom="false"/>
  {setup.options(p)}<option gravity="{_numbers(p.gravity_vector)}"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    {plane}
    <body {at}><freejoint/>{_inertial(p.ball_mass, np.zeros(3), p.ball_inertia * np.eye(3))}
      <geom name="ball" type="sphere" size="{p.ball_radius:.17g}"/>{ball_site}</body>
    <body {at}><freejoint/>{_inertial(body.mass, body.com, body.inertia)}{body_site}{wheels}{payloads}</body>
  </worldbody>
  <contact><pair geom1="floor" geom2="ball" condim="3" friction="{floor}" {stiffness}/>{pairs}</contact>
  <actuator>{motors}</actuator>
</mujoco>"""


class MujocoRobot:
    """One robot, one `MjData`.

    On a terrain the floor is its tangent plane under the ball, updated in each step.
    """

    def __init__(self, robot: RobotGeometry, setup: Setup, terrain: Terrain | None = None) -> None:
        check_no_obstacles(terrain, "the engine 'mujoco'")
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot, setup, moving_floor=terrain is not None))
        self._terrain, self._ball_radius = terrain, robot.params.ball_radius
        self.data = mujoco.MjData(self.model)
        self.sim_dt = setup.sim_dt
        self._turned, self._drives = setup.turned, robot.drives
        #: Wheel number of a geom, −1 for other geoms.
        self._wheel_of = np.full(self.model.ngeom, -1)
        self._wheel_of[[self.model.geom(f"wheel{i}").id for i in range(3)]] = range(3)
        self._body = int(self.model.jnt_bodyid[1])
        self._turn = np.zeros(9)
        self._floor = robot.params if robot.params.has_perturbed_floor else None
        self._floor_friction = self.model.pair_friction[0, :2].copy()

    def reset(self, state: State) -> None:
        """Restarts from a state."""
        mujoco.mj_resetData(self.model, self.data)
        self.move(state.to_array())

    def reset_raw(
        self, attitude: Array, rate: Array, speeds: Array, position: Array, velocity: Array, ball_rate: Array
    ) -> None:
        """Restarts with the body at the ball; arguments as the fields of `ballbot_rs.State`."""
        mujoco.mj_resetData(self.model, self.data)
        qpos = self.data.qpos
        qpos[BALL_POSITION], qpos[BODY_POSITION], qpos[BODY_QUATERNION] = position, position, attitude
        # The ball's rate is in the ball's frame, which a reset aligns with the inertial frame.
        self.data.qvel[:15] = np.concatenate([velocity, ball_rate, velocity, rate, speeds])

    def move(self, row: Array) -> None:
        """Continues from another state, a row as `State.to_array` (32); the solver starts from its last forces."""
        qpos, qvel = self.data.qpos, self.data.qvel
        qpos[BALL_POSITION], qpos[BALL_QUATERNION] = row[rows.BALL_POSITION], row[rows.BALL_QUATERNION]
        qpos[BODY_POSITION], qpos[BODY_QUATERNION] = row[rows.BODY_POSITION], row[rows.BODY_QUATERNION]
        qpos[WHEEL_ANGLES], qvel[WHEEL_SPEEDS] = row[rows.WHEEL_ANGLES], row[rows.WHEEL_SPEEDS]
        qvel[BALL_VELOCITY], qvel[BODY_VELOCITY] = row[rows.BALL_VELOCITY], row[rows.BODY_VELOCITY]
        qvel[BODY_RATE] = row[rows.BODY_RATE]
        qvel[BALL_RATE] = row[rows.BALL_RATE] @ self._ball_axes()

    def row(self) -> Array:
        """The present state, as `State.to_array` (32)."""
        qpos, qvel = self.data.qpos, self.data.qvel
        return np.concatenate(
            [
                qpos[BALL_POSITION],
                qpos[BALL_QUATERNION],
                qvel[BALL_VELOCITY],
                self._ball_axes() @ qvel[BALL_RATE],
                qpos[BODY_POSITION],
                qpos[BODY_QUATERNION],
                qvel[BODY_VELOCITY],
                qvel[BODY_RATE],
                qpos[WHEEL_ANGLES],
                qvel[WHEEL_SPEEDS],
            ]
        )

    def _ball_axes(self) -> Array:
        """Rotation from the ball's frame to the inertial frame, (3, 3)."""
        mujoco.mju_quat2Mat(self._turn, self.data.qpos[BALL_QUATERNION])
        return self._turn.reshape(3, 3)

    def push(self, push: Array) -> None:
        """Pushes the body over the next time step: impulse (N·s), its moment about the CoM (N·m·s), inertial, (6)."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        com = self.data.subtree_com[self._body]
        force, torque = push[:3] / self.sim_dt, push[3:] / self.sim_dt
        mujoco.mj_applyFT(self.model, self.data, force, torque, com, self._body, self.data.qfrc_applied)

    def step(self, torques: Array, steps: int) -> None:
        """Advances by `steps` time steps under wheel torques (3, N·m)."""
        self.data.ctrl[:3] = torques
        if steps > 1 and self.data.qfrc_applied.any():
            self._advance(1)
            steps -= 1
            self.data.qfrc_applied[:] = 0.0
        self._advance(steps)
        self.data.qfrc_applied[:] = 0.0

    def _advance(self, steps: int) -> None:
        if not self._turned and self._terrain is None and self._floor is None:
            mujoco.mj_step(self.model, self.data, nstep=steps)
            return
        for _ in range(steps):
            # MuJoCo would log a warning to a separate file.
            if not np.abs(self.data.qvel).sum() + np.abs(self.data.qpos).sum() < DIVERGED:
                self.data.qpos[:] = np.nan
                return
            if self._floor is not None:
                self._perturb_floor(self._floor)
            if self._terrain is not None:
                center = self.data.qpos[BALL_POSITION]
                self.data.mocap_pos[0], self.data.mocap_quat[0] = contact_plane(
                    self._terrain, center, self._ball_radius
                )
            mujoco.mj_step1(self.model, self.data)
            if self._turned:
                self._turn_contacts()
            mujoco.mj_step2(self.model, self.data)

    def _perturb_floor(self, params: Params) -> None:
        """Sets gravity and floor friction of the next step, of a floor that moves or is slippery in places."""
        self.model.opt.gravity[:] = params.gravity_at(self.data.time + 0.5 * self.sim_dt)
        touched = self.data.qpos[BALL_POSITION]
        if self._terrain is not None:
            touched, _ = contact_plane(self._terrain, touched, self._ball_radius)
        factor = params.floor_friction_factor(touched[0], touched[1])
        self.model.pair_friction[0, :2] = self._floor_friction * factor

    def _turn_contacts(self) -> None:
        """Aligns the first friction direction of each wheel's contact with its drive, and rebuilds its constraint."""
        contacts = self.data.contact
        wheels = self._wheel_of[contacts.geom].max(axis=1)
        turned = wheels >= 0
        frames = contacts.frame
        drives = (self._drives @ self.data.xmat[self._body].reshape(3, 3).T)[wheels[turned]]
        (x, y, z), (u, v, w) = frames[turned, :3].T, drives.T
        frames[turned, 3:6] = drives
        frames[turned, 6:9] = np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=1)
        mujoco.mj_makeConstraint(self.model, self.data)
        mujoco.mj_projectConstraint(self.model, self.data)
        mujoco.mj_referenceConstraint(self.model, self.data)

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Body quaternion (4), body rate (3, body frame), wheel speeds (3), ball position and velocity (2 each)."""
        qpos, qvel = self.data.qpos, self.data.qvel
        return qpos[BODY_QUATERNION], qvel[BODY_RATE], qvel[WHEEL_SPEEDS], qpos[:2], qvel[:2]

    def state(self) -> State:
        """The present state."""
        return State.from_array(self.row())

    def wheel_loads(self) -> Array:
        """Normal force of each wheel on the ball in the last step, (3,), N."""
        loads, force = np.zeros(3), np.zeros(6)
        for k, wheel in enumerate(self._wheel_of[self.data.contact.geom].max(axis=1)):
            if wheel >= 0:
                mujoco.mj_contactForce(self.model, self.data, k, force)
                loads[wheel] = force[0]
        return loads

    def close(self) -> None:
        """Nothing to close."""
