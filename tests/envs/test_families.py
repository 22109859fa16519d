"""Several robots in one batch, families of robots, and policies that fit any robot."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import ROBOTS
from ballbot_rs.cli import main
from ballbot_rs.engines.engine_batch import EngineBatch
from ballbot_rs.envs._batch_env import new_batch, resolved_options
from ballbot_rs.envs.family import RANGES, sample_robots

FAMILY = {"family": 5, "seed": 3}


def test_a_robot_of_a_family_depends_only_on_the_seed_and_its_number():
    few, many = sample_robots(2, 7), sample_robots(6, 7)
    assert few == many[:2]
    assert len({repr(robot) for robot in (*many, *sample_robots(6, 8))}) == 12


def test_the_family_surrounds_the_robots_of_the_package():
    family = sample_robots(400)
    for unit in ("s", "m", "N·m"):
        scales = [robot.scale(unit) for robot in family]
        assert all(min(scales) < bb.Params.preset(name).scale(unit) < max(scales) for name in ROBOTS), unit
    for name in ("ball_radius", "body_mass", "wheel_zenith"):
        low, high = RANGES[name]
        found = [getattr(robot, name) for robot in family]
        assert low <= min(found) < low + 0.1 * (high - low)
        assert high - 0.1 * (high - low) < max(found) <= high


def test_a_family_may_have_other_ranges():
    ranges = {"friction": (0.4, 0.5), "wheel_viscous_friction": (0.0, 0.0)}
    robots, usual = sample_robots(20, 3, ranges), sample_robots(20, 3)
    assert all(0.4 <= robot.wheel_static_friction <= 0.5 for robot in robots)
    assert all(robot.wheel_viscous_friction == 0.0 for robot in robots)
    assert [robot.body_mass for robot in robots] == [robot.body_mass for robot in usual]
    batch = new_batch(16, options={"robot": {"family": 2, "seed": 3, "ranges": ranges}})
    assert [batch.nominal_params(i) for i in (0, 8)] == robots[:2]


def test_a_family_may_have_preloads():
    robots, usual = sample_robots(20, 3, {"wheel_preload / weight of the body": (0.5, 2.0)}), sample_robots(20, 3)
    weights = [robot.wheel_preload / (robot.body_mass * robot.gravity) for robot in robots]
    assert 0.5 <= min(weights) < 0.8
    assert 1.7 < max(weights) <= 2.0
    assert all(robot.wheel_preload == 0.0 for robot in usual)
    assert [robot.body_com_offset for robot in robots] == [robot.body_com_offset for robot in usual]
    # Torques are relative to what the robot needs.
    assert robots[0].max_wheel_torque == pytest.approx(usual[0].max_wheel_torque, rel=1e-12)


@pytest.mark.parametrize("bounds", [(-1.0, 1.0), (0.0, 2000.0)])
def test_preloads_of_which_some_are_invalid_are_rejected(bounds):
    """Not sampled from the valid part alone."""
    with pytest.raises(ValueError, match=r"weight of the body.* expected two numbers of at least 0 .* at most 1000"):
        sample_robots(2, 0, {"wheel_preload / weight of the body": bounds})


@pytest.mark.parametrize("robots", [["paper", "kugle"], range(10**12), {"family": 2}])
def test_motions_of_fewer_robots_than_are_named_are_rejected(robots):
    """The others would not be simulated."""
    with pytest.raises(ValueError, match=r"robot has 1?[02]+ robots, but num_envs = 1 has room for 1"):
        bb.simulate("lqr", robot=robots, seconds=0.1)
    with pytest.raises(ValueError, match=r"robot has 1?[02]+ robots, but num_envs = 8 has room for 1"):
        bb.rollout("lqr", 8, robot=robots, seconds=0.1)


@pytest.mark.parametrize(
    ("robot", "error", "text"),
    [
        ({"family": 0}, ValueError, "robot.family = 0"),
        ({"family": 2**21}, ValueError, "robot.family = 2097152 is out of range"),
        ({"family": 3}, ValueError, "robot has 3 robots, but num_envs = 16 has room for 2"),
        ({"family": 2, "seed": -1}, ValueError, "seed"),
        ({"family": 2, "sed": 1}, TypeError, "sed"),
        ({"family": 2, "ranges": 1}, TypeError, "robot.ranges = 1 is not a table"),
        ({"family": 2, "ranges": {"frction": [1, 2]}}, TypeError, "'frction': did you mean 'friction'"),
        ({"family": 2, "ranges": {"friction": 1}}, ValueError, r"'friction'\] = 1: expected a smallest and a largest"),
        ({"family": 2, "ranges": {"friction": ["a", 1]}}, TypeError, "friction'] = 'a' is not a number"),
        ({"family": 2, "ranges": {"friction": [0, 1]}}, ValueError, "expected two positive numbers in ascending"),
        ({"family": 2, "ranges": {"friction": [1, float("inf")]}}, ValueError, "at most 1e.06"),
        ({"family": 2, "ranges": {"wheel_coulomb_friction": [0.1, 0]}}, ValueError, "two numbers in ascending order"),
        ({"family": 2, "ranges": {"wheel_zenith": [3.0, 4.0]}}, ValueError, "none of 1000 sampled robots is valid"),
        ([], ValueError, "there is none"),
        (["paper", "nobody"], ValueError, "nobody"),
        (["paper", 3], TypeError, "int"),
    ],
)
def test_invalid_robots_are_named(robot, error, text):
    with pytest.raises(error, match=text):
        bb.BallbotVecEnv(16, robot=robot)


def test_a_batch_has_room_for_its_robots():
    with pytest.raises(ValueError, match=r"robot has 2 entries, but num_envs = 8 has room for 1.*at least 9"):
        bb.Batch(8, robot=["paper", "kugle"])
    assert bb.Batch(9, robot=["paper", "kugle"]).nominal_params(8) == bb.Params.preset("kugle")


def test_eight_neighbors_have_the_same_robot():
    batch = new_batch(30, options={"robot": ["paper", bb.Params.preset("kugle").to_dict(), "rezero"]})
    robots = [bb.Params.preset(name) for name in ("paper", "kugle", "rezero")]
    assert [batch.nominal_params(i) for i in range(30)] == [robots[i // 8 % 3] for i in range(30)]
    own = [new_batch(1, options={"robot": robot}).max_wheel_torque for robot in robots]
    np.testing.assert_array_equal(batch.action_torques, [own[i // 8 % 3] for i in range(30)])
    assert batch.max_wheel_torque == own[0]


def test_options_of_a_family_name_no_number_that_follows_from_a_robot():
    options = {"robot": FAMILY, "scale_by_robot": True}
    found = resolved_options(new_batch(16, task="velocity", options=options), options)
    assert found["robot"] == FAMILY
    assert found["max_wheel_torque"] is None
    assert "command_seconds" not in found
    assert "speed" not in found
    again = resolved_options(new_batch(1, task="velocity", options=found), found)
    assert again == found
    given = {**options, "speed": 0.2, "max_wheel_torque": 0.1}
    found = resolved_options(new_batch(16, task="velocity", options=given), given)
    assert (found["speed"], found["max_wheel_torque"]) == (0.2, 0.1)
    several = {"robot": ["paper", "kugle"]}
    assert resolved_options(new_batch(16, options=several), several)["max_wheel_torque"] is None


def test_each_robot_has_its_own_torque_in_every_front_end():
    params = ["paper", "kugle"]
    each = [new_batch(1, options={"robot": robot}).max_wheel_torque for robot in params]
    expected = [each[i // 8] for i in range(16)]
    assert bb.BallbotVecEnv(16, robot=params).get_attr("max_wheel_torque") == expected
    assert list(bb.BalanceVectorEnv(16, robot=params).get_attr("max_wheel_torque")) == expected


def test_a_snapshot_of_another_robot_is_rejected():
    batch = new_batch(16, options={"robot": ["paper", "rezero"], "scale_by_robot": True, "max_wheel_torque": 0.2})
    batch.reset()
    batch.restore(1, batch.snapshot(0))
    with pytest.raises(ValueError, match="snapshot"):
        batch.restore(8, batch.snapshot(0))


def test_laws_are_designed_for_each_robot():
    options = {"robot": {"family": 4, "seed": 11}}
    result = bb.evaluate("lqr", episodes=32, **options)
    assert result.success_rate == 1.0
    each = [bb.evaluate("lqr", episodes=8, robot=robot) for robot in sample_robots(4, 11)]
    assert result.torque_rms > 0.8 * np.sqrt(np.mean([np.square(one.torque_rms) for one in each]))
    with pytest.raises(ValueError, match="law in Python: it runs on one robot"):
        bb.evaluate(lambda state: 0.0 * state.wheel_speeds, episodes=16, **options)
    # The law of the first robot falls on others.
    batch = new_batch(32, options=options, seed=1000)
    batch.reset()
    law = bb.Controller("lqr", batch.nominal_params(0), batch.control_dt)
    found = batch.rollout(law, 300, record=["terminated"])
    assert found["terminated"].any()


def test_other_engines_drive_each_robot_with_its_own_torque():
    pytest.importorskip("mujoco")
    options = {"robot": ["paper", "rezero"], "scale_by_robot": True}
    batch = EngineBatch(new_batch(16, options=options), "mujoco")
    batch.reset()
    law = bb.Controller("lqr", bb.Params.paper(), batch.control_dt)
    for _ in range(100):
        _, _, terminated, _ = batch.step(batch.control(law, drawn=True))
        assert not terminated.any()


def test_the_command_line_takes_families(capsys):
    arguments = ["evaluate", "--controller", "lqr", "--episodes", "16", "--set", "robot.family=2", "--json"]
    assert main([*arguments, "--set", "robot.seed=5"]) == 0
    assert '"success_rate": 1.0' in capsys.readouterr().out
    assert main(["evaluate", "--controller", "lqr", "--set", "robot.family=0"]) == 1
    assert "robot.family = 0" in capsys.readouterr().err
    assert main([*arguments[:-1], "--robot", "kugle"]) == 1
    assert "a robot is also given" in capsys.readouterr().err


def test_scaled_observations_have_gains_of_the_robot():
    plain, scaled = (new_batch(1, options={"robot": "kugle", "scale_by_robot": on}) for on in (False, True))
    robot = bb.Params.preset("kugle")
    factors = plain.observation_gains / scaled.observation_gains
    # A motion is as large as the lean that starts it: here the lean that the motors leave, in proportion to the torque.
    lean = robot.max_wheel_torque / (0.4 * robot.scale("N·m"))
    assert lean < 0.8 * robot.scale("rad")
    np.testing.assert_allclose(factors[:3], lean)
    np.testing.assert_allclose(factors[3:6], lean * robot.scale("rad/s"))
    # Its velocity follows from the acceleration that the lean gives.
    per_lean = [bb.Scale.of(one).acceleration_per_lean for one in ("paper", robot)]
    motion = lean * per_lean[1] / per_lean[0]
    wheels = robot.scale("m/s") * bb.Params.paper().wheel_radius / robot.wheel_radius
    np.testing.assert_allclose(factors[6:9], motion * wheels)
    np.testing.assert_allclose(factors[9:11], motion * robot.scale("m"))
    np.testing.assert_allclose(factors[11:13], motion * robot.scale("m/s"))
    np.testing.assert_allclose(factors[13:], 1.0)
    assert scaled.max_wheel_torque == robot.max_wheel_torque
    assert (new_batch(1, options={"scale_observations": False}).observation_gains == 1.0).all()
