"""Parameters, states, closed-form models and controllers, as Python users see them."""

import copy
import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import ballbot_rs
from ballbot_rs import (
    PAPER_BALL_VISCOUS_FRICTION,
    BalanceEnv,
    Ballbot,
    BallbotError,
    Batch,
    Controller,
    DivergedError,
    InvalidInputError,
    LinearModel,
    Lqr,
    Params,
    Pid,
    PlanarModel,
    Renderer,
    SpatialModel,
    State,
    UrdfError,
    virtual_to_wheel_torques,
    wheel_to_virtual_torques,
)
from ballbot_rs._core import CONTROLLERS, ENVIRONMENT_OPTIONS, PARAMETERS
from ballbot_rs.envs._batch_env import option_names
from ballbot_rs.envs.options import BalanceOptions, CommonOptions
from tests.support.paths import ROOT

VECTORS = ROOT / "tests/rust/core/data/spatial_vectors.json"


def test_every_exported_name_exists():
    pytest.importorskip("stable_baselines3", reason="BallbotVecEnv is exported too")
    for name in ballbot_rs.__all__:
        assert getattr(ballbot_rs, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        ballbot_rs.nothing  # noqa: B018


def test_exceptions_are_what_users_would_catch():
    assert issubclass(UrdfError, ValueError)
    assert issubclass(DivergedError, ArithmeticError)
    assert issubclass(InvalidInputError, ValueError)
    for error in (UrdfError, DivergedError, InvalidInputError):
        assert issubclass(error, BallbotError)
        assert error.__module__ == "ballbot_rs"


class TestParams:
    def test_paper_is_table_ii(self, paper):
        table = {
            "ball_mass": 1.437,
            "ball_inertia": 0.0112,
            "ball_radius": 0.112,
            "body_mass": 2.228,
            "body_inertia": (0.0583, 0.0583, 0.0137),
            "body_com_height": 0.142,
            "wheel_inertia": 0.000149,
            "wheel_radius": 0.05,
            "wheel_zenith": np.pi / 4,
            "gravity": 9.81,
            "ball_viscous_friction": 0.0,
        }
        for name, value in table.items():
            assert getattr(paper, name) == pytest.approx(value, rel=1e-15)
            assert paper.to_dict()[name] == getattr(paper, name)
        np.testing.assert_allclose(np.rad2deg(paper.wheel_azimuths), [0, 120, 240])
        assert pytest.approx(49.849) == PAPER_BALL_VISCOUS_FRICTION

    def test_presets(self, paper):
        names = Params.preset_names()
        assert names[0] == "paper"
        assert len(names) == len(set(names)) >= 4
        assert Params.preset("paper") == paper
        assert all(Params.preset(name) != paper for name in names[1:])
        with pytest.raises(ValueError, match="unknown robot preset 'r2d2': expected one of paper, "):
            Params.preset("r2d2")

    def test_toml_brings_every_value_back(self, paper):
        odd = paper.replace(ball_mass=13.0 / 9.0, body_inertia=[0.05, 0.05, 1e-2 / 3.0])
        assert Params.from_toml(odd.to_toml()) == odd
        assert Params.from_toml("# kept in robot.toml\n" + odd.to_toml() + "# from robot.toml") == odd

    @pytest.mark.parametrize("convert", [str, Path])
    def test_a_toml_file_describes_a_robot(self, paper, tmp_path, convert):
        heavy = paper.replace(body_mass=4.0)
        path = convert(tmp_path / "my_robot.toml")
        Path(path).write_text(heavy.to_toml(), encoding="utf-8")
        assert Params.from_toml(path) == heavy
        assert Ballbot(path).params == heavy
        np.testing.assert_array_equal(Lqr(path, 0.005).gain, Lqr(heavy, 0.005).gain)
        assert BalanceEnv(robot=path).params == heavy

    def test_a_path_object_needs_no_suffix(self, paper, tmp_path):
        path = tmp_path / "robot"
        path.write_text(paper.to_toml(), encoding="utf-8")
        assert Ballbot(path).params == paper

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("ball_mass = 1.437", "ball_mass = -1.5", "ball_mass = -1.5 is out of range"),
            ("ball_mass = 1.437", 'ball_mass = "heavy"', 'ball_mass = "heavy" is not a number'),
            ("ball_mass", "ball_weight", "unknown parameter 'ball_weight'"),
            ("ball_mass =", "ball_mass", "line 1"),
        ],
    )
    def test_an_error_of_a_toml_file_names_it(self, paper, tmp_path, old, new, words):
        path = tmp_path / "my_robot.toml"
        path.write_text(paper.to_toml().replace(old, new), encoding="utf-8")
        with pytest.raises(ValueError, match=re.escape(words)) as rejection:
            Ballbot(str(path))
        assert str(path) in str(rejection.value)

    def test_a_toml_file_that_is_missing(self):
        with pytest.raises(FileNotFoundError, match=r"^\[Errno 2\] No such file or directory: 'no_robot\.toml'$"):
            BalanceEnv(robot="no_robot.toml")
        with pytest.raises(TypeError, match="TOML text or a path, not int"):
            Params.from_toml(3)

    @pytest.mark.parametrize("convert", [str, Path])
    def test_urdf_files_describe_the_paper(self, assets, paper, convert):
        found = Params.from_urdf(convert(assets / "bot.urdf"), convert(assets / "ball.urdf"))
        expected = paper.to_dict()
        assert found.to_dict().keys() == expected.keys()
        for name, value in found.to_dict().items():
            np.testing.assert_allclose(value, expected[name], rtol=1e-12, atol=1e-12, err_msg=name)

    def test_a_general_body(self, paper):
        assert paper.is_symmetric
        assert paper.body_com == (0.0, 0.0, 0.142)
        assert paper.wheel_zeniths == (paper.wheel_zenith,) * 3
        np.testing.assert_allclose(paper.equilibrium_wheel_loads, 2.228 * 9.81 / (3 * np.cos(np.pi / 4)), rtol=1e-15)
        general = paper.replace(
            body_com_offset=[3e-3, -4e-3],
            body_products_of_inertia=(1e-3, -2e-3, 5e-4),
            wheel_zenith_offsets=np.array([0.01, 0.0, -0.02]),
            wheel_azimuths=[0.02, 2.1, 4.1],
        )
        assert not general.is_symmetric
        assert general.body_com == (3e-3, -4e-3, 0.142)
        assert general.wheel_zeniths == tuple(paper.wheel_zenith + offset for offset in (0.01, 0.0, -0.02))
        assert general.body_products_of_inertia == (1e-3, -2e-3, 5e-4)
        assert Params(**general.to_dict()) == general == Params.from_toml(general.to_toml())
        # The wheels hold the weight along the line to the CoM.
        com = np.array(general.body_com)
        sin, cos = np.sin(general.wheel_zeniths), np.cos(general.wheel_zeniths)
        contacts = np.array([sin * np.cos(general.wheel_azimuths), sin * np.sin(general.wheel_azimuths), cos])
        weight = general.body_mass * general.gravity * com / np.linalg.norm(com)
        np.testing.assert_allclose(contacts @ general.equilibrium_wheel_loads, weight, atol=1e-12)

    @pytest.mark.parametrize("change", [{"body_com_offset": [1e-3, 0.0]}, {"wheel_azimuths": [0.01, 2.1, 4.2]}])
    def test_the_planar_model_is_of_symmetric_robots(self, paper, change):
        general, words = paper.replace(**change), f"'spatial', 'contact' and 'rigid' take any: {next(iter(change))} = "
        for make in (lambda: PlanarModel(general), lambda: Ballbot(general, model="planar")):
            with pytest.raises(ValueError, match=words):
                make()
        Ballbot(general, model="spatial")

    def test_the_printed_map_is_of_even_wheels(self, paper):
        uneven = paper.replace(wheel_zenith_offsets=[0.01, 0.0, 0.0])
        for make in (
            lambda: virtual_to_wheel_torques(uneven, [0, 0, 1], "as_printed"),
            lambda: Pid(uneven, mapping="as_printed"),
        ):
            with pytest.raises(ValueError, match=r"eq\. \(8\) as printed .*: wheel_zenith_offsets = "):
                make()
        assert virtual_to_wheel_torques(uneven, [0, 0, 1]).shape == (3,)

    def test_values_survive_every_way_of_copying(self, paper):
        heavy = paper.replace(body_mass=4.0, body_inertia=[0.1, 0.1, 0.02])
        for again in (
            Params(**heavy.to_dict()),
            pickle.loads(pickle.dumps(heavy)),
            copy.deepcopy(heavy),
            eval(repr(heavy), {"Params": Params}),
            heavy.replace(),
        ):
            assert again == heavy
            assert again is not paper
            assert again.to_dict() == heavy.to_dict()
        assert heavy != paper
        assert paper.body_mass == 2.228, "replace changed the original"
        assert (paper == 3) is False

    def test_defaults(self):
        required = {k: v for k, v in Params.paper().to_dict().items() if "friction" not in k and k != "gravity"}
        assert Params(**required).gravity == 9.81

    def test_parameters_are_described(self, paper):
        assert [parameter["name"] for parameter in PARAMETERS] == list(paper.to_dict())
        for parameter in PARAMETERS:
            name, default = parameter["name"], parameter["default"]
            doc = getattr(Params, name).__doc__
            assert doc.startswith(parameter["doc"])
            assert parameter["limit"] in doc
            assert parameter["unit"] in doc
            changes = {key: value for key, value in paper.to_dict().items() if key != name}
            if default is None:
                with pytest.raises(ValueError, match=f"parameter {name} is missing"):
                    Params(**changes)
            else:
                value = getattr(Params(**changes), name)
                assert value == (tuple(default) if isinstance(default, list) else default)

    def test_attributes_are_listed_and_read_only(self, paper):
        assert set(paper.to_dict()) <= set(dir(paper))
        with pytest.raises(AttributeError, match="ball_weight"):
            paper.ball_weight  # noqa: B018
        with pytest.raises(AttributeError):
            paper.ball_mass = 1.0
        paper.to_dict()["ball_mass"] = 99.0
        assert paper.ball_mass == 1.437

    def test_missing_and_unknown_names(self, paper):
        with pytest.raises(ValueError, match=r"parameters ball_inertia, ball_radius, .*, wheel_zenith are missing"):
            Params(ball_mass=1.0)
        with pytest.raises(ValueError, match="unknown parameter 'ball_weight': expected one of ball_mass"):
            paper.replace(ball_weight=1.0)
        with pytest.raises(TypeError):
            Params(1.0)


