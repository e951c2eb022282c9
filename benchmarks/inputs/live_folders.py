"""Folders that change while `live` reads them: each must give its newest whole frames, in order."""

import os
import shutil
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.inputs.case import Base, Make
from benchmarks.inputs.images import PNG, encoded, frame
from t2twin.core.errors import T2TwinError
from t2twin.live.folder import FolderSource
from t2twin.live.frame import Frame

STEP_S = 0.02
"""Pause between two writes of a folder's files, s (assumed: a camera of 50 Hz)."""

SHORT_PATIENCE_S = 0.2
"""Patience with unreadable files in these cases, s, so that they are quick."""


class Watched:
    """A folder source in an empty folder, with what it reported."""

    def __init__(self, box: Path) -> None:
        self.path = box / "frames"
        self.path.mkdir()
        self.reports: list[str] = []
        self.source = FolderSource(self.path, 0, self.reports.append, SHORT_PATIENCE_S)

    def frames(self, write: Callable[[Path], None], last: int) -> list[Frame]:
        """Those that are read while `write` writes, until one of grey level `last`."""
        error: list[BaseException] = []

        def run() -> None:
            try:
                write(self.path)
            except BaseException as failure:  # it is raised again below
                error.append(failure)
                self.source.close()

        writer = threading.Thread(target=run)
        writer.start()
        seen: list[Frame] = []
        while (each := self.source.read()) is not None:
            seen.append(each)
            if _grey(each) == last:
                break
        writer.join()
        if error:
            raise error[0]
        if not seen or _grey(seen[-1]) != last:
            raise AssertionError(f"frame {last} did not come")
        return seen


def _png(grey: int) -> bytes:
    """A frame that is known by its grey level; noise makes it a large file."""
    image = np.asarray(frame(grey)).copy()
    image[:160] = grey
    return encoded(Image.fromarray(image))


def _grey(seen: Frame) -> int:
    return int(seen.image[0, 0, 0])


def _in_place(path: Path, content: bytes, parts: int = 4) -> None:
    """Written part by part, as cameras' programs do that know nothing of renaming."""
    with path.open("wb") as file:
        for part in np.array_split(np.frombuffer(content, np.uint8), parts):
            file.write(part.tobytes())
            file.flush()
            time.sleep(STEP_S / parts)
    time.sleep(STEP_S)


def _renamed(path: Path, content: bytes) -> None:
    temporary = path.with_suffix(".tmp")
    temporary.write_bytes(content)
    temporary.replace(path)
    time.sleep(STEP_S)


def require(holds: bool, what: str) -> None:
    if not holds:
        raise AssertionError(what)


def _rising(seen: list[Frame]) -> None:
    greys = [_grey(each) for each in seen]
    require(greys == sorted(set(greys)), f"frames came as {greys}")
    numbers = [each.number for each in seen]
    require(numbers == sorted(set(numbers)), f"frames are numbered {numbers}")


def _many(write: Callable[[Path, bytes], None], name: str, box: Path, base: Base) -> None:
    """name: of each file, with its number in place of {}."""
    watched, count = Watched(box), 20

    def run(path: Path) -> None:
        for number in range(count + 1):
            write(path / name.format(number), _png(100 + number))

    seen = watched.frames(run, 100 + count)
    _rising(seen)
    require(len(seen) > 2, f"{len(seen)} frames of {count + 1} came")
    require(not watched.reports, f"reported {watched.reports}")


def _damaged_between(box: Path, base: Base) -> None:
    watched = Watched(box)

    def run(path: Path) -> None:
        for number in range(10):
            (path / f"{number}-bad.png").write_bytes(PNG[:500])
            _renamed(path / f"{number}.png", _png(100 + number))

    _rising(watched.frames(run, 109))


def _damaged_alone(box: Path, base: Base) -> None:
    watched = Watched(box)

    def run(path: Path) -> None:
        for number in range(5):
            (path / f"{number}.png").write_bytes(b"no image")
        while not watched.reports:
            time.sleep(STEP_S)
        _renamed(path / "good.png", _png(100))

    watched.frames(run, 100)
    require(len(watched.reports) == 1, f"{len(watched.reports)} reports, one is enough")
    require("skipped" in watched.reports[0], watched.reports[0])


def _vanishing(box: Path, base: Base) -> None:
    watched = Watched(box)

    def run(path: Path) -> None:
        for number in range(30):
            (path / f"{number}.png").write_bytes(_png(100 + number))
            (path / f"{number}.png").unlink()
        _renamed(path / "last.png", _png(200))

    watched.frames(run, 200)


def _written_again(box: Path, base: Base) -> None:
    """Files of earlier names come again with a new content."""
    watched = Watched(box)

    def run(path: Path) -> None:
        for number in range(12):
            _renamed(path / f"{number % 3}.png", _png(100 + number))

    _rising(watched.frames(run, 111))


def _old_time(box: Path, base: Base) -> None:
    """A frame that is copied with its time of change is new too."""
    watched = Watched(box)

    def run(path: Path) -> None:
        _renamed(path / "a.png", _png(100))
        (path / ".b.png").write_bytes(_png(101))
        os.utime(path / ".b.png", (1000, 1000))
        (path / ".b.png").replace(path / "b.png")

    require(_grey(watched.frames(run, 101)[-1]) == 101, "the copied frame did not come")


def _other_size(box: Path, base: Base) -> None:
    watched = Watched(box)

    def run(path: Path) -> None:
        for number, size in enumerate(((240, 320), (320, 240), (64, 48), (1, 1))):
            content = encoded(Image.new("RGB", size, (100 + number,) * 3))
            _renamed(path / "latest.png", content)

    _rising(watched.frames(run, 103))


def _entries_arrive(box: Path, base: Base) -> None:
    watched = Watched(box)

    def run(path: Path) -> None:
        os.mkfifo(path / "a.png")
        (path / "b.png").mkdir()
        (path / "c.png").symlink_to("/dev/zero")
        (path / "d.png").symlink_to("nowhere")
        _renamed(path / "e.png", _png(100))

    watched.frames(run, 100)
    require(not watched.reports, f"reported {watched.reports}")


def _gone(box: Path, base: Base) -> None:
    watched = Watched(box)
    try:
        watched.frames(shutil.rmtree, 100)
    except T2TwinError as error:
        require("no longer exists" in str(error), str(error))
    else:
        raise AssertionError("the folder went without a word")


def _in_vain(box: Path, base: Base) -> None:
    """A file in the folder's place."""
    watched = Watched(box)
    watched.path.rmdir()
    watched.path.write_text("a file")
    try:
        watched.source.read()
    except T2TwinError as error:
        require("no longer exists" in str(error), str(error))
    else:
        raise AssertionError("the folder went without a word")


CHANGING: dict[str, Make] = {
    "each frame written in place": partial(_many, _in_place, "{}.png"),
    "each frame renamed": partial(_many, _renamed, "{}.png"),
    "one file replaced again and again": partial(_many, _renamed, "latest.png"),
    "one file written in place again and again": partial(_many, _in_place, "latest.png"),
    "two files in turn": _written_again,
    "damaged frames between good ones": _damaged_between,
    "damaged frames, then a good one": _damaged_alone,
    "frames that vanish": _vanishing,
    "a frame with an old time": _old_time,
    "frames of another size": _other_size,
    "pipes and folders that arrive": _entries_arrive,
    "it goes": _gone,
    "a file in its place": _in_vain,
}
"""By what happens to the folder."""
