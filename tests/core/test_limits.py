"""Numbers that would use all memory or all threads are rejected at once, meaningless numbers by name."""

import threading

import numpy as np
import pytest

import ballbot_rs as bb
from tests.support.names import BALANCE

HUGE = 10**30


@pytest.fixture(scope="module")
def batch():
    batch = bb.Batch(2, "balance", model="contact")
    batch.reset()
    return batch


#: (what is called, exception, what its message must have)
CASES = {
    "environments": (lambda: bb.Batch(10**8), ValueError, "num_envs = 100000000, it must be at most 1048576"),
    "environments, huge": (lambda: bb.Batch(HUGE), ValueError, f"{HUGE} is out of range: it must be within"),
    "vector environment": (lambda: bb.BalanceVectorEnv(10**8), ValueError, "num_envs = 100000000"),
    "threads": (lambda: bb.Batch(2, num_threads=10**6), ValueError, "num_threads = 1000000, it must be at most 256"),
    "threads, negative": (lambda: bb.Batch(2, num_threads=-3), ValueError, "num_threads = -3, it must be at least 1"),
    "seed": (lambda: bb.Batch(2, seed=-1), ValueError, "-1 is out of range: it must be from 0 to 2.64 - 1"),
    "seed, huge": (lambda: bb.Batch(2, seed=2**64), ValueError, "18446744073709551616 is out of range"),
    "renderer's threads": (lambda: bb.Renderer(num_threads=10**6), ValueError, "num_threads = 1000000, .* at most 256"),
    "renderer's threads, negative": (lambda: bb.Renderer(num_threads=-5), ValueError, "num_threads = -5"),
    "width": (lambda: bb.Renderer(width=10**6), ValueError, "width = 1000000 .* 8192"),
    "width, negative": (lambda: bb.Renderer(width=-1), ValueError, "width = -1, it must be at least 1"),
    "width, huge": (lambda: bb.Renderer(width=HUGE), ValueError, f"{HUGE} is out of range"),
    "camera target": (
        lambda: bb.Renderer(camera={"target": [1e300, 0, 1]}),
        ValueError,
        r"target\[0\] = 1e300 .* ±1000000 m",
    ),
    "steps": (lambda: bb.Ballbot().step([0, 0, 0], HUGE), ValueError, f"{HUGE} is out of range"),
    "max_episode_steps": (lambda: bb.BalanceEnv(max_episode_steps=HUGE), ValueError, "max_episode_steps"),
    "torque": (
        lambda: bb.BalanceEnv(max_wheel_torque=5e-324),
        ValueError,
        "max_wheel_torque = 5e-324 .* >= 1e-9 N·m",
    ),
    "endless file": (lambda: bb.Params.from_urdf("/dev/zero", "x"), OSError, "cannot read /dev/zero: .* regular file"),
    # A reward of NaN.
    "setpoint": (
        lambda: bb.BalanceEnv(setpoint=(1e155, 0)),
        ValueError,
        r"setpoint\[0\] = 1e155 .* >= -10000 and <= 10000 m",
    ),
    "success_radius": (lambda: bb.BalanceEnv(success_radius=5e-324), ValueError, "success_radius = 5e-324 .* >= 1e-12"),
    # Overflow in the equations of motion.
    "gain": (lambda: bb.Pid(integral=1e300), ValueError, "integral = 1e300 .* <= 1e9"),
    "filter": (lambda: bb.Pid(filter_coefficient=1e300), ValueError, "filter_coefficient = 1e300 .* <= 1e9"),
    "weight": (lambda: bb.Lqr(position=1e-200), ValueError, "position = 1e-200 .* >= 1e-6"),
    "cost": (lambda: bb.Lqr(Q=np.full(10, 1e200)), ValueError, r"Q\[0, 0\] = 1e200 .* within ±1e15"),
    "slow controller": (lambda: bb.Pid(control_dt=1e9), ValueError, "control_dt = 1000000000 .* <= 1000 s"),
    "state": (lambda: bb.State([1e200, 0, 1]), ValueError, r"ball_position\[0\] = 1e200 .* within ±1e9"),
    "state, rolling": (
        lambda: bb.State.rolling(bb.Params.paper(), [1e10, 0]),
        ValueError,
        r"ball_velocity\[0\] = 10000000000 .* within ±1e9",
    ),
    "velocity": (
        lambda: bb.SpatialModel(bb.Params.paper()).energy([1, 0, 0, 0], [1e200] * 6),
        ValueError,
        r"generalized_velocity\[0\] = 1e200 .* within ±1e9",
    ),
    "planar rate": (lambda: bb.PlanarModel(bb.Params.paper()).energy([0, 0], [1e200, 0]), ValueError, r"q_dot\[0\]"),
    "virtual torque": (lambda: bb.PlanarModel(bb.Params.paper()).yaw_acceleration(1e300), ValueError, "virtual_torque"),
    "discretization": (lambda: bb.LinearModel().discretize(1e6), ValueError, "dt = 1000000 s is too long"),
}


