"""Messages that no page of the studio sends: each gives one line, and the studio continues."""

from collections.abc import Iterator
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path
from typing import Any

from attempt import LOCAL
from cases import Base, Case
from studio_client import CAMERA, Client, Target, target

from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.log import BURST

NAN, INF = float("nan"), float("inf")
DRAG = {
    "type": "SceneNodeDragMessage", "phase": "update", "name": "/nothing", "instance_index": None,
    "start_position": [0.0, 0.0, 0.0], "start_screen_pos": [0.5, 0.5], "button": "left",
    "end_position": [1.0, 0.0, 0.0], "end_screen_pos": [0.5, 0.6], "modifier": None, "owner": "",
}  # fmt: skip
UPLOAD = {
    "type": "FileTransferStartUpload", "source_component_uuid": "$Upload a shape",
    "transfer_uuid": "a", "filename": "a.stl", "mime_type": "", "part_count": 2, "size_bytes": 20,
}  # fmt: skip
PART = {"type": "FileTransferPart", "source_component_uuid": "$Upload a shape",
        "transfer_uuid": "never begun", "part_index": 0, "content": b"\0"}  # fmt: skip
UPDATE = {"type": "GuiUpdateMessage", "uuid": "$force, N", "updates": {"value": 5.0}}
GOOD: dict[str, dict[str, Any]] = {
    "camera": CAMERA, "drag": DRAG, "part": PART, "update": UPDATE, "upload": UPLOAD,
}  # fmt: skip
"""Valid messages. A $ and a label stand for the identifier of a control."""

RAW = (
    b"", b"\xc1", b"\x81", b"\x05", b"\xc0", b"\x91\x05", b"\x91" * 100_000, b"\x81\xa1a" * 100_000,
    b"\xdf\xff\xff\xff\xff", b"\xdd\x7f\xff\xff\xff", b"\xdb\xff\xff\xff\xff", b"\xd4\x05\x00",
    b"\x81\xa4type\xa2\xff\xfe", b"\xd6\xff\x00\x00\x00\x00", b"\x81\xa4type\xa1a\x00",
    b"GET / HTTP/1.1\r\n\r\n", bytes(10_000),
)  # fmt: skip
TEXTS = ("", "hello", '{"type": "GuiUpdateMessage"}', "\u202e\x1b[31m")
TYPES = (
    None, 5, "", "Message", "_Message", "object", "__class__", "RunJavascriptMessage",
    "GuiRemoveMessage", "ShareUrlRequest", "ShareUrlDisconnect", "ReplayDoneMessage",
    "ResetGuiMessage", "LocalStorageGetItemResponseMessage", "GetRenderResponseMessage",
    "CommandTriggerMessage", "x" * 5000,
)  # fmt: skip
NUMBERS = (NAN, INF, -INF, 1e308, -1e308, "5", None, True, [5.0], {"a": 5.0})
VALUES: dict[str, tuple[Any, ...]] = {
    **dict.fromkeys(("x, mm", "y, mm", "yaw, °", "force, N", "depth, mm", "friction"), NUMBERS),
    "Markers": (1, None, "on"),
    "Noise": (1, 0.0, "yes", None, [], NAN), "Taxels": ("/etc/passwd", "../cyskin-20", "", None, 3),
    "Kind": (5, None, "no such kind", "/etc/passwd", ["square"], {"a": 1}, True),
    "Motion": ("fly", "", None, 1, ["slide"]), "Lift off and press again": (1, "true", None),
    "Array": ("nothing", "ALL", None, 7), "Shape as": ("wire", None, 1),
    "Seed": (-1, 1.5, 2**60, "1", None, NAN), "Number": (-1, 0.5, 1e300, "17", None),
    "mm per unit": (0.0, -1.0, NAN, INF, "25.4"), "Download this press (zip)": (1, "true", None),
    "Upload a shape": ("a.stl", None, {"name": "a.stl", "content": ""}),
}  # fmt: skip
"""Values that a control cannot have, by its label."""

ATTRIBUTES = ("update_cb", "removed", "props", "uuid", "__class__", "visible", "options", "min")
UPLOADS: tuple[tuple[dict[str, Any], str], ...] = (
    ({"source_component_uuid": "$force, N"}, "accepts no files"), ({"size_bytes": 0}, "parts"),
    ({"source_component_uuid": "x"}, "accepts no files"), ({"part_count": 10**9}, "parts"),
    ({"size_bytes": -1}, "size_bytes"), ({"part_count": 0}, "parts"),
    ({"size_bytes": 2**63, "part_count": 2**63}, ""), ({"filename": "x" * 20_000}, "filename"),
)  # fmt: skip
FINE = (
    *({"uuid": uuid, "updates": {"value": value}} for uuid, value in (
        ("gone", 5.0), ("$Array", "all"), ("$Seed", 3.0), ("$yaw, °", 180))),
)  # fmt: skip


