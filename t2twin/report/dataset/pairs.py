"""Randomly sampled pairs: DIGIT image, counts of the CySkin's taxels, tactile image."""

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
    draw_tactile_image,
    draw_taxels,
    extent_mm,
    figure,
)
from t2twin.report.html.labels import SPLIT_NAMES, shape_name
from t2twin.sim.digit.camera.pinhole import DIGIT_CAMERA

PAIRS = 12
SEED = 0
MAX_NAMES = 60
"""Maximum number of names that are sampled in their order (assumed: the number of images)."""

WIDTH_IN, HEIGHT_IN = 4.4, 2.1


def section(dataset: Dataset) -> str:
    """One figure per pair, of different families as far as possible."""
    text = (
        "From left to right: the DIGIT image; the CySkin's taxels to scale, colored by their "
        "counts; the tactile image, interpolated between the taxels (φ in the paper). The color "
        "scale is in counts. "
    )
    if dataset.info.is_simulated:
        half_width, half_height = DIGIT_CAMERA.seen_half_extent_mm()
        text += (
            f"The rectangle is the DIGIT's field of view, {2 * half_width:.1f} × "
            f"{2 * half_height:.1f} mm, at the scale of the array. "
        )
    text += "Random samples, one family after another."
    rows = sampled_pairs(dataset)
    return markup.section(
        "pairs",
        "Pairs",
        [
            markup.paragraph(text, "note"),
            markup.grid([_pair(dataset, split, row) for split, row in rows]),
        ],
    )


def sampled_pairs(dataset: Dataset) -> list[tuple[str, int]]:
    """Splits and rows of PAIRS pairs, sampled from all families in turn."""
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
            f"; depth in the gel {table['digit_depth_mm'][row].as_py():.2f} mm, in the cover "
            f"{table['cyskin_depth_mm'][row].as_py():.2f} mm"
        )
    force_n = table["force_n"][row].as_py()
    if dataset.forces_n.size > 1 and force_n is not None:
        note += f"; {force_n:.3g} N"
    alt = f"DIGIT image, taxel counts and tactile image of {shape}"
    return markup.embed(content, "png", alt, shape, width="narrow", note=note)


def _draw(page: Figure, dataset: Dataset, split: str, row: int, counts: np.ndarray) -> None:
    image = dataset.image(split, row)
    digit, array, tactile = page.subplots(1, 3, width_ratios=(digit_width(image), 1, 1))
    draw_digit_image(digit, image)
    limits = (0.0, max(float(counts.max()), 1.0))
    _draw_pads(array, dataset, counts, limits)
    drawn = draw_tactile_image(tactile, dataset.phi(counts), dataset.phi, limits)
    draw_taxels(tactile, dataset.layout.x_mm, dataset.layout.y_mm)
    color_bar(page, drawn, tactile, 0.07)


def _draw_pads(
    axes: Axes, dataset: Dataset, counts: np.ndarray, limits: tuple[float, float]
) -> None:
    """Draws pads as discs of their diameters, with the field of view of a simulated DIGIT."""
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


def sample_in_turn(
    dataset: Dataset, names: np.ndarray, number: int, seed: int
) -> list[tuple[str, int]]:
    """Splits and rows of sampled pairs: one pair of each name, then further ones of each.

    names: (P,) groups of the pairs, such as dataset.shapes; of more than MAX_NAMES, their order is
    random. number: of pairs.
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
    return in_turn[:number]
