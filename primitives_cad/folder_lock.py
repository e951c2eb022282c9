"""One writer a folder: whoever writes more than one file into it holds its lock meanwhile."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import LEFT_OVERS, in_hand, made_folder, not_written, sweep

LOCK = ".t2twin.lock"
"""The lock's file in a folder. It goes with the lock; one that a killed process left behind locks
nothing."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """The folder is made where it is missing, and nobody else's to write into within the block.

    What killed processes left half-written in it is removed first; a folder that was made here and
    has nothing in it afterwards is removed too. Raises T2TwinError where another process holds the
    lock, where the path is a file, and where it cannot be written.
    """
    file = folder / LOCK
    with made_folder(folder):
        in_hand.add(file)
        try:
            lock = _acquired(folder)
            try:
                sweep(folder)
                yield
            finally:
                # While it is held: a lock's file that was removed is not taken for the lock.
                with suppress(OSError):
                    file.unlink(missing_ok=True)
                lock.release()
        finally:
            in_hand.discard(file)


def _acquired(folder: Path) -> FileLock:
    try:
        lock = FileLock(folder / LOCK, blocking=False)
        lock.acquire()
    except Timeout:
        raise T2TwinError(
            f"another t2twin is writing into {folder}; wait until it is done, or choose another "
            "folder"
        ) from None
    except OSError as error:
        raise not_written(folder, error) from error
    return lock


def is_empty(folder: Path) -> bool:
    """Whether nothing is in a folder but a lock and what is being written there."""
    return not any(path.name != LOCK and not path.match(LEFT_OVERS) for path in folder.iterdir())
