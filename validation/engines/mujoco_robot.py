"""The robot in MuJoCo: its MJCF, and one robot that is stepped by hand."""

import dataclasses
from typing import Any

import mujoco
import numpy as np

import ballbot_rs as bb
from validation.engines.any_robot import ExternalRobot
from validation.engines.geometry import SIM_DT, Array, RobotGeometry
from validation.engines.rotations import matrix

#: Where the pieces stand in qpos (17) and qvel (15): ball, body, three wheels.
BALL_POSITION, BALL_QUATERNION, BODY_POSITION = slice(0, 3), slice(3, 7), slice(7, 10)
BODY_QUATERNION, WHEEL_ANGLES = slice(10, 14), slice(14, 17)
BALL_VELOCITY, BALL_RATE, BODY_VELOCITY = slice(0, 3), slice(3, 6), slice(6, 9)
BODY_RATE, WHEEL_SPEEDS = slice(9, 12), slice(12, 15)

#: Which of a contact's two friction directions is the wheel's drive direction, where the robot faces along x.
#: MuJoCo derives them from the normal and the world's axes, not from the wheel.
_DRIVE_SLOT = (0, 1, 1)
#: Friction across the drive direction: an omniwheel's rollers are free.
_FREE = 1e-5

#: Nothing is computed that is not used.
_UNUSED = (
    '<flag equality="disable" frictionloss="disable" limit="disable" spring="disable" damper="disable"'
    ' clampctrl="disable" sensor="disable" midphase="disable" eulerdamp="disable" island="disable"/>'
)


@dataclasses.dataclass(frozen=True)
class Setup:
    """How MuJoCo steps: time step (s), attributes of its solver, and whether contact frames are turned to the wheels.

    Cones are elliptic, as a pyramid cannot be this thin; contacts are as stiff as the time step allows.
    """

    sim_dt: float
    solver: str
    turned: bool = False

    @property
    def options(self) -> str:
        """The MJCF element."""
        return f'<option timestep="{self.sim_dt}" cone="elliptic" solver="Newton" {self.solver}>{_UNUSED}</option>'

    @property
    def stiffness(self) -> str:
        """Attributes of a contact pair."""
        return f'solref="{2 * self.sim_dt} 1" solimp="0.95 0.99 0.0001"'


#: A loose tolerance, but MuJoCo's full line search, without which the growth rate breaks.
FAST = Setup(SIM_DT, 'integrator="Euler" iterations="10" ls_iterations="50" tolerance="1e-4"')

#: The contacts solved out at 1 kHz, in stock MuJoCo and with their frames turned.
ACCURATE = Setup(1e-3, 'integrator="Euler" iterations="100" ls_iterations="100" tolerance="1e-12"')
ACCURATE_TURNED = dataclasses.replace(ACCURATE, turned=True)


def _numbers(values: Any) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def _inertial(mass: float, com: Array, inertia: Array) -> str:
    i = inertia
    full = [i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2]]
    return f'<inertial mass="{mass:.17g}" pos="{_numbers(com)}" fullinertia="{_numbers(full)}"/>'


def mjcf(robot: RobotGeometry, setup: Setup = FAST) -> str:
    """MJCF of the robot on a floor, with only what it needs: four contact pairs, three motors, no other collision.

    `FAST` is tuned for speed at which the robot still works: the probes show whether it does.
    """
    p = robot.params
    stiffness = setup.stiffness
    wheels, pairs, motors = "", "", ""
    for i in range(3):
        wheels += (
            f'<body pos="{_numbers(robot.centers[i])}">'
            f"{_inertial(p.wheel_mass, np.zeros(3), robot.wheel_inertias[i])}"
            f'<joint name="wheel{i}" type="hinge" axis="{_numbers(robot.axles[i])}"/>'
            f'<geom name="wheel{i}" type="sphere" size="{p.wheel_radius:.17g}"/></body>'
        )
        slots = [_FREE, _FREE]
        slots[0 if setup.turned else _DRIVE_SLOT[i]] = p.wheel_dynamic_friction
        pairs += (
            f'<pair geom1="wheel{i}" geom2="ball" condim="3" friction="{_numbers([*slots, 0, 0, 0])}" {stiffness}/>'
        )
        motors += f'<motor joint="wheel{i}"/>'
    floor = _numbers([p.floor_dynamic_friction, p.floor_dynamic_friction, 0, 0, 0])
    at = f'pos="0 0 {p.ball_radius:.17g}"'
    return f"""<mujoco>
  <compiler angle="radian" inertiafromgeom="false"/>
  {setup.options}<option gravity="{_numbers(p.gravity_vector)}"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body {at}><freejoint/>{_inertial(p.ball_mass, np.zeros(3), p.ball_inertia * np.eye(3))}
      <geom name="ball" type="sphere" size="{p.ball_radius:.17g}"/></body>
    <body {at}><freejoint/>{_inertial(robot.body.mass, robot.body.com, robot.body.inertia)}{wheels}</body>
  </worldbody>
  <contact><pair geom1="floor" geom2="ball" condim="3" friction="{floor}" {stiffness}/>{pairs}</contact>
  <actuator>{motors}</actuator>
</mujoco>"""


