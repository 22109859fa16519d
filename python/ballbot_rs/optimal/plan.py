"""One robot, its start and its goal: costs, first motions and results of an optimization."""

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_bounded, check_no_payload, check_still_floor, real_array
from ballbot_rs._core import Ballbot, Lqr, Reference, State, Terrain
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._quaternions import about_vertical, conjugate, product
from ballbot_rs._robot import Robot, params_of
from ballbot_rs.control.laws import Laws
from ballbot_rs.control.setpoints import Setpoint
from ballbot_rs.optimal import solver, tangent
from ballbot_rs.optimal.cost import Quadratic
from ballbot_rs.optimal.law import LEAN_OBSERVER
from ballbot_rs.optimal.linear import check_on_ball, steps_of
from ballbot_rs.optimal.result import OptimizedTrajectory, stretched

Array = npt.NDArray[np.float64]

#: Coordinates of `Jacobian.states`: position and velocity of the ball, lean and heading of the body, and their rates.
_PLACE, _POSITION, _LEAN, _YAW = slice(0, 3), slice(0, 2), slice(9, 11), slice(11, 12)
_VELOCITY, _SPIN, _LEAN_RATE, _YAW_RATE = slice(15, 17), slice(20, 21), slice(24, 26), slice(26, 27)

#: Differences from the goal within which it is reached, for the paper's robot: coordinates, amount, unit.
GOAL = (
    (_PLACE, 1e-3, "m"),
    (_VELOCITY, 5e-3, "m/s"),
    (_LEAN, 2e-3, ""),
    (_YAW, 5e-3, ""),
    (_LEAN_RATE, 1e-2, "rad/s"),
    (_YAW_RATE, 2e-2, "rad/s"),
    (_SPIN, 1e-1, "rad/s"),
)
#: Differences from a reference of equal cost per second.
ON_REFERENCE = (
    (_POSITION, 1e-3, "m"),
    (_VELOCITY, 1e-1, "m/s"),
    (_YAW, 2e-2, ""),
    (_YAW_RATE, 2e-1, "rad/s"),
)
#: Differences from the motion of equal cost per second, for the gains of the law.
FEEDBACK = (
    (_POSITION, 3e-2, "m"),
    (_VELOCITY, 1e-1, "m/s"),
    (_LEAN, 5e-2, ""),
    (_YAW, 1e-1, ""),
    (_LEAN_RATE, 3e-1, "rad/s"),
    (_YAW_RATE, 5e-1, "rad/s"),
)
#: The torque that costs 1/2 per second, and the largest change of a torque in an iteration, for the paper's robot, N·m.
TORQUE, LARGEST_CHANGE = 0.25, 0.05
#: Time for which a motion along a reference is continued, for the paper's robot, s: without it, it would end in a fall.
TAIL = 1.0
#: Weight of the last state in the gains, in seconds of the motion.
LAST = 0.3
#: Weight of the goal: the first, and its growth until it is reached.
FIRST_WEIGHT, GROWTH, WEIGHTS = 1e-4, 30.0, 6
#: Weights of a reference, on level ground and on a terrain, where the first motion is far from it.
LEVEL_WEIGHTS, TERRAIN_WEIGHTS = (1.0,), (1e-3, 0.03, 1.0)
#: Weight of traction beyond its limit: relative to the weight of the goal, and per second along a reference.
TRACTION, TRACTION_ON_REFERENCE = 1e6, 1e3
#: Fractions of the friction limit for the first motion, until it does not fall.
FIRST_FRICTION = (0.8, 0.6, 0.4, 0.2)
#: Most control steps of a motion.
MOST_STEPS = 20_000


