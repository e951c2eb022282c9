"""Cached files that end with a checksum: a damaged or foreign file is found before it is used.

The checksum is the CRC-32 of the file's name and content, so a file that was copied under another
name does not pass. What reads the content from the file's beginning, such as numpy.load, ignores
the eight bytes at the end.

Arrays that take long to compute, kept in the cache home.
"""

import hashlib
import io
import os
import stat
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np

from t2twin.core.cache_dir import cache_home
from t2twin.core.errors import T2TwinError
from t2twin.core.files import whole_file

MARK = b"CRC1"
"""Begins the last eight bytes of a file; the checksum follows, little-endian."""

SIZE = len(MARK) + 4

BLOCK_BYTES = 1 << 20
"""Bytes that are read at once (assumed: bounds memory)."""


def add_checksum(file: BinaryIO, name: str) -> None:
    """Appends the checksum to a file that is open for reading and writing. name: in the end."""
    file.flush()
    file.seek(0)
    checksum = _start(name)
    while block := file.read(BLOCK_BYTES):
        checksum = zlib.crc32(block, checksum)
    file.write(_trailer(checksum))


def write_checked(path: Path, content: bytes) -> None:
    """Writes a file with its checksum. Raises T2TwinError where it cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_bytes(content + _trailer(zlib.crc32(content, _start(path.name))))


def read_checked(path: Path) -> bytes | None:
    """The content of a file without its checksum; None where `is_intact` is false."""
    content = b"".join(_blocks(path))
    body, trailer = content[:-SIZE], content[-SIZE:]
    return body if trailer == _trailer(zlib.crc32(body, _start(path.name))) else None


def is_intact(path: Path) -> bool:
    """Whether this is a regular file whose checksum is that of its name and content."""
    checksum, held = _start(path.name), b""
    for block in _blocks(path):
        held += block
        checksum = zlib.crc32(held[:-SIZE], checksum)
        held = held[-SIZE:]
    return held == _trailer(checksum)


def _blocks(path: Path) -> Iterator[bytes]:
    """A regular file's content; nothing of anything else, such as a pipe, and of no file."""
    try:
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # waits for no pipe
        try:
            if stat.S_ISREG(os.fstat(number).st_mode):
                while block := os.read(number, BLOCK_BYTES):
                    yield block
        finally:
            os.close(number)
    except OSError:
        return


def _start(name: str) -> int:
    return zlib.crc32(os.fsencode(name))


def _trailer(checksum: int) -> bytes:
    return MARK + checksum.to_bytes(4, "little")


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
