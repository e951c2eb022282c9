"""The cards next to the scene: images with their errors, color bars, tables and charts, as HTML.

The markup is in cards.html, which escapes all texts.
"""

import io
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image, ImageDraw

from t2twin.core.draw import (
    COLOR_MAP,
    DIFFERENCE_MAP,
    PALETTE,
    color_table,
    draw_contact,
    figure,
    in_colors,
    relief,
)
from t2twin.core.errors import T2TwinError
from t2twin.core.templates import data_uri, render
from t2twin.sim.touch import Touch
from t2twin.studio.session import PressResult
from t2twin.studio.translators import LEVEL, Translation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MIN_SHARE, MIN_COUNTS, MIN_KPA = 0.0025, 100.0, 1.0
"""Minimum upper ends of the color scales, so that noise has no strong colors: share of full scale,
counts where it is unknown, and kPa."""

NICE = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Leading digits of the upper end of a color bar or a chart."""

PREDICTED, TRUE, GREY = PALETTE[0], PALETTE[1], "#808080"
"""Colors of charts, distinct in both themes and for color-blind readers."""

CHART_PX, LEFT_PX = (800, 260), 88
"""Size of a chart of intervals, twice as displayed, and width of the margin for its labels."""

LOADING = "The translators are being loaded."
NO_RUNS = "There is no trained run; `t2twin demo` trains two in minutes."
SLID = "The networks are trained on presses without friction."


def nice_end(maximum: float, minimum_end: float) -> float:
    """The smallest number with leading digits of NICE that is not below either argument."""
    end = max(float(maximum), minimum_end)
    decade = 10.0 ** np.floor(np.log10(end))
    return float(next(n * decade for n in NICE if n * decade >= end * (1 - 1e-9)))


def scales_of(result: PressResult) -> tuple[dict[str, float], dict[str, float]]:
    """Upper ends of the color scales by sensor: of pressures, kPa, and of the counts of arrays.

    The first array has the scale of the predictions, which are compared with it.
    """
    touch, counts = result.touch, {}
    predicted = [float(each.counts.max()) for each in result.translations]
    reading: Any
    for name, reading in touch.readings.items():
        if (values := getattr(reading, "counts", None)) is not None:
            others = [] if counts else predicted
            least = MIN_SHARE * reading.sensor.full_scale
            counts[name] = nice_end(max(values.max(), *others, 0.0), least)
    kpa = {
        name: nice_end(each.pressure_kpa.max(), MIN_KPA) for name, each in touch.contacts.items()
    }
    return kpa, counts


def card_html(**values: Any) -> str:
    """A card. values: of the template, which shows only what is given."""
    return render(
        "studio/cards.html",
        colors=_stops(COLOR_MAP),
        difference_colors=_stops(DIFFERENCE_MAP),
        percent=f"{100 * LEVEL:.0f} %",
        **values,
    )


def press_html(
    result: PressResult, kpa: dict[str, float], counts: dict[str, float], missing: str = ""
) -> str:
    """All cards of a press. kpa, counts: see `scales_of`. missing: in place of translations."""
    touch, found = result.touch, result.translations
    predicted = [float(each.counts.max()) for each in found]
    high = next(iter(counts.values()), nice_end(max(predicted, default=0.0), MIN_COUNTS))
    texts = [missing] if missing and not found else []
    slide, behind = "", []
    if any(result.remaining):  # the figure takes as long as a step
        distance_mm, rotation_deg = result.remaining
        behind = [f"The slide is behind: {distance_mm:.1f} mm and {rotation_deg:.0f}° remain."]
    elif result.has_slid:
        slide = data_uri(figure("png", 4.2, 4.4, lambda page: _draw_slide(page, result)))
    return card_html(
        texts=[*texts, *([SLID] if found and result.has_slid else [])],
        images=[_reading(name, each, counts) for name, each in touch.readings.items()],
        bars=[
            *((f"pressure on {name}", end, " kPa") for name, end in kpa.items()),
            *((f"taxels of {name}", end, " counts") for name, end in counts.items()),
        ],
        slide=slide,
        behind=behind,
        translations=[(each, _pictures(each, high, touch)) for each in found],
        touch=touch,
        peaks_kpa=[each.pressure_kpa.max() for each in touch.contacts.values()],
        tangential=list(result.tangential[-1].values()) if result.state.motion == "slide" else [],
    )


def frame_html(
    frame: tuple[np.ndarray, str],
    background: tuple[np.ndarray, str] | None,
    translations: Sequence[Translation],
) -> str:
    """A frame without known true counts and its name, with the prediction of each run.

    background: background frame of the field runs and its name.
    """
    high = nice_end(max((t.counts.max() for t in translations), default=0.0), MIN_COUNTS)
    images = [("Frame", frame[1], _url(Image.fromarray(frame[0])), "frame")]
    if background is not None:
        url = _url(Image.fromarray(background[0]))
        images.append(("Background", background[1], url, "background"))
    return card_html(
        texts=[] if translations else ["No translator is selected."],
        images=images,
        bars=[("tactile images", high, " counts")] if translations else [],
        translations=[(each, _pictures(each, high, None)) for each in translations],
    )


def _reading(name: str, reading: Any, counts: dict[str, float]) -> tuple[str, str, str, str]:
    """The image of a gel camera, or the tactile image of a taxel array."""
    if (image := getattr(reading, "image", None)) is not None:
        return name, "camera image, from below", _url(Image.fromarray(image)), name
    try:
        pixels = in_colors(reading.tactile_image / counts[name])
    except T2TwinError as error:  # a layout without a tactile image
        return name, str(error), "", name
    note = f"tactile image, {reading.sensor.layout.size} taxels"
    return name, note, _url(Image.fromarray(pixels)), name


def _pictures(translation: Translation, high: float, touch: Touch | None) -> dict[str, Any]:
    """Pictures of a prediction. high: of the color scale. touch: with the full scale."""
    counts = _url(Image.fromarray(in_colors(translation.tactile_image / high)))
    pictures: dict[str, Any] = {"counts": counts, "difference": ""}
    if touch is not None and translation.truth is not None:
        residuals = translation.counts - translation.truth
        least = MIN_SHARE * touch.of_array.sensor.full_scale
        pictures["end"] = nice_end(np.abs(residuals).max(), least)
        pictures["difference"] = _discs(translation, residuals, pictures["end"])
    if (contact := translation.contact) is not None:
        pictures["contact"] = _url(relief(contact.depth_mm, contact.mask, contact.view_mm))
    if translation.interval is not None:
        pictures["intervals"] = _intervals(translation)
    return pictures


def _discs(translation: Translation, residuals: np.ndarray, end: float) -> str:
    """Differences of the taxels as discs at their positions, in the size of a tactile image."""
    (rows, columns), px_per_mm = translation.tactile_image.shape, translation.px_per_mm
    colors = in_colors(0.5 + np.append(residuals, 0.0) / (2 * end), DIFFERENCE_MAP)
    picture = Image.new("RGB", (columns, rows), tuple(colors[-1].tolist()))
    pen, layout = ImageDraw.Draw(picture), translation.layout
    for x_mm, y_mm, pad_mm, rgb in zip(
        layout.x_mm, layout.y_mm, layout.pad_diameter_mm, colors.tolist(), strict=False
    ):
        center = (columns / 2 + px_per_mm * x_mm, rows / 2 + px_per_mm * y_mm)
        pen.circle(center, px_per_mm * pad_mm / 2, fill=tuple(rgb))
    return _url(picture)


def _intervals(translation: Translation) -> str:
    """Chart of the taxels: interval as a bar, prediction as a disc, true count as a line."""
    assert translation.interval is not None
    low, high = translation.interval
    counts, truth = translation.counts, translation.truth
    end = nice_end(max(high.max(), 0.0 if truth is None else truth.max()), 1.0)
    picture = Image.new("RGBA", CHART_PX)
    pen, (width, height) = ImageDraw.Draw(picture), CHART_PX

    def y_px(value: float) -> float:
        return height - 12 - (height - 32) * value / end

    for value in (0.0, end / 2, end):
        pen.line((LEFT_PX, y_px(value), width, y_px(value)), GREY)
        place = (LEFT_PX - 10, y_px(value))
        pen.text(place, f"{value:,.0f}", GREY, anchor="rm", font_size=22)
    pitch = (width - LEFT_PX) / counts.size
    for n, count in enumerate(counts):
        x, half = LEFT_PX + (n + 0.5) * pitch, min(0.3 * pitch, 12.0)
        # Intervals have a minimum height, so that narrow ones are visible.
        pen.rectangle((x - half, y_px(high[n]) - 1, x + half, y_px(low[n]) + 1), PREDICTED + "60")
        pen.circle((x, y_px(count)), half / 2, PREDICTED)
        if truth is not None:
            pen.line((x - 1.4 * half, y_px(truth[n]), x + 1.4 * half, y_px(truth[n])), TRUE, 4)
    return _url(picture)


def _draw_slide(page: "Figure", result: PressResult) -> None:
    """Maps of where the contacts stick and slip, and the tangential force over the path, or the
    torque of a pure rotation."""
    contacts = result.touch.contacts
    axes = page.subplot_mosaic([[*contacts], ["path"] * len(contacts)], height_ratios=(1.2, 1))
    for name, contact in contacts.items():
        peak_kpa = draw_contact(axes[name], contact)
        axes[name].set_title(f"{name}: at most {peak_kpa:.3g} kPa\nstick blue, slip orange")
    rows = np.array([(row.x_mm, row.y_mm, row.yaw_deg) for row in result.rows])
    steps = np.abs(np.diff(rows, axis=0, prepend=rows[:1]))
    travel = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
    turns = travel[-1] == 0
    path = np.cumsum(steps[:, 2]) if turns else travel
    for name, color in zip(contacts, PALETTE, strict=False):
        force_n, torque_nmm, limit_n = np.transpose([each[name] for each in result.tangential])
        axes["path"].plot(path, np.abs(torque_nmm) if turns else force_n, color=color, label=name)
        if not turns:
            axes["path"].plot(path[1:], limit_n[1:], "--", color=color, alpha=0.7)
    words = ("torque, N mm", "rotation, °") if turns else ("tangential force, N", "path, mm")
    axes["path"].set(ylabel=words[0], xlabel=words[1], ylim=(0, None))
    axes["path"].legend(title=None if turns else "dashed: limit of friction")


def _url(picture: Image.Image) -> str:
    """Data URL of a picture as PNG, with little compression."""
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", compress_level=1)
    return data_uri(buffer.getvalue())


@cache
def _stops(name: str) -> list[str]:
    """Colors of a CSS gradient, from low to high values."""
    return [f"rgb{tuple(rgb)}" for rgb in color_table(name)[::51].tolist()]