class TestState:
    def test_defaults_are_at_rest(self):
        state = State((1.0, 2.0, 0.112), ball_velocity=(0.1, 0.2, 0.0))
        np.testing.assert_array_equal(state.body_position, [1.0, 2.0, 0.112])
        np.testing.assert_array_equal(state.body_velocity, [0.1, 0.2, 0.0])
        np.testing.assert_array_equal(state.body_quaternion, [1, 0, 0, 0])
        np.testing.assert_array_equal(state.wheel_speeds, [0, 0, 0])
        assert state.tilt == 0.0
        assert state.yaw == 0.0

    def test_upright_with_tilt_and_yaw(self, paper):
        state = State.at_rest(paper, tilt=(0.03, -0.04), yaw=0.5)
        assert state.tilt == pytest.approx(0.05, abs=1e-12)
        np.testing.assert_allclose(state.tilt_components, [0.03, -0.04], atol=1e-12)
        assert state.yaw == pytest.approx(0.5, abs=1e-12)
        assert state.ball_position[2] == paper.ball_radius
        assert np.linalg.norm(state.body_quaternion) == pytest.approx(1.0, abs=1e-15)

    def test_equilibrium_has_the_center_of_mass_above_the_ball(self, paper):
        assert State.at_equilibrium(paper) == State.at_rest(paper)
        off = paper.replace(body_com_offset=[3e-3, -4e-3])
        state = State.at_equilibrium(off, yaw=0.5)
        assert state.tilt == pytest.approx(np.arctan(5e-3 / 0.142), abs=1e-15)
        assert state.yaw == pytest.approx(0.5, abs=1e-15)
        robot = Ballbot(off, model="spatial")
        robot.reset(state)
        np.testing.assert_allclose(robot.contacts.wheel_normal_forces, off.equilibrium_wheel_loads, rtol=1e-12)
        robot.step([0.0, 0.0, 0.0], steps=100)
        assert abs(robot.state.tilt - state.tilt) < 1e-13
        tilted = State.at_equilibrium(off, tilt=(0.03, -0.04), yaw=0.5)
        w, x, y, z = tilted.body_quaternion
        up = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
        assert np.arccos(up @ off.body_com / np.linalg.norm(off.body_com)) == pytest.approx(0.05, abs=1e-12)
        assert State.at_equilibrium(paper, (0.03, -0.04), 0.5) == State.at_rest(paper, (0.03, -0.04), 0.5)
        with pytest.raises(ValueError, match="yaw"):
            State.at_equilibrium(off, yaw=np.nan)

    def test_rolling_has_no_slip(self, paper):
        state = State.rolling(paper, (0.3, -0.2), ball_spin=0.7)
        np.testing.assert_allclose(state.ball_angular_velocity, [0.2 / 0.112, 0.3 / 0.112, 0.7], rtol=1e-12)
        np.testing.assert_array_equal(state.body_velocity, [0.3, -0.2, 0.0])
        speeds = SpatialModel(paper, ball_spins_about_vertical=True).wheel_speeds(
            state.body_quaternion,
            [0.3, -0.2, 0, 0, 0, 0.7],
        )
        np.testing.assert_allclose(state.wheel_speeds, speeds, rtol=1e-12)
        assert np.abs(speeds).max() > 1.0

    def test_array_round_trip(self, paper):
        state = State.rolling(paper, (0.3, -0.2)).replace(wheel_angles=(1.0, 2.0, 3.0))
        array = state.to_array()
        assert array.shape == (32,)
        assert State.from_array(array) == state
        np.testing.assert_array_equal(array[26:29], [1, 2, 3])
        np.testing.assert_array_equal(array[:3], state.ball_position)

    def test_copies_are_equal(self, paper):
        state = State.at_rest(paper, tilt=(0.1, 0.2), yaw=-1.0)
        for again in (pickle.loads(pickle.dumps(state)), copy.deepcopy(state)):
            assert again == state
        assert state.replace() == state
        assert state.replace(ball_velocity=(1, 0, 0)) != state
        assert state != "state"

    def test_attributes_are_copies(self, paper):
        state = State.at_rest(paper)
        state.ball_position[:] = 9.0
        assert state.ball_position[0] == 0.0
        with pytest.raises(AttributeError):
            state.ball_position = (0, 0, 0)


