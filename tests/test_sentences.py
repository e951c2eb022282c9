"""Sentences of the documents and of public docstrings are short, and so are the documents."""

import ast
import re

from documents import CONTRIBUTING, ROOT, documents, prose
from test_structure import PRODUCT, modules

MAX_WORDS = 30
README_WORDS, DOCUMENT_WORDS = 800, 11_000
"""Limits on the words of the README, and of all documents with the README."""

END = re.compile(
    r"(?<=[.!?])[\"')\]]*\s+"  # of a sentence
    r"|\n\s*\n|\n\s*(?=(?:[-*#>]|\d+\.)\s)|\n(?=#)"  # of a paragraph or an item of a list
    r"|\n(?=\s*\w[\w, *]*: )|^\s*(?:Args|Returns|Raises|Yields):\s*$"  # of an argument
    r"|^.*\S {3,}\S.*$(?:\n {12,}\S.*$)*",  # a table in a docstring
    re.MULTILINE,
)


def words(text: str) -> int:
    """Number of words; numbers and signs are none."""
    return sum(bool(re.search(r"[^\W\d_]", word)) for word in text.split())


def test_sentences_are_short():
    texts = {str(path.relative_to(ROOT)): prose(path) for path in (*documents(), CONTRIBUTING)}
    for path, text in modules(*PRODUCT, "benchmarks"):
        nodes = [*ast.walk(ast.parse(text))]
        functions = [node for node in nodes if isinstance(node, ast.FunctionDef)]
        private = {each.body[0] for each in functions if each.name.startswith("_")}
        for node in {*nodes} - private:
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                texts[f"{path}:{node.lineno}"] = str(node.value.value)
    sentences = ((place, part) for place, text in texts.items() for part in END.split(text))
    assert not [f"{place}: {part}" for place, part in sentences if words(part) > MAX_WORDS]


def test_documents_are_short():
    assert words(prose(ROOT / "README.md")) <= README_WORDS
    assert sum(words(prose(path)) for path in documents()) <= DOCUMENT_WORDS
