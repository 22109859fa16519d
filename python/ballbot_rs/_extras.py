"""Optional dependencies."""

import contextlib
from collections.abc import Iterator
from pathlib import Path


def install_hint(*extras: str) -> str:
    """The command that installs optional dependencies, for a clone of the repository or an installed package."""
    listed = ",".join(extras)
    clone = Path(__file__).resolve().parents[2]
    if (clone / "pyproject.toml").is_file():
        return f"pip install -e '{'.' if Path.cwd() == clone else clone}[{listed}]'"
    return f"pip install 'ballbot-rs[{listed}]'"


@contextlib.contextmanager
def require(feature: str, *extras: str) -> Iterator[None]:
    """A context for the imports of a feature.

    Raises:
        ModuleNotFoundError: an import within it failed; the message has the command that installs the extras.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        missing = (error.name or "more packages").split(".")[0]
        if missing == "ballbot_rs":
            raise
        raise ModuleNotFoundError(
            f"{feature} needs {missing}: install it with `{install_hint(*extras)}`", name=error.name
        ) from error