class TestSpatialModel:
    @pytest.mark.parametrize("case", json.loads(VECTORS.read_text())["accelerations"][::9], ids=lambda c: c["name"])
    def test_accelerations_of_an_independent_reference(self, paper, case):
        params = paper.replace(
            ball_viscous_friction=case["ball_viscous_friction"], wheel_viscous_friction=case["wheel_viscous_friction"]
        )
        model = SpatialModel(params, case["absolute_wheel_spin"], case["ball_spins_about_vertical"])
        motion = (case["body_quaternion_wxyz"], case["generalized_velocity"])
        found = model.accelerations(*motion, case["wheel_torques"])
        expected = np.array(case["generalized_acceleration"])
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10 * max(1.0, np.abs(expected).max()))
        np.testing.assert_allclose(model.wheel_speeds(*motion), case["wheel_speeds"], rtol=1e-10, atol=1e-10)
        assert model.energy(*motion) == pytest.approx(case["energy"], rel=1e-10)
        contacts = model.contacts(*motion, case["wheel_torques"])
        for name in ("floor_force", "wheel_normal_forces", "wheel_tractions"):
            np.testing.assert_allclose(getattr(contacts, name), case[name], rtol=1e-9, atol=1e-9, err_msg=name)


class TestPlanarModel:
    @pytest.mark.parametrize(
        ("friction", "expected"),
        [(0.0, [-6.10762538, 0.0, 0.0, 6.10762538]), (49.849, [-14.11227169, -5.04038319, 0.0, 5.66158298])],
    )
    def test_poles(self, paper, friction, expected):
        a, b = PlanarModel(paper.replace(ball_viscous_friction=friction)).linearize()
        assert a.shape == (4, 4)
        assert b.shape == (4, 1)
        poles = np.linalg.eigvals(a)
        # A double pole at zero is only as exact as the square root of the rounding error.
        np.testing.assert_allclose(np.sort(poles.real), expected, atol=1e-7)
        np.testing.assert_allclose(poles.imag, 0.0, atol=1e-7)

    def test_linearization_is_the_slope_of_the_accelerations(self, paper):
        model = PlanarModel(paper, plane="xz")
        a, b = model.linearize()
        h = 1e-6
        for i in range(2):
            step = np.eye(2)[i] * h
            slope = (model.accelerations(step, [0, 0], 0) - model.accelerations(-step, [0, 0], 0)) / (2 * h)
            np.testing.assert_allclose(a[2:, i], slope, atol=1e-6)
        np.testing.assert_allclose(b[2:, 0], model.accelerations([0, 0], [0, 0], 1.0), rtol=1e-9)
        assert model.energy([0, 0], [0, 0]) == pytest.approx(2.228 * 9.81 * 0.142)


