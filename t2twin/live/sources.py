"""Sources of frames: a camera, a video file played at its own rate, a folder of images."""

import os
import time
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.live.folder import PATIENCE_S, POLL_S, Folder
from t2twin.live.frame import Frame, Report, turned

LIKELY_HZ = 60.0
"""Rate of a video that does not state its own: a DIGIT's (digit-interface)."""

MIN_HZ, MAX_HZ = 0.1, 1000.0
"""Smallest and largest rate that a video is believed to have, Hz (assumed)."""

WHOLE_SHARE = 0.9
"""Part of the frames that a video's header announces below which its end is reported as early
(assumed: some formats state an estimate)."""

MAX_CAMERA_DIGITS = 4
"""Digits of a camera's number (assumed), which OpenCV takes as a C integer."""

TURNS_DEG = (0, 90, 180, 270)
"""How far frames may be turned, clockwise, to stand upright."""


HEAD_BYTES = 4096
"""Bytes of a file that are looked at to tell text from a video (assumed)."""


class Source(Protocol):
    """Frames one after another."""

    def read(self) -> Frame | None:
        """Waits for the next frame; None where there will be none. Raises T2TwinError where the
        source fails."""
        ...


def _silent(message: str) -> None:
    """For sources whose reports nobody reads."""


def open_source(name: str, turn_deg: int = 0, report: Report = _silent) -> Source:
    """A camera by its number, a folder, or a video file.

    turn_deg: how far its frames are turned clockwise, one of TURNS_DEG. report: takes messages
    about skipped frames and a video's odd rate or early end.
    Raises T2TwinError for anything else, and where OpenCV is needed and missing.
    """
    if turn_deg not in TURNS_DEG:
        raise T2TwinError(f"frames cannot be turned by {turn_deg}; allowed are {TURNS_DEG}")
    if name.isascii() and name.isdigit():
        return CameraSource(name, turn_deg)
    path = Path(name)
    try:
        if name and path.is_dir():
            return Folder(path, turn_deg, report)
        if path.is_file():
            if _is_picture(path):
                raise T2TwinError(
                    f"{name} is a picture, and no source of frames; give a camera's number, a "
                    "video file, or a folder that frames arrive in"
                )
            return Video(path, turn_deg, report)
    except OSError as error:
        raise T2TwinError(
            f"the source {name!r} cannot be read ({(error.strerror or str(error)).lower()})"
        ) from error
    raise T2TwinError(
        f"there is no source {name!r}; give a camera's number, a video file, or a folder that "
        "frames arrive in"
    )


def open_background(path: Path, turn_deg: int = 0) -> np.ndarray:
    """A background frame's image file, turned as frames are: (h, w, 3) or (h, w) uint8.

    Raises T2TwinError where it cannot be read as an image.
    """
    from t2twin.translate.data.images import decode_image  # imports torch

    return turned(np.asarray(decode_image(path)), turn_deg)


class CameraSource:
    """A camera of this machine. Raises T2TwinError where it cannot be opened."""

    def __init__(self, number: str, turn_deg: int = 0) -> None:
        cv2 = _opencv()
        self._capture = cv2.VideoCapture()
        if len(number) <= MAX_CAMERA_DIGITS:
            self._capture.open(int(number))
        if not self._capture.isOpened():
            raise T2TwinError(
                f"camera {number} cannot be opened; give the number of one that is there and that "
                "no other program uses"
            )
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # an older frame is of no use
        self._name, self._turn_deg, self._count = f"camera {number}", turn_deg, 0

    def read(self) -> Frame | None:
        failed_s: float | None = None
        while True:
            ok, bgr = self._capture.read()
            if ok:
                break
            failed_s = failed_s or time.monotonic()
            if time.monotonic() - failed_s >= PATIENCE_S:
                raise T2TwinError(f"{self._name} gives no more frames; is it still there?")
            time.sleep(POLL_S)  # one damaged frame is no end
        frame = Frame(_upright(bgr, self._turn_deg), self._count, None, time.perf_counter())
        self._count += 1
        return frame


class Video:
    """A video file, whose frames arrive when they would if it were played.

    Raises T2TwinError for a file that is no video, and for one without any frame.
    """

    def __init__(self, path: Path, turn_deg: int = 0, report: Report = _silent) -> None:
        cv2 = _opencv()
        # FFmpeg draws text as a video, and follows playlists to other files.
        self._capture = cv2.VideoCapture()
        if not _is_text(path):
            self._capture.open(str(path), cv2.CAP_FFMPEG)
        if not self._capture.isOpened():
            raise T2TwinError(f"{path} cannot be read as a video; give a file that players play")
        hz = self._capture.get(cv2.CAP_PROP_FPS)
        if not MIN_HZ <= hz <= MAX_HZ:
            report(f"{path} states {hz:g} frames/s; it is played at {LIKELY_HZ:g}")
            hz = LIKELY_HZ
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
            raise T2TwinError(f"{self._path} holds no frame that can be read")
        if self._count < WHOLE_SHARE * self._announced:
            self._report(
                f"{self._path} ends after {self._count} of {self._announced:.0f} frames; it is cut "
                "short or damaged"
            )


def _is_picture(path: Path) -> bool:
    """Whether a file is a picture by its content, which FFmpeg takes for a video of one frame."""
    from t2twin.core.images import check_image_header

    try:
        check_image_header(path, ("PNG", "JPEG", "BMP", "TIFF"))
    except T2TwinError:
        return False
    return True


def _is_text(path: Path) -> bool:
    """Whether a file begins with text, as no video does. Raises OSError where it is unreadable."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    try:
        words = head.decode()
    except UnicodeDecodeError as error:
        words = head[: error.start].decode() if error.start > len(head) - 4 else "\0"
    return all(character.isprintable() or character in "\t\r\n\x1b" for character in words)


def _upright(bgr: np.ndarray, turn_deg: int) -> np.ndarray:
    """OpenCV's frame as (h, w, 3), red, green, blue."""
    return turned(bgr[:, :, ::-1], turn_deg)


def _opencv() -> Any:
    """OpenCV, quiet, and kept to local files. Raises T2TwinError where it is not installed."""
    # A video may name other files and addresses as its parts, and FFmpeg speaks for itself.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = "protocol_whitelist;file"
    try:
        import cv2
    except ImportError:
        raise T2TwinError(
            "cameras and videos need OpenCV, which is not installed; `pip install "
            "'t2twin[live]'` brings it, and a folder of frames needs none"
        ) from None
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return cv2
