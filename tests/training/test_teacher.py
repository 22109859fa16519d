"""The fit to a classical controller before PPO: what it reaches, what it leaves unchanged, and what is rejected."""

import dataclasses
import shutil
import tempfile

import numpy as np
import pytest
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor

import ballbot_rs as bb
from ballbot_rs.cli import main
from ballbot_rs.envs.own import registry
from ballbot_rs.training import config, teacher, teacher_errors, train
from ballbot_rs.training.seeds import first_seed
from ballbot_rs.training.teacher_rounds import rounds
from tests.support.killed_training import weights
from tests.support.names import BALANCE
from tests.support.tiny_config import TINY_CONFIG

TAUGHT = f"""\
{TINY_CONFIG}
[teacher]
controller = "lqr"
rounds = 2
steps = 20
value_rollouts = 1
"""

#: Enough for a network of this size to balance.
FIT = config.Teacher("lqr", rounds=6, steps=60, epochs=30, batch_size=256, learning_rate=1e-2)


def new_model(task="balance", seed=0, net_arch=(16,), **options):
    env = bb.BallbotVecEnv(32, task=task, model="spatial", num_threads=1, seed=seed, **options)
    policy = {"net_arch": list(net_arch)}
    return PPO("MlpPolicy", VecMonitor(env), n_steps=16, batch_size=256, policy_kwargs=policy, seed=seed)


def values(modules):
    return [parameter.detach().clone() for module in modules for parameter in module.parameters()]


def of_actor(model):
    policy = model.policy
    return [*values([policy.mlp_extractor.policy_net, policy.action_net]), policy.log_std.detach().clone()]


def of_value(model):
    return values([model.policy.mlp_extractor.value_net, model.policy.value_net])


def shares(first, second):
    return [torch.equal(a, b) for a, b in zip(first, second, strict=True)]


def difference(model, law):
    """Root mean square difference of a policy's actions from a controller's, on separate episodes."""
    env = bb.BallbotVecEnv(50, model="spatial", num_threads=1, seed=77)
    observations, differences = env.reset(), []
    for _ in range(100):
        desired = env._batch.control(law, {"position": np.zeros((50, 2)), "yaw": [state.yaw for state in env.state]})
        actions = model.predict(observations, deterministic=True)[0]
        differences.append(actions - desired)
        observations = env.step(actions)[0]
    return np.sqrt(np.mean(np.square(differences)))


@pytest.fixture(scope="module")
def fitted():
    """A fitted model, and the errors of the rounds."""
    model = new_model()
    value = of_value(model)
    errors = teacher.fit_actor(model, *teacher.laws_of(model, FIT), FIT, seed=0)
    assert all(shares(value, of_value(model)))
    return model, errors


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("taught") / "run"
    messages = []
    train.train(config.parse(TAUGHT, "taught"), TAUGHT, folder, seed=3, progress_bar=False, tell=messages.append)
    assert len(messages) == 1
    assert messages[0].startswith("fitted to lqr: root mean square error of the actions 0.")
    return folder


