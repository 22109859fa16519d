"""Which engines are installed."""

import importlib


def missing(package: str) -> str | None:
    """Why a package cannot be used, or None."""
    try:
        importlib.import_module(package)
    except ImportError as error:
        return f"not available: {error}"
    return None
