"""Sources of frames: a camera, a video file at its own frame rate, a folder of images.

`LatestFrame` reads any of them and drops the frames that are not taken in time.
"""

import itertools
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Condition, Thread
from typing import Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, how_to_install
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.images import SUFFIXES

DEFAULT_HZ = 60.0  # of a video without a valid frame rate (assumed: that of many cameras)
MIN_HZ, MAX_HZ = 0.1, 1000.0  # of valid frame rates of a video (assumed)
# Limits FFmpeg to videos in local files: it also renders text and images as videos
FFMPEG_OPTIONS = (
    "protocol_whitelist;file|format_whitelist;avi,mov,matroska,mpegts,mpeg,mpegvideo,h264,hevc,"
    "mjpeg,flv,asf,ogg,gif,ivf,mxf,yuv4mpegpipe"
)
POLL_S = 0.002  # of a folder: an eighth of the period of a 60 Hz camera
# For which an unreadable file is read again after its last change, and a camera without frames
READ_TIMEOUT_S = 1.0  # (assumed)

Report = Callable[[str], object]  # receives a message for the user


@dataclass(frozen=True)
class Frame:
    """One frame of a source."""

    image: np.ndarray  # (h, w, 3) or (h, w) uint8, upright
    number: int  # position in the source, from 0
    name: str | None  # file name in a folder
    arrived_s: float  # arrival on the clock of time.perf_counter


# Frames of a source; None where there is no new one yet. Raises T2TwinError if it fails
Source = Iterator[Frame | None]


def open_source(
    name: str, order: FrameOrder = UPRIGHT, report: Report = lambda message: None
) -> Source:
    """Opens a camera (by its number), a folder or a video file.

    order: of the stored frames. report: receives messages about skipped frames and about an invalid
    frame rate or early end of a video.
    Raises T2TwinError for any other source, and if OpenCV is required but not installed.
    """
    path, order = Path(name), arguments.instance(order, "order", FrameOrder)
    if name.isascii() and name.isdigit():
        frames = _camera(int(name))
    elif name and path.is_dir():
        frames = _folder(path, report)
    elif path.is_file():
        frames = _video(path, report)
    else:
        raise T2TwinError(
            f"there is no source {name!r}; expected a camera number, a video file or a folder"
        )
    return (each and replace(each, image=order.upright(each.image)) for each in frames)


def _opened(source: int | str) -> tuple[Any, Any]:
    """OpenCV, and a camera or a video. Raises T2TwinError if it cannot be opened."""
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = FFMPEG_OPTIONS
    try:
        import cv2
    except ImportError:
        raise T2TwinError(f"cameras and videos need OpenCV; {how_to_install('live')}") from None
    is_camera = isinstance(source, int)
    capture = None
    with suppress(cv2.error):  # such as a number beyond the largest
        capture = cv2.VideoCapture(source, cv2.CAP_ANY if is_camera else cv2.CAP_FFMPEG)
    if capture is None or not capture.isOpened():
        name = f"camera {source}" if is_camera else source
        raise T2TwinError(
            f"{name} cannot be opened; expected the number of a free camera, or a video file, such "
            "as AVI, MP4 or MKV"
        )
    if is_camera:
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # older frames are not needed
    return cv2, capture


def _camera(number: int) -> Source:
    """Frames of a camera."""
    cv2, capture = _opened(number)

    def frames() -> Source:
        count, due_s = 0, time.monotonic() + READ_TIMEOUT_S
        while True:
            ok, bgr = capture.read()
            if ok:
                yield Frame(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), count, None, time.perf_counter())
                count, due_s = count + 1, time.monotonic() + READ_TIMEOUT_S
            elif time.monotonic() >= due_s:
                raise T2TwinError(f"camera {number} returns no frames; check its connection")
            else:  # a damaged frame is not the end
                time.sleep(POLL_S)
                yield None

    return frames()


def _video(path: Path, report: Report) -> Source:
    """Frames of a video file at its frame rate. Raises T2TwinError for a video without frames."""
    cv2, capture = _opened(str(path))
    hz, announced = (capture.get(key) for key in (cv2.CAP_PROP_FPS, cv2.CAP_PROP_FRAME_COUNT))
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
            yield Frame(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), count, None, due_s)
        if not count:
            codec = np.int64(capture.get(cv2.CAP_PROP_FOURCC)).tobytes()[:4].decode("latin-1")
            raise T2TwinError(f"OpenCV decodes no frame of {path} ({codec}); convert it to H.264")
        if count < 0.9 * announced:  # headers may be inexact (assumed)
            report(f"{path} ends after {count} of {announced:.0f} frames; it is damaged")

    return frames()


def _folder(path: Path, report: Report) -> Source:
    """PNG and JPEG files of a folder: the latest existing file first, then new files.

    A new content of the latest file is a new frame. An incomplete file is read again; if it remains
    unreadable for READ_TIMEOUT_S after its last change, it is reported.
    """
    from t2twin.translate.data.images import open_image  # imports torch

    done = _versions(path, _image_names(path))  # of the frames so far
    last = next(reversed(done), "")
    done.pop(last, None)

    def frames() -> Source:
        nonlocal done, last
        count = 0
        while True:
            names = _image_names(path)
            done = {name: version for name, version in done.items() if name in names}
            found = _versions(path, (names - done.keys()) | ({last} & names))
            new = {name: each for name, each in found.items() if each != done.get(name)}
            image, arrived_s = None, 0.0
            while new and image is None:
                last, arrived_s = next(reversed(new)), time.perf_counter()
                try:
                    image = np.asarray(open_image(path / last))
                except T2TwinError as error:
                    version = new.pop(last)
                    if time.time() - version[0] / 1e9 >= READ_TIMEOUT_S:
                        done[last] = version
                        report(f"a frame is skipped: {error}")
            if image is None:
                yield None
                time.sleep(POLL_S)
            else:
                done |= new
                count += len(new)
                yield Frame(image, count - 1, last, arrived_s)

    return frames()


def _image_names(path: Path) -> set[str]:
    try:
        names = {each.name for each in path.iterdir()}
    except OSError as error:
        raise T2TwinError(f"the folder {path} cannot be read: {error.strerror}") from error
    return {each for each in names if each.lower().endswith(SUFFIXES) and each[0] != "."}


def _versions(path: Path, names: Iterable[str]) -> dict[str, tuple[int, int]]:
    """Times of the last change, ns, and sizes of files by name, the latest last."""
    found = {}
    for name in names:
        with suppress(OSError):  # it is deleted
            status = (path / name).stat()
            found[name] = status.st_mtime_ns, status.st_size
    return dict(sorted(found.items(), key=lambda each: (each[1], each[0])))


class LatestFrame:
    """Reads a source in a thread; all takers get the latest frame. read: number of frames."""

    def __init__(self, source: Iterable[Frame | None]) -> None:
        self.read, self.ended = 0, False
        self._source, self._closed = source, False
        self._frame: Frame | None = None
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
            self._changed.wait_for(lambda: self.read > after + 1 or self.ended, timeout_s)
            if self._frame is not None and self._frame.number > after:
                return self._frame
            if self._error is not None:
                raise self._error
            return None

    def close(self) -> None:
        """Stops reading, without waiting for a frame that is being read."""
        self._closed = True

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
            self.ended = True
            self._changed.notify_all()