class TestTorqueMaps:
    def test_printed_torques_are_too_large_by_the_known_factors(self, paper):
        def virtual(desired, mapping):
            return wheel_to_virtual_torques(paper, virtual_to_wheel_torques(paper, desired, mapping))

        desired = np.array([0.1, -0.2, 0.3])
        np.testing.assert_allclose(virtual(desired, "consistent"), desired, rtol=1e-12)
        np.testing.assert_allclose(virtual(desired, "as_printed") / desired, [1.68, 1.68, 3.36], rtol=1e-12)

    def test_unknown_mapping(self, paper):
        with pytest.raises(ValueError, match="unknown torque mapping 'x': expected one of consistent, as_"):
            virtual_to_wheel_torques(paper, [0, 0, 0], "x")


class TestControllers:
    @pytest.mark.parametrize("model", ["rigid", "contact", "spatial", "planar"])
    @pytest.mark.parametrize("make", [lambda: Pid(control_dt=0.002), lambda: Lqr(control_dt=0.002)])
    def test_they_balance(self, model, make):
        robot, controller = Ballbot(model=model, sim_dt=0.002), make()
        assert controller.control_dt == 0.002
        robot.reset(State.at_rest(robot.params, tilt=(np.deg2rad(3.0), np.deg2rad(-2.0))))
        for _ in range(2000):
            torques = controller(robot.state)
            assert np.abs(torques).max() <= robot.params.max_wheel_torque
            robot.step(torques)
        assert np.rad2deg(robot.state.tilt) < 0.5

    def test_lqr_reaches_its_setpoint(self):
        robot, regulator = Ballbot(model="spatial", sim_dt=0.002), Lqr(control_dt=0.002)
        for _ in range(4000):
            robot.step(regulator(robot.state, position=(0.2, -0.1), yaw=0.3))
        np.testing.assert_allclose(robot.state.ball_position[:2], [0.2, -0.1], atol=0.01)
        assert robot.state.yaw == pytest.approx(0.3, abs=0.02)
        assert regulator.residual < 1e-9

    def test_a_reset_pid_forgets(self, paper):
        pid, tilted = Pid(control_dt=0.002), State.at_rest(paper, tilt=(0.002, 0.0))
        first = pid(tilted)
        assert not np.array_equal(pid(tilted), first)
        pid.reset()
        np.testing.assert_array_equal(pid(tilted), first)

    def test_max_torque_is_kept(self, paper):
        leaning = State.at_rest(paper, tilt=(0.3, 0.1))
        for controller in (Pid(max_torque=0.05), Lqr(max_torque=0.05)):
            assert np.abs(controller(leaning)).max() == pytest.approx(0.05, rel=1e-12)


