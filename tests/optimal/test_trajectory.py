"""Linear models, optimal motions and the law that follows them."""

import copy
import pickle

import numpy as np
import pytest

import ballbot_rs as bb

PAPER = bb.Params.paper()


def test_a_linear_model_about_rest_has_the_matrices_of_the_equations():
    for name in ("paper", "rezero"):
        a, b = bb.linearize(name, sim_dt=1e-4)
        exact_a, exact_b = bb.LinearModel(name).discretize(0.01)
        np.testing.assert_allclose(a[:10, :10], exact_a, atol=3e-5 * np.abs(exact_a).max())
        np.testing.assert_allclose(b[:10], exact_b, atol=1e-4 * np.abs(exact_b).max())


def test_a_linear_model_of_a_leaning_robot_predicts_its_motion():
    start = bb.State.rolling(PAPER, (0.4, -0.1), bb.State.at_rest(PAPER, tilt=(0.1, 0.05)).body_quaternion)
    torques = np.array([0.05, -0.02, 0.01])
    a, b = bb.linearize(PAPER, start, torques, dt=0.02)
    robot = bb.Ballbot()

    def end(place, change):
        robot.reset(start.replace(ball_position=start.ball_position + place, body_position=start.body_position + place))
        robot.step(torques + change, 20)
        return np.concatenate([robot.state.ball_position[:2], robot.state.ball_velocity[:2]])

    for axis in range(3):
        change = 1e-5 * np.eye(3)[axis]
        slope = (end(np.zeros(3), change) - end(np.zeros(3), -change)) / 2e-5
        np.testing.assert_allclose(b[[0, 1, 5, 6], axis], slope, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(a[:2, :2], np.eye(2), atol=1e-9)


def test_a_linear_model_on_a_slope_is_about_rest():
    params = PAPER.replace(floor_tilt=(0.08, -0.05))
    robot = bb.Ballbot(params)
    start = bb.State.at_equilibrium(params, tilt=params.slope_lean())
    robot.reset(start)
    torques = params.holding_torques(start.yaw)
    robot.step(torques, 10)
    assert np.linalg.norm(robot.state.ball_velocity) < 1e-6
    robot.reset(start)
    for own, direct in zip(bb.linearize(params), robot.jacobian(torques, 10).rolling(), strict=True):
        np.testing.assert_array_equal(own, direct)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"dt": 0.0015}, "dt = 0.0015 is not a multiple"),
        ({"dt": 0.0}, "dt = 0.0 is out of range"),
        ({"dt": float("nan")}, "dt = nan"),
        ({"robot": "nobody"}, "nobody"),
        ({"state": bb.State.at_rest(PAPER).replace(ball_position=(0.3, 0.0, 0.112))}, "the body is 0.3 m from"),
        ({"wheel_torques": (0, 0)}, "wheel_torques"),
        ({"state": bb.State.at_rest(PAPER, tilt=(1.7, 0.0))}, "floor"),
    ],
)
def test_a_linear_model_names_bad_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        bb.linearize(**arguments)


@pytest.mark.parametrize("name", ["paper", "kugle", "rezero"])
def test_a_goal_is_reached_and_the_law_follows(name):
    params = bb.Params.preset(name)
    goal = np.array([0.4, -0.1]) * params.scale("m")
    seconds = round(2.2 * params.scale("s"), 2)
    found = bb.optimize_trajectory(goal, robot=name, seconds=seconds)
    assert found.reached, found
    assert found.converged, found
    assert found.position_errors[-1] < 1e-3 * params.scale("m")
    assert np.abs(found.torques).max() <= found.max_torque <= params.max_wheel_torque
    assert found.friction_used.max() < params.wheel_static_friction
    assert found.times[-1] == pytest.approx(seconds, abs=0.011)

    robot = bb.Ballbot(params)
    robot.reset(found.states[0])
    for torques in found.torques:
        robot.step(torques, 10)
    np.testing.assert_array_equal(robot.state.to_array(), found.states[-1].to_array())

    # From another place, on another time step.
    offset = np.array([0.02, 0.01, 0.0]) * params.scale("m")
    start = found.states[0]
    start = start.replace(ball_position=start.ball_position + offset, body_position=start.body_position + offset)
    run = bb.simulate(found.law(), start=start, seconds=found.times[-1] + 1.0)
    assert run.params == params
    assert run.fell_at is None
    at_end = run.states[len(found.torques)]
    assert np.linalg.norm(at_end.ball_position[:2] - goal) < 0.2 * np.linalg.norm(offset)


