"""A dozen pairs: what the DIGIT saw, what the CySkin's taxels counted, the tactile image.

Which pairs are shown: drawn at random, from every shape or family in turn.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.figures import (
    COUNTS_MAP,
    color_bar,
    digit_width,
    draw_digit_image,
    draw_taxels,
    extent_mm,
    figure,
)
from t2twin.report.html.labels import SPLIT_NAMES, shape_name
from t2twin.sim.digit.camera.pinhole import DIGIT_CAMERA

PAIRS = 12
SEED = 0
WIDTH_IN, HEIGHT_IN = 4.4, 2.1


def section(dataset: Dataset) -> str:
    """One picture a pair, each of another family as far as there are."""
    text = (
        "For each pair the DIGIT picture, the CySkin's taxels to scale, each pad in the color of "
        "its count, and the tactile image: the counts interpolated between the taxels, which the "
        "paper calls φ. The scale beside it is in counts. "
    )
    if dataset.info.is_simulated:
        half_width, half_height = DIGIT_CAMERA.seen_half_extent_mm()
        text += (
            f"The rectangle is what the DIGIT sees, {2 * half_width:.1f} × {2 * half_height:.1f} "
            "mm, on the scale of the array. "
        )
    text += "Drawn at random, family by family."
    rows = chosen(dataset)
    return markup.section(
        "pairs",
        "Pairs",
        [
            markup.paragraph(text, "note"),
            markup.grid([_pair(dataset, split, row) for split, row in rows]),
        ],
    )


def chosen(dataset: Dataset) -> list[tuple[str, int]]:
    """Splits and rows of PAIRS pairs: families in turn, one more of each until there are enough."""
    return sample_in_turn(dataset, dataset.families, PAIRS, SEED)


def _pair(dataset: Dataset, split: str, row: int) -> str:
    table = dataset.tables[split]
    shape = shape_name(dataset.shape(split, row))
    counts = np.array(table["taxels"][row].as_py(), dtype=np.float32)
    content = figure(
        "png", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, dataset, split, row, counts)
    )
    note = f"({SPLIT_NAMES[split]}): largest taxel {counts.max():,.0f} counts"
    if dataset.info.is_simulated:
        note += (
            f"; depth in the gel {table['digit_depth_mm'][row].as_py():.2f} mm, in the skin "
            f"{table['cyskin_depth_mm'][row].as_py():.2f} mm"
        )
    force_n = table["force_n"][row].as_py()
    if dataset.forces_n.size > 1 and force_n is not None:
        note += f"; {force_n:.3g} N"
    alt = f"DIGIT picture, taxel counts and tactile image of {shape}"
    return markup.embed(content, "png", alt, shape, width="narrow", note=note)


def _draw(page: Figure, dataset: Dataset, split: str, row: int, counts: np.ndarray) -> None:
    seen = dataset.image(split, row)
    picture, array, image = page.subplots(1, 3, width_ratios=(digit_width(seen), 1, 1))
    draw_digit_image(picture, seen)
    limits = (0.0, max(float(counts.max()), 1.0))
    _array(array, dataset, counts, limits)
    drawn = draw_tactile_image(image, dataset.phi(counts), dataset.phi, limits)
    draw_taxels(image, dataset.layout.x_mm, dataset.layout.y_mm)
    color_bar(page, drawn, image, 0.07)


def _array(axes: Axes, dataset: Dataset, counts: np.ndarray, limits: tuple[float, float]) -> None:
    """Every pad as a disc of its diameter, mm, with a simulated DIGIT's view about the middle."""
    x_mm, y_mm = dataset.layout.x_mm, dataset.layout.y_mm
    size = dataset.pad_diameter_mm
    pads = EllipseCollection(
        size,
        size,
        np.zeros(size.size),
        units="xy",
        offsets=np.column_stack([x_mm, y_mm]),
        offset_transform=axes.transData,
        array=counts,
        cmap=COUNTS_MAP,
        clim=limits,
        edgecolors="#444444",
        linewidths=0.4,
    )
    axes.add_collection(pads)
    if dataset.info.is_simulated:
        half_width, half_height = DIGIT_CAMERA.seen_half_extent_mm()
        corner, sides = (-half_width, -half_height), (2 * half_width, 2 * half_height)
        axes.add_patch(Rectangle(corner, *sides, fill=False, edgecolor="#d55e00", linewidth=1.0))
    left, right, bottom, top = extent_mm(dataset.phi)
    axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    axes.set_axis_off()


MAX_NAMES = 60
"""Names that are gone through in their order (assumed: as many as there are pictures of)."""


def sample_in_turn(
    dataset: Dataset, names: np.ndarray, most: int, seed: int
) -> list[tuple[str, int]]:
    """Splits and rows: one pair of each name, then one more of each, until there are `most`.

    names: (P,) what the pairs are told apart by, such as dataset.shapes. Of more than MAX_NAMES
    the names are taken at random too.
    """
    rng = np.random.default_rng(seed)
    of_name: dict[str, list[tuple[str, int]]] = {}
    for name, place in zip(names, dataset.places, strict=True):
        of_name.setdefault(str(name), []).append(place)
    orders = [[places[i] for i in rng.permutation(len(places))] for places in of_name.values()]
    if len(orders) > MAX_NAMES:
        orders = [orders[i] for i in rng.permutation(len(orders))]
    deepest = max(len(order) for order in orders)
    in_turn = [order[turn] for turn in range(deepest) for order in orders if turn < len(order)]
    return in_turn[:most]
