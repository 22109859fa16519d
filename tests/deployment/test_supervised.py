"""Controllers under the supervisor in simulation: faults trip it, driving does not."""

import copy

import numpy as np
import pytest

import ballbot_rs as bb

PRESETS = bb.Params.preset_names()


class Faulty:
    """A supervised controller whose readings, or their arrival, a fault changes from 1 s on.

    Args:
        law: `Supervised`.
        fault: changes the readings, or the law before its call.
        steps: control steps for which it lasts.
    """

    def __init__(self, law, fault, steps=10_000):
        self._law, self._fault, self._left = law, fault, steps
        self.reads_sensors, self.control_dt = law.reads_sensors, law.control_dt
        self._calls = 0

    def __call__(self, state, setpoint):
        """Torques."""
        self._calls += 1
        if self._calls > 100 and self._left > 0:
            self._left -= 1
            state = self._fault(self._law, state)
        return self._law(state, setpoint)


def lose(law, readings):
    """There are no readings."""
    law.fresh = False
    return readings


def spoil(_, readings):
    """A gyroscope that gives NaN."""
    return {**readings, "gyro": np.full(3, np.nan)}


def spin(_, readings):
    """An encoder that runs away."""
    angles = np.array(readings["wheel_angles"])
    angles[1] += spin.angle
    spin.angle += 3.0
    return {**readings, "wheel_angles": angles}


spin.angle = 0.0


def supervised(**limits):
    """A controller on the estimator of the robot kugle, under the supervisor."""
    return bb.Supervised(bb.EstimatedController("lqr", "kugle", sensors="kugle"), "kugle", **limits)


SCENE = {"robot": "kugle", "sensors": "kugle", "seconds": 2.5}


@pytest.mark.slow("a minute of simulation")
@pytest.mark.parametrize("name", PRESETS)
def test_driving_does_not_trip(name):
    motors = {"actuators": "kugle"} if name == "kugle" else {}
    law = bb.Supervised("lqr", name, **motors)
    options = {**motors, "task": "velocity", "sensors": "kugle", "observation": "sensors", "seconds": 60.0, "seed": 1}
    motion = bb.simulate(law, robot=name, **options)
    assert law.counts == {"running": 6000}
    assert law.log == []
    assert 0.0 < law.heat.max() < 1.0
    # It drives, and the supervisor does not change a bit of it.
    assert np.abs(motion.states[-1].ball_position[:2]).max() > 1.0
    np.testing.assert_array_equal(motion.torques, bb.simulate("lqr", robot=name, **options).torques)


def test_a_kick_beyond_the_basin_trips_and_a_lighter_one_does_not():
    robot = bb.Params.preset("kugle")
    capture = bb.Scale.of(robot).capture_impulse
    for factor, statuses in ((0.85, set()), (1.5, {"tilt"})):
        law = bb.Supervised("lqr", robot)
        push = bb.Push(time=1.0, impulse=(factor * capture, 0.0, 0.0))
        motion = bb.simulate(law, robot=robot, pushes=[push], seconds=4.0)
        assert set(law.counts) & {"tilt", "speed", "stale", "not_finite"} == statuses
        assert (motion.fell_at is not None) == bool(statuses)
    # Before it counts as fallen, and the torques are falling.
    assert law.log == [(pytest.approx(1.1, abs=0.06), "tilt")]
    assert law.log[0][0] < motion.fell_at
    assert law.share < 0.7


@pytest.mark.parametrize(
    ("fault", "status", "most"), [(lose, "stale", 3), (spoil, "not_finite", 3), (spin, "speed", 10)]
)
def test_faults_of_sensors_ramp_the_torques_down(fault, status, most):
    spin.angle = 0.0
    law = supervised(max_speed=40.0, ramp_time=0.2)
    motion = bb.simulate(Faulty(law, fault), **SCENE)
    time, last = law.log[-1]
    assert last == status
    assert 1.0 <= time <= 1.0 + 0.01 * most + 1e-9
    largest = np.abs(motion.torques).max(axis=1)
    first = round(time / 0.01)
    # Held torques are scaled by a share that falls to zero within the ramp.
    assert not largest[first + 20 :].any()
    assert law.share == 0.0
    # The fall comes after it.
    assert motion.fell_at > time + 0.2


