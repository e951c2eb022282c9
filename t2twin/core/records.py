"""Reads JSON and TOML into dataclasses and msgspec Structs, and checks names of columns and keys.

Content that does not fit raises a T2TwinError of one sentence.
"""

import difflib
import re
import tomllib
from codecs import BOM_UTF8
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import msgspec
import numpy as np
from msgspec import Struct, structs

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

_BOUNDS = {">=": "at least", "<=": "at most", ">": "above", "<": "below"}
"""Bounds by their sign in msgspec's messages."""

MIN_SIMILARITY = 0.8
"""Least similarity of a misspelled name to the right one, by difflib's ratio (assumed)."""

UNIT = re.compile(r"[_ ]?\(?(?:um|mm|cm|m|mn|n|kn|g|kg|rad|deg|mpa|kpa)\)?$")
"""A unit at the end of a name."""

REMARKS = ("about", "note")
"""Keys of layout and optics files that a user may add; they are not read."""

MAX_TOML_BYTES = 1_000_000
"""Largest TOML file, bytes (assumed: some hundred times a long one)."""

MAX_FAULTS = 8
"""Faults of a file that a message lists at most (assumed)."""

MAX_LISTED = 12
"""Names that a message lists at most (assumed)."""


@dataclass(frozen=True)
class _FormatNumber:
    """The format number of a file; 1 if missing."""

    format: int = 1


