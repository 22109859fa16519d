"""The robot in PyBullet: one robot in one physics server."""

import ctypes
import os
import sys
import tempfile
from pathlib import Path

import numpy as np
import pybullet
from pybullet_utils import bullet_client

import ballbot_rs as bb
from ballbot_rs._checks import check_still_floor
from ballbot_rs.engines.robot_geometry import Array, RobotGeometry
from validation.engines.any_robot import ExternalRobot
from validation.engines.rotations import matrix, roll_pitch_yaw
from validation.engines.steps import SIM_DT

#: Iterations of Bullet's sequential-impulse solver; half as many increase the growth rate's error tenfold.
SOLVER_ITERATIONS = 10

_STILL = {"linearDamping": 0.0, "angularDamping": 0.0, "restitution": 0.0, "rollingFriction": 0.0}


def _link(name: str, mass: float, com: Array, inertia: Array, shape: str = "") -> str:
    terms = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    moments = " ".join(f'{term}="{inertia[at]:.17g}"' for term, at in terms.items())
    return (
        f'<link name="{name}"><inertial><origin xyz="{com[0]:.17g} {com[1]:.17g} {com[2]:.17g}"/>'
        f'<mass value="{mass:.17g}"/><inertia {moments}/></inertial>{shape}</link>'
    )


def _sphere(radius: float) -> str:
    return f'<collision><geometry><sphere radius="{radius:.17g}"/></geometry></collision>'


def urdfs(robot: RobotGeometry) -> tuple[str, str]:
    """URDFs of the ball and of the body with its wheels; a wheel's frame has x along its axle, y along its drive."""
    p = robot.params
    ball = _link("ball", p.ball_mass, np.zeros(3), p.ball_inertia * np.eye(3), _sphere(p.ball_radius))
    body = _link("body", robot.body.mass, robot.body.com, robot.body.inertia)
    for i in range(3):
        axes = np.stack([robot.axles[i], robot.drives[i], np.cross(robot.axles[i], robot.drives[i])], axis=1)
        x, y, z = robot.centers[i]
        roll, pitch, yaw = roll_pitch_yaw(axes)
        inertia = axes.T @ robot.wheel_inertias[i] @ axes
        body += _link(f"wheel{i}", p.wheel_mass, np.zeros(3), inertia, _sphere(p.wheel_radius))
        body += (
            f'<joint name="joint{i}" type="continuous"><parent link="body"/><child link="wheel{i}"/>'
            f'<origin xyz="{x:.17g} {y:.17g} {z:.17g}" rpy="{roll:.17g} {pitch:.17g} {yaw:.17g}"/>'
            '<axis xyz="1 0 0"/></joint>'
        )
    return f'<robot name="ball">{ball}</robot>', f'<robot name="bot">{body}</robot>'


def connect() -> bullet_client.BulletClient:
    """A separate physics server, without the line that Bullet prints from C for each."""
    flush = ctypes.CDLL(None).fflush
    sys.stdout.flush()
    kept = os.dup(1)
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        try:
            return bullet_client.BulletClient(connection_mode=pybullet.DIRECT)
        finally:
            flush(None)
            os.dup2(kept, 1)
            os.close(kept)