class TestFit:
    def test_the_error_falls_and_the_policy_balances(self, fitted):
        model, errors = fitted
        law = bb.make_controller("lqr")
        assert len(errors) == FIT.rounds
        assert errors[-1] < errors[0]
        found = difference(model, law)
        assert found < 0.2 * difference(new_model(), law)
        # Of a regulator with other weights.
        assert found < 0.5 * difference(model, bb.make_controller("lqr", torque=1.0))
        env = VecMonitor(bb.BallbotVecEnv(20, model="spatial", num_threads=1, seed=99, max_episode_steps=300))
        assert evaluate_policy(model, env, 20, return_episode_rewards=True)[1] == [300] * 20
        _, lengths = evaluate_policy(new_model(), env, 20, return_episode_rewards=True)
        assert np.mean(lengths) < 200

    def test_the_value_function_learns_without_the_policy(self, fitted):
        model, _ = fitted
        actor, value = of_actor(model), of_value(model)
        rate, epochs, log = model.lr_schedule, model.n_epochs, model.tensorboard_log
        teacher.fit_value(model, 2)
        assert all(shares(actor, of_actor(model)))
        assert not any(shares(value, of_value(model)))
        assert (model.num_timesteps, model._n_updates) == (0, 0)
        assert (model.lr_schedule, model.n_epochs, model.tensorboard_log) == (rate, epochs, log)
        # Afterwards the actor learns.
        model.learn(model.n_steps * model.n_envs)
        assert not any(shares(actor, of_actor(model)))

    def test_the_command_does_not_depend_on_the_heading(self):
        model = new_model()
        batch = teacher._batch(model)
        params, yaws = batch.params(0), np.linspace(-3.0, 3.0, 32)
        starts = []
        for yaw in yaws:
            x, y = 0.03, 0.08
            tilt = (np.cos(yaw) * x - np.sin(yaw) * y, np.sin(yaw) * x + np.cos(yaw) * y)
            starts.append(bb.State.at_rest(params, tilt=tilt, yaw=yaw))
        observations = batch.reset(starts=starts)
        np.testing.assert_allclose(observations, np.tile(observations[:1], (32, 1)), atol=1e-5)
        (law,) = teacher.laws_of(model, FIT)
        labels = batch.control(law, teacher._setpoints(batch, law, FIT))
        np.testing.assert_allclose(labels, np.tile(labels[:1], (32, 1)), atol=1e-5)
        # With the heading held at zero they would differ.
        assert np.ptp(batch.control(law), axis=0).max() > 0.1

    @pytest.mark.parametrize("task", ["velocity", "goal", "path", "push"])
    def test_every_task_has_laws_to_learn_from(self, task):
        model = new_model(task)
        quick = config.Teacher("cascade_pid", rounds=2, steps=10)
        (law,) = teacher.laws_of(model, quick)
        assert np.isfinite(teacher.fit_actor(model, law, quick, seed=0)).all()
        assert set(teacher._setpoints(teacher._batch(model), law, quick)) >= {"position", "yaw"}

    def test_a_controller_that_does_not_follow_positions_ignores_the_position(self):
        model = new_model("path")
        batch = teacher._batch(model)
        batch.reset()
        (law,) = teacher.laws_of(model, FIT)
        requested = batch.setpoint(0)
        for follows in (True, False):
            chosen = teacher._setpoints(batch, law, dataclasses.replace(FIT, follows_position=follows))
            place = requested["position"] if follows else batch.state(0).ball_position[:2]
            np.testing.assert_array_equal(chosen["position"][0], place)
            np.testing.assert_array_equal(chosen["velocity"][0], requested["velocity"])
        with pytest.raises(ValueError, match="follows_position = 1 must be true or false"):
            dataclasses.replace(FIT, follows_position=1)

    def test_a_controller_that_does_not_follow_the_motion_follows_the_command(self):
        model = new_model("velocity")
        batch = teacher._batch(model)
        batch.reset()
        (law,) = teacher.laws_of(model, FIT)
        chosen = teacher._setpoints(batch, law, dataclasses.replace(FIT, follows_motion=False))
        # A robot at the setpoint stays there on a circle with the commanded speed and rate.
        x, y, rate = batch.command().T
        yaw = chosen["yaw"]
        np.testing.assert_allclose(chosen["velocity"][:, 0], np.cos(yaw) * x - np.sin(yaw) * y)
        np.testing.assert_allclose(np.linalg.norm(chosen["velocity"], axis=1), np.hypot(x, y))
        for lower, higher in (("velocity", "acceleration"), ("acceleration", "jerk"), ("jerk", "snap")):
            turned = np.stack([-chosen[lower][:, 1], chosen[lower][:, 0]], axis=1)
            np.testing.assert_allclose(chosen[higher], rate[:, None] * turned)
        np.testing.assert_array_equal(chosen["yaw_rate"], rate)
        with pytest.raises(ValueError, match="follows_motion = False: the task path commands no velocity"):
            teacher.laws_of(new_model("path"), dataclasses.replace(FIT, follows_motion=False))

    def test_labels_are_of_each_robot_as_events_have_sampled_it(self):
        events = [{"term": "body_com_offset", "range": [-0.005, 0.005]}]
        for drawn in (True, False):
            model, other = (new_model(events=events) for _ in range(2))
            settings = dataclasses.replace(FIT, rounds=1, steps=1, drawn=drawn)
            (law,) = teacher.laws_of(model, settings)
            batch = teacher._batch(model)

            def label(batch=batch, law=law, settings=settings):
                return teacher._actions_of(law, batch, settings), np.ones(32, dtype=np.float32)

            (found,) = rounds(model.get_env(), lambda *_: 0.0, label, settings, np.random.default_rng(0))
            batch = teacher._batch(other)
            other.get_env().reset()
            own = np.zeros((32, 3))
            for i in range(32):
                params = batch.params(i) if drawn else bb.Params.paper()
                controller = bb.Controller("lqr", params, max_torque=batch.max_wheel_torque)
                own[i] = controller(batch.state(i), yaw=batch.state(i).yaw) / batch.max_wheel_torque
            np.testing.assert_allclose(found.labels[0], own, atol=1e-5)

    def test_of_the_same_observation_of_two_robots_the_weighted_mean_is_learned(self):
        model = new_model(robot=["paper", "rezero"], scale_by_robot=True)
        settings = dataclasses.replace(FIT, epochs=150, drawn=True, weights={"s": 2, "rad": -1})
        batch = teacher._batch(model)
        factors = teacher_errors.Weighting(batch, settings).of(batch, np.zeros((32, 3), dtype=np.float32))
        paper, rezero = factors[[0, 8]] ** 2
        scale = bb.Params.preset("rezero").scale
        assert rezero / paper == pytest.approx(scale("s") ** 2 / scale("rad"), rel=1e-6)
        seen = np.zeros((32, *model.observation_space.shape), dtype=np.float32)
        labels = np.where(np.arange(32)[:, None] % 16 < 8, 0.5, -0.5).repeat(3, axis=1).astype(np.float32)
        optimizer = torch.optim.Adam(teacher._actor(model), lr=2e-2)
        states = [torch.as_tensor(rows) for rows in (seen, labels, factors)]
        teacher._regress(model, optimizer, states, settings, 0)
        expected = 0.5 * (paper - rezero) / (paper + rezero)
        np.testing.assert_allclose(model.predict(seen[0], deterministic=True)[0], expected, atol=1e-3)

    def test_large_tilts_do_not_count_and_small_actions_count_more(self):
        model = new_model(robot=["paper", "rezero"])
        batch = teacher._batch(model)
        leans = [batch.params(8 * robot).scale("rad") for robot in range(2)]
        tilts = np.where(np.arange(32) % 2 == 0, 0.29, 0.31) * np.repeat(leans * 2, 8)
        batch.reset(starts=[bb.State.at_rest(batch.params(i), tilt=(tilts[i], 0.0)) for i in range(32)])
        actions = np.tile(np.array([[0.0, 0.1, -0.1]], dtype=np.float32), (32, 1))
        actions[::4] = [0.2, -0.8, 0.3]
        weighting = teacher_errors.Weighting(batch, dataclasses.replace(FIT, largest_tilt=0.3, small_action=0.2))
        expected = np.where(np.arange(32) % 4 == 0, 1.0 / 0.8, 1.0 / 0.2)
        expected[1::2] = 0.0
        np.testing.assert_allclose(weighting.of(batch, actions) ** 2, expected, rtol=1e-5)

    @pytest.mark.parametrize("saturates", [True, False])
    def test_beyond_the_largest_action_there_is_no_error_on_its_side(self, saturates):
        settings = dataclasses.replace(FIT, epochs=1, saturates=saturates)
        for label, bias, is_equal in ((1.0, 2.0, True), (1.0, -2.0, False), (0.9, 2.0, False), (1.0, 0.5, False)):
            model = new_model()
            states = [torch.zeros(32, *model.observation_space.shape), torch.full((32, 3), label), torch.ones(32)]
            with torch.no_grad():
                model.policy.action_net.bias.fill_(bias)
            before = of_actor(model)
            optimizer = torch.optim.Adam(teacher._actor(model))
            error = teacher._regress(model, optimizer, states, settings, 0)
            assert all(shares(before, of_actor(model))) == (saturates and is_equal)
            assert (error == 0.0) == (saturates and is_equal)

    def test_the_learning_rate_falls_by_rounds_or_to_zero(self):
        optimizer = torch.optim.Adam(teacher._actor(new_model()))

        def rate(settings, done, epochs):
            teacher_errors.set_rate(optimizer, settings, done, epochs)
            return optimizer.param_groups[0]["lr"]

        usual = dataclasses.replace(FIT, rounds=3, epochs=2)
        assert [rate(usual, done, epochs) for done in range(3) for epochs in (0, 1.5)] == pytest.approx(
            [1e-2, 1e-2, 1e-2 * 2 / 3, 1e-2 * 2 / 3, 1e-2 / 3, 1e-2 / 3]
        )
        # Epochs of one, two and three rounds of states.
        longer = dataclasses.replace(usual, last_epochs=5)
        passed = [0.5, 2 + 2 * 0.5, 2 + 2 * 2 + 3 * 4.5, 2 + 2 * 2 + 3 * 5]
        found = [rate(longer, *at) for at in ((0, 0.5), (1, 0.5), (2, 4.5), (2, 5))]
        assert found == pytest.approx([1e-2 * (1.0 - one / 21) for one in passed])

    @pytest.mark.parametrize(
        ("name", "value", "words"),
        [
            ("small_action", 0.0, "from 0.001 to 1"),
            ("largest_tilt", float("nan"), "from 0.01 to 3"),
            ("last_epochs", 0, "a whole number of at least 1"),
            ("saturates", 1, "must be true or false"),
        ],
    )
    def test_values_out_of_range_are_named(self, name, value, words):
        with pytest.raises(ValueError, match=f"teacher.{name} = {value!r}.*{words}"):
            dataclasses.replace(FIT, **{name: value})

    @pytest.mark.parametrize(("continues", "expected"), [(False, 3), (True, 1)])
    def test_rounds_reset_the_robots_or_continue(self, continues, expected, monkeypatch):
        model = new_model()
        settings = dataclasses.replace(FIT, rounds=3, steps=7, continues=continues)
        resets = []
        environment = model.get_env()
        reset = environment.reset
        monkeypatch.setattr(environment, "reset", lambda: resets.append(None) or reset())
        (law,) = teacher.laws_of(model, settings)
        teacher.fit_actor(model, law, settings, 0)
        assert len(resets) == expected

    def test_of_several_controllers_the_best_is_chosen(self):
        several = dataclasses.replace(FIT, controller=["sliding_mode", "lqr"], options={"lqr": {"torque": 0.3}})
        messages = []
        for seed in (0, 1):
            model = new_model(max_episode_steps=200)
            law = teacher.best_law(model, several, seed, messages.append)
            assert law.name == "lqr"
            # The run begins as without a choice: with robots that no other seed has.
            begins = bb.BallbotVecEnv(32, model="spatial", seed=first_seed(seed)).reset()
            np.testing.assert_array_equal(model.get_env().reset(), begins)
        assert messages[0] != messages[1]
        first = [float(text.rpartition(" ")[2]) for text in messages[0].removeprefix("mean returns: ").split(", ")]
        assert messages[0].startswith("mean returns: sliding_mode ")
        assert first[0] < first[1] <= 200.0
        # Each is judged in the same episodes.
        again = dataclasses.replace(several, controller=["lqr", "sliding_mode"])
        teacher.best_law(new_model(max_episode_steps=200), again, 0, messages.append)
        assert [
            float(text.rpartition(" ")[2]) for text in messages[2].removeprefix("mean returns: ").split(", ")
        ] == first[::-1]


