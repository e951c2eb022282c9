"""The folder that a slide is written to.

slide.csv                           pose, force, shear and slip, one row a step
counts.csv                          the CySkin's counts, one row a step
markers.csv                         the DIGIT's markers, if any: one row a step and marker
frames/000.png                      the DIGIT's images
contact_digit_000.npz, contact_cyskin_000.npz    each contact's fields
slide.png                           tangential force, and what the sensors show in three steps
slide.gif, slide.mp4                images and counts; the second with imageio-ffmpeg only
"""

import importlib
import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import asdict
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
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.phi import Phi
from t2twin.sim.taxels.tactile_image import colored_tactile_image
from t2twin.sim.touch import MARKER_COLUMNS, MARKERS_CSV, Touch, marker_rows
from t2twin.slide_figure import SHOWN, draw_slide, page_size

SLIDE_CSV, COUNTS_CSV, FRAMES = "slide.csv", "counts.csv", "frames"
CONTACT_FILE = re.compile(r"contact_(digit|cyskin)_\d+\.npz")
FRAME_FILE = re.compile(r"\d+\.png")

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
    counts: list[np.ndarray] = []
    markers: list[list[Any]] = []
    layout = last = phi = None
    (folder / FRAMES).mkdir()
    for step, touch in enumerate(touches):
        rows.append(_row(step, touch))
        for sensor, contact in touch.contacts.items():
            _write_contact(folder / f"contact_{sensor}_{step:0{digits}}.npz", contact)
        if touch.image is not None:
            Image.fromarray(touch.image).save(folder / FRAMES / f"{step:0{digits}}.png")
        if touch.markers is not None:
            markers += [[step, *row] for row in marker_rows(touch)]
        if touch.layout is not None:
            layout = touch.layout
            phi = phi or Phi(layout.x_mm, layout.y_mm)
            counts.append(touch.counts)
        if touch.contacts:
            last = step, touch
            if len(shown) < SHOWN - 1 and step >= wanted[len(shown)]:
                shown.append(last)
    names = list(dict.fromkeys(name for row in rows for name in row))
    write_csv(folder / SLIDE_CSV, names, [[row.get(name) for name in names] for row in rows])
    if counts:
        names = ["step", *(f"taxel_{n}" for n in range(counts[0].size))]
        lines = [[step, *values.tolist()] for step, values in enumerate(counts)]
        write_csv(folder / COUNTS_CSV, names, lines)
    if markers:
        write_csv(folder / MARKERS_CSV, ("step", *MARKER_COLUMNS), markers)
    assert last is not None  # a path has at least one contact
    if last is not shown[-1]:
        shown.append(last)
    steps, chosen = zip(*shown, strict=True)
    page = figure("png", *page_size(chosen), lambda page: draw_slide(page, rows, steps, chosen))
    (folder / "slide.png").write_bytes(page)
    _write_animation(folder, counts, layout, phi)
    return rows


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
        row |= {f"marker_{name}": value for name, value in asdict(touch.markers).items()}
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
    folder: Path, counts: list[np.ndarray], layout: Layout | None, phi: Phi | None
) -> None:
    """Write slide.gif and, with imageio-ffmpeg, slide.mp4: images next to counts, on one scale."""
    first, *others = _animation(folder, counts, layout, phi)
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
        for image in _animation(folder, counts, layout, phi):
            writer.send(np.ascontiguousarray(image.convert("RGB")))
        writer.close()


def _animation(
    folder: Path, counts: list[np.ndarray], layout: Layout | None, phi: Phi | None
) -> Iterator[Image.Image]:
    full_scale = max(1.0, max((float(values.max()) for values in counts), default=1.0))
    frames = sorted((folder / FRAMES).iterdir())
    steps = max(len(frames), len(counts))
    for step in np.unique(np.linspace(0, steps - 1, min(steps, MAX_FRAMES)).round().astype(int)):
        parts = []
        if frames:
            with Image.open(frames[step]) as image:
                parts.append(image.convert("RGB"))
        if layout is not None and phi is not None:
            tactile = phi(counts[step].astype(np.float32))
            parts.append(colored_tactile_image(tactile, layout.x_mm, layout.y_mm, full_scale))
        parts = [
            part.resize((2 * round(part.width * HEIGHT_PX / part.height / 2), HEIGHT_PX))
            for part in parts
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
    old = [path for path in folder.iterdir() if CONTACT_FILE.fullmatch(path.name)]
    old += [folder / COUNTS_CSV, folder / MARKERS_CSV, folder / "slide.mp4"]
    if old_frames.is_dir():
        old += [path for path in old_frames.iterdir() if FRAME_FILE.fullmatch(path.name)]
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
