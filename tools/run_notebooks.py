"""Runs the notebooks of `examples/`, each in an empty folder, and updates their output.

`python tools/run_notebooks.py`.
"""

import tempfile
from pathlib import Path

import nbclient
import nbformat

EXAMPLES = Path(__file__).parents[1] / "examples"


def executed(path: Path, changes: dict[str, str] | None = None) -> nbformat.NotebookNode:
    """A notebook with the output of all its cells.

    Args:
        path: the notebook.
        changes: replacement texts of its cells, by the text to replace.

    Raises:
        nbclient.exceptions.CellExecutionError: a cell failed.
    """
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        for before, after in (changes or {}).items():
            cell.source = cell.source.replace(before, after)
    with tempfile.TemporaryDirectory() as folder:
        resources = {"metadata": {"path": folder}}
        nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    # Timestamps and versions would differ in every run.
    notebook.metadata.get("language_info", {}).pop("version", None)
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
    return notebook


if __name__ == "__main__":
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        nbformat.write(executed(path), path)
        print(f"wrote {path} ({path.stat().st_size / 1024:.0f} KiB)")
