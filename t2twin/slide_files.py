"""The folder that a slide is written to.

slide.csv                pose, and force, shear and slip of each sensor, one row a step
counts.csv               counts of the first taxel array, one row a step
counts_SENSOR.csv        those of the second one, if there is one
markers.csv              markers of the first gel camera, if any: one row a step and marker
frames/000.png           images of the first gel camera
frames/SENSOR_000.png    those of the second one, if there is one
contact_SENSOR_000.npz   each contact's fields
slide.png                tangential force, and what the sensors show in three steps
slide.gif, slide.mp4     images and counts; the second with imageio-ffmpeg only
"""

import importlib
import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.core.errors import T2TwinError
from t2twin.core.files import (
    check_replaceable,
    is_empty,
    locked,
    move_into,
    temporary_folder,
    write_csv,
)
from t2twin.report.figures import figure
from t2twin.sim.contact.types import Contact
from t2twin.sim.taxels.tactile_image import colored_tactile_image
from t2twin.sim.touch import MARKER_COLUMNS, MARKERS_CSV, Touch, marker_rows
from t2twin.slide_figure import SHOWN, draw_slide, page_size

SLIDE_CSV, FRAMES = "slide.csv", "frames"
CONTACT_FILE = re.compile(r"contact_([a-z0-9_-]+)_\d+\.npz")
COUNTS_FILE = re.compile(r"counts(_[a-z0-9_-]+)?\.csv")
FRAME_FILE = re.compile(r"(?:([a-z0-9_-]+)_)?\d+\.png")

MARKER_VALUES = ("pitch_mm", "diameter_mm", "jitter_mm", "seed")
"""Attributes of markers that are columns of slide.csv."""

MIN_DIGITS = 3
"""Digits of a step in a file's name, at least."""

FRAME_MS = 150
"""Duration of a step in the animation, ms (assumed)."""

MAX_FRAMES = 300
"""Steps in the animation at most, evenly spaced (assumed: its file stays below 100 MB)."""

HEIGHT_PX = 480
"""Height of the animation; even, as video codecs need."""

Row = dict[str, Any]
"""A row of slide.csv. Columns of a sensor without contact are missing."""


def write_slide(folder: Path, touches: Iterable[Touch], number: int) -> list[Row]:
    """Write all files of the touches of a path, or none; returns the rows of slide.csv.

    touches: may compute each touch when it is needed. number: how many there are.
    Raises T2TwinError for a folder with other files, or that cannot be written.
    """
    with locked(folder):
        if not is_empty(folder) and not (folder / SLIDE_CSV).is_file():
            raise T2TwinError(
                f"{folder} is not empty, and its files are not of a slide; expected a new or empty "
                "folder, or one of an earlier slide"
            )
        with temporary_folder(folder, "slide") as temporary:
            rows = _write(temporary, touches, number)
            _replace(folder, temporary)
    return rows


def _write(folder: Path, touches: Iterable[Touch], number: int) -> list[Row]:
    digits = max(MIN_DIGITS, len(str(number - 1)))
    wanted = np.linspace(0, number - 1, SHOWN)
    shown: list[tuple[int, Touch]] = []
    rows: list[Row] = []
    images: dict[str, list[Path]] = {}  # by sensor, as counts
    counts: dict[str, list[np.ndarray]] = {}
    markers: list[list[Any]] = []
    last = None
    (folder / FRAMES).mkdir()
    for step, touch in enumerate(touches):
        rows.append(_row(step, touch))
        for sensor, contact in touch.contacts.items():
            _write_contact(folder / f"contact_{sensor}_{step:0{digits}}.npz", contact)
        for sensor, reading in touch.readings.items():
            if (image := getattr(reading, "image", None)) is not None:
                of_sensor = images.setdefault(sensor, [])
                prefix = _after_first(images, sensor, f"{sensor}_")
                of_sensor.append(folder / FRAMES / f"{prefix}{step:0{digits}}.png")
                Image.fromarray(image).save(of_sensor[-1])
            if (values := getattr(reading, "counts", None)) is not None:
                counts.setdefault(sensor, []).append(values)
        if touch.markers is not None:
            markers += [[step, *row] for row in marker_rows(touch)]
        if touch.contacts:
            last = step, touch
            if len(shown) < SHOWN - 1 and step >= wanted[len(shown)]:
                shown.append(last)
    names = list(dict.fromkeys(name for row in rows for name in row))
    write_csv(folder / SLIDE_CSV, names, [[row.get(name) for name in names] for row in rows])
    for sensor, of_steps in counts.items():
        names = ["step", *(f"taxel_{n}" for n in range(of_steps[0].size))]
        lines = [[step, *values.tolist()] for step, values in enumerate(of_steps)]
        write_csv(folder / f"counts{_after_first(counts, sensor, f'_{sensor}')}.csv", names, lines)
    if markers:
        write_csv(folder / MARKERS_CSV, ("step", *MARKER_COLUMNS), markers)
    assert last is not None  # a path has at least one contact
    if last is not shown[-1]:
        shown.append(last)
    steps, chosen = zip(*shown, strict=True)
    page = figure("png", *page_size(chosen), lambda page: draw_slide(page, rows, steps, chosen))
    (folder / "slide.png").write_bytes(page)
    sensors = {sensor: reading.sensor for sensor, reading in last[1].readings.items()}
    pictures = partial(_pictures, images, counts, sensors)
    _write_animation(folder, pictures, len(rows))
    return rows


