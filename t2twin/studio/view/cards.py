"""The cards next to the scene, as HTML: images with their errors, color bars and tables.

All texts are escaped here. Text has the page's own color, for the light and the dark theme.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from t2twin.sim.contact.types import Contact
from t2twin.sim.cyskin.phi import PX_PER_MM, TACTILE_SHAPE
from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS
from t2twin.sim.touch import Touch
from t2twin.studio.frame_source import NamedFrame
from t2twin.studio.session import TRANSLATING, PressResult
from t2twin.studio.translators import TRAIN_COMMAND, Translation
from t2twin.studio.view.colors import (
    DIVERGING,
    SEQUENTIAL,
    color_image_url,
    color_values,
    gradient,
    image_url,
)
from t2twin.studio.view.intervals import force_html, intervals_html, taxels_html

NICE = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Leading digits of a color bar's upper end."""

MIN_COUNTS, MIN_KPA = 100.0, 1.0
"""Minimum upper ends of the color scales, so that noise is not drawn in strong colors."""

MODELS = {"resnet18": "ResNet18", "touch2touch": "touch2touch", "field": "field"}
"""Displayed names of the models."""

WELCOME = (
    "Press a shape into two touch sensors. Move a slider or drag the shape: Shift rotates it, Ctrl "
    "changes the force. Drop a file on the page to press your own shape."
)

LOADING = "The translators are being loaded."

OUT_OF_DISTRIBUTION = "This image is unlike the training images; its counts are unreliable."

BACKGROUND_USED = "Uses the background frame."

PRETRAINED = "pretrained run"
"""Displayed instead of the run's name."""

STYLE = """<style>
.t2 { font-size: 0.8rem; line-height: 1.4; padding: 0.5rem 1.1rem 0.3rem 0.7rem; }
.t2 h4 { margin: 0.9rem 0 0.3rem; font-size: 0.85rem; font-weight: 600; }
.t2 .row { display: grid; grid-template-columns: 1fr 1fr 1fr; gap: 0.7rem;
  margin-bottom: 0.7rem; }
.t2 .row > * { margin: 0; min-width: 0; overflow-wrap: anywhere; }
.t2 b { display: block; font-weight: 600; }
.t2 img, .t2 svg { display: block; width: 100%; border-radius: 3px; }
.t2 .soft { opacity: 0.75; }
.t2 .bar { margin-bottom: 0.55rem; }
.t2 .bar i { display: block; height: 0.55rem; border-radius: 2px; margin: 0.15rem 0; }
.t2 .ends { display: flex; justify-content: space-between; }
.t2 td, .t2 .ends { font-variant-numeric: tabular-nums; }
.t2 table { width: 100%; border-collapse: collapse; }
.t2 th { font-weight: 400; text-align: left; opacity: 0.75; }
.t2 td, .t2 thead th { text-align: right; }
.t2 tbody tr { border-top: 1px solid rgba(128, 128, 128, 0.25); }
.t2 tr.off td { font-weight: 700; }
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


@dataclass(frozen=True)
class Scales:
    """Upper ends of the color scales: pressure on the gel and on the cover, kPa, counts, and
    differences of counts, whose scale is symmetric."""

    digit_kpa: float
    cyskin_kpa: float
    counts: float
    difference: float


def scales_of(result: PressResult) -> Scales:
    """The smallest rounded upper ends that include all values of a result."""
    counts = [result.touch.counts.max(), *(each.counts.max() for each in result.translations)]
    residuals = [np.abs(each.counts - each.truth).max() for each in result.translations
                 if each.truth is not None]  # fmt: skip
    return Scales(
        nice_end(result.touch.digit.pressure_kpa.max(), MIN_KPA),
        nice_end(result.touch.cyskin.pressure_kpa.max(), MIN_KPA),
        nice_end(max(counts), MIN_COUNTS),
        nice_end(max(residuals, default=0.0), MIN_COUNTS),
    )


def nice_end(maximum: float, minimum_end: float) -> float:
    """The smallest number with leading digits of NICE that is not below either argument."""
    end = max(float(maximum), minimum_end)
    decade = 10.0 ** np.floor(np.log10(end))
    return float(next(n * decade for n in NICE if n * decade >= end * (1 - 1e-9)))


def welcome_html() -> str:
    """The introduction of a page, with the style of all cards."""
    return STYLE + _page([f"<p>{escape(WELCOME)}</p>"])


def press_html(result: PressResult, scales: Scales, has_runs: bool, loading: bool = False) -> str:
    """All cards of a press. has_runs: whether there are runs. loading: whether runs are being
    searched or loaded."""
    touch = result.touch
    digit = _figure("DIGIT", "camera image, from below", image_url(touch.image), "digit")
    if result.tactile_image is None:
        cyskin = f"<figure><b>CySkin</b>{_paragraph(result.no_image)}</figure>"
    else:
        url = color_image_url(result.tactile_image, scales.counts)
        cyskin = _figure("CySkin", f"tactile image, {touch.layout.size} taxels", url, "cyskin")
    parts = [_row(digit, cyskin, _bars(scales))]
    if result.translations:
        parts.append("<h4>CySkin predicted from the DIGIT image</h4>")
        force_n = touch.command.force_n
        parts += [_translation_row(each, scales, force_n) for each in result.translations]
    elif loading:
        parts.append(f"<h4>Translation</h4>{_paragraph(LOADING)}")
    elif not has_runs:
        parts.append(_no_runs())
    notes = "".join(_paragraph(note) for note in _notes(touch))
    parts += [_contacts(touch.digit, touch.cyskin), notes, _steps(result), _counts(result)]
    return _page([*parts, *map(_taxels, result.translations)])


def reproduce_html(line: str, link: str | None) -> str:
    """Command line of a press and link to it; None for a press with a user's file."""
    shown = _paragraph("Not available: a link contains no files.") if link is None else _code(link)
    return _page(["<h4>Command line</h4>", _code(line), "<h4>Link to this press</h4>", shown])


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
        url = color_image_url(each.tactile_image, high)
        figure = _figure(_model(each), _caption(each), url, "translated")
        notes = "" if each.in_distribution else _paragraph(OUT_OF_DISTRIBUTION)
        notes += _paragraph(BACKGROUND_USED) if each.background_used else ""
        notes += _paragraph(f"{each.milliseconds:.0f} ms")
        listed = f"<p><b>counts</b><code>{_listed(each.counts)}</code></p>"
        parts.append(_row(figure, f'<div class="wide">{notes}{listed}</div>'))
        parts += [force_html(each, None), intervals_html(each), taxels_html(each)]
    return _page(parts)


