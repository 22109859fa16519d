"""Paths of the repository's files."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
ASSETS = ROOT / "assets"
ROBOTS = ROOT / "crates" / "ballbot-base" / "robots"
