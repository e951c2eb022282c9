"""Reading the report's pages in tests."""

import re
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "img", "br", "hr", "link"}


class Reader(HTMLParser):
    """A page's elements: checks that every tag is closed in its turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.section = ""
        self.rows: dict[str, list[list[str]]] = {}  # cells of each section's table rows

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

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[self.section][-1][-1] += data


def read_page(page: Path) -> tuple[Reader, str]:
    reader, text = Reader(), page.read_text(encoding="utf-8")
    reader.feed(text)
    reader.close()
    assert reader.open == []
    return reader, re.sub(r"<[^>]+>", " ", text)
