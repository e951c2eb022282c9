"""The folder that a slide is written to; docs/reference/file-formats.md describes its files."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from t2twin.core import draw, files
from t2twin.sim.contact.types import Contact
from t2twin.sim.touch import MARKER_COLUMNS, MARKERS_CSV, Touch, marker_rows

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SLIDE_CSV, FRAMES = "slide.csv", "frames"

MARKER_VALUES = ("pitch_mm", "diameter_mm", "jitter_mm", "seed")  # also columns of slide.csv
MIN_DIGITS = 3  # of a step in a file's name, at least
FRAME_MS = 150  # duration of a step in the animation (assumed)
MAX_FRAMES = 300  # steps in the animation at most (assumed: its file stays below 100 MB)
HEIGHT_PX = 480  # of the animation; even, as video codecs need

LIMIT_COLOR = "#888888"
LEGEND_PT = 20  # height of the legend between a panel and its title
MIN_ARROW_PX = 3.0  # shortest displacement of a marker that has an arrow
SHOWN = 3  # steps that the figure shows: the first, the middle and the last one

PANEL_WIDTH, PANEL_HEIGHT, FORCE_HEIGHT = 2.5, 2.6, 2.4  # of a step and of the force, inches

Row = dict[str, Any]
"""A row of slide.csv. Columns of a sensor without contact are missing."""


def write_slide(folder: Path, touches: Iterable[Touch], number: int) -> list[Row]:
    """Writes all files of a path's touches, of this number, or none; returns the rows of slide.csv.
    Raises T2TwinError where another's file has one of the names, or none can be written."""
    with files.result_folder(folder, "slide", [SLIDE_CSV]) as temporary:
        return _write(temporary, touches, number)


def _write(folder: Path, touches: Iterable[Touch], number: int) -> list[Row]:
    digits = max(MIN_DIGITS, len(str(number - 1)))
    wanted = np.linspace(0, number - 1, SHOWN)
    shown: dict[int, Touch] = {}  # by step
    rows: list[Row] = []
    images: dict[str, list[Path]] = {}  # by sensor, as counts
    counts: dict[str, list[np.ndarray]] = {}
    markers: list[list[Any]] = []
    (folder / FRAMES).mkdir()
    last = None
    for step, touch in enumerate(touches):
        rows.append(_row(step, touch))
        for sensor, contact in touch.contacts.items():
            np.savez_compressed(
                folder / f"contact_{sensor}_{step:0{digits}}.npz",
                pressure_kpa=contact.pressure_kpa,
                shear_kpa=contact.shear_kpa.astype(np.float32),
                displacement_mm=contact.displacement_mm,
                slip_mm=contact.slip_mm.astype(np.float32),
                x_mm=contact.x_mm,
                y_mm=contact.y_mm,
            )
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
                shown[step] = touch
    assert last is not None  # a path has at least one contact
    shown[last[0]] = last[1]
    names = list(dict.fromkeys(name for row in rows for name in row))
    files.write_csv(folder / SLIDE_CSV, names, [[row.get(name) for name in names] for row in rows])
    for sensor, of_steps in counts.items():
        names = ["step", *(f"taxel_{n}" for n in range(of_steps[0].size))]
        lines = [[step, *values.tolist()] for step, values in enumerate(of_steps)]
        name = f"counts{_after_first(counts, sensor, f'_{sensor}')}.csv"
        files.write_csv(folder / name, names, lines)
    if markers:
        files.write_csv(folder / MARKERS_CSV, ("step", *MARKER_COLUMNS), markers)
    width_in = 2 * PANEL_WIDTH * len(last[1].contacts)
    height_in = FORCE_HEIGHT + PANEL_HEIGHT * len(shown)
    filled = partial(_draw_slide, rows=rows, shown=shown)
    (folder / "slide.png").write_bytes(draw.figure("png", width_in, height_in, filled))
    _write_animation(folder, images, counts, last[1])
    return rows


def _after_first(of_kind: Iterable[str], sensor: str, name: str) -> str:
    """A part of a file's name that all sensors of a kind but the first one have."""
    return "" if sensor == next(iter(of_kind)) else name


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


def _write_animation(
    folder: Path, images: dict[str, list[Path]], counts: dict[str, list[np.ndarray]], last: Touch
) -> None:
    """Write slide.gif and, with imageio-ffmpeg, slide.mp4: the images and the tactile images of all
    sensors side by side; counts are on one scale. images, counts: of each step."""
    steps, pages = len(next(iter([*images.values(), *counts.values()]))), []
    for step in np.unique(np.linspace(0, steps - 1, min(steps, MAX_FRAMES)).round().astype(int)):
        pictures = []
        for sensor, reading in last.readings.items():
            if sensor in images:
                with Image.open(images[sensor][step]) as image:
                    pictures.append(image.convert("RGB"))
                continue
            device: Any = reading.sensor
            brightest = max(1.0, max(float(values.max()) for values in counts[sensor]))
            tactile = device.phi(counts[sensor][step].astype(np.float32))
            layout, scale = device.layout, device.spec.tactile_image.px_per_mm
            places = layout.x_mm, layout.y_mm
            colored = draw.colored_tactile_image(tactile, *places, brightest, px_per_mm=scale)
            pictures.append(colored)
        page = draw.in_a_row(pictures, HEIGHT_PX)
        pages.append(page.quantize(palette=page.quantize()))  # the second pass dithers
    first, *others = pages
    each = {"save_all": True, "append_images": others, "duration": FRAME_MS, "loop": 0}
    first.save(folder / "slide.gif", **each)
    if find_spec("imageio_ffmpeg"):
        writer = importlib.import_module("imageio_ffmpeg").write_frames(
            str(folder / "slide.mp4"), first.size, fps=1000 / FRAME_MS, macro_block_size=2
        )
        writer.send(None)
        for page in pages:
            writer.send(np.ascontiguousarray(page.convert("RGB")))
        writer.close()


