"""JSON read into frozen dataclasses; whatever does not fit becomes one plain sentence.

Checks the names of a table's columns, and of an object's keys, against those that are read.
"""

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.renames import message

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
"""JSON's types as msgspec names them, in plain words."""

_BOUNDS = {">=": "at least", "<=": "at most", ">": "above", "<": "below", "of length": "of length"}
"""What msgspec says of a type's bounds, in plain words."""


@dataclass(frozen=True)
class _Numbered:
    """What is looked at first in a file: the number of its format, 1 where it names none."""

    format: int = 1


def read_json(path: Path, kind: type[Record], number: int) -> Record:
    """The record in a JSON file. number: of the file's format, the one that this version reads.

    Raises T2TwinError where the file cannot be read, is of another format, or does not fit the
    record; see `decode_json`.
    """
    content = read_file(path)
    there = decode_json(content, _Numbered, path).format
    if there != number:
        raise T2TwinError(
            f"{path} is of format {there}; this version of t2twin reads format {number} only"
        )
    return decode_json(content, kind, path)


def decode_json(content: bytes | str, kind: type[Record], source: object) -> Record:
    """The record in JSON text. kind: a dataclass; keys that it does not know are left out.

    source: where the text is from, for messages. Raises T2TwinError that names the source and the
    field for a missing key and a value of another type or out of bounds. A ValueError of the
    dataclass's own __post_init__ becomes such a sentence too. JSON has no NaN and no infinity:
    both are refused.
    """
    try:
        return msgspec.json.decode(content, type=kind)
    except (msgspec.DecodeError, RecursionError) as error:
        raise T2TwinError(_sentence(error, kind, source)) from None


def convert(content: Any, kind: type[Record], source: object) -> Record:
    """The same for values of JSON that are decoded already: dicts, lists, text, numbers."""
    try:
        return msgspec.convert(content, type=kind)
    except msgspec.ValidationError as error:
        raise T2TwinError(_sentence(error, kind, source)) from None


def _sentence(error: Exception, kind: type, source: object) -> str:
    """msgspec says "Expected `int`, got `str` - at `$.seed`"."""
    if not isinstance(error, msgspec.ValidationError):
        return f"{source} is damaged: it is not JSON"
    said, _, place = str(error).partition(" - at `$")
    field = place.rstrip("`").removeprefix(".")
    name = field or "the content"
    if missing := re.fullmatch(r"Object missing required field `(.*)`", said):
        return f"{source}: {f'{field}.' if field else ''}{missing[1]} is missing"
    if expected := re.fullmatch(r"Expected `([^`]*)`(?:, got `(.*)`)?( .*)?", said):
        kinds = " or ".join(_TYPES.get(kind, kind) for kind in expected[1].split(" | "))
        is_now = f"is {_TYPES.get(expected[2], expected[2])}; it " if expected[2] else ""
        return f"{source}: {name} {is_now}must be {kinds}{_bound(expected[3])}"
    if unknown := re.fullmatch(r"Invalid enum value (.*)", said):
        return f"{source}: {name} is {unknown[1]}, which is none of the allowed values"
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", said):
        near = nearest(unknown[1], sorted(_field_names(kind)))
        renamed = message("json", unknown[1])
        meant = f"; {renamed}" if renamed else f"; did you mean {near}?" if near else ""
        return f"{source}: {f'{field} has' if field else 'it has'} no field {unknown[1]}{meant}"
    if said == "Number out of range":
        return f"{source}: {name} is a number too large to be read"
    return f"{source}: {f'{field}: ' if field else ''}{said}"


def _bound(said: str | None) -> str:
    if not said:
        return ""
    sign, _, value = said.strip().rpartition(" ")
    return f" {_BOUNDS.get(sign, sign)} {value}"


def _field_names(kind: type) -> set[str]:
    """Names of all fields of a record and of those within it."""
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


SIMILAR = 0.8
"""Least similarity of a misspelt name to the right one, by difflib's ratio (assumed)."""

UNIT = re.compile(r"[_ ]?\(?(?:um|mm|cm|m|mn|n|kn|g|kg|rad|deg|mpa|kpa)\)?$")
"""A unit at the end of a name."""

MAX_LISTED = 12
"""Most names that a message lists (assumed)."""


def check_names(
    names: Iterable[str],
    known: Sequence[str],
    source: object,
    others: bool = False,
    what: str = "column",
) -> None:
    """Raises T2TwinError for a name that comes twice, and for one that is not known.

    names: those of a table's columns, in its order. known: those that are read. source: what has
    the names, and what they are of, for the message. others: whether others are allowed that are
    not near a known one.
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
                f"{source} has a {what} {_shown(name)}, which is not read; did you mean {near}?"
            )
        if not others:
            raise T2TwinError(
                f"{source} has a {what} {_shown(name)}, which is not read; its {what}s may be "
                f"{', '.join(known[:MAX_LISTED])}"
            )


def nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name that was probably meant, None where there is none.

    Names that differ in capitals, spaces or the unit at their end are near, and misspelt ones.
    """
    plain = {_plain(each): each for each in reversed(known)}
    roots = {UNIT.sub("", each): full for each, full in plain.items()}
    wanted = _plain(name)
    if found := plain.get(wanted) or roots.get(UNIT.sub("", wanted)):
        return found
    close = difflib.get_close_matches(wanted, plain, n=1, cutoff=SIMILAR)
    return plain[close[0]] if close else None


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]+", "_", name.strip().lower())


def _shown(name: str) -> str:
    """In quotes, as it may have spaces, and not too long."""
    return repr(name if len(name) <= 40 else f"{name[:40]}...")