def test_a_move_is_shorter_than_the_closed_form_allows():
    with pytest.raises(ValueError, match=r"traction|friction|demand"):
        bb.Reference.line((1.0, 0.0), 2.4, robot=PAPER)
    found = bb.optimize_trajectory((1.0, 0.0), seconds=2.3, max_torque=PAPER.max_wheel_torque)
    assert found.reached
    again = bb.optimize_trajectory((1.0, 0.0), seconds=2.3, max_torque=PAPER.max_wheel_torque)
    np.testing.assert_array_equal(found.torques, again.torques)
    shorter = bb.optimize_trajectory((1.0, 0.0), seconds=2.2, max_torque=PAPER.max_wheel_torque, initial=found)
    assert shorter.reached
    assert shorter.times[-1] == pytest.approx(2.2)


def test_a_reference_is_followed_better_than_with_lqr():
    reference = bb.Reference.square(0.4, 2.5)
    found = bb.optimize_trajectory(reference)
    assert found.reached is None
    assert found.times[-1] == pytest.approx(10.0)
    runs = [
        bb.simulate(found.law(), start=found.states[0], seconds=10.0),
        bb.simulate("lqr", reference=reference, start=found.states[0]),
    ]
    places = np.array([reference(time)["position"] for time in runs[0].times])
    errors = [
        np.linalg.norm(np.array([state.ball_position[:2] for state in run.states]) - places, axis=1) for run in runs
    ]
    assert 5.0 * errors[0].max() < errors[1].max(), [error.max() for error in errors]


@pytest.mark.parametrize("terrain", ["wave", "plane"])
def test_a_goal_on_a_terrain_is_reached(terrain):
    ground = bb.Terrain.plane(0.06) if terrain == "plane" else bb.Terrain.generate("wave", size_x=3.0, size_y=3.0)
    found = bb.optimize_trajectory((0.5, 0.2), seconds=2.6, terrain=ground)
    assert found.reached
    run = bb.simulate(found.law(), start=found.states[0], seconds=3.0)
    assert run.fell_at is None
    assert np.linalg.norm(run.states[260].ball_position[:2] - (0.5, 0.2)) < 5e-3


@pytest.mark.parametrize("slope", [0.06, pytest.param(None, marks=pytest.mark.slow("a minute"))])
def test_a_reference_on_a_terrain_is_followed(slope):
    ground = bb.Terrain.generate("wave", size_x=3.0, size_y=3.0) if slope is None else bb.Terrain.plane(slope)
    found = bb.optimize_trajectory(bb.Reference.circle(0.3, 6.0), seconds=3.0, terrain=ground, iterations=60)
    assert found.position_errors.max() < 0.02, found.position_errors.max()


def test_another_result_is_a_start_at_any_rate():
    found = bb.optimize_trajectory((0.3, 0.1), seconds=2.0)
    costs = []
    for control_dt in (0.01, 0.02, 0.005):
        seen = []
        bb.optimize_trajectory(
            (0.3, 0.1),
            seconds=2.0,
            initial=found,
            control_dt=control_dt,
            iterations=1,
            progress=lambda _, cost, seen=seen: seen.append(cost),
        )
        costs.append(seen[0])
    assert max(costs) < 1.5 * min(costs), costs
    reference = bb.Reference.square(0.3, 2.5)
    first = bb.optimize_trajectory(reference)
    again = bb.optimize_trajectory(reference, initial=first, iterations=3)
    assert again.position_errors.max() < 1e-3


def test_a_law_that_is_given_as_a_start_is_reset():
    law = bb.optimize_trajectory((0.2, 0.0), seconds=1.5).law()
    runs = [bb.optimize_trajectory((0.25, 0.0), seconds=1.5, initial=law) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].torques, runs[1].torques)


def test_a_goal_that_is_out_of_reach_is_not_converged():
    found = bb.optimize_trajectory((1.0, 0.0), seconds=1.0, iterations=60)
    assert not found.reached
    assert not found.converged


def test_a_law_starts_over():
    found = bb.optimize_trajectory((0.1, 0.0), seconds=1.5)
    law = found.law()
    first = law(found.states[0])
    law(found.states[1])
    law.reset()
    np.testing.assert_array_equal(law(found.states[0]), first)
    np.testing.assert_allclose(first, found.torques[0])
    copied = copy.deepcopy(law)
    np.testing.assert_array_equal(copied(found.states[1]), law(found.states[1]))
    loaded = pickle.loads(pickle.dumps(found))
    assert not loaded.torques.flags.writeable
    again = loaded.law()
    np.testing.assert_array_equal(again(found.states[0]), first)
    far = found.states[0].replace(ball_position=(9.0, 0.0, 0.112), body_position=(9.0, 0.0, 0.112))
    assert np.abs(law(far)).max() <= found.max_torque * (1.0 + 1e-12)


def test_progress_counts_iterations():
    seen = []
    found = bb.optimize_trajectory((0.1, 0.0), seconds=1.5, progress=lambda k, cost: seen.append((k, cost)))
    assert [k for k, _ in seen] == list(range(len(seen)))
    assert len(seen) >= found.iterations
    assert all(np.isfinite(cost) for _, cost in seen)


