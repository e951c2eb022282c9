"""Tables in Markdown files, between two comments that no reader sees.

    <!--table results-->
    | ... |
    <!--/table-->

`python -m benchmarks --docs` writes all of them; tables.toml and reference.py define them. The keys
of tables.toml, whose tables have figures of benchmarks/results:

columns: the heading of each column, and the template of its cells. `{val.rmse:.1f}` is a figure:
    its path and format. `{a.b / 60 * c:.0f}` multiplies and divides figures. A cell is empty if its
    path leads to null, or leads nowhere and the template begins with `?`.
rows: the label of each row, and what ROW in the templates stands for; or the path of a dict, each
    key of which is a row.
groups: labels, and what GROUP stands for; each group has all columns.
at: what all paths begin with. A whole path begins with the name of a results file.
end: the cells of further rows.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from benchmarks import ROOT
from benchmarks.evidence import Results, read_results
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write

RESULTS = ROOT / "benchmarks" / "results"

FIGURE = re.compile(r"\{(?P<terms>[^{}:]+)(?::(?P<format>[^{}]*))?\}")


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A table of tables.toml; the attributes are its keys."""

    columns: dict[str, str]
    rows: dict[str, str] | str
    groups: dict[str, str] = msgspec.field(default_factory=lambda: {"": ""})
    at: str = ""
    end: list[list[str]] = []

    def __call__(self) -> str:
        """The table in Markdown, and the dates on which its figures were measured."""
        figures = Figures()
        pairs = [(name, head) for name in self.groups for head in self.columns]
        lines = [["", *(f"{name}: {head}".removeprefix(": ") for name, head in pairs)]]
        for label, row in self._rows(figures).items():
            cells = (
                figures.cell(self.columns[head], self.at, row, self.groups[name])
                for name, head in pairs
            )
            lines.append([label, *cells])
        return f"{markdown([*lines, *self.end])}\n\n{figures.dates()}"

    def _rows(self, figures: "Figures") -> Mapping[str, str]:
        if not isinstance(self.rows, str):
            return self.rows
        return {f"`{key}`": key for key in figures.value(self.at + self.rows)}


class Figures:
    """Figures by their paths, and the results files that were read."""

    def __init__(self) -> None:
        self._read: dict[str, Results] = {}

    def cell(self, template: str, at: str, row: str, group: str = "") -> str:
        """The text of a cell."""

        def filled(text: str) -> str:
            return text.replace("ROW", row).replace("GROUP", group)

        def formatted(match: re.Match[str]) -> str:
            number = self._calculated(match["terms"], filled(at))
            return format(number, match["format"] or "").replace("%", " %")

        try:
            return FIGURE.sub(formatted, filled(template).removeprefix("?"))
        except _NullError:
            return ""
        except T2TwinError:
            if template.startswith("?"):
                return ""
            raise

    def value(self, path: str) -> Any:
        """The value at a whole path. Raises T2TwinError if it leads nowhere."""
        name, _, rest = path.partition(".")
        try:
            return _walk(self._results(name).content, rest)
        except LookupError:
            raise T2TwinError(f"benchmarks/results/{name}.json has nothing at {rest}") from None

    def dates(self) -> str:
        """A sentence with the date of each results file that was read."""
        each = [f"{self.date(name)} (`{name}`)" for name in self._read]
        return f"*Measured on {', '.join(each)}.*"

    def date(self, name: str) -> str:
        """The date of a results file, YYYY-MM-DD."""
        return self._results(name).measured_on.date[:10]

    def _results(self, name: str) -> Results:
        if name not in self._read:
            self._read[name] = read_results(RESULTS / f"{name}.json")
        return self._read[name]

    def _calculated(self, terms: str, at: str) -> Any:
        result, sign = None, "*"
        for term in re.split(r" ([*/]) ", terms):
            if term in "*/":
                sign = term
                continue
            value = float(term) if re.fullmatch(r"[\d.e]+", term) else self.value(at + term)
            if value is None:
                raise _NullError
            if result is not None:
                value = result * value if sign == "*" else result / value
            result = value
        return result


class _NullError(Exception):
    """A path leads to null."""


def _walk(content: Any, path: str) -> Any:
    """What is at a dotted path; keys may contain dots. Raises LookupError if there is nothing."""
    if not path or content is None:
        return content
    if isinstance(content, list):
        content = {str(number): each for number, each in enumerate(content)}
    keys = [key for key in content if f"{path}.".startswith(f"{key}.")]
    key = max(keys, key=len, default="")
    return _walk(content[key], path[len(key) + 1 :])


def figure_tables() -> dict[str, Table]:
    """The tables of tables.toml by name."""
    content = tomllib.loads(Path(__file__).with_name("tables.toml").read_text("utf-8"))
    return msgspec.convert(content, dict[str, Table])


def markdown(lines: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; the first line is its head."""
    head, *body = (
        "|" + "".join(f" {cell} |" if cell else " |" for cell in cells) for cells in lines
    )
    return "\n".join([head, "|" + "---|" * len(lines[0]), *body])


# Documents

TABLE = re.compile(r"(?m)^<!--table (?P<name>\S+?)-->\n(?P<text>.*?)^<!--/table-->$", re.DOTALL)
MARKER = re.compile(r"<!--\s*(/?table\b|=|/-->)")
"""Starts of all markers; each whole table has two. `<!--=` began a figure in a sentence."""


def documents(root: Path = ROOT) -> list[Path]:
    """Every file that may contain tables."""
    files = (root / "README.md", root / "CHANGELOG.md", *sorted((root / "docs").rglob("*.md")))
    return [file for file in files if file.is_file()]


def write_documents(root: Path = ROOT) -> list[Path]:
    """Writes the tables into the documents; returns the files that changed."""
    changed = []
    for path, text in rewritten(root):
        if text != path.read_text("utf-8"):
            changed.append(path)
            with atomic_write(path) as temporary:
                temporary.write_text(text, "utf-8")
    return changed


def rewritten(root: Path = ROOT) -> Iterator[tuple[Path, str]]:
    """Every document and its text with the present tables.

    Raises T2TwinError for an incomplete marker, or one that names no table.
    """
    from benchmarks.documents.reference import tables  # which uses this module

    known = tables()

    def table(match: re.Match[str]) -> str:
        name = match["name"]
        if name not in known:
            raise T2TwinError(f"there is no table {name!r}; expected one of {', '.join(known)}")
        return f"<!--table {name}-->\n{known[name]()}\n<!--/table-->"

    for path in documents(root):
        text = path.read_text("utf-8")
        if len(MARKER.findall(text)) != 2 * len(TABLE.findall(text)):
            raise T2TwinError(
                f"{path.name}: incomplete marker; expected whole lines <!--table NAME--> and "
                "<!--/table-->"
            )
        try:
            yield path, TABLE.sub(table, text)
        except T2TwinError as error:
            raise T2TwinError(f"{path.name}: {error}") from None