class TestRun:
    def test_begins_with_the_fitted_policy(self, run):
        assert np.load(run / "evaluations.npz")["timesteps"].tolist() == [0, 256, 512, 768]
        assert PPO.load(run / "final_model.zip").num_timesteps == 768
        assert PPO.load(run / "checkpoints" / "rl_model_0_steps.zip").num_timesteps == 0

    def test_is_reproducible(self, run, tmp_path, monkeypatch):
        monkeypatch.delenv("SB3_LOGDIR")
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
        (tmp_path / "temporary").mkdir()
        train.train(config.parse(TAUGHT, "taught"), TAUGHT, tmp_path / "again", seed=3, progress_bar=False)
        first, second = (PPO.load(folder / "final_model.zip") for folder in (run, tmp_path / "again"))
        assert all(shares(values([first.policy]), values([second.policy])))
        assert not list((tmp_path / "temporary").iterdir()), "Stable-Baselines3 logs into the temporary folder"

    def test_resumes_without_another_fit(self, run, tmp_path, monkeypatch):
        folder = shutil.copytree(run, tmp_path / "run")
        for steps in (256, 512, 768):
            (folder / "checkpoints" / f"rl_model_{steps}_steps.zip").unlink()
        monkeypatch.delattr(teacher, "fit")
        train.resume(folder, progress_bar=False)
        assert PPO.load(folder / "final_model.zip").num_timesteps == 768
        assert np.load(folder / "evaluations.npz")["timesteps"].tolist() == [0, 256, 512, 768]
        assert weights(folder / "final_model.zip") == weights(run / "final_model.zip")

    def test_the_command_line_prints_and_sets(self, tmp_path, capsys):
        path = tmp_path / "tiny.toml"
        path.write_text(TAUGHT, encoding="utf-8")
        arguments = ["train", "--config", str(path), "--episodes", "0", "--no-report", "--set"]
        assert main([*arguments, "teacher.options.torque=0.3", "--run", str(tmp_path / "run")]) == 0
        assert "fitted to lqr: root mean square error" in capsys.readouterr().err
        assert main([*arguments, "teacher.rounds=0", "--run", str(tmp_path / "other")]) == 1
        assert "teacher.rounds = 0 is out of range: it must be a whole number of at least 1" in capsys.readouterr().err


