"""Errors about unknown keywords name the nearest, the new name of an old one, or where else it exists."""

import pickle

import pytest

import ballbot_rs as bb


@pytest.mark.parametrize(
    ("call", "end"),
    [
        (lambda: bb.simulate("lqr", modle="rigid"), "simulate got .* 'modle': did you mean 'model'"),
        (lambda: bb.simulate("lqr", puhses=()), "did you mean 'pushes'"),
        (lambda: bb.simulate("lqr", push=bb.Push((0.1, 0, 0))), "'push': it is now pushes="),
        (lambda: bb.simulate("lqr", env_options={}), "write its entries as keywords"),
        (lambda: bb.simulate("lqr", sweep={}), "'sweep' is a keyword of compare and run_scenarios"),
        (lambda: bb.evaluate("lqr", params="kugle"), "evaluate got .* 'params': it is now robot="),
        (lambda: bb.evaluate("lqr", goal_radius=0.1), "'goal_radius' is an option of the task goal"),
        (lambda: bb.BalanceEnv(params="kugle"), "BalanceEnv got .* 'params': it is now robot="),
        (lambda: bb.BalanceEnv(pushes=()), "'pushes' is a keyword of simulate"),
        (lambda: bb.tune("lqr", scenario="S1"), "it is now scenarios="),
        (lambda: bb.tune("lqr", terrain="wave"), "'terrain' is an option of environments"),
        (lambda: bb.identify("log.csv", params="kugle"), "it is now robot="),
        (lambda: bb.record_log(controller_params=None), "it is now controller_robot="),
        (lambda: bb.Push((0.1, 0, 0), durations=0.1), "Push got .* did you mean 'duration'"),
        (lambda: bb.StateFeedback([[1.0]], params="kugle"), "StateFeedback got .* it is now robot="),
        (lambda: bb.Ballbot(params="kugle"), "Ballbot got .* 'params': it is now robot="),
        (lambda: bb.Batch(1, params="kugle"), "Batch got .* 'params': it is now robot="),
        (lambda: bb.Batch(1, setpiont=(0, 0)), "did you mean 'setpoint'"),
        (lambda: bb.Batch(1, "goal", goal_radiu=1.0), "did you mean 'goal_radius'"),
        (lambda: bb.Lqr(params="kugle"), "Lqr got .* 'params': it is now robot="),
        (lambda: bb.Reference.circle(1.0, 6.0, params="kugle"), "Reference.circle got .* it is now robot="),
        (lambda: bb.State.at_rest(params="kugle"), "State.at_rest got .* it is now robot="),
        (lambda: bb.State.at_equilibrium(), "argument: 'robot'"),
        (lambda: bb.simulate("lqr", delay=0.01), r"'delay': write actuators={'delay': \.\.\.}$"),
        (lambda: bb.simulate("lqr", duration=3.0), "'duration': write seconds= or max_episode_steps=$"),
        (lambda: bb.BallbotEnv(dt=0.01), "'dt': write control_dt= or sim_dt=$"),
        (lambda: bb.rollout("lqr", 4, num_envs=4), "'num_envs': write num_robots=$"),
        (lambda: bb.simulate("lqr", body_mass=3.0), r"parameter of robot, as in Params.preset\('paper'\).replace"),
        (lambda: bb.make_controller("lqr", params="kugle"), "make_controller got .* it is now robot="),
        (lambda: bb.make_controller("lqr", delya=0.01), "did you mean 'delay'"),
        (lambda: bb.Supervised("lqr", delay=0.01), r"Supervised got .* write actuators={'delay': \.\.\.}$"),
        (lambda: bb.Scale.of(params="kugle"), "Scale.of got .* it is now robot="),
        (lambda: bb.Renderer(widht=640), "Renderer got .* did you mean 'width'"),
    ],
)
def test_an_unknown_keyword_names_what_to_write(call, end):
    with pytest.raises(TypeError, match=end) as caught:
        call()
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_a_name_that_has_gone_names_its_successor():
    with pytest.raises(AttributeError, match=r"is now bb\.simulate"):
        bb.run  # noqa: B018


def test_a_controller_in_capitals_is_recognized():
    with pytest.raises(FileNotFoundError, match="did you mean 'lqr'"):
        bb.simulate("LQR")
    with pytest.raises(ValueError, match="did you mean 'lqr'"):
        bb.make_controller("LQR")


def test_a_differentiable_batch_is_made_of_a_batch():
    pytest.importorskip("torch", exc_type=ImportError)
    with pytest.raises(TypeError, match=r"DifferentiableBatch got .* 'model'; 'model' is an option of environments"):
        bb.DifferentiableBatch(model="contact")
    with pytest.raises(TypeError, match=r"batch must be a Batch, not int: make one first, as Batch\(64\)"):
        bb.DifferentiableBatch(4)


@pytest.mark.parametrize(
    "make", [bb.Ballbot, lambda robot: bb.Batch(1, robot=robot), bb.Lqr, bb.LinearModel, bb.Estimator, bb.Scale.of]
)
def test_the_core_takes_a_robot_in_every_form(make, tmp_path):
    kugle = bb.Params.preset("kugle")
    (tmp_path / "mine.toml").write_text(kugle.to_toml())
    for robot in ("kugle", kugle, kugle.to_dict(), tmp_path / "mine.toml", str(tmp_path / "mine.toml")):
        make(robot)
    with pytest.raises(TypeError, match=r"robot must be Params, .* not float"):
        make(3.0)
