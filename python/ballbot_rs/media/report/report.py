"""The report of a training run, from its folder to the file."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ballbot_rs import _files
from ballbot_rs._extras import require
from ballbot_rs._progress import Progress, no_progress
from ballbot_rs._text_table import legend, rows
from ballbot_rs.analysis import recovery_map as recovery
from ballbot_rs.analysis.conditions import baselines
from ballbot_rs.analysis.episodes import compare
from ballbot_rs.analysis.pushes import Push
from ballbot_rs.analysis.result import Result
from ballbot_rs.analysis.simulate import simulate
from ballbot_rs.analysis.trajectory import Trajectory
from ballbot_rs.control.resolve import ResolvedController, find, options_of
from ballbot_rs.envs.family import first_of
from ballbot_rs.envs.registration import description_of, task_of
from ballbot_rs.media.figures.labels import short
from ballbot_rs.media.report import origin, page
from ballbot_rs.media.video import renderer_for, write_video
from ballbot_rs.training import config as config_module
from ballbot_rs.training import curve, run_folder

#: In the video and the trajectories a robot is released at a tilt (rad), then pushed (N·s, s).
TILT, PUSH = (0.08, 0.05), Push((0.3, 0.1, 0.0), 1.5)
#: Length of the trajectories, s.
SECONDS = 4.0
#: Meaning of the arrows of the contact forces.
ARROWS = "Arrows: loads (blue) and tractions (green) of the wheels, the force along the ground (red)."


def write(
    folder: Path,
    *,
    target: Path | None = None,
    results: Sequence[Result] | None = None,
    episodes: int = 100,
    video_seconds: float = 4.0,
    progress: Callable[[str], Progress] | None = None,
) -> Path:
    """Writes the report of a run and returns its path, `report.html` in the run unless `target` is given.

    Args:
        folder: the run.
        target: the file.
        results: of the policy and of the controllers it is compared with, if they exist already.
        episodes: number of episodes of each in the comparison, otherwise; 0 omits it.
        video_seconds: length of the video; 0 omits it.
        progress: makes, for the name of a part, a function that is called with the progress of that part.

    Raises:
        FileNotFoundError: the folder has no run, or a run without a policy.
        ValueError: a number out of range, or a file that cannot be read; the message names the file.
        OSError: the file cannot be written; an earlier one stays as it is.
        ModuleNotFoundError: matplotlib or moviepy is not installed.
    """
    with require("a report", "plot", "video"):
        from ballbot_rs.media.figures import learning_curve
    # Not `< 0`, which is false for NaN; the simulation checks the length itself.
    if not video_seconds >= 0.0:
        raise ValueError(f"video_seconds = {video_seconds} is out of range: it must be at least 0")
    if episodes < 0:
        raise ValueError(f"episodes = {episodes} is out of range: it must be at least 0")
    learned = curve.read(folder)
    record = run_folder.read_record(folder)
    task = task_of(config_module.parse(learned.config, str(folder)).env_id)
    policy = _with_one_robot(find(str(folder.resolve()), task=task))
    show = progress or (lambda _: no_progress)
    described = origin.rows(record, folder, task)
    parts = [page.note(f"Training run {folder.resolve().name}, seed {record['seed']}."), page.pairs(described)]
    # First, because it may not be installed.
    if video_seconds > 0:
        parts.append(page.section("The policy at work", *_video(policy, video_seconds, show("rendering"))))
    if results is None and episodes > 0:
        names = [policy.name, *baselines(task)]
        results = compare(names, task=task, episodes=episodes, progress=show("comparing"))
    if results:
        named = [dataclasses.replace(result, controller=short(result.controller)) for result in results]
        table = page.table(rows(named, task))
        count = f"{results[0].episodes} episodes each, the same starts for all, model {results[0].model}."
        parts.append(
            page.section(
                "Comparison with the classical controllers", table, page.note(" ".join([count, *legend(results, task)]))
            )
        )
    parts += [
        page.section(
            "Learning curve",
            page.figure(learning_curve.draw([learned]), "Return and success over environment steps"),
            page.note(f"{learned.returns.shape[1]} episodes an evaluation; band: the best and the worst of them."),
        )
    ]
    # The nominal robot, without samples of events.
    nominal = {name: value for name, value in policy.env_options.items() if name != "events"}
    shown = [
        simulate(
            one, seconds=SECONDS, tilt=TILT, pushes=PUSH, task=task, **{**options_of(one, nominal), "events": None}
        )
        for one in (policy, *map(find, baselines(task)))
    ]
    parts.append(page.section("After a push", *_push(shown)))
    if not description_of(task)["command"]:
        parts.append(_recovery(policy, task, show))
    parts += [
        page.section("Robot", *origin.robot(shown[0].params, nominal)),
        page.section("Configuration", page.code(learned.config)),
        page.section("Versions", page.table([("what", "version"), *_versions(record)])),
    ]
    target = target or folder / "report.html"
    _files.write(target, page.page("Balancing on a ball: a training run", parts))
    return target


def _with_one_robot(policy: ResolvedController) -> ResolvedController:
    """The policy on the first of the robots that it was trained on."""
    options = policy.env_options
    if "robot" not in options:
        return policy
    return dataclasses.replace(policy, env_options={**options, "robot": first_of(options["robot"])})


def _push(shown: Sequence[Trajectory]) -> tuple[str, ...]:
    """The replay of the first trajectory above the curves of all; without viser, the curves."""
    from ballbot_rs.media.figures import trajectories

    released = f"Released at a tilt of {TILT} rad, pushed by {PUSH.impulse} N·s at {PUSH.time} s."
    drawn = trajectories.draw(shown)
    try:
        from ballbot_rs.viewer.replay.recorder import record
    except ModuleNotFoundError:
        # Without the command that installs it, which would name a folder of this machine.
        return page.figure(drawn, trajectories.DESCRIPTION), page.note(f"{released} A replay needs the extra view.")
    # The axes of a figure are in rows, with a column for each trajectory.
    spans = [(0.0, float(one.times[-1])) for one in shown] * (len(drawn.axes) // len(shown))
    return (
        page.replay(record(shown[0], forces=True)),
        page.timed_figure(drawn, trajectories.DESCRIPTION, spans),
        page.note(f"{released} The line in the curves is at the time of the replay, of the policy. {ARROWS}"),
    )


def _recovery(policy: ResolvedController, task: str, show: Callable[[str], Progress]) -> str:
    """The section on the tilts from which robots recover."""
    from ballbot_rs.media.figures import recovery_map

    maps = [
        recovery.collect(
            controller,
            task=task,
            env_options=options_of(controller, policy.env_options),
            progress=show(f"recovery of {controller.name}"),
        )
        for controller in (policy, *map(find, baselines(task)))
    ]
    return page.section(
        "Recovery",
        page.figure(recovery_map.draw(maps), "Polar maps of recovery for each controller"),
        page.note(
            "A robot at rest is released, leaning by the radius towards the angle; 0° is the body's x axis. Torques of "
            "a policy are limited as in its training, torques of a feedback law by the motors."
        ),
    )


def _versions(record: dict[str, Any]) -> list[tuple[str, str]]:
    versions = record.get("versions")
    return [(name, str(version)) for name, version in versions.items()] if isinstance(versions, dict) else []


def _video(policy: Any, seconds: float, progress: Progress) -> tuple[str, str]:
    push = PUSH if seconds > PUSH.time else None
    shown = simulate(policy, seconds=seconds, tilt=TILT, pushes=push or ())
    # Small and plain, so that the report is quick.
    renderer = renderer_for(shown, width=480, height=360, samples=1)
    with _files.scratch_folder() as folder:
        path = folder / "policy.mp4"
        write_video(shown, path, renderer=renderer, frame_rate=25.0, forces=True, progress=progress)
        playing = page.video(path)
    pushed = "" if push is None else f", pushed by {push.impulse} N·s at {push.time} s"
    return playing, page.note(f"Released at a tilt of {TILT} rad{pushed}. {ARROWS} Model {shown.model}.")
