"""Reads JSON into frozen dataclasses and msgspec Structs, and checks names of columns and keys.

Content that does not fit raises a T2TwinError of one sentence.
"""

import difflib
import re
from codecs import BOM_UTF8
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.renamed import hint

Record = TypeVar("Record")

_TYPES = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "an object",
    "null": "null",
}
"""JSON types by their name in msgspec's messages."""

_BOUNDS = {">=": "at least", "<=": "at most", ">": "above", "<": "below", "of length": "of length"}
"""Bounds by their sign in msgspec's messages."""

MIN_SIMILARITY = 0.8
"""Least similarity of a misspelled name to the right one, by difflib's ratio (assumed)."""

UNIT = re.compile(r"[_ ]?\(?(?:um|mm|cm|m|mn|n|kn|g|kg|rad|deg|mpa|kpa)\)?$")
"""A unit at the end of a name."""

REMARKS = ("about", "note")
"""Keys of layout and optics files that a user may add; they are not read."""

MAX_LISTED = 12
"""Names that a message lists at most (assumed)."""


@dataclass(frozen=True)
class _FormatNumber:
    """The format number of a file; 1 if missing."""

    format: int = 1


def read_json(path: Path, kind: type[Record], number: int) -> Record:
    """The record in a JSON file, which may have a byte order mark. kind: its dataclass. number: the
    supported format number.

    Raises T2TwinError where the file cannot be read, has another format, or does not fit the
    dataclass; see `decode_json`.
    """
    content = read_file(path).removeprefix(BOM_UTF8)
    found = decode_json(content, _FormatNumber, path).format
    if found != number:
        raise T2TwinError(
            f"{path} is of format {found}; this version of t2twin reads format {number} only"
        )
    return decode_json(content, kind, path)


def decode_json(content: bytes | str, kind: type[Record], source: object) -> Record:
    """The record in JSON text. kind: a dataclass; unknown keys are ignored.

    source: origin of the text, for messages. Raises T2TwinError with the source and the field for
    a missing key, a value of another type or out of bounds, and a ValueError of __post_init__. NaN
    and infinity are not JSON and are rejected.
    """
    try:
        return msgspec.json.decode(content, type=kind, dec_hook=_array)
    except (msgspec.DecodeError, RecursionError) as error:
        raise T2TwinError(_message(error, kind, source)) from None


def convert(content: Any, kind: type[Record], source: object, strict: bool = True) -> Record:
    """As `decode_json`, for decoded JSON: dicts, lists, str, numbers. strict: whether a text is no
    number."""
    try:
        return msgspec.convert(content, type=kind, dec_hook=_array, strict=strict)
    except msgspec.ValidationError as error:
        raise T2TwinError(_message(error, kind, source)) from None


def _array(kind: type, content: Any) -> np.ndarray:
    """(n,) float64 from a list of numbers; the only type that msgspec does not read itself."""
    assert kind is np.ndarray
    try:
        return np.array(msgspec.convert(content, type=list[float]))
    except msgspec.ValidationError as error:
        raise ValueError(error) from None


def _message(error: Exception, kind: type, source: object) -> str:
    """The sentence for msgspec's message, such as "Expected `int`, got `str` - at `$.seed`"."""
    if not isinstance(error, msgspec.ValidationError):
        return f"{source} is damaged: it is not JSON"
    reason, *places = str(error).split(" - at `$")  # of an array's number: its own, the array's
    field = "".join(place.rstrip("`") for place in reversed(places)).removeprefix(".")
    name = field or "the content"
    if missing := re.fullmatch(r"Object missing required field `(.*)`", reason):
        return f"{source}: {f'{field}.' if field else ''}{missing[1]} is missing"
    if expected := re.fullmatch(r"Expected `([^`]*)`(?:, got `(.*)`)?( .*)?", reason):
        kinds = " or ".join(_TYPES.get(kind, kind) for kind in expected[1].split(" | "))
        is_now = f"is {_TYPES.get(expected[2], expected[2])}; it " if expected[2] else ""
        return f"{source}: {name} {is_now}must be {kinds}{_bound(expected[3])}"
    if unknown := re.fullmatch(r"Invalid enum value (.*)", reason):
        return f"{source}: {name} is {unknown[1]}, which is none of the allowed values"
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", reason):
        near = nearest(unknown[1], sorted(_field_names(kind)))
        meant = hint(unknown[1]) or (f"; did you mean {near}?" if near else "")
        return f"{source}: {f'{field} has' if field else 'it has'} no field {unknown[1]}{meant}"
    if reason == "Number out of range":
        return f"{source}: {name} is a number too large to be read"
    return f"{source}: {f'{field}: ' if field else ''}{reason}"


def _bound(bound: str | None) -> str:
    if not bound:
        return ""
    sign, _, value = bound.strip().rpartition(" ")
    return f" {_BOUNDS.get(sign, sign)} {value}"


def _field_names(kind: type) -> set[str]:
    """Names of all fields of a record, including nested ones."""
    names, waiting = set(), [msgspec.inspect.type_info(kind)]
    while waiting:
        each = waiting.pop()
        for field in getattr(each, "fields", ()):
            names.add(field.encode_name)
            waiting.append(field.type)
        waiting += [*getattr(each, "types", ()), *getattr(each, "item_types", ())]
        if (item := getattr(each, "item_type", None)) is not None:
            waiting.append(item)
    return names


def check_names(
    names: Iterable[str],
    known: Sequence[str],
    source: object,
    others: bool = False,
    what: str = "column",
) -> None:
    """Raises T2TwinError for a duplicate name and for an unknown one.

    names: of a table's columns or an object's keys. known: the names that are read. source, what:
    origin and type of the names, for the message. others: whether to allow unknown names that are
    not similar to a known one.
    """
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise T2TwinError(f"{source} has two {what}s {name}; leave one out")
        seen.add(name)
        if name in known:
            continue
        near = nearest(name, known)
        if near is not None:
            raise T2TwinError(
                f"{source} has a {what} {_quoted(name)}, which is not read; did you mean {near}?"
            )
        if not others:
            raise T2TwinError(
                f"{source} has a {what} {_quoted(name)}, which is not read; its {what}s may be "
                f"{', '.join(known[:MAX_LISTED])}"
            )


def nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name most similar to a misspelled one, or None.

    Names that differ in case, spaces or the unit at their end are similar.
    """
    plain = {_plain(each): each for each in reversed(known)}
    roots = {UNIT.sub("", each): full for each, full in plain.items()}
    wanted = _plain(name)
    if found := plain.get(wanted) or roots.get(UNIT.sub("", wanted)):
        return found
    close = difflib.get_close_matches(wanted, plain, n=1, cutoff=MIN_SIMILARITY)
    return plain[close[0]] if close else None


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]+", "_", name.strip().lower())


def _quoted(name: str) -> str:
    return repr(name if len(name) <= 40 else f"{name[:40]}...")