def _translation_row(translation: Translation, scales: Scales, force_n: float) -> str:
    """Predicted tactile image of a run, differences from the true counts, error and intervals.

    force_n: true force.
    """
    assert translation.truth is not None
    url = color_image_url(translation.tactile_image, scales.counts)
    left = _figure(_model(translation), _caption(translation), url, "translated")
    discs = _discs(translation, scales.difference)
    right = f'<figure><b>Difference</b>{discs}<span class="soft">predicted − true</span></figure>'
    bar = _bar("counts", DIVERGING, f"-{scales.difference:,.0f}", f"+{scales.difference:,.0f}")
    notes = (
        f"<p><b>RMSE {translation.rmse_counts:,.0f} counts</b>"
        f'<span class="soft">{translation.rmse_percent:.2f}&nbsp;% of full scale '
        f"({FULL_SCALE_COUNTS:,.0f})</span></p>"
    )
    notes += "" if translation.in_distribution else _paragraph(OUT_OF_DISTRIBUTION)
    notes += _paragraph(f"{translation.milliseconds:.0f} ms")
    figures = _row(left, right, f"<div>{bar}{notes}</div>")
    return figures + force_html(translation, force_n) + intervals_html(translation)


def _taxels(translation: Translation) -> str:
    """Table of a run's counts with their intervals."""
    table = taxels_html(translation)
    return table and f"<h4>{escape(translation.name)}, counts by taxel</h4>{table}"


def _discs(translation: Translation, high: float) -> str:
    """Differences of the taxels as discs at their positions, in the size of a tactile image."""
    assert translation.truth is not None
    rows, columns = TACTILE_SHAPE
    colors = color_values(translation.counts - translation.truth, high, DIVERGING)
    layout = translation.layout
    discs = "".join(
        f'<circle cx="{columns / 2 + PX_PER_MM * layout.x_mm[n]:.1f}"'
        f' cy="{rows / 2 + PX_PER_MM * layout.y_mm[n]:.1f}"'
        f' r="{PX_PER_MM * layout.pad_diameter_mm[n] / 2:.1f}"'
        f' fill="rgb({red},{green},{blue})"/>'
        for n, (red, green, blue) in enumerate(colors.tolist())
    )
    middle = ",".join(map(str, color_values(np.zeros(1), high, DIVERGING)[0].tolist()))
    return (
        f'<svg viewBox="0 0 {columns} {rows}" role="img" aria-label="Difference">'
        f'<rect width="{columns}" height="{rows}" fill="rgb({middle})"/>{discs}</svg>'
    )


