"""Pairs that stand out: near-duplicates of another, and those far from the rest of their shape."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report import markup
from t2twin.report.figures import digit_picture, figure
from t2twin.report.material import Dataset
from t2twin.report.scan import BLOCK_PX, Scan

NOISE_GREY = 0.5
"""Noise of a picture whose dataset does not say: that of the simulated ones, grey levels."""

DUPLICATE_SHARE = 0.0005
"""Difference of two pairs' taxels, in parts of full scale, below which they are the same (assumed:
20 of 40,000 counts, four times what two readings of one press differ by)."""

NAMED = 5
"""Shapes named as those with most."""

SHOWN = 12
BINS = 60
MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

LEAST_SCALE = 0.02
"""Least standard deviation taken, in parts of the median: less is no spread worth speaking of."""

WIDTH_IN, HEIGHT_IN = 9.0, 2.6
PANELS, PANEL_IN, LINE_IN = 6, 1.5, 2.3
"""Panels in a line, their width and the line's height, inches."""


def duplicates_section(dataset: Dataset, scan: Scan) -> str:
    """The share of near-duplicates, with what is meant by it."""
    noise = noise_grey(dataset)
    duplicates, alike = near_duplicates(dataset, scan), np.isfinite(scan.alike_counts)
    text = (
        "Two presses of a shape look alike where their pictures differ by less than a picture's "
        f"own noise, {noise:.2f} grey levels (root mean square over squares of {BLOCK_PX} x "
        f"{BLOCK_PX} pixels, in which the noise itself has fallen to an eighth). Where their "
        f"taxels are alike too, within {same_counts(dataset):.0f} counts (root mean square), one "
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
            markup.picture(chart, "svg", "Histogram of the differences between nearest pictures"),
        ],
    )


def noise_grey(dataset: Dataset) -> float:
    """Standard deviation of a picture's noise, grey levels."""
    return dataset.info.get("parameters", {}).get("digit", {}).get("noise_grey", NOISE_GREY)


def near_duplicates(dataset: Dataset, scan: Scan) -> np.ndarray:
    """(P,) whether each pair is one of another."""
    return scan.alike_counts < same_counts(dataset)


def same_counts(dataset: Dataset) -> float:
    """Difference of two pairs' taxels below which they are the same, counts."""
    return DUPLICATE_SHARE * dataset.layout.full_scale_counts


def _most(dataset: Dataset, found: np.ndarray) -> str:
    """The shapes that most of them are of, in brackets."""
    if not found.any():
        return ""
    shapes = np.array([dataset.tables[s]["shape"][r].as_py() for s, r in dataset.places])
    names, times = np.unique(shapes[found], return_counts=True)
    order = np.argsort(-times, kind="stable")[:NAMED]
    return " (most of " + ", ".join(f"{names[i]}, {times[i]}" for i in order) + ")"


def outliers_section(dataset: Dataset, scan: Scan) -> str:
    """The pairs that are farthest from the others of their shape."""
    rows = outliers(dataset, scan)
    text = (
        "The pairs farthest from the median of their shape in the sum of their counts, in depth, "
        "or in their picture, in robust standard deviations (from the median absolute deviation). "
        "Rims and corners of a shape are far from its middle by right; a press that missed or a "
        "picture that broke would stand here too."
    )
    lines = -(-len(rows) // PANELS)
    content = figure(
        "png", PANEL_IN * PANELS, LINE_IN * lines, lambda page: _panels(page, dataset, rows)
    )
    return markup.section(
        "outliers",
        "Outliers",
        [
            markup.paragraph(text, "note"),
            markup.picture(content, "png", "DIGIT pictures of the farthest pairs"),
        ],
    )


def outliers(dataset: Dataset, scan: Scan) -> list[tuple[int, str, float]]:
    """Place of each pair shown, the quantity that is far off, and by how many deviations."""
    shapes = np.array([dataset.tables[s]["shape"][r].as_py() for s, r in dataset.places])
    quantities = {"counts": dataset.counts.sum(axis=1), "picture": scan.off_grey}
    if dataset.is_simulated:
        quantities |= {
            f"{sensor} depth": dataset.column(f"{sensor}_depth_mm")
            for sensor in ("digit", "cyskin")
        }
    far = {name: deviations(values, shapes) for name, values in quantities.items()}
    names = list(far)
    table = np.stack([far[name] for name in names])
    which, most = table.argmax(axis=0), table.max(axis=0)
    order = np.argsort(-most, kind="stable")[:SHOWN]
    return [(int(place), names[which[place]], float(most[place])) for place in order]


def deviations(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """How far each value is from its group's median, in robust standard deviations: (P,).

    The deviation is at least LEAST_SCALE of the median.
    """
    far = np.zeros(values.size)
    for group in np.unique(groups):
        mine = groups == group
        off = np.abs(values[mine] - np.median(values[mine]))
        least = LEAST_SCALE * abs(np.median(values[mine]))
        scale = max(MAD_TO_SIGMA * float(np.median(off)), least)
        far[mine] = off / scale if scale > 0 else 0.0
    return far


def _panels(page: Figure, dataset: Dataset, rows: list[tuple[int, str, float]]) -> None:
    lines = -(-len(rows) // PANELS)
    axes: list[Axes] = list(np.ravel(page.subplots(lines, PANELS, squeeze=False)))
    for place in axes:
        place.set_axis_off()
    for place, (pair, quantity, far) in zip(axes, rows, strict=False):
        split, row = dataset.places[pair]
        shape = dataset.tables[split]["shape"][row].as_py()
        index = dataset.tables[split]["index"][row].as_py()
        digit_picture(place, dataset.picture(split, row))
        place.set_title(f"{shape}, {index}\n{quantity} {far:.1f}", fontsize=7.5)


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
