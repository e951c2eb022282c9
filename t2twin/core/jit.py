"""Functions compiled by numba, with their machine code in the cache directory.

A function is compiled at its first call, or loaded if it was compiled before. Numba's cache detects
changes only in a function's own file, although code of other files is compiled into it. Here its
folder is named after a digest of all sources of the function's package, of this module and of the
version of rocket-fft.
"""

import gc
import logging
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from threading import RLock
from typing import Any

import numba
from filelock import FileLock, Timeout
from numba.core import config
from numba.core.caching import FunctionCache, NullCache

from t2twin.core.cache_dir import cache_dir, is_writable
from t2twin.core.cached_files import short_digest

PACKAGE_LEVEL = 3
"""Dots in the name of a module; modules with more belong to a package at this level."""

INNER = {"no_cpython_wrapper": True}
"""Options of a function that only compiled functions call: Python cannot call it."""

_lock = RLock()
_config: Any = config
_njit: Any = numba.njit
"""Of numba, whose types pyright cannot resolve."""

COMPILE_TIMEOUT_S = 60.0
"""Longest wait for another process that compiles a function, seconds (assumed: several times what
the largest takes)."""

_log = logging.getLogger("t2twin")
_has_compiled = False
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


@contextmanager
def _without_collections() -> Iterator[None]:
    """Collect no garbage within the block: compiling takes a tenth less time."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


def compiled(*signature: str, **options: Any) -> Callable[[Callable], Any]:
    """A decorator with the arguments of numba.njit, except `cache`.

    A function with a signature accepts only these types, and its method `prepare` compiles it
    without a call. A division by zero gives inf or nan. Without a cache directory the function is
    compiled in every process. NUMBA_CACHE_DIR replaces the cache directory.
    """
    # A wrapper for C callers would take a tenth of the time to compile.
    options = {"error_model": "numpy", "no_cfunc_wrapper": True, **options}

    def declare(function: Callable) -> Any:
        dispatcher = _njit(**options)(function)
        dispatcher._cache = _machine_code(function)

        def compile_declared() -> None:
            with _lock, _timed(), _without_collections():
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
            dispatcher.prepare = compile_declared
        return dispatcher

    return declare


class _MachineCode(FunctionCache):
    """Numba's cache of a function. A damaged file and a full disk are as if there was no cache.

    One process at a time compiles a function; others wait for it and load the result.
    """

    def __init__(self, function: Callable) -> None:
        super().__init__(function)
        place = Path(self._cache_path, f"{self._impl.filename_base}.lock")
        self._lock = FileLock(place, timeout=COMPILE_TIMEOUT_S, thread_local=False)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for a signature, or None."""
        global _has_compiled
        found = self._loaded(sig, target_context)
        if found is None:
            with suppress(OSError, Timeout):
                self._lock.acquire()
            found = self._loaded(sig, target_context)
            if found is not None:
                self._release()
        if found is None and not _has_compiled:
            _has_compiled = True
            _log.info("compiling numerical loops for their first use here, up to a minute")
        return found

    def _loaded(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # a damaged pickle raises errors of many types
            with suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store a compiled function, if possible."""
        with suppress(Exception):
            super().save_overload(sig, data)
        self._release()

    def _release(self) -> None:
        if self._lock.is_locked:
            with suppress(OSError):  # a process that waits for the file still gets it
                Path(self._lock.lock_file).unlink(missing_ok=True)
        self._lock.release(force=True)


def _machine_code(function: Callable) -> FunctionCache | NullCache:
    """The cache of a function."""
    # Loops of one package, with its subpackages, inline each other.
    level = max(0, function.__module__.count(".") - PACKAGE_LEVEL)
    with _lock:
        given = _config.CACHE_DIR
        folder = _code_folder(given, Path(function.__code__.co_filename).parents[level])
        if folder is None:
            return NullCache()
        _config.CACHE_DIR = str(folder)  # read by the constructor
        try:
            return _MachineCode(function)
        finally:
            _config.CACHE_DIR = given


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
