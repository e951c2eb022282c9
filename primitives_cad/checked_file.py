"""Files of the cache home, which are used only while they are exactly what was written.

A file holds a digest of its key and its content, and then the content. A file that is damaged, cut
short or written for another key, and whatever else lies under its name, counts as missing.
"""

import hashlib
from contextlib import suppress
from pathlib import Path

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file

DIGEST_BYTES = 16
"""Bytes of the digest, 128 bits: damage goes unnoticed with a probability of 2^-128."""


def read_checked(path: Path, key: bytes) -> bytes | None:
    """The content that was written under this key; None where it is missing or not intact."""
    try:
        if not path.is_file():  # opening a pipe would wait for its writer
            return None
        whole = path.read_bytes()
    except OSError:
        return None
    content = whole[DIGEST_BYTES:]
    return content if whole[:DIGEST_BYTES] == _digest(key, content) else None


def write_checked(path: Path, key: bytes, content: bytes) -> None:
    """Write a content for `read_checked`. Raises T2TwinError where the file cannot be written."""
    with whole_file(path) as temporary:
        temporary.write_bytes(_digest(key, content) + content)


def try_write_checked(path: Path, key: bytes, content: bytes) -> None:
    """As `write_checked`; does nothing where the file cannot be written."""
    with suppress(T2TwinError):
        write_checked(path, key, content)


def _digest(key: bytes, content: bytes) -> bytes:
    digest = hashlib.blake2b(len(key).to_bytes(8, "little") + key, digest_size=DIGEST_BYTES)
    digest.update(content)
    return digest.digest()
