"""Sessions on uneven ground: robots balance on it, leave it and start again, and rays meet it."""

import numpy as np
import pytest

from ballbot_rs import Terrain
from ballbot_rs.viewer.scene.arrows import FORCE_LENGTH, force_arrows
from ballbot_rs.viewer.scene.ground import HALF, patch, ray_meets
from ballbot_rs.viewer.session import Session

HILLS = {"kind": "noise", "slope": 0.1, "seed": 3}


def gap_of(session):
    """From the ground to the ball along the vertical, less what that is on a slope, m."""
    state, params = session.robots.states[0], session.robots[0].params
    x, y, z = state.ball_position
    below = np.array([x, y]) - params.ball_radius * session.robots.setup.terrain.normal(x, y)[:2]
    return z - params.ball_radius * session.robots.setup.terrain.normal(*below)[2] - session.frame().heights(below)


@pytest.mark.parametrize("model", ["contact", "rigid"])
def test_a_robot_is_placed_on_the_ground_and_starts_in_its_lean(model):
    session = Session(model=model, task_options={"terrain": HILLS})
    session.reset([0.0, 0.0])
    start = session.robots.states[0]
    assert start.ball_position[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert abs(gap_of(session)) < 1e-3
    session.advance(4.0)
    assert not session.robots.fallen.any()
    assert abs(gap_of(session)) < 1e-3


def test_the_terrain_task_has_separate_ground_for_each_robot_and_a_tile_to_start_on():
    session = Session(task="terrain")
    paper = session.robots.setup.terrain
    session.advance(3.0)
    assert session.robots.setup.terrain is paper
    session.choose(robot="kugle")
    assert session.robots.setup.terrain.slope != paper.slope
    tile = np.asarray(session.robots.states[0].ball_position[:2])
    np.testing.assert_allclose(tile % 4.0, 0.0, atol=1e-9)
    session.drive(1.0, 0.0, 0.0)
    session.advance(1.0)
    assert session.robots.commands[0, 0] > 0.1


SMALL = {"kind": "hills", "tiles": 2, "tile": 6.0, "slope": 0.05}


def drive_along_x(session, until):
    for _ in range(200):
        session.drive(1.0, 0.0, 0.0)
        session.advance(0.2)
        if until():
            return
    raise AssertionError("the robot did not get there in 40 s")


def test_a_robot_at_the_edge_of_a_tile_keeps_its_command_and_at_the_edge_of_the_terrain_restarts():
    session = Session(task="terrain", robot="kugle", task_options={"terrain": SMALL}, seed=1)
    session.robots[0].start((0.0, 0.0))
    while session.robots.states[0].ball_position[0] > 0.0:
        session.reset()
    along = [session.robots.states[0].ball_position[0]]
    first = session.robots.episodes[0]

    def moves_on():
        x = session.robots.states[0].ball_position[0]
        assert abs(x - along[-1]) < 0.5, "the robot jumped"
        along.append(x)
        return session.robots.episodes[0] > first

    drive_along_x(session, moves_on)
    assert abs(along[-1]) < 0.3, "the tiles meet at x = 0"
    speed = session.robots.commands[0, 0]
    assert speed > 0.3
    session.advance(0.1)
    assert session.robots.commands[0, 0] >= speed - 0.1
    assert not session.notices
    second = session.robots.episodes[0]
    drive_along_x(session, lambda: session.robots.episodes[0] > second)
    assert list(session.notices) == ["robot 0 left its ground and starts again"]
    assert abs(session.robots.states[0].ball_position[0]) == pytest.approx(3.0, abs=0.2)


@pytest.mark.slow("rigid falls")
@pytest.mark.parametrize(("robot", "largest"), [("paper", 20.0), ("rezero", 40.0)])
def test_a_body_that_strikes_the_floor_in_rigid_lies_where_it_fell(robot, largest):
    """An impact has it some millimeters within the floor, where no robot may begin."""
    fell = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        session = Session(model="rigid", robot=robot)
        session.reset(rng.uniform(-0.3, 0.3, 2))
        session.push(rng.uniform(-3.0, 3.0), rng.uniform(5.0, largest))
        while not session.robots.fallen.any() and session.time < 3.0:
            session.advance(0.05)
        if session.robots.fallen.any():
            fell += 1
            place = session.robots.states[0].ball_position
            session.advance(0.5)
            assert session.robots.fallen.all()
            assert np.linalg.norm(session.robots.states[0].ball_position - place) < 3.0
            assert not session.notices
    assert fell > 8


def test_a_rolling_robot_continues_in_place_in_a_model_without_slip_on_a_plane():
    session = Session(task_options={"terrain": {"kind": "plane", "slope": 0.08, "direction": 0.6}})
    session.move_setpoint(0.6, 0.3)
    session.advance(1.2)
    before = session.robots.states[0]
    session.choose(model="spatial")
    after = session.robots.states[0]
    np.testing.assert_allclose(after.ball_position, before.ball_position, atol=1e-3)
    np.testing.assert_allclose(after.ball_velocity, before.ball_velocity, atol=2e-2)
    np.testing.assert_allclose(after.body_quaternion, before.body_quaternion, atol=1e-12)
    assert np.linalg.norm(after.ball_velocity) > 0.02
    session.advance(3.0)
    assert not session.robots.fallen.any()


def same(session):
    """Whether robot and ghost are in the same episode, with the same command, at the same position."""
    robot, ghost = session.robots, session.ghost.robots
    assert ghost.episodes == robot.episodes
    if session.task != "balance":
        np.testing.assert_allclose(ghost.commands, robot.commands, atol=1e-9)
    np.testing.assert_allclose(ghost.states[0].to_array(), robot.states[0].to_array(), atol=1e-6)


@pytest.mark.parametrize("task", ["velocity", "terrain", "goal", "balance"])
def test_a_ghost_begins_the_episodes_of_the_robot(task):
    session = Session(task=task, seed=5)
    session.advance(1.0)
    session.reset()
    session.compare_with("lqr")
    same(session)
    session.advance(1.0)
    same(session)
    if task != "balance":
        session.sample_commands()
        session.advance(0.5)
        same(session)
    # If only the ghost falls, it restarts its episode; if the robot falls, both begin the next episode.
    session.ghost.robots[0].push([20.0, 0.0, 0.0])
    session.advance(4.0)
    assert session.ghost.robots.episodes == session.robots.episodes
    session.reset()
    same(session)
    session.robots[0].push([20.0, 0.0, 0.0])
    before = session.robots.episodes[0]
    while session.robots.episodes[0] == before and session.time < 10.0:
        session.advance(0.02)
    assert any("fell" in note for note in session.notices)
    same(session)
    session.advance(0.5)
    same(session)


def test_a_ghost_survives_a_change_of_the_task_whose_options_it_has():
    session = Session(task="velocity", task_options={"speed": 0.4})
    session.choose(task="balance")
    session.compare_with("lqi")
    assert session.ghost.controller == "lqi"
    session.choose(task="goal")
    assert session.ghost.task == "goal"
    assert not session.notices


@pytest.mark.slow("rigid on tiles")
def test_a_level_of_tiles_stays_behind_on_other_ground():
    session = Session(task="terrain", task_options={"level": 2})
    session.choose(task="velocity")
    session.choose(task="openballbot")
    session.choose(task="terrain")
    assert session.robots.setup.terrain is not None


def test_changing_to_level_ground_and_back_restarts_and_a_ghost_is_on_the_same_ground():
    session = Session(task_options={"terrain": HILLS})
    ground = session.robots.setup.terrain
    session.compare_with("lqi")
    assert session.ghost.robots.setup.terrain == ground
    session.advance(1.0)
    session.choose(task="openballbot")
    assert session.robots.setup.terrain == ground
    with pytest.raises(ValueError, match="num_robots = 4: there is one robot on uneven ground"):
        session.choose(num_robots=4)
    assert len(session.robots) == 1


@pytest.mark.parametrize("wrong", [{"kind": "noise", "slope": 2.0}, {"kind": "lava"}])
def test_invalid_ground_is_rejected(wrong):
    with pytest.raises(ValueError, match=r"slope|lava"):
        Session(task_options={"terrain": wrong})


def test_models_without_ground_reject_it_and_nothing_changes():
    session = Session(task_options={"terrain": HILLS})
    with pytest.raises(ValueError, match=r"planar|level"):
        session.choose(model="planar")
    assert session.robots.model == "contact"
    session.advance(0.5)


def test_a_ray_meets_the_ground_where_it_is():
    ground = Terrain.generate("noise", **{name: value for name, value in HILLS.items() if name != "kind"})
    # From a height that no hill hides a point at.
    for eye in (np.array([-2.0, -2.5, 4.0]), np.array([60.0, 0.0, 80.0])):
        for x, y in [(0.0, 0.0), (0.7, 0.4), (-1.0, 1.2)]:
            point = np.array([x, y, float(ground.height(x, y))])
            assert ray_meets(ground, eye, point - eye) == pytest.approx((x, y), abs=1e-2)
    assert ray_meets(ground, eye, np.array([0.0, 0.0, 1.0])) is None
    assert ray_meets(ground, np.array([0.0, 0.0, -5.0]), np.array([1.0, 0.0, -0.1])) is None
    # A hill is hit before what is behind it.
    ridge = Terrain.from_function(lambda x, y: 0.3 * np.exp(-((x / 0.5) ** 2)) + 0.0 * y, (8.0, 8.0))
    x, _ = ray_meets(ridge, np.array([-3.0, 0.0, 0.4]), np.array([4.0, 0.0, -0.4]))
    assert -1.0 < x < 0.0


def test_the_patch_is_the_ground():
    ground = Terrain.plane(0.1, 0.5)
    points = patch(ground, np.array([3.0, -1.0]))
    assert np.ptp(points[..., 0]) == pytest.approx(2.0 * HALF)
    np.testing.assert_allclose(points[..., 2], ground.height(points[..., 0], points[..., 1]))


def test_the_arrow_of_the_floor_is_along_the_slope():
    session = Session(task_options={"terrain": Terrain.plane(0.1)})
    session.advance(3.0)
    frame = session.frame()
    tail, tip = force_arrows(frame)[-1]
    normal = frame.terrain.normal(0.0, 0.0)
    assert (tip - tail) @ normal == pytest.approx(0.0, abs=1e-9)
    params = frame.params
    weight = (params.body_mass + params.ball_mass) * params.gravity
    assert np.linalg.norm(tip - tail) == pytest.approx(FORCE_LENGTH * weight * np.sin(0.1), rel=0.02)


def test_the_arrow_of_the_floor_is_along_the_ground_at_the_contact():
    bowl = Terrain.from_function(lambda x, y: 0.5 * (x**2 + y**2), (2.0, 2.0))
    session = Session(task_options={"terrain": bowl}, robot="kugle")
    session.move_setpoint(0.3, 0.0)
    session.advance(4.0)
    frame = session.frame()
    tail, tip = force_arrows(frame)[-1]
    ball, radius = frame.states[0, :3], frame.params.ball_radius
    contact = (tail - ball) / 0.98 + ball
    assert np.linalg.norm(tip - tail) > 0.01
    assert contact[2] == pytest.approx(float(bowl.height(*contact[:2])), abs=2e-3)
    assert (tip - tail) @ bowl.normal(*contact[:2]) == pytest.approx(0.0, abs=1e-4)
    assert np.linalg.norm(contact - ball) == pytest.approx(radius)
