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
        (lambda: bb.State.at_rest(params="kugle"), "argument: 'robot'"),
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


@pytest.mark.parametrize(
    "make", [bb.Ballbot, lambda robot: bb.Batch(1, robot=robot), bb.Lqr, bb.LinearModel, bb.Estimator]
)
def test_the_core_takes_a_robot_in_every_form(make, tmp_path):
    kugle = bb.Params.preset("kugle")
    (tmp_path / "mine.toml").write_text(kugle.to_toml())
    for robot in ("kugle", kugle, kugle.to_dict(), tmp_path / "mine.toml", str(tmp_path / "mine.toml")):
        make(robot)
    with pytest.raises(TypeError, match=r"robot must be Params, .* not float"):
        make(3.0)
