"""Messages that no page of the studio sends: one line each, and the studio goes on."""

import atexit
import json
import subprocess
import sys
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

from benchmarks import ROOT
from benchmarks.inputs.case import Base, Case
from benchmarks.studio_client import CAMERA
from t2twin.core.errors import T2TwinError

DRAG = {
    "type": "SceneNodeDragMessage",
    "phase": "update",
    "name": "/nothing",
    "instance_index": None,
    "start_position": [0.0, 0.0, 0.0],
    "start_screen_pos": [0.5, 0.5],
    "end_position": [1.0, 0.0, 0.0],
    "end_screen_pos": [0.5, 0.6],
    "button": "left",
    "modifier": None,
    "owner": "",
}
UPLOAD = {
    "type": "FileTransferStartUpload",
    "source_component_uuid": {"$uuid": "Upload a shape"},
    "transfer_uuid": "a",
    "filename": "a.stl",
    "mime_type": "",
    "part_count": 2,
    "size_bytes": 20,
}
PART = {
    "type": "FileTransferPart",
    "source_component_uuid": {"$uuid": "Upload a shape"},
    "transfer_uuid": "never begun",
    "part_index": 0,
    "content": {"$hex": "00"},
}
KEPT = {
    "type": "LocalStorageGetItemResponseMessage",
    "value": None,
    "error": None,
    "request_uuid": "a",
}
UPDATE = {
    "type": "GuiUpdateMessage",
    "uuid": {"$uuid": "force, N"},
    "updates": {"value": 5.0},
}
"""One message of each kind as a page sends it."""

GOOD = {"camera": CAMERA, "drag": DRAG, "part": PART, "kept": KEPT, "update": UPDATE}
OPTIONAL = ("owner",)

RAW = {
    "nothing": b"",
    "a byte that is none": b"\xc1",
    "a map cut short": b"\x81",
    "a number": b"\x05",
    "nothing but null": b"\xc0",
    "a list": b"\x91\x05",
    "nested lists": b"\x91" * 100_000,
    "nested maps": b"\x81\xa1a" * 100_000,
    "a map of 4 billion": b"\xdf\xff\xff\xff\xff",
    "a list of 2 billion": b"\xdd\x7f\xff\xff\xff",
    "text of 4 billion": b"\xdb\xff\xff\xff\xff",
    "text that is no UTF-8": b"\x81\xa4type\xa2\xff\xfe",
    "an extension": b"\xd4\x05\x00",
    "a time": b"\xd6\xff\x00\x00\x00\x00",
    "something after it": b"\x81\xa4type\xa1a\x00",
    "HTTP": b"GET / HTTP/1.1\r\n\r\n",
    "zeros": bytes(10_000),
}
TEXTS = ("", "hello", '{"type": "GuiUpdateMessage"}', "\u202e\x1b[31m")

TYPES = (
    None, 5, "", "Message", "_Message", "object", "__class__", "RunJavascriptMessage",
    "GuiRemoveMessage", "ShareUrlRequest", "ShareUrlDisconnect", "ReplayDoneMessage",
    "ResetGuiMessage", "GetRenderResponseMessage", "CommandTriggerMessage", "x" * 5000,
)  # fmt: skip

SLIDERS = ("x, mm", "y, mm", "yaw, °", "force, N", "depth, mm")
NUMBERS = (
    float("nan"), float("inf"), -float("inf"), 1e308, -1e308, "5", None, True, [5.0], {"a": 5.0},
)  # fmt: skip
VALUES = {
    "Noise": (1, 0.0, "yes", None, [], float("nan")),
    "Kind": (5, None, "no such kind", "/etc/passwd", ["square"], {"a": 1}, True),
    "Taxels": ("/etc/passwd", "../layouts/cyskin-20", "", None, 3),
    "Array": ("nothing", "ALL", None, 7),
    "Shape as": ("wire", None, 1),
    "Seed": (-1, 1.5, 2**60, "1", None, float("nan")),
    "Number": (-1, 0.5, 1e300, "17", None),
    "mm per unit": (0.0, -1.0, float("nan"), float("inf"), "25.4"),
    "Upload a shape": ("a.stl", None, {"name": "a.stl", "content": ""}),
    "Download this press (zip)": (1, "true", None),
}
"""Values that these controls cannot have."""

ATTRIBUTES = ("update_cb", "removed", "props", "uuid", "__class__", "visible", "options", "min")


