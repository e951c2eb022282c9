"""Where frames come from: a camera, a video file at its own rate, a folder that files arrive in."""

import os
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from t2twin.primitives_cad.errors import T2TwinError

POLL_S = 0.002
"""How often a folder is looked into, s: an eighth of a 60 Hz camera's period."""

PATIENCE_S = 1.0
"""How long a file in a folder may be no whole image, s, before it is not waited for any longer."""

LIKELY_HZ = 60.0
"""Rate of a video that does not say its own: a DIGIT's (digit-interface)."""

MOST_HZ = 1000.0
"""Largest rate that a video is believed to have, Hz (assumed)."""

TURNS_DEG = (0, 90, 180, 270)
"""How far frames may be turned, clockwise, to stand upright."""


@dataclass(frozen=True)
class Frame:
    """image: (h, w, 3) or (h, w) uint8, upright. number: within its source, from 0. name: the
    file's, in a folder. arrived_s: when it was there, on time.perf_counter's clock."""

    image: np.ndarray
    number: int
    name: str | None
    arrived_s: float


class Source(Protocol):
    """Frames one after another."""

    def read(self) -> Frame | None:
        """Waits for the next frame; None where there will be none. Raises T2TwinError where the
        source fails."""
        ...


def open_source(name: str, turn_deg: int = 0) -> Source:
    """A camera by its number, a folder, or a video file.

    turn_deg: how far its frames are turned clockwise, one of TURNS_DEG.
    Raises T2TwinError for anything else, and where OpenCV is needed and missing.
    """
    if turn_deg not in TURNS_DEG:
        raise T2TwinError(f"frames cannot be turned by {turn_deg}; allowed are {TURNS_DEG}")
    if name.isascii() and name.isdigit():
        return Camera(int(name), turn_deg)
    path = Path(name)
    if name and path.is_dir():
        return Folder(path, turn_deg)
    if path.is_file():
        if _is_picture(path):
            raise T2TwinError(
                f"{name} is a picture, and no source of frames; give a camera's number, a video "
                "file, or a folder that frames arrive in"
            )
        return Video(path, turn_deg)
    raise T2TwinError(
        f"there is no source {name!r}; give a camera's number, a video file, or a folder that "
        "frames arrive in"
    )


class Camera:
    """A camera of this machine. Raises T2TwinError where it cannot be opened."""

    def __init__(self, number: int, turn_deg: int = 0) -> None:
        cv2 = _opencv()
        self._capture = cv2.VideoCapture(number)
        if not self._capture.isOpened():
            raise T2TwinError(
                f"camera {number} cannot be opened; give the number of one that is there and that "
                "no other program uses"
            )
        self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # an older frame is of no use
        self._name, self._turn_deg, self._count = f"camera {number}", turn_deg, 0

    def read(self) -> Frame | None:
        ok, bgr = self._capture.read()
        if not ok:
            raise T2TwinError(f"{self._name} gives no more frames; is it still there?")
        frame = Frame(_upright(bgr, self._turn_deg), self._count, None, time.perf_counter())
        self._count += 1
        return frame


class Video:
    """A video file, whose frames arrive when they would if it were played.

    Raises T2TwinError for a file that is no video.
    """

    def __init__(self, path: Path, turn_deg: int = 0) -> None:
        cv2 = _opencv()
        self._capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        if not self._capture.isOpened():
            raise T2TwinError(f"{path} cannot be read as a video; give a file that players play")
        hz = self._capture.get(cv2.CAP_PROP_FPS)
        self._period_s = 1.0 / (hz if 0.0 < hz <= MOST_HZ else LIKELY_HZ)
        self._turn_deg, self._count = turn_deg, 0
        self._began_s: float | None = None

    def read(self) -> Frame | None:
        if self._began_s is None:
            self._began_s = time.perf_counter()
        due_s = self._began_s + self._count * self._period_s
        ok, bgr = self._capture.read()
        if not ok:
            return None
        frame = Frame(_upright(bgr, self._turn_deg), self._count, None, due_s)
        self._count += 1
        time.sleep(max(0.0, due_s - time.perf_counter()))
        return frame


class Folder:
    """A folder of PNG and JPEG files: first the newest that is there, then those that arrive."""

    def __init__(self, path: Path, turn_deg: int = 0) -> None:
        self._path, self._turn_deg, self._count = path, turn_deg, 0
        self._seen = set(self._new(set())[:-1])

    def read(self) -> Frame | None:
        from t2twin.translate.data.images import open_image

        first_seen_s: float | None = None
        while True:
            new = self._new(self._seen)
            if not new:
                time.sleep(POLL_S)
                continue
            arrived_s = time.perf_counter()
            first_seen_s = first_seen_s or arrived_s
            try:
                image = np.asarray(open_image(self._path / new[-1]))
            except T2TwinError:
                if arrived_s - first_seen_s < PATIENCE_S:
                    time.sleep(POLL_S)  # it is still being written
                    continue
                raise
            frame = Frame(_turned(image, self._turn_deg), self._count, new[-1], arrived_s)
            self._seen.update(new)
            self._count += len(new)
            return frame

    def _new(self, seen: set[str]) -> list[str]:
        """Names of images that are not among those seen, the newest last. What is gone is
        forgotten. Raises T2TwinError where the folder is gone."""
        from t2twin.translate.batch import SUFFIXES

        changed: dict[str, int] = {}
        there: set[str] = set()
        try:
            with os.scandir(self._path) as entries:
                for entry in entries:
                    if not entry.name.lower().endswith(SUFFIXES) or entry.name.startswith("."):
                        continue
                    there.add(entry.name)
                    if entry.name not in seen:
                        with suppress(FileNotFoundError):  # it went while it was looked at
                            changed[entry.name] = entry.stat().st_mtime_ns
        except FileNotFoundError:
            raise T2TwinError(f"the folder {self._path} is gone") from None
        seen &= there
        return sorted(changed, key=lambda name: (changed[name], name))


def _is_picture(path: Path) -> bool:
    """Whether a file is a picture by its content, which FFmpeg takes for a video of one frame."""
    from t2twin.sim.pictures import check_picture

    try:
        check_picture(path, ("PNG", "JPEG", "BMP", "TIFF"))
    except T2TwinError:
        return False
    return True


def _upright(bgr: np.ndarray, turn_deg: int) -> np.ndarray:
    """OpenCV's frame as (h, w, 3), red, green, blue."""
    return _turned(bgr[:, :, ::-1], turn_deg)


def _turned(image: np.ndarray, turn_deg: int) -> np.ndarray:
    return np.ascontiguousarray(np.rot90(image, -turn_deg // 90))


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
