"""A law in C, called through a function pointer for all robots at once."""

import ctypes
import sys
from collections.abc import Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from ballbot_rs._checks import check_real
from ballbot_rs._errors import InvalidInputError
from ballbot_rs._keywords import named
from ballbot_rs._reading import open_regular
from ballbot_rs._state_rows import BALL_POSITION, BALL_RATE, BALL_VELOCITY, BODY_QUATERNION, BODY_RATE, WHEEL_SPEEDS
from ballbot_rs.control.setpoints import PARTS
from ballbot_rs.deployment.compiled import pointer

Array = npt.NDArray[np.float64]

#: Columns of `State.to_array` in the order of `ballbot_state`.
STATE: Final = np.r_[
    BODY_QUATERNION, BODY_RATE, BALL_POSITION.start : 2, BALL_VELOCITY.start : 9, BALL_RATE, WHEEL_SPEEDS
]

#: First numbers of parts in `ballbot_setpoint`, which also has a tilt, and how many numbers it has.
SETPOINT: Final = {"position": 0, "velocity": 2, "yaw": 4, "acceleration": 7, "jerk": 9, "snap": 11, "yaw_rate": 13}
SETPOINT_LEN: Final = 14


@named
class NativeLaw:
    """A law in C, usable wherever a law is: one call for all robots at each control step.

    ```python
    import pathlib, subprocess

    body = "{ for (int i = 0; i < 3 * count; i++) torques[i] = 0.0; }"
    arguments = "int count, const void *states, const void *setpoints, double *torques, void *memory"
    pathlib.Path("law.c").write_text(f"void law({arguments}) {body}")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", "law.so", "law.c"], check=True)
    print(bb.simulate(bb.NativeLaw("law.so"), robot="kugle", seconds=1.0))
    ```

    With the structs of a header of `ballbot export --controller`, in double precision, the library has the function

    ```c
    void law(int count, const ballbot_state *states, const ballbot_setpoint *setpoints, double *torques, void *memory);
    ```

    which writes three wheel torques for each of `count` robots, N·m, limited afterwards like any law's. A law with
    memory also has `int law_memory(void)`, the bytes of one robot, and may have `void law_reset(void *memory)`, which
    begins an episode of one robot; else the memory is zero then. docs/deployment.md has a program.

    The library runs in this process: writing beyond its arrays can crash it.

    Args:
        library: path of a shared library, or a `ctypes.CDLL`.
        symbol: name of the function; the others are named after it.
        control_dt: time between two calls, s; None is the task's.

    Raises:
        OSError: the library cannot be loaded.
        ValueError: it is not a regular file, it has no such function, or `control_dt` is not above 0.
    """

    batched = True

    def __init__(
        self, library: str | PathLike[str] | ctypes.CDLL, symbol: str = "law", control_dt: float | None = None
    ) -> None:
        self._library: Any = library if isinstance(library, ctypes.CDLL) else _loaded(Path(fspath(library)))
        if control_dt is not None and not check_real("control_dt", control_dt) > 0.0:
            raise InvalidInputError(f"control_dt = {control_dt} is out of range: it must be above 0")
        self.name = symbol
        self.control_dt = control_dt
        self._step = self._function(symbol)
        if self._step is None:
            raise InvalidInputError(f"{self._library._name} has no function '{symbol}'")
        self._step.argtypes = [ctypes.c_int, *[ctypes.POINTER(ctypes.c_double)] * 3, ctypes.c_void_p]
        self._step.restype = None
        self._begin = self._function(f"{symbol}_reset")
        if self._begin is not None:
            self._begin.argtypes, self._begin.restype = [ctypes.c_void_p], None
        size = self._function(f"{symbol}_memory")
        self._size = 0 if size is None else int(size())
        if self._size < 0:
            raise InvalidInputError(f"{symbol}_memory() returned {self._size} bytes: it must be at least 0")
        self._memory = np.zeros((0, self._size), dtype=np.uint8)

    def _function(self, name: str) -> Any:
        # Not an attribute of the library, which would share its types.
        try:
            return self._library[name]
        except AttributeError:
            return None

    def __deepcopy__(self, _: dict[int, Any]) -> "NativeLaw":
        copied = NativeLaw(self._library, self.name, self.control_dt)
        copied._memory = self._memory.copy()
        return copied

    def reset(self, mask: npt.NDArray[np.bool_]) -> None:
        """Clears the memory of some robots, shape (n,)."""
        if len(self._memory) != len(mask):
            self._memory = np.zeros((len(mask), self._size), dtype=np.uint8)
        self._memory[mask] = 0
        if self._begin is not None:
            for robot in np.flatnonzero(mask).tolist():
                self._begin(self._memory.ctypes.data + robot * self._size)

    def __call__(self, states: Array, setpoints: Mapping[str, npt.ArrayLike]) -> Array:
        """Wheel torques, shape (n, 3), N·m, for rows as `State.to_array`, shape (n, 32), and parts of setpoints."""
        count = len(states)
        if len(self._memory) != count:
            self.reset(np.ones(count, dtype=bool))
        given = np.zeros((count, SETPOINT_LEN))
        for part, first in SETPOINT.items():
            if part in setpoints:
                given[:, first : first + PARTS[part]] = np.reshape(setpoints[part], (count, PARTS[part]))
        rows = np.ascontiguousarray(np.asarray(states, dtype=np.float64)[:, STATE])
        torques = np.zeros((count, 3))
        self._step(count, pointer(rows), pointer(given), pointer(torques), self._memory.ctypes.data)
        return torques


def _loaded(path: Path) -> ctypes.CDLL:
    # The loader would wait for a pipe for ever.
    try:
        open_regular(path, sys.maxsize).close()
    except ValueError as error:
        raise InvalidInputError(str(error)) from error
    return ctypes.CDLL(str(path.resolve()))