@pytest.mark.parametrize(
    ("goal", "arguments", "message"),
    [
        ((1.0, 0.0), {}, "seconds is needed"),
        ((1.0, 0.0, 0.0), {"seconds": 2.0}, "not a position"),
        ((np.nan, 0.0), {"seconds": 2.0}, "not a position"),
        ((1.0, 0.0), {"seconds": 0.0}, "seconds = 0.0"),
        ((1.0, 0.0), {"seconds": np.inf}, "seconds = inf"),
        ((1.0, 0.0), {"seconds": 2.0, "control_dt": 0.0015}, "control_dt = 0.0015"),
        ((1.0, 0.0), {"seconds": 2.0, "max_torque": 9.0}, "max_torque = 9"),
        ((1.0, 0.0), {"seconds": 2.0, "friction": 0.0}, "friction = 0.0"),
        ((1.0, 0.0), {"seconds": 2.0, "iterations": 0}, "iterations"),
        ((1.0, 0.0), {"seconds": 2.0, "tolerance": -1.0}, "tolerance"),
        ((1.0, 0.0), {"seconds": 2.0, "start": bb.State.at_rest(PAPER, tilt=(0.7, 0.0))}, "every initial motion"),
        (
            (1.0, 0.0),
            {"seconds": 2.0, "start": bb.State.at_rest(PAPER).replace(ball_position=(0.3, 0, 0.112))},
            "body is",
        ),
        ((1.0, 0.0), {"seconds": 2.0, "initial": "lqr"}, "neither a result nor a law"),
        ((1.0, 0.0), {"seconds": 2.0, "initial": lambda _: (0.0, 0.0)}, "the law of initial="),
        ((1.0, 0.0), {"seconds": 2.0, "initial": lambda _: (0.0, 0.0, np.nan)}, "the law of initial="),
        ((1.0, 0.0), {"seconds": 2.0, "robot": PAPER.replace(floor_tilt=(0.05, 0.0))}, "floor_tilt"),
        (bb.Reference.circle(0.5, 6.0), {}, "seconds is needed"),
        (bb.Reference.line((0.5, 0.0), 3.0, robot="kugle"), {}, "another robot"),
    ],
)
def test_bad_input_is_named(goal, arguments, message):
    with pytest.raises((ValueError, TypeError), match=message):
        bb.optimize_trajectory(goal, **arguments)


def test_the_law_by_name_follows_a_reference_or_moves_to_a_place():
    reference = bb.Reference.line((0.05, 0.0), 1.2)
    run = bb.simulate("tvlqr", reference=reference, control_dt=0.02)
    assert run.controller == "tvlqr"
    place = lambda time: reference(time)["position"]  # noqa: E731
    for state, time in zip(run.states, run.times, strict=True):
        assert np.linalg.norm(state.ball_position[:2] - place(time)) < 1e-4
    pushed = bb.Push((0.05, 0.0, 0.0), time=0.5)
    run = bb.simulate("tvlqr", reference={"position": (0.2, 0.0)}, seconds=1.5, pushes=pushed, control_dt=0.02)
    assert np.linalg.norm(run.states[-1].ball_position[:2] - (0.2, 0.0)) < 0.02


@pytest.mark.parametrize("start", [{"position": (1.0, 0.0)}, {"tilt": (0.03, -0.02), "yaw": 0.4}])
def test_the_law_by_name_is_planned_from_the_start_of_the_robot(start):
    goal = np.array([0.2, 0.0]) + start.get("position", (0.0, 0.0))
    run = bb.simulate("tvlqr", reference={"position": goal}, seconds=1.5, control_dt=0.02, **start)
    first, last = run.states[0], run.states[-1]
    np.testing.assert_allclose(first.ball_position[:2], start.get("position", (0.0, 0.0)))
    assert np.linalg.norm(last.ball_position[:2] - goal) < 2e-3
    assert last.yaw == pytest.approx(first.yaw, abs=5e-3)


def test_a_class_with_the_name_of_the_law_is_not_replaced():
    class Law:
        name = "tvlqr"

        def __call__(self, state):
            return 0.0 * state.wheel_speeds

    assert bb.simulate(Law, tilt=(0.05, 0.0), seconds=0.1).torques.max() == 0.0


def test_the_law_by_name_needs_a_motion():
    for reference in (None, {"yaw": 1.0}, lambda time: {"position": (time, 0.0)}):
        with pytest.raises(TypeError, match="follows a Reference or moves to a constant position"):
            bb.simulate("tvlqr", reference=reference)
    with pytest.raises(ValueError, match=r"does not reach \(0.3, 0.0\) m in 0.1 s"):
        bb.simulate("tvlqr", reference={"position": (0.3, 0.0)}, seconds=0.1, control_dt=0.05)
    with pytest.raises(ValueError, match="tvlqr follows one motion"):
        bb.evaluate("tvlqr", episodes=1)
