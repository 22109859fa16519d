"""One robot along a reference, under pushes and forces."""

import copy
import functools
import math
import pickle

import numpy as np
import pytest

import ballbot_rs as bb
from tests.support.paths import ASSETS

CIRCLE = bb.Reference.circle(0.3, 6.0)
PARAMS = bb.Params.paper()
ON_BALL = {"model": "spatial", "seconds": 0.3}


class Follower:
    def __init__(self, robot, control_dt):
        self.law = bb.Lqr(robot, control_dt)

    def __call__(self, state, setpoint):
        return self.law(state, **setpoint)


@pytest.mark.parametrize("controller", ["lqr", Follower])
def test_a_circle_of_six_seconds_is_followed_within_a_millimeter(controller):
    done = bb.simulate(controller, reference=CIRCLE, seconds=12.0)
    desired = CIRCLE.sample(done.times)
    for part, values in desired.items():
        np.testing.assert_allclose(done.setpoints[part], values, atol=1e-12)
    errors = np.linalg.norm(done.of_states("ball_position")[:, :2] - desired["position"], axis=1)
    metrics = done.metrics()
    assert metrics.position_error_rms == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-12)
    assert metrics.position_error_rms < 1e-3
    assert metrics.position_error_final == pytest.approx(errors[-1])
    assert metrics.position_error_max == pytest.approx(errors.max())
    assert errors.max() < 1e-3
    # Without the feed-forward of the reference it is far behind.
    placed = bb.simulate(controller, reference=lambda t: {"position": CIRCLE(t)["position"]}, seconds=12.0)
    assert placed.metrics().position_error_rms > 0.05


def test_a_reference_has_a_start_and_a_duration():
    line = bb.Reference.line((1.0, 0.5), 4.0, (0.5, 0.5), yaw=0.4)
    done = bb.simulate("lqr", reference=line)
    assert done.times[-1] == pytest.approx(4.0)
    assert done.states[0].ball_position[:2].tolist() == [0.5, 0.5]
    assert done.states[0].yaw == pytest.approx(0.4)
    assert done.metrics().position_error_max < 2e-3
    np.testing.assert_allclose(done.states[-1].ball_position[:2], [1.0, 0.5], atol=1e-3)
    away = bb.simulate("lqr", reference=line, position=(0.4, 0.5), yaw=0.0, tilt=(0.02, 0.0), seconds=1.0)
    assert away.states[0].ball_position[:2].tolist() == [0.4, 0.5]
    assert away.states[0].tilt_components[0] == pytest.approx(0.02)


def test_a_circle_goes_around_once():
    motion = bb.Reference.circle(0.3, 6.0, 2.0)
    done = bb.simulate("lqr", reference=motion)
    assert done.times[-1] == pytest.approx(motion.first_turn)
    assert motion.first_turn == 8.0
    # Where full speed began.
    np.testing.assert_allclose(done.states[-1].ball_position, done.states[200].ball_position, atol=3e-3)
    assert bb.Reference.lemniscate(0.3, 6.0).first_turn == 10.0
    assert bb.Reference.line((1.0, 0.0), 4.0).first_turn is None


def test_a_start_beyond_the_fall_is_named():
    assert repr(bb.simulate("lqr", tilt=(0.5, 0.0), seconds=0.1)) == (
        "<Trajectory of lqr on contact: 0.1 s, 11 rows, fell at 0.01 s as it began at 0.5 rad, beyond the option "
        "fall_tilt = 0.349 rad, sim_dt 2 ms>"
    )
    assert "beyond" not in repr(bb.simulate("zero", tilt=(0.3, 0.0), seconds=1.0))
    assert bb.simulate("lqr", tilt=(0.4, 0.0), fall_tilt=0.5, seconds=0.1).fell_at is None


HEAVY = bb.Params.paper().replace(body_mass=12.0, body_com_height=0.35, body_inertia=(1.0, 1.0, 0.1))


