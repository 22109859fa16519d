"""Coverage of the intervals of `identify`: logs of random robots, each fitted from the nominal robot.

`python -m validation.identification` prints the table of docs/identify.md; `--figure FILE` draws its figure. With
`--payload` the robots have a payload that sways.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import ballbot_rs as bb
from ballbot_rs.identification.fit import FIELDS
from ballbot_rs.identification.parameters import ALONG
from validation.page import table

Array = npt.NDArray[np.float64]

#: Fewest of 100 intervals that contain the true value. Of 100 intervals of 95 %, 90 or more do with a probability of
#: 98.8 %.
LEAST = 0.90
#: Factors of the nominal values and absolute values, uniform within these ranges; mild.toml has the factors, too.
FACTORS = {"body_mass": (0.95, 1.05), "body_com_height": (0.97, 1.03), "body_inertia": (0.9, 1.1)}
RANGES = {
    "body_com_offset": (-0.004, 0.004),
    "ball_viscous_friction": (0.1, 0.6),
    "wheel_viscous_friction": (2e-4, 2e-3),
    "wheel_coulomb_friction": (2e-3, 1e-2),
}
#: The nominal payload: fraction of the body's mass, height in heights of its CoM, frequency (Hz) and damping ratio on a
#: body at rest; and ranges as above.
PAYLOAD = {"share": 0.2, "height": 1.5, "hertz": 2.0, "damping": 0.1}
PAYLOAD_FACTORS = {"payload_mass": (0.7, 1.3), "payload_stiffness": (0.7, 1.3), "payload_damping": (0.5, 1.5)}
#: Of its place, m.
PAYLOAD_OFFSETS = ((-0.01, 0.01), (-0.01, 0.01), (-0.03, 0.03))
PAYLOAD_FIELDS = (*PAYLOAD_FACTORS, "payload_position")
#: Range of the delay, model steps.
DELAYS = (1, 10)
SIM_DT = 0.002


@dataclass(frozen=True)
class Study:
    """Results of all logs."""

    names: tuple[str, ...]
    #: Error of each number in each log, in standard errors, shape (logs, p).
    scores: Array
    #: Whether each interval contains the true value, shape (logs, p).
    covered: npt.NDArray[np.bool_]
    #: Error and standard error in units of the number, shape (logs, p).
    errors: Array
    standard_errors: Array
    #: Processor time of each fit, s.
    seconds: Array
    #: Logs that did not converge, and why.
    failures: tuple[str, ...]


def loaded(params: bb.Params) -> bb.Params:
    """A robot with the nominal payload."""
    mass = PAYLOAD["share"] * params.body_mass
    stiffness = mass * (2.0 * np.pi * PAYLOAD["hertz"]) ** 2
    damping = 2.0 * PAYLOAD["damping"] * np.sqrt(stiffness * mass)
    place = (0.0, 0.0, PAYLOAD["height"] * params.body_com_height)
    return params.with_payload(mass, position=place, stiffness=stiffness, damping=damping)


def drawn(nominal: bb.Params, rng: np.random.Generator) -> tuple[bb.Params, float]:
    """A random robot, with a random payload if the nominal robot has one, and the delay of its motors, s."""
    values: dict[str, Any] = {}
    if nominal.has_payload:
        offset = [rng.uniform(*ends) for ends in PAYLOAD_OFFSETS]
        values["payload_position"] = (np.array(nominal.payload_position) + offset).tolist()
    for name, ends in ({**FACTORS, **PAYLOAD_FACTORS} if nominal.has_payload else FACTORS).items():
        value = np.asarray(getattr(nominal, name))
        values[name] = (value * rng.uniform(*ends, value.shape)).tolist()
    for name, ends in RANGES.items():
        shape = np.shape(getattr(nominal, name))
        values[name] = np.asarray(rng.uniform(*ends, shape)).tolist()
    return nominal.replace(**values), float(rng.integers(*DELAYS)) * SIM_DT


def run(
    logs: int, *, seconds: float = 20.0, first: int = 0, num_threads: int | None = None, payload: bool = False
) -> Study:
    """Records and fits logs of random robots; i seeds robot and log number i."""
    nominal = loaded(bb.Params.paper()) if payload else bb.Params.paper()
    fields = (*FIELDS, *PAYLOAD_FIELDS) if payload else FIELDS
    found: list[tuple[Array, Array, npt.NDArray[np.bool_]]] = []
    failures: list[str] = []
    durations: list[float] = []
    names: tuple[str, ...] = ()
    for seed in range(first, first + logs):
        robot, delay = drawn(nominal, np.random.default_rng(seed))
        # LQR is made for the nominal robot: the true robot is unknown when a log is recorded.
        log = bb.record_log(
            robot, seconds, actuators={"delay": delay}, controller_robot=nominal, sim_dt=SIM_DT, seed=seed
        )
        began = time.process_time()
        try:
            result = bb.identify(log, nominal, fields, sim_dt=SIM_DT, num_threads=num_threads)
        except (ValueError, ArithmeticError) as error:
            failures.append(f"log {seed}: {error}")
            continue
        durations.append(time.process_time() - began)
        names = result.names
        truth = true_values(robot, delay, fields)
        inside = (result.intervals[:, 0] <= truth) & (truth <= result.intervals[:, 1])
        found.append((result.values - truth, result.standard_errors, inside))
        print(
            f"log {seed}: {int(inside.sum())} of {len(truth)} intervals hold, {durations[-1]:.1f} s",
            file=sys.stderr,
            flush=True,
        )
    errors = np.array([one[0] for one in found]).reshape(len(found), -1)
    spreads = np.array([one[1] for one in found]).reshape(len(found), -1)
    covered = np.array([one[2] for one in found]).reshape(len(found), -1)
    return Study(names, errors / spreads, covered, errors, spreads, np.array(durations), tuple(failures))


def true_values(robot: bb.Params, delay: float, fields: Sequence[str]) -> Array:
    """A robot's numbers that `identify` fits."""
    values = [np.ravel(delay if name == "delay" else getattr(robot, name)) for name in fields]
    pairs = zip(fields, values, strict=True)
    return np.concatenate([value[list(ALONG.get(name, range(len(value))))] for name, value in pairs])


