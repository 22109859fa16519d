"""assets/bot.urdf as read by Pinocchio, MuJoCo and PyBullet, all in the body frame."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ballbot_rs.engines.robot_geometry import Array
from validation.engines.rotations import matrix

BOT = Path(__file__).parents[2] / "assets" / "bot.urdf"
BALL = BOT.with_name("ball.urdf")
_WHEELS = range(3)


@dataclass(frozen=True)
class FreeState:
    """The bot in free fall: attitude, then velocity of the origin (inertial), rate (body) and wheel speeds."""

    quaternion: Array
    velocity: Array
    rate: Array
    wheel_speeds: Array
    wheel_angles: Array
    torques: Array


@dataclass(frozen=True)
class Read:
    """Four links, the body first, and three joints, in the body frame.

    `mass_matrix` is for (velocity of the origin, rate, both in the body frame, wheel speeds); `acceleration` for the
    origin (inertial), the rate (body) and the wheel speeds.
    """

    masses: Array
    coms: Array
    #: About each link's center of mass, (4, 3, 3).
    inertias: Array
    axes: Array
    centers: Array
    mass_matrix: Callable[[FreeState], Array]
    acceleration: Callable[[FreeState], Array] | None = None

    def composite(self) -> tuple[float, Array, Array]:
        """Mass, center of mass, and inertia about it with the wheels locked."""
        mass = float(self.masses.sum())
        com = self.masses @ self.coms / mass
        inertia = self.inertias.sum(axis=0)
        for link, at in zip(self.masses, self.coms - com, strict=True):
            inertia += link * (at @ at * np.eye(3) - np.outer(at, at))
        return mass, com, inertia


def pinocchio() -> Read:
    """Free-flyer joint: velocity of the origin and rate, both in the body frame."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(BOT), pin.JointModelFreeFlyer())
    data = model.createData()
    joints = [model.getJointId(f"wheel_joint_{i}") for i in _WHEELS]
    placements = [model.jointPlacements[joint] for joint in joints]
    turns = [np.eye(3), *(np.array(placement.rotation) for placement in placements)]
    at = [np.zeros(3), *(np.array(placement.translation) for placement in placements)]
    links = [model.inertias[joint] for joint in (1, *joints)]

    def q(s: FreeState) -> Array:
        w, x, y, z = s.quaternion
        # A continuous joint has the cosine and sine of its angle as coordinates.
        circles = np.stack([np.cos(s.wheel_angles), np.sin(s.wheel_angles)], axis=1).ravel()
        return np.concatenate([np.zeros(3), [x, y, z, w], circles])

    def mass_matrix(s: FreeState) -> Array:
        upper = np.triu(pin.crba(model, data, q(s)))
        return np.asarray(upper + np.triu(upper, 1).T)

    def acceleration(s: FreeState) -> Array:
        turn = matrix(s.quaternion)
        velocity = turn.T @ s.velocity
        v = np.concatenate([velocity, s.rate, s.wheel_speeds])
        a = np.array(pin.aba(model, data, q(s), v, np.concatenate([np.zeros(6), s.torques])))
        # The acceleration of components in the moving frame, not of the point.
        a[:3] = turn @ (a[:3] + np.cross(s.rate, velocity))
        return a

    return Read(
        np.array([link.mass for link in links]),
        np.array([o + turn @ link.lever for o, turn, link in zip(at, turns, links, strict=True)]),
        np.array([turn @ link.inertia @ turn.T for turn, link in zip(turns, links, strict=True)]),
        np.array([turn[:, 2] for turn in turns[1:]]),
        np.array(at[1:]),
        mass_matrix,
        acceleration,
    )


