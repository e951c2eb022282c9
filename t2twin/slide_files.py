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

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from t2twin.core.draw import (
    COLORS,
    colored_tactile_image,
    draw_tactile_image,
    figure,
    in_a_row,
)
from t2twin.core.errors import T2TwinError
from t2twin.core.files import (
    check_own,
    check_replaceable,
    locked,
    move_into,
    temporary_folder,
    write_csv,
)
from t2twin.sim.contact.types import Contact
from t2twin.sim.optical.gel_camera import ImageReading
from t2twin.sim.taxels.taxel_array import CountsReading
from t2twin.sim.touch import MARKER_COLUMNS, MARKERS_CSV, Touch, marker_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SLIDE_CSV, FRAMES = "slide.csv", "frames"
OPTIONAL_FILE = re.compile(
    r"contact_([a-z0-9_-]+)_\d+\.npz|counts(_[a-z0-9_-]+)?\.csv|markers\.csv|slide\.mp4"
)
FRAME_FILE = re.compile(r"(?:([a-z0-9_-]+)_)?\d+\.png")
"""Names of the files that an earlier slide may have and a new one lacks."""

MARKER_VALUES = ("pitch_mm", "diameter_mm", "jitter_mm", "seed")
"""Attributes of markers that are columns of slide.csv."""

MIN_DIGITS = 3  # of a step in a file's name, at least
FRAME_MS = 150  # duration of a step in the animation (assumed)
MAX_FRAMES = 300  # steps in the animation at most (assumed: its file stays below 100 MB)
HEIGHT_PX = 480  # of the animation; even, as video codecs need

LIMIT_COLOR, STICK_COLOR, SLIP_COLOR = "#888888", "#9ec5e8", "#f2b880"
MARGIN_MM = 1.0  # around the contact
LEGEND_PT = 20  # height of the legend between a panel and its title
KEY_SHARE = 0.1  # height below the contact for the key of the arrows, share of the panel (assumed)
ARROWS = 10  # along the longer side of the contact, about
MIN_ARROW_PX = 3.0  # shortest displacement of a marker that has an arrow
SHOWN = 3  # steps that the figure shows: the first, the middle and the last one

PANEL_WIDTH, PANEL_HEIGHT, FORCE_HEIGHT = 2.5, 2.6, 2.4
"""Sizes of a panel of a step and of the panels of the force, inches."""

Row = dict[str, Any]
"""A row of slide.csv. Columns of a sensor without contact are missing."""


def write_slide(folder: Path, touches: Iterable[Touch], number: int) -> list[Row]:
    """Write all files of the touches of a path, or none; returns the rows of slide.csv.

    touches: may compute each touch when it is needed. number: how many there are.
    Raises T2TwinError for a folder with other files, or that cannot be written.
    """
    with locked(folder):
        check_own(folder, SLIDE_CSV, "slide")
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
    width_in = 2 * PANEL_WIDTH * len(last[1].contacts)
    height_in = FORCE_HEIGHT + PANEL_HEIGHT * len(chosen)
    draw = partial(_draw_slide, rows=rows, steps=steps, shown=chosen)
    (folder / "slide.png").write_bytes(figure("png", width_in, height_in, draw))
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
        "tilt_x_deg": float(np.rad2deg(command.tilt_x_rad)),
        "tilt_y_deg": float(np.rad2deg(command.tilt_y_rad)),
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
    each = {"save_all": True, "append_images": others, "duration": FRAME_MS, "loop": 0}
    first.save(folder / "slide.gif", **each)
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
        page = in_a_row(pictures(int(step)), HEIGHT_PX)
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
    old_frames.mkdir(exist_ok=True)
    files = [(path, OPTIONAL_FILE.fullmatch(path.name)) for path in folder.iterdir()]
    old = [path for path, match in files if match]
    sensors = {match[1] for _, match in files if match}
    images = [(path, FRAME_FILE.fullmatch(path.name)) for path in old_frames.iterdir()]
    old += [path for path, match in images if match and match[1] in (None, *sensors)]
    for path in old:
        if path.is_file():
            path.unlink()
    move_into(folder, new)
    move_into(old_frames, sorted(frames.iterdir()))
    with suppress(OSError):  # it has files
        old_frames.rmdir()


