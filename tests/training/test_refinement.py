"""The evolution after a fit: what it changes, what it tries, and that it improves."""

import copy
import dataclasses
import json

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

import ballbot_rs as bb
from ballbot_rs._state_rows import BALL_VELOCITY
from ballbot_rs.envs.family import sample_robots
from ballbot_rs.training import config, refinement, teacher, tied
from ballbot_rs.training.refinement import AZIMUTHS, FRACTIONS, Space, Trials, objective
from ballbot_rs.training.symmetry import kinds, symmetries
from tests.training.test_symmetry import asymmetry
from tests.training.test_teacher import FIT, new_model

ONE = {"family": 1, "seed": 0}
ROBOT = sample_robots(1, 0)[0]
SETTINGS = config.Refinement([ONE], generations=2, population=4)
WHOLE = config.TrainConfig(symmetric=True, teacher=FIT, refinement=SETTINGS, env={"max_episode_steps": 300})


@pytest.fixture(scope="module")
def fitted():
    """A tied policy fitted to LQR, with its ties."""
    # A robot of the family has a preferred side, two have none on average.
    model = new_model(net_arch=(12, 12), robot={"family": 2, "seed": 0})
    ties = tied.tie(model, True, pytest.fail)
    fit = dataclasses.replace(FIT, drawn=True)
    teacher.fit_actor(model, teacher.laws_of(model, fit)[0], fit, 0, ties)
    return model, ties


@pytest.fixture(scope="module")
def trials():
    found = Trials(WHOLE, SETTINGS, seed=0)
    found.measure(law())
    return found


#: Of robots that topple slowly.
SLOW = {"gyration radius / body_com_height": [2.0, 3.0]}


def law():
    return bb.Lqr(ROBOT)


def network_of(model):
    layers = [*tied.linear_layers(model.policy.mlp_extractor.policy_net), model.policy.action_net]
    return [(layer.weight.detach().double().numpy(), layer.bias.detach().double().numpy()) for layer in layers]


def test_rows_that_turn_into_each_other_are_of_a_kind():
    rows = ("body rate about body x", "body rate about body y", "body rate about body z")
    wheels = tuple(f"wheel speed {wheel}" for wheel in range(3))
    np.testing.assert_array_equal(kinds(symmetries(rows + wheels, 2)), [0, 0, 1, 2, 2, 2, 3, 3, 4, 5, 5, 5])


def test_all_numbers_make_symmetric_policies_and_zero_the_fit(fitted):
    model, ties = fitted
    space = Space(network_of(model), ties, 1)
    # Of the last layer, of the units, of the kinds of rows and of the age.
    assert space.size == 2 * 3 + 2 + 2 + 8 + 1
    for (weights, biases), (w, b) in zip(space.network(np.zeros(space.size)), network_of(model), strict=True):
        np.testing.assert_allclose(weights, w, atol=1e-7)
        np.testing.assert_array_equal(biases, b)
    numbers = np.random.default_rng(0).normal(0.0, 0.3, space.size)
    other = new_model(net_arch=(12, 12))
    for layer, (weights, biases) in zip(
        [*tied.linear_layers(other.policy.mlp_extractor.policy_net), other.policy.action_net],
        space.network(numbers),
        strict=True,
    ):
        layer.weight.data[:] = tied._tensor(weights)
        layer.bias.data[:] = tied._tensor(biases)
    assert asymmetry(other) < 1e-6
    for (weights, _), (w, _) in zip(space.network(numbers), network_of(model), strict=True):
        assert np.abs(weights - w).max() > 0.01


def test_the_starts_are_fractions_of_what_the_law_recovers_from(trials):
    """At the fractions the law recovers; a tenth beyond its limits it does not."""
    found = trials._limits(law(), np.array([[0.6], [60.0]]))
    grid = np.concatenate([found[..., None] * FRACTIONS[:-1], 1.1 * found[..., None]], axis=-1)

    def fallen(batch, steps):
        terminated = [batch.step(batch.control(law(), privileged=True, drawn=True))[2] for _ in range(steps)]
        return np.any(terminated, axis=0)

    recovered = trials._upright(*trials._tilts_and_pushes(grid), fallen)
    assert recovered.shape == (2, 1, len(FRACTIONS), len(AZIMUTHS))
    assert recovered[:, :, :-1].all()
    assert not recovered[:, :, -1].all(axis=-1).any()


def test_a_policy_that_does_nothing_recovers_from_nothing(trials, fitted):
    network = [(0.0 * weights, biases) for weights, biases in network_of(fitted[0])]
    parts = trials.parts(network)
    assert set(parts.values()) == {0.0}
    assert objective(parts) == 0.0