def test_a_reference_is_made_for_the_robot_that_follows_it():
    """It was made for the paper's robot, whichever robot ran."""
    motion = bb.Reference.circle(0.5, 10.0)
    assert motion.params is None
    own = bb.Reference.circle(0.5, 10.0, robot=HEAVY)
    assert own.params == HEAVY
    run = functools.partial(bb.simulate, "lqr", robot=HEAVY, seconds=15.0)
    expected = run(reference=own)
    np.testing.assert_array_equal(run(reference=motion).to_array(), expected.to_array())
    assert expected.metrics().position_error_rms < 0.002
    # The setpoints of the paper's robot, which are still to be had.
    other = run(reference=lambda time: motion(time))
    assert other.metrics().position_error_rms > 5.0 * expected.metrics().position_error_rms
    with pytest.raises(ValueError, match=r"the Reference 'circle' was made for another robot, which leans"):
        run(reference=bb.Reference.circle(0.5, 10.0, robot="paper"))
    # Of the same lean, on other ground.
    slippery = HEAVY.replace(floor_dynamic_friction=0.5, floor_static_friction=0.6)
    assert bb.simulate("lqr", robot=slippery, seconds=0.1, reference=own).fell_at is None
    with pytest.raises(ValueError, match="of the robot's traction and torque"):
        run(reference=bb.Reference.circle(0.5, 2.5))


def test_a_batch_follows_the_reference_of_the_robot_of_its_controller():
    motion, own = bb.Reference.circle(0.5, 10.0), bb.Reference.circle(0.5, 10.0, robot=HEAVY)
    law = bb.Controller("lqr", HEAVY)

    def states(reference):
        batch = bb.Batch(2, robot=HEAVY, max_wheel_torque=5.0, num_threads=1)
        batch.reset(starts=[bb.State.at_rest(HEAVY)] * 2)
        return batch.rollout(law, 300, reference)["states"]

    np.testing.assert_array_equal(states(motion), states(own))
    np.testing.assert_array_equal(states([motion, own]), states(own))
    np.testing.assert_array_equal(states(motion.for_robot(HEAVY)), states(own))
    with pytest.raises(ValueError, match="for another robot"):
        states([motion, bb.Reference.circle(0.5, 10.0, robot="kugle")])


@pytest.mark.parametrize("motion", [bb.Reference.circle(0.5, 10.0), bb.Reference.circle(0.5, 10.0, friction=0.1)])
def test_a_pickled_reference_is_still_for_any_robot(motion):
    again = pickle.loads(pickle.dumps(motion))
    assert again.params is None
    np.testing.assert_array_equal(again.for_robot(HEAVY)(3.0)["snap"], motion.for_robot(HEAVY)(3.0)["snap"])
    assert again.for_robot("kugle").params == bb.Params.preset("kugle")


def test_the_time_step_of_the_model_is_in_the_results():
    """A rate that is not a multiple of it shortened it without an error."""

    class Odd:
        control_dt = 0.0031

        def __call__(self, state):  # noqa: ARG002
            return np.zeros(3)

    done = bb.simulate(Odd(), seconds=0.1)
    assert (done.control_dt, done.sim_dt) == (0.0031, 0.00155)
    assert repr(done).endswith("sim_dt 1.55 ms>")
    usual = bb.simulate("lqr", seconds=0.1)
    assert (usual.control_dt, usual.sim_dt) == (0.01, 0.002)
    result = bb.evaluate(Odd(), episodes=1, max_episode_steps=10)
    assert (result.control_dt, result.sim_dt) == (0.0031, 0.00155)
    assert repr(result).endswith("sim_dt 1.55 ms>")
    assert "sim dt" in result._repr_html_()


def test_parts_that_stay_are_a_step_from_the_origin():
    done = bb.simulate("lqr", reference={"position": (0.3, 0.0), "yaw": 0.5}, seconds=6.0)
    assert done.states[0].ball_position[:2].tolist() == [0.0, 0.0]
    np.testing.assert_allclose(done.states[-1].ball_position[:2], [0.3, 0.0], atol=2e-3)
    assert done.states[-1].yaw == pytest.approx(0.5, abs=2e-3)
    assert done.metrics().position_error_max == pytest.approx(0.3, rel=0.2)


