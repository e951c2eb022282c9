"""Calibration files, and the frames that calibrations are fitted to."""

import io
import os
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.inputs.case import Base, Case, LeavesFile, Make, holding
from benchmarks.inputs.images import JPEG, PNG, bomb, encoded, frame
from t2twin.sim.digit import probe_surfaces
from t2twin.sim.digit.calibration import DEFAULT_PATH
from t2twin.sim.digit.optics import NOISE_GREY, DigitOptics

PRESS = ("press", "circle-1", "--sensor", "digit", "--out", "out", "--calibration", "c.npz")
CALIBRATE = ("calibrate", "--background", "background.png", "--presses", "presses",
             "--ball-diameter-mm", "4.7", "--out", "out")  # fmt: skip


def _arrays() -> dict[str, np.ndarray]:
    with np.load(DEFAULT_PATH) as file:
        return {key: file[key] for key in file.files}


def _packed(arrays: dict[str, np.ndarray]) -> bytes:
    file = io.BytesIO()
    np.savez(file, **arrays)  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def _spoiled() -> Iterator[tuple[str, bytes]]:
    good = _arrays()
    whole = _packed(good)
    yield "empty", b""
    yield "text", b"gamma = 2.2\n"
    yield "a picture", PNG
    yield "an empty zip", b"PK\x05\x06" + bytes(18)
    for share in (0.2, 0.5, 0.9, 0.999):
        yield f"cut at {share:.1%}", whole[: int(share * len(whole))]
    flipped = bytearray(whole)
    flipped[len(whole) // 2] ^= 0xFF
    yield "one byte flipped", bytes(flipped)
    for key in good:
        yield f"no {key}", _packed({k: v for k, v in good.items() if k != key})
        yield f"{key} of text", _packed(good | {key: np.array("abc")})
        yield f"{key} of objects", _pickled(good, key)
        yield f"{key} empty", _packed(good | {key: np.zeros(0)})
        yield f"{key} complex", _packed(good | {key: good[key] * (1 + 1j)})
        if key != "background":
            for value in (np.nan, np.inf, 1e38, -1e30):
                yield f"{key} {value}", _packed(good | {key: np.full(good[key].shape, value)})
            yield f"{key} times 1e30", _packed(good | {key: good[key] * 1e30})
    yield "background of floats", _packed(good | {"background": good["background"] / 255.0})
    yield "background of half the size", _packed(good | {"background": good["background"][::2]})
    yield (
        "background on its side",
        _packed(good | {"background": good["background"].swapaxes(0, 1)}),
    )
    yield "one lamp inside out", _packed(good | {"sizes_mm": -good["sizes_mm"]})
    yield "a camera out of sight", _packed(good | {"shift_x_px": np.array(1e6)})
    yield "a gel on edge", _packed(good | {"tilt_y_deg": np.array(80.0)})
    yield "a tilt that is no number", _packed(good | {"tilt_x_deg": np.array(np.nan)})
    for young in (np.nan, np.inf, 0.0, -0.5, 1e9):
        yield f"a gel of {young} MPa", _packed(good | {"young_mpa": np.array(young)})
    yield "a gel of text", _packed(good | {"young_mpa": np.array("soft")})
    yield "two gels", _packed(good | {"young_mpa": np.array([0.4, 0.5])})
    yield "two lamps", _packed(good | {"lamps_mm": good["lamps_mm"][:2]})
    yield "a bomb", _zip_bomb()


def _pickled(good: dict[str, np.ndarray], key: str) -> bytes:
    return _packed(good | {key: np.array([LeavesFile()], dtype=object)})


def _zip_bomb() -> bytes:
    """200 MB of zeros in an array that the file calls response."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        array = io.BytesIO()
        np.save(array, np.zeros(25_000_000))
        archive.writestr("response.npy", array.getvalue())
    return file.getvalue()


def _odd() -> Iterator[tuple[str, bytes]]:
    good = _arrays()
    yield "a soft gel", _packed(good | {"young_mpa": np.array(0.05)})
    yield "with one array more", _packed(good | {"note": np.array("mine")})
    yield "in single precision", _packed({**good, "response": good["response"].astype(np.float32)})
    yield "no light at all", _packed(good | {"response": np.zeros_like(good["response"])})
    yield "a black background", _packed(good | {"background": np.zeros_like(good["background"])})
    yield "lamps half a metre off", _packed(good | {"lamps_mm": good["lamps_mm"] * 22.0})
    yield "lamps within the gel", _packed(good | {"lamps_mm": np.zeros((3, 3))})
    yield "the largest lamps", _packed(good | {"sizes_mm": np.full(3, 100.0)})
    yield "a shifted camera", _packed(good | {"shift_y_px": np.array(-100.0)})
    yield "a tilted gel", _packed(good | {"tilt_x_deg": np.array(5.0)})
    yield "a far camera", _packed(good | {"distance_mm": np.array(100.0)})
    yield "a near camera", _packed(good | {"distance_mm": np.array(5.0)})
    yield "a coarse camera", _packed(good | {"scale_px_per_mm": np.array(5.0)})
    yield "a fine camera", _packed(good | {"scale_px_per_mm": np.array(100.0)})


def frames(background: bytes | None = PNG, *presses: tuple[str, bytes]) -> Make:
    """Lays out a background and a folder of presses."""

    def make(box: Path, base: Base) -> None:
        if background is not None:
            (box / "background.png").write_bytes(background)
        (box / "presses").mkdir()
        for name, content in presses:
            (box / "presses" / name).write_bytes(content)

    return make


BALL_MM = 4.7
"""Diameter of the ball of CALIBRATE, mm."""

UNTOUCHED = encoded(Image.new("RGB", (240, 320), (90, 90, 90)))
FRAMES = tuple((f"press_{number}.png", encoded(frame(number))) for number in range(8))
good_frames = frames(UNTOUCHED, *FRAMES)


def ball_frames(box: Path, base: Base) -> None:
    """Pictures that a calibration can be fitted to: of the light that ships, with noise."""
    optics, rng = DigitOptics.load(), np.random.default_rng(0)
    (box / "presses").mkdir()
    untouched = probe_surfaces.ball(0.0, 0.0, 1.0, BALL_MM / 2) * 0.0
    _save(optics.render(untouched, rng, NOISE_GREY), box / "background.png")
    for number in range(8):
        x_mm, y_mm = 3.0 * np.cos(0.8 * number), 4.0 * np.sin(0.8 * number)
        surface = probe_surfaces.ball(x_mm, y_mm, 1.0 + 0.05 * number, BALL_MM / 2)
        _save(optics.render(surface, rng, NOISE_GREY), box / f"presses/{number}.png")


def _save(picture: np.ndarray, path: Path) -> None:
    Image.fromarray(picture).save(path)


def _unlike(content: bytes) -> tuple[tuple[str, bytes], ...]:
    return (*FRAMES[:3], ("press_9.png", content))


def _beside(name: str, lay: Callable[[Path], object]) -> Make:
    """Good frames, and beside them what `lay` makes."""

    def make(box: Path, base: Base) -> None:
        good_frames(box, base)
        lay(box / "presses" / name)

    return make


_table_folder = _beside("forces.csv", Path.mkdir)
_table_fifo = _beside("forces.csv", os.mkfifo)
_press_fifo = _beside("press_9.png", os.mkfifo)

BAD_FRAMES: tuple[tuple[str, Make, str], ...] = (
    ("no background", frames(None, *FRAMES), "background.png"),
    ("an empty background", frames(b"", *FRAMES), "background.png"),
    ("a background of text", frames(b"grey", *FRAMES), "background.png"),
    ("half a background", frames(UNTOUCHED[:200], *FRAMES), "background.png"),
    ("a background of another size", frames(encoded(frame(size=(320, 240))), *FRAMES), "wide"),
    ("a background of 1 x 1", frames(encoded(frame(size=(1, 1))), *FRAMES), "wide"),
    ("a background that is a bomb", frames(bomb(), *FRAMES), "pixels"),
    ("no presses", frames(UNTOUCHED), "presses"),
    ("one press", frames(UNTOUCHED, *FRAMES[:1]), "press"),
    ("notes only", frames(UNTOUCHED, ("notes.txt", b"x")), "presses"),
    ("an empty press", frames(UNTOUCHED, *_unlike(b"")), "press_9.png"),
    ("half a press", frames(UNTOUCHED, *_unlike(PNG[:400])), "press_9.png"),
    ("a press that is a bomb", frames(UNTOUCHED, *_unlike(bomb())), "press_9.png"),
    ("a press of another size", frames(UNTOUCHED, *_unlike(encoded(frame(size=(240, 240))))), "9"),
    ("presses of nothing", frames(UNTOUCHED, *((f"{n}.png", UNTOUCHED) for n in range(4))), ""),
    ("one press four times", frames(UNTOUCHED, *((f"{n}.png", PNG) for n in range(4))), ""),
    ("GIF called PNG", frames(UNTOUCHED, *_unlike(encoded(frame(), "GIF"))), "press_9.png"),
    ("a press without its end", frames(UNTOUCHED, *_unlike(PNG[:-12])), "press_9.png"),
    ("a press without its last byte", frames(UNTOUCHED, *_unlike(PNG[:-1])), "press_9.png"),
    ("a background without its end", frames(UNTOUCHED[:-12], *FRAMES), "background.png"),
    ("half a JPEG", frames(UNTOUCHED, *FRAMES[:3], ("press_9.jpg", JPEG[: len(JPEG) // 2])),
     "press_9.jpg"),
    ("a press that is a TIFF", frames(UNTOUCHED, *_unlike(encoded(frame(), "TIFF"))),
     "press_9.png"),
    ("a table that is a folder", _table_folder, "forces.csv"),
    ("a table that is a FIFO", _table_fifo, "forces.csv"),
    ("a press that is a FIFO", _press_fifo, "press_9.png"),
    ("16 bits", frames(UNTOUCHED, *_unlike(encoded(Image.fromarray(
        np.zeros((320, 240), np.uint16))))), "8 bits"),
    ("all of another size", frames(encoded(frame(size=(120, 160))), *(
        (f"{n}.png", encoded(frame(n, (120, 160)))) for n in range(4))), "wide"),
)  # fmt: skip


BAD_TABLES: tuple[tuple[str, bytes], ...] = (
    ("empty", b""),
    ("a picture", PNG),
    ("no file column", b"force_n\n1.0\n"),
    ("another file", b"file,force_n\nnone.png,1.0\n"),
    ("a file twice", b"file,force_n\npress_0.png,1\npress_0.png,1\n"),
    ("a file above", b"file,force_n\n../background.png,1\n"),
    ("no file's name", b"file,force_n\n,1\n"),
    ("a force of text", b"file,force_n\npress_0.png,soft\n"),
    ("a force of 0", b"file,force_n\npress_0.png,0\n"),
    ("a force below 0", b"file,force_n\npress_0.png,-1\n"),
    ("a force without end", b"file,force_n\npress_0.png,inf\n"),
    ("a force of 1e9", b"file,force_n\npress_0.png,1e9\n"),
    ("a depth in micrometers", b"file,depth_mm\npress_0.png,900\n"),
    ("a depth of 0", b"file,depth_mm\npress_0.png,0\n"),
    ("a ball of 40 mm", b"file,ball_diameter_mm\npress_0.png,40\n"),
    ("not UTF-8", b"file,force_n\npress_\xff.png,1\n"),
    ("a misspelt force", b"file,froce_n\npress_0.png,1\n"),
    ("a misspelt depth", b"file,depht_mm\npress_0.png,1\n"),
    ("a force without its unit", b"file,force\npress_0.png,1\n"),
    ("a depth in another unit", b"file,depth_um\npress_0.png,900\n"),
    ("capitals", b"file,Force_N\npress_0.png,1\n"),
    ("a space before a column's name", b"file, force_n\npress_0.png,1\n"),
    ("a column of notes", b"file,force_n,note\npress_0.png,1,good\n"),
    ("a column without a name", b"file,force_n,\npress_0.png,1,\n"),
    ("a column twice", b"file,force_n,force_n\npress_0.png,1,2\n"),
    ("the files twice", b"file,file\npress_0.png,press_1.png\n"),
    ("a force of nan", b"file,force_n\npress_0.png,nan\n"),
    ("a depth of NaN", b"file,depth_mm\npress_0.png,NaN\n"),
    ("a ball of nan", b"file,ball_diameter_mm\npress_0.png,nan\n"),
    ("a force of 1e400", b"file,force_n\npress_0.png,1e400\n"),
    ("a force of NA", b"file,force_n\npress_0.png,NA\n"),
    ("a force of null", b"file,force_n\npress_0.png,null\n"),
    ("a force with its unit", b"file,force_n\npress_0.png,1 N\n"),
    ("a force of -inf", b"file,force_n\npress_0.png,-inf\n"),
    ("a depth that is true", b"file,depth_mm\npress_0.png,true\n"),
    ("a force with two commas", b"file;force_n\npress_0.png;1,000,5\n"),
    ("semicolons and nan", b"file;force_n\npress_0.png;nan\n"),
    ("an open quote", b'file,force_n\n"press_0.png,1\n'),
)
"""forces.csv beside frames, which are as they should be."""


def with_table(content: bytes) -> Make:
    return frames(UNTOUCHED, *FRAMES, ("forces.csv", content))


def _no_folder(box: Path, base: Base) -> None:
    (box / "background.png").write_bytes(UNTOUCHED)
    (box / "presses").write_bytes(JPEG)


def cases() -> Iterator[Case]:
    for name, content in _spoiled():
        yield Case(f"calibration: {name}", PRESS, holding("c.npz", content), "c.npz")
    for name, content in _odd():
        yield Case(f"calibration: {name}", PRESS, holding("c.npz", content), fine=True)
    for name, make, says in BAD_FRAMES:
        yield Case(f"frames: {name}", CALIBRATE, make, says)
    for name, content in BAD_TABLES:
        yield Case(f"forces.csv: {name}", CALIBRATE, with_table(content), "forces.csv")
    alone = ("calibrate", "--background", "background.png", "--out", "out")
    yield Case("frames: the background alone", alone, frames(UNTOUCHED), fine=True)
    for name, content in (("text", b"grey"), ("cut", UNTOUCHED[:200]), ("a bomb", bomb())):
        yield Case(f"the background alone: {name}", alone, frames(content), "background.png")
    yield Case("frames: as they should be", (*CALIBRATE, "--held-out", "2"), ball_frames, fine=True)
    yield Case("frames: presses are a file", CALIBRATE, _no_folder, "presses")
    for held in ("0", "3", "8", "9"):
        yield Case(f"frames: {held} of 8 held out", (*CALIBRATE, "--held-out", held), good_frames)
