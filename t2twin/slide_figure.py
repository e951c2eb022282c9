"""The figure of a slide: tangential force over displacement, and what both sensors show."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from t2twin.report.figures import COUNTS_MAP
from t2twin.sim.contact.types import Contact
from t2twin.sim.optical.gel_camera import ImageReading
from t2twin.sim.taxels.taxel_array import CountsReading
from t2twin.sim.touch import Touch

FORCE_COLOR, TORQUE_COLOR, LIMIT_COLOR = "#1f5fa8", "#b8561b", "#888888"
STICK_COLOR, SLIP_COLOR = "#9ec5e8", "#f2b880"
MARKER_COLOR = "white"

MARGIN_MM = 1.0
"""Margin around the contact, mm."""

LEGEND_PT = 20
"""Height of the legend between a panel and its title, points."""

KEY_SHARE = 0.1
"""Height below the contact for the key of the arrows, as a share of the panel (assumed)."""

ARROWS = 10
"""Arrows along the longer side of the contact, about."""

MIN_ARROW_PX = 3.0
"""Shortest displacement of a marker that has an arrow, px."""

SHOWN = 3
"""Steps that the figure shows: the first, the middle and the last one."""

PANEL_WIDTH, PANEL_HEIGHT, FORCE_HEIGHT = 2.5, 2.6, 2.4
"""Sizes of a panel of a step and of the panels of the force, inches."""


def page_size(shown: Sequence[Touch]) -> tuple[float, float]:
    """Width and height of the figure, inches."""
    width = 2 * PANEL_WIDTH * len(shown[-1].contacts)
    return width, FORCE_HEIGHT + PANEL_HEIGHT * len(shown)


def draw_slide(
    page: Figure, rows: list[dict[str, Any]], steps: Sequence[int], shown: Sequence[Touch]
) -> None:
    """Draw the tangential force of each sensor, and below it a row of panels for each shown step.

    rows: of slide.csv, see t2twin.slide_files. steps, shown: touches with contact, and their
    numbers.
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
        _draw_contacts(contacts, [touch.contacts[sensor] for touch in shown])
        title = f"elastomer of {sensor}\n{contacts[0].get_title('left')}"
        contacts[0].set_title(title, loc="left")
        readings = [touch[sensor] for touch in shown]
        draw: Any = _draw_images if hasattr(readings[0], "image") else _draw_counts
        draw(sensor, images, readings)
    for axes, step in zip(columns[0], steps, strict=True):
        axes.set_ylabel(f"step {step}\n{axes.get_ylabel()}".strip())
    bottom.legend(
        handles=[Patch(color=STICK_COLOR, label="stick"), Patch(color=SLIP_COLOR, label="slip")],
        loc="outside lower center",
        ncols=2,
    )


def _draw_force(axes: Axes, rows: list[dict[str, Any]], sensor: str, contact: Contact) -> None:
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
    lines = axes.plot(travel, force_n, ".-", color=FORCE_COLOR, label="tangential force")
    if contact.motion is not None:
        limit_n = np.where(np.isnan(force_n), np.nan, contact.motion.friction * column("force_n"))
        lines += axes.plot(
            travel, limit_n, "--", color=LIMIT_COLOR, label="limit of friction", linewidth=1
        )
    axes.set_ylabel("tangential force, N")
    axes.set_ylim(bottom=0)
    if turned_deg[slides].any():
        other = axes.twinx()
        other.spines["right"].set_visible(True)
        torque_nmm = column(f"{sensor}_torque_nmm")
        lines += other.plot(travel, torque_nmm, ".-", color=TORQUE_COLOR, label="torque")
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
            angles="xy", scale_units="xy", scale=1, width=0.01, color=MARKER_COLOR,
        )  # fmt: skip
        rows, columns, _ = reading.image.shape
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))


def _draw_counts(sensor: str, panels: Sequence[Axes], readings: Sequence[CountsReading]) -> None:
    """The tactile images of a taxel array on one scale, with a circle on each taxel."""
    largest = max(float(reading.tactile_image.max()) for reading in readings)
    for axes, reading in zip(panels, readings, strict=True):
        scale = reading.sensor.spec.tactile_image.px_per_mm
        rows, columns = (size / scale / 2 for size in reading.tactile_image.shape)
        image = axes.imshow(
            reading.tactile_image, cmap=COUNTS_MAP, vmin=0, vmax=max(largest, 1.0),
            extent=(-columns, columns, rows, -rows),
        )  # fmt: skip
        layout = reading.sensor.layout
        axes.plot(layout.x_mm, layout.y_mm, "o", ms=4, mfc="none", mec="white", mew=0.5)
        axes.set(xticks=[], yticks=[])
        axes.figure.colorbar(image, ax=axes, fraction=0.07, label="counts")
    panels[0].set_title(f"tactile image of {sensor}", loc="left")


def _draw_contacts(panels: Sequence[Axes], contacts: Sequence[Contact]) -> None:
    """Stick and slip regions, and the tangential traction on the sensor as arrows of one scale."""
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
        axes.set_title(f"{100 * contact.slip_share:.0f} % of the contact slips", loc="left")
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
