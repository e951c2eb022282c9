"""Sources of frames: a camera, a video file at its own frame rate, a folder of images.

`LatestFrame` reads any of them and drops the frames that are not taken in time.
"""

import itertools
import os
import stat
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Condition, Thread
from typing import Any

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.images import SUFFIXES
from t2twin.core.words import counted

DEFAULT_HZ = 60.0
"""Frame rate of a video without a valid rate (assumed: that of many cameras)."""

MIN_HZ, MAX_HZ = 0.1, 1000.0
"""Range of valid frame rates of a video, Hz (assumed)."""

MIN_COMPLETE_SHARE = 0.9
"""Share of the frames in a video's header below which its end is reported as early (assumed: some
formats state an estimate)."""

MAX_CAMERA_DIGITS = 4
"""Maximum number of digits of a camera number, which OpenCV reads as a C integer (assumed)."""

TURNS_DEG = (0, 90, 180, 270)
"""Allowed clockwise rotations of frames."""

FFMPEG_OPTIONS = {
    "protocol_whitelist": "file",
    "format_whitelist": "avi,mov,matroska,mpegts,mpeg,mpegvideo,h264,hevc,mjpeg,flv,asf,ogg,gif,"
    "ivf,mxf,yuv4mpegpipe",
}
"""Limits of FFmpeg to videos in local files: it also renders text and images as videos, and opens
the files and addresses of a playlist."""

POLL_S = 0.002
"""Polling period of a folder, s: an eighth of the period of a 60 Hz camera."""

READ_TIMEOUT_S = 1.0
"""Time for which an unreadable file is read again after its last change, and a camera that returns
no frame, s (assumed)."""

RECENT = 64
"""Number of recently read files that every poll checks for changes (assumed). All files are checked
less often, because checking tens of thousands of them takes longer than a frame."""

FULL_SCAN_EVERY_S, FULL_SCAN_SHARE = 0.5, 0.05
"""Minimum time between two checks of all files, s, and maximum share of the time that they take
(assumed)."""

REPORT_EVERY_S = 5.0
"""Minimum time between two reports of skipped frames, s (assumed)."""

Report = Callable[[str], None]
"""Receives a message for the user."""


@dataclass(frozen=True)
class Frame:
    """One frame of a source.

    image: (h, w, 3) or (h, w) uint8, upright. number: position in the source, from 0. name: file
    name in a folder, None otherwise. arrived_s: arrival on the clock of time.perf_counter.
    """

    image: np.ndarray
    number: int
    name: str | None
    arrived_s: float


Source = Iterator[Frame | None]
"""Frames of a source; None where there is no new one yet. Raises T2TwinError if the source fails.
"""


def _silent(message: str) -> None:
    """Discards a report."""


def open_source(name: str, turn_deg: int = 0, report: Report = _silent) -> Source:
    """Opens a camera (by its number), a folder or a video file.

    turn_deg: clockwise rotation of the frames, one of TURNS_DEG. report: receives messages about
    skipped frames and about an invalid frame rate or early end of a video.
    Raises T2TwinError for any other source, and if OpenCV is required but not installed.
    """
    if turn_deg not in TURNS_DEG:
        raise T2TwinError(f"frames cannot be rotated by {turn_deg}; expected one of {TURNS_DEG}")
    path = Path(name)
    try:
        if name.isascii() and name.isdigit():
            frames = _camera(_opened_camera(name), name)
        elif name and path.is_dir():
            frames = FolderSource(path, report)
        elif path.is_file():
            frames = _video(path, report)
        else:
            raise T2TwinError(
                f"there is no source {name!r}; expected a camera number, a video file or a folder"
            )
    except OSError as error:
        raise T2TwinError(
            f"the source {name!r} cannot be read ({(error.strerror or str(error)).lower()})"
        ) from error
    return (each and replace(each, image=_rotated(each.image, turn_deg)) for each in frames)


def _opened_camera(number: str) -> Any:
    """A camera of this machine. Raises T2TwinError if it cannot be opened."""
    cv2 = _opencv()
    capture = cv2.VideoCapture()
    if len(number) <= MAX_CAMERA_DIGITS:
        capture.open(int(number))
    if not capture.isOpened():
        raise T2TwinError(
            f"camera {number} cannot be opened; expected the number of a connected camera that no "
            "other program uses"
        )
    capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # older frames are not needed
    return capture


