"""Measures, then writes `docs/benchmark.json` and, from it alone, `docs/benchmark.md` and `docs/benchmark.svg`."""

import argparse
import json
import time
from pathlib import Path
from typing import Any

from validation.benchmarks import actions, chart, comparability, machine, memory, report, scaling, throughput

_PARTS = {
    "throughput": throughput.measure,
    "actions": actions.measure,
    "accuracy": comparability.measure,
    "scaling": scaling.measure,
    "memory": memory.measure,
}


def main() -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(prog="python -m validation.benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer and shorter rounds: about three minutes")
    parser.add_argument("--only", choices=_PARTS, help="one part; the others stay as the JSON has them")
    parser.add_argument("--report", action="store_true", help="measure nothing: report and chart from the JSON")
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[2] / "docs", help="folder (docs)")
    arguments = parser.parse_args()

    arguments.output.mkdir(parents=True, exist_ok=True)
    path = arguments.output / "benchmark.json"
    found: dict[str, Any] = {}
    if path.exists() and (arguments.only or arguments.report):
        found = json.loads(path.read_text(encoding="utf-8"))
    if not arguments.report:
        start = time.monotonic()
        command = "python -m validation.benchmarks" + (" --quick" if arguments.quick else "")
        described = machine.describe(command + (f" --only {arguments.only}" if arguments.only else ""))
        for name, measure in _PARTS.items():
            if arguments.only in (None, name):
                found[name] = measure(arguments.quick)
                # A part that is measured separately may be from another day or machine than the rest.
                found.setdefault("measured", {})[name] = f"`{described['command']}`, {described['date']}"
        found["machine"] = described
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        print(f"measured in {time.monotonic() - start:.0f} s", flush=True)
    elif not found:
        parser.error(f"there is no {path} to report on")

    (arguments.output / "benchmark.md").write_text(report.markdown(found), encoding="utf-8")
    if "throughput" in found:
        print(report.summary(found["throughput"]))
        try:
            chart.draw(found["throughput"], arguments.output / "benchmark.svg")
        except ImportError as error:
            print(f"no chart: {error}")
    print(f"report: {arguments.output / 'benchmark.md'}")


if __name__ == "__main__":
    main()
