"""Sizes of modules, functions and folders, part of `make check`. Imports no product code."""

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("t2twin", "translate", "sim", "primitives_cad")

MAX_MODULE_LINES = 500
MAX_FUNCTION_LINES = 60
MAX_MODULES = 20
"""Modules of a folder of product code or benchmarks, without __init__.py."""

SHORT_LINES, MAX_SHORT_MODULES = 40, 15
"""Modules below SHORT_LINES lines, and how many of them there may be, without __init__.py."""


def modules(*folders: str) -> Iterator[tuple[str, str]]:
    """Paths from the root, and texts, of all modules; folders that are links are left out."""
    for folder in folders:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not any(parent.is_symlink() for parent in path.parents):
                yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")


def functions(path: str, text: str) -> Iterator[tuple[str, int]]:
    """Place and number of lines of every function; its decorators are not counted."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{path}:{node.lineno} {node.name}", (node.end_lineno or 0) - node.lineno + 1


def over(sizes: Iterator[tuple[str, int]], limit: int) -> list[str]:
    return [f"{place}: {size}" for place, size in sizes if size > limit]


def test_modules_are_short():
    sizes = ((path, text.count("\n")) for path, text in modules(*PRODUCT))
    assert not over(sizes, MAX_MODULE_LINES)


def test_functions_are_short():
    sizes = (each for module in modules(*PRODUCT) for each in functions(*module))
    assert not over(sizes, MAX_FUNCTION_LINES)


def test_few_modules_are_very_short():
    short = [
        path
        for path, text in modules(*PRODUCT)
        if text.count("\n") < SHORT_LINES and not path.endswith("__init__.py")
    ]
    assert len(short) <= MAX_SHORT_MODULES, short


def test_folders_have_few_modules():
    counts = Counter(
        str(Path(path).parent)
        for path, _ in modules(*PRODUCT, "benchmarks")
        if not path.endswith("__init__.py")
    )
    assert not over(iter(counts.items()), MAX_MODULES)