class Plan:
    """One robot, and what is to be done with it."""

    plant: solver.Plant
    #: The reference to follow; None for a motion to a goal.
    reference: Reference | None
    #: The desired state at each time, shape (T + 1, 32).
    targets: Array

    def __init__(
        self,
        robot: Robot | None,
        terrain: Terrain | str | None,
        control_dt: float,
        sim_dt: float,
        max_torque: float | None,
        friction: float,
    ) -> None:
        params = params_of(robot)
        self.robot = Ballbot(params, "contact", sim_dt, terrain)
        #: Another one, to find equilibria.
        self.scratch = Ballbot(params, "contact", sim_dt, terrain)
        self.params = self.robot.params
        self.substeps = steps_of("control_dt", control_dt, sim_dt)
        self.control_dt, self.sim_dt, self.friction = control_dt, sim_dt, friction
        limit = self.params.max_wheel_torque if max_torque is None else max_torque
        self.max_torque = check_bounded("max_torque", limit, 1e-9, self.params.max_wheel_torque)
        if any(self.params.floor_tilt):
            raise InvalidInputError(
                f"floor_tilt = {self.params.floor_tilt}: a slope must be terrain=Terrain.plane(slope, direction)"
            )
        check_still_floor(self.params, "an optimization")
        check_no_payload(self.params, "an optimization")
        self.iteration = 0

    @property
    def torque(self) -> float:
        """A torque that is large for this robot, N·m."""
        return TORQUE * self.params.scale("N·m")

    def begin(self, start: State | None, goal: Reference | State | npt.ArrayLike, steps: int) -> None:
        """Puts the robot at the start of a motion of this many steps; a reference is continued by its tail."""
        self.reference = goal if isinstance(goal, Reference) else None
        self.steps = steps
        for name, state in (("start", start), ("goal", goal)):
            if isinstance(state, State):
                check_on_ball(name, state)
        if start is not None:
            self.robot.reset(start)
        elif self.reference is not None:
            first = self.reference(0.0)
            x, y = first["position"]
            self.robot.place_on_ground(float(x), float(y), first["yaw"])
        else:
            self.robot.place_on_ground(0.0, 0.0)
        change = LARGEST_CHANGE * self.params.scale("N·m")
        self.plant = solver.Plant(self.robot, self.substeps, self.max_torque, change)
        tail = 0 if self.reference is None else math.ceil(TAIL * self.params.scale("s") / self.control_dt)
        self.targets = self._targets(goal, steps + tail)

    def _targets(self, goal: Reference | State | npt.ArrayLike, steps: int) -> Array:
        here = self.robot.state
        if isinstance(goal, Reference):
            rows = np.repeat(here.to_array()[None], steps + 1, axis=0)
            along = goal.sample(np.arange(steps + 1) * self.control_dt)
            rows[:, 0:2], rows[:, 7:9] = along["position"], along["velocity"]
            rows[:, 16:20] = about_vertical(along["yaw"])
            rows[:, 23:25], rows[:, 25] = 0.0, along["yaw_rate"]
            return rows
        if not isinstance(goal, State):
            place = real_array("goal is", goal, "a position (x, y), a State or a Reference").astype(np.float64)
            if place.shape != (2,) or not np.isfinite(place).all():
                raise InvalidInputError(f"goal = {goal} is not a position (x, y), m")
            self.scratch.place_on_ground(float(place[0]), float(place[1]), here.yaw)
            goal = self.scratch.state
        return np.repeat(goal.to_array()[None], steps + 1, axis=0)

    def first(
        self, initial: OptimizedTrajectory | Callable[[State], npt.ArrayLike] | None
    ) -> tuple[solver.Motion, solver.Derivatives]:
        """The first motion: of least cost among the laws of the first group whose robot does not fall."""
        cost = self.cost(self.weights()[0])
        for laws in self._groups(initial):
            motions = [self.plant.motion(law, len(self.targets) - 1) for law in laws]
            found = [(m, self.plant.derivatives(m)) for m in motions if m is not None]
            upright = [(motion, derivatives) for motion, derivatives in found if derivatives is not None]
            if upright:
                return min(upright, key=lambda one: cost.total(one[0]))
        raise InvalidInputError(
            "the robot falls in every initial motion tried: give more seconds, a start from which Lqr recovers, or a "
            "law that recovers as initial="
        )

    def _groups(
        self, initial: OptimizedTrajectory | Callable[[State], npt.ArrayLike] | None
    ) -> Iterator[list[Callable[[int, Array], Array]]]:
        """Groups of laws, torques by step and state, for first motions."""
        references = list(self._lines()) if self.reference is None else [self.reference]
        if isinstance(initial, OptimizedTrajectory):
            again = stretched(initial, self.steps, self.control_dt)
            after = self._along(references[0])[0]
            yield [lambda k, row: again(k, row) if k < self.steps else after(k, row)]
        elif initial is not None:
            if not callable(initial):
                raise TypeError(f"initial = {initial!r} is neither a result nor a law that is called with a State")
            yield [self._given(initial)]
        for reference in references:
            yield self._along(reference)

    def _given(self, law: Callable[[State], npt.ArrayLike]) -> Callable[[int, Array], Array]:
        """The law that was given as the first motion."""
        if hasattr(law, "reset"):
            law.reset()
        # The plant limits the torques.
        laws = Laws("the law of initial=", lambda: law, 1, np.inf, is_made=False)
        return lambda _, row: laws.torques([State.from_array(row)], [Setpoint()])[0]

    def _along(self, reference: Reference) -> list[Callable[[int, Array], Array]]:
        """Laws that follow a reference: on a terrain some that ignore the slope, that learn it, and that know it."""

        def law(seen: Callable[[Array], State], **options: float) -> Callable[[int, Array], Array]:
            lqr = Lqr(self.params, control_dt=self.control_dt, max_torque=self.max_torque, **options)
            return lambda k, row: np.asarray(lqr(seen(row), reference(k * self.control_dt)))

        if self.robot.terrain is None:
            return [law(State.from_array)]
        return [law(State.from_array), law(State.from_array, lean_observer=LEAN_OBSERVER), law(self._leveled)]

    def _lines(self) -> Iterator[Reference]:
        """To the goal, slowly enough for the wheels to grip."""
        here, there = self.robot.state, State.from_array(self.targets[-1])
        seconds = self.steps * self.control_dt

        def line(seconds: float) -> Reference:
            ends = there.ball_position[:2], seconds, here.ball_position[:2]
            return Reference.line(*ends, robot=self.params, yaw=here.yaw, friction=None)

        for friction in FIRST_FRICTION:
            slower = line(seconds).slowdown(friction)
            if slower is not None:
                yield line(seconds * slower)

    def _leveled(self, row: Array) -> State:
        """The state with the lean from the equilibrium on the slope where it is, as on level ground."""
        state = State.from_array(row)
        x, y = state.ball_position[:2]
        self.scratch.place_on_ground(float(x), float(y), state.yaw)
        lean = product(state.body_quaternion, conjugate(self.scratch.state.body_quaternion))
        return state.replace(body_quaternion=product(lean, about_vertical(np.array(state.yaw))))

    def weights(self) -> list[float]:
        """Weights of the goal or the reference to try."""
        if self.reference is not None:
            return list(LEVEL_WEIGHTS if self.robot.terrain is None else TERRAIN_WEIGHTS)
        return [FIRST_WEIGHT * GROWTH**k for k in range(WEIGHTS)]

    def cost(self, weight: float) -> Quadratic:
        """The cost of motions, with this weight of the goal or the reference."""
        weights = np.zeros((len(self.targets), tangent.COORDINATES))
        if self.reference is not None:
            weights[:] = weight * self.control_dt * self.weight(ON_REFERENCE)
            traction = TRACTION_ON_REFERENCE * self.control_dt
        else:
            weights[-1] = weight * self.weight(GOAL)
            traction = TRACTION * weight
        params = self.params
        limit = min(params.wheel_static_friction, params.wheel_dynamic_friction)
        return Quadratic(
            targets=self.targets,
            weights=weights,
            torque_weight=self.control_dt / self.torque**2,
            traction_weight=traction / float(np.mean(params.equilibrium_wheel_loads)) ** 2,
            friction=self.friction * limit,
        )

    def weight(self, table: Sequence[tuple[slice, float, str]]) -> Array:
        """Inverse squares of the amounts of a table, shape (30,)."""
        out = np.zeros(tangent.COORDINATES)
        for coordinates, amount, unit in table:
            out[coordinates] = (amount * (self.params.scale(unit) if unit else 1.0)) ** -2
        return out

    def reached(self, motion: solver.Motion) -> bool | None:
        """Whether the motion ends at the goal; None along a reference."""
        if self.reference is not None:
            return None
        error = tangent.difference(motion.states[-1], self.targets[-1])
        return bool(np.all(self.weight(GOAL) * error**2 <= 1.0))

    def counted(self, progress: Callable[[int, float], None] | None) -> Callable[[int, float], None] | None:
        """`progress` with iterations counted over all weights."""
        if progress is None:
            return None
        call = progress

        def report(_: int, cost: float) -> None:
            call(self.iteration, cost)
            self.iteration += 1

        return report

    def gains(self, motion: solver.Motion, derivatives: solver.Derivatives) -> Array:
        """Gains of the law that follows the motion."""
        weights = np.zeros((len(motion.states), tangent.COORDINATES))
        weights[:] = self.control_dt * self.weight(FEEDBACK)
        weights[-1] *= LAST / self.control_dt
        cost = Quadratic(motion.states, weights, self.control_dt / self.torque**2, 0.0, 1.0)
        expansion = dataclasses.replace(cost.expand(motion, derivatives), u=np.zeros_like(motion.torques))
        far = np.full_like(motion.torques, np.inf)
        swept = solver.sweep(derivatives, expansion, -far, far, solver.LEAST)
        assert swept is not None, "the torques have a weight"
        return swept.gains

    def result(self, result: solver.Result, iterations: int) -> OptimizedTrajectory:
        """The motion without the tail of a reference."""
        motion, steps = result.motion, self.steps
        rows = motion.states[: steps + 1]
        loads, tractions = motion.forces[:steps, 0:3], np.abs(motion.forces[:steps, 3:6])
        return OptimizedTrajectory(
            params=self.params,
            terrain=self.robot.terrain,
            reference=self.reference,
            times=np.arange(steps + 1, dtype=np.float64) * self.control_dt,
            states=tuple(State.from_array(row) for row in rows),
            torques=motion.torques[:steps],
            friction_used=np.divide(tractions, loads, out=np.zeros_like(loads), where=loads > 0.0),
            position_errors=np.linalg.norm(rows[:, :2] - self.targets[: steps + 1, :2], axis=1),
            reached=self.reached(motion),
            converged=result.converged,
            iterations=iterations,
            cost=result.cost,
            gains=self.gains(motion, result.derivatives)[:steps],
            control_dt=self.control_dt,
            sim_dt=self.sim_dt,
            max_torque=self.max_torque,
        )
