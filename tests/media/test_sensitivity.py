"""Effects of parameters on a motion: exact derivatives of the closed loop, limits, the figure and its command."""

import csv

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs.analysis import sensitivity
from ballbot_rs.cli import main
from ballbot_rs.optimal import tangent

FIELDS = ("body_mass", "body_inertia", "gravity", "wheel_inertia")
TILT, SECONDS = (0.08, 0.05), 1.5


def exact(fields, change):
    """Largest changes of the ball's place, mm, and the torques, mN·m, by the chain rule through steps and law."""
    robot = bb.Ballbot("paper", "contact", 0.002)
    robot.reset(bb.State.at_equilibrium(robot.params, tilt=TILT))
    law = bb.Lqr(robot.params, 0.01, max_torque=robot.params.max_wheel_torque)

    def torques(row):
        return np.asarray(law(bb.State.from_array(row)))

    size, small = sum(len(np.atleast_1d(robot.params.to_dict()[name])) for name in fields), 1e-6
    dx, places, efforts = np.zeros((30, size)), [], []
    for _ in range(round(SECONDS / 0.01)):
        row = robot.state.to_array()
        along = tangent.numbers_by_change(row[None])[0]
        slopes = [(torques(row + small * one) - torques(row - small * one)) / (2 * small) for one in along.T]
        du = np.array(slopes).T @ dx
        motion = robot.jacobian(torques(row), steps=5, parameters=fields)
        places.append(dx[:2])
        efforts.append(du)
        dx = motion.A @ dx + motion.B @ du + motion.P
        robot.step(torques(row), 5)
    ball = np.linalg.norm(np.array([*places, dx[:2]]), axis=1).max(axis=0)
    return {"ball": 1e3 * ball * change, "torque": 1e3 * np.abs(efforts).max(axis=(0, 1)) * change}


def test_effects_are_the_exact_derivatives_of_the_closed_loop():
    found = sensitivity.collect("lqr", FIELDS, tilt=TILT, seconds=SECONDS)
    assert found.names == (
        "body_mass",
        "body_inertia_xx",
        "body_inertia_yy",
        "body_inertia_zz",
        "gravity",
        "wheel_inertia",
    )
    expected = exact(FIELDS, found.changes)
    for name, effects in expected.items():
        np.testing.assert_allclose(found.effects[name], effects, rtol=1e-2, atol=1e-3 * effects.max(), err_msg=name)


def test_a_parameter_without_effect_has_none_and_losses_of_zero_have_one():
    found = sensitivity.collect("lqr", ("wheel_mass", "floor_rolling_friction", "roller_friction"), seconds=1.0)
    for effect in found.effects.values():
        assert effect[0] == 0.0
        assert (effect[1:] > 0.0).all()
    assert set(found.largest(2).names) == {"floor_rolling_friction", "roller_friction"}


@pytest.mark.parametrize("robot", ["rezero", "asroballet"])
def test_at_a_limit_of_a_parameter_the_difference_is_one_sided(robot):
    """The balls of these are thin shells, or static and dynamic friction are equal: the derivatives are of one side."""
    names = ("ball_inertia", "wheel_static_friction", "wheel_dynamic_friction")
    found = sensitivity.collect("lqr", names, env_options={"robot": robot}, seconds=1.0)
    # The same motion with the parameter away from its limit.
    params = bb.Params.preset(robot)
    away = params.replace(ball_inertia=0.995 * params.ball_inertia)
    inside = sensitivity.collect("lqr", names, robot=away, env_options={"robot": robot}, seconds=1.0)
    for name, effects in inside.effects.items():
        assert found.effects[name][0] == pytest.approx(effects[0], rel=0.05)
        assert effects[0] > 0.0


def test_parameters_that_the_model_fixes_are_left_out():
    planar = {"model": "planar"}
    found = sensitivity.collect("lqr", ("wheel_azimuths", "body_mass"), env_options=planar, seconds=1.0)
    assert found.names == ("body_mass",)
    with pytest.raises(ValueError, match="the model planar allows no other values of wheel_azimuths"):
        sensitivity.collect("lqr", ("wheel_azimuths",), env_options=planar)


def test_on_uneven_ground_a_larger_ball_starts_on_it():
    ground = {"terrain": bb.Terrain.generate("wave", size_x=4.0, size_y=4.0)}
    found = sensitivity.collect("lqr", ("ball_radius",), env_options=ground, seconds=0.5)
    assert found.effects["ball"][0] > 0.0


def test_progress_is_reported_to_the_end_and_may_end_the_computation():
    reports = []
    sensitivity.collect("lqr", ("body_mass",), seconds=0.5, progress=lambda *report: reports.append(report))
    assert reports == [(20, 50), (40, 50), (50, 50)]

    def stop(*_):
        raise InterruptedError

    with pytest.raises(InterruptedError):
        sensitivity.collect("lqr", ("body_mass",), progress=stop)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: sensitivity.collect("zero"), "a robot falls at .* s: sensitivities need a motion that stays upright"),
        (lambda: sensitivity.collect("lqr", ("delay",)), "delay is not a parameter of the robot"),
        (lambda: sensitivity.collect("lqr", ("body_mas",)), "did you mean 'body_mass'"),
        (lambda: sensitivity.collect("lqr", env_options={"events": "mild"}), "leave out events and sensors"),
        (
            lambda: sensitivity.collect("lqr", pushes=[bb.Push((0.1, 0, 0)), bb.Push((0.1, 0, 0), point=(0, 0, 0.2))]),
            r"pushes are at the center of mass and \(0.0, 0.0, 0.2\) m: .* at one point of the body",
        ),
    ],
)
def test_what_has_no_sensitivities_is_rejected(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("width", [(), ("--width", "89")])
def test_the_figure_and_its_numbers(tmp_path, width):
    pytest.importorskip("matplotlib")
    command = ["plot", "--figure", "sensitivity", "--controller", "lqr", "--controller", "cascade_pid"]
    assert main([*command, "--robot", "kugle", "--seconds", "1", "--data", *width, "-o", str(tmp_path)]) == 0
    assert (tmp_path / "sensitivity.svg").is_file()
    with (tmp_path / "sensitivity-LQR.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert "body_com_offset_x" in [row["parameter"] for row in rows]
    assert all(float(row["tilt_deg"]) >= 0.0 for row in rows)