@pytest.mark.parametrize("name", CASES)
def test_sizes_out_of_range_are_rejected(name):
    call, error, message = CASES[name]
    with pytest.raises(error, match=message):
        call()


def test_a_record_that_does_not_fit_into_memory_is_rejected(batch):
    with pytest.raises(
        MemoryError, match=r"the record 'states' of shape \[1099511627777, 2, 32\] needs about .* GB of mem"
    ):
        batch.rollout(bb.Lqr(), 2**40)
    with pytest.raises(MemoryError, match="the record 'states'"):
        batch.rollout(bb.Lqr(), 2**63 - 1)


@pytest.mark.parametrize("index", [-1, 2, 2**64])
@pytest.mark.parametrize("call", ["state", "params", "snapshot", "contacts", "reward_terms", "ending"])
def test_an_index_out_of_range_is_rejected(batch, call, index):
    with pytest.raises(ValueError, match=rf"{index} is out of range: it must be (from 0 to|below) num_envs"):
        getattr(batch, call)(index)


@pytest.mark.parametrize("name", list(bb.Params.paper().to_dict()))
@pytest.mark.parametrize("value", [1e155, 1e300, 1.7e308])
def test_huge_parameters_are_rejected(paper, name, value):
    old = paper.to_dict()[name]
    new = tuple((x or 1.0) * value for x in old) if isinstance(old, tuple) else value
    with pytest.raises(ValueError, match="must be"):
        paper.replace(**{name: new})


@pytest.mark.parametrize(
    "name", ["ball_mass", "ball_radius", "body_mass", "wheel_mass", "wheel_inertia", "wheel_radius", "gravity"]
)
def test_parameters_that_are_almost_zero_are_rejected(paper, name):
    with pytest.raises(ValueError, match=rf"{name} = 1e-300 is out of range: it must be >= 1e-\d+ and <= "):
        paper.replace(**{name: 1e-300})


@pytest.mark.parametrize(
    "extreme",
    [
        {"wheel_radius": 1e-4, "wheel_inertia": 10.0},
        {"body_mass": 1e6, "ball_mass": 1e-6, "ball_inertia": 1e-12},
        {"body_inertia": [1e-18] * 3, "body_com_height": 1e-6},
        {"wheel_zenith": 1e-3},
        {"wheel_zenith": np.pi / 2 - 1e-3},
        {"gravity": 1e6, "body_com_height": 1e3},
    ],
    ids=str,
)
def test_models_of_extreme_robots_are_finite(paper, extreme):
    params = paper.replace(**extreme)
    for plane in ("xz", "yz"):
        for matrix in bb.PlanarModel(params, plane=plane).linearize():
            assert np.isfinite(matrix).all()
    linear = bb.LinearModel(params)
    assert np.isfinite(linear.A).all()
    assert np.isfinite(linear.B).all()


#: Values that are not arrays of real numbers, and their names in the error.
NO_NUMBERS = {
    "text": ([["0.1", "0.2", "0.3"]] * 2, "list of dtype <U3"),
    "bytes": (np.array([[b"1", b"2", b"3"]] * 2), r"ndarray of dtype \|S1"),
    "times": (np.zeros((2, 3), "timedelta64[s]"), r"ndarray of dtype timedelta64\[s\]"),
    "dates": (np.zeros((2, 3), "datetime64[s]"), r"ndarray of dtype datetime64\[s\]"),
    "complex": (np.zeros((2, 3), complex), "ndarray of dtype complex128"),
    "complex list": ([[0j, 0, 0]] * 2, "list of dtype complex128"),
    "objects": (np.zeros((2, 3), object), "ndarray of dtype object"),
    "None": ([[None, 0, 0]] * 2, "list of dtype object"),
    "masked": (np.ma.masked_array(np.zeros((2, 3)), mask=np.eye(2, 3)), "a masked array"),
    "ragged": ([[0, 0, 0], [0]], "list"),
}


