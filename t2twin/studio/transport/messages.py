"""Schemas of the messages that a page may send, checked before viser reads them.

viser trusts its page: it sets any attribute of a control to any value, and an error causes a
traceback. Messages that do not match a schema are refused.
"""

import math
from typing import Annotated, Any, Literal

import msgspec
import viser
from msgspec import Meta

from t2twin.core.errors import T2TwinError
from t2twin.core.records import convert

MAX_PX = 100_000
"""Maximum width and height of a page, pixels (assumed)."""

MAX_PARTS = 512
"""Maximum number of parts of an upload: a page sends 512 KiB in each, so 64 MB require 123."""

TOLERANCE = 1e-6
"""Tolerance of a slider's range, relative to its width, because a page rounds values."""

Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
"""A finite number: comparisons with NaN fail. Bounds assumed: a scene is 100 mm wide."""

Pixels = Annotated[int, Meta(ge=1, le=MAX_PX)]
Name = Annotated[str, Meta(max_length=200)]
Content = Annotated[str, Meta(max_length=10_000)]
Vector = tuple[Number, Number, Number]


class _Message(msgspec.Struct, forbid_unknown_fields=True):
    type: str


class ViewerCameraMessage(_Message):
    """Pose of the page's camera."""

    wxyz: tuple[Number, Number, Number, Number]
    position: Vector
    fov: Number
    near: Number
    far: Number
    image_height: Pixels
    image_width: Pixels
    look_at: Vector
    up_direction: Vector


class GuiUpdateMessage(_Message):
    """New value of a control, checked by `check_update`."""

    uuid: Name
    updates: dict[Name, Any]


class SceneNodeDragMessage(_Message):
    """One step of a drag of the shape."""

    phase: Literal["start", "update", "end"]
    name: Name
    instance_index: int | None
    start_position: Vector
    start_screen_pos: tuple[Number, Number]
    end_position: Vector
    end_screen_pos: tuple[Number, Number]
    button: Literal["left", "middle", "right"]
    modifier: Name | None
    owner: Name = ""


class FileTransferStartUpload(_Message):
    """Start of an upload."""

    source_component_uuid: Name
    transfer_uuid: Name
    filename: Content
    mime_type: Name
    part_count: Annotated[int, Meta(ge=0)]
    size_bytes: Annotated[int, Meta(ge=0)]


class FileTransferPart(_Message):
    """Part of an upload."""

    source_component_uuid: Name
    transfer_uuid: Name
    part_index: Annotated[int, Meta(ge=0, lt=MAX_PARTS)]
    content: bytes


MESSAGE_TYPES: dict[str, type[_Message]] = {
    kind.__name__: kind
    for kind in (
        ViewerCameraMessage,
        GuiUpdateMessage,
        SceneNodeDragMessage,
        FileTransferStartUpload,
        FileTransferPart,
    )
}
"""Messages that the studio's page sends, by name."""


def read_message(raw: bytes | str) -> _Message:
    """Decodes a message. Raises T2TwinError if it is not one of MESSAGE_TYPES."""
    if isinstance(raw, str):
        raise T2TwinError("it is text; expected MessagePack")
    try:
        content = msgspec.msgpack.decode(raw)
    except (msgspec.DecodeError, ValueError, RecursionError):
        raise T2TwinError("it is not MessagePack") from None
    name = content.get("type") if isinstance(content, dict) else None
    kind = MESSAGE_TYPES.get(name) if isinstance(name, str) else None
    if kind is None:
        expected = ", ".join(MESSAGE_TYPES)
        raise T2TwinError(f"its type is {str(name)[:40]!r}; expected one of {expected}")
    return convert(content, kind, kind.__name__)


def check_update(gui: viser.GuiApi, message: GuiUpdateMessage) -> None:
    """Raises T2TwinError unless a control accepts the value of the message.

    viser ignores messages to controls that no longer exist.
    """
    control = gui._gui_input_handle_from_uuid.get(message.uuid)
    if control is None:
        return
    if list(message.updates) != ["value"]:
        raise T2TwinError(f"it sets {', '.join(message.updates)[:80]!r}; expected 'value'")
    value, label = message.updates["value"], getattr(control, "label", "a control")
    if isinstance(control, viser.GuiCheckboxHandle | viser.GuiButtonHandle):
        if not isinstance(value, bool):
            raise T2TwinError(f"{label!r} is {_short(value)}; expected true or false")
    elif isinstance(control, viser.GuiDropdownHandle):
        if value not in control.options:
            raise T2TwinError(f"{label!r} is {_short(value)}; expected one of its options")
    elif isinstance(control, viser.GuiSliderHandle | viser.GuiNumberHandle):
        _check_number(value, control.min, control.max, isinstance(control.value, int), label)
    else:
        raise T2TwinError(f"{label!r} accepts no value")


def _check_number(
    value: Any, low: float | None, high: float | None, whole: bool, label: str
) -> None:
    low, high = (-math.inf if low is None else low), (math.inf if high is None else high)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise T2TwinError(f"{label!r} is {_short(value)}; expected a finite number")
    if whole and value != int(value):
        raise T2TwinError(f"{label!r} is {_short(value)}; expected a whole number")
    tolerance = TOLERANCE * (high - low) if math.isfinite(high - low) and not whole else 0.0
    if not low - tolerance <= value <= high + tolerance:
        raise T2TwinError(f"{label!r} is {_short(value)}; expected {low:g} to {high:g}")


def _short(value: Any) -> str:
    """A value for quotation in an error message."""
    if isinstance(value, str | bytes | list | dict):
        value = value[:40] if isinstance(value, str | bytes) else type(value).__name__
    return repr(value)[:60]
