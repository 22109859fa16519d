"""Rollouts of many robots: their rows are the motion of each, thinned out, and a fall freezes only its own robot."""

import math

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.analysis import robots as module

PAPER = bb.Params.paper()
#: Heights of the center of mass of the true robots, and their tilt at the start, rad.
HEIGHTS, TILT = [0.25, 0.31, 0.4], (0.05, 0.02)


def own(**changes):
    given = {"robots": {"body_com_height": HEIGHTS}, "tilt": TILT, "seconds": 1.0, "dtype": np.float64}
    return bb.rollout("lqr", **{**given, **changes})


def test_each_robot_moves_as_in_a_batch():
    found = own(record=("states", "torques"))
    batch = bb.Batch(3, max_wheel_torque=PAPER.max_wheel_torque, max_episode_steps=1000, autoreset="same_step")
    for i, height in enumerate(HEIGHTS):
        batch.set_params(i, PAPER.replace(body_com_height=height))
    batch.reset(starts=[bb.State.at_equilibrium(batch.params(i), tilt=TILT) for i in range(3)])
    rows = batch.rollout(bb.Lqr(PAPER), 100, record=("states", "torques"))
    np.testing.assert_array_equal(found["states"], rows["states"])
    np.testing.assert_array_equal(found["torques"][:-1], rows["torques"])
    np.testing.assert_array_equal(found["torques"][-1], rows["torques"][-1])


def test_records_are_attributes_of_the_states():
    found = own(record=["states", "ball_position", "body_angular_velocity", "tilt", "tilt_components"])
    for row, i in ((0, 0), (40, 1), (100, 2)):
        expected = found["states"][row, i]
        np.testing.assert_array_equal(found["ball_position"][row, i], expected[:3])
        np.testing.assert_array_equal(found["body_angular_velocity"][row, i], expected[23:26])
        components = found["tilt_components"][row, i]
        assert found["tilt"][row, i] == pytest.approx(math.hypot(*components), abs=1e-12)
    np.testing.assert_allclose(found["tilt_components"][0], np.tile(TILT, (3, 1)), atol=1e-12)


@pytest.mark.parametrize("memory", [1, 10_000, 1 << 26])
def test_rows_are_thinned_out_in_pieces_of_any_size(monkeypatch, memory):
    names = ("tilt", "torques", "wheel_normal_forces")
    full = own(record=names)
    monkeypatch.setattr(module, "_CHUNK", memory)
    for every in (1, 7, 10, 100, 1000):
        thin = own(record=names, every=every)
        np.testing.assert_array_equal(thin.times, full.times[::every])
        for name in names:
            np.testing.assert_array_equal(thin[name], full[name][::every])


@pytest.mark.parametrize("memory", [1, 1 << 26])
@pytest.mark.parametrize("every", [1, 10])
def test_a_fallen_robot_is_frozen_at_its_last_row_and_the_others_move_on(monkeypatch, memory, every):
    monkeypatch.setattr(module, "_CHUNK", memory)
    tilts = [(0.02, 0.0), (0.3, 0.0), (0.0, 0.02)]
    law = bb.rollout("zero", 3, tilt=tilts, seconds=1.0, every=every, dtype=np.float64)
    alone = bb.rollout("zero", 1, tilt=tilts[0], seconds=1.0, every=every, dtype=np.float64)
    np.testing.assert_array_equal(law["tilt"][:, 0], alone["tilt"][:, 0])
    np.testing.assert_array_equal(law.upright, np.isnan(law.fell_at))
    batch = bb.Batch(1, autoreset="disabled")
    batch.reset(starts=[bb.State.at_equilibrium(PAPER, tilt=tilts[1])])
    states = [batch.state(0)]
    while not batch.step(np.zeros((1, 3)))[2][0]:
        states.append(batch.state(0))
    assert law.fell_at[1] == pytest.approx(len(states) * batch.control_dt)
    after = law.times >= law.fell_at[1] - 1e-9
    assert after.any()
    np.testing.assert_allclose(law["tilt"][after, 1], states[-1].tilt, rtol=1e-12)
    before = law["tilt"][~after, 1]
    np.testing.assert_allclose(before, [state.tilt for state in states[::every]][: len(before)], rtol=1e-12)


def test_a_fall_loses_nothing_and_is_never_settled():
    slippery = {name: [1.0, 0.02] for name in ("wheel_static_friction", "wheel_dynamic_friction")}
    found = bb.rollout("lqr", robots=slippery, tilt=(0.05, 0.0), seconds=5.0, record=("tilt",))
    assert found.upright.tolist() == [True, False]
    settled, never = found.settling_times()
    assert never == math.inf
    limit = np.deg2rad(1.0)
    assert (found["tilt"][found.times >= settled, 0] <= limit).all()
    assert found["tilt"][np.searchsorted(found.times, settled) - 1, 0] > limit
    with pytest.raises(KeyError, match="'ball_position' was not recorded, only tilt"):
        found["ball_position"]


def test_a_robot_that_diverges_is_frozen_at_finite_numbers():
    push = {"term": "push", "at": 0.1, "range": [1e4, 1e4]}
    options = {"fall_tilt": 3.1, "events": [push]}
    found = bb.rollout("zero", 3, tilt=(0.0, 0.0), seconds=0.5, record=("states",), **options)
    assert (found.fell_at > 0.1).all()
    assert np.isfinite(found["states"]).all()
    assert (found["states"][-1] == found["states"][-2]).all()


