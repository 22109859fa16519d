"""A policy as a C99 header."""

import re
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

from ballbot_rs import __version__
from ballbot_rs._core import INSTRUMENTS, SCALED_BOUND
from ballbot_rs._robot import Robot
from ballbot_rs.control.observed_integral import POSITION, VELOCITY
from ballbot_rs.control.onnx_policy import OnnxPolicy
from ballbot_rs.deployment.c_text import array, comment, guarded, number, piece
from ballbot_rs.deployment.network import network
from ballbot_rs.envs._batch_env import new_batch
from ballbot_rs.envs.family import are_several
from ballbot_rs.envs.registration import description_of
from ballbot_rs.envs.spaces import history_ages

#: Rows of observations, by their names, from a `ballbot_view`, a state, a setpoint and the last action.
_ROWS: Final = {
    **{f"gravity direction, body {axis}": f"view.gravity[{i}]" for i, axis in enumerate("xyz")},
    **{f"body rate about body {axis}": f"state->rate[{i}]" for i, axis in enumerate("xyz")},
    **{f"wheel speed {i}": f"state->wheel_speeds[{i}]" for i in range(3)},
    **{row: f"view.position[{i}]" for i, row in enumerate(POSITION)},
    **{row: f"view.velocity[{i}]" for i, row in enumerate(VELOCITY)},
    **{f"commanded velocity, heading {axis}": f"view.commanded[{i}]" for i, axis in enumerate("xy")},
    "commanded rate of the heading": "setpoint->yaw_rate",
    **{
        f"error of the velocity, heading {axis}": f"view.commanded[{i}] - view.velocity[{i}]"
        for i, axis in enumerate("xy")
    },
    "error of the heading's rate": "setpoint->yaw_rate - view.yaw_rate",
    **{f"last action, wheel {i}": f"policy->action[{i}]" for i in range(3)},
}

_NUMBERS: Final = ("bound", "rest", "typical")


def policy_header(
    path: str | PathLike[str],
    task: str | None = None,
    robot: Robot | None = None,
) -> str:
    """The text of a C99 header with a policy.

    Args:
        path: an ONNX file that `ballbot export` wrote.
        task: the task that it was trained for; None is the task that the file names.
        robot: which it is to drive, of which a policy with `scale_by_robot` needs the size; None is the
            training robot.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: it is not a policy for the task, or has an operator that cannot be written as C; a policy that was
            trained on several robots needs `robot`; a robot whose motors are too weak.
        ModuleNotFoundError: onnxruntime or onnx is not installed.
    """
    file = Path(fspath(path))
    policy = OnnxPolicy(file, task)
    options = policy.env_options
    if robot is not None:
        if not options["scale_by_robot"] and not are_several(options.get("robot")):
            raise ValueError(f"{file} drives the robot that it was trained on: leave out robot (--robot)")
        options["robot"] = robot
    if are_several(options.get("robot")):
        raise ValueError(f"{file} was trained on several robots: name the robot that it is to drive (--robot)")
    for part in (*INSTRUMENTS, "rows"):
        if options.get(part) is not None:
            raise ValueError(f"{file}: a policy with {part} cannot be written as C, which has no {part}")
    batch = new_batch(1, task=policy.task, num_threads=1, options=options)
    options["max_wheel_torque"] = batch.max_wheel_torque
    rows = [dict(row) for row in description_of(policy.task)["observation"]]
    if options["scale_observations"]:
        for row, gain in zip(rows, batch.observation_gains, strict=True):
            row["typical"] = 1.0 / float(gain)
    try:
        ages = history_ages(options["history"])
        weights, act = network(file.read_bytes(), len(rows) * len(ages), policy.state_len)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error
    observe = _observe(rows)
    head = comment(_head(policy, options, rows, has_observe=bool(observe)))
    viewed = (piece("state"), piece("view")) if observe else ()
    step = piece("policy")
    if policy.state_len:
        step = _with(step, _OF_STATE)
    if batch.integral is not None:
        step = _with(step, _OF_INTEGRAL)
    parts = (
        piece("real"),
        *viewed,
        "/* ---- Constants, SI units. */\n\n" + _scaling(options, rows, policy.state_len, batch.integral) + weights,
        piece("policy_sum"),
        act,
        step,
        observe,
    )
    return guarded("policy", "policy", head, "\n".join(part for part in parts if part))


#: What the memory of a policy and its step have for a recurrent policy, too.
_OF_STATE: Final = {
    "    int newest; ": f"    {'ballbot_real state[BALLBOT_POLICY_STATE];':<69} /* of the network */\n    int newest; ",
    "{{0}, {0}, 0, 0, 0}": "{{0}, {0}, {0}, 0, 0, 0}",
    "ballbot_policy_act(observation, policy->action)": "ballbot_policy_act(observation, policy->state, policy->action)",
}


#: What they have for a policy that observes the integral of the position error, too.
_OF_INTEGRAL: Final = {
    "    int newest; ": f"    {'ballbot_real integral[2];':<69} /* of the position error */\n    int newest; ",
    "{{0}, {0},": "{{0}, {0}, {0},",
    "/* Wheel torques for the next": piece("policy_integral") + "/* Wheel torques for the next",
    "    policy->started = 1;\n": "    ballbot_policy_integrate(policy);\n    policy->started = 1;\n",
}


def _with(text: str, changes: Mapping[str, str]) -> str:
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    return text


