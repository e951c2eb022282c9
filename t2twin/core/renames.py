"""Names that version 0.3.0 changed, in one table, renames.csv.

The command line and the readers name the new one in their errors. The readers of runs and
calibrations translate the keys that version 0.2 wrote. The changelog prints the table.
"""

import csv
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

TABLE = Path(__file__).with_name("renames.csv")


class Rename(NamedTuple):
    """One changed name.

    kind: command, option, keyword, name (public, as in "t2twin.load"), import (a module's path),
    json, safetensors (keys), or value. old, new: the option of one command follows that command's
    name, as in "translate --background".
    """

    kind: str
    old: str
    new: str


@cache
def table() -> tuple[Rename, ...]:
    """All renames, in the order of the file."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        return tuple(Rename(**row) for row in csv.DictReader(file))


def new_name(kind: str, old: str) -> str | None:
    """The new name, or None for a name that did not change."""
    return _by_old(kind).get(old)


def message(kind: str, old: str) -> str | None:
    """The sentence about a renamed name, as in "--start is now --init-from"."""
    new = new_name(kind, old)
    return None if new is None else f"{old.split()[-1]} is now {new.split()[-1]}"


def translated(kind: str, content: dict[str, Any]) -> dict[str, Any]:
    """A JSON object, or tensors by name, with the keys of version 0.2 renamed.

    kind: "json" or "safetensors". JSON keys are renamed at every depth. Each part of a tensor's
    name, as in "network/generator/encoder.bias", is a key.
    """
    names = _by_old(kind)
    if kind == "safetensors":
        return {_renamed_parts(key, names): tensor for key, tensor in content.items()}
    return _renamed_keys(content, names)


@cache
def _by_old(kind: str) -> dict[str, str]:
    return {each.old: each.new for each in table() if each.kind == kind}


def _renamed_keys(content: Any, names: Mapping[str, str]) -> Any:
    if isinstance(content, dict):
        return {names.get(k, k): _renamed_keys(each, names) for k, each in content.items()}
    return (
        [_renamed_keys(each, names) for each in content] if isinstance(content, list) else content
    )


def _renamed_parts(key: str, names: Mapping[str, str]) -> str:
    parts = re.split(r"([./])", key)
    return "".join(names.get(part, part) for part in parts)
