"""Sources and options of `live`: no frames, odd videos, folders that change meanwhile."""

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.inputs.case import Base, Case, Make, holding
from benchmarks.inputs.images import JPEG, PNG, bomb, encoded, frame
from benchmarks.inputs.live_folders import CHANGING, require
from t2twin.live.sources import open_source

LIVE = ("live", "--run", "{resnet18}")
FIELD = ("live", "d", "--frames", "1")
TRANSLATE = ("translate", "d/newest.png", "--out", "out")
ONE = ("--frames", "1")


def video(
    name: str, hz: float = 1000.0, frames: int = 4, size: tuple[int, int] = (240, 320),
    codec: str = "MJPG", part: float = 1.0,
) -> Make:  # fmt: skip
    """A video file; part: of its bytes that are kept."""

    def make(box: Path, base: Base) -> None:
        from t2twin.live.sources import _opencv

        cv2 = _opencv()
        temporary = box / f"temporary{Path(name).suffix}"
        writer = cv2.VideoWriter(str(temporary), cv2.VideoWriter.fourcc(*codec), hz, size)
        for number in range(frames):
            writer.write(np.ascontiguousarray(np.asarray(frame(number, size))[:, :, ::-1]))
        writer.release()
        content = temporary.read_bytes()
        temporary.unlink()
        (box / os.fsdecode(name)).write_bytes(content[: int(part * len(content))])

    return make


def folder(**others: bytes) -> Make:
    """A folder d with a good frame that is its newest file, and older ones."""

    def make(box: Path, base: Base) -> None:
        (box / "d").mkdir()
        for number, (name, content) in enumerate(others.items()):
            path = box / "d" / name.replace("_", ".")
            path.write_bytes(content)
            os.utime(path, (1000 + number, 1000 + number))
        (box / "d/newest.png").write_bytes(PNG)

    return make


def _odd_entries(box: Path, base: Base) -> None:
    folder(a_png=PNG)(box, base)
    (box / "d/sub.png").mkdir()
    (box / "d/deeper").mkdir()
    os.mkfifo(box / "d/pipe.png")
    (box / "d/device.png").symlink_to("/dev/zero")
    (box / "d/nowhere.png").symlink_to("nowhere")
    (box / "d/itself.png").symlink_to("itself.png")
    (box / "d/.hidden.png").write_text("no image")
    (box / "d/notes.txt").write_text("no image")


def _link(box: Path, base: Base) -> None:
    folder()(box, base)
    (box / "link").symlink_to("d")


def _fifo(box: Path, base: Base) -> None:
    os.mkfifo(box / "f.avi")


def _bad_background(content: bytes) -> Make:
    def make(box: Path, base: Base) -> None:
        folder()(box, base)
        (box / "b.png").write_bytes(content)

    return make


def _background_folder(box: Path, base: Base) -> None:
    folder()(box, base)
    (box / "b.png").mkdir()


NO_SOURCE: tuple[tuple[str, str], ...] = (
    ("nowhere", "no source"), ("", "no source"), (" ", "no source"), ("/dev/null", "no source"),
    ("/dev/zero", "no source"), ("~", "no source"),
    ("*", "no source"), ("http://127.0.0.1:9/x.mp4", "no source"),
    ("rtsp://127.0.0.1:9/x", "no source"), ("file:///etc/hosts", "no source"),
    ("concat:a.avi|b.avi", "no source"), ("1.5", "no source"), ("0x0", "no source"),
    ("٣", "no source"), ("²", "no source"), ("nowhere/", "no source"),
    ("99", "camera 99"), ("9999999999", "camera 9999999999"), ("9" * 5000, "camera"),
    ("x" * 300, "cannot be read"), ("v.avi\n", "no source"),
)  # fmt: skip
"""Sources that are none, and what the sentence must hold."""

NO_VIDEO: tuple[tuple[str, bytes], ...] = (
    ("empty.mp4", b""), ("text.mp4", b"no video"), ("notes.txt", b"a line\n" * 100),
    ("long.txt", "ä line\n".encode() * 5000), ("list.m3u8", b"#EXTM3U\n#EXTINF:1,\n/etc/hosts\n"),
    ("list.ffconcat", b"ffconcat version 1.0\nfile /etc/hosts\n"), ("x.sdp", b"v=0\nm=video\n"),
    ("x.html", b"<html></html>"), ("x.json", b"{}"), ("x.npz", b"PK\x03\x04" + bytes(100)),
    ("zeros.avi", bytes(100_000)), ("noise.avi", np.random.default_rng(0).bytes(100_000)),
    ("head.avi", b"RIFF\0\0\0\0AVI LIST"),
)  # fmt: skip
"""Files that are no videos."""

OPTIONS: tuple[tuple[tuple[str, ...], str], ...] = (
    (("--frames", "0"), "1 or more"), (("--frames", "-1"), "1 or more"),
    (("--frames", "1.5"), "expected a whole number"), (("--frames=",), "--frames is ''"),
    (("--frames", "many"), "--frames is 'many'"), (("--frames",), "--frames has no value"),
    (("--turn-deg", "45"), "expected 0, 90, 180 or 270"), (("--turn-deg", "-90"), "--turn-deg"),
    (("--turn-deg", "360"), "--turn-deg is '360'"), (("--turn-deg", "90.0"), "--turn-deg"),
    (("--layout", "none"), "layout"), (("--layout", ""), "layout"),
    (("--layout", "cyskin-63"), "ResNet18"), (("--background", "none.png"), "none.png"),
    (("--background", "d"), "d"), (("--background", "d/newest.png"), "needs a field run"),
    (("--background",), "--background has no value"), (("--bf16=yes",), "unexpected argument"),
    (("--untouched", "d/newest.png"), "there is no option '--untouched'"),
    (("--out", "out"), "there is no option '--out'"), (("extra",), "with --run RUN"),
)  # fmt: skip
"""Options that are refused with a good source."""


