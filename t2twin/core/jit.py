"""Functions compiled by numba at their first call, with their machine code in the cache directory.

Numba's cache detects changes only in a function's own file, although code of other files is
compiled into it. Here its folder is named after a digest of all sources of the function's package,
of this module and of the version of rocket-fft.
"""

import logging
import shutil
import sys
import time
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numba
from numba.core import event

from t2twin.core.cache_dir import cache_dir, is_writable, short_digest

_modules: Any = sys.modules
_is_hidden = _modules.setdefault("scipy.fft") is None  # rocket_fft imports it, for half a second
from rocket_fft import c2c, c2r, next_fast_len, r2c  # noqa: E402, F401

if _is_hidden:
    del _modules["scipy.fft"]

PACKAGE_LEVEL = 3
"""Dots in the name of a module; modules with more belong to a package at this level."""

INNER = {"no_cpython_wrapper": True}
"""Options of a function that only compiled functions call: Python cannot call it."""

_numba: Any = numba
"""Of numba, whose types pyright cannot resolve."""


class _Compiling(event.Listener):
    """Measures the time of compiling and loading, and gives a notice before the first compiling."""

    seconds, depth, is_noticed = 0.0, 0, False

    def on_start(self, event: Any) -> None:
        """A function begins to be compiled, perhaps within another."""
        if event.kind == "numba:compile" and not self.is_noticed:
            self.is_noticed = True
            logging.getLogger("t2twin").info(
                "compiling numerical loops for their first use here, up to a minute"
            )
        if not self.depth:
            self.started = time.perf_counter()
        self.depth += 1

    def on_end(self, event: Any) -> None:
        """A function is compiled."""
        self.depth -= 1
        if not self.depth:
            self.seconds += time.perf_counter() - self.started


_compiling = _Compiling()
for kind in ("numba:compile", "numba:compiler_lock"):
    event.register(kind, _compiling)


def compile_time_s() -> float:
    """Seconds that this process has spent on compiling and loading functions."""
    return _compiling.seconds


def compiled(**options: Any) -> Callable[[Callable], Any]:
    """A decorator with the arguments of numba.njit, except `cache`; it compiles at the first call.

    A division by zero gives inf or nan. Without a cache directory the function is compiled in every
    process. NUMBA_CACHE_DIR replaces the cache directory.
    """
    # A wrapper for C callers would take a tenth of the time to compile.
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}

    def declare(function: Callable) -> Any:
        # Loops of one package, with its subpackages, inline each other.
        level = max(0, function.__module__.count(".") - PACKAGE_LEVEL)
        given = _numba.config.CACHE_DIR
        folder = _code_folder(given, Path(function.__code__.co_filename).parents[level])
        _numba.config.CACHE_DIR = given if folder is None else str(folder)
        try:
            return _numba.njit(cache=folder is not None, **options)(function)
        finally:
            _numba.config.CACHE_DIR = given

    return declare


def cached_code(module: str) -> list[Path] | None:
    """The cached functions of the package of a module's file; None without a cache directory."""
    folder = _code_folder(_numba.config.CACHE_DIR, Path(module).parent)
    return None if folder is None else list(folder.rglob("*.nbi"))


@cache
def _code_folder(numba_folder: str, sources: Path) -> Path | None:
    """The folder for machine code from a package's sources; removes that of older sources.

    numba_folder: NUMBA_CACHE_DIR, or "".
    """
    root = Path(numba_folder).absolute() if numba_folder else cache_dir()
    if root is None:
        return None
    if not numba_folder:
        root /= "numba"
    place = root / f"{sources.name}-{short_digest(str(sources).encode())}"
    used = sorted({*sources.rglob("*.py"), Path(__file__)})
    # FFTs are calls of a library, whose form depends on its version.
    content = [path.read_bytes() for path in used] + [version("rocket-fft").encode()]
    folder = place / short_digest(b"".join(content))
    if not folder.is_dir():
        for older in set(place.glob("*")) - {folder}:
            shutil.rmtree(older, ignore_errors=True)
    return folder if is_writable(folder) else None
