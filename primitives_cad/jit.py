"""Inner loops compiled by numba, their machine code kept in the cache home.

numba itself notices a change in a loop's own file only, while parts of other files may be compiled
into it. So what is kept goes by all sources in the loop's folder and in this one as well.
"""

import hashlib
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path
from threading import RLock
from typing import Any

import numba
from numba.core import config

from t2twin.primitives_cad.cache_home import cache_home, is_writable

DIGITS = 16
"""Hexadecimal digits of a folder's name, 64 bits: no two will share one."""

_lock = RLock()
_config: Any = config
_njit: Any = numba.njit
"""numba's, whose types pyright cannot see."""


def compiled(*signature: str, **options: Any) -> Callable[[Callable], Any]:
    """A decorator as numba.njit's, which takes the same but for `cache`.

    Where nothing can be kept, the loop is compiled in every process anew. A folder that the user
    has given to numba (NUMBA_CACHE_DIR) is taken instead of the cache home.
    """

    def compile_loop(loop: Callable) -> Any:
        with _lock:
            given = _config.CACHE_DIR
            kept = _kept_in(given, Path(loop.__code__.co_filename).parent)
            _config.CACHE_DIR = str(kept or "")
            try:
                return _njit(*signature, cache=kept is not None, **options)(loop)
            finally:
                _config.CACHE_DIR = given  # a user's own loops are none of ours

    return compile_loop


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
