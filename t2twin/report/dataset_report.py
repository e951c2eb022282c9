"""The report of a dataset: one self-contained HTML page."""

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.core import arguments
from t2twin.core.draw import draw_discs, figure, force_axis
from t2twin.report import pairs
from t2twin.report.data import MIN_CONTACT_SHARE, Array, Dataset, read_dataset
from t2twin.report.page import (
    SENSOR_COLORS,
    SPLIT_COLORS,
    SPLIT_NAMES,
    check_out,
    forces_text,
    shape_name,
    write_page,
)

MAX_BARS = 100
"""Maximum number of bars (assumed: three printed pages)."""

GALLERY_COLUMNS, MAX_IMAGES = 10, 60
GALLERY_SEED = 0
BARS_WIDTH_IN, BAR_IN, MARGINS_IN = 4.4, 0.17, 1.0
"""Width of the bar chart, which fits on a phone; height of a bar and of the margins, inches."""

SATURATION_IN = 2.8
MIN_BARS = 4
"""Height of the charts of saturation, inches; smallest range of saturated taxels of a pair."""

TILE_TITLE_IN = 0.22
"""Height of the title of an image of the grid, inches."""

BINS = 40
FORCE_BINS = 12
"""Number of bins of the commanded forces, equal in the logarithm."""

MAX_FAMILIES = 24
"""Maximum number of families in the chart of depths (assumed: space for their names)."""

MIN_PERCENT = 0.001
"""Smallest displayed force error, percent."""

COUNTS_TICKS = 5
WIDTH_IN, HEIGHT_IN, DEPTHS_IN = 9.0, 2.9, 3.2