def _camera(capture: Any, number: str) -> Source:
    """Frames of an open camera."""
    count, due_s = 0, time.monotonic() + READ_TIMEOUT_S
    while True:
        ok, bgr = capture.read()
        if ok:
            yield Frame(bgr[:, :, ::-1], count, None, time.perf_counter())
            count, due_s = count + 1, time.monotonic() + READ_TIMEOUT_S
        elif time.monotonic() >= due_s:
            raise T2TwinError(f"camera {number} returns no frames; check its connection")
        else:  # a damaged frame is not the end
            time.sleep(POLL_S)
            yield None


def _video(path: Path, report: Report) -> Source:
    """Frames of a video file at its frame rate.

    Raises T2TwinError for a file that is not a video, and for a video without frames.
    """
    cv2 = _opencv()
    with path.open("rb"):
        pass  # raises the reason, which OpenCV does not state
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise T2TwinError(
            f"{path} cannot be read as a video; expected a video file, such as AVI, MP4 or MKV, or "
            "a folder of images"
        )
    hz = capture.get(cv2.CAP_PROP_FPS)
    if not MIN_HZ <= hz <= MAX_HZ:
        report(f"{path} states {hz:g} frames/s; {DEFAULT_HZ:g} frames/s are used instead")
        hz = DEFAULT_HZ

    def frames() -> Source:
        began_s = time.perf_counter()
        for count in itertools.count():
            due_s = began_s + count / hz
            ok, bgr = capture.read()
            if not ok:
                break
            time.sleep(max(0.0, due_s - time.perf_counter()))
            yield Frame(bgr[:, :, ::-1], count, None, due_s)
        announced = capture.get(cv2.CAP_PROP_FRAME_COUNT)
        if not count:
            raise T2TwinError(f"{path} contains no readable frame")
        if count < MIN_COMPLETE_SHARE * announced:
            report(
                f"{path} ends after {count} of {announced:.0f} frames; it is truncated or damaged"
            )

    return frames()


_Version = tuple[int, int]
"""Identifies one content of a file: time of its last change, ns, and size in bytes."""


class FolderSource:
    """PNG and JPEG files of a folder: the latest existing file first, then new files.

    A rewritten file is a new frame. An incomplete file is retried; if it remains unreadable for
    read_timeout_s after its last change, it is skipped and reported. Subfolders, hidden files,
    pipes and devices are ignored. Raises T2TwinError if the folder cannot be listed.
    """

    def __init__(self, path: Path, report: Report, read_timeout_s: float = READ_TIMEOUT_S) -> None:
        self._path, self._report, self._read_timeout_s = path, report, read_timeout_s
        self._count, self._skipped, self._report_due_s = 0, 0, 0.0
        self._recent: deque[str] = deque(maxlen=RECENT)  # names of processed files
        self._done: dict[str, _Version] = {}  # processed contents
        self._full_scan_due_s = 0.0  # monotonic
        self._done.update(sorted(self._listed().items(), key=_age)[:-1])

    def __iter__(self) -> Source:
        while True:
            frame = self._latest()
            yield frame
            if frame is None:
                time.sleep(POLL_S)

    def _latest(self) -> Frame | None:
        """The latest readable frame that was not read yet. Older frames are dropped."""
        listed = self._listed()
        for name in self._done.keys() - listed.keys():
            del self._done[name]
        new = [each for each in listed.items() if self._done.get(each[0]) != each[1]]
        new.sort(key=_age)
        while new:
            name, version = new[-1]
            arrived_s = time.perf_counter()
            image = self._image(name, version)
            if image is not None:
                self._done.update(new)
                self._recent.extend(name for name, _ in new)
                self._count += len(new)
                return Frame(image, self._count - 1, name, arrived_s)
            new.pop()
        return None

    def _image(self, name: str, version: _Version) -> np.ndarray | None:
        """The image of a file; None if it is incomplete or was rewritten during reading."""
        from t2twin.translate.data.images import open_image  # imports torch

        try:
            image = np.asarray(open_image(self._path / name))
        except T2TwinError as error:
            if time.time() - version[0] / 1e9 >= self._read_timeout_s:
                self._skip(name, version, str(error))
            return None
        return image if _version(self._path / name) in (version, None) else None

    def _skip(self, name: str, version: _Version, reason: str) -> None:
        """Counts a frame that remains unreadable, and reports it at a limited rate."""
        self._done[name] = version
        self._skipped += 1
        if time.monotonic() >= self._report_due_s:
            self._report_due_s = time.monotonic() + REPORT_EVERY_S
            self._report(f"{counted(self._skipped, 'frame')} skipped so far; latest: {reason}")

    def _listed(self) -> dict[str, _Version]:
        """Versions of the image files. Raises T2TwinError if the folder cannot be listed."""
        began_s = time.monotonic()
        is_full = began_s >= self._full_scan_due_s
        recent, listed = set(self._recent), {}
        for name in self._names():
            known = None if is_full or name in recent else self._done.get(name)
            version = known or _version(self._path / name)
            if version is not None:
                listed[name] = version
        if is_full:
            now_s = time.monotonic()
            pause_s = max(FULL_SCAN_EVERY_S, (now_s - began_s) / FULL_SCAN_SHARE)
            self._full_scan_due_s = now_s + pause_s
        return listed

    def _names(self) -> list[str]:
        try:
            names = [path.name for path in self._path.iterdir()]
        except (FileNotFoundError, NotADirectoryError):
            raise T2TwinError(f"the folder {self._path} no longer exists") from None
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            raise T2TwinError(f"the folder {self._path} cannot be listed ({reason})") from error
        return [name for name in names if name.lower().endswith(SUFFIXES) and name[0] != "."]


