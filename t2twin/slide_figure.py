"""The figure of a slide: tangential force over displacement, and the last contact."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from t2twin.sim.contact.types import Contact
from t2twin.sim.touch import Touch

NAMES = {"digit": "DIGIT's gel", "cyskin": "CySkin's cover"}

FORCE_COLOR, TORQUE_COLOR, LIMIT_COLOR = "#1f5fa8", "#b8561b", "#888888"
STICK_COLOR, SLIP_COLOR = "#9ec5e8", "#f2b880"

MARGIN_MM = 1.0
"""Margin around the contact, mm."""

LEGEND_PT = 20
"""Height of the legend between a panel and its title, points."""

ARROWS = 10
"""Arrows along the longer side of the contact, about."""


def draw_slide(page: Figure, rows: list[dict[str, Any]], last: Touch) -> None:
    """Draw both panels of each sensor that the last touch contacts.

    rows: of slide.csv, see t2twin.slide_files. last: the last touch with contact.
    """
    page.set_layout_engine("constrained", wspace=0.06, hspace=0.06)
    panels = page.subplots(len(last.contacts), 2, squeeze=False)
    for (left, right), (sensor, contact) in zip(panels, last.contacts.items(), strict=True):
        left.set_title(NAMES[sensor], loc="left", pad=LEGEND_PT)
        _draw_force(left, rows, sensor, contact)
        step = max(row["step"] for row in rows if f"{sensor}_slip_share" in row)
        right.set_title(
            f"step {step}: {100 * contact.slip_share:.0f} % of the contact slips", loc="left"
        )
        _draw_contact(right, contact)


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


def _draw_contact(axes: Axes, contact: Contact) -> None:
    """Stick and slip regions, and the tangential traction on the sensor as arrows."""
    x_mm, y_mm, inside = contact.x_mm, contact.y_mm, contact.pressure_kpa > 0
    half = contact.pitch_mm / 2
    axes.imshow(
        np.where(inside, 1.0 + contact.slipping, np.nan),
        cmap=ListedColormap([STICK_COLOR, SLIP_COLOR]),
        vmin=1,
        vmax=2,
        extent=(x_mm[0] - half, x_mm[-1] + half, y_mm[-1] + half, y_mm[0] - half),
    )
    columns, rows = np.flatnonzero(inside.any(axis=0)), np.flatnonzero(inside.any(axis=1))
    left, right = x_mm[columns[0]] - MARGIN_MM, x_mm[columns[-1]] + MARGIN_MM
    top, bottom = y_mm[rows[0]] - MARGIN_MM, y_mm[rows[-1]] + MARGIN_MM
    axes.set(xlim=(left, right), ylim=(bottom, top), xlabel="x, mm", ylabel="y (down), mm")
    axes.legend(
        handles=[Patch(color=STICK_COLOR, label="stick"), Patch(color=SLIP_COLOR, label="slip")],
        loc="upper left",
        bbox_to_anchor=(1, 1),
    )
    shear = contact.shear_kpa
    peak = float(np.hypot(*shear).max())
    if peak == 0:
        return
    every = max(1, round(max(columns.size, rows.size) / ARROWS))
    rows_at, columns_at = np.nonzero(inside)
    kept = (rows_at % every == every // 2) & (columns_at % every == every // 2)
    at = rows_at[kept], columns_at[kept]
    arrows = axes.quiver(
        x_mm[at[1]], y_mm[at[0]], shear[0][at], shear[1][at],
        angles="xy", scale_units="xy", scale=peak / (1.1 * every * contact.pitch_mm), width=0.006,
    )  # fmt: skip
    label = f"{peak:.2g} kPa" if peak < 10 else f"{peak:.0f} kPa"
    axes.quiverkey(arrows, 1.14, 0.1, peak, label, labelpos="N")
