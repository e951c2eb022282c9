"""Sentences of more than MAX_WORDS words in the documents and in public docstrings.

python -m tests.sentences            every such sentence, and the number of words of the documents
python -m tests.sentences PATH ...   the sentences below these paths
"""

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PRODUCT = ("t2twin", "translate", "sim", "primitives_cad", "benchmarks")

MAX_WORDS = 30
README_WORDS, DOCUMENT_WORDS = 900, 12_000
"""Limits on the words of the README, and of all documents with the README."""

CODE = re.compile(r"(?ms)^```.*?^```[ ]*$|<!--.*?-->|^\|.*?$|^( {4}|\t)\S.*?$")
"""Code blocks, comments and rows of tables in Markdown."""

LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)")
BLOCK = re.compile(r"\n\s*\n|\n\s*(?=(?:[-*#>]|\d+\.)\s)|\n(?=#)")
"""Ends of paragraphs, and starts of list items and headings."""

ENTRY = re.compile(r"(?m)^\s*\w[\w, *]*: |^\s*(?:Args|Returns|Raises|Yields):\s*$")
"""Start of the description of an argument in a docstring."""

COLUMNS = re.compile(r"(?m)^.*\S {3,}\S.*$(?:\n {12,}\S.*$)*")
"""Rows of a table in a docstring, with the lines that continue them."""

END = re.compile(r"(?<=[.!?])[\"')\]]*\s+")
WORD = re.compile(r"[^\W\d_]")


class Sentence(NamedTuple):
    path: str
    line: int
    text: str

    @property
    def words(self) -> int:
        return len(words(self.text))

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.words} words: {self.text}"


def words(text: str) -> list[str]:
    """The words of a text; numbers and signs are none."""
    return [word for word in text.split() if WORD.search(word)]


def documents(root: Path = ROOT) -> list[Path]:
    """The README and all pages of docs."""
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def prose(markdown: str) -> str:
    """Markdown without code blocks, tables, comments and targets of links; lines are kept."""
    without = CODE.sub(lambda match: "\n" * match[0].count("\n"), markdown)
    return LINK.sub(lambda match: match[1], without)


def sentences(text: str, path: str, line: int = 1) -> Iterator[Sentence]:
    """Sentences of a text; list items, headings and paragraphs end one."""
    start = 0
    for end in [*(match.end() for match in BLOCK.finditer(text)), len(text)]:
        block, at = text[start:end], start
        for part in END.split(block):
            place = text.find(part, at)
            if part.strip():
                yield Sentence(path, line + text.count("\n", 0, place), " ".join(part.split()))
            at = place + len(part)
        start = end


def docstrings(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of each public docstring: of the module, classes, functions and constants."""
    yield from _docstrings(ast.parse(source).body)


def _docstrings(body: list[ast.stmt]) -> Iterator[tuple[int, str]]:
    named: str | None = ""
    for node in body:
        value = node.value if isinstance(node, ast.Expr) else None
        if isinstance(value, ast.Constant) and isinstance(value.value, str) and named is not None:
            yield node.lineno, value.value
        named = _name(node)
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            public = not node.name.startswith("_") or node.name == "__init__"
            if public:
                yield from _docstrings(
                    node.body if isinstance(node, ast.ClassDef) else node.body[:1]
                )
            named = None
        elif named.startswith("_"):
            named = None


def _name(node: ast.stmt) -> str:
    """Name that an assignment binds; a string after it is its docstring."""
    target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
    return target.id if isinstance(target, ast.Name) else ""


def _without_tables(docstring: str) -> str:
    rows = COLUMNS.sub(lambda match: "\n" * match[0].count("\n"), docstring)
    return ENTRY.sub(lambda match: "\n\n" + match[0], rows)


def long_sentences(root: Path = ROOT) -> list[Sentence]:
    """Every sentence of more than MAX_WORDS words."""
    found: list[Sentence] = []
    for path in (*documents(root), root / "CONTRIBUTING.md"):
        found += sentences(prose(path.read_text("utf-8")), path.relative_to(root).as_posix())
    for folder in PRODUCT:
        for path in sorted((root / folder).rglob("*.py")):
            if any(up.is_symlink() for up in path.parents):
                continue
            name = path.relative_to(root).as_posix()
            for line, text in docstrings(path.read_text("utf-8")):
                found += sentences(_without_tables(text), name, line)
    return [sentence for sentence in found if sentence.words > MAX_WORDS]


def counts(root: Path = ROOT) -> dict[str, int]:
    """Words of each document by its path."""
    return {
        path.relative_to(root).as_posix(): len(words(prose(path.read_text("utf-8"))))
        for path in documents(root)
    }


def main(paths: list[str]) -> None:
    found = [
        sentence
        for sentence in long_sentences()
        if not paths or sentence.path.startswith(tuple(paths))
    ]
    print(*found, sep="\n")
    counted = counts()
    for path, number in counted.items():
        print(f"{path:44}{number:7,} words")
    total, readme = sum(counted.values()), counted["README.md"]
    print(f"{'all':44}{total:7,} words, at most {DOCUMENT_WORDS:,}; README at most {README_WORDS}")
    if found or total > DOCUMENT_WORDS or readme > README_WORDS:
        sys.exit(f"{len(found)} sentences of more than {MAX_WORDS} words")


if __name__ == "__main__":
    main(sys.argv[1:])