class LatestFrame:
    """Reads a source in a thread of its own. read: number of frames read so far.

    A queue.Queue would give each frame to one taker only; here all takers get the latest one.
    """

    def __init__(self, source: Iterable[Frame | None]) -> None:
        self.read = 0
        self._source, self._closed = source, False
        self._frame: Frame | None = None
        self._ended = False
        self._error: Exception | None = None
        self._changed = Condition()
        # A daemon thread: the process does not wait for a camera when it stops.
        Thread(target=self._run, daemon=True).start()

    def take(self, after: int = -1, timeout_s: float | None = None) -> Frame | None:
        """Waits for a frame with a number above `after` and returns the latest one.

        Returns None after the end of the source and after the timeout. Several threads may take
        frames. Raises the exception that the source raised.
        """
        with self._changed:
            self._changed.wait_for(lambda: self.read > after + 1 or self._ended, timeout_s)
            if self._frame is not None and self._frame.number > after:
                return self._frame
            if self._error is not None:
                raise self._error
            return None

    def close(self) -> None:
        """Stops reading, without waiting for a frame that is being read."""
        self._closed = True

    @property
    def ended(self) -> bool:
        """Whether the source has ended."""
        with self._changed:
            return self._ended

    def _run(self) -> None:
        try:
            for frame in self._source:
                if self._closed:
                    break
                if frame is not None:
                    with self._changed:
                        self._frame, self.read = frame, frame.number + 1
                        self._changed.notify_all()
        except Exception as error:  # `take` raises it
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify_all()


def _rotated(image: np.ndarray, turn_deg: int) -> np.ndarray:
    """The image rotated clockwise by a multiple of 90 degrees."""
    return np.ascontiguousarray(np.rot90(image, -turn_deg // 90))


def _age(item: tuple[str, _Version]) -> tuple[int, str]:
    """Sort key of files, the latest last."""
    name, (modified_ns, _) = item
    return modified_ns, name


def _version(path: Path) -> _Version | None:
    """The version of a regular file; None for anything else and for a missing file."""
    try:
        status = path.stat()
    except OSError:
        return None
    if not stat.S_ISREG(status.st_mode):
        return None
    return status.st_mtime_ns, status.st_size


def _opencv() -> Any:
    """OpenCV, silent and limited by FFMPEG_OPTIONS. Raises T2TwinError if it is not installed."""
    options = "|".join(f"{name};{value}" for name, value in FFMPEG_OPTIONS.items())
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = options
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg's own messages
    try:
        import cv2
    except ImportError:
        raise T2TwinError(
            "cameras and videos require OpenCV, which is not installed; install it with "
            "`pip install 't2twin[live]'`, or use a folder of frames"
        ) from None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2
