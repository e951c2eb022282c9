"""Figures in Markdown that come from the results files, between comments that no reader sees.

A figure in running text names its results file and path, and its format:

    off by <!--=press.sensors.digit.worst.depth_error .1%-->2.0 %<!--/-->

The format is Python's of a number; with % a space stands before the sign. A table is made by a
function of `benchmarks.documents.tables`, by name:

    <!--table results-->
    | ... |
    <!--/table-->

`python -m benchmarks --docs` writes all of them anew. Markdown takes a line that begins with a
comment for HTML, so a figure's comment never stands first in a line, nor in a block of code.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from benchmarks import ROOT
from benchmarks.documents.formats import formatted
from benchmarks.documents.tables import TABLES
from benchmarks.evidence.results import read_results
from benchmarks.evidence.values import value
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write

FIGURE = re.compile(r"<!--=(?P<path>[^<>]+) (?P<format>\S+?)-->(?P<text>[^<>\n]*)<!--/-->")
TABLE = re.compile(r"(?m)^<!--table (?P<name>\S+?)-->\n(?P<text>.*?)^<!--/table-->$", re.DOTALL)
OPENING = re.compile(r"<!--(=|table )")
FIRST_IN_LINE = re.compile(r"(?m)^\s*(?:[-*]\s+|\d+\.\s+)?<!--=")
CODE = re.compile(r"(?ms)^```.*?^```|^ {4}\S.*?$")


def documents(root: Path = ROOT) -> list[Path]:
    """Every file in which figures and tables are bound."""
    files = (root / "README.md", root / "CHANGELOG.md", *sorted((root / "docs").glob("*.md")))
    return [file for file in files if file.is_file()]


def write_documents(root: Path = ROOT) -> list[Path]:
    """Writes the results' figures into the documents; the files that have changed."""
    changed = []
    for path, now in rewritten(root):
        if now != path.read_text():
            changed.append(path)
            with atomic_write(path) as temporary:
                temporary.write_text(now)
    return changed


def rewritten(root: Path = ROOT) -> Iterator[tuple[Path, str]]:
    """Every document, and its text with the figures that the results hold now.

    Raises T2TwinError for a marker that is damaged, would be seen, or names nothing.
    """
    for path in documents(root):
        text = path.read_text()
        try:
            check(text)
            text = TABLE.sub(_table, text)
            yield path, FIGURE.sub(_figure, text)
        except T2TwinError as error:
            raise T2TwinError(f"{path.name}: {error}") from None


def check(text: str) -> None:
    """Raises T2TwinError for a marker that is damaged or that a reader would see."""
    whole = len(FIGURE.findall(text)) + len(TABLE.findall(text))
    if len(OPENING.findall(text)) != whole:
        raise T2TwinError("a marker is damaged; it is <!--=PATH FORMAT-->TEXT<!--/-->, in one line")
    if first := FIRST_IN_LINE.search(text):
        line = text[first.start() :].strip().splitlines()[0]
        raise T2TwinError(f"a marker stands first in a line, where Markdown sees HTML: {line}")
    if any(OPENING.search(block) for block in CODE.findall(text)):
        raise T2TwinError("a marker stands in a block of code, where it is seen")


def _figure(match: re.Match[str]) -> str:
    name, _, path = match["path"].partition(".")
    number = value(read_results(ROOT / "benchmarks" / "results" / f"{name}.json").content, path)
    return f"<!--={match['path']} {match['format']}-->{formatted(number, match['format'])}<!--/-->"


def _table(match: re.Match[str]) -> str:
    name = match["name"]
    if name not in TABLES:
        raise T2TwinError(f"there is no table {name!r}; there are {', '.join(TABLES)}")
    return f"<!--table {name}-->\n{TABLES[name]()}\n<!--/table-->"
