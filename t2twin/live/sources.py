"""Sources of frames: a camera, a video file at its own frame rate, a folder of images."""

import os
import time
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.live.folder import POLL_S, READ_TIMEOUT_S, FolderSource
from t2twin.live.frame import Frame, Report, rotated

DEFAULT_HZ = 60.0
"""Frame rate of a video without a valid rate: that of a DIGIT (digit-interface)."""

MIN_HZ, MAX_HZ = 0.1, 1000.0
"""Range of valid frame rates of a video, Hz (assumed)."""

MIN_COMPLETE_SHARE = 0.9
"""Share of the frames in a video's header below which its end is reported as early (assumed: some
formats state an estimate)."""

MAX_CAMERA_DIGITS = 4
"""Maximum number of digits of a camera number, which OpenCV reads as a C integer (assumed)."""

TURNS_DEG = (0, 90, 180, 270)
"""Allowed clockwise rotations of frames."""

HEAD_BYTES = 4096
"""Number of bytes of a file that are checked for text (assumed)."""


class Source(Protocol):
    """A sequence of frames."""

    def read(self) -> Frame | None:
        """Waits for the next frame; None after the last. Raises T2TwinError if the source fails."""
        ...


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
    if name.isascii() and name.isdigit():
        return CameraSource(name, turn_deg)
    path = Path(name)
    try:
        if name and path.is_dir():
            return FolderSource(path, turn_deg, report)
        if path.is_file():
            if _is_image(path):
                raise T2TwinError(
                    f"{name} is an image, not a source of frames; expected a camera number, a "
                    "video file or a folder"
                )
            return VideoSource(path, turn_deg, report)
    except OSError as error:
        raise T2TwinError(
            f"the source {name!r} cannot be read ({(error.strerror or str(error)).lower()})"
        ) from error
    raise T2TwinError(
        f"there is no source {name!r}; expected a camera number, a video file or a folder"
    )


def open_background(path: Path, turn_deg: int = 0) -> np.ndarray:
    """Reads a background frame, rotated like other frames: (h, w, 3) or (h, w) uint8.

    Raises T2TwinError if the file cannot be read as an image.
    """
    from t2twin.translate.data.images import open_image  # imports torch

    return rotated(np.asarray(open_image(path)), turn_deg)


class CameraSource:
    """A camera of this machine. Raises T2TwinError if it cannot be opened."""

    def __init__(self, number: str, turn_deg: int = 0) -> None:
        cv2 = _opencv()
        self._capture = cv2.VideoCapture()
        if len(number) <= MAX_CAMERA_DIGITS:
            self._capture.open(int(number))
        if not self._capture.isOpened():
            raise T2TwinError(
                f"camera {number} cannot be opened; expected the number of a connected camera that "
                "no other program uses"
            )
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # older frames are not needed
        self._name, self._turn_deg, self._count = f"camera {number}", turn_deg, 0

    def read(self) -> Frame | None:
        failed_s: float | None = None
        while True:
            ok, bgr = self._capture.read()
            if ok:
                break
            failed_s = failed_s or time.monotonic()
            if time.monotonic() - failed_s >= READ_TIMEOUT_S:
                raise T2TwinError(f"{self._name} returns no frames; check its connection")
            time.sleep(POLL_S)  # a damaged frame is not the end
        frame = Frame(_upright(bgr, self._turn_deg), self._count, None, time.perf_counter())
        self._count += 1
        return frame


class VideoSource:
    """A video file, read at its frame rate.

    Raises T2TwinError for a file that is not a video, and for a video without frames.
    """

    def __init__(self, path: Path, turn_deg: int = 0, report: Report = _silent) -> None:
        cv2 = _opencv()
        # FFmpeg renders text as a video, and opens the files of a playlist.
        self._capture = cv2.VideoCapture()
        if not _is_text(path):
            self._capture.open(str(path), cv2.CAP_FFMPEG)
        if not self._capture.isOpened():
            raise T2TwinError(f"{path} cannot be read as a video")
        hz = self._capture.get(cv2.CAP_PROP_FPS)
        if not MIN_HZ <= hz <= MAX_HZ:
            report(f"{path} states {hz:g} frames/s; {DEFAULT_HZ:g} frames/s are used instead")
            hz = DEFAULT_HZ
        self._announced = self._capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self._path, self._period_s, self._report = path, 1.0 / hz, report
        self._turn_deg, self._count = turn_deg, 0
        self._began_s: float | None = None

    def read(self) -> Frame | None:
        if self._began_s is None:
            self._began_s = time.perf_counter()
        due_s = self._began_s + self._count * self._period_s
        ok, bgr = self._capture.read()
        if not ok:
            self._check_end()
            return None
        frame = Frame(_upright(bgr, self._turn_deg), self._count, None, due_s)
        self._count += 1
        time.sleep(max(0.0, due_s - time.perf_counter()))
        return frame

    def _check_end(self) -> None:
        if not self._count:
            raise T2TwinError(f"{self._path} contains no readable frame")
        if self._count < MIN_COMPLETE_SHARE * self._announced:
            self._report(
                f"{self._path} ends after {self._count} of {self._announced:.0f} frames; it is "
                "truncated or damaged"
            )


def _is_image(path: Path) -> bool:
    """Whether a file is an image, which FFmpeg opens as a video of one frame."""
    from t2twin.core.images import check_image_header

    try:
        with path.open("rb") as file:
            check_image_header(file, ("PNG", "JPEG", "BMP", "TIFF"))
    except T2TwinError:
        return False
    return True


def _is_text(path: Path) -> bool:
    """Whether a file begins with text, unlike any video. Raises OSError if it is unreadable."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    try:
        text = head.decode()
    except UnicodeDecodeError as error:
        text = head[: error.start].decode() if error.start > len(head) - 4 else "\0"
    return all(character.isprintable() or character in "\t\r\n\x1b" for character in text)


def _upright(bgr: np.ndarray, turn_deg: int) -> np.ndarray:
    """A frame of OpenCV as (h, w, 3) RGB, rotated upright."""
    return rotated(bgr[:, :, ::-1], turn_deg)


def _opencv() -> Any:
    """OpenCV, silent and limited to local files. Raises T2TwinError if it is not installed."""
    # A video may refer to other files and addresses, and FFmpeg prints messages of its own.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = "protocol_whitelist;file"
    try:
        import cv2
    except ImportError:
        raise T2TwinError(
            "cameras and videos require OpenCV, which is not installed; install it with "
            "`pip install 't2twin[live]'`, or use a folder of frames"
        ) from None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2