def test_parts_repeat(trials, fitted):
    network = network_of(fitted[0])
    parts = trials.parts(network)
    assert parts == trials.parts(network)
    assert all(0.0 <= value <= 1.0 for value in parts.values())
    # The fit had small tilts only.
    assert parts["upright"] == 1.0
    assert parts["tilt limit"] >= FRACTIONS[0]


class Rolling:
    """Eight episodes of a robot whose ball rolls at one speed, and falls in the last fifth of the first of them."""

    num_envs, max_episode_steps = 8, 300

    def __init__(self, speed):
        self.speed, self.steps = speed, []

    def reset(self, seeds):
        assert len(seeds) == 8

    def episodes(self, network, steps):  # noqa: ARG002
        self.steps.append(steps)
        never = np.zeros(8, dtype=bool)
        return {"terminated": np.arange(8) < (len(self.steps) == 3), "truncated": never, "success": ~never}

    def states(self):
        states = np.zeros((8, 32))
        states[:, BALL_VELOCITY] = (0.6 * self.speed, 0.8 * self.speed, 0.0)
        return states


@pytest.mark.parametrize(("factor", "still"), [(0.0, 1.0), (1.0, 0.5), (3.0, 0.25)])
def test_a_ball_that_rolls_at_the_end_is_less_at_rest(trials, factor, still):
    batch = Rolling(factor * 0.008 * ROBOT.scale("m/s"))
    ended = trials._ended(batch, [])
    assert sum(batch.steps) == 300
    assert batch.steps[0] == 240
    np.testing.assert_allclose(ended["at rest"], 7 / 8 * still)
    assert ended["upright"] == ended["in place"] == 7 / 8


def test_kinds_of_episodes_count_by_their_weights(fitted):
    # Robots that are upright succeed in the first kind; in the second nobody is upright enough.
    easy, hard = ({"reset_tilt": 0.02, "success_radius": 10.0, "success_tilt": tilt} for tilt in (0.3, 1e-6))
    for weight in (1.0, 3.0):
        settings = dataclasses.replace(SETTINGS, episodes=[easy, {**hard, "weight": weight}])
        weighted = Trials(WHOLE, settings, seed=0)
        weighted.measure(law())
        parts = weighted.parts(network_of(fitted[0]))
        assert parts["upright"] == 1.0
        assert parts["in place"] == pytest.approx(1.0 / (1.0 + weight))


def test_the_hardest_robots_are_kept_with_their_starts(fitted):
    model, _ = fitted
    network = network_of(model)
    settings = dataclasses.replace(SETTINGS, robots=[{"family": 5, "seed": 3}])
    whole, kept = (Trials(WHOLE, one, seed=0) for one in (settings, dataclasses.replace(settings, hardest=2, others=1)))
    for one in (whole, kept):
        one.measure(law())
    of_each = objective(whole._measured(network))
    assert kept.on_all(network) == whole.on_all(network) == whole.parts(network)
    kept.begin(0)
    hardest = set(np.argsort(of_each, kind="stable")[:2].tolist())
    expected = sorted(hardest | {min(set(range(5)) - hardest)})
    assert [robot.body_mass for robot in kept._robots] == [whole._robots[i].body_mass for i in expected]
    np.testing.assert_array_equal(objective(kept._measured(network)), of_each[expected])
    assert len(set(of_each.tolist())) > 1


def test_each_generation_has_other_starts_noise_and_robots_and_repeats(fitted):
    network = network_of(fitted[0])
    settings = dataclasses.replace(SETTINGS, robots=[{"family": 7, "seed": 3}], hardest=2, others=2)
    found = Trials(WHOLE, settings, seed=0)
    found.measure(law())
    found.on_all(network)

    def begun(generation):
        found.begin(generation)
        return found._robots, found._azimuths, found._fractions, found._seeds

    robots, azimuths, fractions, seeds = zip(*(begun(generation) for generation in range(4)), strict=True)
    masses = [{robot.body_mass for robot in one} for one in robots]
    assert [len(one) for one in masses] == [4] * 4
    # The hardest in all of them, and of the others all come.
    assert len(set.intersection(*masses)) == 2
    assert len(set.union(*masses)) == 7
    assert len(np.unique(seeds)) == 4 * len(seeds[0])
    np.testing.assert_array_equal(fractions[0], FRACTIONS)
    for one, azimuth in zip(fractions[1:], azimuths[1:], strict=True):
        assert (one < FRACTIONS).all()
        assert (one[1:] > FRACTIONS[:-1]).all()
        np.testing.assert_array_equal(azimuth[:, :2], azimuths[0][:, :2])
        assert (azimuth[:, 2:] != azimuths[0][:, 2:]).all()
    found.begin(2)
    parts = found.parts(network)
    found.begin(0)
    assert found.parts(network) != parts
    found.begin(2)
    assert found.parts(network) == parts


