"""Outliers: pairs far from the rest of their shape."""

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
"""Shapes up to which a pair is compared with those of its own (assumed: of more, each has too few
presses for a median)."""

MIN_N = 0.01
"""The least force that is told from others, N: what a press may be commanded (sim.contact)."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

MIN_SCALE = 0.02
"""Least standard deviation taken, in parts of the median: less is no spread worth speaking of."""

PANELS, PANEL_IN, LINE_IN = 6, 1.5, 2.3
"""Panels in a line, their width and the line's height, inches."""


def section(dataset: Dataset, scan: Scan) -> str:
    """The pairs that are farthest from the others of their shape."""
    rows = outliers(dataset, scan)
    many = np.unique(dataset.shapes).size > MAX_SHAPES
    group = "family" if many else "shape"
    at_force = " and of forces within a doubling" if dataset.forces_n.size > 1 else ""
    text = (
        f"The pairs farthest from the median of their {group}{at_force} in the sum of their "
        "counts, in depth, or in their picture, in robust standard deviations (from the median "
        "absolute deviation). Rims and corners of a shape are far from its middle by right; a "
        "press that missed or a picture that broke would stand here too."
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
            markup.embed(content, "png", "DIGIT pictures of the farthest pairs"),
        ],
    )


def outliers(dataset: Dataset, scan: Scan) -> list[tuple[int, str, float]]:
    """Place of each pair shown, the quantity that is far off, and by how many deviations."""
    quantities = {"counts": dataset.counts.sum(axis=1), "picture": scan.off_grey}
    if dataset.info.is_simulated:
        quantities |= {
            f"{sensor} depth": dataset.column(f"{sensor}_depth_mm")
            for sensor in ("digit", "cyskin")
        }
    alike = _alike(dataset)
    far = {name: deviations(values, alike) for name, values in quantities.items()}
    names = list(far)
    table = np.stack([far[name] for name in names])
    which, most = table.argmax(axis=0), table.max(axis=0)
    order = np.argsort(-most, kind="stable")[:SHOWN]
    return [(int(place), names[which[place]], float(most[place])) for place in order]


def _alike(dataset: Dataset) -> np.ndarray:
    """(P,) what each pair is compared with the others of: its shape, or of many shapes its family,
    and where there are several forces those within a doubling of its own."""
    few = np.unique(dataset.shapes).size <= MAX_SHAPES
    groups = dataset.shapes if few else dataset.families
    if dataset.forces_n.size < 2:
        return groups
    force_n = np.nan_to_num(dataset.column("force_n").astype(float))
    doubling = np.where(force_n > 0, np.floor(np.log2(np.maximum(force_n, MIN_N))), np.nan)
    return np.char.add(np.char.add(groups, " "), doubling.astype(str))


def deviations(values: np.ndarray, groups: np.ndarray) -> np.ndarray:
    """How far each value is from its group's median, in robust standard deviations: (P,).

    The deviation is at least MIN_SCALE of the median.
    """
    far = np.zeros(values.size)
    in_order = np.argsort(groups, kind="stable")
    begins = np.unique(groups[in_order], return_index=True)[1]
    for mine in np.split(in_order, begins[1:]):
        off = np.abs(values[mine] - np.median(values[mine]))
        least = MIN_SCALE * abs(np.median(values[mine]))
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
        shape = shape_name(dataset.shape(split, row))
        index = dataset.tables[split]["index"][row].as_py()
        draw_digit_image(place, dataset.image(split, row))
        place.set_title(f"{shape}, {index}\n{quantity} {far:.1f}", fontsize=7.5)
