"""What the presses came to: forces really carried, depths, counts, presses that went wrong."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.report import markup
from t2twin.report.dataset import Dataset
from t2twin.report.figures import figure
from t2twin.report.names import SENSOR_COLOURS, SENSOR_NAMES, SPLIT_COLOURS, SPLIT_NAMES
from t2twin.sim.dataset.store import taxels

SENSORS = ("digit", "cyskin")
BINS = 40
COUNTS_TICKS = 5
WIDTH_IN, HEIGHT_IN, DEPTHS_IN = 9.0, 2.9, 3.2


def section(dataset: Dataset) -> str:
    """Histograms of force and counts, depths by family, and the numbers that they come to."""
    charts = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: forces_and_counts(page, dataset))
    depths = figure("svg", WIDTH_IN, DEPTHS_IN, lambda page: depths_in(page, dataset))
    counts = dataset.counts
    full_scale = dataset.layout.full_scale_counts
    return markup.section(
        "forces",
        "Forces, depths, counts",
        [
            markup.facts(_numbers(dataset)),
            markup.picture(
                charts,
                "svg",
                "Histograms of the forces carried and of the counts",
                note="Left: the force that each sensor's contact pressure integrates to, less the "
                f"one commanded, over all {counts.shape[0]:,} pairs. Right: all {counts.size:,} "
                f"counts; {_saturation(dataset.saturated)} at {full_scale:,.0f}.",
            ),
            markup.picture(
                depths,
                "svg",
                "Depths of the presses by family for both sensors",
                note="How far a shape went in after its first touch. Boxes: quartiles and median; "
                "whiskers: all presses.",
            ),
        ],
    )


def _numbers(dataset: Dataset) -> list[tuple[str, str]]:
    commanded = dataset.column("force_n")
    pairs = commanded.size
    facts = [("Commanded", _range(commanded, "N"))]
    for sensor in SENSORS:
        off = dataset.column(f"{sensor}_force_n") / commanded - 1.0
        unsettled = int(pairs - dataset.column(f"{sensor}_settled").sum())
        bottomed = int(dataset.column(f"{sensor}_bottomed").sum())
        facts.append(
            (
                SENSOR_NAMES[sensor],
                f"carried within {_percent(100 * np.abs(off).max())} % of it at worst; "
                f"{_of(unsettled, pairs)} not settled, {_of(bottomed, pairs)} on the base plate; "
                f"depth {_range(dataset.column(f'{sensor}_depth_mm'), 'mm')}",
            )
        )
    return facts


def _of(number: int, pairs: int) -> str:
    return f"none of {pairs:,}" if number == 0 else f"{number:,} of {pairs:,}"


def _percent(value: float) -> str:
    """Two digits that count, down to a thousandth."""
    return f"{value:.2g}" if value >= 1e-3 else "0.001"


def _saturation(saturated: np.ndarray) -> str:
    """saturated: (P, N), which counts are."""
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
    off = {s: 1e3 * (dataset.column(f"{s}_force_n") - commanded) for s in SENSORS}
    most = max(float(np.abs(values).max()) for values in off.values()) or 1.0
    bins = np.linspace(-most, most, BINS + 1).tolist()
    for sensor, values in off.items():
        left.hist(
            values, bins, color=SENSOR_COLOURS[sensor], alpha=0.65, label=SENSOR_NAMES[sensor]
        )
    left.axvline(0.0, color="#222222", linewidth=0.8)
    at = ", ".join(f"{force:g}" for force in np.unique(commanded))
    left.set(xlabel=f"force carried less commanded ({at} N), mN", ylabel="pairs")
    left.legend()
    _counts(right, dataset)


def _counts(axes: Axes, dataset: Dataset) -> None:
    full_scale = dataset.layout.full_scale_counts
    bins = np.linspace(0.0, full_scale, BINS + 1).tolist()
    for split, colour in SPLIT_COLOURS.items():
        if split not in dataset.tables:
            continue
        counts = taxels(dataset.tables[split]).ravel()
        weights = np.full(counts.size, 100.0 / counts.size)
        name = SPLIT_NAMES[split]
        axes.hist(counts, bins, weights=weights, histtype="step", color=colour, label=name)
    axes.set(xlabel="counts", ylabel="% of the split's counts", yscale="log")
    axes.xaxis.set_major_locator(MaxNLocator(COUNTS_TICKS))
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.legend()


def depths_in(page: Figure, dataset: Dataset) -> None:
    families = dataset.families
    names = list(dict.fromkeys(families.tolist()))
    axes = page.subplots()
    for place, sensor in enumerate(SENSORS):
        depths = dataset.column(f"{sensor}_depth_mm")
        colour = SENSOR_COLOURS[sensor]
        boxes = axes.boxplot(
            [depths[families == name] for name in names],
            positions=(np.arange(len(names)) + 0.36 * (place - 0.5)).tolist(),
            widths=0.28,
            whis=(0, 100),
            patch_artist=True,
            boxprops={"facecolor": colour, "alpha": 0.65, "linewidth": 0.6},
            medianprops={"color": "#111111", "linewidth": 1.0},
            whiskerprops={"linewidth": 0.7},
            capprops={"linewidth": 0.7},
        )
        boxes["boxes"][0].set_label(SENSOR_NAMES[sensor])
    axes.set_xticks(range(len(names)), [name.replace("-", "-\n") for name in names])
    axes.set(ylabel="depth, mm", ylim=(0, None))
    axes.legend()
