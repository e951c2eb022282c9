"""JSON read into frozen dataclasses; whatever does not fit becomes one plain sentence."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.reading import read_file
from t2twin.sim.column_names import nearest

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
        meant = f"; did you mean {near}?" if near else ""
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
