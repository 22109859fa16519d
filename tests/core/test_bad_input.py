"""Whatever is wrong with an input, the error has the right class and states what, which value and which limit."""

import gymnasium
import numpy as np
import pytest

from ballbot_rs import (
    BalanceEnv,
    BalanceVectorEnv,
    Ballbot,
    BallbotVectorEnv,
    Batch,
    Lqr,
    Params,
    Pid,
    PlanarModel,
    SpatialModel,
    State,
    rollout,
    simulate,
    virtual_to_wheel_torques,
    wheel_to_virtual_torques,
)
from ballbot_rs.analysis.episodes import compare, evaluate
from tests.support.names import BALANCE

NAN, INF = float("nan"), float("inf")
UPRIGHT = [1, 0, 0, 0]


def robot():
    return Ballbot(model="spatial")


def stepped(action):
    env = BalanceEnv()
    env.reset(seed=0)
    return env.step(action)


#: (what is called, exception, what its message must have)
CASES = {
    # Actions.
    "action NaN": (lambda: stepped([0, NAN, 0]), ValueError, r"actions\[0, 1\] = NaN .* finite"),
    "action inf": (lambda: stepped([0, 0, -INF]), ValueError, r"actions\[0, 2\] = -inf .* finite"),
    "action too short": (lambda: stepped([0, 0]), ValueError, r"shape \(2,\), expected \(3,\) for one robot"),
    "action scalar": (lambda: stepped(0.5), ValueError, "shape"),
    "action 2-D": (lambda: stepped(np.zeros((1, 3))), ValueError, r"shape \(1, 3\), .* BallbotVectorEnv takes"),
    "action text": (lambda: stepped("abc"), TypeError, "actions must be an array of numbers"),
    "action None": (lambda: stepped(None), (TypeError, ValueError), "actions"),
    "action dict": (lambda: stepped({"a": 1}), TypeError, "actions must be an array of numbers"),
    # Torques, pushes, joints.
    "torque NaN": (lambda: robot().step([NAN, 0, 0]), ValueError, r"wheel_torques\[0\] = NaN"),
    "torque too large": (lambda: robot().step([0, 6, 0]), ValueError, r"wheel_torques\[1\] = 6 .* = 5 N·m"),
    "torque shape": (lambda: robot().step([0, 0]), ValueError, r"wheel_torques has shape \(2,\), expected \(3,\)"),
    "steps float": (lambda: robot().step([0, 0, 0], 1.5), TypeError, "integer"),
    "steps negative": (lambda: robot().step([0, 0, 0], -1), ValueError, "steps = -1"),
    "push NaN": (lambda: robot().push([0, NAN, 0]), ValueError, r"impulse\[1\] = NaN"),
    "push point": (lambda: robot().push([0, 0, 0], [0, 0, INF]), ValueError, r"point\[2\] = inf"),
    "push shape": (lambda: robot().push([0, 0]), ValueError, r"impulse has shape \(2,\)"),
    "params of no robot": (lambda: robot().set_params("kugel"), ValueError, "unknown robot preset 'kugel'"),
    "params None": (lambda: robot().set_params(None), TypeError, "robot must be Params"),
    # Robots and states.
    "model": (lambda: Ballbot(model="x"), ValueError, "unknown model 'x': expected one of planar, spatial, contact, r"),
    "robot": (lambda: Ballbot(3), TypeError, "robot must be Params, the name of a preset, the path of a TOML file"),
    "sim_dt zero": (lambda: Ballbot(sim_dt=0.0), ValueError, "sim_dt = 0 .* 0.02"),
    "sim_dt NaN": (lambda: Ballbot(sim_dt=NAN), ValueError, "sim_dt = NaN"),
    "sim_dt large": (lambda: Ballbot(sim_dt=0.05), ValueError, "sim_dt = 0.05 .* 0.02"),
    "tilt shape": (
        lambda: State.at_rest(Params.paper(), [0, 0, 0]),
        ValueError,
        r"tilt has shape \(3,\), expected \(2,\)",
    ),
    "tilt in degrees": (
        lambda: State.at_rest("paper", [0, 10]),
        ValueError,
        r"tilt\[1\] = 10 .* within ±pi rad; did you mean math.radians\(10\)\?",
    ),
    "tilt of a place in degrees": (lambda: robot().place_on_ground(0, 0, tilt=[-5, 0]), ValueError, r"radians\(-5\)"),
    "tilt of a start in degrees": (lambda: simulate("lqr", tilt=(2, 0)), ValueError, r"±pi/2 rad; .*radians\(2\)"),
    "tilt of starts in degrees": (lambda: rollout("lqr", 2, tilt=(0, 3)), ValueError, r"±pi/2 rad; .*radians\(3\)"),
    "a URDF": (lambda: Ballbot("bot.urdf"), ValueError, r"'bot.urdf': URDFs are two, .* Params.from_urdf"),
    "two URDFs": (lambda: simulate("lqr", robot=("a.urdf", "b.urdf")), ValueError, r"write Params.from_urdf"),
    "two URDFs for the core": (lambda: Ballbot(("a.urdf", "b.urdf")), TypeError, r"not tuple; .* Params.from_urdf"),
    "incomplete robot": (
        lambda: Ballbot({"ball_mass": 2.0, "body_mass": 3.0}),
        ValueError,
        r"parameters ball_inertia, ball_radius, body_inertia, .* are missing; to change .*replace\(",
    ),
    "motors of another robot": (
        lambda: simulate("lqr", actuators="kugle"),
        ValueError,
        "at most wheel_inertia / sim_dt = 0.0745 .* of the robot, .* fit the robot with its name",
    ),
    "picture as terrain": (
        lambda: simulate("lqr", terrain="hill.png"),
        ValueError,
        r"=read_terrain\('hill.png', cell=",
    ),
    "function as reward": (
        lambda: BallbotVectorEnv(2, reward=abs),
        TypeError,
        "a Task of your own has its own rewards",
    ),
    "name of a controller for the core": (
        lambda: Batch(2).rollout("lqr", 5),
        TypeError,
        "controller must be a Controller, not 'lqr': make_controller makes",
    ),
    "tilt NaN": (lambda: State.at_rest(Params.paper(), [0, NAN]), ValueError, "NaN"),
    "below the floor": (lambda: robot().reset(State([0, 0, 0])), ValueError, r"ball_position\[2\] = 0 .* = 0.112"),
    "far away": (lambda: robot().reset(State([1e6, 0, 1])), ValueError, "limit 10000 m"),
    "slip": (lambda: robot().reset(State([0, 0, 0.112], [1, 0, 0])), ValueError, "slip"),
    "state missing": (lambda: State(), TypeError, "ball_position"),
    "state NaN": (lambda: State([0, NAN, 0]), ValueError, r"ball_position\[1\] = NaN"),
    "state shape": (lambda: State([0, 0]), ValueError, r"ball_position has shape \(2,\), expected \(3,\)"),
    "state text": (lambda: State("abc"), TypeError, "ball_position must be an array of numbers, not str"),
    "quaternion length": (lambda: State([0, 0, 1], body_quaternion=[1, 1, 0, 0]), ValueError, "1.414.* 1e-6"),
    "quaternion zero": (lambda: State.from_array(np.zeros(32)), ValueError, "quaternion = 0"),
    "quaternion shape": (lambda: State([0, 0, 1], body_quaternion=[1, 0, 0]), ValueError, r"\(3,\), expected \(4,\)"),
    "array shape": (lambda: State.from_array(np.zeros(31)), ValueError, r"\(31,\), expected \(32,\)"),
    "array NaN": (lambda: State.from_array([NAN] * 32), ValueError, "NaN"),
    "unknown field": (lambda: State([0, 0, 1]).replace(x=1), TypeError, "no field x; it has ball_position"),
    # Models and controllers.
    "spatial torque": (
        lambda: SpatialModel(Params.paper()).accelerations(UPRIGHT, [0] * 6, [0, 0, INF]),
        ValueError,
        r"wheel_torques\[2\] = inf",
    ),
    "spatial shape": (
        lambda: SpatialModel(Params.paper()).accelerations(UPRIGHT, [0] * 5, [0] * 3),
        ValueError,
        r"\(5,\), expected \(6,\)",
    ),
    "spatial quaternion": (
        lambda: SpatialModel(Params.paper()).energy([2, 0, 0, 0], [0] * 6),
        ValueError,
        "length of body_quaternion = 2",
    ),
    "planar variant": (lambda: PlanarModel(Params.paper(), "x"), ValueError, "unknown wheel inertia 'x'"),
    "planar plane": (lambda: PlanarModel(Params.paper(), plane="x"), ValueError, "unknown plane 'x'"),
    "planar shape": (lambda: PlanarModel(Params.paper()).energy([0], [0, 0]), ValueError, r"\(1,\), expected \(2,\)"),
    "virtual NaN": (lambda: virtual_to_wheel_torques(Params.paper(), [0, NAN, 0]), ValueError, r"virtual_torques\[1\]"),
    "wheel NaN": (lambda: wheel_to_virtual_torques(Params.paper(), [0, NAN, 0]), ValueError, r"wheel_torques\[1\]"),
    "pid gain": (lambda: Pid(proportional=-1), ValueError, "proportional = -1 .* >= 0"),
    "pid rate": (lambda: Pid(control_dt=0), ValueError, "control_dt = 0 .* > 0"),
    "pid mapping": (lambda: Pid(mapping="x"), ValueError, "unknown torque mapping 'x'"),
    "pid limit": (lambda: Pid(max_torque=0), ValueError, "max_torque = 0"),
    "pid state": (lambda: Pid()(3), TypeError, "State"),
    "lqr weight": (lambda: Lqr(position=0), ValueError, "position = 0 .* >= 1e-6"),
    "lqr name": (
        lambda: Lqr(speed=1),
        TypeError,
        "Lqr got an unexpected keyword argument 'speed': did you mean .max_speed",
    ),
    "lqr rate": (lambda: Lqr(control_dt=NAN), ValueError, "control_dt = NaN"),
    "lqr too slow": (
        lambda: Lqr(control_dt=10.0),
        ValueError,
        r"control_dt = 10 s is too long for a robot that topples",
    ),
    "setpoint NaN": (lambda: Lqr()(State([0, 0, 1]), position=[0, NAN]), ValueError, r"position\[1\] = NaN"),
    # Environments.
    "num_envs zero": (lambda: BalanceVectorEnv(0), ValueError, "num_envs = 0, it must be at least 1"),
    "num_envs negative": (lambda: BalanceVectorEnv(-2), ValueError, "num_envs = -2, it must be at least 1"),
    "num_envs float": (lambda: BalanceVectorEnv(2.0), TypeError, "num_envs = 2.0"),
    "num_envs make_vec": (lambda: gymnasium.make_vec(BALANCE, 0), ValueError, "num_envs = 0"),
    "num_threads zero": (lambda: BalanceVectorEnv(2, num_threads=0), ValueError, "num_threads = 0"),
    "num_threads negative": (lambda: BalanceVectorEnv(2, num_threads=-1), ValueError, "num_threads = -1"),
    "num_threads text": (lambda: BalanceVectorEnv(2, num_threads="2"), TypeError, "num_threads = '2'"),
    "limit zero": (lambda: BalanceEnv(max_episode_steps=0), ValueError, "max_episode_steps = 0"),
    "limit negative": (lambda: BalanceEnv(max_episode_steps=-5), ValueError, "max_episode_steps = -5"),
    "limit float": (lambda: BalanceEnv(max_episode_steps=1.5), TypeError, "max_episode_steps = 1.5"),
    "env model": (lambda: BalanceEnv(model="x"), ValueError, "unknown model 'x'"),
    "env unknown option": (
        lambda: BalanceEnv(sim_tim=1),
        TypeError,
        "BalanceEnv got an unexpected keyword argument 'sim_tim': did you mean 'sim_dt'",
    ),
    "vec unknown option": (
        lambda: BalanceVectorEnv(2, sim_tim=1),
        TypeError,
        "BalanceVectorEnv got an unexpected keyword argument 'sim_tim'",
    ),
    "env positional": (lambda: BalanceEnv("rigid"), TypeError, "positional"),
    "control_dt uneven": (lambda: BalanceEnv(control_dt=0.0033), ValueError, "1.65 .* whole number.*0.0033.*0.002"),
    "control_dt zero": (lambda: BalanceEnv(control_dt=0), ValueError, "control_dt = 0"),
    "control_dt short": (lambda: BalanceEnv(control_dt=0.001), ValueError, "control_dt / sim_dt = 0.5"),
    "control_dt text": (lambda: BalanceEnv(control_dt="fast"), TypeError, "str"),
    "torque beyond motor": (lambda: BalanceEnv(max_wheel_torque=6), ValueError, "max_wheel_torque = 6 .* 5 N·m"),
    "reset tilt": (lambda: BalanceEnv(reset_tilt=0.5), ValueError, "reset_tilt = 0.5 .* fall_tilt = 0.349"),
    "setpoint shape": (lambda: BalanceEnv(setpoint=[1]), ValueError, "setpoint has 1 values, expected 2"),
    "reward name": (
        lambda: BalanceEnv(reward={"bonus": 1}),
        ValueError,
        "unknown reward term 'bonus': expected one of alive",
    ),
    "reward NaN": (lambda: BalanceEnv(reward={"tilt": NAN}), ValueError, "reward.* = NaN"),
    "reward type": (lambda: BalanceEnv(reward=1.0), TypeError, "dict"),
    "seed negative": (lambda: BalanceEnv().reset(seed=-1), ValueError, "seed = -1 .* from 0"),
    "seed huge": (lambda: BalanceEnv().reset(seed=2**64), ValueError, "seed = 18446744073709551616"),
    "seed float": (lambda: BalanceEnv().reset(seed=1.5), TypeError, "seed = 1.5 is not a whole number"),
    "seed text": (lambda: BalanceEnv().reset(seed="1"), TypeError, "seed = '1'"),
    "vec seed negative": (lambda: BalanceVectorEnv(2).reset(seed=[1, -1]), ValueError, "seed = -1"),
    "vec seed list": (lambda: BalanceVectorEnv(2).reset(seed=[1]), ValueError, "1 entries, expected num_envs = 2"),
    "vec seed constructor": (lambda: BalanceVectorEnv(2, seed=-1), ValueError, "seed = -1"),
    "vec mask": (
        lambda: BalanceVectorEnv(2).reset(options={"reset_mask": np.ones(3, bool)}),
        ValueError,
        r"\(3,\), expected \(2,\)",
    ),
    "vec mask type": (
        lambda: BalanceVectorEnv(2).reset(options={"reset_mask": np.ones(2)}),
        TypeError,
        "float64, expected bool",
    ),
    "vec mask list": (
        lambda: BalanceVectorEnv(2).reset(options={"reset_mask": [True, False]}),
        TypeError,
        "of type list, expected a NumPy array",
    ),
    "vec mask empty": (
        lambda: BalanceVectorEnv(2).reset(options={"reset_mask": np.zeros(2, bool)}),
        ValueError,
        "nothing to reset",
    ),
    "make num_envs": (
        lambda: gymnasium.make(BALANCE, num_envs=4),
        TypeError,
        "unexpected keyword argument 'num_envs': .* gymnasium.make_vec",
    ),
    "make num_threads": (lambda: gymnasium.make(BALANCE, num_threads=4), TypeError, "use gymnasium.make_vec"),
    "make autoreset": (lambda: gymnasium.make(BALANCE, autoreset_mode="x"), TypeError, "use gymnasium.make_vec"),
    "frameskip": (
        lambda: gymnasium.make(BALANCE, frameskip=1),
        TypeError,
        "got an unexpected keyword argument 'frameskip'",
    ),
    "vec task": (lambda: BallbotVectorEnv(2, task="walk"), ValueError, "unknown task 'walk'"),
    "vec states": (
        lambda: BalanceVectorEnv(2).reset(options={"states": [None]}),
        ValueError,
        "1 entries, expected num_envs = 2",
    ),
    "options": (lambda: BalanceEnv().reset(options=3), TypeError, "options is of type int, expected a dict"),
    # The core finds the closest name; nothing else is added.
    "model name, alike": (lambda: BalanceEnv(model="contct"), ValueError, r"rigid; did you mean 'contact'\?$"),
    "vec option": (lambda: BalanceVectorEnv(2).reset(options={"mask": 1}), ValueError, "unknown reset option 'mask'"),
    "env name": (lambda: gymnasium.make("ballbot/Walk-v0"), gymnasium.error.NameNotFound, "Walk"),
    "env version": (lambda: gymnasium.make("ballbot/Balance-v9"), gymnasium.error.VersionNotFound, "v9"),
    # Evaluation.
    "evaluate env": (lambda: evaluate("zero", task="x"), ValueError, "unknown task 'x'"),
    "evaluate episodes": (lambda: evaluate("zero", episodes=0), ValueError, "episodes = 0"),
    "evaluate seed": (lambda: evaluate("zero", episodes=1, seed=-1), ValueError, "seed = -1"),
    "compare name": (lambda: compare("lqr"), TypeError, r"controllers must be a list: \['lqr'\]"),
    "evaluate name": (lambda: evaluate("lpr"), FileNotFoundError, "no policy at lpr: .*did you mean 'lqr'"),
    "evaluate object": (lambda: evaluate(3), TypeError, "3 is not a controller"),
    "evaluate option": (
        lambda: evaluate("zero", episodes=1, x=1),
        TypeError,
        "unexpected keyword argument 'x'",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_bad_input_is_rejected(name):
    call, error, message = CASES[name]
    with pytest.raises(error, match=message):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda: SpatialModel(Params.paper()).accelerations(UPRIGHT, [0, 0, 0, 0, 0, NAN], [0, 0, 0]),
        lambda: SpatialModel(Params.paper()).energy(UPRIGHT, [0, 0, 0, INF, 0, 0]),
        lambda: PlanarModel(Params.paper()).accelerations([NAN, 0], [0, 0], 0),
        lambda: PlanarModel(Params.paper()).accelerations([0, 0], [0, 0], NAN),
        lambda: PlanarModel(Params.paper()).energy([0, NAN], [0, 0]),
        lambda: PlanarModel(Params.paper()).yaw_acceleration(INF),
    ],
)
def test_closed_form_models_reject_numbers_that_are_not_finite(call):
    with pytest.raises(ValueError, match="finite"):
        call()