def read_json(path: Path, kind: type[Record], *numbers: int) -> Record:
    """The record in a JSON file, which may have a byte order mark. kind: its dataclass. numbers:
    the supported format numbers.

    Raises T2TwinError where the file cannot be read, has another format, or does not fit the
    dataclass; see `decode_json`.
    """
    content = read_file(path).removeprefix(BOM_UTF8)
    found = decode_json(content, _FormatNumber, path).format
    if found not in numbers:
        known = " and ".join(map(str, numbers))
        raise T2TwinError(
            f"{path} is of format {found}; this version of t2twin reads format {known} only"
        )
    return decode_json(content, kind, path)


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file, which may have a byte order mark.

    Raises T2TwinError where the file cannot be read or is no TOML.
    """
    text = read_file(path, MAX_TOML_BYTES)
    try:
        return tomllib.loads(text.decode("utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise T2TwinError(f"{path} is not TOML ({error})") from error


def decode_json(content: bytes | str, kind: type[Record], source: object) -> Record:
    """The record in JSON text. kind: a dataclass; unknown keys are ignored.

    source: origin of the text, for messages. Raises T2TwinError with the source and the field for
    a missing key, a value of another type or out of bounds, and a ValueError of __post_init__. NaN
    and infinity are not JSON and are rejected.
    """
    try:
        return msgspec.json.decode(content, type=kind, dec_hook=_array)
    except msgspec.ValidationError as error:
        raise T2TwinError(f"{source}: {_fault(error, kind)}") from None
    except (msgspec.DecodeError, RecursionError):
        raise T2TwinError(f"{source} is damaged: it is not JSON") from None


def convert(content: Any, kind: type[Record], source: object, strict: bool = True) -> Record:
    """As `decode_json`, for decoded JSON: dicts, lists, str, numbers. strict: whether a text is no
    number."""
    try:
        return msgspec.convert(content, type=kind, dec_hook=_array, strict=strict)
    except msgspec.ValidationError as error:
        raise T2TwinError(f"{source}: {_fault(error, kind)}") from None


def convert_tables(content: object, record: type[Record], source: object) -> Record:
    """As `convert`, for a record of nested Structs; the error names up to MAX_FAULTS faults.

    NaN is rejected.
    """
    found = _table_faults(content, record, "")
    if found:
        more = f"; and {len(found) - MAX_FAULTS} more" if len(found) > MAX_FAULTS else ""
        raise T2TwinError(f"{source}: {'; '.join(found[:MAX_FAULTS])}{more}")
    return convert(content, record, source)


def _table_faults(content: object, record: Any, place: str) -> list[str]:
    """One clause for each fault of a table. place: its name, "" for the whole file."""
    inside = f"{place}." if place else ""
    if not isinstance(content, dict):
        return [f"{place} must be a table"]
    known = {field.encode_name: field for field in structs.fields(record)}
    found = []
    for key in content:
        if key not in known:
            near = nearest(key, tuple(known))
            meant = f", did you mean {near}?" if near else f"; allowed are {', '.join(known)}"
            found.append(f"{inside}{key} is unknown{meant}")
    for key, field in known.items():
        if key in content:
            found += _value_faults(content[key], field.type, f"{inside}{key}")
        elif field.required:
            found.append(f"{inside}{key} is missing")
    return found or _faults(content, record, place)


def _value_faults(value: object, kind: Any, place: str) -> list[str]:
    """One clause for each fault of a value. place: its name."""
    table, tables = tables_in(kind, value, place)
    if tables:
        return [fault for at, each in tables.items() for fault in _table_faults(each, table, at)]
    if _has_nan(value):
        return [f"{place} is not a number"]
    literal = next((part for part in _parts(kind) if get_origin(part) is Literal), None)
    if literal and isinstance(value, str) and value not in get_args(literal):
        return [f"{place} is {value!r}; allowed are {', '.join(get_args(literal))}"]
    return _faults(value, kind, place)


def _faults(value: object, kind: Any, place: str) -> list[str]:
    """The first fault of a value, if any."""
    try:
        msgspec.convert(value, type=kind)
    except msgspec.ValidationError as error:
        return [_fault(error, kind, place)]
    return []


def tables_in(kind: Any, value: object, place: str) -> tuple[type[Struct], dict[str, object]]:
    """The record of the tables in a value, and the tables by their places; none for other types."""
    parts = _parts(kind)
    record = next((p for p in parts if isinstance(p, type) and issubclass(p, Struct)), None)
    if record is None:
        return Struct, {}
    container = next((get_origin(p) for p in parts if record in get_args(p)), None)
    if container is tuple and isinstance(value, list):
        return record, {f"{place}[{n}]": each for n, each in enumerate(value)}
    if container is dict and isinstance(value, dict):
        return record, {f"{place}.{name}": each for name, each in value.items()}
    return record, {} if container in (tuple, dict) else {place: value}


def _parts(kind: Any) -> list[Any]:
    """A type and those in it, such as of a union."""
    parts = [kind, *get_args(kind)]
    return parts + [inner for part in parts[1:] for inner in get_args(part)]


def _has_nan(value: object) -> bool:
    return any(map(_has_nan, value)) if isinstance(value, list) else value != value


def _array(kind: type, content: Any) -> np.ndarray:
    """(n,) float64 from a list of numbers; the only type that msgspec does not read itself."""
    assert kind is np.ndarray
    try:
        return np.array(msgspec.convert(content, type=list[float]))
    except msgspec.ValidationError as error:
        raise ValueError(error) from None


def _fault(error: msgspec.ValidationError, kind: type, place: str = "") -> str:
    """The clause for msgspec's message, such as "Expected `int`, got `str` - at `$.seed`".

    place: of the content, "" for a whole file.
    """
    reason, *places = str(error).split(" - at `$")  # of an array's number: its own, the array's
    inner = "".join(each.rstrip("`") for each in reversed(places))
    field = f"{place}{inner}".removeprefix(".")
    name = field or "the content"
    if missing := re.fullmatch(r"Object missing required field `(.*)`", reason):
        return f"{f'{field}.' if field else ''}{missing[1]} is missing"
    if expected := re.fullmatch(r"Expected `([^`]*)`(?:, got `(.*)`)?( .*)?", reason):
        named = [_TYPES.get(each, each) for each in expected[1].split(" | ") if each != "null"]
        kinds = " or ".join(named) or "null"
        is_now = f"is {_TYPES.get(expected[2], expected[2])}; it " if expected[2] else ""
        return f"{name} {is_now}must be {kinds}{_bound(expected[3])}"
    if unknown := re.fullmatch(r"Invalid enum value (.*)", reason):
        allowed = ", ".join(map(str, _values(kind, re.sub(r"\[.*?]", "", name).split(".")[-1])))
        return f"{name} is {unknown[1]}; allowed are {allowed}"
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", reason):
        near = nearest(unknown[1], sorted(_field_names(kind)))
        meant = hint(unknown[1]) or (f"; did you mean {near}?" if near else "")
        return f"{f'{field} has' if field else 'it has'} no field {unknown[1]}{meant}"
    if reason == "Number out of range":
        return f"{name} is a number too large to be read"
    return f"{f'{field}: ' if field else ''}{reason}"


def _bound(bound: str | None) -> str:
    if not bound:
        return ""
    *words, sign, value = bound.split()
    return " ".join(["", *words, _BOUNDS.get(sign, sign), value])


def _field_names(kind: type) -> set[str]:
    """Names of all fields of a record, including nested ones."""
    return {field.encode_name for field in _fields(kind)}


def _values(kind: type, name: str) -> list[Any]:
    """The values that all fields of this name may have, in a record and in nested ones."""
    types = [field.type for field in _fields(kind) if field.encode_name == name]
    parts = [part for each in types for part in getattr(each, "types", (each,))]
    values = [value for part in parts for value in getattr(part, "values", ())]
    return list(dict.fromkeys(values))


def _fields(kind: type) -> Iterator[Any]:
    """All fields of a record and of nested ones."""
    waiting = [msgspec.inspect.type_info(kind)]
    while waiting:
        each = waiting.pop()
        for field in getattr(each, "fields", ()):
            yield field
            waiting.append(field.type)
        waiting += [*getattr(each, "types", ()), *getattr(each, "item_types", ())]
        if (item := getattr(each, "item_type", None)) is not None:
            waiting.append(item)


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
