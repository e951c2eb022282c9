"""matplotlib figures as bytes, in one style, and panels that several figures share.

Shape letters: R rows, C columns, N taxels.
"""

import io
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import FixedLocator, LogFormatter, NullLocator
from scipy.spatial import KDTree

from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.phi import Phi

STYLE = {
    "axes.edgecolor": "#666666",
    "axes.grid": False,
    "axes.labelcolor": "#222222",
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 8.5,
    "font.size": 8.5,
    "image.interpolation": "nearest",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.4,
    "text.parse_math": False,  # names of shapes may contain dollar signs
    "svg.hashsalt": "t2twin",  # makes the bytes of a figure reproducible
    "xtick.color": "#444444",
    "xtick.major.width": 0.6,
    "ytick.color": "#444444",
    "ytick.major.width": 0.6,
}
DPI = 144
"""Resolution of PNG images; charts are SVG."""

COUNTS_MAP = "viridis"
DIFFERENCE_MAP = "RdBu_r"
"""Color maps of counts, perceptually uniform, and of differences, white at zero."""

RING_MM, RING_SHARE = 0.7, 0.15
"""Largest radius of the ring that marks a taxel, mm, and relative to the nearest taxel's distance.
"""

FORCE_MARGIN = 1.15
"""Margin of a force axis at both ends, a factor."""

BAR_WIDTH = 0.12
"""Width of a color bar, relative to an image."""

PANEL_IN, WIDEST_IN, TITLE_IN, BAR_IN, DIFFERENCE_BAR_IN = 2.06, 2.5, 0.22, 0.6, 0.3
"""Largest height and width of a panel, height of the titles, widths of the color bars, inches."""


def figure(
    kind: Literal["svg", "png"],
    width_in: float,
    height_in: float,
    draw: Callable[[Figure], None],
) -> bytes:
    """File content of a figure. draw: fills the empty figure.

    A character that the font lacks is drawn as a box.
    """
    with rc_context(STYLE), warnings.catch_warnings():  # pyright: ignore[reportArgumentType]
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        # On a busy machine the placement of a legend may exceed the limit for this warning.
        warnings.filterwarnings("ignore", "Creating legend with loc")
        page = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(page)
        _plain_powers(page)
        buffer = io.BytesIO()
        metadata = {"Date": None} if kind == "svg" else {}
        page.savefig(buffer, format=kind, dpi=DPI, metadata=metadata)
    return buffer.getvalue()


def _plain_powers(page: Figure) -> None:
    """Labels logarithmic axes with numbers, because STYLE disables formulas."""
    for axis in (axis for axes in page.axes for axis in (axes.xaxis, axes.yaxis)):
        if axis.get_scale() == "log":
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(LogFormatter())


def aspect_of(image: np.ndarray) -> float:
    """Width over height of an image, (R, C) or (R, C, 3)."""
    rows, columns = image.shape[:2]
    return columns / rows


def draw_image(axes: Axes, image: np.ndarray) -> None:
    """Draws an image, (R, C, 3) uint8, without axes."""
    axes.imshow(image)
    axes.set_axis_off()


def draw_tactile_image(
    axes: Axes,
    image: np.ndarray,
    phi: Phi,
    layout: Layout,
    limits: tuple[float, float],
    color_map: str = COUNTS_MAP,
    rings: str = "white",
) -> AxesImage:
    """Draws a tactile image or a difference of two, (R, C) counts, on axes in mm.

    limits: counts at both ends of the color scale. rings: color of the ring at each taxel.
    """
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(visible=True, linewidth=0.4, color="#aaaaaa")
    low, high = limits
    drawn = axes.imshow(image, cmap=color_map, vmin=low, vmax=high, extent=extent_mm(phi))
    places = np.column_stack([layout.x_mm, layout.y_mm])
    nearest_mm = KDTree(places).query(places, 2)[0][:, 1].min()
    size = np.full(layout.size, 2 * min(RING_MM, RING_SHARE * nearest_mm))
    draw_discs(axes, layout, size, facecolors="none", edgecolors=rings, linewidths=0.5)
    return drawn