def test_pushes_act_at_their_times_and_add_up():
    pushes = [bb.Push((0.1, 0.0, 0.0), 0.1), bb.Push((0.0, 0.05, 0.0), 0.2), bb.Push((0.0, 0.05, 0.0), 0.2)]
    done = bb.simulate("zero", pushes=pushes, **ON_BALL)
    twin = bb.Ballbot(PARAMS, "spatial", 0.002)
    for row, state in enumerate(done.states[:-1]):
        np.testing.assert_allclose(state.to_array(), twin.state.to_array(), atol=1e-12)
        if row == 10:
            twin.push((0.1, 0.0, 0.0))
        if row == 20:
            twin.push((0.0, 0.1, 0.0))
        twin.step(np.zeros(3), 5)
    moving = np.abs(done.of_states("body_angular_velocity"))
    assert (moving[:11] == 0.0).all()
    assert moving[11, 1] > 0.05
    assert moving[20, 0] < 1e-9 < moving[21, 0]


def test_a_push_over_a_duration_is_half_a_sine_of_the_same_impulse():
    push = bb.Push((0.2, 0.0, 0.0), 0.1, duration=0.1)
    shares = [push.share(0.01 * i, 0.01 * (i + 1)) for i in range(30)]
    assert sum(shares) == pytest.approx(1.0)
    assert shares[:10] == [0.0] * 10
    assert shares[20:] == pytest.approx([0.0] * 10)
    expected = np.pi / 2 * np.sin(np.pi * (np.arange(10) + 0.5) / 10) * 0.1
    np.testing.assert_allclose(shares[10:20], expected, rtol=5e-3)
    slow, sudden = (bb.simulate("zero", pushes=[one], **ON_BALL) for one in (push, bb.Push((0.2, 0.0, 0.0), 0.15)))
    rates = [done.of_states("body_angular_velocity")[:, 1] for done in (slow, sudden)]
    assert rates[0][11] < 0.1 * rates[0][20]
    assert rates[0][20] == pytest.approx(rates[1][20], rel=0.05)


def test_a_push_at_a_point_matches_a_single_robot():
    point = (0.0, 0.0, 0.3)
    done = bb.simulate("zero", pushes=[bb.Push((0.1, 0.0, 0.0), 0.0, point=point)], **ON_BALL)
    twin = bb.Ballbot(PARAMS, "spatial", 0.002)
    twin.push((0.1, 0.0, 0.0), point)
    twin.step(np.zeros(3), 5)
    np.testing.assert_allclose(done.states[1].to_array(), twin.state.to_array(), atol=1e-12)
    center = bb.simulate("zero", pushes=[bb.Push((0.1, 0.0, 0.0), 0.0)], **ON_BALL)
    assert not np.allclose(center.states[1].to_array(), done.states[1].to_array(), atol=1e-3)


def test_a_force_is_its_impulse_in_each_step_while_it_lasts():
    force = bb.Force((2.0, 0.0, 0.0), begin=0.105, end=0.2)
    done = bb.simulate("zero", forces=[force], **ON_BALL)
    pushes = [bb.Push((0.01, 0.0, 0.0), 0.10), *(bb.Push((0.02, 0.0, 0.0), 0.01 * i) for i in range(11, 20))]
    same = bb.simulate("zero", pushes=pushes, **ON_BALL)
    np.testing.assert_allclose(done.to_array(), same.to_array(), atol=1e-12)
    # A steady force leaves LQR with an offset that lqi removes.
    ends = [
        bb.simulate(name, forces=[bb.Force((0.3, 0.0, 0.0))], seconds=15.0).metrics().position_error_final
        for name in ("lqr", "lqi")
    ]
    assert ends[0] > 0.01
    assert ends[1] < 0.1 * ends[0]


def test_a_fallen_robot_lies_and_its_metrics_end_with_the_fall():
    done = bb.simulate("lqr", pushes=[bb.Push((6.0, 0.0, 0.0), 0.5)], seconds=3.0)
    assert done.fell_at is not None
    assert len(done.times) == 301
    assert "fell at" in repr(done)
    rows = done.times <= done.fell_at + 1e-9
    errors = np.linalg.norm(done.of_states("ball_position")[:, :2], axis=1)
    assert done.metrics().position_error_max == pytest.approx(errors[rows].max())
    assert errors.max() > errors[rows].max()
    (before,) = np.flatnonzero(np.isclose(done.times, done.fell_at))
    assert (done.torques[before:] == 0.0).all()


