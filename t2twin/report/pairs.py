"""Pairs: DIGIT image, counts of the CySkin's taxels, tactile image, prediction of a run."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from t2twin.report.dataset import Dataset
from t2twin.report.figures import (
    COUNTS_MAP,
    Panel,
    color_bar,
    digit_width,
    draw_digit_image,
    draw_discs,
    draw_panels,
    draw_tactile_image,
    draw_taxels,
    extent_mm,
    figure,
)
from t2twin.sim.optical.camera.pinhole import DIGIT_CAMERA
from t2twin.sim.taxels.phi import TACTILE_SHAPE

PAIRS = 12
SEED = 0
MAX_NAMES = 60
"""Maximum number of names that are sampled in their order (assumed: the number of images)."""

WIDTH_IN, HEIGHT_IN = 4.4, 2.1
EXAMPLE_IN, BAR_IN, TITLES_IN = 4.2, 0.7, 0.45
"""Width of the example and of its color bar, height of its titles, inches."""


def section(dataset: Dataset) -> dict[str, Any]:
    """Rows and figures of PAIRS pairs, of different families as far as possible."""
    pairs = [
        (split, dataset.row(split, row), _figure(dataset, split, row))
        for split, row in sampled_pairs(dataset)
    ]
    half_width, half_height = DIGIT_CAMERA.seen_half_extent_mm()
    return {"pairs": pairs, "field_of_view_mm": (2 * half_width, 2 * half_height)}


def sampled_pairs(dataset: Dataset) -> list[tuple[str, int]]:
    """Splits and rows of PAIRS pairs, sampled from all families in turn."""
    return sample_in_turn(dataset, dataset.families, PAIRS, SEED)


def example(dataset: Dataset, split: str, row: int, translated: np.ndarray | None = None) -> bytes:
    """Content of a PNG file with a pair. translated: (N,) predicted counts."""
    true = dataset.phi(np.array(dataset.row(split, row)["taxels"], dtype=np.float32))
    panels = [Panel("DIGIT\n(image)", dataset.image(split, row))]
    if translated is None:
        panels.append(Panel("CySkin\n(counts)", true))
    else:
        panels.append(Panel("CySkin\n(true counts)", true))
        panels.append(Panel("network\n(predicted)", dataset.phi(translated)))
    layout = dataset.layout
    panel_in = (EXAMPLE_IN - BAR_IN) / sum(panel.width for panel in panels)
    height_in = TITLES_IN + panel_in * TACTILE_SHAPE[0] / TACTILE_SHAPE[1]
    return figure(
        "png",
        EXAMPLE_IN,
        height_in,
        lambda page: draw_panels(page, panels, dataset.phi, layout.x_mm, layout.y_mm),
    )


def _figure(dataset: Dataset, split: str, row: int) -> bytes:
    image = dataset.image(split, row)
    counts = np.array(dataset.row(split, row)["taxels"], dtype=np.float32)
    limits = (0.0, max(float(counts.max()), 1.0))

    def draw(page: Figure) -> None:
        digit, array, tactile = page.subplots(1, 3, width_ratios=(digit_width(image), 1, 1))
        draw_digit_image(digit, image)
        _draw_pads(array, dataset, counts, limits)
        drawn = draw_tactile_image(tactile, dataset.phi(counts), dataset.phi, limits)
        draw_taxels(tactile, dataset.layout.x_mm, dataset.layout.y_mm)
        color_bar(page, drawn, tactile, 0.07)

    return figure("png", WIDTH_IN, HEIGHT_IN, draw)


def _draw_pads(
    axes: Axes, dataset: Dataset, counts: np.ndarray, limits: tuple[float, float]
) -> None:
    """Draws pads as discs of their diameters, with the field of view of a simulated DIGIT."""
    draw_discs(
        axes, dataset.layout.x_mm, dataset.layout.y_mm, dataset.pad_diameter_mm, array=counts,
        cmap=COUNTS_MAP, clim=limits, edgecolors="#444444", linewidths=0.4,
    )  # fmt: skip
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
