"""What stands beside the scene, as HTML: pictures with their errors, color bars, figures.

Every text is escaped here. Colors of text are the page's own, so that it can be read by day and
by night.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from t2twin.sim.contact.types import Contact
from t2twin.sim.cyskin.phi import PX_PER_MM, TACTILE_SHAPE
from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS
from t2twin.sim.touch import Touch
from t2twin.studio.frame_source import Named
from t2twin.studio.session import TRANSLATING, Look
from t2twin.studio.translators import MAKE_ONE, Translation
from t2twin.studio.view.colors import (
    DIVERGING,
    SEQUENTIAL,
    colored,
    colored_address,
    data_address,
    gradient,
)
from t2twin.studio.view.intervals import force_html, intervals_html, taxels_html

NICE = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""First figures of a color bar's upper end."""

MIN_COUNTS, MIN_KPA = 100.0, 1.0
"""Least upper ends of the colors of counts and of kPa, so that nothing is not drawn as much."""

MODELS = {"resnet18": "ResNet18", "touch2touch": "touch2touch", "field": "field"}
"""How the models are written."""

WELCOME = (
    "Press a shape into two touch sensors at once. Move a slider, or drag the shape itself: "
    "with Shift it turns, with Ctrl it is pressed harder. Drop a file of yours anywhere to press "
    "that."
)
"""What a new page says first."""

RUNS_COME = "The translators are being loaded."
"""What stands in their place until then."""

UNFAMILIAR = "This picture is unlike all that it was trained on: its counts mean little."
"""What is said of a translation that cannot be trusted."""

COMPARED = "Compared with the background frame."
"""Shown with a translation that used one."""

PRETRAINED = "the pretrained run"
"""Shown in place of its name."""

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
.t2-drop::after { content: "Drop it to press it"; position: fixed; inset: 0.6rem; z-index: 9999;
  display: grid; place-items: center; border: 3px dashed currentColor; border-radius: 8px;
  background: rgba(128, 128, 128, 0.35); font: 600 1.4rem sans-serif; pointer-events: none; }