def test_evolution_improves_on_the_fit(fitted):
    model, ties = fitted
    settings = dataclasses.replace(
        SETTINGS, robots=[{"family": 3, "seed": 0}], hardest=2, others=1, generations=7, population=8
    )
    # Too weak: it falls from starts from which the fit recovers.
    for parameter in model.policy.action_net.parameters():
        parameter.data *= 0.7
    trials, told = Trials(WHOLE, settings, seed=0), []
    trials.measure(law())
    refinement.refine(model, trials, ties, 0, told.append)
    values = {text.split(": ")[0]: float(text.split(": ")[1].split(",")[0]) for text in told}
    average = "the average of the last half of the generations"
    assert list(values) == ["the fit", "refined for 4 generations", average]
    assert values[average] > values["the fit"]
    *hidden, last = network_of(model)
    tried = [*hidden, tuple(numbers / refinement.MARGIN for numbers in last)]
    assert objective(trials.on_all(tried)) == pytest.approx(values[average], abs=2e-2)
    assert asymmetry(model) < 1e-6


def test_an_interrupted_evolution_continues_with_the_same_robots(fitted, tmp_path, monkeypatch):
    """The robots on which the mean does worst are chosen every four generations."""
    model, ties = fitted
    before = copy.deepcopy(model.policy.state_dict())
    settings = dataclasses.replace(SETTINGS, robots=[{"family": 5, "seed": 3}], hardest=2, others=1, generations=10)
    record = tmp_path / "objective.json"
    begun = []

    def measured(self, network):
        numbers = 1e3 * network[-1][0].ravel()
        hardness = np.sin([numbers @ np.arange(numbers.size) * robot.body_mass for robot in self._robots])
        begun.append([robot.body_mass for robot in self._robots])
        return dict.fromkeys(refinement._WEIGHTS, 0.5 + 0.5 * hardness)

    monkeypatch.setattr(Trials, "_measured", measured)
    first, of_all = None, []
    for kept in (0, 3, 4, 7, 8, 9, 10):
        model.policy.load_state_dict(before)
        if kept > 0:
            record.write_text(json.dumps(json.loads(record.read_text())[:kept]))
        trials = Trials(WHOLE, settings, seed=0)
        trials.measure(law())
        begun.clear()
        refinement.refine(model, trials, ties, 0, lambda _: None, record)
        tried = [robots for robots in begun if len(robots) == 3]
        found = (record.read_text(), [layer.tolist() for pair in network_of(model) for layer in pair])
        if first is None:
            first, of_all = found, tried
            assert len({tuple(robots) for robots in tried}) > 3
        assert found == first
        assert tried == of_all[kept * settings.population :]


def test_robots_have_their_own_azimuths(fitted):
    settings = dataclasses.replace(SETTINGS, robots=[{"family": 5, "seed": 3}], hardest=2)
    whole = Trials(WHOLE, settings, seed=0)
    whole.measure(law())
    before = whole._azimuths
    np.testing.assert_array_equal(before[:, :-1], np.tile(AZIMUTHS[:-1], (5, 1)))
    assert len(np.unique(np.round(before[:, -1] % (2.0 * np.pi), 6))) == 5
    impulses = whole._impulses.reshape(5, 2, len(FRACTIONS), len(AZIMUTHS), 3)[:, 1]
    np.testing.assert_allclose(np.exp(1j * before), np.exp(1j * np.arctan2(impulses[..., 1], impulses[..., 0]))[:, 0])
    whole.on_all(network_of(fitted[0]))
    whole.begin(0)
    assert len(whole._azimuths) == 2
    assert {tuple(row) for row in whole._azimuths} < {tuple(row) for row in before}


