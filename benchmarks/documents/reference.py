"""Tables of the reference: options of the commands, public names, results files."""

import warnings
from collections.abc import Callable
from importlib import import_module
from inspect import getdoc

from benchmarks.documents.figures import Figures, figure_tables, markdown
from benchmarks.documents.sensor_files import KINDS, keys_of
from benchmarks.evidence import find_benchmarks


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
            first = (getdoc(import_module(benchmark.module)) or "").partition("\n\n")[0]
            text = " ".join(first.split())
            lines.append([f"`{benchmark.name}`", text, figures.date(benchmark.name)])
    return markdown(lines)
