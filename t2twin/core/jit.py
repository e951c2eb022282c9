"""Inner loops compiled by numba, their machine code kept in the cache home.

A loop is compiled at its first call, or read from the cache home where it was compiled before.
numba's own cache is not used: it notices a change in a loop's own file only, while parts of other
files may be compiled into it, and it unpickles files without a check. Here machine code is kept by
all sources in the loop's folder and in this one, and is read only while it is intact.
"""

import hashlib
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

from t2twin.core.cache_dir import cache_home, is_writable
from t2twin.core.cached_files import read_checked, write_checked
from t2twin.core.compile_ahead import announce_compiling, wait_for_helper
from t2twin.core.errors import T2TwinError

DIGITS = 16
"""Hexadecimal digits of a folder's name, 64 bits: no two will share one."""

SUFFIX = ".loop"
"""Of the files that hold machine code."""

_lock = RLock()
_config: Any = config
_njit: Any = numba.njit
"""numba's, whose types pyright cannot see."""


_preparing_s = 0.0
_depth = 0


def preparing_s() -> float:
    """Seconds that this process has compiled or read loops with a signature."""
    return _preparing_s


@contextmanager
def _timed() -> Iterator[None]:
    """Counts what `preparing_s` returns; loops that are compiled for another one count once."""
    global _preparing_s, _depth
    started, _depth = time.perf_counter(), _depth + 1
    try:
        yield
    finally:
        _depth -= 1
        if _depth == 0:
            _preparing_s += time.perf_counter() - started


def compiled(*signature: str, **options: Any) -> Callable[[Callable], Any]:
    """A decorator as numba.njit's, which takes the same but for `cache`.

    A loop with a signature takes arguments of these types only. Where nothing can be kept, the loop
    is compiled in every process. A folder that the user has given to numba (NUMBA_CACHE_DIR) is
    used instead of the cache home.
    """

    def declare(loop: Callable) -> Any:
        dispatcher = _njit(**options)(loop)
        with _lock:
            folder = _kept_in(_config.CACHE_DIR, Path(loop.__code__.co_filename).parent)
        dispatcher._cache = _MachineCode(folder, f"{loop.__module__}.{loop.__qualname__}")

        def compile_declared() -> None:
            with _lock, _timed():
                if not dispatcher._can_compile:  # another thread was first
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

        if signature:  # what numba calls for types that are not compiled yet
            dispatcher._compile_for_args = compile_for_args
            dispatcher.get_call_template = get_call_template
        return dispatcher

    return declare


class _MachineCode(NullCache):
    """The machine code of one loop, a file for each signature and kind of processor.

    folder: None keeps nothing.
    """

    def __init__(self, folder: Path | None, name: str) -> None:
        self._folder, self._name = folder, name

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What numba compiled earlier, ready to be called, or None."""
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
        """Keep what numba has compiled, where that is possible."""
        path = self._file(sig, data.target_context)
        if path is not None:
            with suppress(T2TwinError):  # then it is compiled the next time too
                write_checked(path, dumps(data._reduce()))

    def _file(self, sig: Any, target_context: Any) -> Path | None:
        """Where the machine code is kept, by all that it depends on besides the sources."""
        if self._folder is None:
            return None
        machine = target_context.codegen().magic_tuple()
        made_from = repr((self._name, sig, numba.__version__, sys.version, machine)).encode()
        short = self._name.removeprefix("t2twin.")
        return self._folder / f"{short}-{_digest(made_from)}{SUFFIX}"


@cache
def _kept_in(given: str, sources: Path) -> Path | None:
    """Where what is compiled from this folder's sources is kept; what older ones gave is removed.

    given: the folder that the user has given to numba, or "".
    """
    home = Path(given).absolute() if given else _in_cache_home()
    if home is None:
        return None
    place = home / f"{sources.name}-{_digest(str(sources).encode())}"
    used = sorted({*sources.glob("*.py"), *Path(__file__).parent.glob("*.py")})
    folder = place / _digest(b"".join(path.read_bytes() for path in used))
    if not folder.is_dir():
        for older in set(place.glob("*")) - {folder}:
            shutil.rmtree(older, ignore_errors=True)
    return folder if is_writable(folder) else None


def _in_cache_home() -> Path | None:
    home = cache_home()
    return None if home is None else home / "numba"


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:DIGITS]
