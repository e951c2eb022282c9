"""Names that version 0.3.0 changed, in one table, renames.csv.

The command line and the readers name the new one in their errors. The readers of runs and
calibrations translate the keys that version 0.2 wrote. The changelog prints the table.
"""

import csv
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

TABLE = Path(__file__).with_name("renames.csv")

KINDS = {
    "command": "Commands",
    "option": "Options",
    "keyword": "Keywords of functions",
    "name": "Names in Python",
    "import": "Modules",
    "json": "Keys of JSON files",
    "safetensors": "Keys of safetensors files",
    "value": "Values",
}
"""Kinds of names, and their headings in the changelog."""

Content = TypeVar("Content")


class Rename(NamedTuple):
    """kind: one of KINDS. old, new: a module has its full path; an option that only one command
    has follows the command's name, as in "translate --background"."""

    kind: str
    old: str
    new: str


@cache
def table() -> tuple[Rename, ...]:
    """All renames, in the order of the file."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return tuple(Rename(*row) for row in rows)


def new_name(kind: str, old: str) -> str | None:
    """The new name, or None for a name that did not change."""
    return _by_old(kind).get(old)


def message(kind: str, old: str) -> str | None:
    """The sentence about a renamed name, as in "--untouched is now --background"."""
    new = new_name(kind, old)
    return None if new is None else f"{old.split()[-1]} is now {new.split()[-1]}"


def translated(kind: str, content: Content) -> Content:
    """JSON content, or a mapping of tensors, with its old keys renamed.

    kind: "json" or "safetensors". JSON keys are renamed at every depth. Of a tensor's name, as in
    "network/generator/encoder.bias", each part is a key.
    """
    names = _by_old(kind)
    if kind == "safetensors" and isinstance(content, Mapping):
        return {_renamed_parts(key, names): tensor for key, tensor in content.items()}  # type: ignore
    return _renamed_keys(content, names)


def as_markdown() -> str:
    """The changelog's tables, one for each kind of name."""
    return "\n\n".join(_sections())


def _sections() -> Iterator[str]:
    for kind, heading in KINDS.items():
        rows = sorted(each for each in table() if each.kind == kind)
        if rows:
            lines = [f"| `{each.old}` | `{each.new}` |" for each in rows]
            yield "\n".join([f"### {heading}", "", "| 0.2 | 0.3 |", "|---|---|", *lines])


@cache
def _by_old(kind: str) -> dict[str, str]:
    return {each.old: each.new for each in table() if each.kind == kind}


def _renamed_keys(content: Any, names: Mapping[str, str]) -> Any:
    if isinstance(content, dict):
        return {names.get(k, k): _renamed_keys(each, names) for k, each in content.items()}
    return [_renamed_keys(each, names) for each in content] if isinstance(content, list) else content


def _renamed_parts(key: str, names: Mapping[str, str]) -> str:
    parts = re.split(r"([./])", key)
    return "".join(names.get(part, part) for part in parts)