@pytest.mark.parametrize("name", NO_NUMBERS)
def test_values_that_are_not_numbers_are_rejected_with_their_type(batch, name):
    value, words = NO_NUMBERS[name]
    with pytest.raises(TypeError, match=f"actions must be an array of numbers, not {words}"):
        batch.step(value)
    with pytest.raises(TypeError, match=f"wheel_torques must be an array of numbers, not {words}"):
        bb.Ballbot(model="spatial").step(value)
    with pytest.raises(TypeError, match=f"ball_position must be an array of numbers, not {words}"):
        bb.State(value)


def test_times_are_not_numbers(paper):
    second = np.timedelta64(1, "s")
    for call in (
        lambda: bb.Ballbot(sim_dt=second),
        lambda: bb.Lqr(control_dt=second),
        lambda: bb.LinearModel().discretize(second),
        lambda: paper.replace(ball_mass=second),
        lambda: bb.State.at_rest(paper, yaw=second),
    ):
        with pytest.raises(TypeError, match="timedelta64"):
            call()


@pytest.mark.parametrize("dtype", ["f2", "f4", "f8", "g", "i1", "u8", ">f8", "?"])
def test_all_real_types_are_accepted(batch, dtype):
    batch.step(np.zeros((2, 3), dtype))
    assert bb.Ballbot(sim_dt=np.float32(0.001)).sim_dt == float(np.float32(0.001))


def test_a_mask_of_numbers_is_rejected(batch):
    with pytest.raises(TypeError, match="reset_mask must be an array of bools, not ndarray of dtype float64"):
        batch.reset(mask=np.ones(2))


def error_of(call):
    """Message of the RuntimeError that a call raises, or None."""
    try:
        call()
    except RuntimeError as error:
        return str(error)
    return None


def busy(target, call):
    """The error of `call` while another thread runs `target`."""
    thread = threading.Thread(target=target)
    thread.start()
    message = None
    while thread.is_alive() and message is None:
        message = error_of(call)
    thread.join()
    return message


def test_a_second_thread_gets_an_error_that_names_the_cause():
    robot = bb.Ballbot(model="spatial")
    message = busy(lambda: robot.step([0, 0, 0], 400_000), lambda: robot.time)
    assert message == (
        "this Ballbot is being used by another thread: give each thread its own, or take turns with a lock"
    )
    batch = bb.Batch(8, "balance", model="spatial")
    batch.reset()
    message = busy(lambda: batch.rollout(bb.Lqr(), 5000, record=()), lambda: batch.step(np.zeros((8, 3))))
    assert message.startswith("this environment is being used by another thread")
    # Neither is left as if it were in use.
    assert robot.time == pytest.approx(400)
    batch.step(np.zeros((8, 3)))


def test_threads_may_share_a_controller():
    lqr = bb.Lqr()
    batches = [bb.Batch(4, "balance", model="spatial", seed=3) for _ in range(2)]
    runs = [None, None]

    def rollout(i):
        batches[i].reset()
        runs[i] = batches[i].rollout(lqr, 500)["states"]

    threads = [threading.Thread(target=rollout, args=(i,)) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (runs[0] == runs[1]).all()


def test_a_state_round_trips_through_python_exactly(paper):
    robot = bb.Ballbot(model="spatial")
    robot.reset(bb.State.at_rest(paper, tilt=(0.05, 0.03), yaw=0.4))
    lqr = bb.Lqr(paper, 0.005)
    for _ in range(200):
        robot.step(lqr(robot.state), 5)
        state = robot.state
        for copy in (bb.State.from_array(state.to_array()), state.replace()):
            assert (copy.to_array() == state.to_array()).all()
    other = bb.Ballbot(model="spatial")
    other.reset(state.replace())
    torques = lqr(state)
    for run in (robot, other):
        run.step(torques, 500)
    assert (robot.state.to_array() == other.state.to_array()).all()


def test_make_vec_rejects_too_many_environments():
    import gymnasium

    with pytest.raises(ValueError, match="num_envs = 100000000"):
        gymnasium.make_vec(BALANCE, 10**8)


def test_a_push_of_another_type_is_rejected():
    with pytest.raises(TypeError, match=r"pushes has 0\.1: expected a Push"):
        bb.simulate("lqr", pushes=[0.1, 0, 0], tilt=(0.05, 0.0))
