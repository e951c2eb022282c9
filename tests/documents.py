"""Code blocks, commands, links and option names of README.md, CONTRIBUTING.md and docs/."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]

CODE = re.compile(r"(?ms)^```.*?^```[ ]*$|<!--.*?-->|^\|.*?$|^( {4}|\t)\S.*?$")
"""Code blocks, comments and rows of tables."""

LABEL = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
FENCE = re.compile(r"(?ms)^```(?P<language>\w*)\n(?P<text>.*?)^```$")
LINK = re.compile(r"\]\((?P<target>[^)\s]+)\)")
INLINE = re.compile(r"`([^`\n]+)`")
HEADING = re.compile(r"(?m)^#+ (.+)$")

CONTRIBUTING = ROOT / "CONTRIBUTING.md"


def documents() -> list[Path]:
    """The README and all pages of docs."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


PAGES = [*documents(), CONTRIBUTING]


def prose(page: Path) -> str:
    """A page without code blocks, tables, comments and targets of links."""
    return LABEL.sub(r"\1", CODE.sub("", page.read_text("utf-8")))


class Block(NamedTuple):
    """A fenced block of code. line: of its first line of code."""

    page: Path
    line: int
    language: str
    text: str

    @property
    def place(self) -> str:
        return f"{name_of(self.page)}:{self.line}"

    def commands(self) -> Iterator[tuple[str, str]]:
        """The command lines, without comments and the sign of a background job, and the files that
        their output goes to, or an empty text."""
        for line in self.text.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if words and words[-1] == "&":
                words.pop()
            end = words.index(">") if ">" in words else len(words)
            if words:
                yield shlex.join(words[:end]), "".join(words[end + 1 :])


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page in order."""
    text = page.read_text("utf-8")
    return [
        Block(page, text.count("\n", 0, match.start("text")) + 1, match["language"], match["text"])
        for match in FENCE.finditer(text)
    ]


def links(page: Path) -> list[str]:
    """Targets of the links and images outside of code blocks."""
    return [match["target"] for match in LINK.finditer(FENCE.sub("", page.read_text("utf-8")))]


def anchors(page: Path) -> set[str]:
    """Fragments that lead to the headings of a page."""
    headings = HEADING.findall(FENCE.sub("", page.read_text("utf-8")))
    return {
        re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings
    }


def inline_code(page: Path) -> list[str]:
    """Text between single backticks, generated tables included."""
    return INLINE.findall(FENCE.sub("", page.read_text("utf-8")))
