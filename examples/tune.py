"""Search the weights of LQR for a push, a step and a circle with delayed motors; compare them with the defaults."""

import sys

import ballbot_rs as bb

budget = int(sys.argv[1]) if len(sys.argv) > 1 else 200  # evaluations
scenarios = ["S4", "S9", "S18-circle"]  # `ballbot compare --list` has all

tuned = bb.tune("lqr", scenarios, budget)
print(f"cost {tuned.cost:.3f} of the cost of the default weights")
for name, value in tuned.options.items():
    print(f"{name:<10} {bb.controllers()['lqr'].options[name].default:8.4g} -> {value:8.4g}")
for outcome in bb.run_scenarios(["lqr", tuned.source()], scenarios):
    print(f"{outcome.scenario.id:<10} {outcome.controller:<12} {outcome.score:.4g}")
