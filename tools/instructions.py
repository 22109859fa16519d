"""Compares the instruction count of each model with the counts stored in the repository.

Times on a shared machine vary by tens of percent; instruction counts of valgrind are repeatable.
"""

import argparse
import concurrent.futures
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "benches/instructions.json"

ENVS = 64
"""Environments of a batch, as in benches/instructions.rs."""

WORKLOADS = {
    "planar step": ("planar", "step", 200, 1),
    "spatial step": ("spatial", "step", 200, 1),
    "contact step": ("contact", "step", 200, 1),
    "rigid step": ("rigid", "step", 200, 1),
    "contact control step in a batch": ("contact", "batch-step", 20, ENVS),
    "planar reset": ("planar", "reset", 100, 1),
    "spatial reset": ("spatial", "reset", 100, 1),
    "contact reset": ("contact", "reset", 100, 1),
    "rigid reset": ("rigid", "reset", 100, 1),
    "contact reset in a batch": ("contact", "batch-reset", 20, ENVS),
}
"""Counted runs: model, workload, repetitions, and number of concurrent environments."""

TOLERANCE = 0.03
"""Allowed relative growth of a count: repeats differ by far less, and a cost of a few percent is detected."""

SHOWN = "{:<32} {:>12} {:>12} {:>8}"


def fail(message: str) -> None:
    """Ends the program."""
    sys.exit(f"make instructions: {message}")


def output(command: list[str]) -> str:
    """The output of a program, which must succeed."""
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()


def build() -> str:
    """The compiled workloads."""
    command = ["cargo", "bench", "--locked", "--package", "ballbot-benches", "--bench", "instructions", "--no-run"]
    messages = subprocess.run(
        [*command, "--message-format", "json-render-diagnostics"],
        cwd=ROOT,
        check=False,
        stdout=subprocess.PIPE,
        text=True,
    )
    if messages.returncode != 0:
        fail("cargo cannot build the workloads")
    for line in messages.stdout.splitlines():
        message = json.loads(line)
        if message.get("target", {}).get("name") == "instructions" and message.get("executable"):
            return message["executable"]
    return fail("cargo has built no workloads")


def run(program: str, model: str, workload: str, times: int) -> tuple[int, str]:
    """Instructions of a whole run, and the vector instructions that it used."""
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        # The program must not see the caller's environment.
        process = subprocess.run(
            [
                "valgrind",
                "--tool=callgrind",
                f"--log-file={log}",
                "--callgrind-out-file=/dev/null",
                program,
                model,
                workload,
                str(times),
            ],
            env={"PATH": os.environ["PATH"]},
            check=False,
            capture_output=True,
            text=True,
        )
        text = log.read_text() if log.exists() else ""
    if "unhandled instruction" in text:
        fail(f"{output(['valgrind', '--version'])} does not simulate an instruction of the program; 3.24 does")
    if process.returncode != 0:
        fail(f"{model} {workload} has failed under valgrind:\n{process.stderr}{text}")
    totals = [line.split(":")[1] for line in text.splitlines() if "Collected :" in line]
    lanes = [line.split()[1] for line in process.stdout.splitlines() if line.startswith("lanes ")]
    if len(totals) != 1 or len(lanes) != 1:
        fail(f"valgrind's report is not understood:\n{process.stdout}{text}")
    return int(totals[0]), lanes[0]


def measure(program: str) -> tuple[dict[str, int], str]:
    """Instructions of each workload, and the vector instructions used."""

    def cost(workload: tuple[str, str, int, int]) -> tuple[float, str]:
        model, name, times, share = workload
        (without, _), (some, lanes) = (run(program, model, name, n) for n in (0, times))
        return (some - without) / (times * share), lanes

    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        costs = list(pool.map(cost, WORKLOADS.values()))
    return {name: round(cost) for name, (cost, _) in zip(WORKLOADS, costs, strict=True)}, costs[0][1]


def conditions(lanes: str) -> dict[str, str]:
    """What counts depend on in addition to the source."""
    rustc = output([os.environ.get("RUSTC", "rustc"), "--version"])
    flags = os.environ.get("RUSTFLAGS", "")
    return {"rustc": rustc, "rustflags": flags, "machine": platform.machine(), "lanes": lanes}


def main() -> None:
    """Measures, compares, and stores the numbers if requested."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--accept", action="store_true", help="keep what is measured")
    accept = parser.parse_args().accept
    if shutil.which("valgrind") is None:
        fail("valgrind is missing; install it, on Debian and Ubuntu with: sudo apt-get install valgrind")

    counts, lanes = measure(build())
    present = conditions(lanes)
    valgrind = output(["valgrind", "--version"])
    if accept:
        kept = {"tolerance": TOLERANCE, "conditions": present, "valgrind": valgrind, "instructions": counts}
        KEPT.write_text(json.dumps(kept, indent=2) + "\n")
    kept = json.loads(KEPT.read_text())

    limit = 1 + kept["tolerance"]
    grown = []
    print(SHOWN.format("instructions of one", "measured", "kept", "ratio"))
    for name, count in counts.items():
        before = kept["instructions"].get(name)
        if before is None:
            print(SHOWN.format(name, f"{count:,}", "none", ""))
            grown.append(name)
            continue
        print(SHOWN.format(name, f"{count:,}", f"{before:,}", f"{count / before:.3f}"))
        if count > limit * before:
            grown.append(name)
    print(f"with {present['rustc']}, {lanes} in lanes, {valgrind}")

    differing = [key for key, value in present.items() if kept["conditions"].get(key) != value]
    if differing:
        print("\nNOT COMPARABLE: nothing has been checked, since the kept numbers are from elsewhere.")
        for key in differing:
            print(f"  {key}: here '{present[key]}', kept '{kept['conditions'].get(key)}'")
        print("Compare with those, or count the commit before here first: make instructions ACCEPT=1")
    elif grown:
        fail(
            f"more than {100 * kept['tolerance']:g} % above what is kept, or not kept at all: {', '.join(grown)}.\n"
            f"If the change is worth it, state it in its commit, with the numbers of: make instructions ACCEPT=1"
        )


if __name__ == "__main__":
    main()