@media (max-width: 36em) {
  .mantine-Paper-root:has(.t2) { left: 0 !important; width: 100% !important; }
  .mantine-Paper-root:has(.t2) .mantine-ScrollArea-content > div { width: 100% !important; }
}
</style>"""
"""How the cards look, for the page's head; on a phone viser's sheet of controls is made as wide as
the screen."""


@dataclass(frozen=True)
class Scales:
    """Upper ends of the colors: of the gel's and the cover's pressure, kPa, of counts, and of
    differences of counts, which go as far below zero."""

    digit_kpa: float
    cyskin_kpa: float
    counts: float
    difference: float


def scales_of(look: Look) -> Scales:
    """The least nice ends that hold all of a look."""
    counts = [look.touch.counts.max(), *(each.counts.max() for each in look.translations)]
    off = [np.abs(each.counts - each.truth).max() for each in look.translations
           if each.truth is not None]  # fmt: skip
    return Scales(
        nice_end(look.touch.digit.pressure_kpa.max(), MIN_KPA),
        nice_end(look.touch.cyskin.pressure_kpa.max(), MIN_KPA),
        nice_end(max(counts), MIN_COUNTS),
        nice_end(max(off, default=0.0), MIN_COUNTS),
    )


def nice_end(largest: float, least: float) -> float:
    """The least number with a first figure of NICE that is no less than either."""
    most = max(float(largest), least)
    ten = 10.0 ** np.floor(np.log10(most))
    return float(next(n * ten for n in NICE if n * ten >= most * (1 - 1e-9)))


def welcome_html() -> str:
    """What a new page says first, with the style of all cards."""
    return STYLE + _page([f"<p>{escape(WELCOME)}</p>"])


def pictures_html(look: Look, scales: Scales, runs_known: bool, runs_come: bool = False) -> str:
    """All that is said of a look. runs_known: whether there is any run to translate by. runs_come:
    whether some are still being looked for or loaded."""
    touch = look.touch
    seen = _figure("DIGIT", "what its camera saw, from below", data_address(touch.image), "digit")
    if look.tactile_image is None:
        felt = f"<figure><b>CySkin</b>{_paragraph(look.no_image)}</figure>"
    else:
        address = colored_address(look.tactile_image, scales.counts)
        felt = _figure("CySkin", f"what {touch.layout.size} taxels felt", address, "cyskin")
    parts = [_row(seen, felt, _bars(scales))]
    if look.translations:
        parts.append("<h4>The CySkin, translated from the DIGIT's picture alone</h4>")
        force_n = touch.command.force_n
        parts += [_translation_row(each, scales, force_n) for each in look.translations]
    elif runs_come:
        parts.append(f"<h4>TranslationResult</h4>{_paragraph(RUNS_COME)}")
    elif not runs_known:
        parts.append(_none_yet())
    notes = "".join(_paragraph(note) for note in _notes(touch))
    parts += [_contacts(touch.digit, touch.cyskin), notes, _steps(look), _counts(look)]
    return _page([*parts, *map(_taxels, look.translations)])


def again_html(line: str, link: str | None) -> str:
    """How a press is made again: by a command line, and by a link, None where it can have none."""
    address = _paragraph("None, as a link holds no files.") if link is None else _code(link)
    return _page([
        "<h4>The line that makes it again</h4>", _code(line),
        "<h4>A link to this very press</h4>", address,
    ])  # fmt: skip


def frame_html(named: Named, background: Named | None, translations: Sequence[Translation]) -> str:
    """A frame of the user's, whose truth is not known, with the prediction of each run.

    background: the frame that field runs compare it with.
    """
    most = nice_end(max((t.counts.max() for t in translations), default=0.0), MIN_COUNTS)
    cells = [_figure("Frame", named[1], data_address(named[0]), "frame")]
    if background is not None:
        image, name = background
        cells.append(_figure("Background", name, data_address(image), "background"))
    if not translations:
        return _page([_row(*cells), _none_yet()])
    bar = _bar("tactile images", SEQUENTIAL, "0", f"{most:,.0f} counts")
    parts = [_row(*cells, f"<div>{bar}</div>")]
    for each in translations:
        address = colored_address(each.tactile_image, most)
        figure = _figure(_model(each), _caption(each), address, "translated")
        words = "" if each.familiar else _paragraph(UNFAMILIAR)
        words += _paragraph(COMPARED) if each.compared else ""
        words += _paragraph(f"{each.milliseconds:.0f} ms")
        listed = f"<p><b>counts</b><code>{_listed(each.counts)}</code></p>"
        parts.append(_row(figure, f'<div class="wide">{words}{listed}</div>'))
        parts += [force_html(each, None), intervals_html(each), taxels_html(each)]
    return _page(parts)


def _translation_row(translation: Translation, scales: Scales, force_n: float) -> str:
    """A run's tactile image, its difference from what the CySkin felt, its error in words, and its
    intervals where it has some. force_n: the true one."""
    assert translation.truth is not None
    drawn = colored_address(translation.tactile_image, scales.counts)
    left = _figure(_model(translation), _caption(translation), drawn, "translated")
    discs = _discs(translation, scales.difference)
    right = (
        f'<figure><b>Difference</b>{discs}<span class="soft">translated less felt</span></figure>'
    )
    bar = _bar("counts", DIVERGING, f"-{scales.difference:,.0f}", f"+{scales.difference:,.0f}")
    words = (
        f"<p><b>{translation.rmse_counts:,.0f} counts off</b>"
        f'<span class="soft">root mean square, {translation.rmse_percent:.2f}&nbsp;% of full scale '
        f"({FULL_SCALE_COUNTS:,.0f})</span></p>"
    )
    words += "" if translation.familiar else _paragraph(UNFAMILIAR)
    words += _paragraph(f"{translation.milliseconds:.0f} ms")
    figures = _row(left, right, f"<div>{bar}{words}</div>")
    return figures + force_html(translation, force_n) + intervals_html(translation)


def _taxels(translation: Translation) -> str:
    """A run's counts with their intervals, in figures."""
    table = taxels_html(translation)
    return table and f"<h4>{escape(translation.name)}, taxel by taxel</h4>{table}"


