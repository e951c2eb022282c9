"""Tangential traction of a contact: arrows, and a map of the cells that stick and slip."""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from t2twin.sim.contact.types import Contact
from t2twin.studio.view.colors import data_url

STICK_RGB, SLIP_RGB = (158, 197, 232), (242, 150, 60)
"""Light blue and orange: of different hue and lightness, distinct for color-blind readers."""

ARROWS = 10
"""Number of arrows along the longer side of a contact, about."""

MARGIN_MM = 0.5
"""Margin of a map around the contact, mm."""

HEAD = 0.35
"""Length of an arrow's head relative to the arrow."""


@dataclass(frozen=True)
class Arrows:
    """Tangential traction at some cells of a contact.

    rows, columns: (n,) the cells. x_mm, y_mm: (n,) their centers. along_mm: (2, n) the arrows in x
    and y, as long as the cells' spacing at the largest traction. slips: (n,) bool. peak_kpa: the
    largest traction.
    """

    rows: np.ndarray
    columns: np.ndarray
    x_mm: np.ndarray
    y_mm: np.ndarray
    along_mm: np.ndarray
    slips: np.ndarray
    peak_kpa: float


def arrows_of(contact: Contact, number: int = ARROWS) -> Arrows:
    """About `number` arrows along the longer side of a contact."""
    shear, inside = contact.shear_kpa, contact.pressure_kpa > 0
    width, height = (np.ptp(np.flatnonzero(inside.any(axis=axis))) + 1 for axis in (0, 1))
    every = max(1, round(max(width, height) / number))
    rows, columns = np.nonzero(inside)
    kept = (rows % every == every // 2) & (columns % every == every // 2)
    rows, columns = rows[kept], columns[kept]
    peak_kpa = float(np.hypot(*shear).max())
    return Arrows(
        rows,
        columns,
        contact.x_mm[columns],
        contact.y_mm[rows],
        shear[:, rows, columns] * (every * contact.pitch_mm / max(peak_kpa, 1e-9)),
        contact.slipping[rows, columns],
        peak_kpa,
    )


def half_side_mm(contact: Contact) -> float:
    """Half of the side of a contact's map, mm."""
    inside = contact.pressure_kpa > 0
    x_mm, y_mm = contact.x_mm[inside.any(axis=0)], contact.y_mm[inside.any(axis=1)]
    return max(np.ptp(x_mm), np.ptp(y_mm)) / 2 + MARGIN_MM


def map_svg(contact: Contact, half_mm: float, name: str) -> str:
    """Map of a contact in mm: cells that stick or slip, with arrows. half_mm: half of its side."""
    x_mm, y_mm, pitch = contact.x_mm, contact.y_mm, contact.pitch_mm
    inside = contact.pressure_kpa > 0
    middle_x, middle_y = (
        (at[along].min() + at[along].max()) / 2
        for at, along in ((x_mm, inside.any(axis=0)), (y_mm, inside.any(axis=1)))
    )
    image = Image.fromarray(np.where(inside, 1 + contact.slipping, 0).astype(np.uint8))
    image.putpalette((0, 0, 0, *STICK_RGB, *SLIP_RGB))
    arrows = arrows_of(contact)
    paths = "".join(
        _arrow(x, y, dx, dy)
        for x, y, dx, dy in zip(arrows.x_mm, arrows.y_mm, *arrows.along_mm, strict=True)
    )
    return (
        f'<svg data-name="{name}" role="img" aria-label="Tangential traction" viewBox="'
        f'{middle_x - half_mm:.2f} {middle_y - half_mm:.2f} {2 * half_mm:.2f} {2 * half_mm:.2f}">'
        f'<image x="{x_mm[0] - pitch / 2:.3f}" y="{y_mm[0] - pitch / 2:.3f}" '
        f'width="{x_mm.size * pitch:.3f}" height="{y_mm.size * pitch:.3f}" '
        f'preserveAspectRatio="none" style="image-rendering:pixelated" '
        f'href="{data_url(image, transparency=0)}"/>'
        f'<path d="{paths}" fill="none" stroke="#202020" stroke-width="{half_mm / 70:.3f}"/></svg>'
    )


def _arrow(x: float, y: float, dx: float, dy: float) -> str:
    """Path of an arrow, centered on its cell."""
    tip_x, tip_y = x + dx / 2, y + dy / 2
    back_x, back_y = tip_x - HEAD * dx, tip_y - HEAD * dy
    side_x, side_y = HEAD / 2 * dy, -HEAD / 2 * dx
    points = (
        ("M", x - dx / 2, y - dy / 2), ("L", tip_x, tip_y), ("M", back_x + side_x, back_y + side_y),
        ("L", tip_x, tip_y), ("L", back_x - side_x, back_y - side_y),
    )  # fmt: skip
    return "".join(f"{kind}{a:.3f} {b:.3f}" for kind, a, b in points)
