"""The `ballbot` command in this process."""

import json

from ballbot_rs.cli import main


def parse_json(text):
    """JSON as other languages read it: NaN and Infinity are not numbers."""

    def refuse(constant):
        raise AssertionError(f"{constant} in the JSON output")

    return json.loads(text, parse_constant=refuse)


def run(capsys, *arguments):
    """Exit code, standard output and standard error of the command."""
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as exit_:
        code = exit_.code
    captured = capsys.readouterr()
    return code, captured.out, captured.err
