"""Pairs: images of gel cameras, counts and tactile images of taxel arrays, prediction of a run."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from t2twin.report.data import Dataset
from t2twin.report.figures import (
    COUNTS_MAP,
    Panel,
    aspect_of,
    color_bar,
    draw_discs,
    draw_image,
    draw_panels,
    draw_tactile_image,
    draw_taxels,
    extent_mm,
    figure,
)

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
    return sample_in_turn(dataset, dataset.families, PAIRS, SEED)


def example(dataset: Dataset, split: str, row: int) -> bytes:
    """Content of a PNG file with a pair: images and tactile images."""
    parts = [column[-1:] for column in _columns(dataset, split, row)]
    return _pair(dataset, parts, EXAMPLE_IN, EXAMPLE_HEIGHT_IN, has_titles=True)


def translation(dataset: Dataset, split: str, row: int, predicted: np.ndarray) -> bytes:
    """Content of a PNG file with an image, the true counts and those that a run predicts.

    predicted: (N,) counts.
    """
    array, layout = dataset.array, dataset.array.layout
    true = dataset.counts_of(split, row, dataset.info.role_of("counts"))
    panels = [
        Panel(f"{dataset.camera_name}\n(image)", dataset.image(split, row)),
        Panel(f"{dataset.array_name}\n(true counts)", array.phi(true)),
        Panel("network\n(predicted)", array.phi(predicted)),
    ]
    height = min(EXAMPLE_HEIGHT_IN, (EXAMPLE_IN - BAR_IN) / sum(panel.aspect for panel in panels))
    return figure(
        "png",
        EXAMPLE_IN,
        height + TITLES_IN,
        lambda page: draw_panels(page, panels, array.phi, layout.x_mm, layout.y_mm),
    )


class _Part(NamedTuple):
    """A part of a pair's figure.

    title: of an image or a tactile image. aspect: width over height. draw: draws it, and returns
    what needs a color bar.
    """

    title: str
    aspect: float
    draw: Callable[[Axes], AxesImage | None]


_Column = list[_Part]
"""One part, or two of the same aspect on top of each other."""


def _columns(dataset: Dataset, split: str, row: int) -> list[_Column]:
    """The image of each gel camera, the pads and the tactile image of each array, source first."""
    columns = []
    for role in dataset.info.sensors:
        if role in dataset.cameras:
            columns.append([_image(dataset, role, dataset.image(split, row, role))])
        else:
            columns.append(_array(dataset, role, dataset.counts_of(split, row, role)))
    return columns


def _figure(dataset: Dataset, split: str, row: int) -> bytes:
    columns = []
    for column in _columns(dataset, split, row):
        columns += [column] if column[0].aspect > STACKED_ASPECT else [[part] for part in column]
    return _pair(dataset, columns, WIDTH_IN, HEIGHT_IN)


def _pair(
    dataset: Dataset,
    columns: list[_Column],
    width_in: float,
    height_in: float,
    has_titles: bool = False,
) -> bytes:
    """Content of a PNG file. height_in: largest height of the images."""
    aspects = [column[0].aspect / len(column) for column in columns]
    height = min(height_in, (width_in - BAR_IN * len(dataset.arrays)) / sum(aspects))

    def draw(page: Figure) -> None:
        grid = page.add_gridspec(2, len(columns), width_ratios=aspects)
        for place, column in enumerate(columns):
            half = [grid[0, place], grid[1, place]]
            spaces = half if len(column) == 2 else [grid[:, place]]
            axes = [page.add_subplot(space) for space in spaces]
            drawn = [part.draw(own) for part, own in zip(column, axes, strict=True)]
            if drawn[-1] is not None:
                color_bar(page, drawn[-1], axes, BAR_WIDTH, "counts" if has_titles else "")
            if has_titles:
                axes[0].set_title(column[0].title)

    return figure("png", width_in, height + (TITLES_IN if has_titles else MARGIN_IN), draw)


def _image(dataset: Dataset, role: str, image: np.ndarray) -> _Part:
    title = f"{dataset.label(role)}\n(image)"
    return _Part(title, aspect_of(image), lambda axes: draw_image(axes, image))


def _array(dataset: Dataset, role: str, counts: np.ndarray) -> _Column:
    """The pads and the tactile image. counts: (N,)."""
    array = dataset.arrays[role]
    phi, layout = array.phi, array.layout
    limits = (0.0, max(float(counts.max()), 1.0))

    def draw_pads(axes: Axes) -> None:
        draw_discs(
            axes, layout.x_mm, layout.y_mm, layout.pad_diameter_mm, array=counts, cmap=COUNTS_MAP,
            clim=limits, edgecolors="#444444", linewidths=0.4, clip_on=False,
        )  # fmt: skip
        half_mm = field_of_view(dataset)
        if half_mm is not None:
            corner, sides = (-half_mm[0], -half_mm[1]), (2 * half_mm[0], 2 * half_mm[1])
            axes.add_patch(Rectangle(corner, *sides, fill=False, edgecolor="#d55e00", linewidth=1))
        left, right, bottom, top = extent_mm(phi)
        axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
        axes.set_axis_off()

    def draw_tactile(axes: Axes) -> AxesImage:
        drawn = draw_tactile_image(axes, phi(counts), phi, limits)
        draw_taxels(axes, layout.x_mm, layout.y_mm)
        return drawn

    aspect = phi.shape[1] / phi.shape[0]
    title = f"{dataset.label(role)}\n(counts)"
    return [_Part(title, aspect, draw_pads), _Part(title, aspect, draw_tactile)]


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
