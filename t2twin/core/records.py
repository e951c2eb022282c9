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

Kind = TypeVar("Kind")

UNIT = re.compile(r"[_ ]?\(?(?:um|mm|cm|m|mn|n|kn|g|kg|rad|deg|mpa|kpa)\)?$")
"""A unit at the end of a name."""

FORMAT = "1.0"
"""Format of all files of this version of t2twin. Earlier versions had whole numbers, or none."""

REMARKS = ("about", "note")
"""Keys of layout and optics files that a user may add; they are not read."""


def read_json(path: Path, kind: type[Kind], made_by: str | None = None) -> Kind:
    """The record in a JSON file. kind: its dataclass. made_by: as for `_check_format`.

    Raises T2TwinError where the file cannot be read, has a key twice or another format, or does not
    fit.
    """
    content = read_file(path).removeprefix(BOM_UTF8)
    _check_format(decode_json(content, dict, path), path, made_by)

    def check_keys(pairs: list[tuple[str, Any]]) -> None:
        check_names((name for name, _ in pairs), [name for name, _ in pairs], path, what="key")

    json.loads(content, object_pairs_hook=check_keys)  # msgspec uses the last of equal keys
    return decode_json(content, kind, path)


def read_toml(path: Path) -> dict[str, Any]:
    """A user's TOML file, without its format. Raises T2TwinError for NaN and another format."""
    try:
        content = tomllib.loads(read_file(path).decode("utf-8-sig"), parse_float=_number)
    except (ValueError, RecursionError) as error:
        raise T2TwinError(f"{path}: {error}") from error
    _check_format(content, path)
    return content


def _check_format(content: dict[str, Any], path: Path, made_by: str | None = None) -> None:
    """Takes the format out of a file's content; T2TwinError for another one. made_by: what writes
    the file; None for a user's, which may omit the format."""
    found = content.pop("format", "missing" if made_by else FORMAT)
    if str(found) != FORMAT:
        way = f"make it again in another folder with {made_by}" if made_by else "remove this key"
        raise T2TwinError(
            f"{path} is of another version of t2twin: format is {found}, expected {FORMAT}; {way}"
        )


def _number(text: str) -> float:
    """A number of a TOML file. Raises ValueError for NaN."""
    if math.isnan(value := float(text)):
        raise ValueError(f"{text} is not a number; leave the key out, or give a number")
    return value


def decode_json(content: bytes | str, kind: type[Kind], source: object) -> Kind:
    """The record in JSON text. kind: a dataclass; unknown keys are ignored.

    source: origin of the text, for messages. Raises T2TwinError for text that is not JSON, and for
    values that are missing, of another type, or refused by the record.
    """
    try:
        return msgspec.json.decode(content, type=kind, dec_hook=_array)
    except (msgspec.MsgspecError, RecursionError) as error:
        raise T2TwinError(f"{source}: {error}") from None


def convert(
    content: Any, kind: type[Kind], source: object, strict: bool = True, row: bool = False
) -> Kind:
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
    close = difflib.get_close_matches(_plain(name), plain, n=1, cutoff=0.8)  # assumed
    return plain[close[0]] if close else None


def _plain(name: str) -> str:
    return UNIT.sub("", re.sub(r"[\s_-]+", "_", name.strip().lower()))
