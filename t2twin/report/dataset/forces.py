"""Contact forces, depths and counts of the presses, and presses that failed."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.report.dataset.tables import Dataset
from t2twin.report.html.figures import figure, force_axis
from t2twin.report.html.labels import (
    SENSOR_COLORS,
    SENSOR_NAMES,
    SPLIT_COLORS,
    SPLIT_NAMES,
    forces_text,
)
from t2twin.sim.dataset.store import taxels

SENSORS = ("digit", "cyskin")
BINS = 40
FORCE_BINS = 12
"""Number of bins of the commanded forces, equal in the logarithm."""

MAX_FAMILIES = 24
"""Maximum number of families in the chart of depths (assumed: space for their names)."""

MIN_PERCENT = 0.001
"""Smallest displayed force error, percent."""

COUNTS_TICKS = 5
WIDTH_IN, HEIGHT_IN, DEPTHS_IN = 9.0, 2.9, 3.2


def section(dataset: Dataset) -> dict[str, Any]:
    """Ranges by sensor, histograms of forces and counts, depths by family and by force."""
    commanded = dataset.column("force_n")
    contact = commanded > 0
    families = np.unique(dataset.families).size

    def chart(draw: Callable[[Figure, Dataset], None], height_in: float = HEIGHT_IN) -> bytes:
        return figure("svg", WIDTH_IN, height_in, lambda page: draw(page, dataset))

    return {
        "commanded": _range(commanded[contact], "N"),
        "without_contact": int((~contact).sum()),
        "sensors": [_sensor(dataset, sensor) for sensor in SENSORS],
        "pairs": commanded.size,
        "saturated": dataset.saturated,
        "families": families,
        "max_families": MAX_FAMILIES,
        "by_force": chart(commanded_and_depths) if dataset.forces_n.size > 1 else None,
        "histograms": chart(forces_and_counts),
        "depths": chart(depths_in, DEPTHS_IN),
    }


def _sensor(dataset: Dataset, sensor: str) -> dict[str, Any]:
    """Force error, failed presses and depths of a sensor."""
    commanded = dataset.column("force_n")
    contact = commanded > 0
    error = dataset.column(f"{sensor}_force_n")[contact] / commanded[contact] - 1.0
    percent = 100 * np.abs(error).max()
    return {
        "name": SENSOR_NAMES[sensor],
        "error_percent": f"{percent:.2g}" if percent >= MIN_PERCENT else f"{MIN_PERCENT:g}",
        "not_converged": int((~dataset.column(f"{sensor}_settled").astype(bool)).sum()),
        "bottomed": int(dataset.column(f"{sensor}_bottomed").sum()),
        "depth": _range(dataset.column(f"{sensor}_depth_mm")[contact], "mm"),
    }


def _range(values: np.ndarray, unit: str) -> str:
    low, high = f"{values.min():.2f}", f"{values.max():.2f}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def forces_and_counts(page: Figure, dataset: Dataset) -> None:
    left, right = page.subplots(1, 2)
    commanded = dataset.column("force_n")
    errors = {s: 1e3 * (dataset.column(f"{s}_force_n") - commanded) for s in SENSORS}
    limit = max(float(np.abs(values).max()) for values in errors.values()) or 1.0
    bins = np.linspace(-limit, limit, BINS + 1).tolist()
    for sensor, values in errors.items():
        left.hist(values, bins, color=SENSOR_COLORS[sensor], alpha=0.65, label=SENSOR_NAMES[sensor])
    left.axvline(0.0, color="#222222", linewidth=0.8)
    commanded_text = forces_text(dataset.forces_n)
    left.set(xlabel=f"contact force − commanded ({commanded_text}), mN", ylabel="pairs")
    left.locator_params(axis="x", nbins=6)
    left.legend()
    _counts(right, dataset)


def commanded_and_depths(page: Figure, dataset: Dataset) -> None:
    left, right = page.subplots(1, 2)
    commanded = dataset.column("force_n")
    touching = commanded > 0
    low, high = commanded[touching].min(), commanded[touching].max()
    edges = np.geomspace(low, high, FORCE_BINS + 1) if high > low else np.array([low, 2 * low])
    splits = np.repeat(list(dataset.tables), [len(table) for table in dataset.tables.values()])
    for split, color in SPLIT_COLORS.items():
        own = commanded[touching & (splits == split)]
        if own.size:
            left.hist(own, edges.tolist(), histtype="step", color=color, label=SPLIT_NAMES[split])
    left.set(xlabel="commanded force, N", ylabel="pairs")
    force_axis(left, low, high)
    left.legend()
    place = np.clip(np.searchsorted(edges, commanded, "right") - 1, 0, edges.size - 2)
    bins = [touching & (place == n) for n in range(edges.size - 1)]
    kept = [mine for mine in bins if mine.any()]
    middles = [float(np.median(commanded[mine])) for mine in kept]
    for sensor in SENSORS:
        depths = dataset.column(f"{sensor}_depth_mm")
        spread = [np.quantile(depths[mine], (0.25, 0.5, 0.75)) for mine in kept]
        first, median, third = np.array(spread).T
        color = SENSOR_COLORS[sensor]
        right.plot(middles, median, "o-", color=color, markersize=3, label=SENSOR_NAMES[sensor])
        right.fill_between(middles, first, third, color=color, alpha=0.2, linewidth=0)
    right.set(xlabel="commanded force, N", ylabel="depth, mm", ylim=(0, None))
    force_axis(right, low, high)
    right.legend()


def _counts(axes: Axes, dataset: Dataset) -> None:
    full_scale = dataset.layout.full_scale_counts
    bins = np.linspace(0.0, full_scale, BINS + 1).tolist()
    for split, color in SPLIT_COLORS.items():
        if split not in dataset.tables:
            continue
        counts = taxels(dataset.tables[split]).ravel()
        weights = np.full(counts.size, 100.0 / counts.size)
        name = SPLIT_NAMES[split]
        axes.hist(counts, bins, weights=weights, histtype="step", color=color, label=name)
    axes.set(xlabel="counts", ylabel="% of the split's counts", yscale="log")
    axes.xaxis.set_major_locator(MaxNLocator(COUNTS_TICKS))
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.legend()


def depths_in(page: Figure, dataset: Dataset) -> None:
    touching = dataset.column("force_n") > 0
    families = dataset.families[touching]
    names = list(dict.fromkeys(families.tolist()))
    if len(names) > MAX_FAMILIES:
        names = [name for name, _ in Counter(families.tolist()).most_common(MAX_FAMILIES)]
    axes = page.subplots()
    for place, sensor in enumerate(SENSORS):
        depths = dataset.column(f"{sensor}_depth_mm")[touching]
        color = SENSOR_COLORS[sensor]
        boxes = axes.boxplot(
            [depths[families == name] for name in names],
            positions=(np.arange(len(names)) + 0.36 * (place - 0.5)).tolist(),
            widths=0.28, whis=(0, 100), patch_artist=True,
            boxprops={"facecolor": color, "alpha": 0.65, "linewidth": 0.6},
            medianprops={"color": "#111111", "linewidth": 1.0},
            whiskerprops={"linewidth": 0.7}, capprops={"linewidth": 0.7},
        )  # fmt: skip
        boxes["boxes"][0].set_label(SENSOR_NAMES[sensor])
    axes.set_xticks(range(len(names)), [name.replace("-", "-\n") for name in names])
    axes.set(ylabel="depth, mm", ylim=(0, None))
    axes.legend()
