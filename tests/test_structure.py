"""Lines of the project and lengths of functions, part of `make check`. Imports no product code."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PRODUCT = ("t2twin", "translate", "sim", "primitives_cad", "maintenance")

BUDGET = {
    "t2twin": 9_249,
    "translate": 7_596,
    "sim": 14_908,
    "primitives_cad": 2_540,
    "maintenance": 615,
    "tests": 18_998,
    "benchmarks": 6_967,
}
"""Lines of Python of each folder. A budget only falls: lower it when a folder shrinks."""

MAX_FUNCTION_LINES = 60


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


@pytest.mark.parametrize("folder", BUDGET)
def test_folder_keeps_its_budget(folder):
    assert sum(text.count("\n") for _, text in modules(folder)) <= BUDGET[folder]


def test_functions_are_short():
    sizes = (each for module in modules(*PRODUCT) for each in functions(*module))
    assert not [f"{place}: {size}" for place, size in sizes if size > MAX_FUNCTION_LINES]
