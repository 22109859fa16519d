"""Controllers compared with independent libraries: python-control for the regulators, scikit-fuzzy for the rules."""

from collections.abc import Callable

import control
import numpy as np
import numpy.typing as npt
import pytest
import skfuzzy
from skfuzzy import control as rules

import ballbot_rs as bb
from ballbot_rs._core import ROBOTS

Array = npt.NDArray[np.float64]

SETS = np.arange(-3, 4) / 3.0
#: c_ij of the default rules.
TABLE = np.clip((np.arange(-3, 4)[:, None] + np.arange(-3, 4)) / 3.0, -1.0, 1.0)
#: Half of the width of a consequent that represents a singleton.
HALF = 1.0 / 12.0


def sampled(params: bb.Params, control_dt: float) -> tuple[Array, Array]:
    """A and B of the robot that laws are designed for: the friction of the joints is compensated."""
    linear = bb.LinearModel(params.replace(wheel_viscous_friction=0.0, wheel_coulomb_friction=0.0))
    a, b = np.asarray(linear.A), np.asarray(linear.B)
    found = control.c2d(control.ss(a, b, np.eye(10), np.zeros((10, 3))), control_dt, "zoh")
    return found.A, found.B


def costs(options: dict[str, float]) -> tuple[Array, Array]:
    names = ["position"] * 2 + ["tilt"] * 2 + ["yaw"] + ["velocity"] * 2 + ["tilt_rate"] * 2 + ["yaw_rate"]
    return np.diag([options[name] ** -2 for name in names]), np.eye(3) * options["torque"] ** -2


def defaults(law: str, params: bb.Params) -> dict[str, float]:
    return {
        name: option.default * (params.scale(option.unit) if option.scaled else 1.0)
        for name, option in bb.controllers()[law].options.items()
    }


@pytest.mark.parametrize("control_dt", [0.002, 0.01, 0.02])
@pytest.mark.parametrize("robot", ROBOTS)
def test_the_regulator_matches_python_control(robot: str, control_dt: float):
    params = bb.Params.preset(robot)
    lqr = bb.Lqr(params, control_dt)
    gain, cost, _ = control.dlqr(*sampled(params, control_dt), *costs(defaults("lqr", params)))
    np.testing.assert_allclose(lqr.gain, gain, rtol=0.0, atol=1e-9 * np.abs(gain).max())
    np.testing.assert_allclose(lqr.riccati_solution, cost, rtol=0.0, atol=1e-9 * np.abs(cost).max())


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_regulator_with_an_integral_matches_python_control(robot: str):
    params, control_dt = bb.Params.preset(robot), 0.01
    options = defaults("lqi", params)
    a, b = sampled(params, control_dt)
    q, r = costs(options)
    # z⁺ = z + T (x, y).
    augmented = np.block([[a, np.zeros((10, 2))], [control_dt * np.eye(2, 10), np.eye(2)]])
    weights = np.block([[q, np.zeros((10, 2))], [np.zeros((2, 10)), np.eye(2) * options["integral"] ** -2]])
    gain, _, _ = control.dlqr(augmented, np.vstack([b, np.zeros((2, 3))]), weights, r)
    constants = bb.make_controller("lqi", params, control_dt).constants()
    found = np.hstack([np.asarray(constants["gain"]), np.asarray(constants["integral_gain"])])
    np.testing.assert_allclose(found, gain, rtol=0.0, atol=1e-9 * np.abs(gain).max())


def surface() -> tuple[Callable[[float, float], float], float, float]:
    """Φ(e/E, ė/Ė) of the law, from its torques without any limit or setpoint, and the ranges E (rad) and Ė (rad/s)."""
    params = bb.Params.paper().replace(max_wheel_torque=1e3)
    law = bb.make_controller("fuzzy_mamdani", params, 0.01, max_lean=0.0, traction=False, max_torque=1e3)
    options, turning = defaults("fuzzy_mamdani", params), np.asarray(bb.LinearModel(params).B)[8]
    toppling = bb.Scale.of(params).toppling_rate
    frequency = options["lean_bandwidth"] * toppling
    largest = (toppling**2 + frequency**2) * options["range"]
    rate = largest / (2.0 * options["lean_damping"] * frequency)

    def output(error: float, change: float) -> float:
        # The error is of an upright robot, e = −θ, in the plane of x.
        state = bb.State.at_rest(params, tilt=(0.0, -error * options["range"]))
        state = state.replace(body_angular_velocity=(0.0, -change * rate, 0.0))
        return float(turning @ law(state)) / largest

    return output, options["range"], rate


