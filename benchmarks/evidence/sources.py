"""The sources that a benchmark's figures depend on, found by following imports, and their digests.

A digest is of what a module does: comments, docstrings and formatting are not in it.
"""

import ast
import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from benchmarks import ROOT
from benchmarks.evidence.record import Benchmark
from t2twin.core.errors import T2TwinError

MEASURED = ("t2twin", "benchmarks")
"""Packages whose imports are followed."""

MACHINERY = ("benchmarks.evidence", "benchmarks.documents", "benchmarks.declared")
"""What runs benchmarks and keeps their results; no figure depends on it."""

SHAPES = tuple(
    f"t2twin.primitives_cad.{name}"
    for name in ("primitive_parameters", "solids", "height_map", "tools")
)
"""Modules and packages that hold the shapes' parameters, or make solids and surfaces of them."""

DATA_SUFFIXES = (".csv", ".json", ".npz", ".png")
"""Files beside a module that it may read."""

DIGITS = 12
"""Hexadecimal digits of a digest: 48 bits."""


@dataclass(frozen=True)
class Sources:
    """Digests by module or data file. shapes: those of the shapes' parameters, empty for a
    benchmark that does not depend on them; code: all others."""

    code: dict[str, str]
    shapes: dict[str, str]


class SourceTree:
    """The modules below a copy of the repository, each read once."""

    def __init__(self, root: Path = ROOT) -> None:
        self.root = root
        self._trees: dict[str, ast.Module] = {}
        self._imports: dict[str, frozenset[str]] = {}
        self._digests: dict[str, str] = {}

    def sources_of(self, benchmark: Benchmark) -> Sources:
        """What a benchmark depends on, with digests."""
        names = self.modules_of(benchmark)
        digests = {name: self._digest(name) for name in sorted(names)}
        digests |= {self._name(path): _sha256(path.read_bytes()) for path in self._data(names)}
        if benchmark.shapes:
            digests |= {name: self._digest(name) for name in self.shape_modules}
        shapes = {name: digest for name, digest in digests.items() if _below(name, SHAPES)}
        code = {name: digest for name, digest in digests.items() if name not in shapes}
        return Sources(code, shapes if benchmark.shapes else {})

    def files_of(self, benchmark: Benchmark) -> list[Path]:
        """The files of the modules and data that a benchmark depends on."""
        names = self.modules_of(benchmark)
        if benchmark.shapes:
            names |= set(self.shape_modules)
        return sorted({*(self._path(name) for name in names), *self._data(names)})

    def modules_of(self, benchmark: Benchmark) -> set[str]:
        """The modules that a benchmark depends on: its own, its entries, and what they import."""
        seen: set[str] = set()
        waiting = [benchmark.module, *benchmark.entries]
        while waiting:
            name = waiting.pop()
            if name not in seen and not _below(name, (*MACHINERY, *benchmark.apart_from)):
                seen.add(name)
                waiting += self._imported_by(name)
        return seen

    @cached_property
    def shape_modules(self) -> tuple[str, ...]:
        """All modules of SHAPES, also those that are imported by a name made up at run time."""
        names = []
        for name in SHAPES:
            path = self._path(name)
            names.append(name)
            if path.name == "__init__.py":
                inside = (each.stem for each in path.parent.glob("*.py") if each != path)
                names += sorted(f"{name}.{stem}" for stem in inside)
        return tuple(names)

    def _imported_by(self, name: str) -> frozenset[str]:
        if name not in self._imports:
            tree, here = self._tree(name), self._package(name)
            self._imports[name] = frozenset(
                imported for node in _at_run_time(tree) for imported in self._named_in(node, here)
            )
        return self._imports[name]

    def _named_in(self, node: ast.AST, package: str) -> Iterator[str]:
        """The modules of MEASURED that an import statement names."""
        if isinstance(node, ast.Import):
            for alias in node.names:
                if self._exists(alias.name):
                    yield alias.name
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".")[: len(package.split(".")) + 1 - node.level]
            start = ".".join(parents) if node.level else ""
            origin = ".".join(part for part in (start, node.module) if part)
            for alias in node.names:
                # What is no module by that name is something that its package defines.
                inner = f"{origin}.{alias.name}"
                if self._exists(inner):
                    yield inner
                elif self._exists(origin):
                    yield origin

    def _exists(self, name: str) -> bool:
        return name.split(".")[0] in MEASURED and self._find(name) is not None

    def _find(self, name: str) -> Path | None:
        place = self.root.joinpath(*name.split("."))
        candidates = (place.with_name(f"{place.name}.py"), place / "__init__.py")
        return next((path for path in candidates if path.is_file()), None)

    def _path(self, name: str) -> Path:
        path = self._find(name)
        if path is None:
            raise T2TwinError(f"there is no module {name}; name one that is there")
        return path

    def _package(self, name: str) -> str:
        return name if self._path(name).name == "__init__.py" else name.rpartition(".")[0]

    def _tree(self, name: str) -> ast.Module:
        if name not in self._trees:
            self._trees[name] = ast.parse(self._path(name).read_bytes())
        return self._trees[name]

    def _digest(self, name: str) -> str:
        if name not in self._digests:
            self._digests[name] = _sha256(_meaning(self._tree(name)).encode())
        return self._digests[name]

    def _data(self, names: Iterable[str]) -> set[Path]:
        """Data files beside modules of t2twin, and in folders there that are no packages."""
        folders = {self._path(name).parent for name in names if name.startswith("t2twin.")}
        folders |= {
            inner
            for folder in folders
            for inner in folder.iterdir()
            if inner.is_dir() and not (inner / "__init__.py").is_file()
        }
        return {p for folder in folders for p in folder.iterdir() if p.suffix in DATA_SUFFIXES}

    def _name(self, path: Path) -> str:
        return path.relative_to(self.root).as_posix()


def _below(name: str, packages: Iterable[str]) -> bool:
    return any(name == package or name.startswith(f"{package}.") for package in packages)


def _at_run_time(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes but what is only there for type checkers."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        yield node
        yield from _at_run_time(node)


def _meaning(node: object) -> str:
    """A syntax tree in words, the same in all versions of Python: docstrings, and strings that
    stand alone below a constant, are left out, and so is every field that is empty."""
    if isinstance(node, list):
        kept = (part for part in node if not _is_docstring(part))
        return f"[{','.join(_meaning(part) for part in kept)}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = (
        f"{name}={_meaning(part)}"
        for name, part in ast.iter_fields(node)
        if part is not None and part != [] and name != "kind"
    )
    return f"{type(node).__name__}({','.join(fields)})"


def _is_docstring(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]