def test_metrics_match_the_rows():
    done = bb.simulate("lqr", tilt=(0.1, 0.0), robot=PARAMS.replace(body_com_offset=(0.003, 0.0)), seconds=2.0)
    metrics = done.metrics()
    # From the equilibrium, which the mast of this robot is not upright in.
    assert metrics.tilt_max == pytest.approx(0.1, rel=1e-6)
    assert abs(done.of_states("tilt").max() - 0.1) > 1e-4
    assert metrics.torque_rms == pytest.approx(np.sqrt(np.mean(done.torques[:-1] ** 2)))
    assert metrics.torque_max == np.abs(done.torques).max()
    tractions, loads = np.abs(done.of_contacts("wheel_tractions")), done.of_contacts("wheel_normal_forces")
    share = (tractions[1:] / loads[1:] / done.params.wheel_dynamic_friction).max()
    assert metrics.traction_utilization_max == pytest.approx(share)


def test_options_match_the_environment():
    named = bb.simulate(
        "lqr",
        robot="kugle",
        model="contact",
        actuators="kugle",
        sensors="kugle",
        observation="sensors",
        events="mild",
        tilt=(0.02, 0.0),
        seconds=0.5,
        seed=3,
    )
    options = {"robot": "kugle", "model": "contact", "actuators": "kugle", "sensors": "kugle"}
    options |= {"observation": "sensors", "events": "mild"}
    whole = bb.simulate("lqr", tilt=(0.02, 0.0), seconds=0.5, seed=3, **options)
    np.testing.assert_array_equal(named.to_array(), whole.to_array())
    assert len(named.estimates) == len(named.states)
    assert named.draws.keys() == whole.draws.keys() != set()


def test_a_run_is_a_simulation_with_one_push():
    push = bb.Push((0.1, 0.0, 0.0), 0.2)
    short = bb.simulate("lqr", seconds=0.5, pushes=push, tilt=(0.05, 0.0))
    same = bb.simulate("lqr", seconds=0.5, tilt=(0.05, 0.0), pushes=[push])
    np.testing.assert_array_equal(short.to_array(), same.to_array())
    start = bb.State.at_equilibrium(PARAMS, (0.05, 0.0))
    np.testing.assert_array_equal(
        bb.simulate("lqr", seconds=0.5, start=start, pushes=[push]).to_array(), same.to_array()
    )


def still(_):
    return np.zeros(3)


