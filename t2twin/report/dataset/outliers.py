"""Outliers: pairs that differ strongly from the others of their shape."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report.dataset.scan import Scan
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.figures import draw_digit_image, figure
from t2twin.report.html.labels import shape_name

SHOWN = 12
MAX_SHAPES = 200
"""Maximum number of shapes for comparison within a shape (assumed: with more shapes, each has too
few presses for a median). Otherwise pairs are compared within their family."""

MIN_N = 0.01
"""Smallest commanded force, N (sim.contact)."""

MAD_TO_SIGMA = 1.4826
"""Ratio of standard deviation and median absolute deviation of a normal distribution."""

MIN_SCALE = 0.02
"""Minimum standard deviation, relative to the median (assumed)."""

PANELS, PANEL_IN, LINE_IN = 6, 1.5, 2.3
"""Panels per row, their width and the height of a row, inches."""


def section(dataset: Dataset, scan: Scan) -> str:
    """The pairs with the largest deviations."""
    rows = outliers(dataset, scan)
    many = np.unique(dataset.shapes).size > MAX_SHAPES
    group = "family" if many else "shape"
    at_force = " at similar forces (within a factor of two)" if dataset.forces_n.size > 1 else ""
    text = (
        f"Pairs with the largest deviations from the median of their {group}{at_force}, by summed "
        "counts, depth or image, in robust standard deviations (from the median absolute "
        "deviation). Rims and corners of a shape deviate as expected; failed presses and damaged "
        "images also appear here."
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
            markup.embed(content, "png", "DIGIT images of the pairs with the largest deviations"),
        ],
    )


def outliers(dataset: Dataset, scan: Scan) -> list[tuple[int, str, float]]:
    """Index of each pair, the deviating quantity, and its deviation."""
    quantities = {"counts": dataset.counts.sum(axis=1), "image": scan.residual_grey}
    if dataset.info.is_simulated:
        quantities |= {
            f"{sensor} depth": dataset.column(f"{sensor}_depth_mm")
            for sensor in ("digit", "cyskin")
        }
    groups = _groups(dataset)
    names = list(quantities)
    table = np.stack([deviations(values, groups) for values in quantities.values()])
    which, largest = table.argmax(axis=0), table.max(axis=0)
    order = np.argsort(-largest, kind="stable")[:SHOWN]
    return [(int(pair), names[which[pair]], float(largest[pair])) for pair in order]


def _groups(dataset: Dataset) -> np.ndarray:
    """(P,) group in which each pair is compared: its shape, or its family if there are many shapes;
    of several forces, with the force rounded down to a power of two."""
    few = np.unique(dataset.shapes).size <= MAX_SHAPES
    groups = dataset.shapes if few else dataset.families
    if dataset.forces_n.size < 2:
        return groups
    force_n = np.nan_to_num(dataset.column("force_n").astype(float))
    doubling = np.where(force_n > 0, np.floor(np.log2(np.maximum(force_n, MIN_N))), np.nan)
    return np.char.add(np.char.add(groups, " "), doubling.astype(str))


def deviations(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """(P,) deviation of each value from its group's median, in robust standard deviations.

    The standard deviation is at least MIN_SCALE times the median.
    """
    result = np.zeros(values.size)
    in_order = np.argsort(groups, kind="stable")
    starts = np.unique(groups[in_order], return_index=True)[1]
    for members in np.split(in_order, starts[1:]):
        residual = np.abs(values[members] - np.median(values[members]))
        min_scale = MIN_SCALE * abs(np.median(values[members]))
        scale = max(MAD_TO_SIGMA * float(np.median(residual)), min_scale)
        result[members] = residual / scale if scale > 0 else 0.0
    return result


def _panels(page: Figure, dataset: Dataset, rows: list[tuple[int, str, float]]) -> None:
    lines = -(-len(rows) // PANELS)
    axes: list[Axes] = list(np.ravel(page.subplots(lines, PANELS, squeeze=False)))
    for place in axes:
        place.set_axis_off()
    for place, (pair, quantity, deviation) in zip(axes, rows, strict=False):
        split, row = dataset.places[pair]
        shape = shape_name(dataset.shape(split, row))
        index = dataset.tables[split]["index"][row].as_py()
        draw_digit_image(place, dataset.image(split, row))
        place.set_title(f"{shape}, {index}\n{quantity} {deviation:.1f}", fontsize=7.5)
