"""Long commands in lines that fit the page: broken before options, with comments on separate lines."""

import re
from typing import Final

#: Characters that fit the column of the text.
WIDTH: Final = 88

_BLOCK: Final = re.compile(r"^```sh\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


def wrapped(text: str) -> str:
    """A page with the long lines of its blocks for the shell broken."""
    return _BLOCK.sub(lambda found: f"```sh\n{''.join(map(_line, found[1].splitlines()))}```", text)


def _line(line: str) -> str:
    if len(line) <= WIDTH or line.startswith("#"):
        return f"{line}\n"
    command, hash_, comment = line.partition("  # ")
    above = f"# {comment}\n" if hash_ else ""
    parts = _parts(command.rstrip()) if len(command.rstrip()) > WIDTH else [command.rstrip()]
    return above + " \\\n    ".join(parts) + "\n"


def _parts(command: str) -> list[str]:
    """The pieces of a command that begin with an option, as many in a line as fit."""
    lines = [""]
    # Quoted texts stay whole.
    for piece in re.findall(r"""(?:"[^"]*"|'[^']*'|\S| (?!-[a-z-]))+""", command):
        if lines[-1] and len(lines[-1]) + len(piece) > WIDTH - 6:
            lines.append(piece)
        else:
            lines[-1] = f"{lines[-1]} {piece}".strip()
    return lines
