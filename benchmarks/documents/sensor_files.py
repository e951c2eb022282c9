"""Tables of the keys of sensor files, from the records that read them."""

from collections.abc import Iterator
from typing import Any, get_args, get_origin

from msgspec import Meta, Struct, structs

from benchmarks.documents.figures import markdown
from t2twin.sim.optical.spec import GelCameraSpec
from t2twin.sim.taxels.spec import TaxelArraySpec

KINDS = {"gel-camera": GelCameraSpec, "taxel-array": TaxelArraySpec}


def keys_of(kind: str) -> str:
    """The keys of the file of a kind of sensor: name, range, default, meaning."""
    return markdown([["key", "allowed", "default", "meaning"], *_rows(KINDS[kind], "")])


def _rows(record: type[Struct], place: str) -> Iterator[list[str]]:
    for field in structs.fields(record):
        name = f"{place}{field.encode_name}"
        table, is_list = _table_of(field.type)
        meaning = _description(field.type)
        if table is not None:
            first = "list of tables" if is_list else "table"
            yield [f"`{name}`", first, "" if field.required else "none", meaning]
            if table.__name__ != "Imperfections":
                yield from _rows(table, f"{name}.")
            continue
        default = "" if field.required else _shown(field.default)
        yield [f"`{name}`", _allowed(field.type), default, meaning]


def _table_of(kind: Any) -> tuple[type[Struct] | None, bool]:
    """The record of a nested table, and whether there are several."""
    kind = _without_meta(kind)
    several = get_origin(kind) in (tuple, dict)
    for each in (kind, *(_without_meta(part) for part in get_args(kind))):
        if isinstance(each, type) and issubclass(each, Struct):
            return each, several
    return None, False


def _without_meta(kind: Any) -> Any:
    while hasattr(kind, "__metadata__"):
        kind = kind.__origin__
    return kind


def _metas(kind: Any) -> list[Meta]:
    found = []
    while hasattr(kind, "__metadata__"):
        found += kind.__metadata__
        kind = kind.__origin__
    return found


def _description(kind: Any) -> str:
    return next((meta.description for meta in _metas(kind) if meta.description), "")


def _allowed(kind: Any) -> str:
    """The type and the bounds, in words."""
    plain = _without_meta(kind)
    parts = [part for part in get_args(plain) if part is not type(None)]
    if get_origin(plain) is tuple:
        sizes = "several" if Ellipsis in parts else len(parts)
        return f"{sizes} of: {_allowed(parts[0])}"
    if type(None) in get_args(plain):
        return _allowed(parts[0])
    if parts and all(isinstance(part, str) for part in parts):
        return " or ".join(parts)
    words = {int: "whole number", float: "number", str: "text", bool: "true or false"}
    metas = _metas(kind)
    low = next((f"from {m.ge:g}" for m in metas if m.ge is not None), "")
    low = low or next((f"above {m.gt:g}" for m in metas if m.gt is not None), "")
    high = next((f"to {m.le:g}" for m in metas if m.le is not None), "")
    return " ".join(part for part in (words.get(plain, ""), low, high) if part)


def _shown(default: Any) -> str:
    if default is None or default == ():
        return "none"
    return ", ".join(f"{each:g}" for each in default) if isinstance(default, tuple) else (
        default if isinstance(default, str) else f"{default:g}"
    )  # fmt: skip
