"""Content of a dataset: summary, pairs and images of the shapes, saturation."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from t2twin.report.dataset.pairs import example, sample_in_turn
from t2twin.report.dataset.scan import Scan, near_duplicates
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import SPLIT_COLORS, SPLIT_NAMES, shape_name

MIN_CONTACT_COUNTS = 100
"""Smallest maximum count of a pair with contact: more than ten times the noise."""

MAX_BARS = 100
"""Maximum number of bars (assumed: three printed pages)."""

GALLERY_COLUMNS, MAX_IMAGES = 10, 60
GALLERY_SEED = 0
WIDTH_IN = 9.0
BARS_WIDTH_IN, BAR_IN, MARGINS_IN = 4.4, 0.17, 0.8
"""Width of the bar chart, which fits on a phone; height of a bar and of the margins, inches."""

SATURATION_IN = 2.8
TILE_IN = 1.42


def summary(dataset: Dataset, scan: Scan) -> dict[str, Any]:
    """Shares of unusual pairs and counts, and the pair with the median maximum count."""
    largest = dataset.counts.max(axis=1)
    place = int(np.argsort(largest, kind="stable")[(largest.size - 1) // 2])
    split, row = dataset.places[place]
    return {
        "shapes": np.unique(dataset.shapes).size,
        "near_duplicates": _share(near_duplicates(dataset, scan)),
        "without_contact": _share(largest < MIN_CONTACT_COUNTS),
        "saturated": _share(dataset.saturated),
        "min_contact_counts": MIN_CONTACT_COUNTS,
        "example": example(dataset, split, row),
        "shape": dataset.row(split, row)["shape"],
        "largest": largest[place],
    }


def _share(which: np.ndarray) -> str:
    """The share of True values, such as "1.2 %", or "none"."""
    return f"{100 * which.mean():.2g} %" if which.any() else "none"


def about(dataset: Dataset) -> dict[str, Any]:
    """Number of shapes by split, size of the dataset, and pairs without contact."""
    sizes = [(dataset.data / path).stat().st_size for path in dataset.info.shards]
    largest = dataset.counts.max(axis=1)
    return {
        "shapes": {s: len(table["shape"].unique()) for s, table in dataset.tables.items()},
        "size_bytes": sum(sizes),
        "pairs": largest.size,
        "without_contact": int((largest < MIN_CONTACT_COUNTS).sum()),
        "min_contact_counts": MIN_CONTACT_COUNTS,
    }


def shapes(dataset: Dataset) -> dict[str, Any]:
    """Bar chart of the pairs per shape; of more than MAX_BARS shapes, per family."""
    number = np.unique(dataset.shapes).size
    by_shape = number <= MAX_BARS
    counted = counted_by_split(dataset, dataset.shapes if by_shape else dataset.families)
    shown = dict(list(counted.items())[:MAX_BARS])
    height = MARGINS_IN + BAR_IN * len(shown)
    return {
        "shapes": number,
        "by_shape": by_shape,
        "hidden": len(counted) - len(shown),
        "chart": figure("svg", BARS_WIDTH_IN, height, lambda page: bars(page, shown)),
    }


def counted_by_split(dataset: Dataset, names: np.ndarray) -> dict[tuple[str, str], int]:
    """Number of pairs by split and name, in the order of the shards.

    Of more than MAX_BARS names, in descending order. names: (P,).
    """
    splits = np.repeat(list(dataset.tables), [len(table) for table in dataset.tables.values()])
    counted = Counter(zip(splits.tolist(), names.tolist(), strict=True))
    return dict(counted.most_common()) if len(counted) > MAX_BARS else dict(counted)


def gallery(dataset: Dataset) -> list[tuple[str, int]]:
    """Splits and rows of the sampled images: one of each shape, then further ones of each."""
    return sample_in_turn(dataset, dataset.shapes, MAX_IMAGES, GALLERY_SEED)


def images(dataset: Dataset) -> dict[str, Any]:
    """Grid of images of all shapes."""
    rows = gallery(dataset)
    height = TILE_IN * -(-len(rows) // GALLERY_COLUMNS)
    return {"grid": figure("png", WIDTH_IN, height, lambda page: tiles(page, dataset, rows))}


def saturation_chart(dataset: Dataset) -> dict[str, Any]:
    """Histograms of saturated counts by pair and by taxel."""
    chart = figure("svg", WIDTH_IN, SATURATION_IN, lambda page: saturation(page, dataset))
    return {"saturated": dataset.saturated, "chart": chart}


def bars(page: Figure, counted: Mapping[tuple[str, str], int]) -> None:
    """counted: number of pairs by split and name, in the order of the bars."""
    axes = page.subplots()
    for split in dict.fromkeys(split for split, _ in counted):
        own = [n for n, (where, _) in enumerate(counted) if where == split]
        pairs = [number for (where, _), number in counted.items() if where == split]
        axes.barh(own, pairs, 0.8, color=SPLIT_COLORS[split], label=SPLIT_NAMES[split])
    axes.set_yticks(range(len(counted)), [shape_name(name) for _, name in counted], fontsize=7.5)
    axes.set(xlabel="pairs", ylim=(len(counted) - 0.4, -0.6))
    axes.locator_params(axis="x", integer=True)
    axes.legend()


def tiles(page: Figure, dataset: Dataset, rows: list[tuple[str, int]]) -> None:
    """rows: splits and rows of the images."""
    grid = page.subplots(-(-len(rows) // GALLERY_COLUMNS), GALLERY_COLUMNS, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for axes, (split, row) in zip(grid.flat, rows, strict=False):
        axes.imshow(dataset.image(split, row))
        axes.set_title(shape_name(dataset.row(split, row)["shape"]), fontsize=6)


def saturation(page: Figure, dataset: Dataset) -> None:
    largest, number, array = page.subplots(1, 3)
    counts, full_scale = dataset.counts, dataset.layout.full_scale_counts
    largest.hist(counts.max(axis=1), np.linspace(0, full_scale, 41).tolist(), color="#0072b2")
    largest.set(xlabel="largest count of a pair", ylabel="pairs")
    largest.xaxis.set_major_formatter("{x:,.0f}")
    largest.locator_params(axis="x", nbins=4)
    saturated = dataset.saturated
    times = np.bincount(saturated.sum(axis=1))
    number.bar(range(times.size), times, color="#0072b2")
    number.set(xlabel="saturated taxels of a pair", ylabel="pairs", yscale="log")
    number.locator_params(axis="x", integer=True)
    drawn = array.scatter(
        dataset.layout.x_mm,
        dataset.layout.y_mm,
        c=100 * saturated.mean(axis=0),
        s=70,
        edgecolors="#444444",
        linewidths=0.4,
    )
    array.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
    array.margins(0.15)
    array.invert_yaxis()
    page.colorbar(drawn, ax=array, label="saturated, % of the pairs")
