"""Which engines are there."""

import importlib


def missing(package: str) -> str | None:
    """Why a package cannot be used, or None."""
    try:
        importlib.import_module(package)
    except Exception as error:  # a broken wheel raises what it likes
        return f"not available: {error}"
    return None
