"""Reads JSON and TOML files into dataclasses and msgspec Structs, and checks names of columns.

Content that does not fit raises T2TwinError: the file, and what the decoder found.
"""

import difflib
import json
import math
import re
import reprlib
import tomllib
from codecs import BOM_UTF8
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from t2twin.core.arrays import kept
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file

Record = TypeVar("Record")

MIN_SIMILARITY = 0.8
"""Least similarity of a misspelled name to the right one, by difflib's ratio (assumed)."""

UNIT = re.compile(r"[_ ]?\(?(?:um|mm|cm|m|mn|n|kn|g|kg|rad|deg|mpa|kpa)\)?$")
"""A unit at the end of a name."""

REMARKS = ("about", "note")
"""Keys of layout and optics files that a user may add; they are not read."""


def read_json(path: Path, kind: type[Record], *numbers: int) -> Record:
    """The record in a JSON file. kind: its dataclass. numbers: the supported format numbers.

    Raises T2TwinError where the file cannot be read, has a key twice or another format, or does not
    fit.
    """
    content = read_file(path).removeprefix(BOM_UTF8)
    found = decode_json(content, dict, path).get("format", 1)

    def check_keys(pairs: list[tuple[str, Any]]) -> None:
        check_names((name for name, _ in pairs), [name for name, _ in pairs], path, what="key")

    json.loads(content, object_pairs_hook=check_keys)  # msgspec uses the last of equal keys
    if found not in numbers:
        known = " and ".join(map(str, numbers))
        raise T2TwinError(
            f"{path} is of format {found}; this version of t2twin reads format {known} only"
        )
    return decode_json(content, kind, path)


def read_toml(path: Path) -> dict[str, Any]:
    """The content of a TOML file without NaN. Raises T2TwinError for anything else."""
    try:
        content = tomllib.loads(read_file(path).decode("utf-8-sig"))
        _check_no_nan(content, "")
    except (ValueError, RecursionError) as error:
        raise T2TwinError(f"{path}: {error}") from error
    return content


def _check_no_nan(value: Any, place: str) -> None:
    """Raises ValueError, with its place, for a NaN in the content of a TOML file."""
    if isinstance(value, float) and math.isnan(value):
        raise ValueError(f"{place} is nan, which is not a number")
    if isinstance(value, dict):
        for key, each in value.items():
            _check_no_nan(each, f"{place}.{key}" if place else key)
    for number, each in enumerate(value if isinstance(value, list) else ()):
        _check_no_nan(each, f"{place}[{number}]")


def decode_json(content: bytes | str, kind: type[Record], source: object) -> Record:
    """The record in JSON text. kind: a dataclass; unknown keys are ignored.

    source: origin of the text, for messages. Raises T2TwinError for text that is not JSON, and for
    values that are missing, of another type, or refused by the record.
    """
    try:
        return msgspec.json.decode(content, type=kind, dec_hook=_array)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise T2TwinError(f"{source}: {error}") from None


def convert(
    content: Any, kind: type[Record], source: object, strict: bool = True, row: bool = False
) -> Record:
    """As `decode_json`, for decoded JSON or TOML. strict: whether a text is no number. row: whether
    it has the cells of a table's row by column, which the message names."""
    try:
        return msgspec.convert(content, type=kind, dec_hook=_array, strict=strict)
    except msgspec.ValidationError as error:
        words = str(error)
        if row and (named := re.search(r"`(?:\$\.)?(\w+)[^`]*`$", words)):  # or a missing column
            source = f"{source}, column {named[1]} has {reprlib.repr(content.get(named[1], ''))}"
            words = words.partition(" - at ")[0]
        raise T2TwinError(f"{source}: {words}") from None


def _array(kind: type, content: Any) -> np.ndarray:
    """(n,) float64 from a list of numbers; the only type that msgspec does not read itself."""
    assert kind is np.ndarray
    try:
        return kept(np.array(msgspec.convert(content, type=list[float])))
    except msgspec.ValidationError as error:
        raise ValueError(error) from None


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
        near = None if name in known else nearest(name, known)
        if near is not None or (name not in known and not others):
            meant = f"did you mean {near}?" if near else f"expected {', '.join(known[:12])}"
            raise T2TwinError(f"{source} has a {what} {name!r}, which is not read; {meant}")


def nearest(name: str, known: Sequence[str]) -> str | None:
    """The known name most similar to a misspelled one, or None.

    Names that differ in case, spaces or the unit at their end are similar.
    """
    plain = {_plain(each): each for each in reversed(known)}
    close = difflib.get_close_matches(_plain(name), plain, n=1, cutoff=MIN_SIMILARITY)
    return plain[close[0]] if close else None


def _plain(name: str) -> str:
    return UNIT.sub("", re.sub(r"[\s_-]+", "_", name.strip().lower()))