def cases() -> Iterator[Case]:
    for raw in RAW:
        yield _case(f"raw {raw[:9]!r}", raw)
    for text in TEXTS:
        yield _case(f"text {text!r}", text, "it is text")
    for kind in TYPES:
        yield _case(f"type {str(kind)[:20]}", CAMERA | {"type": kind}, "its type is")
    yield _case("no type", {"value": 5}, "its type is")
    for name, good in GOOD.items():
        yield from _fields(name, good)
    for label, values in VALUES.items():
        for value in values:
            message = UPDATE | {"uuid": f"${label}", "updates": {"value": value}}
            yield _case(f"{label}: {str(value)[:20]}", message, label)
    for updates in ({}, *({name: []} for name in ATTRIBUTES),
                    *({"value": 5.0, name: []} for name in ATTRIBUTES)):  # fmt: skip
        yield _case(f"updates {list(updates)}", UPDATE | {"updates": updates}, "expected 'value'")
    for changes, says in UPLOADS:
        yield _case(f"upload: {str(changes)[:40]}", UPLOAD | changes, says)
    for index in (-1, 10**9):
        yield _case(f"part {index}", PART | {"part_index": index}, "part_index")
    large = UPLOAD | {"size_bytes": 65_000_000, "part_count": 124}
    valid = [message for name, message in GOOD.items() if name != "upload"]
    for number, message in enumerate((*valid, *(UPDATE | changes for changes in FINE), large)):
        yield _case(f"valid {number}", message, fine=True)


def _fields(name: str, good: dict[str, Any]) -> Iterator[Case]:
    for field in sorted(set(good) - {"type"}):
        wrong = 5 if field == "updates" else {"a": 1}
        yield _case(f"{name}: wrong {field}", good | {field: wrong}, field)
        if field != "owner":
            rest = {key: value for key, value in good.items() if key != field}
            yield _case(f"{name}: no {field}", rest, f"{field} is missing")
        if isinstance(good[field], list):
            for value in ([NAN] * len(good[field]), []):
                yield _case(f"{name}: {field} {value}", good | {field: value}, field)
    yield _case(f"{name}: unknown field", good | {"more": 1}, "more")


def _case(name: str, message: Any, says: str = "", fine: bool = False) -> Case:
    # The first case starts the studio, which is not part of its duration.
    return Case(name, "", lambda box, base: _prepare(), says, fine, call=partial(_send, message))


def _prepare() -> None:
    """Opens a page. Starts a new studio before the log of the old one suppresses lines."""
    if _clients and len(_studio().lines) >= BURST / 2:
        STACK.close()
        _clients.clear()
        _studio.cache_clear()
    _page()


def _send(message: Any, box: Path, base: Base) -> None:
    """Sends a message. Then the client, or another if it was closed, must be served."""
    studio, client = _page()
    known = len(studio.lines)
    client.send(_filled(message, client) if isinstance(message, dict) else message)
    serves = client.serves()
    if not serves and not client.is_open:
        serves = _page()[1].serves()
    lines = studio.lines[known:]
    if not serves or len(lines) > 1 or any("Traceback" in line for line in lines):
        raise AssertionError(f"served: {serves}; printed: {' | '.join(lines)}")
    if lines:
        raise T2TwinError(lines[0].removeprefix("t2twin: "))


def _filled(message: dict[str, Any], client: Client) -> dict[str, Any]:
    """The message with identifiers of controls."""
    return {
        key: client.controls[value[1:]]["uuid"] if str(value)[:1] == "$" else value
        for key, value in message.items()
    }


@cache
def _studio() -> Target:
    return STACK.enter_context(target())


STACK = ExitStack()
"""Ends the studio; to be closed after the last case."""

_clients: list[Client] = []


def _page() -> tuple[Target, Client]:
    """The studio, and an open page of it."""
    if not _clients or not _clients[-1].is_open:
        LOCAL.add(int(_studio().address.rsplit(":", 1)[1]))
        _clients.append(Client(_studio().address).open_page())
    return _studio(), _clients[-1]
