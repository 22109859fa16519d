"""Networks in Rust with separate weights for each robot: rollouts, and the sums of episodes."""

import itertools

import numpy as np
import pytest

import ballbot_rs as bb

N, STEPS = 19, 60


def layers(widths, n=N):
    """Policies that keep some robots upright longer than others."""
    rng = np.random.default_rng(0)
    return [
        (rng.standard_normal((n, outputs, inputs)) / np.sqrt(inputs), 0.1 * rng.standard_normal((n, outputs)))
        for inputs, outputs in itertools.pairwise(widths)
    ]


def of(policies, robot):
    return [(weights[[robot]], biases[[robot]]) for weights, biases in policies]


def act(policies, observations):
    """The same networks in NumPy."""
    values = observations.astype(float)
    for k, layer in enumerate(policies):
        weights, biases = (numbers.astype(np.float32).astype(float) for numbers in layer)
        values = np.einsum("noi,ni->no", weights, values) + biases
        values = np.tanh(values) if k + 1 < len(policies) else np.clip(values, -1.0, 1.0)
    return values.astype(np.float32)


def batch(n=N, seed=3, model="contact", **options):
    made = bb.Batch(n, seed=seed, model=model, **options)
    made.reset()
    return made


def first_episodes(record, limit):
    """Sums over the first episode of each robot, from a rollout's record."""
    done = record["terminated"] | record["truncated"]
    lengths = np.where(done.any(axis=0), done.argmax(axis=0) + 1, limit)
    robots = np.arange(done.shape[1])
    returns = [sum(record["rewards"][:length, i]) for i, length in enumerate(lengths)]
    names = ("terminated", "truncated", "success")
    return {"returns": returns, "lengths": lengths, **{name: record[name][lengths - 1, robots] for name in names}}


@pytest.mark.parametrize("model", ["contact", "spatial", "rigid"])
@pytest.mark.parametrize("widths", [(16, 3), (16, 32, 3), (16, 5, 7, 3)])
def test_actions_equal_numpy(widths, model):
    policies = layers(widths)
    found = batch(model=model).rollout(policies=policies, steps=STEPS, record=["observations", "actions", "rewards"])
    expected = [act(policies, observations) for observations in found["observations"][:-1]]
    np.testing.assert_allclose(found["actions"], expected, rtol=0, atol=1e-6)
    assert np.ptp(found["actions"]) > 1.0
    stepped = batch(model=model)
    for step, actions in enumerate(found["actions"]):
        observations, rewards, *_ = stepped.step(actions.astype(np.float32))
        np.testing.assert_array_equal(found["observations"][step + 1], observations)
        np.testing.assert_array_equal(found["rewards"][step], rewards)