def _draw_slide(
    page: Figure, rows: list[Row], steps: Sequence[int], shown: Sequence[Touch]
) -> None:
    """The tangential force of each sensor, and below it a row of panels for each shown step.

    rows: of slide.csv. steps, shown: touches with contact, and their numbers.
    """
    page.set_layout_engine("constrained", wspace=0.04, hspace=0.04)
    sensors = list(shown[-1].contacts)
    heights = [FORCE_HEIGHT, PANEL_HEIGHT * len(shown)]
    top, bottom = page.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
    panels = top.subplots(1, len(sensors), squeeze=False)[0]
    for axes, sensor in zip(panels, sensors, strict=True):
        axes.set_title(f"elastomer of {sensor}", loc="left", pad=LEGEND_PT)
        _draw_force(axes, rows, sensor, shown[-1].contacts[sensor])
    columns = bottom.subplots(len(shown), 2 * len(sensors), squeeze=False).T
    for number, sensor in enumerate(sensors):
        pair = columns[2 * number : 2 * number + 2]
        images, contacts = pair if number == 0 else pair[::-1]
        _draw_contacts(sensor, contacts, [touch.contacts[sensor] for touch in shown])
        readings = [touch[sensor] for touch in shown]
        draw: Any = _draw_images if hasattr(readings[0], "image") else _draw_counts
        draw(sensor, images, readings)
    for axes, step in zip(columns[0], steps, strict=True):
        axes.set_ylabel(f"step {step}\n{axes.get_ylabel()}".strip())
    from matplotlib.patches import Patch

    bottom.legend(
        handles=[Patch(color=STICK_COLOR, label="stick"), Patch(color=SLIP_COLOR, label="slip")],
        loc="outside lower center",
        ncols=2,
    )


def _draw_force(axes: Axes, rows: list[Row], sensor: str, contact: Contact) -> None:
    """Tangential force over the path's length, and torque if the shape turns.

    The horizontal axis is the rotation where the shape only turns, and else the step where it does
    not move in every step.
    """

    def column(name: str) -> np.ndarray:
        return np.array([row.get(name, np.nan) for row in rows], float)

    touches = column("force_n") > 0
    slides = touches[1:] & touches[:-1]
    moved_mm = np.hypot(np.diff(column("x_mm")), np.diff(column("y_mm")))
    turned_deg = np.abs(np.diff(column("yaw_deg")))
    if (moved_mm[slides] > 0).all():
        axes.set_xlabel("displacement of the shape, mm")
        travel = np.cumsum([0.0, *moved_mm])
    elif (turned_deg[slides] > 0).all() and not moved_mm[slides].any():
        axes.set_xlabel("rotation of the shape, degrees")
        travel = np.cumsum([0.0, *turned_deg])
    else:
        axes.set_xlabel("step")
        travel = column("step")
    force_n = np.hypot(column(f"{sensor}_shear_x_n"), column(f"{sensor}_shear_y_n"))
    lines = axes.plot(travel, force_n, ".-", color=COLORS[0], label="tangential force")
    if contact.motion is not None:
        limit_n = np.where(
            np.isnan(force_n), np.nan, contact.motion.friction.limit_n(column("force_n"))
        )
        lines += axes.plot(
            travel, limit_n, "--", color=LIMIT_COLOR, label="limit of friction", linewidth=1
        )
    axes.set_ylabel("tangential force, N")
    axes.set_ylim(bottom=0)
    if turned_deg[slides].any():
        other = axes.twinx()
        other.spines["right"].set_visible(True)
        torque_nmm = column(f"{sensor}_torque_nmm")
        lines += other.plot(travel, torque_nmm, ".-", color=COLORS[1], label="torque")
        if np.nanmin(torque_nmm) >= 0:
            other.set_ylim(bottom=0)
        other.set_ylabel("torque, N mm")
    axes.legend(handles=lines, loc="lower left", bbox_to_anchor=(0, 1), ncols=3)


