"""Near-duplicates: pairs that differ from another pair of the same shape by less than the noise."""

import numpy as np
from matplotlib.figure import Figure

from t2twin.report.dataset.scan import BLOCK_PX, Scan
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import shape_name

NOISE_GREY = 0.5
"""Noise of images of imported datasets, grey levels: that of simulated ones."""

DUPLICATE_SHARE = 0.0005
"""Difference of the counts of two equal pairs, relative to full scale (assumed: 20 of 40,000
counts, four times the difference of two readings of one press)."""

MAX_LISTED = 5
"""Number of listed shapes."""

BINS = 60
WIDTH_IN, HEIGHT_IN = 9.0, 2.6


def section(dataset: Dataset, scan: Scan) -> str:
    """Share of near-duplicates and of ambiguous pairs."""
    noise = noise_grey(dataset)
    duplicates, similar = near_duplicates(dataset, scan), np.isfinite(scan.alike_counts)
    ambiguous = similar & ~duplicates
    text = (
        "Two images of a shape are indistinguishable if they differ by less than the noise of an "
        f"image, {noise:.2f} grey levels (RMS over blocks of {BLOCK_PX} × {BLOCK_PX} pixels, in "
        "which averaging reduces the noise to an eighth). If their counts also differ by less than "
        f"{same_counts(dataset):.3g} (RMS), the pairs are near-duplicates: "
        f"{duplicates.sum():,} of {duplicates.size:,} pairs, {100 * duplicates.mean():.2f} %"
        f"{_most_frequent(dataset, duplicates)}. An example is a round shape, pressed at its "
        f"center with different yaw. {ambiguous.sum():,} further pairs, "
        f"{100 * ambiguous.mean():.2f} %, have an indistinguishable image but different counts"
        f"{_most_frequent(dataset, ambiguous)}. An example is a line whose ends lie outside the "
        "image. No translator can distinguish such pairs."
    )
    chart = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _histogram(page, scan, noise))
    return markup.section(
        "duplicates",
        "Near-duplicates",
        [
            markup.paragraph(text),
            markup.embed(chart, "svg", "Histogram of the differences between nearest images"),
        ],
    )


def noise_grey(dataset: Dataset) -> float:
    """Standard deviation of the image noise, grey levels."""
    parameters = dataset.info.parameters
    return NOISE_GREY if parameters is None else parameters.digit.noise_grey


def near_duplicates(dataset: Dataset, scan: Scan) -> np.ndarray:
    """(P,) bool: near-duplicates of another pair."""
    return scan.alike_counts < same_counts(dataset)


def same_counts(dataset: Dataset) -> float:
    """RMS difference of the counts below which pairs are equal."""
    return DUPLICATE_SHARE * dataset.layout.full_scale_counts


def _most_frequent(dataset: Dataset, which: np.ndarray) -> str:
    """The most frequent shapes of the pairs `which`, (P,) bool, in brackets."""
    if not which.any():
        return ""
    names, numbers = np.unique(dataset.shapes[which], return_counts=True)
    order = np.argsort(-numbers, kind="stable")[:MAX_LISTED]
    listed = ", ".join(f"{shape_name(str(names[i]))}: {numbers[i]}" for i in order)
    return f" (most frequent: {listed})"


def _histogram(page: Figure, scan: Scan, noise: float) -> None:
    axes = page.subplots()
    values = scan.nearest_grey[np.isfinite(scan.nearest_grey)]
    if values.size:
        low = max(float(values.min()), 1e-2)
        bins = np.geomspace(min(low, noise) / 1.2, max(float(values.max()), noise) * 1.2, BINS)
        axes.hist(np.maximum(values, low), bins.tolist(), color="#0072b2")
    axes.axvline(noise, color="#d55e00", linewidth=1.0)
    axes.set(
        xlabel="difference from the nearest image of the same shape, grey levels; line: noise of "
        "one image",
        ylabel="pairs",
        xscale="log",
    )
