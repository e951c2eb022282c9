"""The cards next to the scene: images with their errors, color bars, tables and charts, as HTML.

All texts are escaped here. Text has the page's own color, for the light and the dark theme.
"""

import io
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image, ImageDraw

from t2twin.core.draw import (
    COLOR_MAP,
    COLORS,
    DIFFERENCE_MAP,
    color_table,
    extent_mm,
    figure,
    relief,
)
from t2twin.core.errors import T2TwinError
from t2twin.core.templates import data_uri
from t2twin.sim.touch import Touch
from t2twin.studio.scene import SLIP_RGB, STICK_RGB, color_values, traction_arrows
from t2twin.studio.session import PressResult
from t2twin.studio.translators import LEVEL, Translation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STYLE = """<style>
.t2 { font-size: 0.8rem; line-height: 1.4; padding: 0.5rem 1.1rem 0.3rem 0.7rem; }
.t2 h4 { margin: 0.9rem 0 0.3rem; font-size: 0.85rem; font-weight: 600; }
.t2 .row { display: grid; grid-template-columns: 1fr 1fr 1fr; gap: 0.7rem;
  margin-bottom: 0.7rem; }
.t2 .row > * { margin: 0; min-width: 0; overflow-wrap: anywhere; }
.t2 .wide { grid-column: span 2; }
.t2 b { display: block; font-weight: 600; }
.t2 img { display: block; width: 100%; border-radius: 3px; }
.t2 .soft { opacity: 0.75; }
.t2 .bar i { display: block; height: 0.55rem; border-radius: 2px; margin: 0.15rem 0; }
.t2 .ends { display: flex; justify-content: space-between; }
.t2 table { width: 100%; border-collapse: collapse; font-variant-numeric: tabular-nums; }
.t2 th { font-weight: 400; text-align: left; opacity: 0.75; }
.t2 td, .t2 thead th { text-align: right; }
.t2 tbody tr { border-top: 1px solid rgba(128, 128, 128, 0.25); }
.t2 figure { margin: 0.4rem 0 0.9rem; }
.t2 p { margin: 0.3rem 0; }
.t2 code { font-size: 0.75rem; overflow-wrap: anywhere; }
</style>"""

MIN_SHARE, MIN_COUNTS, MIN_KPA = 0.0025, 100.0, 1.0
"""Minimum upper ends of the color scales, so that noise has no strong colors: share of full scale,
counts where it is unknown, and kPa."""

