"""Tables in Markdown files, between two comments that no reader sees.

    <!--table results-->
    | ... |
    <!--/table-->

`python -m benchmarks --docs` writes all of them; tables.toml and reference.py define them.
"""

import re
from collections.abc import Iterator
from pathlib import Path

from benchmarks import ROOT
from benchmarks.documents.reference import tables
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write

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