class MujocoRobot(ExternalRobot):
    """One robot, one `MjData`."""

    def __init__(self, robot: RobotGeometry, setup: Setup = FAST) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(robot, setup))
        self.data = mujoco.MjData(self.model)
        self.sim_dt = setup.sim_dt
        self._turned, self._drives = setup.turned, robot.drives
        self._wheels = {self.model.geom(f"wheel{i}").id: i for i in range(3)}
        self._body = int(self.model.jnt_bodyid[1])

    def reset_raw(
        self, attitude: Array, rate: Array, speeds: Array, position: Array, velocity: Array, ball_rate: Array
    ) -> None:
        """Starts anew with the body at the ball; arguments as the fields of `ballbot_rs.State`."""
        mujoco.mj_resetData(self.model, self.data)
        qpos = self.data.qpos
        qpos[BALL_POSITION], qpos[BODY_POSITION], qpos[BODY_QUATERNION] = position, position, attitude
        # The ball's rate is in its own frame, which a reset leaves at the inertial one.
        self.data.qvel[:] = np.concatenate([velocity, ball_rate, velocity, rate, speeds])

    def step(self, torques: Array, steps: int) -> None:
        """Advances by `steps` time steps under wheel torques (3, N·m)."""
        self.data.ctrl[:] = torques
        if not self._turned:
            mujoco.mj_step(self.model, self.data, nstep=steps)
            return
        for _ in range(steps):
            mujoco.mj_step1(self.model, self.data)
            self._turn_contacts()
            mujoco.mj_step2(self.model, self.data)

    def _turn_contacts(self) -> None:
        """Lays the first friction direction of each wheel's contact along its drive, and makes its constraint anew."""
        axes = self.data.xmat[self._body].reshape(3, 3)
        for contact in self.data.contact:
            wheel = self._wheels.get(int(contact.geom1), self._wheels.get(int(contact.geom2)))
            if wheel is not None:
                normal, drive = contact.frame[:3], axes @ self._drives[wheel]
                contact.frame[3:6], contact.frame[6:9] = drive, np.cross(normal, drive)
        mujoco.mj_makeConstraint(self.model, self.data)
        mujoco.mj_projectConstraint(self.model, self.data)
        mujoco.mj_referenceConstraint(self.model, self.data)

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Body quaternion (4), body rate (3, body frame), wheel speeds (3), ball position and velocity (2 each)."""
        qpos, qvel = self.data.qpos, self.data.qvel
        return qpos[BODY_QUATERNION], qvel[BODY_RATE], qvel[WHEEL_SPEEDS], qpos[:2], qvel[:2]

    def state(self) -> bb.State:
        """The present state."""
        qpos, qvel = self.data.qpos, self.data.qvel
        ball = qpos[BALL_QUATERNION]
        return bb.State(
            qpos[BALL_POSITION], qvel[BALL_VELOCITY], matrix(ball) @ qvel[BALL_RATE], qpos[BODY_QUATERNION],
            qvel[BODY_RATE], qvel[WHEEL_SPEEDS], ball_quaternion=ball, wheel_angles=qpos[WHEEL_ANGLES],
            body_position=qpos[BODY_POSITION], body_velocity=qvel[BODY_VELOCITY],
        )  # fmt: skip

    def wheel_loads(self) -> Array:
        """Normal force of each wheel on the ball in the last step, (3,), N."""
        loads, force = np.zeros(3), np.zeros(6)
        for k, contact in enumerate(self.data.contact):
            wheel = self._wheels.get(int(contact.geom1), self._wheels.get(int(contact.geom2)))
            if wheel is not None:
                mujoco.mj_contactForce(self.model, self.data, k, force)
                loads[wheel] = force[0]
        return loads

    def close(self) -> None:
        """Nothing to close."""
