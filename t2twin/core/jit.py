"""Functions compiled by numba, with their machine code in the cache directory.

A function is compiled at its first call, or loaded if it was compiled before. Numba's own cache is
not used: it detects changes only in a function's own file, although code of other files is compiled
into it, and it unpickles files without a check. Here the key includes all sources of the function's
package and of this one, and a file is loaded only if its checksum is right.
"""

import pickle
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from threading import RLock
from typing import Any

import numba
from numba.core import config
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

from t2twin.core.cache_dir import cache_dir, is_writable
from t2twin.core.cached_files import read_checked, short_digest, write_checked
from t2twin.core.compile_ahead import announce_compiling, wait_for_helper
from t2twin.core.errors import T2TwinError

PACKAGE_LEVEL = 3
"""Dots in t2twin.sim.digit.optics; modules with more belong to a package at this level."""

SUFFIX = ".loop"
"""Suffix of the files with machine code."""

_lock = RLock()
_config: Any = config
_njit: Any = numba.njit
"""Of numba, whose types pyright cannot resolve."""

_compile_time_s = 0.0
_depth = 0


def compile_time_s() -> float:
    """Seconds that this process has spent on compiling and loading functions with a signature."""
    return _compile_time_s


@contextmanager
def _timed() -> Iterator[None]:
    """Add the block's duration to `compile_time_s`; nested blocks count once."""
    global _compile_time_s, _depth
    started, _depth = time.perf_counter(), _depth + 1
    try:
        yield
    finally:
        _depth -= 1
        if _depth == 0:
            _compile_time_s += time.perf_counter() - started


def compiled(*signature: str, **options: Any) -> Callable[[Callable], Any]:
    """A decorator with the arguments of numba.njit, except `cache`.

    A function with a signature accepts only these types. Without a cache directory it is compiled
    in every process. NUMBA_CACHE_DIR replaces the cache directory.
    """

    def declare(function: Callable) -> Any:
        dispatcher = _njit(**options)(function)
        # Loops of one package, such as t2twin.sim.digit with its subpackages, inline each other.
        level = max(0, function.__module__.count(".") - PACKAGE_LEVEL)
        sources = Path(function.__code__.co_filename).parents[level]
        with _lock:
            folder = _code_folder(_config.CACHE_DIR, sources)
        name = f"{function.__module__}.{function.__qualname__}"
        dispatcher._cache = _MachineCode(folder, name)

        def compile_declared() -> None:
            with _lock, _timed():
                if not dispatcher._can_compile:  # another thread has compiled it
                    return
                for each in signature:
                    dispatcher.compile(each)
                dispatcher.disable_compile()
                for name in ("_compile_for_args", "get_call_template"):
                    vars(dispatcher).pop(name, None)

        def compile_for_args(*_: Any, **__: Any) -> Any:
            compile_declared()
            return dispatcher

        def get_call_template(*given: Any) -> Any:
            compile_declared()
            return dispatcher.get_call_template(*given)

        if signature:  # numba calls these for types that are not compiled yet
            dispatcher._compile_for_args = compile_for_args
            dispatcher.get_call_template = get_call_template
        return dispatcher

    return declare


class _MachineCode(NullCache):
    """The machine code of one function, one file for each signature and type of processor.

    folder: None to store nothing.
    """

    def __init__(self, folder: Path | None, name: str) -> None:
        self._folder, self._name = folder, name

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for a signature, or None."""
        target_context.refresh()
        path = self._file(sig, target_context)
        content = None if path is None else read_checked(path)
        if content is None and path is not None and "t2twin.sim.digit." in self._name:
            wait_for_helper()
            content = read_checked(path)
        if content is None:
            announce_compiling()
            return None
        return CompileResult._rebuild(target_context, *pickle.loads(content))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled function, if possible."""
        path = self._file(sig, data.target_context)
        if path is not None:
            with suppress(T2TwinError):  # a full disk: it is compiled the next time too
                write_checked(path, dumps(data._reduce()))

    def _file(self, sig: Any, target_context: Any) -> Path | None:
        """The file of a signature; its name depends on everything but the sources."""
        if self._folder is None:
            return None
        machine = target_context.codegen().magic_tuple()
        key = repr((self._name, sig, numba.__version__, sys.version, machine)).encode()
        short = self._name.removeprefix("t2twin.")
        return self._folder / f"{short}-{short_digest(key)}{SUFFIX}"


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
    used = sorted({*sources.rglob("*.py"), *Path(__file__).parent.glob("*.py")})
    folder = place / short_digest(b"".join(path.read_bytes() for path in used))
    if not folder.is_dir():
        for older in set(place.glob("*")) - {folder}:
            shutil.rmtree(older, ignore_errors=True)
    return folder if is_writable(folder) else None