def cases() -> Iterator[Case]:
    """All of them; one studio serves them, which the first of them starts."""
    for name, raw in RAW.items():
        yield _case(f"raw: {name}", {"raw": raw.hex()})
    for number, text in enumerate(TEXTS):
        yield _case(f"text {number}", {"text": text}, "it is text")
    for number, kind in enumerate(TYPES):
        message = {"message": CAMERA | {"type": kind}}
        yield _case(f"type {number}: {str(kind)[:20]}", message, "its type is")
    yield _case("no type", {"message": {"value": 5}}, "its type is")
    for name, good in (GOOD | {"upload": UPLOAD}).items():
        yield from _of_fields(name, good)
    for label in SLIDERS:
        yield from _of_values(label, NUMBERS)
    for label, values in VALUES.items():
        yield from _of_values(label, values)
    for name in ATTRIBUTES:
        message = UPDATE | {"updates": {name: []}}
        yield _case(f"sets {name}", {"message": message}, "expected 'value'")
        both = UPDATE | {"updates": {"value": 5.0, name: []}}
        yield _case(f"sets value and {name}", {"message": both}, "expected 'value'")
    yield _case("sets nothing", {"message": UPDATE | {"updates": {}}}, "expected 'value'")
    yield from _uploads()
    yield from _fine()


def _of_fields(name: str, good: dict[str, Any]) -> Iterator[Case]:
    for field in good:
        if field == "type":
            continue
        other = 5 if field == "updates" else {"a": 1}
        yield _case(f"{name}: wrong {field}", {"message": good | {field: other}}, field)
        if field not in OPTIONAL:
            rest = {key: value for key, value in good.items() if key != field}
            yield _case(f"{name}: no {field}", {"message": rest}, f"{field} is missing")
        if isinstance(good[field], list):
            nan = [float("nan")] * len(good[field])
            yield _case(f"{name}: NaN {field}", {"message": good | {field: nan}}, field)
            yield _case(f"{name}: short {field}", {"message": good | {field: []}}, field)
    yield _case(f"{name}: unknown field", {"message": good | {"more": 1}}, "more")


def _of_values(label: str, values: tuple[Any, ...]) -> Iterator[Case]:
    for number, value in enumerate(values):
        message = UPDATE | {"uuid": {"$uuid": label}, "updates": {"value": value}}
        yield _case(f"{label}: {number} {str(value)[:20]}", {"message": message}, label)


def _uploads() -> Iterator[Case]:
    for name, changes, says in (
        ("to a slider", {"source_component_uuid": {"$uuid": "force, N"}}, "accepts no files"),
        ("to nothing", {"source_component_uuid": "x"}, "accepts no files"),
        ("too many parts", {"part_count": 10**9}, "parts"),
        ("negative size", {"size_bytes": -1}, "size_bytes"),
        ("no parts", {"part_count": 0}, "parts"),
        ("parts of nothing", {"size_bytes": 0}, "parts"),
        ("a size of 2^63", {"size_bytes": 2**63, "part_count": 2**63}, ""),
        ("a long name", {"filename": "x" * 20_000}, "filename"),
    ):
        yield _case(f"upload {name}", {"message": UPLOAD | changes}, says)
    yield _case("part of a slider's", {"message": PART | {"part_index": -1}}, "part_index")
    yield _case("part 10^9", {"message": PART | {"part_index": 10**9}}, "part_index")


def _fine() -> Iterator[Case]:
    for name, good in GOOD.items():
        yield _case(f"good {name}", {"message": good}, fine=True)
    for name, changes in {
        "a control that is gone": {"uuid": "gone"},
        "an option": {"uuid": {"$uuid": "Array"}, "updates": {"value": "all"}},
        "a whole number as a float": {"uuid": {"$uuid": "Seed"}, "updates": {"value": 3.0}},
        "an end of a slider": {"uuid": {"$uuid": "yaw, °"}, "updates": {"value": 180}},
    }.items():
        yield _case(name, {"message": UPDATE | changes}, fine=True)
    large = UPLOAD | {"size_bytes": 65_000_000, "part_count": 124}
    yield _case("a file too large, which the page says", {"message": large}, fine=True)


def _case(name: str, request: dict[str, Any], says: str = "", fine: bool = False) -> Case:
    return Case(name, (), _start, says, fine, call=partial(_try, request))


def _start(box: Path, base: Base) -> None:
    _studio()


def _try(request: dict[str, Any], box: Path, base: Base) -> None:
    studio = _studio()
    assert studio.stdin is not None and studio.stdout is not None
    studio.stdin.write(json.dumps(request) + "\n")
    studio.stdin.flush()
    answer = json.loads(studio.stdout.readline())
    lines = answer["lines"]
    if not answer["serves"] or len(lines) > 1 or any("Traceback" in line for line in lines):
        raise AssertionError(f"served: {answer['serves']}; printed: {' | '.join(lines)}")
    if lines:
        raise T2TwinError(lines[0].removeprefix("t2twin: "))


@cache
def _studio() -> subprocess.Popen:
    """A process with a studio and a client, which ends with this one."""
    process = subprocess.Popen(
        [sys.executable, "-m", "benchmarks.studio_client"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        cwd=ROOT, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    assert process.stdout is not None and process.stdout.readline() == "ready\n"
    atexit.register(_end, process)
    return process


def _end(process: subprocess.Popen) -> None:
    """The process ends with its standard input."""
    with process:
        process.communicate()