def draw_discs(
    axes: Axes, layout: Layout, diameter_mm: np.ndarray, **style: Any
) -> EllipseCollection:
    """Draws a disc at each taxel, to scale. diameter_mm: (N,)."""
    centers = np.column_stack([layout.x_mm, layout.y_mm])
    angles = np.zeros(diameter_mm.size)
    discs = EllipseCollection(
        diameter_mm, diameter_mm, angles, units="xy", offsets=centers,
        offset_transform=axes.transData, **style,
    )  # fmt: skip
    axes.add_collection(discs)
    return discs


def color_bar(
    page: Figure, drawn: AxesImage, axes: Axes | list[Axes], width: float, title: str = ""
) -> None:
    """Adds a color bar in counts next to axes. width: relative to that of the axes."""
    bar = page.colorbar(drawn, ax=axes, fraction=width, pad=0.06, aspect=28, format="{x:,g}")
    bar.ax.spines["outline"].set_linewidth(0.4)
    bar.ax.tick_params(labelsize=7, length=2)
    bar.set_label(title, fontsize=7)


@dataclass(frozen=True)
class Panel:
    """An image with its title: of a gel camera, (R, C, 3) uint8, or tactile, (R, C) counts.

    is_difference: whether the counts are a difference of two tactile images.
    """

    title: str
    image: np.ndarray
    is_difference: bool = False

    @property
    def aspect(self) -> float:
        """Width over height."""
        return aspect_of(self.image)


def draw_panels(page: Figure, panels: Sequence[Panel], phi: Phi, layout: Layout) -> None:
    """Draws images in a row, with one color scale of counts and one of differences.

    The last panel is a tactile image.
    """
    tactile = [one for one in panels if one.image.ndim == 2]
    peak, difference = (
        max([1.0, *(np.abs(one.image).max() for one in tactile if one.is_difference is which)])
        for which in (False, True)
    )
    axes = page.subplots(1, len(panels), width_ratios=[one.aspect for one in panels])
    drawn: dict[bool, AxesImage] = {}
    for place, one in zip(axes, panels, strict=True):
        place.set_title(one.title)
        if one.image.ndim == 3:
            draw_image(place, one.image)
            continue
        limits, color_map, rings = (
            ((-difference, difference), DIFFERENCE_MAP, "#555555")
            if one.is_difference
            else ((0.0, peak), COUNTS_MAP, "white")
        )
        drawn[one.is_difference] = draw_tactile_image(
            place, one.image, phi, layout, limits, color_map, rings
        )
    for is_difference, image in sorted(drawn.items(), reverse=True):
        title = "difference, counts" if is_difference else "counts"
        color_bar(page, image, axes[-1], BAR_WIDTH, title)


def panels_image(panels: Sequence[Panel], phi: Phi, layout: Layout) -> bytes:
    """Content of a PNG file with a row of panels; see `draw_panels`."""
    bars = BAR_IN + DIFFERENCE_BAR_IN * any(one.is_difference for one in panels)
    aspects = [panel.aspect for panel in panels]
    height = min(PANEL_IN, WIDEST_IN / max(aspects))
    lines = 1 + max(panel.title.count("\n") for panel in panels)
    draw = partial(draw_panels, panels=panels, phi=phi, layout=layout)
    return figure("png", height * sum(aspects) + bars, height + lines * TITLE_IN, draw)


def extent_mm(phi: Phi) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a tactile image, mm; y points down."""
    columns, rows = phi.centers_mm
    half = (columns[1] - columns[0]) / 2
    return columns[0] - half, columns[-1] + half, rows[-1] + half, rows[0] - half


def force_axis(axes: Axes, low_n: float, high_n: float) -> None:
    """Makes x a logarithmic axis with ticks at powers of two. low_n, high_n: range, above 0 N."""
    axes.set_xscale("log")
    axes.set_xlim(low_n / FORCE_MARGIN, high_n * FORCE_MARGIN)
    marks = 2.0 ** np.arange(
        np.ceil(np.log2(low_n / FORCE_MARGIN)), np.log2(high_n * FORCE_MARGIN) + 1e-9
    )
    axes.xaxis.set_major_locator(FixedLocator(marks.tolist() or [low_n]))
    axes.xaxis.set_minor_locator(NullLocator())
