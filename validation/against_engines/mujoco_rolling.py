"""The robot in MuJoCo without slip: MuJoCo's mechanics of the two URDFs and its integrator, contacts as constraints."""

import mujoco
import numpy as np

import ballbot_rs as bb
from ballbot_rs.engines.robot_geometry import Array
from validation.against_engines.urdf_readers import BALL, BOT
from validation.engines.rotations import matrix

#: Step of the difference quotient along the motion for the constraints' rate, s.
_AHEAD = 1e-5
#: Rows of the constraints: normal and drive direction of each wheel, then the floor.
_NORMAL, _DRIVE, _FLOOR = slice(0, 3), slice(3, 6), slice(6, 9)


class MujocoRolling:
    """Ball and bot are free bodies; at every evaluation of MuJoCo's Runge-Kutta method a callback adds contact forces.

    They keep the nine velocity constraints J(q)v = 0: no motion of the ball's lowest point, none between wheel and ball
    along the normal and the drive direction. With MuJoCo's M, bias b and Jacobians,
    λ = (J M⁻¹ Jᵀ)⁻¹ (−J̇v − J M⁻¹(τ − b)). It uses none of our equations of motion.
    If not `touching`, ball and bot pass through each other and the floor.
    """

    def __init__(self, params: bb.Params, sim_dt: float, touching: bool = True) -> None:
        bot, ball = mujoco.MjSpec.from_file(str(BOT)), mujoco.MjSpec.from_file(str(BALL))
        for spec, link in ((bot, "body"), (ball, "ball")):
            spec.compiler.fusestatic = False
            spec.body(link).add_freejoint()
        bot.attach(ball, frame=bot.worldbody.add_frame(), prefix="ball/")
        bot.option.timestep, bot.option.gravity = sim_dt, params.gravity_vector
        bot.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        bot.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.sim_dt, self._touching = sim_dt, touching
        self.model = bot.compile()
        self.data, self._scratch = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._ball, self._body = self.model.body("ball/ball").id, self.model.body("body").id
        self._wheels = [self.model.body(f"wheel_{i}").id for i in range(3)]
        self._radius = params.ball_radius
        self._forces, self._torques = np.zeros(9), np.zeros(3)

    def reset(self, state: bb.State) -> None:
        """Restarts from `state`."""
        mujoco.mj_resetData(self.model, self.data)
        body = (state.body_position, state.body_quaternion, state.wheel_angles)
        self.data.qpos[:] = np.concatenate([*body, state.ball_position, state.ball_quaternion])
        body = (state.body_velocity, state.body_angular_velocity, state.wheel_speeds)
        # A free joint's rate is in its own frame.
        ball_rate = matrix(state.ball_quaternion).T @ state.ball_angular_velocity
        self.data.qvel[:] = np.concatenate([*body, state.ball_velocity, ball_rate])

    def step(self, torques: Array, steps: int) -> None:
        """Advances by time steps under wheel torques (3, N·m)."""
        self._torques = np.asarray(torques)
        if not self._touching:
            self.data.qfrc_applied[6:9] = self._torques
            mujoco.mj_step(self.model, self.data, nstep=steps)
            return
        mujoco.set_mjcb_control(self._apply)
        try:
            mujoco.mj_step(self.model, self.data, nstep=steps)
        finally:
            mujoco.set_mjcb_control(None)

    def _apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Sets the applied forces: motors and contacts."""
        rows = self._rows(data)
        applied = np.zeros(model.nv)
        applied[6:9] = self._torques
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        inverse = np.linalg.inv(mass)
        free = inverse @ (applied + data.qfrc_passive - data.qfrc_bias)
        self._forces = np.linalg.solve(rows @ inverse @ rows.T, -self._drift(data) - rows @ free)
        data.qfrc_applied[:] = applied + rows.T @ self._forces

    def _drift(self, data: mujoco.MjData) -> Array:
        """J̇v, by a central difference of J along the motion."""
        change, scratch = np.zeros(9), self._scratch
        for sign in (1.0, -1.0):
            scratch.qpos[:] = data.qpos
            mujoco.mj_integratePos(self.model, scratch.qpos, data.qvel, sign * _AHEAD)
            mujoco.mj_kinematics(self.model, scratch)
            mujoco.mj_comPos(self.model, scratch)
            change += sign * (self._rows(scratch) @ data.qvel)
        return change / (2.0 * _AHEAD)

    def _rows(self, data: mujoco.MjData) -> Array:
        """J, (9, nv)."""
        center = data.xpos[self._ball]
        rows = np.zeros((9, self.model.nv))
        rows[_FLOOR] = self._jacobian(data, center - [0.0, 0.0, self._radius], self._ball)
        up = data.xmat[self._body].reshape(3, 3)[:, 2]
        for i, wheel in enumerate(self._wheels):
            # Relative to the bot's own frame, as the two bodies' origins may drift apart by the integration error.
            normal = data.xpos[wheel] - data.xpos[self._body]
            normal = normal / np.linalg.norm(normal)
            drive = np.cross(up, normal)
            drive = drive / np.linalg.norm(drive)
            point = center + self._radius * normal
            between = self._jacobian(data, point, wheel) - self._jacobian(data, point, self._ball)
            rows[_NORMAL][i], rows[_DRIVE][i] = normal @ between, drive @ between
        return rows

    def _jacobian(self, data: mujoco.MjData, point: Array, body: int) -> Array:
        jacobian = np.zeros((3, self.model.nv))
        mujoco.mj_jac(self.model, data, jacobian, None, point, body)
        return jacobian

    def sense(self) -> tuple[Array, Array, Array, Array, Array]:
        """Attitude (4), body rate (3), wheel speeds (3), ball position and velocity (2 each)."""
        qpos, qvel = self.data.qpos, self.data.qvel
        return qpos[3:7], qvel[3:6], qvel[6:9], qpos[10:12], qvel[9:11]

    def state(self) -> bb.State:
        """The present state."""
        qpos, qvel = self.data.qpos, self.data.qvel
        ball = qpos[13:17]
        return bb.State(
            qpos[10:13], qvel[9:12], matrix(ball) @ qvel[12:15], qpos[3:7], qvel[3:6], qvel[6:9],
            ball_quaternion=ball, wheel_angles=qpos[7:10], body_position=qpos[:3], body_velocity=qvel[:3],
        )  # fmt: skip

    def wheel_loads(self) -> Array:
        """Normal forces (3, N) at the last evaluation."""
        return np.array(self._forces[_NORMAL])

    def slip(self) -> float:
        """Largest violation of a constraint, m/s."""
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        return float(np.abs(self._rows(self.data) @ self.data.qvel).max())

    def close(self) -> None:
        """Nothing to close."""
