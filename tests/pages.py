"""Reading the report's pages in tests."""

from collections import defaultdict
from html.parser import HTMLParser
from pathlib import Path

import pytest

from t2twin.report import run_report

VOID = {"meta", "img", "br", "hr", "link"}


class Reader(HTMLParser):
    """A page's elements: checks that every tag is closed in its turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.section = ""
        self.rows: dict[str, list[list[str]]] = {}  # cells of each section's table rows
        self.parts: defaultdict[str, list[str]] = defaultdict(list)  # texts of each section

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "section":
            self.section = dict(attrs)["id"] or ""
        if tag == "tr":
            self.rows.setdefault(self.section, []).append([])
        if tag in ("td", "th"):
            self.rows[self.section][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "section":
            self.section = ""

    def text(self, section: str) -> str:
        """Text of a section, in one line."""
        return " ".join(" ".join(self.parts[section]).split())

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.parts[self.section].append(data)
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[self.section][-1][-1] += data


def draw_only(patch: pytest.MonkeyPatch, *names: str) -> None:
    """Reports of runs have these sections only, as others take long."""
    sections = {name: run_report.SECTIONS[name] for name in names}
    patch.setattr(run_report, "SECTIONS", sections)


def read_page(page: Path) -> tuple[Reader, str]:
    """The elements of a page, and the text of all its sections in one line."""
    reader = Reader()
    reader.feed(page.read_text(encoding="utf-8"))
    reader.close()
    assert reader.open == []
    return reader, " ".join(reader.text(section) for section in [*reader.parts])
