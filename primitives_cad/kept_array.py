"""Arrays that take long to compute, kept in the cache home."""

import hashlib
import io
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from t2twin.primitives_cad.cache_home import cache_home
from t2twin.primitives_cad.checksum import read_checked, write_checked
from t2twin.primitives_cad.errors import T2TwinError

DIGITS = 16
"""Hexadecimal digits of a file's name, 64 bits: no two will share one."""

SUFFIX = ".npy"

MAX_FILES = 200
"""Most arrays of one kind (assumed: some dozen elastomers); the oldest are removed."""


def kept_array(kind: str, key: str, source: str, compute: Callable[[], np.ndarray]) -> np.ndarray:
    """The array that `compute` returns, computed once for each key.

    kind: folder in the cache home. key: all that the array depends on, besides the code in the file
    `source`. Where nothing can be kept, the array is computed at every call.
    """
    home = cache_home()
    if home is None:
        return compute()
    digest = hashlib.sha256(key.encode() + Path(source).read_bytes()).hexdigest()
    path = home / kind / f"{digest[:DIGITS]}{SUFFIX}"
    content = read_checked(path)
    if content is not None:
        return np.load(io.BytesIO(content), allow_pickle=False)
    values, packed = compute(), io.BytesIO()
    np.save(packed, values)
    with suppress(T2TwinError, OSError):  # no room, or another process may remove them
        write_checked(path, packed.getvalue())
        kept = sorted(path.parent.glob(f"*{SUFFIX}"), key=lambda each: each.stat().st_mtime)
        for oldest in kept[:-MAX_FILES]:
            oldest.unlink()
    return values