def inputs() -> Array:
    """Within and beyond the ranges, at the tops of the sets and between them."""
    return np.concatenate([SETS, np.linspace(-1.3, 1.3, 13), [-0.51, 0.083, 0.97]])


def test_the_rules_match_scikit_fuzzy():
    """Sugeno's weighted mean of singletons with scikit-fuzzy's memberships: no tolerance but rounding."""
    found, _, _ = surface()
    universe = np.arange(-4, 5) / 3.0
    sets = [skfuzzy.trimf(universe, [top - 1.0 / 3.0, top, top + 1.0 / 3.0]) for top in SETS]

    def memberships(value: float) -> Array:
        within = float(np.clip(value, -1.0, 1.0))
        return np.array([skfuzzy.interp_membership(universe, one, within) for one in sets])

    for error in inputs():
        for change in inputs():
            fired = np.outer(memberships(error), memberships(change))
            expected = (fired * TABLE).sum() / fired.sum()
            assert found(error, change) == pytest.approx(expected, abs=1e-12)


def mamdani(steps: int) -> rules.ControlSystemSimulation:
    """The rules as a textbook has them, with centroids on a universe of `steps` points between two sets."""
    error, change = (rules.Antecedent(np.arange(-3, 4) / 3.0, name) for name in ("error", "change"))
    outputs = np.arange(-4 * steps, 4 * steps + 1) / (3.0 * steps)
    output = rules.Consequent(outputs, "output")
    output.accumulation_method = np.add
    for number, top in enumerate(SETS):
        for one in (error, change):
            one[str(number)] = skfuzzy.trimf(one.universe, [top - 1.0 / 3.0, top, top + 1.0 / 3.0])
        output[str(number)] = (np.abs(outputs - top) <= HALF + 1e-9).astype(float)
    level = np.rint(3.0 * TABLE).astype(int) + 3
    table = [
        rules.Rule(error[str(i)] & change[str(j)], output[str(level[i, j])], and_func=np.multiply)
        for i in range(7)
        for j in range(7)
    ]
    return rules.ControlSystemSimulation(rules.ControlSystem(table), cache=False)


def bound(steps: int) -> float:
    """What the sides of a consequent can move the centroid by.

    A box of the width 2 b has sides of one step h of the universe, so that a cut at μ leaves μ (2 b + 2 h − h μ) of its
    area, which is not quite in proportion to μ: by the share ε = h/(2 b + 2 h) at most. The centers that count at once
    are within 2/3.
    """
    step = 1.0 / (3.0 * steps)
    share = step / (2.0 * HALF + 2.0 * step)
    return share / (1.0 - share) * 2.0 / 3.0


# What NumPy deprecates in its calls is scikit-fuzzy's own.
@pytest.mark.filterwarnings("ignore:Passing more than 2 positional arguments:DeprecationWarning:skfuzzy")
def test_the_rules_are_the_limit_of_scikit_fuzzys_centroids():
    found, _, _ = surface()
    # One rule, two, three and four at once, and beyond the ranges.
    points = [(2 / 3, -1 / 3), (0.1, 0.0), (-0.2, 0.45), (0.9, -0.85), (-0.5, -0.1), (-1.2, 0.55), (0.05, 1.4)]
    worst = []
    for steps in (16, 64):
        simulation, errors = mamdani(steps), []
        for error, change in points:
            simulation.input["error"], simulation.input["change"] = error, change
            simulation.compute()
            errors.append(abs(simulation.output["output"] - found(error, change)))
        worst.append(max(errors))
        assert worst[-1] <= bound(steps)
    # Four times the resolution: of first order in the step of the universe.
    assert worst[0] > 3.0 * worst[1] > 1e-5