def test_a_controller_by_name_equals_the_class(paper):
    leaning = State.at_rest(paper, tilt=(0.01, 0.02))
    np.testing.assert_array_equal(Controller("lqr", tilt=0.2)(leaning), Lqr(tilt=0.2)(leaning))
    np.testing.assert_array_equal(Controller("pid")(leaning), Pid()(leaning))
    assert Controller("pid").control_dt == Pid().control_dt == CONTROLLERS["pid"]["control_dt"] == 0.002
    motion = ["position", "velocity", "acceleration", "jerk", "snap", "yaw", "yaw_rate"]
    assert Controller("lqr").setpoint_parts == motion
    with pytest.raises(ValueError, match="unknown controller 'mpx': expected one of lqr, pid"):
        Controller("mpx")


def test_a_part_of_a_setpoint_that_a_controller_ignores_is_rejected(paper):
    for controller, part in ((Pid(), "position"), (Lqr(), "tilt")):
        with pytest.raises(TypeError, match=f"'{part}', it does not follow that part of a setpoint"):
            controller(State.at_rest(paper), **{part: (0.1, 0.0)})


def test_costs_may_be_given_as_matrices_or_diagonals():
    q, r = np.arange(1.0, 11.0), [2.0, 2.0, 2.0]
    np.testing.assert_array_equal(Lqr(Q=q, R=r).gain, Lqr(Q=np.diag(q), R=np.diag(r)).gain)
    with pytest.raises(TypeError, match="Lqr takes Q or the weight tilt, not both"):
        Lqr(Q=q, tilt=0.1)