NICE = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Leading digits of the upper end of a color bar or a chart."""

PREDICTED, TRUE, GREY = COLORS[0], COLORS[1], "#808080"
"""Colors of charts, distinct in both themes and for color-blind readers."""

CHART_PX, LEFT_PX = (800, 260), 88
"""Size of a chart of intervals, twice as displayed, and width of the margin for its labels."""

MAP_MARGIN_MM, ARROWS = 0.5, 10
"""Margin of a map around the contact, and number of arrows along its longer side."""

PERCENT = f"{100 * LEVEL:.0f} %"
MODELS = {"resnet18": "ResNet18"}  # displayed names that differ
LOADING = "The translators are being loaded."
NO_RUNS = "There is no trained run; `t2twin demo` trains two in minutes."
BACKGROUND_USED = "Uses the background frame."


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


def note_html(text: str) -> str:
    """A text on its own, with the style of all cards."""
    return STYLE + _page([_paragraph(text)])


def command_html(line: str) -> str:
    """The command line of a press."""
    return _page([_heading("Command line"), f"<p><code>{escape(line)}</code></p>"])


def press_html(
    result: PressResult, kpa: dict[str, float], counts: dict[str, float], missing: str = ""
) -> str:
    """All cards of a press. kpa, counts: see `scales_of`. missing: in place of translations."""
    touch = result.touch
    bars = [
        *(_bar(f"pressure on {name}", "0", f"{end:,g} kPa") for name, end in kpa.items()),
        *(_bar(f"taxels of {name}", "0", f"{end:,.0f} counts") for name, end in counts.items()),
    ]
    readings = [_reading(name, each, counts) for name, each in touch.readings.items()]
    parts = [_row(*readings, f"<div><b>Colors</b>{''.join(bars)}</div>"), _slide(result)]
    if result.translations:
        parts.append(_heading(f"Counts predicted from the image of {touch.of_camera.sensor.name}"))
        if result.has_slid:
            parts.append(_paragraph("The networks are trained on presses without friction."))
        predicted = [float(each.counts.max()) for each in result.translations]
        high = next(iter(counts.values()), nice_end(max(predicted), MIN_COUNTS))
        parts += [_translation(each, high, touch) for each in result.translations]
    elif missing:
        parts += [_heading("Translation"), _paragraph(missing)]
    parts += [_contacts(result), *map(_paragraph, [*touch.shape.notes, *touch.notes])]
    for name, each in touch.readings.items():
        if (values := getattr(each, "counts", None)) is not None:
            listed = f'<p><code class="counts">{_listed(values)}</code></p>'
            parts += [_heading(f"True counts of {name} by taxel"), listed]
    return _page(parts)


def frame_html(
    frame: tuple[np.ndarray, str],
    background: tuple[np.ndarray, str] | None,
    translations: Sequence[Translation],
) -> str:
    """A frame without known true counts and its name, with the prediction of each run.

    background: background frame of the field runs and its name.
    """
    high = nice_end(max((t.counts.max() for t in translations), default=0.0), MIN_COUNTS)
    cells = [_figure("Frame", frame[1], frame[0], "frame")]
    if background is not None:
        cells.append(_figure("Background", background[1], background[0], "background"))
    if not translations:
        return _page([_row(*cells), _paragraph("No translator is selected.")])
    parts = [_row(*cells, f"<div>{_bar('tactile images', '0', f'{high:,.0f} counts')}</div>")]
    for each in translations:
        notes = _unreliable(each) + (_paragraph(BACKGROUND_USED) if each.background_used else "")
        listed = f"<p><b>counts</b><code>{_listed(each.counts)}</code></p>"
        parts.append(_row(_predicted(each, high), f'<div class="wide">{notes}{listed}</div>'))
        parts.append(_beyond_counts(each, None))
    return _page(parts)


def _reading(name: str, reading: Any, counts: dict[str, float]) -> str:
    """The image of a gel camera, or the tactile image of a taxel array."""
    if (image := getattr(reading, "image", None)) is not None:
        return _figure(name, "camera image, from below", image, name)
    try:
        pixels = color_values(reading.tactile_image, counts[name])
    except T2TwinError as error:  # a layout without a tactile image
        return f"<figure><b>{escape(name)}</b>{_paragraph(str(error))}</figure>"
    return _figure(name, f"tactile image, {reading.sensor.layout.size} taxels", pixels, name)


def _translation(translation: Translation, high: float, touch: Touch) -> str:
    """Predicted tactile image of a run, differences from the true counts, error and intervals."""
    right = f'<div class="wide">{_unreliable(translation)}</div>'
    if translation.truth is not None:
        residuals, full_scale = (
            translation.counts - translation.truth,
            touch.of_array.sensor.full_scale,
        )
        end = nice_end(np.abs(residuals).max(), MIN_SHARE * full_scale)
        bar = _bar("counts", f"-{end:,.0f}", f"+{end:,.0f}", DIFFERENCE_MAP)
        rmse = translation.rmse_counts
        right = _figure(
            "Difference", "predicted − true", _discs(translation, residuals, end), "difference"
        )
        right += (
            f"<div>{bar}<p><b>RMSE {rmse:,.0f} counts</b><span class='soft'>"
            f"{100.0 * rmse / full_scale:.2f}&nbsp;% of full scale ({full_scale:,.0f})</span></p>"
            f"{_unreliable(translation)}</div>"
        )
    force_n = touch.command.force_n
    return _row(_predicted(translation, high), right) + _beyond_counts(translation, force_n)


def _predicted(translation: Translation, high: float) -> str:
    """Predicted tactile image, in colors from 0 to high."""
    model, name = translation.model, translation.name
    caption = "pretrained run" if name == model else name
    pixels = color_values(translation.tactile_image, high)
    return _figure(MODELS.get(model, model), caption, pixels, "translated")


def _unreliable(translation: Translation) -> str:
    """A warning of a frame out of distribution."""
    if translation.in_distribution:
        return ""
    return _paragraph("This image is unlike the training images; its counts are unreliable.")


def _beyond_counts(translation: Translation, true_n: float | None) -> str:
    """What only some runs predict: force, contact and intervals. true_n: None if unknown."""
    parts, contact = [], translation.contact
    if translation.force is not None:
        value, low, high = translation.force
        cells = ["force, N", f"{value:.1f}", f"{low:.1f} to {high:.1f}"]
        heads = ["predicted", f"{PERCENT} interval"]
        if true_n is not None:
            cells, heads = [*cells, f"{true_n:.2f}"], [*heads, "true"]
        parts.append(_table(heads, [cells], "force"))
    if contact is not None:
        picture = np.asarray(relief(contact.depth_mm, contact.mask, contact.view_mm))
        rows = [
            ["largest depth, mm", f"{contact.largest_depth_mm:.2f}"],
            ["contact area in view, mm²", f"{contact.area_mm2:.1f}"],
            ["force in view, N", f"{contact.force_in_view_n:.2f}"],
        ]
        notes = "".join(_paragraph(f"{note[0].upper()}{note[1:]}.") for note in contact.notes)
        table = _table(["predicted"], rows, "predicted-contact")
        right = f'<div class="wide">{table}{notes}</div>'
        parts.append(_row(_figure("Contact", "predicted depth", picture, "contact"), right))
    if translation.interval is not None:
        text = f"predicted counts by taxel with {PERCENT} intervals (blue)"
        if translation.covered is not None:
            text += (
                f" and true counts (orange); the intervals cover {translation.covered} of "
                f"{translation.counts.size} taxels"
            )
        parts.append(_figure("", text, _intervals(translation), "intervals"))
    return "".join(parts)


def _discs(translation: Translation, residuals: np.ndarray, end: float) -> Image.Image:
    """Differences of the taxels as discs at their positions, twice as large as a tactile image."""
    (rows, columns), scale = translation.tactile_image.shape, 2 * translation.px_per_mm
    colors = color_values(np.append(residuals, 0.0), end, DIFFERENCE_MAP)
    picture = Image.new("RGB", (2 * columns, 2 * rows), tuple(colors[-1].tolist()))
    pen, layout = ImageDraw.Draw(picture), translation.layout
    for x_mm, y_mm, pad_mm, rgb in zip(
        layout.x_mm, layout.y_mm, layout.pad_diameter_mm, colors.tolist(), strict=False
    ):
        center = (columns + scale * x_mm, rows + scale * y_mm)
        pen.circle(center, scale * pad_mm / 2, fill=tuple(rgb))
    return picture


def _intervals(translation: Translation) -> Image.Image:
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
    return picture


def _slide(result: PressResult) -> str:
    """Maps of the tangential traction and the chart of a slide; empty for a press."""
    if not result.has_slid:
        return ""
    parts, (distance_mm, rotation_deg) = [_heading("Tangential traction")], result.remaining
    if distance_mm or rotation_deg:
        text = f"The slide is behind: {distance_mm:.1f} mm and {rotation_deg:.0f}° remain."
        parts.append(_paragraph(text))
    else:  # a figure takes as long as a step
        content = figure("png", 4.2, 4.4, lambda page: _draw_slide(page, result))
        parts.append(f'<figure><img data-name="slide" src="{data_uri(content)}"></figure>')
    return "".join(parts)


def _draw_slide(page: "Figure", result: PressResult) -> None:
    """Maps of where the contacts stick and slip, and the tangential force over the path, or the
    torque of a pure rotation."""
    contacts = result.touch.contacts
    axes = page.subplot_mosaic([[*contacts], ["path"] * len(contacts)], height_ratios=(1.2, 1))
    for name, contact in contacts.items():
        inside = contact.pressure_kpa > 0
        colors = np.array([(0, 0, 0, 0), (*STICK_RGB, 255), (*SLIP_RGB, 255)], np.uint8)
        extent = extent_mm(contact.x_mm, contact.y_mm)
        axes[name].imshow(colors[np.where(inside, 1 + contact.slipping, 0)], extent=extent)
        places, along_mm, peak_kpa = traction_arrows(contact, ARROWS)
        at = contact.x_mm[places[1]], contact.y_mm[places[0]]
        axes[name].quiver(*at, *along_mm, angles="xy", scale_units="xy", scale=1.0, pivot="mid")
        x_mm, y_mm = contact.x_mm[inside.any(axis=0)], contact.y_mm[inside.any(axis=1)]
        half = max(np.ptp(x_mm), np.ptp(y_mm)) / 2 + MAP_MARGIN_MM
        x, y = (x_mm[0] + x_mm[-1]) / 2, (y_mm[0] + y_mm[-1]) / 2
        axes[name].set(xlim=(x - half, x + half), ylim=(y + half, y - half))
        axes[name].set_title(f"{name}: at most {peak_kpa:.3g} kPa\nstick blue, slip orange")
    rows = np.array([(row.x_mm, row.y_mm, row.yaw_deg) for row in result.rows])
    steps = np.abs(np.diff(rows, axis=0, prepend=rows[:1]))
    travel = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
    turns = travel[-1] == 0
    path = np.cumsum(steps[:, 2]) if turns else travel
    for name, color in zip(contacts, COLORS, strict=False):
        force_n, torque_nmm, limit_n = np.transpose([each[name] for each in result.tangential])
        axes["path"].plot(path, np.abs(torque_nmm) if turns else force_n, color=color, label=name)
        if not turns:
            axes["path"].plot(path[1:], limit_n[1:], "--", color=color, alpha=0.7)
    words = ("torque, N mm", "rotation, °") if turns else ("tangential force, N", "path, mm")
    axes["path"].set(ylabel=words[0], xlabel=words[1], ylim=(0, None))
    axes["path"].legend(title=None if turns else "dashed: limit of friction")


def _contacts(result: PressResult) -> str:
    """The table of the contacts."""
    contacts = result.touch.contacts.values()
    rows = [
        ["contact force, N", *(f"{each.force_n:.2f}" for each in contacts)],
        ["depth, mm", *(f"{each.depth_mm:.3f}" for each in contacts)],
        ["contact area, mm²", *(f"{each.contact_area_mm2:.1f}" for each in contacts)],
        ["maximum pressure, kPa", *(f"{each.pressure_kpa.max():.0f}" for each in contacts)],
    ]
    if result.state.motion == "slide":
        rows += [
            ["tangential force, N", *(f"{np.hypot(*each.shear_n):.2f}" for each in contacts)],
            ["torque, N mm", *(f"{each.torque_nmm:.2f}" for each in contacts)],
            ["slipping area, %", *(f"{100 * each.slip_share:.0f}" for each in contacts)],
        ]
    return _heading("Contact") + _table(list(result.touch.contacts), rows, "contact")


def _listed(counts: np.ndarray) -> str:
    """Rounded counts, separated by spaces."""
    return " ".join(str(count) for count in np.rint(counts).astype(int))


def _page(parts: Iterable[str]) -> str:
    """A card of HTML."""
    return f'<div class="t2">{"".join(parts)}</div>'


def _row(*cells: str) -> str:
    """Three columns."""
    return f'<div class="row">{"".join(cells)}</div>'


def _figure(title: str, note: str, pixels: np.ndarray | Image.Image, name: str) -> str:
    """An image, (h, w, 3) or (h, w) uint8, with its title and a note. name: for tests."""
    picture, buffer = pixels, io.BytesIO()
    if isinstance(pixels, np.ndarray):
        picture = Image.fromarray(pixels)
    picture.save(buffer, "PNG", compress_level=1)
    return (
        f'<figure><b>{escape(title)}</b><img decoding="sync" alt="{escape(title or name)}" '
        f'data-name="{escape(name)}" src="{data_uri(buffer.getvalue())}">'
        f'<span class="soft">{escape(note)}</span></figure>'
    )


def _bar(name: str, low: str, high: str, colors: str = COLOR_MAP) -> str:
    """A color bar with its ends."""
    return (
        f'<div class="bar"><span class="soft">{escape(name)}</span>'
        f'<i style="background:{_gradient(colors)}"></i>'
        f'<div class="ends"><span>{escape(low)}</span><span>{escape(high)}</span></div></div>'
    )


@cache
def _gradient(colors: str) -> str:
    """CSS gradient of a color map, from left to right."""
    stops = ",".join(f"rgb{tuple(rgb)}" for rgb in color_table(colors)[::51].tolist())
    return f"linear-gradient(to right,{stops})"


def _heading(text: str) -> str:
    """A heading."""
    return f"<h4>{escape(text)}</h4>"


def _paragraph(text: str) -> str:
    """A paragraph."""
    return f'<p class="soft">{escape(text)}</p>'


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], name: str) -> str:
    """heads: of all columns but the first. rows: the first cell is the name of the row."""
    head = "".join(f"<th>{escape(each)}</th>" for each in ("", *heads))
    body = ""
    for first, *cells in rows:
        values = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        body += f"<tr><th>{escape(first)}</th>{values}</tr>"
    return f'<table data-name="{name}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