def summary(dataset: Dataset) -> dict[str, Any]:
    """Shares of unusual pairs and counts, and the pair with the median maximum count, or without
    taxel arrays with the median depth.
    """
    arrays = dataset.arrays
    sizes = dataset.array.largest if arrays else dataset.contact("source", "depth_mm")
    place = int(np.argsort(sizes, kind="stable")[(sizes.size - 1) // 2])
    split, row = dataset.places[place]
    return {
        "shapes": np.unique(dataset.column("shape")).size,
        "without_contact": _share(dataset.without_contact),
        "contact": _contact(dataset),
        "saturated": {dataset.label(role): _share(one.saturated) for role, one in arrays.items()},
        "example": pairs.example(dataset, split, row),
        "shape": dataset.row(split, row)["shape"],
        "median": f"{sizes[place]:,.0f}" if arrays else f"{sizes[place]:.2f}",
    }


def _share(which: np.ndarray) -> str:
    """The share of True values, such as "1.2 %", or "none"."""
    return f"{100 * which.mean():.2g} %" if which.any() else "none"


def _contact(dataset: Dataset) -> str:
    """The condition by which a pair has no contact, in words."""
    if not dataset.arrays:
        return "commanded force of 0 N"
    return f"no count exceeds the noise at rest and {100 * MIN_CONTACT_SHARE:g} % of full scale"


def about(dataset: Dataset) -> dict[str, Any]:
    """Number of shapes by split, size of the dataset, and pairs without contact."""
    sizes = [(dataset.data / path).stat().st_size for path in dataset.info.shards]
    mib, without_contact = sum(sizes) / 2**20, dataset.without_contact
    return {
        "shapes": {s: len(table["shape"].unique()) for s, table in dataset.tables.items()},
        "size": f"{mib:,.0f}" if mib >= 10 else f"{mib:.1f}",
        "pair_kb": sum(sizes) / without_contact.size / 1e3,
        "pairs": without_contact.size,
        "without_contact": int(without_contact.sum()),
        "contact": _contact(dataset),
    }


def shapes(dataset: Dataset) -> dict[str, Any]:
    """Bar chart of the pairs per shape; of more than MAX_BARS shapes, per family."""
    number = np.unique(dataset.column("shape")).size
    by_shape = number <= MAX_BARS
    counted = counted_by_split(
        dataset, dataset.column("shape") if by_shape else dataset.column("family")
    )
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
    counted = Counter(zip(dataset.splits.tolist(), names.tolist(), strict=True))
    return dict(counted.most_common()) if len(counted) > MAX_BARS else dict(counted)


def images(dataset: Dataset) -> dict[str, Any] | None:
    """Grid of images of all shapes for each gel camera; None without one."""
    grids = {role: grid_of(dataset, role) for role in dataset.cameras}
    return {"grids": grids} if grids else None


def grid_of(dataset: Dataset, role: str) -> bytes:
    """Content of a PNG file with images of a gel camera: one of each shape, then further ones."""
    rows = pairs.sample_in_turn(dataset, dataset.column("shape"), MAX_IMAGES, GALLERY_SEED)
    lines = -(-len(rows) // GALLERY_COLUMNS)

    def draw(page: Figure) -> None:
        grid = page.subplots(lines, GALLERY_COLUMNS, squeeze=False)
        for axes in grid.flat:
            axes.set_axis_off()
        for axes, (split, row) in zip(grid.flat, rows, strict=False):
            axes.imshow(dataset.image(split, row, role))
            axes.set_title(shape_name(dataset.row(split, row)["shape"]), fontsize=6)

    rows_px, columns_px, _ = dataset.image(*rows[0], role).shape
    height_in = WIDTH_IN / GALLERY_COLUMNS * rows_px / columns_px
    return figure("png", WIDTH_IN, (height_in + TILE_TITLE_IN) * lines, draw)


def bars(page: Figure, counted: Mapping[tuple[str, str], int]) -> None:
    """counted: number of pairs by split and name, in the order of the bars."""
    axes = page.subplots()
    for split in dict.fromkeys(split for split, _ in counted):
        own = {n: pairs for n, ((s, _), pairs) in enumerate(counted.items()) if s == split}
        axes.barh([*own], [*own.values()], 0.8, color=SPLIT_COLORS[split], label=SPLIT_NAMES[split])
    axes.set_yticks(range(len(counted)), [shape_name(name) for _, name in counted], fontsize=7.5)
    axes.set(xlabel="pairs", ylim=(len(counted) - 0.4, -0.6))
    axes.locator_params(axis="x", integer=True)
    page.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)


def saturation_charts(dataset: Dataset) -> dict[str, Any] | None:
    """Chart of the saturated counts of each taxel array, by pair and by taxel; None without one."""
    charts = {
        role: figure("svg", WIDTH_IN, SATURATION_IN, partial(saturation, array=array))
        for role, array in dataset.arrays.items()
    }
    return {"charts": charts} if charts else None


def saturation(page: Figure, array: Array) -> None:
    largest, number, places = page.subplots(1, 3)
    full_scale, layout, saturated = array.full_scale, array.layout, array.saturated
    largest.hist(array.largest, np.linspace(0, full_scale, 41).tolist(), color="#0072b2")
    largest.set(xlabel="largest count of a pair", ylabel="pairs")
    largest.xaxis.set_major_formatter("{x:,g}")
    largest.locator_params(axis="x", nbins=4)
    times = np.bincount(saturated.sum(axis=1))
    number.bar(range(times.size), times, color="#0072b2")
    number.set(xlabel="saturated taxels of a pair", ylabel="pairs", yscale="log")
    number.set(xlim=(-0.6, max(times.size, MIN_BARS) - 0.4), ylim=(0.5, None))
    number.locator_params(axis="x", integer=True)
    percent = 100 * saturated.mean(axis=0)
    drawn = draw_discs(
        places, layout.x_mm, layout.y_mm, layout.pad_diameter_mm, array=percent,
        clim=(0.0, max(float(percent.max()), 1.0)), edgecolors="#444444", linewidths=0.4,
    )  # fmt: skip
    margin = layout.pad_diameter_mm.max()
    low, high = layout.x_mm.min() - margin, layout.x_mm.max() + margin
    places.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", xlim=(low, high))
    places.set_ylim(layout.y_mm.max() + margin, layout.y_mm.min() - margin)
    page.colorbar(drawn, ax=places, label="saturated, % of the pairs")


def forces(dataset: Dataset) -> dict[str, Any] | None:
    """Ranges by sensor, histograms of forces and counts, depths by family and by force.

    None for imported pairs, which have neither contact forces nor depths.
    """
    if not dataset.info.is_simulated:
        return None
    commanded = dataset.column("force_n")
    contact = commanded > 0
    families = np.unique(dataset.column("family")).size

    def chart(draw: Callable[[Figure, Dataset], None], height_in: float = HEIGHT_IN) -> bytes:
        return figure("svg", WIDTH_IN, height_in, lambda page: draw(page, dataset))

    return {
        "title": forces_title(dataset),
        "commanded": _range(commanded[contact], "N"),
        "without_contact": int((~contact).sum()),
        "sensors": [_sensor(dataset, role) for role in dataset.info.sensors],
        "pairs": commanded.size,
        "families": families,
        "max_families": MAX_FAMILIES,
        "by_force": chart(commanded_and_depths) if dataset.forces_n.size > 1 else None,
        "histograms": chart(forces_and_counts),
        "depths": chart(depths_in, DEPTHS_IN),
    }


def forces_title(dataset: Dataset) -> str:
    """Title of the section `forces`."""
    return "Forces, depths, counts" if dataset.arrays else "Forces and depths"


def _sensor(dataset: Dataset, role: str) -> dict[str, Any]:
    """Force error, failed presses and depths of a sensor."""
    commanded = dataset.column("force_n")
    contact = commanded > 0
    error = dataset.contact(role, "force_n")[contact] / commanded[contact] - 1.0
    percent = 100 * np.abs(error).max(initial=0.0)
    return {
        "name": dataset.label(role),
        "error_percent": f"{percent:.2g}" if percent >= MIN_PERCENT else f"{MIN_PERCENT:g}",
        "not_converged": int((~dataset.contact(role, "settled").astype(bool)).sum()),
        "bottomed": int(dataset.contact(role, "bottomed").sum()),
        "depth": _range(dataset.contact(role, "depth_mm")[contact], "mm"),
    }


def _range(values: np.ndarray, unit: str) -> str:
    low, high = f"{values.min():.2f}", f"{values.max():.2f}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def forces_and_counts(page: Figure, dataset: Dataset) -> None:
    left, *others = page.subplots(1, 1 + len(dataset.arrays), squeeze=False)[0]
    commanded, roles = dataset.column("force_n"), dataset.info.sensors
    errors = {role: 1e3 * (dataset.contact(role, "force_n") - commanded) for role in roles}
    limit = max(float(np.abs(values).max()) for values in errors.values()) or 1.0
    bins = np.linspace(-limit, limit, BINS + 1).tolist()
    for role, values in errors.items():
        label = dataset.label(role)
        left.hist(values, bins, color=SENSOR_COLORS[role], alpha=0.65, label=label)
    left.axvline(0.0, color="#222222", linewidth=0.8)
    commanded_text = forces_text(dataset.forces_n)
    left.set(xlabel=f"contact force − commanded ({commanded_text}), mN", ylabel="pairs")
    left.locator_params(axis="x", nbins=6)
    left.legend()
    for axes, role in zip(others, dataset.arrays, strict=True):
        _counts(axes, dataset, role)


def commanded_and_depths(page: Figure, dataset: Dataset) -> None:
    left, right = page.subplots(1, 2)
    commanded = dataset.column("force_n")
    touching = commanded > 0
    low, high = commanded[touching].min(), commanded[touching].max()
    edges = np.geomspace(low, high, FORCE_BINS + 1) if high > low else np.array([low, 2 * low])
    for split, color in SPLIT_COLORS.items():
        own = commanded[touching & (dataset.splits == split)]
        if own.size:
            left.hist(own, edges.tolist(), histtype="step", color=color, label=SPLIT_NAMES[split])
    left.set(xlabel="commanded force, N", ylabel="pairs")
    force_axis(left, low, high)
    left.legend()
    place = np.clip(np.searchsorted(edges, commanded, "right") - 1, 0, edges.size - 2)
    bins = [touching & (place == n) for n in range(edges.size - 1)]
    kept = [mine for mine in bins if mine.any()]
    middles = [float(np.median(commanded[mine])) for mine in kept]
    for role, color in SENSOR_COLORS.items():
        depths = dataset.contact(role, "depth_mm")
        spread = [np.quantile(depths[mine], (0.25, 0.5, 0.75)) for mine in kept]
        first, median, third = np.array(spread).T
        right.plot(middles, median, "o-", color=color, markersize=3, label=dataset.label(role))
        right.fill_between(middles, first, third, color=color, alpha=0.2, linewidth=0)
    right.set(xlabel="commanded force, N", ylabel="depth, mm", ylim=(0, None))
    force_axis(right, low, high)
    right.legend()


def _counts(axes: Axes, dataset: Dataset, role: str) -> None:
    bins = np.linspace(0.0, dataset.arrays[role].full_scale, BINS + 1).tolist()
    for split in dataset.tables:
        counts = dataset.arrays[role].counts[dataset.splits == split].ravel()
        weights = np.full(counts.size, 100.0 / counts.size)
        color, name = SPLIT_COLORS[split], SPLIT_NAMES[split]
        axes.hist(counts, bins, weights=weights, histtype="step", color=color, label=name)
    axes.set(
        xlabel=f"counts of {dataset.label(role)}", ylabel="% of the split's counts", yscale="log"
    )
    axes.xaxis.set_major_locator(MaxNLocator(COUNTS_TICKS))
    axes.xaxis.set_major_formatter("{x:,g}")
    axes.legend()


def depths_in(page: Figure, dataset: Dataset) -> None:
    touching = dataset.column("force_n") > 0
    families = dataset.column("family")[touching]
    names = list(dict.fromkeys(families.tolist()))
    if len(names) > MAX_FAMILIES:
        names = [name for name, _ in Counter(families.tolist()).most_common(MAX_FAMILIES)]
    axes = page.subplots()
    for place, (role, color) in enumerate(SENSOR_COLORS.items()):
        depths = dataset.contact(role, "depth_mm")[touching]
        boxes = axes.boxplot(
            [depths[families == name] for name in names],
            positions=(np.arange(len(names)) + 0.36 * (place - 0.5)).tolist(),
            widths=0.28, whis=(0, 100), patch_artist=True,
            boxprops={"facecolor": color, "alpha": 0.65, "linewidth": 0.6},
            medianprops={"color": "#111111", "linewidth": 1.0},
            whiskerprops={"linewidth": 0.7}, capprops={"linewidth": 0.7},
        )  # fmt: skip
        boxes["boxes"][0].set_label(dataset.label(role))
    axes.set_xticks(range(len(names)), [name.replace("-", "-\n") for name in names])
    axes.set(ylabel="depth, mm", ylim=(0, None))
    axes.legend()


TEMPLATES = ("report/templates/dataset.html",)


def write_data_report(out: str | Path, data: str | Path) -> Path:
    """Writes out/index.html, a self-contained page, and returns its path.

    data: a finished dataset, simulated or imported. Raises T2TwinError, before anything is written,
    if the dataset or the folder cannot be used.
    """
    out, data = arguments.path(out, "out"), arguments.path(data, "data")
    check_out(out)
    dataset = read_dataset(data)
    sections = {
        "summary": ("", partial(summary, dataset)),
        "about": ("", partial(about, dataset)),
        "shapes": ("Pairs by shape", partial(shapes, dataset)),
        "gallery": ("Images", partial(images, dataset)),
        "pairs": ("Pairs", partial(pairs.section, dataset)),
        "forces": (forces_title(dataset), partial(forces, dataset)),
        "saturation": ("Saturation", partial(saturation_charts, dataset)),
    }
    return write_page(out, f"The dataset in {data}", TEMPLATES, sections, dataset=dataset)