def _bars(scales: Scales) -> str:
    bars = (
        _bar("pressure on the gel", SEQUENTIAL, "0", f"{scales.digit_kpa:,g} kPa"),
        _bar("pressure on the cover", SEQUENTIAL, "0", f"{scales.cyskin_kpa:,g} kPa"),
        _bar("taxels", SEQUENTIAL, "0", f"{scales.counts:,.0f} counts"),
    )
    return f"<div><b>Colors</b>{''.join(bars)}</div>"


def _bar(name: str, colors: str, low: str, high: str) -> str:
    return (
        f'<div class="bar"><span class="soft">{escape(name)}</span>'
        f'<i style="background:{gradient(colors)}"></i>'
        f'<div class="ends"><span>{escape(low)}</span><span>{escape(high)}</span></div></div>'
    )


def _contacts(digit: Contact, cyskin: Contact) -> str:
    rows = (
        ("contact force, N", "{:.2f}", "force_n"),
        ("depth, mm", "{:.3f}", "depth_mm"),
        ("contact area, mm²", "{:.1f}", "contact_area_mm2"),
        ("maximum pressure, kPa", "{:.0f}", "pressure_kpa"),
    )
    body = ""
    for name, template, field in rows:
        values = (np.max(getattr(contact, field)) for contact in (digit, cyskin))
        cells = "".join(f"<td>{template.format(value)}</td>" for value in values)
        body += f"<tr><th>{escape(name)}</th>{cells}</tr>"
    head = "<thead><tr><th></th><th>DIGIT</th><th>CySkin</th></tr></thead>"
    return f"<h4>Contact</h4><table>{head}<tbody>{body}</tbody></table>"


def _notes(touch: Touch) -> list[str]:
    """Notes on a press: repairs of the mesh, and failures of the contact solver."""
    notes = list(touch.shape.notes)
    for name, contact in (("DIGIT", touch.digit), ("CySkin", touch.cyskin)):
        if not contact.settled:
            notes.append(f"The press on the {name} did not converge.")
        if contact.bottomed:
            notes.append(
                f"The press on the {name} bottomed out: its base plate (the lowest flat face) is "
                "in contact."
            )
    return notes


def _steps(result: PressResult) -> str:
    steps = [(name, ms) for name, ms in result.steps_ms.items() if ms or name != TRANSLATING]
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{ms:.1f}</td></tr>" for name, ms in steps)
    rows += f"<tr><th>total</th><td>{result.milliseconds:.1f}</td></tr>"
    return f"<h4>Time, ms</h4><table><tbody>{rows}</tbody></table>"


def _counts(result: PressResult) -> str:
    listed = _listed(result.touch.counts)
    return f'<h4>True counts by taxel</h4><p><code class="counts">{listed}</code></p>'


def _listed(counts: np.ndarray) -> str:
    return " ".join(str(count) for count in np.rint(counts).astype(int))


def _model(translation: Translation) -> str:
    return MODELS.get(translation.model, translation.model)


def _caption(translation: Translation) -> str:
    """Caption of a run: its name, or PRETRAINED, whose name is that of the model."""
    return PRETRAINED if translation.name == translation.model else translation.name


def _row(*cells: str) -> str:
    return f'<div class="row">{"".join(cells)}</div>'


def _no_runs() -> str:
    return (
        "<h4>Translation</h4>"
        + _paragraph("There is no trained run. This command trains two in minutes:")
        + _code(TRAIN_COMMAND)
    )


def _figure(title: str, note: str, url: str, name: str) -> str:
    return (
        f"<figure><b>{escape(title)}</b>"
        f'<img decoding="sync" alt="{escape(title)}" data-name="{name}" src="{url}">'
        f'<span class="soft">{escape(note)}</span></figure>'
    )


def _paragraph(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>'


def _code(text: str) -> str:
    return f"<p><code>{escape(text)}</code></p>"


def _page(parts: Sequence[str]) -> str:
    return f'<div class="t2">{"".join(parts)}</div>'