@pytest.mark.parametrize("options", [{}, {"history": 3}, {"task": "velocity"}, {"model": "spatial"}])
@pytest.mark.parametrize("steps", [None, 15])
def test_episodes_equal_rollouts(options, steps):
    options = {"max_episode_steps": STEPS // 2, "reset_tilt_rate": 1.5, **options}
    widths = (batch(1, **options).observation_len, 8, 3)
    policies = layers(widths)
    record = batch(**options).rollout(
        policies=policies, steps=STEPS, record=["rewards", "terminated", "truncated", "success"]
    )
    found = batch(**options).episodes(policies, steps)
    expected = first_episodes({name: rows[:steps] for name, rows in record.items()}, steps or STEPS)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    if steps is None:
        assert found["terminated"].any()
        assert found["truncated"].any()


@pytest.mark.parametrize("model", ["contact", "planar"])
def test_a_robot_is_independent_of_others_and_of_threads(model):
    n = 8 * 65
    policies = layers((16, 8, 3), n)
    first, second = (batch(n, model=model, num_threads=threads).episodes(policies, 50) for threads in (1, 2))
    for name, values in first.items():
        np.testing.assert_array_equal(second[name], values)
    for robot in (0, 7, 300, n - 1):
        alone = batch(1, seed=3 + robot, model=model).episodes(of(policies, robot), 50)
        for name, values in first.items():
            assert alone[name][0] == values[robot], name


@pytest.mark.parametrize("model", ["contact", "spatial"])
@pytest.mark.parametrize("widths", [(16, 3), (16, 8, 3), (16, 5, 7, 3)])
def test_one_policy_for_all_robots_equals_a_copy_for_each(widths, model):
    shared = [(weights[0], biases[0]) for weights, biases in layers(widths, 1)]
    copies = [(np.broadcast_to(w, (N, *w.shape)), np.broadcast_to(b, (N, *b.shape))) for w, b in shared]
    lists = [(weights.tolist(), biases.tolist()) for weights, biases in shared]
    first, *others = (batch(model=model).episodes(policies, STEPS) for policies in (shared, copies, lists))
    for name, values in first.items():
        for other in others:
            np.testing.assert_array_equal(other[name], values, err_msg=name)
    first, second = (
        batch(model=model).rollout(policies=policies, steps=STEPS, record=["actions"])["actions"]
        for policies in (shared, copies)
    )
    np.testing.assert_array_equal(second, first)


@pytest.mark.parametrize("autoreset", ["same_step", "next_step", "disabled"])
def test_all_robots_can_be_stepped_after_a_reset(autoreset):
    robots = batch(autoreset=autoreset)
    robots.episodes(layers((16, 3)))
    expected = batch(autoreset=autoreset).observations()
    np.testing.assert_array_equal(robots.reset(seeds=list(range(3, 3 + N))), expected)
    robots.step(np.zeros((N, 3)))


def test_episodes_continue():
    policies = layers((16, 3), 8)
    robots, again = batch(8), batch(8)
    robots.rollout(policies=policies, steps=5, record=[])
    parts = [robots.episodes(policies, 4), robots.episodes(policies, 3)]
    record = again.rollout(policies=policies, steps=12, record=["rewards"])["rewards"]
    np.testing.assert_array_equal([part["lengths"][0] for part in parts], [4, 3])
    np.testing.assert_allclose(parts[0]["returns"] + parts[1]["returns"], record[5:].sum(axis=0), rtol=1e-12)


def test_an_episode_that_is_over_is_rejected():
    robots = bb.Batch(2, autoreset="disabled")
    with pytest.raises(ValueError, match=r"the episode of environment 0 is over \(or has not begun\)"):
        robots.episodes(layers((16, 3), 2))


def bad(change):
    weights, biases = layers((16, 3), 2)[0]
    return [change(weights, biases)]


@pytest.mark.parametrize(
    ("policies", "error", "message"),
    [
        ([], ValueError, "policies have no layer, there must be at least 1"),
        (layers((16, 3), 3), ValueError, r"policies\[0\]\[0\] has shape \(3, 3, 16\), expected \(2, n, n\)"),
        (layers((15, 3), 2), ValueError, "an observation of the networks has 15 values, expected 16"),
        (layers((16, 4), 2), ValueError, "outputs of layer 0: 4, expected 3"),
        (layers((16, 0, 3), 2), ValueError, "layer 0 has no outputs"),
        (layers((0, 3), 2), ValueError, "layer 0 has no inputs"),
        ([*layers((16, 5), 2), *layers((4, 3), 2)], ValueError, "inputs of layer 1: 4, expected 5"),
        (bad(lambda w, b: (w * np.nan, b)), ValueError, r"weights of layer 0\[0\] = NaN .* must be finite"),
        (bad(lambda w, b: (w, b * 1e300)), ValueError, r"biases of layer 0\[0\] = .* must be within ±1e9"),
        (bad(lambda w, b: (w, b[:, :2])), ValueError, r"policies\[0\]\[1\] has shape \(2, 2\), expected \(2, 3\)"),
        (bad(lambda w, b: (w[0], b)), ValueError, r"policies\[0\]\[1\] has shape \(2, 3\), expected \(3,\)"),
        (
            [*bad(lambda w, b: (w[0], b[0])), *layers((3, 3), 2)],
            ValueError,
            r"policies\[1\]\[0\] has shape \(2, 3, 3\)",
        ),
        (bad(lambda w, b: (w[0, :2], b[0, :2])), ValueError, "outputs of layer 0: 2, expected 3"),
        (bad(lambda w, _: (w,)), TypeError, r"policies\[0\] must be a pair: weights and biases"),
        (bad(lambda w, _: (w, "no")), TypeError, r"policies\[0\]\[1\] must be an array of numbers"),
    ],
)
def test_invalid_policies_are_rejected(policies, error, message):
    robots = batch(2)
    before = robots.observations()
    for run in (lambda: robots.episodes(policies), lambda: robots.rollout(policies=policies, steps=1)):
        with pytest.raises(error, match=message):
            run()
    np.testing.assert_array_equal(robots.observations(), before)


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"controller": bb.Lqr(control_dt=0.01), "policies": layers((16, 3), 2)},
        {"policies": layers((16, 3), 2), "privileged": True},
        {"policies": layers((16, 3), 2), "setpoints": {"position": (0.0, 0.0)}},
        {"policies": layers((16, 3), 2), "actions": np.zeros((1, 2, 3))},
    ],
)
def test_a_rollout_takes_one_source_of_actions(arguments):
    with pytest.raises(TypeError, match="one of controller, with setpoints and privileged, policies and actions"):
        batch(2).rollout(steps=1, **arguments)


def test_a_rollout_requires_steps():
    with pytest.raises(TypeError, match="requires steps"):
        batch(2).rollout(policies=layers((16, 3), 2))


def test_episodes_of_a_task_with_a_stage_are_rejected():
    from ballbot_rs.envs._batch_env import new_batch

    robots = new_batch(2, options={"reward": {"calm": lambda robots: -np.abs(robots.last_action).sum(1)}})
    robots.reset()
    with pytest.raises(ValueError, match="what Python adds to a task is computed for all robots at once"):
        robots.episodes(layers((16, 3), 2))
    assert robots.rollout(policies=layers((16, 3), 2), steps=3, record=["rewards"])["rewards"].shape == (3, 2)
