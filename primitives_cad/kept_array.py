"""Arrays that take long to compute, kept in the cache home."""

import hashlib
import io
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from t2twin.primitives_cad.cache_home import cache_home
from t2twin.primitives_cad.checked_file import read_checked, try_write_checked

SUFFIX = ".npy.kept"

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
    whole_key = key.encode() + Path(source).read_bytes()
    path = home / kind / f"{hashlib.sha256(whole_key).hexdigest()[:16]}{SUFFIX}"
    content = read_checked(path, whole_key)
    if content is not None:
        return np.load(io.BytesIO(content), allow_pickle=False)
    values, packed = compute(), io.BytesIO()
    np.save(packed, values)
    try_write_checked(path, whole_key, packed.getvalue())
    with suppress(OSError):  # another process may remove them at the same time
        kept = sorted(path.parent.glob(f"*{SUFFIX}"), key=lambda each: each.stat().st_mtime)
        for oldest in kept[:-MAX_FILES]:
            oldest.unlink()
    return values
