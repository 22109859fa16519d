"""The `ballbot` command as `python -m ballbot_rs`."""

import sys

from ballbot_rs.cli import run

sys.exit(run())