class PybulletRobot(ExternalRobot):
    """One robot in its own physics server, in this process."""

    def __init__(self, robot: RobotGeometry, sim_dt: float = SIM_DT, iterations: int = SOLVER_ITERATIONS) -> None:
        p = robot.params
        if p.wheel_preload != 0.0:
            # Forces of PyBullet act for one step, not along a body that turns in substeps.
            raise bb.InvalidInputError(f"PyBullet does not simulate wheel_preload = {p.wheel_preload}: it must be 0")
        if p.roller_angle != 0.0:
            # Anisotropic friction is along the axes of the link.
            raise bb.InvalidInputError(f"PyBullet does not simulate roller_angle = {p.roller_angle}: it must be 0")
        check_still_floor(p, "PyBullet")
        self.sim_dt = sim_dt
        self._com = robot.body.com
        self._joints = [0, 1, 2]
        self._bullet = bullet = connect()
        bullet.setGravity(*p.gravity_vector)
        # The row across the drive has no length, and a cone would let it use up the limit of both.
        bullet.setPhysicsEngineParameter(numSolverIterations=iterations, enableConeFriction=0, enableFileCaching=0)
        self._substeps = 0
        self._set_substeps(1)
        floor = bullet.createMultiBody(0.0, bullet.createCollisionShape(bullet.GEOM_PLANE))
        with tempfile.TemporaryDirectory() as folder:
            for name, text in zip(("ball", "bot"), urdfs(robot), strict=True):
                (Path(folder) / f"{name}.urdf").write_text(text, encoding="utf-8")
            # Files are the only way to give a link its inertia: changeDynamics sets the base's instead.
            flags = bullet.URDF_USE_INERTIA_FROM_FILE
            self._ball = bullet.loadURDF(f"{folder}/ball.urdf", [0.0, 0.0, p.ball_radius], flags=flags)
            self._body = bullet.loadURDF(f"{folder}/bot.urdf", [0.0, 0.0, p.ball_radius], flags=flags)
        # Bullet multiplies the friction of a pair: the ball has 1, the others their own.
        bullet.changeDynamics(floor, -1, lateralFriction=p.floor_dynamic_friction, restitution=0.0)
        bullet.changeDynamics(self._ball, -1, lateralFriction=1.0, spinningFriction=0.0, **_STILL)
        bullet.changeDynamics(self._body, -1, **_STILL)
        for i in self._joints:
            bullet.changeDynamics(self._body, i, lateralFriction=p.wheel_dynamic_friction, jointDamping=0.0, **_STILL)
            bullet.changeDynamics(self._body, i, maxJointVelocity=1000.0)
            # The rollers are free along the axle.
            bullet.changeDynamics(self._body, i, anisotropicFriction=[0.0, 1.0, 1.0])
            bullet.setCollisionFilterPair(floor, self._body, -1, i, 0)
        # By default Bullet brakes every joint.
        bullet.setJointMotorControlArray(self._body, self._joints, bullet.VELOCITY_CONTROL, forces=[0.0] * 3)

    def _set_substeps(self, substeps: int) -> None:
        if substeps != self._substeps:
            self._substeps = substeps
            self._bullet.setPhysicsEngineParameter(fixedTimeStep=self.sim_dt * substeps, numSubSteps=substeps)

    def reset_raw(
        self, attitude: Array, rate: Array, speeds: Array, position: Array, velocity: Array, ball_rate: Array
    ) -> None:
        """Restarts with the body at the ball; arguments as the fields of `ballbot_rs.State`."""
        bullet, turn = self._bullet, matrix(attitude)
        bullet.resetBasePositionAndOrientation(self._ball, position.tolist(), [0.0, 0.0, 0.0, 1.0])
        bullet.resetBaseVelocity(self._ball, velocity.tolist(), ball_rate.tolist())
        # Bullet places a base by its center of mass.
        arm, rate = turn @ self._com, turn @ rate
        w, x, y, z = attitude.tolist()
        bullet.resetBasePositionAndOrientation(self._body, (position + arm).tolist(), [x, y, z, w])
        bullet.resetBaseVelocity(self._body, (velocity + np.cross(rate, arm)).tolist(), rate.tolist())
        bullet.resetJointStatesMultiDof(self._body, self._joints, [[0.0]] * 3, [[speed] for speed in speeds.tolist()])

    def step(self, torques: Array, steps: int) -> None:
        """Advances by `steps` time steps under wheel torques (3, N·m)."""
        self._set_substeps(steps)
        self._bullet.setJointMotorControlArray(
            self._body, self._joints, pybullet.TORQUE_CONTROL, forces=np.asarray(torques).tolist()
        )
        self._bullet.stepSimulation()

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Body quaternion (4), body rate (3, body frame), wheel speeds (3), ball position and velocity (2 each)."""
        bullet = self._bullet
        _, (x, y, z, w) = bullet.getBasePositionAndOrientation(self._body)
        attitude = np.array([w, x, y, z])
        rate = matrix(attitude).T @ np.array(bullet.getBaseVelocity(self._body)[1])
        position = bullet.getBasePositionAndOrientation(self._ball)[0][:2]
        velocity = bullet.getBaseVelocity(self._ball)[0][:2]
        speeds = np.array([joint[1] for joint in bullet.getJointStates(self._body, self._joints)])
        return attitude, rate, speeds, np.array(position), np.array(velocity)

    def state(self) -> bb.State:
        """The present state."""
        bullet = self._bullet
        position, (x, y, z, w) = bullet.getBasePositionAndOrientation(self._ball)
        velocity, ball_rate = bullet.getBaseVelocity(self._ball)
        attitude, rate, speeds, _, _ = self.sense()
        arm = matrix(attitude) @ self._com
        com = np.array(bullet.getBasePositionAndOrientation(self._body)[0])
        com_velocity, turning = (np.array(v) for v in bullet.getBaseVelocity(self._body))
        angles = [joint[0] for joint in bullet.getJointStates(self._body, self._joints)]
        return bb.State(
            position, velocity, ball_rate, attitude, rate, speeds, ball_quaternion=[w, x, y, z], wheel_angles=angles,
            body_position=com - arm, body_velocity=com_velocity - np.cross(turning, arm),
        )  # fmt: skip

    def wheel_loads(self) -> Array:
        """Normal force of each wheel on the ball in the last step, (3,), N; steps must be made one by one."""
        loads = np.zeros(3)
        for contact in self._bullet.getContactPoints(self._ball, self._body):
            loads[contact[4]] += contact[9]
        return loads

    def close(self) -> None:
        """Closes the physics server."""
        self._bullet.disconnect()