def cases() -> Iterator[Case]:
    for name, says in NO_SOURCE:
        yield Case(f"source {name[:20]!r}", (*LIVE, name), says=says)
    for name, content in NO_VIDEO:
        words = (*LIVE, name)
        yield Case(f"source {name}", words, holding(name, content), "cannot be read as a video")
    yield Case("source: one image", (*LIVE, "x.png"), holding("x.png", PNG), "is an image")
    yield Case("source: a pipe", (*LIVE, "f.avi"), _fifo, "no source")
    yield from _videos()
    for options, says in OPTIONS:
        yield Case(f"live {' '.join(options)}", (*LIVE, "d", *options), folder(), says)
    yield Case("the run as the first argument", ("live", "{resnet18}", "d"), folder(), "--run")
    yield Case("a run that is none", ("live", "d", "--run", "d"), folder(), "config.json")
    for name, content in (("text", b"no image"), ("cut", PNG[:-20]), ("cut in half", PNG[:9999]),
                          ("a bomb", bomb()), ("empty", b"")):  # fmt: skip
        for command in (FIELD, TRANSLATE):
            words = (*command, "--background", "b.png")
            make = _bad_background(content)
            yield Case(f"{command[0]} with a background: {name}", words, make, "b.png")
    yield Case(
        "background: a folder", (*FIELD, "--background", "b.png"), _background_folder, "b.png"
    )
    small = encoded(frame(size=(30, 40)).convert("L"))
    yield Case("background of another size", (*FIELD, "--background", "b.png"),
               _bad_background(small), fine=True)  # fmt: skip
    yield from _folders()
    for name, call in (CHANGING | REPORTED).items():
        yield Case(f"folder: {name}", (), call=call, fine=True)


def _videos() -> Iterator[Case]:
    cut = video("v.mp4", 30.0, 30, codec="mp4v", part=0.5)
    yield Case("a video without its index", (*LIVE, "v.mp4"), cut, "cannot be read as a video")
    for name, make in {
        "of 1,000 Hz": video("v.avi"),
        "of 7.5 Hz": video("v.avi", 7.5, 2),
        "of 29.97 Hz": video("v.avi", 30000 / 1001, 3),
        "of 0.01 Hz": video("v.avi", 0.01, 2),
        "of 100,000 Hz": video("v.avi", 100_000.0),
        "of one frame": video("v.avi", frames=1),
        "of 16 x 16": video("v.avi", size=(16, 16)),
        "on its side": video("v.avi", size=(320, 240)),
        "of 1,920 x 1,080": video("v.avi", size=(1920, 1080)),
        "cut in the middle": video("v.avi", 200.0, 20, part=0.5),
    }.items():
        yield Case(f"video {name}", (*LIVE, "v.avi"), make, fine=True)
    for turn in ("0", "90", "180", "270"):
        words = (*LIVE, "v.avi", "--turn-deg", turn)
        yield Case(f"video turned by {turn}", words, video("v.avi"), fine=True)
    yield Case("fewer frames than lines", (*LIVE, "v.avi", "--frames", str(2**70)),
               video("v.avi"), fine=True)  # fmt: skip
    yield Case("video called 0.avi", (*LIVE, "0.avi"), video("0.avi"), fine=True)
    yield Case("video with a space", (*LIVE, "a b.avi"), video("a b.avi"), fine=True)


def _folders() -> Iterator[Case]:
    for name, make in {
        "one frame": folder(),
        "older ones": folder(a_png=PNG, b_jpg=JPEG),
        "older damaged ones": folder(a_png=PNG[:999], b_png=b"", c_jpg=b"no image"),
        "an older bomb": folder(a_png=bomb()),
        "pipes, devices and folders": _odd_entries,
        "frames of other sizes": folder(a_png=encoded(frame(size=(64, 48)))),
    }.items():
        yield Case(f"folder with {name}", (*LIVE, "d", *ONE), make, fine=True)
    yield Case("a link to a folder", (*LIVE, "link", *ONE), _link, fine=True)
    for mode in ("L", "LA", "RGBA", "P", "1", "I;16"):
        words = (*LIVE, "d", *ONE)
        yield Case(f"folder with a frame of mode {mode}", words, _of_mode(mode), fine=True)


def _of_mode(mode: str) -> Make:
    def make(box: Path, base: Base) -> None:
        (box / "d").mkdir()
        if mode == "I;16":
            grey = np.asarray(frame().convert("L")).astype(np.uint16) * 257
            Image.fromarray(grey).save(box / "d/a.png")
        else:
            frame().convert(mode).save(box / "d/a.png")

    return make


def _reported_video(make: Make, said: str, box: Path, base: Base) -> None:
    make(box, base)
    reports: list[str] = []
    source = open_source(str(box / "v.avi"), report=reports.append)
    while source.read() is not None:
        pass
    require(len(reports) == 1 and said in reports[0], f"reported {reports}")


REPORTED: dict[str, Make] = {
    "none, but a video of 0.01 Hz": partial(_reported_video, video("v.avi", 0.01, 2), "frames/s"),
    "none, but a cut video": partial(
        _reported_video, video("v.avi", 500.0, 40, part=0.5), "ends after"
    ),
}
