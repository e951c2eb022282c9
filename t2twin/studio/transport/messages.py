"""The messages that a page may send, checked before viser reads them.

viser's own reading trusts its page: it sets any attribute of a control to any value, and an error
ends in a traceback. What is not in the form below is refused here in one sentence.
"""

import math
from typing import Annotated, Any, Literal

import msgspec
import viser
from msgspec import Meta

from t2twin.core.errors import T2TwinError
from t2twin.core.records import convert

MAX_PX = 100_000
"""Largest side of a page's view, pixels (assumed)."""

MAX_PARTS = 512
"""Most parts of an upload: viser's page sends 512 KiB in each, so 64 MB take 123."""

TOLERANCE = 1e-6
"""How far a slider's value may lie off its range, in parts of it: a page rounds."""

Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
"""Finite, as comparisons with NaN fail. Bounds assumed: a scene is 100 mm wide."""

Pixels = Annotated[int, Meta(ge=1, le=MAX_PX)]
Name = Annotated[str, Meta(max_length=200)]
Content = Annotated[str, Meta(max_length=10_000)]
Vector = tuple[Number, Number, Number]


class _Message(msgspec.Struct, forbid_unknown_fields=True):
    type: str


class ViewerCameraMessage(_Message):
    """Where the page's camera stands."""

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
    """A control's new value; `check_update` checks it."""

    uuid: Name
    updates: dict[Name, Any]


class SceneNodeDragMessage(_Message):
    """A step of a drag of the shape."""

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
    """A file is about to come."""

    source_component_uuid: Name
    transfer_uuid: Name
    filename: Content
    mime_type: Name
    part_count: Annotated[int, Meta(ge=0)]
    size_bytes: Annotated[int, Meta(ge=0)]


class FileTransferPart(_Message):
    """A part of it."""

    source_component_uuid: Name
    transfer_uuid: Name
    part_index: Annotated[int, Meta(ge=0, lt=MAX_PARTS)]
    content: bytes


class LocalStorageGetItemResponseMessage(_Message):
    """What the browser keeps under a name."""

    value: Content | None
    error: Content | None
    request_uuid: Name


KINDS: dict[str, type[_Message]] = {
    kind.__name__: kind
    for kind in (
        ViewerCameraMessage,
        GuiUpdateMessage,
        SceneNodeDragMessage,
        FileTransferStartUpload,
        FileTransferPart,
        LocalStorageGetItemResponseMessage,
    )
}
"""What the studio's page has reason to send."""


def read_message(raw: bytes | str) -> _Message:
    """A message as it came. Raises T2TwinError where it is none of KINDS."""
    if isinstance(raw, str):
        raise T2TwinError("it is text; expected MessagePack")
    try:
        content = msgspec.msgpack.decode(raw)
    except (msgspec.DecodeError, ValueError, RecursionError):
        raise T2TwinError("it is not MessagePack") from None
    name = content.get("type") if isinstance(content, dict) else None
    kind = KINDS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise T2TwinError(f"its type is {str(name)[:40]!r}; expected one of {', '.join(KINDS)}")
    return convert(content, kind, kind.__name__)


def check_update(gui: viser.GuiApi, message: GuiUpdateMessage) -> None:
    """Raises T2TwinError unless the message gives a control of `gui` a value that it can have.

    A control that is not there is none of the page's any more, and viser ignores it.
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
        raise T2TwinError(f"{label!r} takes no value")


def _check_number(
    value: Any, low: float | None, high: float | None, whole: bool, label: str
) -> None:
    low, high = (-math.inf if low is None else low), (math.inf if high is None else high)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise T2TwinError(f"{label!r} is {_short(value)}; expected a finite number")
    if whole and value != int(value):
        raise T2TwinError(f"{label!r} is {_short(value)}; expected a whole number")
    off = TOLERANCE * (high - low) if math.isfinite(high - low) and not whole else 0.0
    if not low - off <= value <= high + off:
        raise T2TwinError(f"{label!r} is {_short(value)}; expected {low:g} to {high:g}")


def _short(value: Any) -> str:
    """A value as a message quotes it."""
    if isinstance(value, str | bytes | list | dict):
        value = value[:40] if isinstance(value, str | bytes) else type(value).__name__
    return repr(value)[:60]
