"""The cards next to the scene: images with their errors, color bars, tables and charts.

All texts are escaped here. Text has the page's own color, for the light and the dark theme.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from t2twin.core.draw import relief
from t2twin.core.errors import T2TwinError
from t2twin.sim.touch import Touch
from t2twin.studio.charts import (
    PERCENT,
    SLIP_RGB,
    STICK_RGB,
    arrows_of,
    half_side_mm,
    intervals_html,
    key,
    map_svg,
    nice_end,
    slide_html,
)
from t2twin.studio.colors import (
    DIVERGING,
    SEQUENTIAL,
    color_image_url,
    color_values,
    gradient,
    image_url,
)
from t2twin.studio.session import PressResult
from t2twin.studio.shared import NamedFrame
from t2twin.studio.translators import TRAIN_COMMAND, Translation

STYLE = """<style>
.t2 { font-size: 0.8rem; line-height: 1.4; padding: 0.5rem 1.1rem 0.3rem 0.7rem; }
.t2 h4 { margin: 0.9rem 0 0.3rem; font-size: 0.85rem; font-weight: 600; }
.t2 .row { display: grid; grid-template-columns: 1fr 1fr 1fr; gap: 0.7rem;
  margin-bottom: 0.7rem; }
.t2 .two { grid-template-columns: 1fr 1fr; }
.t2 .row > * { margin: 0; min-width: 0; overflow-wrap: anywhere; }
.t2 b { display: block; font-weight: 600; }
.t2 img, .t2 svg { display: block; width: 100%; border-radius: 3px; }
.t2 .soft { opacity: 0.75; }
.t2 .bar { margin-bottom: 0.55rem; }
.t2 .bar i { display: block; height: 0.55rem; border-radius: 2px; margin: 0.15rem 0; }
.t2 .ends { display: flex; justify-content: space-between; }
.t2 .key { display: inline-block; width: 0.7rem; height: 0.7rem; border-radius: 2px; }
.t2 td, .t2 .ends { font-variant-numeric: tabular-nums; }
.t2 table { width: 100%; border-collapse: collapse; }
.t2 th { font-weight: 400; text-align: left; opacity: 0.75; }
.t2 td, .t2 thead th { text-align: right; }
.t2 tbody tr { border-top: 1px solid rgba(128, 128, 128, 0.25); }
.t2 .wide { grid-column: span 2; }
.t2 > figure { margin: 0.4rem 0 0.9rem; }
.t2 p { margin: 0.3rem 0; }
.t2 code { font-size: 0.75rem; overflow-wrap: anywhere; }
.t2-drop::after { content: "Drop the file here"; position: fixed; inset: 0.6rem; z-index: 9999;
  display: grid; place-items: center; border: 3px dashed currentColor; border-radius: 8px;
  background: rgba(128, 128, 128, 0.35); font: 600 1.4rem sans-serif; pointer-events: none; }
@media (max-width: 36em) {
  .mantine-Paper-root:has(.t2) { left: 0 !important; width: 100% !important; }
  .mantine-Paper-root:has(.t2) .mantine-ScrollArea-content > div { width: 100% !important; }
}
</style>"""
"""Style of the cards. On a phone, viser's panel of controls is widened to the screen."""

MIN_SHARE, MIN_KPA = 0.0025, 1.0
"""Minimum upper ends of the color scales, as a share of full scale and in kPa, so that noise is not
drawn in strong colors."""

MIN_COUNTS = 100.0
"""The same where the full scale is unknown, counts."""

MODELS = {"resnet18": "ResNet18", "touch2touch": "touch2touch", "field": "field"}
"""Displayed names of the models."""

LOADING = "The translators are being loaded."

BACKGROUND_USED = "Uses the background frame."


@dataclass(frozen=True)
class Scales:
    """Upper ends of the color scales: pressure by sensor, kPa, counts by taxel array, predicted
    counts, and differences of counts, whose scale is symmetric."""

    kpa: dict[str, float]
    counts: dict[str, float]
    predicted: float
    difference: float


