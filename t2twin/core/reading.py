"""Reads files named by the user: regular files up to a size."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import BinaryIO

from t2twin.core.errors import T2TwinError

MAX_TABLE_BYTES = 100_000_000
"""Size limit of tables and descriptions, bytes (assumed: about 700,000 rows of 20 counts)."""


def read_file(path: Path, max_bytes: int = MAX_TABLE_BYTES, otherwise: str = "") -> bytes:
    """The content of a regular file of at most `max_bytes`; see `open_regular`."""
    with open_regular(path, max_bytes, otherwise) as file:
        return file.read()


@contextmanager
def open_regular(
    path: Path, max_bytes: int = MAX_TABLE_BYTES, otherwise: str = ""
) -> Iterator[BinaryIO]:
    """A regular file of at most `max_bytes`, open for reading in binary mode.

    otherwise: alternative to a file that does not exist, for the message. Never blocks, as opening
    a named pipe would.
    Raises T2TwinError where the file does not exist, is a folder, a pipe, a socket or a device,
    cannot be read, or is larger.
    """
    file = None
    try:
        about = path.stat()
        if S_ISREG(about.st_mode) and about.st_size <= max_bytes:
            file = path.open("rb")
    except FileNotFoundError as error:
        also = f"; {otherwise}" if otherwise else ""
        raise T2TwinError(f"there is no file {path}{also}") from error
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise T2TwinError(f"{path} cannot be read ({reason}); give a readable file") from error
    if file is None:
        raise T2TwinError(_refusal(path, about.st_mode, about.st_size, max_bytes))
    with file:
        yield file


def _refusal(path: Path, mode: int, size: int, max_bytes: int) -> str:
    if S_ISDIR(mode):
        return f"{path} is a folder; give a file in it"
    if not S_ISREG(mode):
        return f"{path} is not a file but a pipe or a device; give a file"
    return f"{path} has {size / 1e6:,.0f} MB; at most {max_bytes / 1e6:,.0f} MB are allowed"
