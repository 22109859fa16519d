"""Tunings of the page on controllers: published tunings keep their poles, searched tunings have the stated cost."""

import numpy as np
import pytest

import ballbot_rs as bb
from ballbot_rs._core import Controller, LinearModel
from validation.controllers import tuning, tunings
from validation.controllers.planners import PLANNERS, YIELDING
from validation.controllers.published import Plane, options, published

PAPER = bb.Params.paper()
PLACES = [0, 3, 5, 8]


def poles_of(law: str, chosen: dict[str, float], control_dt: float) -> np.ndarray:
    """Of a law on the linear model, from the torques of small deviations in the plane of x."""
    controller = Controller(law, PAPER, control_dt, **chosen)
    small = 1e-6
    upright = bb.State.at_rest(PAPER)
    requested = [
        (upright, {"position": (-small, 0.0)}),
        (bb.State.at_rest(PAPER, tilt=(0.0, small)), {"position": (0.0, 0.0)}),
        (upright, {"velocity": (-small, 0.0)}),
        (bb.State.rolling(PAPER, (0.0, 0.0), upright.body_quaternion, (0.0, small, 0.0)), {"position": (0.0, 0.0)}),
    ]
    torques = []
    for state, setpoint in requested:
        controller.reset()
        torques.append(np.asarray(controller(state, setpoint)) / small)
    linear = LinearModel(PAPER)
    a, b = np.asarray(linear.A)[np.ix_(PLACES, PLACES)], np.asarray(linear.B)[PLACES]
    return np.sort_complex(np.linalg.eigvals(a + b @ np.stack(torques, axis=1)))


@pytest.mark.parametrize("law", ["lqr", "pd_inverse_dynamics"])
def test_published_loops_keep_their_poles(law):
    expected = np.sort_complex(published()[law].scaled(Plane.of(PAPER).toppling))
    np.testing.assert_allclose(poles_of(law, options(law, PAPER), 1e-3), expected, rtol=0.02)


def test_a_weight_below_zero_moves_the_poles_little():
    """The weight of OCS2's tilt: a regulator with our model cannot have all of its poles."""
    found = options("mpc", PAPER)
    assert found["tilt"] == 1e3
    expected = np.sort_complex(published()["mpc"].scaled(Plane.of(PAPER).toppling))
    np.testing.assert_allclose(poles_of("lqr", found, 1e-3), expected, rtol=0.05)


def test_the_lean_of_the_sliding_mode_matches_kugle():
    """ω of the calm tuning in docs/laws.md, by λ of both robots."""
    found, plane = options("sliding_mode", PAPER), Plane.of(PAPER)
    natural = np.sqrt(found["surface"] * found["switching"] / found["layer"]) * plane.toppling
    kugle = bb.Scale.of(bb.Params.preset("kugle")).toppling_rate
    assert natural * kugle / plane.toppling == pytest.approx(np.sqrt(6.0 * 5.0 / 0.8), rel=1e-9)
    assert found["yaw_surface"] / plane.toppling == pytest.approx(6.0 / kugle, rel=1e-9)


def test_tunings_on_a_separate_time_scale():
    """Nagarajan's LQR as CMU's repository has it: λ² = 24.36 1/s²."""
    tuning = published()["lqr"]
    assert tuning.toppling == pytest.approx(4.9358, abs=1e-4)
    np.testing.assert_allclose(tuning.scaled(tuning.toppling), tuning.poles)
    np.testing.assert_allclose(sorted(tuning.poles.real), [-7.5896, -3.8712, -1.0884, -1.0884], atol=1e-3)
    assert all(np.all(one.poles.real < 0.0) for one in published().values())


@pytest.mark.parametrize("law", [name for name in tuning.CONTROLLERS if name not in (*PLANNERS, *YIELDING)])
def test_tuned_options_have_the_cost_of_the_file(law):
    found = tuning.tuned()[law]
    assert tuning.cost(law, found.options) == pytest.approx(found.cost, rel=1e-6)
    assert found.cost < tuning.cost(law, {})


def test_the_page_states_the_budget():
    assert f"with {tuning.BUDGET} evaluations" in str(tunings.__doc__)