def test_trials_last_longer_for_slow_robots_and_as_long_whatever_the_control_step():
    settings = dataclasses.replace(SETTINGS, robots=[{"family": 6}, {"family": 6, "ranges": SLOW}])
    faster = dataclasses.replace(WHOLE, env={**WHOLE.env, "control_dt": 0.002})
    for config_, per_second in ((WHOLE, 100), (faster, 500)):
        found = Trials(config_, settings, seed=0)
        places = np.concatenate([one.places for one in found._starts])
        np.testing.assert_array_equal(np.sort(places), np.arange(12 * 48))
        for batch, places, steps in found._starts:
            slow = {found._robots[place // 48].scale("s") > 1.7 for place in places}
            assert len(slow) == 1
            assert steps == per_second * (6.5 if slow.pop() else 2.6)
            assert batch.num_envs == len(places)
        assert len(found._starts) == 2


def test_what_no_robot_limits_counts_as_reached(fitted, monkeypatch):
    """The law withstands no push: the objective is a number, and the fit is compared with the average."""
    monkeypatch.setattr(refinement, "_LEAST_PUSH", 1e6)
    found = Trials(WHOLE, SETTINGS, seed=0)
    found.measure(law())
    parts = found.parts(network_of(fitted[0]))
    assert (parts["push limit"], parts["push starts"]) == (1.0, 1.0)
    assert np.isfinite(objective(parts))


def test_robots_that_no_law_can_be_tried_on_are_named():
    heavy = {"family": 1, "ranges": {"body_mass": [1e4, 1e4]}}
    with pytest.raises(ValueError, match=r"refinement\.robots: impulse\[0\] = "):
        Trials(WHOLE, dataclasses.replace(SETTINGS, robots=[heavy]), seed=0).measure(law())


def test_a_policy_without_hidden_layers_or_with_another_activation_is_rejected():
    for policy in ({"net_arch": {"vf": [8]}}, {"net_arch": [6], "activation_fn": torch.nn.ReLU}):
        model = PPO("MlpPolicy", bb.BallbotVecEnv(8), n_steps=8, batch_size=16, policy_kwargs=policy)
        with pytest.raises(ValueError, match=r"\[refinement\]: the policy needs hidden layers with tanh"):
            refinement.network_of(model)


def test_a_fit_stays_if_evolution_does_worse(fitted, monkeypatch):
    model, ties = fitted
    before = network_of(model)
    values = iter(range(100, 0, -1))
    monkeypatch.setattr(refinement, "objective", lambda _: next(values))
    found = Trials(WHOLE, SETTINGS, seed=0)
    found.measure(law())
    refinement.refine(model, found, ties, 0, lambda _: None)
    for (weights, _), (kept, _) in zip(before, network_of(model), strict=True):
        np.testing.assert_array_equal(weights, kept)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"env_id": "ballbot/Goal-v0"}, r"\[refinement\]: env_id = 'ballbot/Goal-v0': expected PPO of balance"),
        ({"symmetric": "auto"}, r"\[refinement\]: symmetric = 'auto': expected"),
        ({"policy": {"net_arch": []}}, r"\[refinement\]: policy\.net_arch = \[\]: expected"),
        ({"teacher": None}, r"\[refinement\]: there is no \[teacher\]: expected"),
        ({"refinement": config.Refinement([ONE, {"family": 2, "seeds": 1}])}, r"refinement\.robots\[1\]: .*'seeds'"),
        (
            {"refinement": config.Refinement([ONE], episodes=[{}, {"reset_tlt": 1.0}])},
            r"refinement\.episodes\[1\]: .*tlt",
        ),
        ({"refinement": config.Refinement([{"family": {}}])}, r"refinement\.robots\[0\]: robot\.family = {}"),
        (
            {"refinement": config.Refinement([{"family": 10_001}])},
            r"refinement\.robots\[0\]: robot\.family = 10001 is out of range: it must be at most 10000",
        ),
        ({"policy": {"net_arch": {"vf": [8]}}}, r"policy\.net_arch = "),
        (
            {"refinement": config.Refinement([ONE], episodes=[{"history": 3}])},
            "has 48 rows, expected 16",
        ),
        (
            {"refinement": config.Refinement([ONE, ONE], hardest=2, others=1)},
            r"refinement\.hardest = 2 and refinement\.others = 1 are more than the 2 robots",
        ),
    ],
)
def test_what_cannot_be_refined_is_named_before_the_fit(changes, message):
    whole = dataclasses.replace(WHOLE, **changes)
    with pytest.raises(ValueError, match=message):
        Trials(whole, whole.refinement, seed=0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"robots": []}, r"refinement\.robots = \[\] must be a list of families"),
        ({"robots": [{"seed": 1}]}, r"refinement\.robots = .* must be a list of families"),
        ({"robots": [ONE], "episodes": [{"robot": "paper"}]}, r"it has no robot, refinement\.robots names them"),
        ({"robots": [ONE], "episodes": []}, r"refinement\.episodes = \[\] must be a list of tables"),
        ({"robots": [ONE], "episodes": [{}, {"weight": 0}]}, r"refinement\.episodes\[1\]\.weight = 0 is out of range"),
        ({"robots": [ONE], "generations": 0}, r"refinement\.generations = 0 is out of range"),
        ({"robots": [ONE], "hardest": 0}, r"refinement\.hardest = 0 is out of range"),
        ({"robots": [ONE], "hardest": 1, "others": -1}, r"refinement\.others = -1 is out of range"),
        ({"robots": [ONE], "others": 1}, r"refinement\.others = 1: without refinement\.hardest all robots are kept"),
        ({"robots": [ONE], "population": 3}, r"refinement\.population = 3 is out of range"),
        ({"robots": [ONE], "sigma": 2.0}, r"refinement\.sigma = 2\.0 is out of range"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        config.Refinement(**settings)


def test_a_table_without_robots_is_rejected():
    with pytest.raises(ValueError, match=r"mine\.toml: \[refinement\]: it has no robots"):
        config.parse("[refinement]\nsigma = 0.1\n", "mine.toml")