def _discs(translation: Translation, most: float) -> str:
    """Each taxel's difference as a disc at its place, drawn as large as a tactile image."""
    assert translation.truth is not None
    rows, columns = TACTILE_SHAPE
    colors = colored(translation.counts - translation.truth, most, DIVERGING)
    layout = translation.layout
    discs = "".join(
        f'<circle cx="{columns / 2 + PX_PER_MM * layout.x_mm[n]:.1f}"'
        f' cy="{rows / 2 + PX_PER_MM * layout.y_mm[n]:.1f}"'
        f' r="{PX_PER_MM * layout.pad_diameter_mm[n] / 2:.1f}"'
        f' fill="rgb({red},{green},{blue})"/>'
        for n, (red, green, blue) in enumerate(colors.tolist())
    )
    middle = ",".join(map(str, colored(np.zeros(1), most, DIVERGING)[0].tolist()))
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
        ("force carried, N", "{:.2f}", "force_n"),
        ("depth, mm", "{:.3f}", "depth_mm"),
        ("contact area, mm²", "{:.1f}", "contact_area_mm2"),
        ("greatest pressure, kPa", "{:.0f}", "pressure_kpa"),
    )
    body = ""
    for name, how, of in rows:
        values = (np.max(getattr(contact, of)) for contact in (digit, cyskin))
        cells = "".join(f"<td>{how.format(value)}</td>" for value in values)
        body += f"<tr><th>{escape(name)}</th>{cells}</tr>"
    head = "<thead><tr><th></th><th>DIGIT</th><th>CySkin</th></tr></thead>"
    return f"<h4>The contact</h4><table>{head}<tbody>{body}</tbody></table>"


def _notes(touch: Touch) -> list[str]:
    """What there is to know of a press, in sentences: what was mended, what did not go well."""
    notes = list(touch.shape.notes)
    for name, contact in (("DIGIT", touch.digit), ("CySkin", touch.cyskin)):
        if not contact.settled:
            notes.append(f"On the {name} it did not settle.")
        if contact.bottomed:
            notes.append(
                f"On the {name} it bottomed out: the base plate (the lowest flat face) touched."
            )
    return notes


def _steps(look: Look) -> str:
    steps = [(name, ms) for name, ms in look.steps_ms.items() if ms or name != TRANSLATING]
    rows = "".join(f"<tr><th>{escape(name)}</th><td>{ms:.1f}</td></tr>" for name, ms in steps)
    rows += f"<tr><th>all</th><td>{look.milliseconds:.1f}</td></tr>"
    return f"<h4>Milliseconds</h4><table><tbody>{rows}</tbody></table>"


def _counts(look: Look) -> str:
    listed = _listed(look.touch.counts)
    return f'<h4>Counts, taxel by taxel</h4><p><code class="counts">{listed}</code></p>'


def _listed(counts: np.ndarray) -> str:
    return " ".join(str(count) for count in np.rint(counts).astype(int))


def _model(translation: Translation) -> str:
    return MODELS.get(translation.model, translation.model)


def _caption(translation: Translation) -> str:
    """A run's name; a pretrained run has that of its model, which is said already."""
    return PRETRAINED if translation.name == translation.model else translation.name


def _row(*cells: str) -> str:
    return f'<div class="row">{"".join(cells)}</div>'


def _none_yet() -> str:
    return (
        "<h4>TranslationResult</h4>"
        + _paragraph("There is no trained translator here yet. This makes both, in minutes:")
        + _code(MAKE_ONE)
    )


def _figure(title: str, note: str, address: str, name: str) -> str:
    return (
        f"<figure><b>{escape(title)}</b>"
        f'<img decoding="sync" alt="{escape(title)}" data-name="{name}" src="{address}">'
        f'<span class="soft">{escape(note)}</span></figure>'
    )


def _paragraph(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>'


def _code(text: str) -> str:
    return f"<p><code>{escape(text)}</code></p>"


def _page(parts: Sequence[str]) -> str:
    return f'<div class="t2">{"".join(parts)}</div>'