@pytest.mark.parametrize(
    ("controller", "arguments", "error", "message"),
    [
        ("pid", {"reference": CIRCLE}, TypeError, "pid does not follow position, .* it follows tilt"),
        (still, {"reference": CIRCLE}, TypeError, "still does not follow .* it takes no setpoint"),
        ("lqr", {"reference": {"place": (0, 0)}}, ValueError, "a setpoint has no part 'place': .* of position"),
        ("lqr", {"reference": {"position": (0, 0, 0)}}, ValueError, r"shape \(3,\), expected \(2,\)"),
        ("lqr", {"reference": {"yaw": float("inf")}}, ValueError, "part yaw of a setpoint is inf"),
        ("lqr", {"reference": lambda _: 3}, TypeError, "the reference gave 3 at 0 s"),
        ("lqr", {"reference": 3.0}, TypeError, "reference must be a Reference, a function of time or a dict"),
        ("lqr", {"seconds": 0.0}, ValueError, "seconds = 0.0 is out of range"),
        ("lqr", {"seconds": "1"}, TypeError, "seconds = '1' is not a number"),
        ("lqr", {"pushes": [bb.Push((1.0, 0.0, 0.0), "1")]}, TypeError, "time of a push = '1' is not a number"),
        ("lqr", {"pushes": [bb.Push((1, 0, 0), 9.0)]}, ValueError, "a push at 9.0 s is out of range"),
        ("lqr", {"pushes": [bb.Push((1, 0), 0.0)]}, ValueError, r"a push has \(1, 0\): expected three finite"),
        ("lqr", {"pushes": [bb.Push((1, 0, 0), 0.0, -1.0)]}, ValueError, "a push has duration = -1.0"),
        ("lqr", {"pushes": [(1, 0, 0)]}, TypeError, r"pushes has \(1, 0, 0\): expected a Push"),
        ("lqr", {"forces": [(1, 0, 0)]}, TypeError, r"forces has \(1, 0, 0\): expected a Force"),
        ("lqr", {"forces": [bb.Force((1, 0, 0), 2.0, 1.0)]}, ValueError, "a force begins at 2.0 s"),
        ("lqr", {"forces": [bb.Force((float("nan"), 0, 0))]}, ValueError, "a force has .nan, 0, 0.: expected three"),
        ("lqr", {"start": 1}, TypeError, "start must be a State, not int"),
        ("lqr", {"start": bb.State([0, 0, 1]), "yaw": 0.1}, TypeError, "start is a whole state"),
        ("lqr", {"env_options": {"model": "rigid"}}, TypeError, "write its entries as keywords"),
        ("lqr", {"robot": "kugel"}, ValueError, "kugel"),
    ],
)
def test_invalid_arguments_are_named(controller, arguments, error, message):
    with pytest.raises(error, match=message):
        bb.simulate(controller, **{"seconds": 5.0, **arguments})


def test_a_policy_has_the_setpoint_of_its_task():
    pytest.importorskip("onnxruntime", reason="needs 'ballbot-rs[onnx]'")
    policy = ASSETS / "policies" / "balance.onnx"
    done = bb.simulate(policy, seconds=1.0, setpoint=(0.1, 0.0))
    assert done.setpoints["position"][-1].tolist() == [0.1, 0.0]
    with pytest.raises(TypeError, match=r"is a policy: its only setpoint is its task's"):
        bb.simulate(policy, seconds=1.0, reference=CIRCLE)


def test_a_trajectory_ends_where_the_ground_does():
    small = bb.Terrain.from_heights(np.zeros((11, 11)), 0.1)
    options = {"terrain": small}
    there = bb.simulate("lqr", seconds=3.0, reference={"position": (2.0, 0.0)}, **options)
    assert there.fell_at is None
    assert there.times[-1] < 2.9
    assert not small.contains(*(there.states[-1].ball_position[:2]))
    assert small.contains(*(there.states[-2].ball_position[:2]))


def test_sampled_pushes_are_found_where_the_body_changes_its_velocity():
    events = [
        {"term": "push", "mode": "interval", "every": [0.5, 0.9], "range": [0.1, 0.3]},
        {"term": "push", "id": 3, "mode": "at", "at": 1.0, "range": [0.1, 0.2], "op": "scale", "height": [0.0, 0.2]},
    ]
    requested = bb.Push((0.05, 0.0, 0.0), time=0.2)
    found = bb.simulate("lqr", seconds=3.0, tilt=(0.0, 0.0), pushes=[requested], events=events)
    assert found.pushes == (requested,)
    assert found.all_pushes == (requested, *found.drawn_pushes)
    assert len(found.drawn_pushes) >= 4
    velocities = found.of_states("body_velocity")[:, :2]
    for push in found.drawn_pushes:
        row = round(push.time / 0.01)
        change = velocities[row + 1] - velocities[row]
        way = np.array(push.impulse[:2])
        assert change @ way / np.linalg.norm(change) / np.linalg.norm(way) > 0.8
        # The step before has none.
        assert np.linalg.norm(velocities[row] - velocities[row - 1]) < 0.5 * np.linalg.norm(change)
    (scaled,) = (push for push in found.drawn_pushes if push.point is not None)
    assert scaled.time == pytest.approx(1.0)
    assert 0.1 <= np.linalg.norm(scaled.impulse) / bb.Params.paper().body_mass <= 0.2
    assert 0.0 <= scaled.point[2] <= 0.2