@pytest.mark.parametrize("fault", [lose, spoil])
def test_short_faults_are_bridged(fault):
    law = supervised()
    motion = bb.simulate(Faulty(law, fault, steps=3), **SCENE)
    assert law.counts["held"] == 3
    assert [status for _, status in law.log] == ["held", "running"]
    assert motion.fell_at is None
    np.testing.assert_array_equal(motion.torques[100:103], [motion.torques[99]] * 3)


def test_a_law_that_gives_nan_or_too_much_is_caught():
    robot = bb.Params.paper()
    law = bb.Supervised(lambda _: np.full(3, np.nan), robot)
    motion = bb.simulate(law, robot=robot, seconds=0.5)
    assert law.counts == {"held": 3, "not_finite": 47}
    assert not motion.torques.any()
    strong = bb.Supervised(lambda _: np.array([20.0, -10.0, 0.0]), robot, continuous_torque=5.0)
    state = bb.State.at_equilibrium(robot)
    np.testing.assert_allclose(strong(state, bb.Setpoint()), [5.0, -2.5, 0.0])
    assert strong.status == "torque"


def test_a_blocked_wheel_heats_its_motor_to_the_limit_and_no_further():
    """The controller needs the largest torque of one motor, as an integral does; the others are reduced with it."""
    robot = bb.Params.preset("kugle")
    wanted = np.array([robot.max_wheel_torque, 0.1, -0.1])
    law = bb.Supervised(lambda _: wanted, robot, heating_time=1.0)
    blocked = bb.State.at_equilibrium(robot)
    found = np.array([law(blocked, bb.Setpoint()) for _ in range(1000)])
    assert set(law.counts) == {"running", "heat"}
    assert law.log == [(pytest.approx(-np.log(1.0 - 1.0 / 9.0), abs=0.02), "heat")]
    assert law.heat.max() == pytest.approx(1.0)
    np.testing.assert_allclose(found[-1], wanted / 3.0, rtol=1e-6)


def test_a_reset_begins_again():
    robot = bb.Params.paper()
    law = bb.Supervised("lqr", robot, tilt_time=0.0)
    law(bb.State.at_equilibrium(robot, tilt=(1.0, 0.0)), bb.Setpoint())
    assert law.status == "tilt"
    law.reset()
    assert (law.status, law.share, law.counts, law.log) == ("running", 1.0, {}, [])
    assert not law.heat.any()


def test_robots_of_a_batch_have_separate_supervisors():
    robot = bb.Params.paper()
    law = bb.Supervised("lqr", robot, tilt_time=0.0)
    other = copy.deepcopy(law)
    other(bb.State.at_equilibrium(robot, tilt=(1.0, 0.0)), bb.Setpoint())
    assert (law.status, other.status) == ("running", "tilt")
    plain, result = (bb.evaluate(one, episodes=4, seed=3) for one in ("lqr", law))
    assert result == plain


def test_controllers_that_cannot_be_supervised_are_rejected(monkeypatch):
    with pytest.raises(bb.InvalidInputError, match=r"link reads sensors and has no estimate\(\)"):
        bb.Supervised(bb.Link("udp://127.0.0.1:9"))
    with pytest.raises(TypeError, match="Supervised got an unexpected keyword argument 'speed': did you mean 'max_sp"):
        bb.Supervised("lqr", speed=1.0)
    with pytest.raises(ValueError, match=r"control_dt = 0\.0 is out of range"):
        bb.Supervised("lqr", control_dt=0.0)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(OSError, match="the supervisor needs a C compiler"):
        bb.Supervised("lqr")