def scales_of(result: PressResult) -> Scales:
    """The smallest rounded upper ends that include all values of a result."""
    touch, translations = result.touch, result.translations
    least = MIN_COUNTS if touch.of_array is None else MIN_SHARE * touch.of_array.sensor.full_scale
    predicted = [each.counts.max() for each in translations]
    residuals = [np.abs(each.counts - each.truth).max() for each in translations
                 if each.truth is not None]  # fmt: skip
    counts = {}
    reading: Any
    for sensor, reading in touch.readings.items():
        if (values := getattr(reading, "counts", None)) is not None:
            # The first array has the scale of the predictions, which are compared with it.
            others = predicted if reading is touch.of_array else []
            own = MIN_SHARE * reading.sensor.full_scale
            counts[sensor] = nice_end(max(values.max(), *others, 0.0), own)
    kpa = {
        name: nice_end(each.pressure_kpa.max(), MIN_KPA) for name, each in touch.contacts.items()
    }
    return Scales(
        kpa,
        counts,
        next(iter(counts.values()), nice_end(max(predicted, default=0.0), least)),
        nice_end(max(residuals, default=0.0), least),
    )


def welcome_html() -> str:
    """The introduction of a page, with the style of all cards."""
    text = (
        "Press a shape into two touch sensors. Move a slider or drag the shape: Shift rotates it, "
        "Ctrl changes the force. Drop a file on the page to press your own shape."
    )
    return STYLE + _page([_paragraph(text)])


def press_html(result: PressResult, scales: Scales, has_runs: bool, loading: bool = False) -> str:
    """All cards of a press. has_runs: whether there are runs. loading: whether runs are being
    searched or loaded."""
    touch = result.touch
    readings = [_reading(name, each, scales) for name, each in touch.readings.items()]
    bars = [
        *(_bar(f"pressure on {name}", SEQUENTIAL, "0", f"{end:,g} kPa")
          for name, end in scales.kpa.items()),
        *(_bar(f"taxels of {name}", SEQUENTIAL, "0", f"{end:,.0f} counts")
          for name, end in scales.counts.items()),
    ]  # fmt: skip
    parts = [_row(*readings, f"<div><b>Colors</b>{''.join(bars)}</div>"), _slide(result)]
    if result.translations:
        parts.append(_heading(f"Counts predicted from the image of {touch.of_camera.sensor.name}"))
        if result.has_slid:
            parts.append(_paragraph("The networks are trained on presses without friction."))
        parts += [_translation(each, scales, touch) for each in result.translations]
    elif loading:
        parts += [_heading("Translation"), _paragraph(LOADING)]
    elif not has_runs:
        parts.append(_no_runs())
    parts += [_contacts(result), *map(_paragraph, [*touch.shape.notes, *touch.notes])]
    for name, each in touch.readings.items():
        if (values := getattr(each, "counts", None)) is not None:
            listed = f'<p><code class="counts">{_listed(values)}</code></p>'
            parts += [_heading(f"True counts of {name} by taxel"), listed]
    return _page(parts)


def _reading(name: str, reading: Any, scales: Scales) -> str:
    """The image of a gel camera, or the tactile image of a taxel array."""
    if (image := getattr(reading, "image", None)) is not None:
        return _figure(name, "camera image, from below", image_url(image), name)
    try:
        url = color_image_url(reading.tactile_image, scales.counts[name])
    except T2TwinError as error:  # a layout without a tactile image
        return f"<figure><b>{escape(name)}</b>{_paragraph(str(error))}</figure>"
    return _figure(name, f"tactile image, {reading.sensor.layout.size} taxels", url, name)


def reproduce_html(line: str, link: str | None) -> str:
    """Command line of a press and link to it; None for a press with a user's file or a slide."""
    missing = "Not available: a link contains no files and no slides."
    shown = _paragraph(missing) if link is None else _code(link)
    return _page([_heading("Command line"), _code(line), _heading("Link to this press"), shown])


def frame_html(
    frame: NamedFrame, background: NamedFrame | None, translations: Sequence[Translation]
) -> str:
    """A frame without known true counts, with the prediction of each run.

    background: background frame of the field runs.
    """
    high = nice_end(max((t.counts.max() for t in translations), default=0.0), MIN_COUNTS)
    cells = [_figure("Frame", frame[1], image_url(frame[0]), "frame")]
    if background is not None:
        image, name = background
        cells.append(_figure("Background", name, image_url(image), "background"))
    if not translations:
        return _page([_row(*cells), _no_runs()])
    bar = _bar("tactile images", SEQUENTIAL, "0", f"{high:,.0f} counts")
    parts = [_row(*cells, f"<div>{bar}</div>")]
    for each in translations:
        notes = _unreliable(each) + (_paragraph(BACKGROUND_USED) if each.background_used else "")
        listed = f"<p><b>counts</b><code>{_listed(each.counts)}</code></p>"
        parts.append(_row(_predicted(each, high), f'<div class="wide">{notes}{listed}</div>'))
        parts += [_force(each, None), _predicted_contact(each), intervals_html(each)]
    return _page(parts)