def test_pushes_of_a_task_are_found():
    (push, *_) = bb.simulate("lqr", task="push", seconds=6.0, seed=1).drawn_pushes
    assert 2.0 <= push.time <= 5.0
    assert bb.simulate("lqr", seconds=1.0).drawn_pushes == ()


def test_a_trajectory_survives_pickling():
    done = bb.simulate("lqr", seconds=0.3, reference=CIRCLE, pushes=[bb.Push((0.3, 0.0, 0.0), 0.1)])
    again = pickle.loads(pickle.dumps(done))
    assert repr(again) == repr(done)
    for name, column in done.columns().items():
        np.testing.assert_array_equal(again.columns()[name], column, err_msg=name)
    assert again.metrics() == done.metrics()


MOTIONS = [
    bb.Reference.hold((0.1, -0.2), yaw=0.3, yaw_rate=0.5),
    bb.Reference.line((1.0, 0.5), 4.0, (0.2, 0.1), robot="kugle"),
    bb.Reference.path([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], [0.0, 3.0, 6.0]),
    bb.Reference.stops([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], [0.0, 3.0, 6.0]),
    bb.Reference.square(0.5, 3.0),
    bb.Reference.velocities([(0.3, 0.0), (0.0, 0.0)], [0.0, 4.0], 2.0),
    bb.Reference.circle(0.5, 6.0),
    bb.Reference.lemniscate(0.5, 12.0, 6.0),
    bb.Reference.attitude(0.05, 0.5),
    # More than the robot has, which was allowed.
    bb.Reference.circle(2.0, 1.0, friction=None),
]


@pytest.mark.parametrize("motion", MOTIONS, ids=repr)
def test_a_motion_survives_pickling(motion):
    times = np.linspace(0.0, 15.0, 31)
    for again in (pickle.loads(pickle.dumps(motion)), copy.deepcopy(motion)):
        assert repr(again) == repr(motion)
        assert again.demand == motion.demand
        for part, values in motion.sample(times).items():
            np.testing.assert_array_equal(again.sample(times)[part], values, err_msg=part)


def test_the_setpoints_match_the_commands_of_the_task():
    """They were the origin, and the goal a position error of the whole way."""
    done = bb.simulate("lqr", task="goal", seconds=6.0, seed=3)
    goal = done.setpoints["position"][-1]
    assert np.linalg.norm(goal) > 1.0
    np.testing.assert_allclose(done.states[-1].ball_position[:2], goal, atol=0.005)
    assert done.metrics().position_error_final < 0.005
    assert done.metrics().position_error_max > 1.0
    fallen = bb.simulate("zero", task="path", seconds=3.0, tilt=(0.1, 0.0))
    assert fallen.fell_at is not None
    assert len(fallen.setpoints["velocity"]) == len(fallen.times)


@pytest.mark.parametrize("tilt", [(0.2, 0.0), (0.0, 0.2), (0.0, -0.2)])
def test_a_fallen_robot_lies_on_the_ground_of_the_environment(tilt):
    slope = bb.Terrain.plane(0.1)
    fallen = bb.simulate("zero", seconds=2.0, tilt=tilt, terrain=slope)
    assert fallen.fell_at is not None
    assert fallen.times[-1] == pytest.approx(2.0)
    x, y, z = fallen.states[-1].ball_position
    above = (z - slope.height(x, y)) * math.cos(0.1)
    assert above == pytest.approx(bb.Params.paper().ball_radius, abs=2e-3)


def test_the_start_on_a_terrain_is_as_given():
    """Starts of episodes lean by up to `reset_tilt` more, which this start does not."""
    terrain = bb.Terrain.plane(0.1)
    run = bb.simulate("lqr", terrain=terrain, position=(1.0, 1.0), seconds=0.1)
    np.testing.assert_allclose(run.states[0].ball_position[:2], (1.0, 1.0), atol=1e-9)
    with pytest.raises(ValueError, match=r"the lean at rest there is .* reset_tilt = 0\.3"):
        bb.simulate("lqr", terrain=terrain, reset_tilt=0.3, seconds=0.1)
