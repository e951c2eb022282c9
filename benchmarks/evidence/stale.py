"""Staleness: which sources of a benchmark changed since its results were measured."""

import ast
from pathlib import Path

from benchmarks import ROOT
from benchmarks.evidence.record import Benchmark
from benchmarks.evidence.results import git, read_results
from t2twin.core.errors import T2TwinError

BASELINE = "0d1cde67c747"
"""Commit from which changes count. Results of earlier commits count as measured at it."""


def changed_sources(
    benchmark: Benchmark, root: Path = ROOT, baseline: str = BASELINE
) -> list[str] | None:
    """The sources that differ from the measured commit.

    Uncommitted changes of tracked files count; changes of comments and docstrings do not. None if
    there are no results. A baseline benchmark is never stale.

    Raises T2TwinError if the repository at root lacks the history.
    """
    if benchmark.is_baseline:
        return []
    if not benchmark.results.is_file():
        return None
    measured = read_results(benchmark.results).measured_on.commit.removesuffix("+")
    if git("cat-file", "-e", f"{baseline}^{{commit}}", root=root) is None:
        raise T2TwinError(
            f"{root} has no git history back to {baseline}; clone the whole repository to find "
            "stale results"
        )
    is_later = git("merge-base", "--is-ancestor", baseline, measured, root=root) is not None
    since = measured if is_later else baseline
    return [source for source in benchmark.sources if _has_changed(source, since, root)]


def _has_changed(source: str, commit: str, root: Path) -> bool:
    paths = git("diff", "--name-only", "--no-renames", commit, "--", source, root=root) or ""
    return any(_code_differs(path, commit, root) for path in paths.splitlines())


def _code_differs(path: str, commit: str, root: Path) -> bool:
    """Whether a file that changed since a commit differs in more than comments and docstrings."""
    before, now = git("show", f"{commit}:{path}", root=root), root / path
    if before is None or not now.is_file() or now.suffix != ".py":
        return True
    try:
        return _code(before) != _code(now.read_text("utf-8"))
    except SyntaxError:
        return True


def _code(text: str) -> str:
    """The syntax tree of a module, without docstrings."""
    return ast.dump(_WithoutDocstrings().visit(ast.parse(text)))


class _WithoutDocstrings(ast.NodeTransformer):
    """Removes the strings that stand alone as statements."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        value = node.value
        is_string = isinstance(value, ast.Constant) and isinstance(value.value, str)
        return None if is_string else node
