"""Charts as SVG: intervals of the predicted counts, the tangential force of a slide, and maps of
its traction."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from html import escape

import numpy as np
from PIL import Image

from t2twin.sim.contact.types import Contact
from t2twin.studio.colors import data_url
from t2twin.studio.session import SlidePoint
from t2twin.studio.translators import LEVEL, Translation

NICE = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Leading digits of the upper end of a color bar or a chart."""

WIDTH, HEIGHT, LEFT = 400.0, 130.0, 44.0
"""Size of a chart and width of the margin for its labels, in units of the SVG."""

ORANGE, BLUE = "#d9480f", "#2f80d0"
"""Distinct in both themes and for color-blind readers."""

TRUE_COLOR, PREDICTED_COLOR = ORANGE, BLUE

PERCENT = f"{100 * LEVEL:.0f} %"
"""Nominal coverage of the intervals."""

SENSOR_COLORS = BLUE, ORANGE
"""Colors of the source and of the target in charts."""

MAX_DRAWN = 300
"""Maximum number of points of a drawn line (assumed: about one per pixel)."""

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


def nice_end(maximum: float, minimum_end: float) -> float:
    """The smallest number with leading digits of NICE that is not below either argument."""
    end = max(float(maximum), minimum_end)
    decade = 10.0 ** np.floor(np.log10(end))
    return float(next(n * decade for n in NICE if n * decade >= end * (1 - 1e-9)))


def intervals_html(translation: Translation) -> str:
    """Chart of the intervals of the counts; empty for a run without intervals."""
    if translation.interval is None:
        return ""
    high = [float(translation.interval[1].max()), 1.0]
    if translation.truth is not None:
        high.append(float(translation.truth.max()))
    end = nice_end(max(high), 1.0)
    taxels = "".join(_taxel(translation, n, end) for n in range(translation.counts.size))
    caption = f"Counts by taxel: {key(PREDICTED_COLOR, f'predicted with {PERCENT} interval')}"
    if translation.covered is not None:
        caption += (
            f" {key(TRUE_COLOR, 'true')}. "
            f"The intervals cover {translation.covered} of {translation.counts.size} taxels."
        )
    return _chart("intervals", _grid(end, ",.0f") + taxels, caption)


def slide_html(points: Sequence[SlidePoint]) -> str:
    """Chart of the tangential force over the displacement, or of the torque of a pure rotation.

    Empty for a contact that has not moved.
    """
    shown = np.unique(np.linspace(0, len(points) - 1, MAX_DRAWN).astype(int))
    x_mm, y_mm, yaw_deg, _ = np.transpose([astuple(point.row) for point in points])
    travel = np.cumsum([0.0, *np.hypot(np.diff(x_mm), np.diff(y_mm))])
    turned = np.cumsum([0.0, *np.abs(np.diff(yaw_deg))])
    if travel[-1] > 0:
        quantity, text = "force_n", f"Tangential force, N, over a path of {travel[-1]:.3g} mm"
    elif turned[-1] > 0:
        travel, quantity = turned, "torque_nmm"
        text = f"Torque, N mm, over a rotation of {turned[-1]:.3g}°"
    else:
        return ""
    colors = dict(zip(points[0].force_n, SENSOR_COLORS, strict=True))
    lines = [
        ([abs(getattr(points[n], quantity)[sensor]) for n in shown], f'stroke="{color}"')
        for sensor, color in colors.items()
    ]
    if quantity == "force_n":
        lines += [
            ([points[max(n, 1)].limit_n[sensor] for n in shown],
             f'stroke="{color}" stroke-dasharray="4 4" opacity="0.7"')
            for sensor, color in colors.items()
        ]  # fmt: skip
    end = nice_end(max(max(values) for values, _ in lines), 1e-6)
    across = LEFT + (WIDTH - LEFT) * travel[shown] / travel[-1]
    drawn = "".join(_line(across, values, end, style) for values, style in lines)
    keys = " ".join(key(color, name) for name, color in colors.items())
    dashes = ", dashed: limit of friction" if quantity == "force_n" else ""
    return _chart("slide", _grid(end, ".3g") + drawn, f"{text}: {keys}{dashes}")


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


def key(color: str, name: str) -> str:
    """A color of a legend with its name."""
    return f'<i class="key" style="background:{color}"></i> {escape(name)}'


def _chart(name: str, drawn: str, caption: str) -> str:
    """caption: HTML."""
    return (
        f'<figure data-name="{name}"><svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="{name}">{drawn}</svg><figcaption>{caption}</figcaption></figure>'
    )


def _y(value: float, end: float) -> float:
    return HEIGHT - 6.0 - (HEIGHT - 16.0) * value / end


def _grid(end: float, style: str) -> str:
    lines = ""
    for value in (0.0, end / 2, end):
        y = _y(value, end)
        lines += (
            f'<line x1="{LEFT}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="currentColor" '
            f'opacity="0.2"/><text x="{LEFT - 5}" y="{y + 3.5:.1f}" text-anchor="end" '
            f'font-size="11" fill="currentColor" opacity="0.8">{value:{style}}</text>'
        )
    return lines


def _line(across: np.ndarray, values: Sequence[float], end: float, style: str) -> str:
    places = (f"{x:.1f},{_y(value, end):.1f}" for x, value in zip(across, values, strict=True))
    return f'<polyline points="{" ".join(places)}" fill="none" stroke-width="2" {style}/>'


def _taxel(translation: Translation, n: int, end: float) -> str:
    """One taxel: interval as a bar, prediction as a disc, true count as a line."""
    assert translation.interval is not None
    low, high = (float(bound[n]) for bound in translation.interval)
    count = float(translation.counts[n])
    pitch = (WIDTH - LEFT) / translation.counts.size
    x, half = LEFT + (n + 0.5) * pitch, min(0.3 * pitch, 6.0)
    top, bottom = _y(high, end), _y(low, end)
    text = f"taxel {n}: predicted {count:,.0f}, interval {low:,.0f} to {high:,.0f}"
    # Intervals have a minimum height, so that narrow ones are visible.
    drawn = (
        f'<rect x="{x - half:.1f}" width="{2 * half:.1f}" y="{top - 0.5:.1f}" '
        f'height="{bottom - top + 1:.1f}" fill="{PREDICTED_COLOR}" opacity="0.35"/>'
        f'<circle cx="{x:.1f}" cy="{_y(count, end):.1f}" r="{half / 2:.1f}" '
        f'fill="{PREDICTED_COLOR}"/>'
    )
    if translation.truth is not None:
        true = float(translation.truth[n])
        text += f", true {true:,.0f}"
        drawn += (
            f'<line x1="{x - 1.4 * half:.1f}" x2="{x + 1.4 * half:.1f}" y1="{_y(true, end):.1f}" '
            f'y2="{_y(true, end):.1f}" stroke="{TRUE_COLOR}" stroke-width="2"/>'
        )
    return f"<g><title>{text}</title>{drawn}</g>"


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
