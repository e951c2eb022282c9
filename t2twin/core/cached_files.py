"""Files of the cache, which end with a checksum, and arrays that are cached in them.

The checksum is the CRC-32 of the file's name and content, so that damaged files and files of
another name are detected. Readers that start at the beginning, such as numpy.load, ignore the last
eight bytes.
"""

import hashlib
import io
import os
import sys
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np

from t2twin.core.cache_dir import cache_dir
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write, open_regular

MARK = b"CRC1"
"""Start of the trailer; the checksum follows, little-endian."""

TRAILER_BYTES = len(MARK) + 4

BLOCK_BYTES = 1 << 20
"""Bytes read at a time (assumed: bounds memory)."""

DIGEST_DIGITS = 16
"""Hexadecimal digits of a digest in a file name, 64 bits: collisions are negligible."""

ARRAY_SUFFIX = ".npy"

MAX_ARRAYS = 200
"""Limit on the arrays of one kind (assumed: some dozen elastomers); the oldest are removed."""


def short_digest(content: bytes) -> str:
    """The first DIGEST_DIGITS hexadecimal digits of the SHA-256."""
    return hashlib.sha256(content).hexdigest()[:DIGEST_DIGITS]


def cached_file(
    path: Path, shape: tuple[int | None, ...], write: Callable[[BinaryIO], object]
) -> None:
    """Write an .npy file with its checksum, unless it exists, intact and of this shape.

    shape: of the array; None stands for any length. write: writes the .npy file.
    """
    if _has_shape(path, shape):
        return
    with atomic_write(path) as temporary, temporary.open("w+b") as file:
        write(file)
        file.flush()
        file.seek(0)
        checksum = _start(path.name)
        while block := file.read(BLOCK_BYTES):
            checksum = zlib.crc32(block, checksum)
        file.write(_trailer(checksum))


def _has_shape(path: Path, shape: tuple[int | None, ...]) -> bool:
    if not is_intact(path):
        return False
    try:
        found = np.load(path, mmap_mode="r").shape
    except Exception:  # a damaged header raises errors of many types
        return False
    return len(found) == len(shape) and all(
        expected in (None, length) for length, expected in zip(found, shape, strict=True)
    )


def write_checked(path: Path, content: bytes, most: int | None = None) -> None:
    """Write a file with its checksum. Raises T2TwinError where that fails.

    most: number of files of this suffix in the folder; the oldest others are removed.
    """
    with atomic_write(path) as temporary:
        temporary.write_bytes(content + _trailer(zlib.crc32(content, _start(path.name))))
    if most is not None:
        with suppress(OSError):  # another process may remove them at the same time
            files = path.parent.glob(f"*{path.suffix}")
            for oldest in sorted(files, key=lambda each: each.lstat().st_mtime)[:-most]:
                oldest.unlink()


def read_checked(path: Path) -> bytes | None:
    """The content of a file without its checksum; None unless `is_intact`."""
    content = b"".join(_blocks(path))
    body, trailer = content[:-TRAILER_BYTES], content[-TRAILER_BYTES:]
    return body if trailer == _trailer(zlib.crc32(body, _start(path.name))) else None


def is_intact(path: Path) -> bool:
    """Whether this is a regular file whose checksum is that of its name and content."""
    checksum, tail = _start(path.name), b""
    for block in _blocks(path):
        tail += block
        checksum = zlib.crc32(tail[:-TRAILER_BYTES], checksum)
        tail = tail[-TRAILER_BYTES:]
    return tail == _trailer(checksum)


def _blocks(path: Path) -> Iterator[bytes]:
    """A regular file's content; nothing where there is no file, or a pipe or a device."""
    with suppress(T2TwinError, OSError), open_regular(path, sys.maxsize) as file:
        while block := file.read(BLOCK_BYTES):
            yield block


def _start(name: str) -> int:
    return zlib.crc32(os.fsencode(name))


def _trailer(checksum: int) -> bytes:
    return MARK + checksum.to_bytes(4, "little")


def cached_array(kind: str, key: str, source: str, compute: Callable[[], np.ndarray]) -> np.ndarray:
    """The array that `compute` returns, computed once for each key.

    kind: subfolder of the cache directory. key: everything that the array depends on, besides the
    code in the file `source`. Without a cache directory the array is computed at every call.
    """
    folder = cache_dir()
    if folder is None:
        return compute()
    digest = short_digest(key.encode() + Path(source).read_bytes())
    path = folder / kind / f"{digest}{ARRAY_SUFFIX}"
    content = read_checked(path)
    if content is not None:
        return np.load(io.BytesIO(content), allow_pickle=False)
    values, buffer = compute(), io.BytesIO()
    np.save(buffer, values)
    with suppress(T2TwinError):  # a full disk
        write_checked(path, buffer.getvalue(), MAX_ARRAYS)
    return values