def _translation(translation: Translation, scales: Scales, touch: Touch) -> str:
    """Predicted tactile image of a run, differences from the true counts, error and intervals."""
    unreliable, rmse_counts = _unreliable(translation), translation.rmse_counts
    if rmse_counts is None:  # no such array was pressed
        right = f'<div class="wide">{unreliable}</div>'
    else:
        discs = _discs(translation, scales.difference)
        bar = _bar("counts", DIVERGING, f"-{scales.difference:,.0f}", f"+{scales.difference:,.0f}")
        full_scale = touch.of_array.sensor.full_scale
        right = (
            f'<figure><b>Difference</b>{discs}<span class="soft">predicted − true</span></figure>'
            f"<div>{bar}<p><b>RMSE {rmse_counts:,.0f} counts</b>"
            f'<span class="soft">{100.0 * rmse_counts / full_scale:.2f}&nbsp;% of full scale '
            f"({full_scale:,.0f})</span></p>{unreliable}</div>"
        )
    figures = _row(_predicted(translation, scales.predicted), right)
    force = _force(translation, touch.command.force_n)
    return figures + force + _predicted_contact(translation) + intervals_html(translation)


def _predicted(translation: Translation, high: float) -> str:
    """Predicted tactile image, in colors from 0 to high."""
    model, name = translation.model, translation.name
    url = color_image_url(translation.tactile_image, high)
    caption = "pretrained run" if name == model else name
    return _figure(MODELS.get(model, model), caption, url, "translated")


def _unreliable(translation: Translation) -> str:
    if translation.in_distribution:
        return ""
    return _paragraph("This image is unlike the training images; its counts are unreliable.")


def _force(translation: Translation, true_n: float | None) -> str:
    """Table of the predicted force; empty for a run without one. true_n: None if unknown."""
    if translation.force is None:
        return ""
    value, low, high = translation.force
    cells = ["force, N", f"{value:.1f}", f"{low:.1f} to {high:.1f}"]
    heads = ["predicted", f"{PERCENT} interval"]
    if true_n is not None:
        cells, heads = [*cells, f"{true_n:.2f}"], [*heads, "true"]
    return _table(heads, [cells], "force")


def _predicted_contact(translation: Translation) -> str:
    """The depth of the predicted contact as a relief, and its values; empty for a run without."""
    contact = translation.contact
    if contact is None:
        return ""
    picture = relief(contact.depth_mm, contact.mask, contact.view_mm)
    figure = _figure("Contact", "predicted depth", image_url(np.asarray(picture)), "contact")
    rows = [
        ["largest depth, mm", f"{contact.largest_depth_mm:.2f}"],
        ["contact area in view, mm²", f"{contact.area_mm2:.1f}"],
        ["force in view, N", f"{contact.force_in_view_n:.2f}"],
    ]
    notes = "".join(_paragraph(f"{note[0].upper()}{note[1:]}.") for note in contact.notes)
    table = _table(["predicted"], rows, "predicted-contact")
    return _row(figure, f'<div class="wide">{table}{notes}</div>')


def _discs(translation: Translation, high: float) -> str:
    """Differences of the taxels as discs at their positions, in the size of a tactile image."""
    assert translation.truth is not None
    (rows, columns), px_per_mm = translation.tactile_image.shape, translation.px_per_mm
    colors = color_values(translation.counts - translation.truth, high, DIVERGING)
    layout = translation.layout
    discs = "".join(
        f'<circle cx="{columns / 2 + px_per_mm * layout.x_mm[n]:.1f}"'
        f' cy="{rows / 2 + px_per_mm * layout.y_mm[n]:.1f}"'
        f' r="{px_per_mm * layout.pad_diameter_mm[n] / 2:.1f}"'
        f' fill="rgb({red},{green},{blue})"/>'
        for n, (red, green, blue) in enumerate(colors.tolist())
    )
    middle = ",".join(map(str, color_values(np.zeros(1), high, DIVERGING)[0].tolist()))
    return (
        f'<svg viewBox="0 0 {columns} {rows}" role="img" aria-label="Difference">'
        f'<rect width="{columns}" height="{rows}" fill="rgb({middle})"/>{discs}</svg>'
    )