def test_the_regulator_accepts_a_delay_and_an_observer_as_by_its_name(paper):
    options = {"delay": 0.02, "lean_observer": 2.0}
    laws = Lqr(paper, tilt=0.2, **options), Controller("lqr", paper, tilt=0.2, **options)
    plain = Lqr(paper, tilt=0.2)
    states = [State.at_rest(paper, tilt=(0.02 * k, -0.01)) for k in range(5)]
    torques = np.array([[law(state) for state in states] for law in (*laws, plain)])
    np.testing.assert_array_equal(torques[0], torques[1])
    assert np.abs(torques[0, 2:] - torques[2, 2:]).max() > 1e-3
    np.testing.assert_array_equal(Lqr(paper, Q=np.ones(10), **options).gain, Lqr(paper, Q=np.ones(10)).gain)
    with pytest.raises(ValueError, match=r"delay = 0\.015 s is not a multiple of control_dt"):
        Lqr(paper, delay=0.015)


def test_the_linear_model_names_what_it_is_in(paper):
    model = LinearModel(paper)
    assert model.A.shape == (len(model.STATES), len(model.STATES)) == (10, 10)
    assert model.B.shape == (len(model.STATES), len(model.INPUTS)) == (10, 3)
    a, b = model.discretize(1e-6)
    np.testing.assert_allclose((a - np.eye(10)) / 1e-6, model.A, atol=1e-3)
    np.testing.assert_allclose(b / 1e-6, model.B, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("name", Params.preset_names())
def test_wheels_that_hold_a_lean_accelerate_the_ball(name):
    model = LinearModel(name)
    leaning = np.eye(10)[3]
    torques = -model.toppling_squared * model.turning_torques[:, 1]
    rates = model.A @ leaning + model.B @ torques
    np.testing.assert_allclose(rates[[5, 8]], [model.acceleration_per_lean, 0.0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(model.B[7:] @ model.turning_torques, np.eye(3), atol=1e-9)


def test_scalar_options_of_environments_are_described():
    options = Batch(1, num_threads=1).options
    kinds = {"float": float, "float | None": float, "int": int, "bool": bool}
    described = {option["name"]: option for option in ENVIRONMENT_OPTIONS}
    assert list(described) == list(options)[: len(described)]
    for name, option in described.items():
        assert type(options[name]) is kinds[option["type"]], name
        assert option["doc"].endswith("."), name
    with pytest.raises(ValueError, match="control_dt = -1 is out of range"):
        Batch(1, control_dt=-1.0)
    with pytest.raises(ValueError, match=r"max_episode_steps = 1.5 .* a whole number"):
        Batch(1, max_episode_steps=1.5)
    with pytest.raises(ValueError, match=r"scale_observations = 2 .* 0 or 1"):
        Batch(1, scale_observations=2)


def test_every_option_that_the_core_has_is_documented():
    for name in option_names("balance"):
        assert f"- `{name}`: " in BalanceEnv.__doc__, name
        assert name in BalanceOptions.__annotations__ or name in CommonOptions.__annotations__


@pytest.mark.parametrize(
    ("call", "closest"),
    [
        (lambda: Params.preset("kugel"), "kugle"),
        (lambda: Params.paper().replace(body_masss=1.0), "body_mass"),
        (lambda: ballbot_rs.BalanceEnv(reward={"positon": 1.0}), "position"),
        (lambda: ballbot_rs.BalanceEnv(actuators={"dealy": 0.01}), "delay"),
        (lambda: ballbot_rs.BalanceEnv(obs_nois=1), None),
    ],
)
def test_an_unknown_name_suggests_the_closest_name(call, closest):
    with pytest.raises((ValueError, TypeError)) as caught:
        call()
    text = str(caught.value)
    assert f"did you mean '{closest}'?" in text if closest else "expected one of robot, model" in text
    restored = pickle.loads(pickle.dumps(caught.value))
    assert str(restored) == text


@pytest.mark.parametrize(
    ("make", "instead"),
    [
        (
            lambda: Batch(2),
            r"Batch objects cannot .* make another with the same arguments, and restore\(i, snapshot\(i\)\)",
        ),
        (Lqr, "Lqr objects cannot .* pass on its name, robot and options"),
        (Pid, "Pid objects cannot .* pass on its name, robot and options"),
        (lambda: Controller("mpc"), "Controller objects cannot .* pass on its name, robot and options"),
        (lambda: Renderer(width=8, height=8), "Renderer objects cannot .* make another with the same arguments"),
        (LinearModel, "LinearModel objects cannot .* make another"),
        (lambda: PlanarModel(Params.paper()), "PlanarModel objects cannot .* make another"),
        (lambda: SpatialModel(Params.paper()), "SpatialModel objects cannot .* make another"),
    ],
)
def test_errors_of_pickling_name_the_alternative(make, instead):
    for copied in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match=instead):
            copied(make())


def test_a_batch_is_restored_from_its_snapshots():
    batch, again = (Batch(2, seed=seed) for seed in (3, 4))
    batch.reset()
    again.reset()
    batch.step(np.full((2, 3), 0.2))
    for i in range(2):
        again.restore(i, batch.snapshot(i))
    for _ in range(3):
        left, right = batch.step(np.zeros((2, 3)))[0], again.step(np.zeros((2, 3)))[0]
        np.testing.assert_array_equal(left, right)