def _draw_slide(page: Figure, rows: list[Row], shown: dict[int, Touch]) -> None:
    """The tangential force of each sensor, and below it its reading and contact in some steps.

    rows: of slide.csv. shown: touches with contact by step.
    """
    from matplotlib.patches import Patch

    *_, last = shown.values()
    sensors = list(last.contacts)
    kinds = [f"{kind} of {sensor}" for sensor in sensors for kind in ("reading", "contact")]
    mosaic: Any = [[f"force of {sensor}" for sensor in sensors for _ in range(2)]]
    mosaic += [[f"{kind}, {step}" for kind in kinds] for step in shown]
    heights = [FORCE_HEIGHT, *[PANEL_HEIGHT] * len(shown)]
    panels = page.subplot_mosaic(mosaic, height_ratios=heights)
    for sensor in sensors:
        _draw_force(panels[f"force of {sensor}"], rows, sensor, last.contacts[sensor])
        images = [getattr(touch[sensor], "tactile_image", np.ones(1)) for touch in shown.values()]
        largest = max(1.0, *(float(image.max()) for image in images))
        for step, touch in shown.items():
            _draw_reading(page, panels[f"reading of {sensor}, {step}"], touch[sensor], largest)
            axes, contact = panels[f"contact of {sensor}, {step}"], touch.contacts[sensor]
            peak_kpa = draw.draw_contact(axes, contact)
            slips = f"step {step}: slip share {100 * contact.slip_share:.0f} %"
            axes.set_title(f"{slips}\narrows: at most {peak_kpa:.3g} kPa", loc="left")
            axes.set(xlabel="x, mm", ylabel="y (down), mm")
    colors = {"stick": draw.STICK_RGB, "slip": draw.SLIP_RGB}
    handles = [Patch(color=tuple(np.divide(rgb, 255)), label=name) for name, rgb in colors.items()]
    page.legend(handles=handles, loc="outside lower center", ncols=2)


def _draw_force(axes: Axes, rows: list[Row], sensor: str, contact: Contact) -> None:
    """Tangential force over the path's length, or the rotation, and torque if the shape turns."""

    def column(name: str) -> np.ndarray:
        return np.array([row.get(name, np.nan) for row in rows], float)

    moved_mm = np.hypot(np.diff(column("x_mm")), np.diff(column("y_mm")))
    turned_deg = np.abs(np.diff(column("yaw_deg")))
    label, travel = "step", column("step")
    if moved_mm.any():
        label, travel = "displacement of the shape, mm", np.cumsum([0.0, *moved_mm])
    elif turned_deg.any():
        label, travel = "rotation of the shape, degrees", np.cumsum([0.0, *turned_deg])
    force_n = np.hypot(column(f"{sensor}_shear_x_n"), column(f"{sensor}_shear_y_n"))
    lines = axes.plot(travel, force_n, ".-", color=draw.PALETTE[0], label="tangential force")
    if contact.motion is not None:
        limit_n = contact.motion.friction[0].limit_n(column("force_n"))
        limit_n = np.where(np.isnan(force_n), np.nan, limit_n)
        look: Any = {"color": LIMIT_COLOR, "label": "limit of friction", "linewidth": 1}
        lines += axes.plot(travel, limit_n, "--", **look)
    axes.set_title(f"elastomer of {sensor}", loc="left", pad=LEGEND_PT)
    axes.set(xlabel=label, ylabel="tangential force, N", ylim=(0, None))
    if turned_deg.any():
        other = axes.twinx()
        other.spines["right"].set_visible(True)
        torque_nmm = column(f"{sensor}_torque_nmm")
        lines += other.plot(travel, torque_nmm, ".-", color=draw.PALETTE[1], label="torque")
        other.set_ylabel("torque, N mm")
    axes.legend(handles=lines, loc="lower left", bbox_to_anchor=(0, 1), ncols=3)


def _draw_reading(page: Figure, axes: Axes, reading: Any, largest: float) -> None:
    """The image of a gel camera, with arrows from the markers at rest to the displaced ones, or the
    tactile image of a taxel array. largest: count at the end of the color scale."""
    device = reading.sensor
    if getattr(reading, "image", None) is None:
        image, limits = reading.tactile_image, (0.0, largest)
        drawn = draw.draw_tactile_image(axes, image, device.phi, device.layout, limits)
        axes.set_title(f"tactile image of {device.name}", loc="left")
        draw.color_bar(page, drawn, axes, 0.07, "counts")
        return
    axes.imshow(reading.image)
    axes.set(xticks=[], yticks=[])
    axes.set_title(f"image of {device.name}", loc="left")
    if device.markers is not None:
        axes.set_title(f"image of {device.name}\narrows: marker displacement", loc="left")
        rest, moved = device.markers.seen_px(device.optics.camera, reading.contact)
        kept = np.hypot(*(moved - rest).T) >= MIN_ARROW_PX
        (y, x), (by_y, by_x) = rest[kept].T, (moved - rest)[kept].T
        look: Any = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.01}
        axes.quiver(x, y, by_x, by_y, color="white", **look)
        rows, columns, _ = reading.image.shape
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