def test_a_robot_too_fast_for_its_wheels_is_rejected(paper):
    with pytest.raises(ValueError, match="first wheel or ball rate"):
        BalanceVectorEnv(20, robot=paper.replace(wheel_radius=1e-6)).reset(seed=0)


PARAMETERS = [
    ({"ball_mass": -1.0}, "ball_mass = -1 .* >= 1e-6 and <= 1e6 kg"),
    ({"body_mass": 0.0}, "body_mass = 0 .* >= 1e-6 and <= 1e6 kg"),
    ({"wheel_mass": -0.1}, "wheel_mass = -0.1"),
    ({"wheel_mass": 1.0}, "wheel_mass = 1 .* third of body_mass = 2.228"),
    ({"ball_radius": 0.0}, "ball_radius = 0 .* >= 1e-6 and <= 1000 m"),
    ({"wheel_radius": 0.0}, "wheel_radius = 0 .* >= 1e-6 and <= 1000 m"),
    ({"ball_inertia": 1.0}, "ball_inertia = 1 .* thin shell"),
    ({"body_inertia": [1.0, 2.0, 4.0]}, r"body_inertia\[2\] = 4 .* 3, .*triangle inequality"),
    ({"body_inertia": [-0.1, 0.1, 0.1]}, r"body_inertia\[0\] = -0.1 .* >= 1e-18 and <= 1e9 kg·m²"),
    ({"body_inertia": [0.1, 0.1]}, "body_inertia has 2 values, expected 3"),
    ({"body_com_height": -0.1}, "body_com_height = -0.1"),
    ({"wheel_zenith": 1.6}, "wheel_zenith = 1.6 .* <= 1.569.* rad"),
    ({"wheel_azimuths": [0.0, 0.1, 3.0]}, "the load of wheel 1 in equilibrium = -.* pass between the wheels"),
    ({"wheel_azimuths": [0.0, 0.0, 3.0]}, "volume spanned by the axles of the wheels = 0 .* every axis"),
    ({"wheel_zenith_offsets": [0.0, 0.8, 0.0]}, r"wheel_zenith \+ wheel_zenith_offsets\[1\] = 1.58.* <= 1.56"),
    ({"wheel_zenith_offsets": [0.1, 0.1]}, "wheel_zenith_offsets has 2 values, expected 3"),
    ({"body_com_offset": [-0.1, 0.0]}, "the load of wheel 0 in equilibrium = -.* N"),
    ({"body_com_offset": [0.0, 0.0, 0.1]}, "body_com_offset has 3 values, expected 2"),
    ({"body_com_offset": [0.0, NAN]}, r"body_com_offset\[1\] = NaN"),
    ({"body_products_of_inertia": [0.06, 0.0, 0.0]}, r"principal moments .*\[0\] = -0.0016999.* > 0"),
    ({"body_products_of_inertia": [0.03, 0.0, 0.0]}, r"principal moments .*\[2\] = 0.088.*triangle inequality"),
    ({"gravity": 0.0}, "gravity = 0"),
    ({"gravity": NAN}, "gravity = NaN"),
    ({"roller_ripple": -1e-4}, "roller_ripple = -0.0001 .* >= 0"),
    ({"roller_ripple": 2e-3}, "roller_ripple = 0.002 .* at most 0.0017.* the ripple of straight rollers"),
    ({"roller_count": 12.5}, "roller_count = 12.5 .* a whole number"),
    ({"floor_tilt": [0.0, 0.6]}, r"floor_tilt\[1\] = 0.6 .*<= 0.5"),
    ({"floor_tilt": [0.4, 0.4]}, "floor_tilt.* = 0.56.* at most 0.5 rad"),
    ({"floor_tilt": 0.1}, "floor_tilt has 1 values, expected 2"),
    ({"floor_patch_friction": [1.0, 0.5]}, r"floor_patch_friction\[0\] = 1 .* at most floor_patch_friction\[1\] = 0.5"),
    ({"floor_patch_size": 1e-4}, "floor_patch_size = 0.0001 .* 0, or at least 1e-3 m"),
    ({"floor_tilt": [0.3, 0.0], "floor_tilt_amplitude": [-0.3, 0.0]}, "floor_tilt.* = 0.6 .* at most 0.5 rad"),
    (
        {"floor_tilt_amplitude": [0.1, 0.0], "floor_tilt_period": 0.5},
        "floor_tilt_amplitude .* neglect this acceleration",
    ),
    ({"ball_mass": INF}, "ball_mass = inf"),
    ({"max_wheel_torque": -5.0}, "max_wheel_torque = -5"),
    ({"wheel_viscous_friction": -1.0}, "wheel_viscous_friction = -1 .* >= 0"),
    ({"floor_static_friction": 0.5}, "floor_static_friction = 0.5 .* 1.05"),
    ({"ball_mass": [1.0, 2.0]}, "ball_mass has 2 values, expected 1"),
]


@pytest.mark.parametrize(("changes", "message"), PARAMETERS, ids=lambda v: next(iter(v)) if isinstance(v, dict) else "")
def test_impossible_parameters_are_rejected(paper, changes, message):
    with pytest.raises(ValueError, match=message):
        paper.replace(**changes)
    with pytest.raises(ValueError, match=message):
        Params(**{**paper.to_dict(), **changes})


def test_a_parameter_that_is_not_a_number_is_rejected(paper):
    with pytest.raises(TypeError, match="ball_mass must be an array of numbers, not str"):
        paper.replace(ball_mass="heavy")