def markdown(study: Study) -> str:
    """The table of docs/identify.md."""
    rows = []
    for index, name in enumerate(study.names):
        bias = study.errors[:, index].mean() / (study.errors[:, index].std(ddof=1) / np.sqrt(len(study.errors)))
        rows.append(
            [
                f"`{name}`",
                f"{int(study.covered[:, index].sum())} of {len(study.covered)}",
                f"{np.median(study.standard_errors[:, index]):.2g}",
                f"{np.sqrt(np.mean(study.errors[:, index] ** 2)):.2g}",
                f"{np.abs(study.scores[:, index]).max():.2f}",
                f"{bias:+.1f}",
            ]
        )
    head = [
        "parameter",
        "intervals that hold",
        "median standard error",
        "rms error",
        "worst, in standard errors",
        "mean, in its standard errors",
    ]
    share = f"{study.covered.mean():.1%}"
    return (
        f"{table(head, rows)}\n\n{len(study.covered)} of {len(study.covered) + len(study.failures)} fits converged; "
        f"{share} of all "
        f"intervals hold. A fit takes {np.median(study.seconds):.1f} s of processor time (median), "
        f"{study.seconds.max():.1f} s at most."
    )


def holds(study: Study) -> bool:
    """Whether all fits converged, and enough intervals of each number hold."""
    return not study.failures and bool((study.covered.mean(axis=0) >= LEAST).all())


def draw(study: Study, path: Path) -> None:
    """A figure: the errors of each number in standard errors, one dot per log, and the ends of the 95 % interval."""
    from ballbot_rs.media.figures import style

    fig = style.figure(8.0, 3.6)
    ax = fig.subplots()
    spread = np.random.default_rng(0).uniform(-0.28, 0.28, study.scores.shape)
    places = np.arange(len(study.names))
    for inside, color in ((True, style.COLORS[0]), (False, style.COLORS[1])):
        chosen = study.covered == inside
        ax.plot(study.scores[chosen], (places + spread)[chosen], ".", color=color, markersize=3.5)
    for end in (-1.96, 1.96):
        ax.axvline(end, color=style.INK, linewidth=1.0, linestyle="--")
    ax.set_yticks(places, study.names)
    ax.invert_yaxis()
    ax.set_xlabel("estimate less true value (standard errors)")
    style.save(fig, path)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command `python -m validation.identification`."""
    parser = argparse.ArgumentParser(prog="python -m validation.identification", description=__doc__)
    parser.add_argument("--logs", type=int, default=100, help="how many (default 100)")
    parser.add_argument("--seconds", type=float, default=20.0, help="duration of a log (default 20)")
    parser.add_argument("--first", type=int, default=0, help="seed of the first log (default 0)")
    parser.add_argument("--threads", type=int, help="threads of the simulations (default: all cores)")
    parser.add_argument("--payload", action="store_true", help="with a payload that sways (default: without)")
    parser.add_argument("--figure", type=Path, help="file of the figure (default: none)")
    requested = parser.parse_args(arguments)
    study = run(
        requested.logs,
        seconds=requested.seconds,
        first=requested.first,
        num_threads=requested.threads,
        payload=requested.payload,
    )
    for failure in study.failures:
        print(failure)
    if not len(study.covered):
        return 1
    print(markdown(study))
    if requested.figure is not None:
        draw(study, requested.figure)
    return 0 if holds(study) else 1


if __name__ == "__main__":
    sys.exit(main())
