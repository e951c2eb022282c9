"""A folder in which image files appear, or in which one file is rewritten."""

import os
import stat
import time
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.live.frame import Frame, Report, SkippedFrames, rotated

POLL_S = 0.002
"""Polling period of a folder, s: an eighth of the period of a 60 Hz camera."""

READ_TIMEOUT_S = 1.0
"""Time after its last change for which an unreadable file is retried, s (assumed)."""

RECENT = 64
"""Number of recently read files that every poll checks for changes (assumed). All files are checked
less often, because checking tens of thousands of them takes longer than a frame."""

FULL_SCAN_EVERY_S = 0.5
"""Minimum time between two checks of all files, s (assumed)."""

FULL_SCAN_SHARE = 0.05
"""Maximum share of the time that checks of all files take (assumed)."""


class Version(NamedTuple):
    """Identifies one content of a file."""

    modified_ns: int
    bytes: int
    inode: int


class FolderSource:
    """PNG and JPEG files of a folder: the latest existing file first, then new files.

    A rewritten file is a new frame. An incomplete file is retried; if it remains unreadable for
    read_timeout_s after its last change, it is skipped and reported. Subfolders, hidden files,
    pipes and devices are ignored. Raises T2TwinError if the folder cannot be listed.
    """

    def __init__(
        self, path: Path, turn_deg: int, report: Report, read_timeout_s: float = READ_TIMEOUT_S
    ) -> None:
        self._path, self._turn_deg, self._read_timeout_s = path, turn_deg, read_timeout_s
        self._count = 0
        self._skipped = SkippedFrames(report)
        self._done: dict[str, Version] = {}  # processed contents, the latest read last
        self._unreadable: dict[str, tuple[Version, float]] = {}  # with the time of the first try
        self._full_scan_due_s = 0.0  # monotonic
        self._closed = False
        older = sorted(self._listed().items(), key=_age)[:-1]
        self._done.update(older)

    def read(self) -> Frame | None:
        """Waits for the next frame; None after `close`.

        Raises T2TwinError if the folder no longer exists.
        """
        while not self._closed:
            frame = self._latest()
            if frame is not None:
                return frame
            time.sleep(POLL_S)
        return None

    def close(self) -> None:
        """Ends `read`."""
        self._closed = True

    def _latest(self) -> Frame | None:
        """The latest readable frame that was not read yet. Older frames are dropped."""
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
                self._done.pop(older, None)  # keeps the order of reading
                self._done[older] = its_version
            self._count += position + 1
            return Frame(rotated(image, self._turn_deg), self._count - 1, name, arrived_s)
        return None

    def _image(self, name: str, version: Version) -> np.ndarray | None:
        """The image of a file; None if it is incomplete or was rewritten during reading."""
        from t2twin.translate.data.images import open_image  # imports torch

        path, now_s = self._path / name, time.monotonic()
        known, since_s = self._unreadable.get(name, (version, now_s))
        timed_out = known == version and now_s - since_s >= self._read_timeout_s
        if known == version and name in self._unreadable and not timed_out:
            return None  # this content was tried already
        try:
            image = np.asarray(open_image(path))
        except T2TwinError as error:
            if not path.exists():
                return None
            if timed_out:
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
        """Versions of the image files. Raises T2TwinError if the folder cannot be listed."""
        began_s = time.monotonic()
        full = began_s >= self._full_scan_due_s
        recent = set(islice(reversed(self._done), RECENT))
        listed = {}
        for name in self._names():
            known = None if full or name in recent else self._done.get(name)
            version = known or _version(self._path / name)
            if version is not None:
                listed[name] = version
        if full:
            now_s = time.monotonic()
            pause_s = max(FULL_SCAN_EVERY_S, (now_s - began_s) / FULL_SCAN_SHARE)
            self._full_scan_due_s = now_s + pause_s
        return listed

    def _names(self) -> list[str]:
        from t2twin.translate.inference.batch import SUFFIXES  # imports torch, as above

        try:
            with os.scandir(self._path) as entries:
                names = [entry.name for entry in entries]
        except (FileNotFoundError, NotADirectoryError):
            raise T2TwinError(f"the folder {self._path} no longer exists") from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise T2TwinError(f"the folder {self._path} cannot be listed ({reason})") from error
        return [name for name in names if name.lower().endswith(SUFFIXES) and name[0] != "."]


def _age(item: tuple[str, Version]) -> tuple[int, str]:
    """Sort key of files, the latest last."""
    name, version = item
    return version.modified_ns, name


def _version(path: Path) -> Version | None:
    """The version of a regular file; None for anything else and for a missing file."""
    try:
        status = path.stat()
    except OSError:
        return None
    if not stat.S_ISREG(status.st_mode):
        return None
    return Version(status.st_mtime_ns, status.st_size, status.st_ino)