def _draw_images(sensor: str, panels: Sequence[Axes], readings: Sequence[ImageReading]) -> None:
    """The images of a gel camera; arrows from the markers at rest to the displaced ones."""
    panels[0].set_title(f"image of {sensor}", loc="left")
    for axes, reading in zip(panels, readings, strict=True):
        assert reading.image is not None and reading.contact is not None
        axes.imshow(reading.image)
        axes.set(xticks=[], yticks=[])
        markers = reading.sensor.markers
        if markers is None:
            continue
        panels[0].set_title(f"image of {sensor}\narrows: marker displacement", loc="left")
        rest, moved = markers.seen_px(reading.sensor.optics.camera, reading.contact)
        by = moved - rest
        kept = np.hypot(*by.T) >= MIN_ARROW_PX
        axes.quiver(
            rest[kept, 1], rest[kept, 0], by[kept, 1], by[kept, 0],
            angles="xy", scale_units="xy", scale=1, width=0.01, color="white",
        )  # fmt: skip
        rows, columns, _ = reading.image.shape
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))


def _draw_counts(sensor: str, panels: Sequence[Axes], readings: Sequence[CountsReading]) -> None:
    """The tactile images of a taxel array on one scale, with a ring on each taxel."""
    largest = max(1.0, *(float(reading.tactile_image.max()) for reading in readings))
    for axes, reading in zip(panels, readings, strict=True):
        phi, layout = reading.sensor.phi, reading.sensor.layout
        places = phi.centers_mm, layout.x_mm, layout.y_mm
        drawn = draw_tactile_image(axes, reading.tactile_image, *places, (0.0, largest))
        axes.figure.colorbar(drawn, ax=axes, fraction=0.07, label="counts", format="{x:,g}")
    panels[0].set_title(f"tactile image of {sensor}", loc="left")


def _draw_contacts(sensor: str, panels: Sequence[Axes], contacts: Sequence[Contact]) -> None:
    """Stick and slip regions, and the tangential traction on the sensor as arrows of one scale."""
    from matplotlib.colors import ListedColormap

    first = contacts[0]
    touched = np.any([contact.pressure_kpa > 0 for contact in contacts], axis=0)
    columns, rows = np.flatnonzero(touched.any(axis=0)), np.flatnonzero(touched.any(axis=1))
    left, right = first.x_mm[columns[[0, -1]]] + (-MARGIN_MM, MARGIN_MM)
    top, bottom = first.y_mm[rows[[0, -1]]] + (-MARGIN_MM, MARGIN_MM)
    bottom += KEY_SHARE * (bottom - top)
    peak = max(float(np.hypot(*contact.shear_kpa).max()) for contact in contacts)
    every = max(1, round(max(columns.size, rows.size) / ARROWS))
    for axes, contact in zip(panels, contacts, strict=True):
        half = contact.pitch_mm / 2
        x_mm, y_mm, inside = contact.x_mm, contact.y_mm, contact.pressure_kpa > 0
        axes.imshow(
            np.where(inside, 1.0 + contact.slipping, np.nan),
            cmap=ListedColormap([STICK_COLOR, SLIP_COLOR]),
            vmin=1,
            vmax=2,
            extent=(x_mm[0] - half, x_mm[-1] + half, y_mm[-1] + half, y_mm[0] - half),
        )
        axes.set(xlim=(left, right), ylim=(bottom, top), ylabel="y (down), mm")
        above = f"elastomer of {sensor}\n" if axes is panels[0] else ""
        axes.set_title(f"{above}{100 * contact.slip_share:.0f} % of the contact slips", loc="left")
        if contact.shear_kpa.any():
            _draw_traction(axes, contact, peak, every)
    panels[-1].set_xlabel("x, mm")


def _draw_traction(axes: Axes, contact: Contact, peak_kpa: float, every: int) -> None:
    """Arrows at each `every`-th cell in contact. peak_kpa: traction of the longest one."""
    rows, columns = np.nonzero(contact.pressure_kpa > 0)
    kept = (rows % every == every // 2) & (columns % every == every // 2)
    at = rows[kept], columns[kept]
    along_x, along_y = contact.shear_kpa
    arrows = axes.quiver(
        contact.x_mm[at[1]], contact.y_mm[at[0]], along_x[at], along_y[at], angles="xy",
        scale_units="xy", scale=peak_kpa / (1.1 * every * contact.pitch_mm), width=0.008,
    )  # fmt: skip
    label = f"{peak_kpa:.2g} kPa" if peak_kpa < 10 else f"{peak_kpa:.0f} kPa"
    axes.quiverkey(arrows, 0.72, 0.05, peak_kpa, label, labelpos="E")
