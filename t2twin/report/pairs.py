"""Pairs: images of gel cameras, counts and tactile images of taxel arrays, prediction of a run."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from t2twin.core.draw import (
    COLOR_MAP,
    Panel,
    color_bar,
    draw_discs,
    draw_image,
    draw_tactile_image,
    extent_mm,
    figure,
    panels_image,
)
from t2twin.report.data import Dataset

PAIRS = 12
SEED = 0
MAX_NAMES = 60
"""Maximum number of names that are sampled in their order (assumed: the number of images)."""

WIDTH_IN, HEIGHT_IN, MARGIN_IN = 4.4, 2.0, 0.1
"""Width of a pair's figure, largest height of its images, and its margin, inches."""

STACKED_ASPECT = 1.2
"""Aspect of a tactile image above which it is drawn below the pads (assumed)."""

EXAMPLE_IN, EXAMPLE_HEIGHT_IN, TITLES_IN, BAR_IN = 4.2, 2.2, 0.45, 0.7
"""Width of the example, largest height of its images, height of its titles, width of a color bar,
inches."""

BAR_WIDTH = 0.07
"""Width of a color bar, relative to a tactile image."""

_Part = Callable[[Axes], ScalarMappable | None]
"""Draws a part of a pair's figure, and returns what needs a color bar."""


def section(dataset: Dataset) -> dict[str, Any]:
    """Rows and figures of PAIRS pairs, of different families as far as possible."""
    pairs = [
        (split, dataset.row(split, row), _figure(dataset, split, row))
        for split, row in sampled_pairs(dataset)
    ]
    half_mm = field_of_view(dataset)
    return {
        "pairs": pairs,
        "field_of_view_mm": None if half_mm is None else [2 * half for half in half_mm],
    }


def field_of_view(dataset: Dataset) -> tuple[float, float] | None:
    """Half of what the image of a simulated gel camera shows along x and y, mm. None where it is
    unknown, and without a taxel array on which it is drawn."""
    if not (dataset.cameras and dataset.arrays and dataset.info.is_simulated):
        return None
    return dataset.info.camera.view_mm


def sampled_pairs(dataset: Dataset) -> list[tuple[str, int]]:
    """Splits and rows of PAIRS pairs, sampled from all families in turn."""
    return sample_in_turn(dataset, dataset.column("family"), PAIRS, SEED)


def example(dataset: Dataset, split: str, row: int) -> bytes:
    """Content of a PNG file with a pair: images and tactile images, with titles."""
    return _figure(dataset, split, row, EXAMPLE_IN, EXAMPLE_HEIGHT_IN, is_example=True)


def translation(dataset: Dataset, split: str, row: int, predicted: np.ndarray) -> bytes:
    """Content of a PNG file with an image, the true counts and those that a run predicts.

    predicted: (N,) counts.
    """
    array = dataset.array
    true = dataset.counts_of(split, row, dataset.info.role_of("counts"))
    panels = [
        Panel(f"{dataset.camera_name}\n(image)", dataset.image(split, row)),
        Panel(f"{dataset.array_name}\n(true counts)", array.phi(true)),
        Panel("network\n(predicted)", array.phi(predicted)),
    ]
    layout = array.layout
    return panels_image(panels, array.phi.centers_mm, layout.x_mm, layout.y_mm, EXAMPLE_IN)


def _figure(
    dataset: Dataset,
    split: str,
    row: int,
    width_in: float = WIDTH_IN,
    height_in: float = HEIGHT_IN,
    is_example: bool = False,
) -> bytes:
    """Content of a PNG file with the image of each gel camera, and with the pads and the tactile
    image of each array, source first. height_in: largest height of the images."""
    columns: list[tuple[str, float, list[_Part]]] = []
    for role in dataset.info.sensors:
        name = dataset.label(role)
        if role in dataset.cameras:
            image = dataset.image(split, row, role)
            draw_own: _Part = partial(draw_image, image=image)
            columns.append((f"{name}\n(image)", image.shape[1] / image.shape[0], [draw_own]))
            continue
        parts = _array_parts(dataset, role, dataset.counts_of(split, row, role))[is_example:]
        rows, pixels = dataset.arrays[role].phi.shape
        is_stacked = len(parts) == 2 and pixels / rows > STACKED_ASPECT
        for column in [parts] if is_stacked else [[part] for part in parts]:
            columns.append((f"{name}\n(counts)", pixels / rows / len(column), column))
    aspects = [aspect for _, aspect, _ in columns]
    height = min(height_in, (width_in - BAR_IN * len(dataset.arrays)) / sum(aspects))

    def draw(page: Figure) -> None:
        grid = page.add_gridspec(2, len(columns), width_ratios=aspects)
        for place, (title, _, parts) in enumerate(columns):
            half = [grid[0, place], grid[1, place]]
            axes = [
                page.add_subplot(space) for space in (half if len(parts) == 2 else [grid[:, place]])
            ]
            drawn = [part(own) for part, own in zip(parts, axes, strict=True)]
            if drawn[-1] is not None:
                color_bar(page, drawn[-1], axes, BAR_WIDTH, "counts" if is_example else "")
            if is_example:
                axes[0].set_title(title)

    return figure("png", width_in, height + (TITLES_IN if is_example else MARGIN_IN), draw)


def _array_parts(dataset: Dataset, role: str, counts: np.ndarray) -> list[_Part]:
    """The pads and the tactile image. counts: (N,)."""
    array = dataset.arrays[role]
    phi, layout = array.phi, array.layout
    limits = (0.0, max(float(counts.max()), 1.0))

    def draw_pads(axes: Axes) -> None:
        draw_discs(
            axes, layout.x_mm, layout.y_mm, layout.pad_diameter_mm, array=counts,
            cmap=COLOR_MAP, clim=limits, edgecolors="#444444", linewidths=0.4, clip_on=False,
        )  # fmt: skip
        half_mm = field_of_view(dataset)
        if half_mm is not None:
            corner, sides = (-half_mm[0], -half_mm[1]), (2 * half_mm[0], 2 * half_mm[1])
            axes.add_patch(Rectangle(corner, *sides, fill=False, edgecolor="#d55e00", linewidth=1))
        left, right, bottom, top = extent_mm(*phi.centers_mm)
        axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
        axes.set_axis_off()

    def draw_tactile(axes: Axes) -> ScalarMappable:
        return draw_tactile_image(
            axes, phi(counts), phi.centers_mm, layout.x_mm, layout.y_mm, limits
        )

    return [draw_pads, draw_tactile]


def sample_in_turn(
    dataset: Dataset, names: np.ndarray, number: int, seed: int
) -> list[tuple[str, int]]:
    """Splits and rows of sampled pairs: one pair of each name, then further ones of each.

    names: (P,) groups of the pairs, such as the column "shape"; of more than MAX_NAMES, their order
    is random. number: of pairs.
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
