"""The policies that ship with the package, by name."""

from pathlib import Path

from ballbot_rs import _assets


def shipped() -> dict[str, Path]:
    """Their files, by the names of the files without suffix."""
    return {path.stem: path for path in sorted(_assets.path("policies").glob("*.onnx"))}


def shipped_name(controller: str) -> str | None:
    """Name of the shipped policy at the path of a controller; None for another controller."""
    if not controller.endswith(".onnx"):
        return None
    return next((name for name, path in shipped().items() if Path(controller).resolve() == path.resolve()), None)
