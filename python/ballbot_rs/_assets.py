"""The data that ships with the package: URDFs, their meshes and a trained policy."""

from pathlib import Path

_PACKAGE = Path(__file__).parent
_REPOSITORY = _PACKAGE.parents[1]


def path(name: str) -> Path:
    """Path of a file such as "bot.urdf" or "policies/balance.onnx": in `assets/` of a clone, else inside the package.

    Raises:
        FileNotFoundError: no such file ships with the package.
    """
    # Files of a clone come first: an editable installation may keep copies of older files.
    clone = _REPOSITORY / "assets"
    folder = clone if (_REPOSITORY / "pyproject.toml").is_file() and clone.is_dir() else _PACKAGE / "assets"
    found = folder / name
    if not found.exists():
        raise FileNotFoundError(f"no file {name!r} ships with ballbot-rs: {found} does not exist")
    return found
