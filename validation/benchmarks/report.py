"""The Markdown report, made only from the JSON."""

from typing import Any

from validation.benchmarks.names import label, measured, strongest

Rows = list[dict[str, Any]]

_METHOD = """\
## What is compared

The robot of `Params.paper()` in every engine, at time steps of 2 ms, five of them an action; the task of
`ballbot/Balance-v0` (16 numbers, reward, fall at 20 deg, 1000 steps, reset within the step); the same actions, uniform
in ±0.1 N·m unless a table has other sizes; a robot falls about twice a second. A wheel of the upright robot slips above
0.57 N·m if only this wheel is driven, above 0.20 N·m at the worst signs of all three. Episodes start at yaw 0
everywhere: there MuJoCo's robot works. Rates are medians over rounds in which all simulators take turns, with the
smallest and the largest. One core means a process pinned to one core; linear algebra has one thread throughout.

- **MuJoCo batch**: `mujoco.batch`, MuJoCo's own thread pool, under a `VecEnv` in NumPy that reads the state rows in
  place. Newton solver from the last step's forces with tolerance 1e-4, elliptic cones, four contact pairs and nothing
  else enabled. With 20 iterations of its line search instead of MuJoCo's 50, or with the `implicitfast` integrator at
  this tolerance, the growth rate below is off by percents or more.
- **PyBullet**: a URDF with anisotropic friction, 10 solver iterations, friction cone off, substeps inside Bullet.
- **Gymnasium** environments of both share the batch's NumPy task, on one robot, in SB3's `DummyVecEnv` (one process)
  and `SubprocVecEnv` (a process a robot, all cores).
- Bodies in MuJoCo and PyBullet have no hull, and contact with the floor is not checked; ours have one, and it is.
"""


