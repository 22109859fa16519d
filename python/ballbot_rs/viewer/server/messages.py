"""Messages that a client may send. All others are dropped before viser, which trusts and shares its input.

Otherwise a value that is not finite, or that a control cannot have, would go to all pages, including pages opened
later.
"""

import math
from typing import Annotated, Any, Literal

import msgspec
import viser

#: Largest coordinate, m, and longest text that a client may send.
MAX_COORDINATE = 1e4
MAX_TEXT = 1024

#: Longest message, bytes; the page's own messages have some hundred.
MAX_MESSAGE = 16_384

Number = Annotated[float, msgspec.Meta(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Fraction = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Name = Annotated[str, msgspec.Meta(max_length=256)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]
Place = tuple[Fraction, Fraction]
Index = Annotated[int, msgspec.Meta(ge=0, le=1_000_000)]
Pixels = Annotated[int, msgspec.Meta(ge=1, le=100_000)]


class _Message(msgspec.Struct, tag_field="type", forbid_unknown_fields=True):
    pass


class Camera(_Message, tag="ViewerCameraMessage"):
    """The camera pose of a client."""

    wxyz: Quaternion
    position: Vector
    fov: Annotated[float, msgspec.Meta(gt=0.0, lt=math.pi)]
    near: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
    far: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector


class Control(_Message, tag="GuiUpdateMessage"):
    """A control that was moved, or a button that was pressed."""

    uuid: Name
    updates: dict[Name, Any]


class Click(_Message, tag="SceneNodeClickMessage"):
    """A click on a node of the scene."""

    name: Name
    ray_origin: Vector
    ray_direction: Vector
    screen_pos: Place
    instance_index: Index | None = None
    modifier: Name | None = None
    owner: Name = ""


class Drag(_Message, tag="SceneNodeDragMessage"):
    """A node of the scene that is dragged: the grabbed point, and the pointer."""

    phase: Literal["start", "update", "end"]
    name: Name
    start_position: Vector
    start_screen_pos: tuple[Number, Number]
    end_position: Vector
    end_screen_pos: tuple[Number, Number]
    button: Literal["left", "middle", "right"]
    instance_index: Index | None = None
    modifier: Name | None = None
    owner: Name = ""


_DECODER = msgspec.msgpack.Decoder(Camera | Control | Click | Drag)


def accepted(raw: bytes | str, controls: dict[str, Any]) -> Camera | Control | Click | Drag | None:
    """The message that a client sent; None if it is malformed, unknown to the page, or requests unavailable values.

    Args:
        raw: the received bytes.
        controls: viser's handles of the controls by their identifiers.
    """
    if isinstance(raw, str) or len(raw) > MAX_MESSAGE:
        return None
    try:
        message = _DECODER.decode(raw)
    except (msgspec.MsgspecError, ValueError, RecursionError):
        return None
    if isinstance(message, Control):
        return message if _is_offered(message, controls) else None
    return None if isinstance(message, Camera) and not _looks_somewhere(message) else message


def encoded(message: Camera | Control | Click | Drag) -> bytes:
    """A message in viser's format."""
    return msgspec.msgpack.encode(message)


def _is_offered(message: Control, controls: dict[str, Any]) -> bool:
    control = controls.get(message.uuid)
    if control is None or set(message.updates) != {"value"} or getattr(control, "disabled", False):
        return False
    value = message.updates["value"]
    if isinstance(control, viser.GuiButtonHandle | viser.GuiCheckboxHandle):
        return isinstance(value, bool)
    if isinstance(control, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        return isinstance(value, str) and value in control.options
    if isinstance(control, viser.GuiSliderHandle):
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and bool(control.min <= value <= control.max)
    return isinstance(control, viser.GuiTextHandle) and isinstance(value, str) and len(value) <= MAX_TEXT


def _looks_somewhere(camera: Camera) -> bool:
    """Whether its attitude is valid, and view direction and up direction span a plane."""
    if abs(math.hypot(*camera.wxyz) - 1.0) > 1e-3:
        return False
    (a, b, c), (x, y, z) = (
        [p - q for p, q in zip(camera.look_at, camera.position, strict=True)],
        camera.up_direction,
    )
    cross = math.hypot(b * z - c * y, c * x - a * z, a * y - b * x)
    return cross > 1e-9 * math.hypot(a, b, c) * math.hypot(x, y, z)
