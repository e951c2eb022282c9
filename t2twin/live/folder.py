"""A folder that image files arrive in, or in which one file is written again and again."""

import os
import stat
import time
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.live.frame import Frame, Report, Skipped, turned

POLL_S = 0.002
"""How often a folder is looked into, s: an eighth of a 60 Hz camera's period."""

PATIENCE_S = 1.0
"""How long a file may stay unreadable after its last change, s, before it is skipped (assumed)."""


RECENT = 64
"""Files, the last read, that every look checks for a new content (assumed); the others are checked
now and then, as a look at tens of thousands takes longer than a frame."""

FULL_LOOK_EVERY_S = 0.5
"""Least time between two looks at all files, s (assumed)."""

FULL_LOOK_SHARE = 0.05
"""Most of the time that looks at all files may take (assumed)."""


class Version(NamedTuple):
    """What tells one content of a file from the next."""

    modified_ns: int
    bytes: int
    inode: int


class Folder:
    """A folder of PNG and JPEG files: first the newest that is there, then those that arrive.

    A file that is written again is a new frame. One that is not whole is waited for, one that stays
    so for patience_s after its last change is skipped and reported. Subfolders, hidden files, pipes
    and devices are left out. Raises T2TwinError where the folder cannot be listed.
    """

    def __init__(
        self, path: Path, turn_deg: int, report: Report, patience_s: float = PATIENCE_S
    ) -> None:
        self._path, self._turn_deg, self._patience_s = path, turn_deg, patience_s
        self._count = 0
        self._skipped = Skipped(report)
        self._done: dict[str, Version] = {}  # files whose present content needs no more reading
        self._unreadable: dict[str, tuple[Version, float]] = {}  # and since when, monotonic, s
        self._full_look_due_s = 0.0  # monotonic
        self._closed = False
        older = sorted(self._listed().items(), key=_age)[:-1]
        self._done.update(older)

    def read(self) -> Frame | None:
        """Waits for the next frame; None once it is closed. Raises T2TwinError where the folder is
        gone."""
        while not self._closed:
            frame = self._newest()
            if frame is not None:
                return frame
            time.sleep(POLL_S)
        return None

    def close(self) -> None:
        """Ends the waiting of `read`."""
        self._closed = True

    def _newest(self) -> Frame | None:
        """The newest readable frame that was not read yet. Older ones are left out from then on."""
        listed = self._listed()
        for known in (self._done, self._unreadable):
            for name in known.keys() - listed.keys():
                del known[name]
        new = [each for each in listed.items() if self._done.get(each[0]) != each[1]]
        new.sort(key=_age)
        for position in reversed(range(len(new))):
            name, version = new[position]
            arrived_s = time.perf_counter()
            image = self._image(name, version)
            if image is None:
                continue
            for older, its_version in new[: position + 1]:
                self._done.pop(older, None)  # the last read is the last in the dictionary
                self._done[older] = its_version
            self._count += position + 1
            return Frame(turned(image, self._turn_deg), self._count - 1, name, arrived_s)
        return None

    def _image(self, name: str, version: Version) -> np.ndarray | None:
        """A file's image, None where it is not whole or was changed meanwhile."""
        from t2twin.translate.data.images import open_image  # imports torch

        path, now_s = self._path / name, time.monotonic()
        known, since_s = self._unreadable.get(name, (version, now_s))
        waited = known == version and now_s - since_s >= self._patience_s
        if known == version and name in self._unreadable and not waited:
            return None  # it was tried already
        try:
            image = np.asarray(open_image(path))
        except T2TwinError as error:
            if not path.exists():
                return None
            if waited:
                self._done[name] = version
                self._count += 1
                self._skipped.add(str(error))
            else:
                self._unreadable[name] = (version, now_s)
            return None
        self._unreadable.pop(name, None)
        after = _version(path)
        rewritten = after is not None and after != version and after.inode == version.inode
        return None if rewritten else image

    def _listed(self) -> dict[str, Version]:
        """The folder's image files. Raises T2TwinError where it cannot be listed."""
        began_s = time.monotonic()
        full = began_s >= self._full_look_due_s
        recent = set(islice(reversed(self._done), RECENT))
        listed = {}
        for name in self._names():
            known = None if full or name in recent else self._done.get(name)
            version = known or _version(self._path / name)
            if version is not None:
                listed[name] = version
        if full:
            now_s = time.monotonic()
            pause_s = max(FULL_LOOK_EVERY_S, (now_s - began_s) / FULL_LOOK_SHARE)
            self._full_look_due_s = now_s + pause_s
        return listed

    def _names(self) -> list[str]:
        from t2twin.translate.inference.batch import SUFFIXES  # imports torch, as above

        try:
            with os.scandir(self._path) as entries:
                names = [entry.name for entry in entries]
        except (FileNotFoundError, NotADirectoryError):
            raise T2TwinError(f"the folder {self._path} is gone") from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise T2TwinError(f"the folder {self._path} cannot be listed ({reason})") from error
        return [name for name in names if name.lower().endswith(SUFFIXES) and name[0] != "."]


def _age(item: tuple[str, Version]) -> tuple[int, str]:
    """Sorts files, the newest last."""
    name, version = item
    return version.modified_ns, name


def _version(path: Path) -> Version | None:
    """None for what is no regular file, and for one that is gone."""
    try:
        about = path.stat()
    except OSError:
        return None
    if not stat.S_ISREG(about.st_mode):
        return None
    return Version(about.st_mtime_ns, about.st_size, about.st_ino)
