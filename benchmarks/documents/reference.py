"""Tables of the reference: options of commands, public names, benchmarks, keys of sensor files."""

import warnings
from collections.abc import Callable, Iterator
from inspect import getdoc
from typing import Any, get_args, get_origin

from msgspec import Meta, Struct, structs

from benchmarks.documents.figures import Figures, figure_tables, markdown
from benchmarks.evidence import find_benchmarks
from t2twin.sim.optical.spec import GelCameraSpec
from t2twin.sim.taxels.spec import TaxelArraySpec

KINDS = {"gel-camera": GelCameraSpec, "taxel-array": TaxelArraySpec}


def tables() -> dict[str, Callable[[], str]]:
    """All tables of the documents by name."""
    from t2twin.cli import COMMANDS

    options = {f"options-{name}": lambda name=name: command_options(name) for name in COMMANDS}
    others = {"benchmarks": benchmarks, "api": public_names}
    files = {f"file-{kind}": lambda kind=kind: keys_of(kind) for kind in KINDS}
    return {**figure_tables(), **options, **files, **others}


def command_options(name: str) -> str:
    """Arguments and options of a command, as its --help prints them."""
    import tyro

    from t2twin.cli import COMMANDS, TYRO_OPTIONS

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        parser = tyro.extras.get_parser(COMMANDS[name], config=TYRO_OPTIONS)
    lines = [["argument", "meaning"]]
    for action in parser._actions:
        if action.dest != "help":
            value = f" {action.metavar}" if action.metavar else ""
            called = f"{action.option_strings[-1]}{value}" if action.option_strings else value[1:]
            meaning = " ".join((action.help or "").split()).replace(" (default: None)", "")
            lines.append([f"`{called}`".replace("|", "\\|"), meaning.replace("|", "\\|")])
    return markdown(lines)


def public_names() -> str:
    """The public names of t2twin and the first sentence of each docstring."""
    import t2twin

    lines = [["name", "description"]]
    for name in t2twin.__all__:
        first = (getdoc(getattr(t2twin, name)) or "").partition("\n\n")[0]
        lines.append([f"`{name}`", " ".join(first.split())])
    return markdown(lines)


def benchmarks() -> str:
    """The results files, what their benchmarks measure, and when they were measured."""
    figures, lines = Figures(), [["name", "measures", "date"]]
    for benchmark in find_benchmarks().values():
        if benchmark.results.is_file():
            name = benchmark.name
            lines.append([f"`{name}`", benchmark.measures, figures.date(name)])
    return markdown(lines)


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
