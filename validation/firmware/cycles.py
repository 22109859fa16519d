"""Cycles per instruction of a control step: what QEMU executes, by the times of instructions in the core's manual."""

import re
import subprocess
from pathlib import Path
from typing import Final

from validation.firmware import episode, qemu

#: Steps that are executed one instruction at a time, of which the last counts.
_STEPS: Final = 3

#: Fewest and most cycles by the name of an instruction, by Arm's Cortex-M4 Technical Reference Manual (100166): single
#: loads and stores take 2, and 1 in a row; a division depends on its numbers; IT may be folded. All others take 1.
_TIMES: Final = (
    (r"[su]div", 2, 12),
    (r"v(div|sqrt)", 14, 14),
    (r"v(fn?m|n?ml)[as]", 3, 3),
    (r"(ldr|str)d", 3, 3),
    (r"v(ldr|str)", 2, 3),
    (r"ldr|str", 1, 2),
    (r"it[te]{0,3}$", 0, 1),
)
#: These take 1 and as many as they have registers.
_MULTIPLE: Final = re.compile(r"v?(push|pop|ldm|stm)")
#: Cycles that refill the pipeline after a branch is taken.
_REFILL: Final = (1, 3)

_INSTRUCTION: Final = re.compile(r"^\s*([0-9a-f]+):\t(\S+)\s*(.*)", re.MULTILINE)
_SYMBOL: Final = re.compile(r"^([0-9a-f]+) <(\w+)>:", re.MULTILINE)
_EXECUTED: Final = re.compile(r"\[[0-9a-f]+/([0-9a-f]+)/")
_NUMBERS: Final = {"sl": 10, "fp": 11, "ip": 12, "sp": 13, "lr": 14, "pc": 15}


def per_instruction(elf: Path, board: str, controller: str, sensors: Path, folder: Path) -> tuple[float, float]:
    """Fewest and most cycles per instruction of estimator and controller, without wait states of the memory."""
    disassembled = _tool("arm-none-eabi-objdump", "--disassemble", "--no-show-raw-insn", str(elf))
    code = {int(address, 16): (name, operands) for address, name, operands in _INSTRUCTION.findall(disassembled)}
    symbols = {name: int(address, 16) for address, name in _SYMBOL.findall(disassembled)}
    following = dict(zip(sorted(code), sorted(code)[1:], strict=False))
    log = folder / "executed.log"
    episode.run(controller, qemu.address(elf, board, executed=log), _STEPS * episode.CONTROL_DT, sensors=sensors)
    executed = [int(address, 16) for address in _EXECUTED.findall(log.read_text(encoding="ascii"))]
    begins = [i for i, address in enumerate(executed) if address == symbols["estimator_update"]][_STEPS - 1]
    ends = executed.index(symbols["board_send"], begins)
    fewest = most = 0
    for address, then in zip(executed[begins:ends], executed[begins + 1 : ends + 1], strict=True):
        low, high = _times(*code[address])
        if then != following[address]:
            low, high = low + _REFILL[0], high + _REFILL[1]
        fewest, most = fewest + low, most + high
    return fewest / (ends - begins), most / (ends - begins)


def _times(name: str, operands: str) -> tuple[int, int]:
    if _MULTIPLE.match(name):
        count = 1 + _registers(operands)
        return count, count
    return next(((low, high) for pattern, low, high in _TIMES if re.match(pattern, name)), (1, 1))


def _registers(operands: str) -> int:
    """How many words a list of registers has, as `{r4, r6-r8, lr}`."""
    count = 0
    for part in operands[operands.index("{") + 1 : operands.index("}")].split(", "):
        first, last = (_NUMBERS.get(end) or int(end[1:]) for end in (part.split("-") * 2)[:2])
        count += (last - first + 1) * (2 if part.startswith("d") else 1)
    return count


def _tool(*words: str) -> str:
    return subprocess.run(words, capture_output=True, text=True, timeout=60.0, check=True).stdout