class TestMistakes:
    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("teacher = 'lqr'", "teacher = 'lqr' must be a table"),
            ("[teacher]\nrounds = 3", r"\[teacher\]: it has no controller, expected one of lqr, "),
            ("[teacher]\nlaw = 'lqr'", r"\[teacher\]: unknown key 'law': expected one of controller, options, "),
            ("[teacher]\ncontroller = 'lqg'", "teacher.controller = 'lqg' is not a controller: expected one of lqr, "),
            ("[teacher]\ncontroller = ['lqr', 'lqg']", r"controller = \['lqr', 'lqg'\] is not a .* or a list of them"),
            ("[teacher]\ncontroller = []", r"teacher.controller = \[\] is not a controller"),
            ("[teacher]\ncontroller = ['lqr']\noptions = {torque = 1}", "options.torque = 1: .* table of options of"),
            ("[teacher]\ncontroller = 'lqr'\ndrawn = 1", "teacher.drawn = 1 must be true or false"),
            ("[teacher]\ncontroller = 'lqr'\noptions = 1", "teacher.options = 1 must be a table"),
            ("[teacher]\ncontroller = 'lqr'\nweights = 1", "teacher.weights = 1 must be a table"),
            ("[teacher]\ncontroller = 'lqr'\nweights = {A = 1}", "'A' has no scale: expected one of"),
            ("[teacher]\ncontroller = 'lqr'\nweights = {s = 5}", "weights.s = 5 is out of range: .* from -4 to 4"),
            ("[teacher]\ncontroller = 'lqr'\nrounds = 0", "teacher.rounds = 0 is out of range: .* at least 1"),
            ("[teacher]\ncontroller = 'lqr'\nsteps = 1.5", "teacher.steps = 1.5 is out of range"),
            ("[teacher]\ncontroller = 'lqr'\nepochs = true", "teacher.epochs = True is out of range"),
            ("[teacher]\ncontroller = 'lqr'\nbatch_size = -1", "teacher.batch_size = -1 is out of range"),
            ("[teacher]\ncontroller = 'lqr'\nvalue_rollouts = -1", "value_rollouts = -1 is out .* at least 0"),
            ("[teacher]\ncontroller = 'lqr'\nlearning_rate = 0", "learning_rate = 0 is out .* from 1e-9 to 1"),
            ("[teacher]\ncontroller = 'lqr'\nnoise = nan", "teacher.noise = nan is out of range: .* from 0 to 1"),
            ("algorithm = 'SAC'\n[teacher]\ncontroller = 'lqr'", "teacher: not available for SAC, only for PPO"),
        ],
    )  # fmt: skip
    def test_are_named_with_their_source(self, text, message):
        with pytest.raises(ValueError, match=message) as caught:
            config.parse(text, "source")
        assert str(caught.value).startswith("source: ")

    def test_observations_that_the_memory_cannot_hold_change_nothing(self, tmp_path):
        text = config.with_values(TAUGHT, {"teacher.steps": 10**9})
        words = r"num_envs = \d+ is out of range: it must be at most 67108864 for observations of 16 numbers"
        with pytest.raises(ValueError, match=words):
            train.train(config.parse(text, "bad"), text, tmp_path / "new", progress_bar=False)
        assert not (tmp_path / "new").exists()

    @pytest.mark.parametrize(("name", "value"), [("torque", -1.0), ("gain", 2.0), ("max_lean", "wide")])
    def test_an_option_that_the_controller_rejects_changes_nothing(self, tmp_path, name, value):
        text = config.with_values(TAUGHT, {f"teacher.options.{name}": value})
        with pytest.raises(ValueError, match=f"^teacher: .*{name}"):
            train.train(config.parse(text, "bad"), text, tmp_path / "new", progress_bar=False)
        assert not (tmp_path / "new").exists()

    def test_a_task_in_python_has_no_teacher(self, tmp_path):
        class Still(bb.Task):
            def observe(self, robots):
                return robots.gravity

            def reward(self, robots):
                return np.zeros(len(robots))

        bb.register("me/Still-v0", Still)
        try:
            text = TAUGHT.replace(BALANCE, "me/Still-v0")
            with pytest.raises(ValueError, match="teacher: the task me/Still-v0 is in Python"):
                train.train(config.parse(text, "own"), text, tmp_path / "own", progress_bar=False)
        finally:
            registry.restore("me/Still-v0", None)
        assert not (tmp_path / "own").exists()
