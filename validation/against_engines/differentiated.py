"""A step of the robot in `contact` and in MuJoCo, differentiated: velocities by rotation, velocities and torques.

Derivatives are (15, 21): the velocities of ball and body, wheel speeds, in the order of `Jacobian.states`, by a
rotation of the body, by the same velocities, and by the torques.
"""

import mujoco
import numpy as np

import ballbot_rs as bb
from ballbot_rs import _state_rows as rows
from ballbot_rs.engines.mujoco_robot import MujocoRobot, accurate
from ballbot_rs.engines.robot_geometry import Array, robot_geometry
from validation.against_engines.engine_list import SIM_DT
from validation.engines import rotations

#: Time steps from a start to the state at which a step is differentiated: MuJoCo's contacts have settled.
_BEFORE = 20
#: Columns by rotation, by velocities and by torques.
_KINDS = (slice(0, 3), slice(3, 18), slice(18, 21))
#: Of a difference, by rotation, by velocities and by torques.
Steps = tuple[float, float, float]

_VELOCITIES = np.r_[rows.BALL_VELOCITY, rows.BALL_RATE, rows.BODY_VELOCITY, rows.BODY_RATE, rows.WHEEL_SPEEDS]


def error(found: Array, truth: Array) -> float:
    """The largest error, relative to the largest entry of its kind."""
    return max(float(np.abs((found - truth)[:, kind]).max() / np.abs(truth[:, kind]).max()) for kind in _KINDS)


def chosen(by_kind: list[Array]) -> Array:
    """One derivative from three: its columns by rotation, by velocities and by torques."""
    return np.concatenate([part[:, kind] for part, kind in zip(by_kind, _KINDS, strict=True)], axis=1)


class Contact:
    """A step of `contact`."""

    def __init__(self, params: bb.Params, start: bb.State, torques: Array) -> None:
        self._robot, self._torques = bb.Ballbot(params, sim_dt=SIM_DT), torques
        self._robot.reset(start)
        self._robot.step(torques, _BEFORE)
        self._row = self._robot.state.to_array()
        jacobian = self._robot.jacobian(torques)
        turn, speed = (jacobian.states.index(name) for name in ("body_rotation_x", "ball_velocity_x"))
        velocities = slice(speed, speed + len(_VELOCITIES))
        a = jacobian.A[velocities]
        self.exact = np.concatenate([a[:, turn : turn + 3], a[:, velocities], jacobian.B[velocities]], axis=1)

    def difference(self, step: float, *, central: bool) -> Array:
        """A difference of first or second order."""
        changes = step * np.eye(self.exact.shape[1])
        ahead = np.array([self._after(change) for change in changes])
        behind = np.array([self._after(-change) for change in changes]) if central else self._after(0.0 * changes[0])
        return np.asarray((ahead - behind).T / (2.0 * step if central else step))

    def _after(self, change: Array) -> Array:
        row = self._row.copy()
        angle = float(np.linalg.norm(change[:3]))
        turn = np.array([np.cos(0.5 * angle), *(0.5 * np.sinc(0.5 * angle / np.pi) * change[:3])])
        row[rows.BODY_QUATERNION] = rotations.product(row[rows.BODY_QUATERNION], turn)
        row[_VELOCITIES] += change[3:18]
        self._robot.reset(bb.State.from_array(row))
        self._robot.step(self._torques + change[18:])
        return np.asarray(self._robot.state.to_array()[_VELOCITIES])


class Mujoco:
    """A step of MuJoCo, whose solver stopped at a tolerance up to now."""

    def __init__(self, params: bb.Params, start: bb.State, torques: Array, tolerance: float) -> None:
        robot = MujocoRobot(robot_geometry(params), accurate(SIM_DT, turned=False))
        self.model, self.data = robot.model, robot.data
        self.model.opt.tolerance = tolerance
        robot.reset(start)
        robot.step(torques, _BEFORE)
        #: Depths of the contacts, m.
        self.depths = -self.data.contact.dist

    def difference(self, step: float, *, central: bool) -> Array:
        """What `mjd_transitionFD` returns."""
        a, b = self._transition(step, central)
        return np.concatenate([a[15:, 9:12], a[15:, 15:], b[15:]], axis=1)

    def heights(self, step: float) -> Array:
        """Central difference of the velocities by the heights of ball and body, (15, 2)."""
        return self._transition(step, True)[0][15:, [2, 8]]

    def _transition(self, step: float, central: bool) -> tuple[Array, Array]:
        nv, nu = self.model.nv, self.model.nu
        a, b = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, nu))
        mujoco.mjd_transitionFD(self.model, self.data, step, central, a, b, None, None)
        return a, b


def fourth_order(robot: Contact | Mujoco, steps: Steps) -> Array:
    """Difference of fourth order, with a step for each kind of column."""
    near = [robot.difference(step, central=True) for step in steps]
    far = [robot.difference(2.0 * step, central=True) for step in steps]
    return (4.0 * chosen(near) - chosen(far)) / 3.0
