"""Builds the firmware, and runs it in QEMU."""

import shlex
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
SENSORS: Final = Path(__file__).with_name("sensors.toml")
COARSE_SENSORS: Final = Path(__file__).with_name("coarse.toml")

#: In seconds: of a build, and of an answer of QEMU's monitor.
_BUILD: Final = 300.0
_ANSWER: Final = 10.0

_STACK_BEGINS: Final = 0x2000_0000


class Board(NamedTuple):
    """A board in QEMU, and how its counter counts instructions."""

    core: str
    #: An instruction takes 2^shift ns of the board's clock (`-icount`).
    shift: int
    #: Instructions in one count.
    per_count: int
    #: Whether the manual of its core has the times of instructions: one that issues two at once has none.
    has_times: bool


#: By the names of QEMU's machines, which are folders of firmware/boards.
BOARDS: Final = {"netduinoplus2": Board("Cortex-M4F", 0, 1, True), "mps2-an500": Board("Cortex-M7", 3, 5, False)}


class Memory(NamedTuple):
    """Bytes that a build needs."""

    flash: int
    #: Without the stack.
    static: int
    stack_size: int


def missing() -> list[str]:
    """The programs that are not installed."""
    programs = ("make", "arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm")
    return [program for program in programs if shutil.which(program) is None]


def build(folder: Path, **options: object) -> Path:
    """Builds the firmware with variables of its Makefile; returns the path of the ELF file.

    Raises:
        RuntimeError: it does not compile; the message has what was printed.
    """
    variables = {"BALLBOT": f"{shlex.quote(sys.executable)} -m ballbot_rs", "SENSORS": SENSORS, "BUILD": folder}
    chosen = [f"{name}={value}" for name, value in {**variables, **options}.items()]
    command = ["make", "-C", str(ROOT / "firmware"), *chosen]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_BUILD, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{shlex.join(command)}\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    return folder / "firmware.elf"


def memory(elf: Path) -> Memory:
    """What a build needs, by its sections."""
    done = subprocess.run(
        ["arm-none-eabi-size", "-A", elf], capture_output=True, text=True, timeout=_ANSWER, check=True
    )
    rows = (line.split() for line in done.stdout.splitlines())
    sizes = {row[0]: int(row[1]) for row in rows if len(row) == 3 and row[1].isdigit()}
    data, stack = sizes[".data"], sizes[".stack"]
    flash = sizes[".text"] + sizes.get(".ARM.exidx", 0) + data
    return Memory(flash, data + sizes[".bss"], stack)


def address(
    elf: Path, board: str, *, counts: Path | None = None, monitor: Path | None = None, executed: Path | None = None
) -> str:
    """The address of a `Link` to the firmware.

    Args:
        elf: the build.
        board: one of `BOARDS`.
        counts: a file for what the firmware writes to its second port; the board's clock then counts instructions.
        monitor: a socket for `command`.
        executed: a file for the address of each instruction that is executed, 70 bytes each.
    """
    words = ["qemu-system-arm", "-machine", board, "-display", "none", "-kernel", str(elf), "-serial", "stdio"]
    words += ["-serial", "null" if counts is None else f"file:{counts}"]
    words += ["-monitor", "none" if monitor is None else f"unix:{monitor},server=on,wait=off"]
    if counts is not None:
        words += ["-icount", f"shift={BOARDS[board].shift}"]
    if executed is not None:
        words += ["-singlestep", "-d", "exec,nochain", "-D", str(executed)]
    return "exec:" + shlex.join(words)


def command(monitor: Path, text: str) -> None:
    """Gives a command to QEMU's monitor, and waits until it has been carried out."""
    with socket.socket(socket.AF_UNIX) as line:
        line.settimeout(_ANSWER)
        line.connect(str(monitor))
        for sent in (b"", text.encode() + b"\n"):
            line.sendall(sent)
            received = b""
            # It echoes the command, and ends with its prompt.
            while not received.endswith(b"(qemu) "):
                received += line.recv(4096)


def deepest_stack(monitor: Path, size: int, folder: Path) -> int:
    """Bytes of the stack that the running firmware has written, of `size`."""
    dump = folder / "stack.bin"
    command(monitor, f'pmemsave {_STACK_BEGINS:#x} {size} "{dump}"')
    written = dump.read_bytes()
    return len(written.lstrip(b"\0"))