def markdown(found: dict[str, Any]) -> str:
    """The report of everything in `found`."""
    machine = found["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in machine["versions"].items())
    load = machine["load_before"]
    parts = [
        "# Benchmark\n",
        f"`{machine['command']}`, {machine['date']}. {machine['processor']}, {machine['cores']} core(s), "
        f"{machine['memory_gib']} GiB, {machine['system']}"
        + (f", load average before the run {load[0]:.2f}" if load else "")
        + f".\n\n{versions}. All numbers are in `benchmark.json`.\n",
        _METHOD,
    ]
    if len(set(found["measured"].values())) > 1:
        parts.insert(2, "".join(f"- {name}: {when}\n" for name, when in found["measured"].items()))
    for name, section in (
        ("throughput", _throughput),
        ("actions", _actions),
        ("accuracy", _accuracy),
        ("scaling", _scaling),
        ("memory", _memory),
    ):
        if name in found:
            parts.append(section(found[name]))
    return "\n".join(parts)


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, [":--"] + ["--:"] * (len(head) - 1), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


def _absent(rows: Rows, key: str = "simulator") -> str:
    lines = [f"- {label(r[key])} ({r.get('quantity', 'all')}): {r['reason']}" for r in rows if "reason" in r]
    return "\n".join([*dict.fromkeys(lines), ""]) if lines else ""


def _throughput(rows: Rows) -> str:
    text = "## Throughput\n\n"
    for quantity, title in (
        ("environment", "Environment steps per second, through the `VecEnv`"),
        ("physics", "Physics steps per second, the engine alone (ours: through the environment, 25 steps an action)"),
    ):
        for threads in sorted({r["threads"] for r in rows if r.get("quantity") == quantity and "threads" in r}):
            at = measured(rows, quantity, threads)
            batch = {r["robots"]: r["median"] for r in at if r["simulator"] == "mujoco-batch"}
            best = max(batch.values(), default=None)
            body = []
            for r in sorted(at, key=lambda r: (r["robots"], -r["median"])):
                reference = batch.get(r["robots"], best)
                name = label(r["simulator"], quantity)
                ratio = f"{r['median'] / reference:.2f}" if reference else ""
                body.append(
                    [
                        name,
                        str(r["robots"]),
                        *_rate(r),
                        ratio,
                    ]
                )
            where = "one core" if threads == 1 else f"{threads} threads"
            head = ["simulator", "robots", "median", "min", "max", "× MuJoCo batch"]
            text += f"### {title}, {where}\n\n{_table(head, body)}\n"
    return text + _absent(rows)


def _actions(rows: Rows) -> str:
    """One table: a row per simulator, a column per action size; in parentheses the ratio to the MuJoCo batch."""
    at = [r for r in rows if "median" in r]
    driven = [r for r in at if r["case"] == "driven"]
    torques = sorted({r["torque"] for r in driven})
    headline = {r["torque"] for r in driven if r["headline"]}
    peer = {r["torque"]: r["median"] for r in driven if r["simulator"] == "mujoco-batch"}

    def cell(r: dict[str, Any] | None) -> str:
        if r is None:
            return "—"
        text = f"{r['median']:,.0f}"
        # The peers' robots have not all fallen.
        if r["case"] == "fallen" or r["torque"] not in peer:
            return text
        ratio = r["median"] / peer[r["torque"]]
        return f"{text} ({ratio:.{0 if ratio >= 100.0 else 1 if ratio >= 10.0 else 2}f})"

    body = []
    for name in dict.fromkeys(r["simulator"] for r in driven):
        of = {r["torque"]: r for r in driven if r["simulator"] == name}
        falls = ", ".join(f"{of[t]['falls_per_second']:.1f}" if t in of else "—" for t in torques)
        robots = str(next(iter(of.values()))["robots"])
        body.append([label(name), robots, *(cell(of.get(t)) for t in torques), falls])
    fallen = [r for r in at if r["case"] == "fallen"]
    for r in fallen:
        cells = [cell(r if r["torque"] == t else None) for t in torques]
        body.append([f"{label(r['simulator'])}: everybody fallen and thrashing", str(r["robots"]), *cells, "—"])
    head = [f"±{t} N·m" + (" (headline)" if t in headline else "") for t in torques]
    text = (
        "## What larger actions cost\n\nEnvironment steps per second, through the `VecEnv`, one core: medians, in "
        "parentheses times the MuJoCo batch at the same size. All runs take turns. "
        + "".join(
            f"The headline, and the size of all other tables and of the chart, is ±{t} N·m, at which no wheel of an "
            "upright robot slips. "
            for t in sorted(headline)
        )
        + "Falls are per robot and second, size by size. `spatial` and `planar` do not slip at any size. "
        "MuJoCo's slipping wheels hop: fewer contacts, hence more steps.\n\n"
        + _table(["simulator", "robots", *head, "falls (1/s)"], body)
    )
    if at:
        spread = max(max(r["max"] / r["median"], r["median"] / r["min"]) for r in at) - 1.0
        text += f"\nThe slowest or fastest round of a run is up to {spread:.0%} off its median.\n"
    for r in fallen:
        text += (
            f"\nEverybody fallen: all robots have fallen before the first round, and {r['lying_mean']:.1%} of them "
            f"(never less than {r['lying_min']:.1%}) touch the floor with body or wheels at the end of a step. Through "
            "`Batch`, without the `VecEnv`. The balance task ends an episode at the fall, so each step begins a new "
            "episode where the last step ended, which is not timed; it solves the contact forces without a warm "
            "start.\n"
        )
    return text + "\n" + _absent(rows)


def _rate(row: dict[str, Any]) -> list[str]:
    return [f"{row[k]:,.0f}" for k in ("median", "min", "max")]


def _range(values: list[float], digits: int) -> str:
    low, _, high = values
    return f"{low:.{digits}f} … {high:.{digits}f}"


def _accuracy(rows: Rows) -> str:
    head = [
        "engine",
        "wheel load at rest (N)",
        "growth rate, yaw 0 (1/s)",
        "growth rate, any yaw (1/s)",
        "drive direction off, yaw 0 (deg)",
        "any yaw (deg)",
        "drive strength, any yaw",
        "slip limit over static μN, any yaw",
        "falls (1/s)",
    ]
    body, exact, note = [], None, ""
    for r in rows:
        if "task" in r:
            t = r["task"]
            note = (
                f"The task in NumPy differs from ours by {t['observation']:.1g} in an observation and "
                f"{t['reward']:.1g} in a reward, and disagrees on {t['falls_disagreeing']} falls, over 3840 steps with "
                f"{t['falls']} falls.\n"
            )
        if "wheel_load" not in r:
            continue
        exact = r
        body.append(
            [
                label(r["engine"]),
                f"{min(r['wheel_load']):.3f} … {max(r['wheel_load']):.3f}",
                _range(r["growth_yaw_0"], 4),
                _range(r["growth_all_yaws"], 4),
                f"{r['drive_direction_error_yaw_0_deg']:.2f}",
                f"{r['drive_direction_error_all_yaws_deg']:.2f}",
                _range(r["drive_strength_all_yaws"], 3),
                "no slip" if r["engine"] == "ours:spatial" else _range(r["slip_limit_all_yaws"], 3),
                f"{r['falls_per_second']:.2f}",
            ]
        )
    text = "## Is it a ballbot\n\n"
    if exact:
        text += (
            f"Exact: {exact['exact_wheel_load']:.4f} N a wheel, a small tilt that grows at "
            f"{exact['exact_growth']:.4f} 1/s, direction off by 0, strength and slip limit 1. Ranges run over "
            "directions of tilt, wheels and, where stated, headings. Direction and strength are the ball's motion "
            "when one wheel is driven, compared with `spatial`, which has no slip, hence no limit. Falls are counted "
            "for one robot under the actions of the throughput.\n\n" + _table(head, body)
        )
    text += (
        "\nStock MuJoCo lays a contact's friction directions by the normal and the world's axes, not by the wheel: "
        "beyond some degrees of yaw the wheels hold where they should roll and roll where they should drive. Bullet "
        "splits a wheel's friction over two rows, both along its drive, which together slip at a limit that varies "
        "with the heading. MuJoCo's convex contacts let the load grow with the slip, so that slipping wheels hop. The "
        "falls here, and all rates except for the larger actions, are at torques of at most half of the smallest "
        "torque at which a wheel slips.\n\n"
    )
    return text + note + _absent(rows, "engine")


def _scaling(rows: Rows) -> str:
    text = "## How the cost grows\n\nEnvironment steps per second, and time of a physics step of one robot.\n\n"
    for model in dict.fromkeys(r["model"] for r in rows):
        for axis in dict.fromkeys(r["axis"] for r in rows):
            at = [r for r in rows if r["model"] == model and r["axis"] == axis]
            fixed = ", ".join(
                f"{at[0][k]} {k if at[0][k] > 1 else k[:-1]}" for k in ("robots", "substeps", "threads") if k != axis
            )
            body = [
                [
                    str(r[axis]),
                    *_rate(r),
                    f"{1e9 / (r['median'] * r['substeps']):,.0f}",
                ]
                for r in at
            ]
            text += f"`{model}`, {fixed}:\n\n{_table([axis, 'median', 'min', 'max', 'ns'], body)}\n"
    return text


def _memory(rows: Rows) -> str:
    body = [
        [label(r["simulator"]), str(r["robots"]), f"{r['bytes_per_robot'] / 1024:,.1f}"]
        for r in rows
        if "reason" not in r
    ]
    text = "## Memory\n\nGrowth of the resident set of a process over that many environments, after a step.\n\n"
    return text + _table(["simulator", "robots", "KiB a robot"], body) + "\n" + _absent(rows)


def summary(throughput: Rows) -> str:
    """One line per simulator, for the terminal."""
    rows = sorted(strongest(throughput, "environment", 1), key=lambda r: -float(r["median"]))
    return "\n".join(f"{label(r['simulator']):36} {r['median']:>12,.0f} environment steps/s on one core" for r in rows)
