"""Charts as SVG: intervals of the predicted counts, and the tangential force of a slide."""

from collections.abc import Sequence
from dataclasses import astuple

import numpy as np

from t2twin.studio.slide import SlidePoint
from t2twin.studio.translators import LEVEL, Translation
from t2twin.studio.view.html import key

WIDTH, HEIGHT, LEFT = 400.0, 130.0, 44.0
"""Size of a chart and width of the margin for its labels, in units of the SVG."""

ORANGE, BLUE = "#d9480f", "#2f80d0"
"""Distinct in both themes and for color-blind readers."""

TRUE_COLOR, PREDICTED_COLOR = ORANGE, BLUE

PERCENT = f"{100 * LEVEL:.0f} %"
"""Nominal coverage of the intervals."""

SENSORS = {"digit": ("DIGIT", BLUE), "cyskin": ("CySkin", ORANGE)}
"""Displayed names of the sensors and their colors in charts."""

MAX_DRAWN = 300
"""Maximum number of points of a drawn line (assumed: about one per pixel)."""


def intervals_html(translation: Translation) -> str:
    """Chart of the intervals of the counts; empty for a run without intervals."""
    if translation.interval is None:
        return ""
    high = [float(translation.interval[1].max()), 1.0]
    if translation.truth is not None:
        high.append(float(translation.truth.max()))
    end = _end(max(high))
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
    lines = [
        ([abs(getattr(points[n], quantity)[sensor]) for n in shown], f'stroke="{color}"')
        for sensor, (_, color) in SENSORS.items()
    ]
    if quantity == "force_n":
        lines += [
            ([points[max(n, 1)].limit_n[sensor] for n in shown],
             f'stroke="{color}" stroke-dasharray="4 4" opacity="0.7"')
            for sensor, (_, color) in SENSORS.items()
        ]  # fmt: skip
    end = _end(max(max(values) for values, _ in lines))
    across = LEFT + (WIDTH - LEFT) * travel[shown] / travel[-1]
    drawn = "".join(_line(across, values, end, style) for values, style in lines)
    keys = " ".join(key(color, name) for name, color in SENSORS.values())
    dashes = ", dashed: limit of friction" if quantity == "force_n" else ""
    return _chart("slide", _grid(end, ".3g") + drawn, f"{text}: {keys}{dashes}")


def _chart(name: str, drawn: str, caption: str) -> str:
    """caption: HTML."""
    return (
        f'<figure data-name="{name}"><svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="{name}">{drawn}</svg><figcaption>{caption}</figcaption></figure>'
    )


def _end(high: float) -> float:
    """Upper end of a chart: the maximum, rounded up to two digits."""
    step = 10.0 ** (np.floor(np.log10(max(high, 1e-6))) - 1)
    return float(np.ceil(high / step) * step) or 1.0


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
