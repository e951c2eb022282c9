"""Sources and options of `live`: no frames, odd videos, folders that change meanwhile."""

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from cases import NOISE, Base, Case, Content, laid, link
from pictures import JPEG, PNG, bomb, encoded, frame, grey16

from t2twin.core.errors import T2TwinError
from t2twin.live.sources import FolderSource, open_source

LIVE = "live --run {resnet18} "
FRAME: dict[str, Content] = {"d/x.png": PNG}
SHORT_PATIENCE_S = 0.2
"""Patience of a folder source with unreadable files in these cases, s."""

NO_SOURCE = ("nowhere", "", "/dev/zero", "~", "http://127.0.0.1:9/x.mp4", "file:///etc/hosts",
             "concat:a.avi|b.avi", "1.5", "٣", "nowhere/", "v.avi\n")  # fmt: skip
OTHER = {"99": "camera 99", "9" * 5000: "camera", "x" * 300: "cannot be read"}
NO_VIDEO: dict[str, bytes] = {
    "empty.mp4": b"", "long.txt": "ä line\n".encode() * 5000, "noise.avi": NOISE * 20,
    "list.m3u8": b"#EXTM3U\n#EXTINF:1,\n/etc/hosts\n", "x.sdp": b"v=0\nm=video\n",
    "list.ffconcat": b"ffconcat version 1.0\nfile /etc/hosts\n", "image.mp4": PNG,
}  # fmt: skip
OPTIONS = """
--turn-deg 45 => expected 0, 90, 180 or 270|--turn-deg -90 => --turn-deg
--layout none => layout|--layout cyskin-63 => ResNet18|--background none.png => none.png
--background d => d|--background d/x.png => needs a field run|extra => with --run RUN
"""
"""Options that are refused with a valid source, and a part of the sentence."""


def video(
    hz: float = 1000.0, frames: int = 4, size: tuple[int, int] = (240, 320), codec: str = "MJPG",
    part: float = 1.0,
) -> Callable[[Path], object]:  # fmt: skip
    """Writes a video file. part: of its bytes that are kept."""

    def write(path: Path) -> None:
        from t2twin.live.sources import _opencv

        cv2 = _opencv()
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), hz, size)
        for number in range(frames):
            writer.write(np.ascontiguousarray(np.asarray(frame(number, size))[:, :, ::-1]))
        writer.release()
        content = path.read_bytes()
        path.write_bytes(content[: int(part * len(content))])

    return write


VIDEOS = (video(30000 / 1001, 3), video(0.01, 2), video(100_000.0), video(frames=1),
          video(size=(16, 16)), video(200.0, 20, part=0.5))  # fmt: skip
ODD_FOLDERS: tuple[dict[str, Content], ...] = (
    {}, {"d/a.png": PNG, "d/b.jpg": JPEG}, {"d/a.png": bomb()},
    {"d/a.png": PNG[:999], "d/b.png": b"", "d/c.jpg": b"no image"},
    {"d/a.png": encoded(frame(size=(64, 48)))},
    {"d/sub.png": Path.mkdir, "d/pipe.png": os.mkfifo, "d/device.png": link("/dev/zero"),
     "d/nowhere.png": link("gone"), "d/itself.png": link("itself.png"), "d/.hidden.png": "",
     "d/notes.txt": "no image"},
)  # fmt: skip
"""Files next to the newest frame."""


def _gone(change: Callable[[Path], object], box: Path, base: Base) -> None:
    folder = box / "frames"
    folder.mkdir()
    source = FolderSource(folder, lambda report: None, SHORT_PATIENCE_S)
    folder.rmdir()
    change(folder)
    with pytest.raises(T2TwinError, match="no longer exists"):
        next(iter(source))


def _reported(make: Callable[[Path], object], says: str, box: Path, base: Base) -> None:
    make(box / "v.avi")
    reports: list[str] = []
    for _ in open_source(str(box / "v.avi"), report=reports.append):
        pass
    assert len(reports) == 1 and says in reports[0], f"reported {reports}"


def cases() -> Iterator[Case]:
    for name, says in (dict.fromkeys(NO_SOURCE, "no source") | OTHER).items():
        yield Case(f"source {name[:20]!r}", f"{LIVE} '{name}'", says=says)
    for name, content in NO_VIDEO.items():
        yield Case(name, LIVE + name, laid({name: content}), "cannot be read as a video")
    for option in OPTIONS.strip().replace("\n", "|").split("|"):
        words, _, says = option.partition(" => ")
        yield Case(f"live {words}", f"{LIVE} d {words}", laid(FRAME), says)
    yield Case("run without --run", "live {resnet18} d", laid(FRAME), "--run")
    yield Case("no run", "live d --run d", laid(FRAME), "config.json")
    cut = laid({"v.mp4": video(30.0, 30, codec="mp4v", part=0.5)})
    yield Case("a video without its index", LIVE + "v.mp4", cut, "cannot be read as a video")
    for number, write in enumerate(VIDEOS):
        yield Case(f"video {number}", LIVE + "v.avi", laid({"v.avi": write}), fine=True)
    for more in ("--turn-deg 0", "--turn-deg 90", "--turn-deg 180", "--turn-deg 270",
                 f"--frames {2**70}"):  # fmt: skip
        yield Case(f"video {more}", f"{LIVE} v.avi {more}", laid({"v.avi": video()}), fine=True)
    for name in ("0.avi", "a b.avi"):
        yield Case(f"video {name}", f"{LIVE} '{name}'", laid({name: video()}), fine=True)
    modes = {mode: encoded(frame().convert(mode)) for mode in ("L", "LA", "RGBA", "P", "1")}
    folders = [*ODD_FOLDERS, *({"d/x.png": content} for content in (*modes.values(), grey16()))]
    for number, files in enumerate(folders):
        make = laid(files | ({} if "d/x.png" in files else FRAME))
        yield Case(f"folder {number}", f"{LIVE} d --frames 1", make, fine=True)
    linked = laid(FRAME | {"link": link("d")})
    yield Case("a linked folder", f"{LIVE} link --frames 1", linked, fine=True)
    for change in (lambda path: None, lambda path: path.write_text("a file")):
        yield Case("a folder that is deleted", call=partial(_gone, change), fine=True)
    for write, says in ((video(0.01, 2), "frames/s"), (video(500.0, 40, part=0.5), "ends after")):
        yield Case(f"a video that {says}", call=partial(_reported, write, says), fine=True)