def mujoco() -> Read:
    """Free joint: velocity of the origin in the inertial frame, rate in the body's."""
    import mujoco as mj

    spec = mj.MjSpec.from_file(str(BOT))
    spec.compiler.fusestatic = False
    spec.body("body").add_freejoint()
    model = spec.compile()
    data = mj.MjData(model)
    bodies = [model.body("body").id, *(model.body(f"wheel_{i}").id for i in _WHEELS)]
    turns = [np.eye(3), *(matrix(model.body_quat[body]) for body in bodies[1:])]
    at = [np.zeros(3), *(np.array(model.body_pos[body]) for body in bodies[1:])]
    principal = [turn @ matrix(model.body_iquat[body]) for turn, body in zip(turns, bodies, strict=True)]

    def put(s: FreeState) -> None:
        data.qpos[:] = np.concatenate([np.zeros(3), s.quaternion, s.wheel_angles])
        data.qvel[:] = np.concatenate([s.velocity, s.rate, s.wheel_speeds])
        data.qfrc_applied[6:] = s.torques
        mj.mj_forward(model, data)

    def mass_matrix(s: FreeState) -> Array:
        put(s)
        full = np.zeros((model.nv, model.nv))
        mj.mj_fullM(model, data, full)
        to_inertial = np.eye(9)
        to_inertial[:3, :3] = matrix(s.quaternion)
        return np.asarray(to_inertial.T @ full @ to_inertial)

    def acceleration(s: FreeState) -> Array:
        put(s)
        return np.array(data.qacc_smooth)

    return Read(
        np.array(model.body_mass[bodies]),
        np.array([o + turn @ model.body_ipos[body] for o, turn, body in zip(at, turns, bodies, strict=True)]),
        np.array([p @ np.diag(model.body_inertia[body]) @ p.T for p, body in zip(principal, bodies, strict=True)]),
        np.array([turn @ model.joint(f"wheel_joint_{i}").axis for i, turn in zip(_WHEELS, turns[1:], strict=True)]),
        np.array(at[1:]),
        mass_matrix,
        acceleration,
    )


def pybullet(from_file: bool = True) -> Read:
    """Base: rate before velocity (of the body link's center of mass), both in the body frame."""
    import pybullet as pb

    from validation.engines.pybullet_robot import connect

    bullet = connect()
    bot = bullet.loadURDF(str(BOT), flags=pb.URDF_USE_INERTIA_FROM_FILE if from_file else 0)
    infos = [bullet.getDynamicsInfo(bot, link) for link in (-1, *_WHEELS)]
    com = np.array(infos[0][3])
    joints = [bullet.getJointInfo(bot, i) for i in _WHEELS]
    # From the base's center of mass; the quaternion is the inverse rotation.
    at = [np.zeros(3), *(com + np.array(joint[14]) for joint in joints)]
    turns = [np.eye(3), *(matrix(np.roll(joint[15], 1)).T for joint in joints)]
    local = [matrix(np.roll(info[4], 1)) for info in infos]
    principal = [turn @ inner for turn, inner in zip(turns, local, strict=True)]

    def mass_matrix(s: FreeState) -> Array:
        x, y, z = s.quaternion[1:]
        bullet.resetBasePositionAndOrientation(bot, [0.0, 0.0, 0.0], [x, y, z, s.quaternion[0]])
        full = np.array(bullet.calculateMassMatrix(bot, s.wheel_angles.tolist()))
        to_base = np.eye(9)
        to_base[:3, :3], to_base[:3, 3:6] = np.zeros((3, 3)), np.eye(3)
        to_base[3:6, :3], to_base[3:6, 3:6] = np.eye(3), np.cross(np.eye(3), com).T
        return np.asarray(to_base.T @ full @ to_base)

    return Read(
        np.array([info[0] for info in infos]),
        np.array([o + turn @ np.array(info[3]) for o, turn, info in zip(at, turns, infos, strict=True)]),
        np.array([p @ np.diag(info[2]) @ p.T for p, info in zip(principal, infos, strict=True)]),
        np.array([turn @ np.array(joint[13]) for joint, turn in zip(joints, turns[1:], strict=True)]),
        np.array(at[1:]),
        mass_matrix,
    )