def _after_first(of_kind: Iterable[str], sensor: str, name: str) -> str:
    """A part of a file's name that all sensors of a kind but the first one have."""
    return "" if sensor == next(iter(of_kind)) else name


def _pictures(
    images: dict[str, list[Path]], counts: dict[str, list[np.ndarray]], sensors: dict[str, Any],
    step: int,
) -> list[Image.Image]:  # fmt: skip
    """The image or the tactile image of each sensor in a step; counts are on one scale."""
    found = []
    for sensor, device in sensors.items():
        if sensor in images:
            with Image.open(images[sensor][step]) as image:
                found.append(image.convert("RGB"))
            continue
        brightest = max(1.0, max(float(values.max()) for values in counts[sensor]))
        layout, scale = device.layout, device.spec.tactile_image.px_per_mm
        tactile = device.phi(counts[sensor][step].astype(np.float32))
        places = layout.x_mm, layout.y_mm
        found.append(colored_tactile_image(tactile, *places, brightest, px_per_mm=scale))
    return found


def _row(step: int, touch: Touch) -> Row:
    command = touch.command
    row: Row = {
        "step": step,
        "x_mm": command.x_mm,
        "y_mm": command.y_mm,
        "yaw_deg": float(np.rad2deg(command.yaw_rad)),
        "force_n": command.force_n,
    }
    for sensor, contact in touch.contacts.items():
        shear_x_n, shear_y_n = contact.shear_n.tolist()
        row |= {
            f"{sensor}_shear_x_n": shear_x_n,
            f"{sensor}_shear_y_n": shear_y_n,
            f"{sensor}_torque_nmm": contact.torque_nmm,
            f"{sensor}_slip_share": contact.slip_share,
            f"{sensor}_depth_mm": contact.depth_mm,
            f"{sensor}_settled": bool(contact.settled),
            f"{sensor}_bottomed": bool(contact.bottomed),
        }
    if touch.markers is not None:
        row |= {f"marker_{name}": getattr(touch.markers, name) for name in MARKER_VALUES}
    return row


def _write_contact(path: Path, contact: Contact) -> None:
    np.savez_compressed(
        path,
        pressure_kpa=contact.pressure_kpa,
        shear_kpa=contact.shear_kpa.astype(np.float32),
        displacement_mm=contact.displacement_mm,
        slip_mm=contact.slip_mm.astype(np.float32),
        x_mm=contact.x_mm,
        y_mm=contact.y_mm,
    )


def _write_animation(
    folder: Path, pictures: Callable[[int], list[Image.Image]], steps: int
) -> None:
    """Write slide.gif and, with imageio-ffmpeg, slide.mp4: the pictures of a step, side by side."""
    first, *others = _animation(pictures, steps)
    first.save(
        folder / "slide.gif",
        save_all=True,
        append_images=others,
        duration=FRAME_MS,
        loop=0,
    )
    if find_spec("imageio_ffmpeg"):
        writer = importlib.import_module("imageio_ffmpeg").write_frames(
            str(folder / "slide.mp4"), first.size, fps=1000 / FRAME_MS, macro_block_size=2
        )
        writer.send(None)
        for image in _animation(pictures, steps):
            writer.send(np.ascontiguousarray(image.convert("RGB")))
        writer.close()


def _animation(pictures: Callable[[int], list[Image.Image]], steps: int) -> Iterator[Image.Image]:
    for step in np.unique(np.linspace(0, steps - 1, min(steps, MAX_FRAMES)).round().astype(int)):
        parts = [
            part.resize((2 * round(part.width * HEIGHT_PX / part.height / 2), HEIGHT_PX))
            for part in pictures(int(step))
        ]
        page = Image.new("RGB", (sum(part.width for part in parts), HEIGHT_PX))
        left = 0
        for part in parts:
            page.paste(part, (left, 0))
            left += part.width
        yield page.quantize(palette=page.quantize())  # the second pass dithers


def _replace(folder: Path, temporary: Path) -> None:
    """Move the new files into the folder, and remove those of an earlier slide."""
    frames, old_frames = temporary / FRAMES, folder / FRAMES
    new = [path for path in temporary.iterdir() if path != frames]
    new.sort(key=lambda path: path.name != SLIDE_CSV)  # first: it marks the folder of a slide
    if old_frames.exists() and not old_frames.is_dir():
        raise T2TwinError(f"{old_frames} is a file; expected a folder, or no such file")
    for path in (*new, *frames.iterdir()):
        check_replaceable(folder / path.relative_to(temporary))
    contacts = [(path, CONTACT_FILE.fullmatch(path.name)) for path in folder.iterdir()]
    old = [path for path, match in contacts if match]
    sensors = {None, *(match[1] for _, match in contacts if match)}
    old += [path for path in folder.iterdir() if COUNTS_FILE.fullmatch(path.name)]
    old += [folder / MARKERS_CSV, folder / "slide.mp4"]
    if old_frames.is_dir():
        frame_files = [(path, FRAME_FILE.fullmatch(path.name)) for path in old_frames.iterdir()]
        old += [path for path, match in frame_files if match and match[1] in sensors]
    for path in old:
        if path.is_file():
            path.unlink()
    move_into(folder, new)
    if any(frames.iterdir()):
        old_frames.mkdir(exist_ok=True)
        move_into(old_frames, sorted(frames.iterdir()))
    else:
        with suppress(OSError):  # there is none, or it has other files
            old_frames.rmdir()
