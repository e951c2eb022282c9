"""Near-duplicates: pairs that another pair of the same shape makes superfluous."""

import numpy as np
from matplotlib.figure import Figure

from t2twin.report.dataset.scan import BLOCK_PX, Scan
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import shape_name

NOISE_GREY = 0.5
"""Noise of a picture whose dataset does not say: that of the simulated ones, grey levels."""

DUPLICATE_SHARE = 0.0005
"""Difference of two pairs' taxels, in parts of full scale, below which they are the same (assumed:
20 of 40,000 counts, four times what two readings of one press differ by)."""

NAMED = 5
"""Shapes named as those with most."""

BINS = 60
WIDTH_IN, HEIGHT_IN = 9.0, 2.6


def section(dataset: Dataset, scan: Scan) -> str:
    """The share of near-duplicates, with what is meant by it."""
    noise = noise_grey(dataset)
    duplicates, alike = near_duplicates(dataset, scan), np.isfinite(scan.alike_counts)
    text = (
        "Two presses of a shape look alike where their pictures differ by less than a picture's "
        f"own noise, {noise:.2f} grey levels (root mean square over squares of {BLOCK_PX} x "
        f"{BLOCK_PX} pixels, in which the noise itself has fallen to an eighth). Where their "
        f"taxels are alike too, within {same_counts(dataset):.3g} counts (root mean square), one "
        "is a near-duplicate of the other and teaches nothing new: "
        f"{duplicates.sum():,} of {duplicates.size:,} pairs, {100 * duplicates.mean():.2f} %"
        f"{_most(dataset, duplicates)}. A round shape pressed in its middle is one however it is "
        f"turned. {(alike & ~duplicates).sum():,} more, "
        f"{100 * (alike & ~duplicates).mean():.2f} %, look like another press but feel otherwise"
        f"{_most(dataset, alike & ~duplicates)}: a line whose ends lie outside the picture looks "
        "the same wherever along it is pressed. Those are true pairs, of which no translator can "
        "tell one from the other."
    )
    chart = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _histogram(page, scan, noise))
    return markup.section(
        "duplicates",
        "Near-duplicates",
        [
            markup.paragraph(text),
            markup.embed(chart, "svg", "Histogram of the differences between nearest pictures"),
        ],
    )


def noise_grey(dataset: Dataset) -> float:
    """Standard deviation of a picture's noise, grey levels."""
    parameters = dataset.info.parameters
    return NOISE_GREY if parameters is None else parameters.digit.noise_grey


def near_duplicates(dataset: Dataset, scan: Scan) -> np.ndarray:
    """(P,) whether each pair is one of another."""
    return scan.alike_counts < same_counts(dataset)


def same_counts(dataset: Dataset) -> float:
    """Difference of two pairs' taxels below which they are the same, counts."""
    return DUPLICATE_SHARE * dataset.layout.full_scale_counts


def _most(dataset: Dataset, which: np.ndarray) -> str:
    """The shapes that most of the pairs `which` ((P,) bool) are of, in brackets."""
    if not which.any():
        return ""
    names, times = np.unique(dataset.shapes[which], return_counts=True)
    order = np.argsort(-times, kind="stable")[:NAMED]
    return " (most of " + ", ".join(f"{shape_name(str(names[i]))}, {times[i]}" for i in order) + ")"


def _histogram(page: Figure, scan: Scan, noise: float) -> None:
    axes = page.subplots()
    values = scan.nearest_grey[np.isfinite(scan.nearest_grey)]
    if values.size:
        low = max(float(values.min()), 1e-2)
        bins = np.geomspace(min(low, noise) / 1.2, max(float(values.max()), noise) * 1.2, BINS)
        axes.hist(np.maximum(values, low), bins.tolist(), color="#0072b2")
    axes.axvline(noise, color="#d55e00", linewidth=1.0)
    axes.set(
        xlabel="difference from the nearest picture of the same shape, grey levels; the line is "
        "the noise of one picture",
        ylabel="pairs",
        xscale="log",
    )
