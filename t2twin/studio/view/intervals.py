"""Uncertainty of a translation as HTML: chart and table of the intervals of the counts, and the
force with its interval."""

import numpy as np

from t2twin.studio.translators import LEVEL, Translation

WIDTH, HEIGHT, LEFT = 400.0, 130.0, 44.0
"""Size of the chart and width of the margin for its labels, in units of the SVG."""

TRUE_COLOR, PREDICTED_COLOR = "#d9480f", "#2f80d0"
"""Orange and blue: distinct in both themes and for color-blind readers."""

PERCENT = f"{100 * LEVEL:.0f}&nbsp;%"
"""Nominal coverage of the intervals, as HTML."""


def force_html(translation: Translation, true_n: float | None) -> str:
    """Table of the predicted force; empty for a run without one. true_n: None if unknown."""
    force = translation.force
    if force is None:
        return ""
    cells = [f"{force.value:.1f}", f"{force.low:.1f} to {force.high:.1f}"]
    heads = ["predicted", f"{PERCENT} interval"]
    if true_n is not None:
        cells, heads = [*cells, f"{true_n:.2f}"], [*heads, "true"]
    return _table(heads, [("force, N", cells, False)], 'data-name="force"')


def intervals_html(translation: Translation) -> str:
    """Chart of the intervals of the counts; empty for a run without intervals."""
    if translation.interval is None:
        return ""
    end = _end(translation)
    parts = [_grid(end)]
    low, high = translation.interval
    for n in range(translation.counts.size):
        parts.append(_taxel(translation, n, float(low[n]), float(high[n]), end))
    covered = translation.covered
    caption = (
        f"Counts of taxels 0 to {translation.counts.size - 1}: "
        f'<span style="color:{PREDICTED_COLOR}">predicted</span> with {PERCENT} interval'
    )
    if covered is not None:
        caption += (
            f', <span style="color:{TRUE_COLOR}">true</span>. '
            f"The intervals cover {covered} of {translation.counts.size} taxels"
        )
    return (
        f'<figure data-name="intervals"><svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" '
        f'aria-label="Intervals">{"".join(parts)}</svg><figcaption>{caption}.</figcaption></figure>'
    )


def taxels_html(translation: Translation) -> str:
    """Table of the intervals, one row per taxel; empty for a run without intervals."""
    if translation.interval is None:
        return ""
    low, high = (np.rint(end).astype(int) for end in translation.interval)
    heads, rows = ["predicted", f"{PERCENT} interval"], []
    truth = None if translation.truth is None else np.rint(translation.truth).astype(int)
    for n, count in enumerate(np.rint(translation.counts).astype(int)):
        cells, outside = [f"{count:,}", f"{low[n]:,} to {high[n]:,}"], False
        if truth is not None:
            cells.append(f"{truth[n]:,}")
            outside = not low[n] <= truth[n] <= high[n]
        rows.append((f"taxel {n}", cells, outside))
    if truth is not None:
        heads.append("true")
    return _table(heads, rows, 'data-name="taxels"')


def _table(heads: list[str], rows: list[tuple[str, list[str], bool]], attribute: str) -> str:
    """heads: HTML. rows: name, cells, and whether the row is highlighted."""
    head = "".join(f"<th>{each}</th>" for each in heads)
    body = ""
    for name, cells, highlighted in rows:
        values = "".join(f"<td>{cell}</td>" for cell in cells)
        body += f"<tr{' class=off' if highlighted else ''}><th>{name}</th>{values}</tr>"
    return (
        f"<table {attribute}><thead><tr><th></th>{head}</tr></thead><tbody>{body}</tbody></table>"
    )


def _end(translation: Translation) -> float:
    """Upper end of the chart, counts: the maximum, rounded up to two digits."""
    assert translation.interval is not None
    high = max(float(translation.interval[1].max()), 1.0)
    if translation.truth is not None:
        high = max(high, float(translation.truth.max()))
    step = 10.0 ** (np.floor(np.log10(high)) - 1)
    return float(np.ceil(high / step) * step)


def _y(counts: float, end: float) -> float:
    return HEIGHT - 6.0 - (HEIGHT - 16.0) * counts / end


def _grid(end: float) -> str:
    lines = ""
    for counts in (0.0, end / 2, end):
        y = _y(counts, end)
        lines += (
            f'<line x1="{LEFT}" x2="{WIDTH}" y1="{y:.1f}" y2="{y:.1f}" stroke="currentColor" '
            f'opacity="0.2"/><text x="{LEFT - 5}" y="{y + 3.5:.1f}" text-anchor="end" '
            f'font-size="11" fill="currentColor" opacity="0.8">{counts:,.0f}</text>'
        )
    return lines


def _taxel(translation: Translation, n: int, low: float, high: float, end: float) -> str:
    """One taxel: interval as a bar, prediction as a disc, true count as a line."""
    pitch = (WIDTH - LEFT) / translation.counts.size
    x, half = LEFT + (n + 0.5) * pitch, min(0.3 * pitch, 6.0)
    top, bottom = _y(high, end), _y(low, end)
    # Intervals have a minimum height, so that narrow ones are visible.
    drawn = (
        f'<rect x="{x - half:.1f}" width="{2 * half:.1f}" y="{top - 0.5:.1f}" '
        f'height="{bottom - top + 1:.1f}" fill="{PREDICTED_COLOR}" opacity="0.35"/>'
        f'<circle cx="{x:.1f}" cy="{_y(float(translation.counts[n]), end):.1f}" r="{half / 2:.1f}" '
        f'fill="{PREDICTED_COLOR}"/>'
    )
    if translation.truth is not None:
        y = _y(float(translation.truth[n]), end)
        drawn += (
            f'<line x1="{x - 1.4 * half:.1f}" x2="{x + 1.4 * half:.1f}" y1="{y:.1f}" '
            f'y2="{y:.1f}" stroke="{TRUE_COLOR}" stroke-width="2"/>'
        )
    return drawn