def _scaling(
    options: dict[str, Any], rows: list[dict[str, Any]], state_len: int, integral: Mapping[str, float] | None
) -> str:
    is_scaled = options["scale_observations"]
    numbers = {
        "control_dt": options["control_dt"],
        "max_torque": options["max_wheel_torque"],
        "scaled_bound": SCALED_BOUND if is_scaled else max(row["bound"] for row in rows),
    }
    vectors = {
        "bound": [row["bound"] for row in rows],
        "rest": [row["rest"] if is_scaled else 0.0 for row in rows],
        "gain": [1.0 / row["typical"] if is_scaled else 1.0 for row in rows],
    }
    numbers |= {f"integral_{name}": value for name, value in (integral or {}).items()}
    ages = history_ages(options["history"])
    text = f"#define BALLBOT_POLICY_ROWS {len(rows)}\n#define BALLBOT_POLICY_HISTORY {len(ages)}\n"
    text += f"#define BALLBOT_POLICY_OLDEST {ages[-1]}\n"
    text += f"#define BALLBOT_POLICY_STATE {state_len}\n" if state_len else ""
    text += f"static const int BALLBOT_POLICY_AGES[] = {{{', '.join(map(str, ages))}}};\n"
    if integral is not None:
        names = [row["name"] for row in rows]
        for of, (x, y) in {"position": POSITION, "velocity": VELOCITY}.items():
            places = f"{names.index(x)}, {names.index(y)}"
            text += f"static const int BALLBOT_POLICY_{of.upper()}[] = {{{places}}}; /* rows */\n"
    text += "".join(
        f"#define BALLBOT_POLICY_{name.upper()} ((ballbot_real){number(value)})\n" for name, value in numbers.items()
    )
    return text + "".join(array(f"BALLBOT_POLICY_{name.upper()}", values) for name, values in vectors.items())


def _observe(rows: list[dict[str, Any]]) -> str:
    """The function that makes the rows from a state; empty for a task with rows outside `_ROWS`."""
    names = [row["name"] for row in rows]
    if not set(names) <= set(_ROWS):
        return ""
    values = [_ROWS[name] for name in names]
    # A compiler warns of what no row reads.
    unread = [name for name in ("policy", "view") if not any(re.search(rf"\b{name}\b", value) for value in values)]
    lines = [
        "/* The rows of an observation in their units, before the policy's next step. */",
        "static inline void ballbot_policy_observe(",
        "    const ballbot_policy *policy, const ballbot_state *state, const ballbot_setpoint *setpoint,",
        "    ballbot_real rows[BALLBOT_POLICY_ROWS])",
        "{",
        "    const ballbot_view view = ballbot_view_of(state, setpoint);",
        *(f"    (void){name};" for name in unread),
        *(f"    rows[{i}] = {value};" for i, value in enumerate(values)),
        "}",
    ]
    return "\n".join(lines) + "\n"


def _head(policy: OnnxPolicy, options: dict[str, Any], rows: list[dict[str, Any]], *, has_observe: bool) -> list[str]:
    known = policy.metadata
    observed = ["    ballbot_policy_observe(&policy, &state, &setpoint, rows);"]
    scaled = (
        "less their value at rest, over their typical magnitude" if options["scale_observations"] else "as they are"
    )
    every = options["control_dt"]
    return [
        f"A policy ({known['algorithm']}) of the task '{policy.task}'; `ballbot export` of ballbot {__version__}.",
        str(description_of(policy.task)["summary"]),
        "",
        f"Use: call `ballbot_policy_reset` once, the rest every BALLBOT_POLICY_CONTROL_DT = {every:g} s:",
        "",
        "    ballbot_policy policy;",
        "    ballbot_real rows[BALLBOT_POLICY_ROWS];",
        "    ballbot_real torques[3];",
        *(["    ballbot_state state;              (from the sensors)"] if has_observe else []),
        *(["    ballbot_setpoint setpoint = {0};"] if has_observe else []),
        "    ballbot_policy_reset(&policy);",
        *(observed if has_observe else ["    (rows from the sensors, in the order and the units below)"]),
        "    ballbot_policy_step(&policy, rows, torques);",
        "",
        f"Torques: the action within [-1, 1] times BALLBOT_POLICY_MAX_TORQUE = {options['max_wheel_torque']:.6g} N m.",
        f"Rows: saturated, then {scaled}; {_seen(options['history'])}",
        *(
            ["The position error that the network sees grows by its integral while the robot rests off the setpoint."]
            if options["integral_rate"]
            else []
        ),
        *(
            [f"The network is recurrent: `ballbot_policy` has its state, {policy.state_len} numbers."]
            if policy.state_len
            else []
        ),
        "Memory: all of it is in `ballbot_policy`; nothing is allocated. Weights are of single precision, sums of",
        "double or of what `#define BALLBOT_REAL float` before the #include chooses.",
        "",
        "Rows, in order: name, unit, bound, value at rest, typical magnitude",
        *(
            f"    {i:2}  {row['name']}, {row['unit'] or '1'}, " + ", ".join(f"{row[key] + 0.0:g}" for key in _NUMBERS)
            for i, row in enumerate(rows)
        ),
        "",
        f"{'Scaled to' if options['scale_by_robot'] else 'Trained on'} the robot {_robot(options)}.",
    ]


def _seen(history: Any) -> str:
    if isinstance(history, list):
        return f"the network sees the observations of {', '.join(map(str, history))} steps ago."
    return f"the network sees the last {history} observations."


def _robot(options: dict[str, Any]) -> str:
    robot = options.get("robot", "paper")
    return f"'{robot}'" if isinstance(robot, str) else f"with {robot}"