def _bar(name: str, colors: str, low: str, high: str) -> str:
    return (
        f'<div class="bar"><span class="soft">{escape(name)}</span>'
        f'<i style="background:{gradient(colors)}"></i>'
        f'<div class="ends"><span>{escape(low)}</span><span>{escape(high)}</span></div></div>'
    )


def _slide(result: PressResult) -> str:
    """Maps of the tangential traction and the chart of a slide; empty for a press."""
    if result.slide is None or not result.has_slid:
        return ""
    parts, contacts = [_heading("Tangential traction")], result.touch.contacts
    if result.is_behind:
        distance_mm, rotation_deg = result.slide.remaining
        parts.append(
            _paragraph(f"The slide is behind: {distance_mm:.1f} mm and {rotation_deg:.0f}° remain.")
        )
    half_mm = max(map(half_side_mm, contacts.values()))
    maps = []
    for sensor, contact in contacts.items():
        note = f"largest {arrows_of(contact).peak_kpa:.3g} kPa"
        maps.append(
            f"<figure><b>{escape(sensor)}</b>{map_svg(contact, half_mm, sensor + '-traction')}"
            f'<span class="soft">{note}</span></figure>'
        )
    keys = [key(f"rgb{rgb}", name) for rgb, name in ((STICK_RGB, "stick"), (SLIP_RGB, "slip"))]
    legend = f"<p>{' '.join(keys)}, maps {2 * half_mm:.1f} mm wide</p>"
    return "".join([*parts, _row(*maps, kind="row two"), legend, slide_html(result.slide.points)])


def _contacts(result: PressResult) -> str:
    contacts = result.touch.contacts.values()
    rows = [
        ["contact force, N", *(f"{each.force_n:.2f}" for each in contacts)],
        ["depth, mm", *(f"{each.depth_mm:.3f}" for each in contacts)],
        ["contact area, mm²", *(f"{each.contact_area_mm2:.1f}" for each in contacts)],
        ["maximum pressure, kPa", *(f"{each.pressure_kpa.max():.0f}" for each in contacts)],
    ]
    if result.slide is not None:
        rows += [
            ["tangential force, N", *(f"{np.hypot(*each.shear_n):.2f}" for each in contacts)],
            ["torque, N mm", *(f"{each.torque_nmm:.2f}" for each in contacts)],
            ["slipping area, %", *(f"{100 * each.slip_share:.0f}" for each in contacts)],
        ]
    return _heading("Contact") + _table(list(result.touch.contacts), rows, "contact")


def _listed(counts: np.ndarray) -> str:
    return " ".join(str(count) for count in np.rint(counts).astype(int))


def _no_runs() -> str:
    text = "There is no trained run. This command trains two in minutes:"
    return _heading("Translation") + _paragraph(text) + _code(TRAIN_COMMAND)


def _page(parts: Iterable[str]) -> str:
    return f'<div class="t2">{"".join(parts)}</div>'


def _row(*cells: str, kind: str = "row") -> str:
    return f'<div class="{kind}">{"".join(cells)}</div>'


def _figure(title: str, note: str, url: str, name: str) -> str:
    """An image with its title and a note. name: for scripts and tests."""
    return (
        f"<figure><b>{escape(title)}</b>"
        f'<img decoding="sync" alt="{escape(title)}" data-name="{name}" src="{url}">'
        f'<span class="soft">{escape(note)}</span></figure>'
    )


def _heading(text: str) -> str:
    return f"<h4>{escape(text)}</h4>"


def _paragraph(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>'


def _code(text: str) -> str:
    return f"<p><code>{escape(text)}</code></p>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], name: str) -> str:
    """heads: of all columns but the first. rows: the first cell is the name of the row."""
    head = "".join(f"<th>{escape(each)}</th>" for each in ("", *heads))
    body = ""
    for first, *cells in rows:
        values = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        body += f"<tr><th>{escape(first)}</th>{values}</tr>"
    return f'<table data-name="{name}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
