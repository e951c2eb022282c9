"""Contact forces, depths and counts of the presses, and presses that failed."""

from collections import Counter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
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

COUNTS_TICKS = 5
WIDTH_IN, HEIGHT_IN, DEPTHS_IN = 9.0, 2.9, 3.2


def section(dataset: Dataset) -> str:
    """Histograms of forces and counts, depths by family, and a table."""
    charts = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: forces_and_counts(page, dataset))
    depths = figure("svg", WIDTH_IN, DEPTHS_IN, lambda page: depths_in(page, dataset))
    counts = dataset.counts
    full_scale = dataset.layout.full_scale_counts
    return markup.section(
        "forces",
        "Forces, depths, counts",
        [
            markup.facts(_numbers(dataset)),
            *_commanded(dataset),
            markup.embed(
                charts,
                "svg",
                "Histograms of the contact forces and of the counts",
                note="Left: difference between the contact force (integral of the contact "
                f"pressure) and the commanded force, {counts.shape[0]:,} pairs. Right: "
                f"{counts.size:,} counts; {_saturation(dataset.saturated)} at {full_scale:,.0f}.",
            ),
            markup.embed(
                depths,
                "svg",
                "Depths of the presses by family for both sensors",
                note="Depth from the first contact. Boxes: quartiles and median; whiskers: minimum "
                f"and maximum.{_hidden_families(dataset)}",
            ),
        ],
    )


def _commanded(dataset: Dataset) -> list[str]:
    """Histogram of several commanded forces, and depths against force."""
    if dataset.forces_n.size < 2:
        return []
    content = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: commanded_and_depths(page, dataset))
    return [
        markup.embed(
            content,
            "svg",
            "Histogram of the commanded forces, and depths against force for both sensors",
            note="Left: commanded forces, without pairs without contact. Right: depth from the "
            "first contact, median and quartiles.",
        )
    ]


def _numbers(dataset: Dataset) -> list[tuple[str, str]]:
    commanded = dataset.column("force_n")
    pairs = commanded.size
    touching = commanded > 0
    facts = [("Commanded", _range(commanded[touching], "N"))]
    if not touching.all():
        without = _of(int((~touching).sum()), pairs)
        facts[0] = ("Commanded", f"{facts[0][1]}; {without} without contact")
    for sensor in SENSORS:
        error = dataset.column(f"{sensor}_force_n")[touching] / commanded[touching] - 1.0
        unsettled = int(pairs - dataset.column(f"{sensor}_settled").sum())
        bottomed = int(dataset.column(f"{sensor}_bottomed").sum())
        facts.append(
            (
                SENSOR_NAMES[sensor],
                f"maximum force error {_percent(100 * np.abs(error).max())} %; not converged: "
                f"{_of(unsettled, pairs)}; base plate in contact: {_of(bottomed, pairs)}; "
                f"depth {_range(dataset.column(f'{sensor}_depth_mm')[touching], 'mm')}",
            )
        )
    return facts


def _hidden_families(dataset: Dataset) -> str:
    families = np.unique(dataset.families).size
    if families <= MAX_FAMILIES:
        return ""
    return f" Shown are the {MAX_FAMILIES} of {families:,} families with the most pairs."


def _of(number: int, pairs: int) -> str:
    return f"none of {pairs:,}" if number == 0 else f"{number:,} of {pairs:,}"


def _percent(value: float) -> str:
    """Two significant digits, at least 0.001."""
    return f"{value:.2g}" if value >= 1e-3 else "0.001"


def _saturation(saturated: np.ndarray) -> str:
    """saturated: (P, N) bool."""
    if not saturated.any():
        return "none is saturated"
    return (
        f"{100 * saturated.mean():.2g} % are saturated, at least one in "
        f"{100 * saturated.any(axis=1).mean():.2g} % of the pairs,"
    )


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
        low_quartile, median, high_quartile = np.array(spread).T
        color = SENSOR_COLORS[sensor]
        right.plot(middles, median, "o-", color=color, markersize=3, label=SENSOR_NAMES[sensor])
        right.fill_between(
            middles, low_quartile, high_quartile, color=color, alpha=0.2, linewidth=0
        )
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
            widths=0.28,
            whis=(0, 100),
            patch_artist=True,
            boxprops={"facecolor": color, "alpha": 0.65, "linewidth": 0.6},
            medianprops={"color": "#111111", "linewidth": 1.0},
            whiskerprops={"linewidth": 0.7},
            capprops={"linewidth": 0.7},
        )
        boxes["boxes"][0].set_label(SENSOR_NAMES[sensor])
    axes.set_xticks(range(len(names)), [name.replace("-", "-\n") for name in names])
    axes.set(ylabel="depth, mm", ylim=(0, None))
    axes.legend()