def test_the_end_of_the_ground_freezes_a_robot_without_a_fall():
    away = {"terrain": bb.Terrain.generate("bowl", size_x=3.0, size_y=3.0, cell=0.05), "setpoint": (5.0, 0.0)}
    found = bb.rollout("lqr", 1, tilt=(0.0, 0.0), seconds=10.0, **away, record=("ball_position",))
    assert np.isnan(found.fell_at[0])
    assert 0.0 < found.ended_at[0] < 10.0
    last = found["ball_position"][found.times >= found.ended_at[0] - 1e-9]
    assert (last == last[0]).all()


def test_given_starts_on_a_slope_are_not_restricted_by_sampled_starts():
    slope = {"terrain": bb.Terrain.plane(0.22), "seconds": 0.2, "record": ("tilt_components",)}
    found = bb.rollout("lqr", 2, tilt=(0.02, 0.0), **slope)
    assert found.upright.all()
    np.testing.assert_allclose(found["tilt_components"][0, :, 0], 0.02, rtol=0.02)
    with pytest.raises(ValueError, match=r"reset_tilt = 0\.087.* is not below fall_tilt"):
        bb.rollout("lqr", 2, **slope)


def test_numbers_follow_from_the_seed_and_not_from_the_threads():
    random = {"events": "mild", "seconds": 0.3}
    first, second, other = (
        bb.rollout("lqr", 9, num_threads=threads, seed=seed, **random) for threads, seed in ((1, 5), (3, 5), (1, 6))
    )
    np.testing.assert_array_equal(first["tilt"], second["tilt"])
    np.testing.assert_array_equal(first["tilt"][:, 1:], other["tilt"][:, :-1])


def test_robots_are_parameters_or_arrays_of_them():
    arrays = own()
    listed = own(robots=[PAPER.replace(body_com_height=height) for height in HEIGHTS])
    np.testing.assert_array_equal(arrays["tilt"], listed["tilt"])
    assert arrays["tilt"].dtype == np.float64
    assert own(dtype=np.float32)["tilt"].dtype == np.float32


def test_policies_and_laws_in_python_have_many_robots():
    class Braking:
        batched = True

        def __call__(self, states, _setpoints):
            return -0.001 * states[:, 29:32]

    for controller in (Braking, bb.Lqr(), "zero"):
        found = bb.rollout(controller, 4, seconds=0.2, record=("tilt", "torques"))
        assert found["torques"].shape == (21, 4, 3)


def test_files_have_everything(tmp_path):
    found = own(every=10)
    found.to_npz(tmp_path / "robots.npz")
    with np.load(tmp_path / "robots.npz") as read:
        assert set(read) == {"times", "fell_at", "ended_at", "ball_position", "tilt"}
        np.testing.assert_array_equal(read["tilt"], found["tilt"])
    with pytest.raises(ValueError, match=r"must end in \.npz"):
        found.to_npz(tmp_path / "robots.csv")
    assert repr(found) == "<Rollout of lqr on contact: 3 robots, 1 s, ball_position, tilt in 11 rows, 0 fell>"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({}, TypeError, "num_robots=, or the robots, robots="),
        ({"num_robots": 0}, ValueError, "num_robots = 0"),
        ({"num_robots": True}, TypeError, "num_robots = True is not a whole number"),
        ({"num_robots": 2, "robots": {"body_mass": [2.0]}}, ValueError, r"2 robots, but robots\['body_mass'\] has 1"),
        ({"robots": {"body_mass": 2.0}}, ValueError, "one value of each robot"),
        ({"robots": {"body_mass": ["x"]}}, TypeError, "expected numbers of each robot"),
        ({"robots": {"body_mas": [2.0]}}, ValueError, "robot 0 of robots: .*did you mean 'body_mass'"),
        ({"robots": {"body_mass": [2.0, -1.0]}}, ValueError, "robot 1 of robots: body_mass = -1 is out of range"),
        ({"robots": [1.0]}, TypeError, "robots must be a list of Params"),
        ({"num_robots": 2, "record": "tilt"}, TypeError, r"as \['tilt'\]"),
        ({"num_robots": 2, "record": ["tlt"]}, ValueError, "did you mean 'tilt'"),
        ({"num_robots": 2, "record": ["tilt", "tilt"]}, ValueError, "'tilt' twice"),
        ({"num_robots": 2, "every": 0}, ValueError, "every = 0"),
        ({"num_robots": 2, "dtype": int}, ValueError, "not a type of real numbers"),
        ({"num_robots": 2, "dtype": "number"}, TypeError, "not a type of numbers"),
        ({"num_robots": 2, "tilt": (0.1, 0.1, 0.1)}, ValueError, r"shape \(3,\): expected \(2,\) or \(2, 2\)"),
        ({"num_robots": 20_000, "seconds": 3600.0}, ValueError, "a larger every"),
    ],
)
def test_bad_input_names_the_cure(arguments, error, message):
    with pytest.raises(error, match=message):
        bb.rollout("lqr", **{"seconds": 0.1, **arguments})


@pytest.mark.parametrize("tilt", [np.nan, -0.1, np.inf, "0.1", np.full(2, 0.1)])
def test_a_limit_of_the_tilt_is_a_number_of_an_angle(tilt):
    """Each robot would be within a limit that is not a number."""
    with pytest.raises(ValueError, match=r"tilt = .* is (out of range: expected 0 to 3\.14159|not a number)"):
        bb.rollout("lqr", 2, seconds=0.1).settling_times(tilt)
