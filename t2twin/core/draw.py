"""All drawing: values in colors, tactile images, reliefs, and figures of matplotlib in one style.

Pillow draws what commands write, because importing matplotlib takes as long as a press.
Shape letters: R rows, C columns, N taxels.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from PIL import Image, ImageDraw

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

COLOR_MAP, DIFFERENCE_MAP = "viridis", "RdBu_r"  # perceptually uniform; white at zero
# Colors of lines and bars for all kinds of color vision (Okabe and Ito 2008)
PALETTE = ("#0072b2", "#d55e00", "#cc79a7", "#e69f00", "#56b4e9", "#009e73")
# Colors of the parts of a contact that stick and slip, distinct for color-blind readers
STICK_RGB, SLIP_RGB = (158, 197, 232), (242, 150, 60)
MAP_MARGIN_MM = 0.5  # of a map around the contact
ARROWS = 10  # along the longer side of a contact, about

SCALE = 2  # rendered pixels per pixel of a tactile image
MARGIN, BAR_WIDTH, LABELS_WIDTH, TAXEL_RADIUS = 20, 18, 60, 4  # rendered pixels
UNIT_SIZE, FONT_SIZE, CAPTION_SIZE, CAPTION_HEIGHT = 18, 20, 12, 34  # rendered pixels
LABELS = 5  # on the color bar

HALF_FADED_SHARE = 0.05
"""Standard deviation at which a color is half white, as a share of full scale (assumed: the error
outside the view)."""

RELIEF_LIGHT = (-0.6, -0.8)  # direction that the light of a relief comes from
RELIEF_SHARE = 0.8  # change of brightness by a slope of 1
GREY_SHARE, DARKEST, BRIGHTEST = 0.3, 0.25, 1.6  # share of white, limits of brightness (assumed)
MIN_DEPTH_MM = 0.1  # least depth at the end of a relief's color scale: noise stays dark (assumed)

STYLE = {
    "axes.edgecolor": "#666666",
    "axes.labelcolor": "#222222",
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 8.5,
    "font.size": 8.5,
    "image.cmap": COLOR_MAP,
    "image.interpolation": "nearest",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.4,
    "text.parse_math": False,  # names of shapes may contain dollar signs
    "svg.hashsalt": "t2twin",  # makes the bytes of a figure reproducible
    "xtick.color": "#444444",
    "ytick.color": "#444444",
}
DPI = 144  # of PNG images; charts are SVG

RING_MM = 1.4  # largest diameter of the ring that marks a taxel
RING_SHARE = 0.3  # of the distance of the nearest taxel
# Largest height and width of a panel, height of a line of its title, width of a color bar, inches
PANEL_IN, WIDEST_IN, TITLE_IN, BAR_IN = 2.06, 2.5, 0.22, 0.6


def in_colors(values: np.ndarray, name: str = COLOR_MAP) -> np.ndarray:
    """Colors, (..., 3) uint8, of values in [0, 1], by a color map."""
    colors = color_table(name)
    return colors[np.minimum(values.clip(0.0, 1.0) * len(colors), len(colors) - 1).astype(int)]


@cache
def color_table(name: str = COLOR_MAP) -> np.ndarray:
    """The 256 colors of a map, (256, 3) uint8, from low to high values."""
    if name == COLOR_MAP:
        with np.load(Path(__file__).with_name("viridis.npz")) as file:
            return file["colours"]
    from matplotlib import colormaps

    return colormaps[name](np.arange(256), bytes=True)[:, :3]


def colored_tactile_image(
    image: np.ndarray,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    full_scale: float,
    std: np.ndarray | None = None,
    px_per_mm: float = 8.8,
) -> Image.Image:
    """A tactile image in colors, with a color bar and rings at the taxels.

    image: (R, C), counts. x_mm, y_mm: (N,) taxel positions. The color scale is from zero to
    full_scale, counts. std: (R, C) standard deviations, counts; colors fade to white with them,
    half way at HALF_FADED_SHARE of full scale. px_per_mm: scale of the image.
    """
    rows, columns = image.shape[0] * SCALE, image.shape[1] * SCALE
    width = columns + 3 * MARGIN + BAR_WIDTH + LABELS_WIDTH
    page = Image.new("RGB", (width, rows + 2 * MARGIN), "white")
    colors = in_colors(image / full_scale)
    if std is not None:
        kept = (HALF_FADED_SHARE / (HALF_FADED_SHARE + std / full_scale))[..., None]
        colors = np.rint(kept * colors + (1.0 - kept) * 255.0).astype(np.uint8)
    large = Image.fromarray(colors).resize((columns, rows), Image.Resampling.BILINEAR)
    page.paste(large, (MARGIN, MARGIN))
    pen = ImageDraw.Draw(page)
    for x, y in np.column_stack([x_mm, y_mm]) * px_per_mm * SCALE:
        center = (MARGIN + columns / 2 + x, MARGIN + rows / 2 + y)
        pen.circle(center, TAXEL_RADIUS, outline="white")
    left = columns + 2 * MARGIN
    bar = in_colors(np.repeat(np.linspace(1.0, 0.0, rows)[:, None], BAR_WIDTH, axis=1))
    page.paste(Image.fromarray(bar), (left, MARGIN))
    pen.text((left, MARGIN - 4), "counts", "black", anchor="ls", font_size=UNIT_SIZE)
    # The first and the last label lie within the bar's height, clear of the unit above it.
    anchors = ("lb", *("lm",) * (LABELS - 2), "lt")
    for part, anchor in zip(np.linspace(0.0, 1.0, LABELS), anchors, strict=True):
        at = (left + BAR_WIDTH + MARGIN / 3, MARGIN + (1.0 - part) * (rows - 1))
        pen.text(at, f"{part * full_scale:,.0f}", "black", anchor=anchor, font_size=FONT_SIZE)
    return page


def relief(
    depth_mm: np.ndarray, mask: np.ndarray, view_mm: tuple[float, float], caption: str = ""
) -> Image.Image:
    """A picture of a depth, (R, C), with the outline of a mask and a caption. Colors go from 0 to
    the largest, shaded as if lit from the upper left. view_mm: half of the view."""
    rows, columns = depth_mm.shape
    down, across = np.gradient(-depth_mm, 2 * view_mm[1] / rows, 2 * view_mm[0] / columns)
    slope = -(RELIEF_LIGHT[0] * across + RELIEF_LIGHT[1] * down)
    shade = (1.0 - RELIEF_SHARE * slope).clip(DARKEST, BRIGHTEST)
    colors = in_colors(depth_mm / max(MIN_DEPTH_MM, float(depth_mm.max()))).astype(float)
    colors = (GREY_SHARE * 255.0 + (1.0 - GREY_SHARE) * colors) * shade[..., None]
    inner = mask.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inner &= np.roll(mask, step, axis)
    colors[mask & ~inner] = 255.0
    page = Image.new("RGB", (columns, rows + (CAPTION_HEIGHT if caption else 0)), "white")
    page.paste(Image.fromarray(colors.clip(0, 255).astype(np.uint8)))
    at = (columns / 2, rows + CAPTION_HEIGHT / 2)
    ImageDraw.Draw(page).text(at, caption, "black", anchor="mm", font_size=CAPTION_SIZE)
    return page


def in_a_row(pictures: Iterable[Image.Image], height_px: int) -> Image.Image:
    """Pictures side by side, scaled to one height; their widths are even, for video codecs."""
    parts = []
    for picture in pictures:
        width_px = 2 * round(picture.width * height_px / picture.height / 2)
        parts.append(np.asarray(picture.convert("RGB").resize((width_px, height_px))))
    return Image.fromarray(np.hstack(parts))


def figure(
    kind: Literal["svg", "png"], width_in: float, height_in: float, draw: Callable[[Figure], None]
) -> bytes:
    """File content of a figure of matplotlib. draw: fills the empty figure.

    A character that the font lacks is drawn as a box.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogFormatter

    with rc_context(STYLE), warnings.catch_warnings():  # pyright: ignore[reportArgumentType]
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        # On a busy machine the placement of a legend may exceed the limit for this warning.
        warnings.filterwarnings("ignore", "Creating legend with loc")
        page = Figure(figsize=(width_in, height_in), layout="constrained")
        draw(page)
        page.draw_without_rendering()  # (one pass does not leave room for all labels)
        for axis in (axis for axes in page.axes for axis in (axes.xaxis, axes.yaxis)):
            if axis.get_scale() == "log":  # powers need formulas, which STYLE disables
                axis.set_major_formatter("{x:g}")
                axis.set_minor_formatter(LogFormatter())
        buffer = io.BytesIO()
        metadata = {"Date": None} if kind == "svg" else {}
        page.savefig(buffer, format=kind, dpi=DPI, metadata=metadata)
    return buffer.getvalue()


def draw_discs(
    axes: Axes, x_mm: np.ndarray, y_mm: np.ndarray, diameter_mm: np.ndarray, **style: Any
) -> ScalarMappable:
    """Draws a disc at each taxel, to scale; all arrays are (N,)."""
    from matplotlib.collections import EllipseCollection

    discs = EllipseCollection(
        diameter_mm, diameter_mm, np.zeros(len(x_mm)), units="xy", offset_transform=axes.transData,
        offsets=np.column_stack([x_mm, y_mm]), **style,
    )  # fmt: skip
    axes.add_collection(discs)
    return discs


def draw_tactile_image(
    axes: Axes, image: np.ndarray, phi: Any, layout: Any, limits: tuple[float, float]
) -> ScalarMappable:
    """Draws a tactile image, (R, C) counts, on axes in mm with y downwards, and taxels as rings.
    limits: ends of the color scale, counts; a negative one is for differences."""
    from scipy.spatial import KDTree

    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set(visible=True, linewidth=0.4, color="#aaaaaa")
    is_difference = limits[0] < 0
    color_map, rings = (DIFFERENCE_MAP, "#555555") if is_difference else (COLOR_MAP, "white")
    extent = extent_mm(*phi.centers_mm)
    drawn = axes.imshow(image, color_map, vmin=limits[0], vmax=limits[1], extent=extent)
    places = np.column_stack([layout.x_mm, layout.y_mm])
    nearest_mm = KDTree(places).query(places, 2)[0][:, 1].min()
    size = np.full(len(places), min(RING_MM, RING_SHARE * nearest_mm))
    look = {"facecolors": "none", "edgecolors": rings, "linewidths": 0.5}
    draw_discs(axes, layout.x_mm, layout.y_mm, size, **look)
    return drawn


def extent_mm(columns_mm: np.ndarray, rows_mm: np.ndarray) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of an image with these centers of its pixels; y points down."""
    half = (columns_mm[1] - columns_mm[0]) / 2
    return columns_mm[0] - half, columns_mm[-1] + half, rows_mm[-1] + half, rows_mm[0] - half


def draw_contact(axes: Axes, contact: Any) -> float:
    """Draws where a `Contact` sticks and slips, and its tangential traction as arrows, in mm with y
    downwards. Returns the largest traction, kPa."""
    inside = contact.pressure_kpa > 0
    colors = np.array([(0, 0, 0, 0), (*STICK_RGB, 255), (*SLIP_RGB, 255)], np.uint8)
    extent = extent_mm(contact.x_mm, contact.y_mm)
    axes.imshow(colors[np.where(inside, 1 + contact.slipping, 0)], extent=extent)
    places, along_mm, peak_kpa = traction_arrows(contact, ARROWS)
    at = contact.x_mm[places[1]], contact.y_mm[places[0]]
    if peak_kpa:
        axes.quiver(*at, *along_mm, angles="xy", scale_units="xy", scale=1.0, pivot="mid")
    x_mm, y_mm = contact.x_mm[inside.any(axis=0)], contact.y_mm[inside.any(axis=1)]
    half = max(np.ptp(x_mm), np.ptp(y_mm)) / 2 + MAP_MARGIN_MM
    x, y = (x_mm[0] + x_mm[-1]) / 2, (y_mm[0] + y_mm[-1]) / 2
    axes.set(xlim=(x - half, x + half), ylim=(y + half, y - half))
    return peak_kpa


def traction_arrows(contact: Any, number: int) -> tuple[tuple[Any, Any], np.ndarray, float]:
    """About `number` arrows of tangential traction along a contact's longer side.

    Returns the (n,) rows and columns of their cells, the arrows, (2, n) mm, and the largest
    traction, kPa, whose arrow is as long as the cells' spacing.
    """
    inside = contact.pressure_kpa > 0
    width, height = (np.ptp(np.flatnonzero(inside.any(axis=axis))) + 1 for axis in (0, 1))
    every = max(1, round(max(width, height) / number))
    rows, columns = np.nonzero(inside)
    kept = (rows % every == every // 2) & (columns % every == every // 2)
    rows, columns = rows[kept], columns[kept]
    peak_kpa = float(np.hypot(*contact.shear_kpa).max())
    length_mm = every * contact.pitch_mm / max(peak_kpa, 1e-9)
    return (rows, columns), contact.shear_kpa[:, rows, columns] * length_mm, peak_kpa


def color_bar(page: Figure, drawn: ScalarMappable, axes: Any, width: float, title: str) -> None:
    """Adds a color bar next to axes. width: relative to that of the axes."""
    bar = page.colorbar(drawn, ax=axes, fraction=width, pad=0.06, aspect=28, format="{x:,g}")
    bar.ax.spines["outline"].set_linewidth(0.4)
    bar.ax.tick_params(labelsize=7, length=2)
    bar.set_label(title, fontsize=7)


class Panel(NamedTuple):
    """An image with its title: of a camera, (R, C, 3) uint8, or tactile, (R, C) counts."""

    title: str
    image: np.ndarray
    phi: Any = None  # of a tactile image, as for `draw_tactile_image`, and layout
    layout: Any = None
    scale: str = ""  # title of its color scale, which panels share; "difference..." of differences


def panels_image(panels: Sequence[Panel], width_in: float = 100.0) -> bytes:
    """PNG of images in a row, with a color bar for each scale. width_in: the most."""
    aspects = [one.image.shape[1] / one.image.shape[0] for one in panels]
    scales = list(dict.fromkeys(one.scale for one in panels if one.scale))
    bars_in = BAR_IN * len(scales)
    peaks = {
        name: max(1.0, *(float(np.abs(one.image).max()) for one in panels if one.scale == name))
        for name in scales
    }

    def draw(page: Figure) -> None:
        all_axes = page.subplots(1, len(panels), squeeze=False, width_ratios=aspects)[0]
        last: dict[str, tuple[Axes, ScalarMappable]] = {}
        for axes, one in zip(all_axes, panels, strict=True):
            axes.set_title(one.title)
            if not one.scale:
                axes.imshow(one.image)
                axes.set_axis_off()
                continue
            peak = peaks[one.scale]
            limits = (-peak if one.scale.startswith("difference") else 0.0, peak)
            drawn = draw_tactile_image(axes, one.image, one.phi, one.layout, limits)
            last[one.scale] = axes, drawn
        for name in reversed(scales):
            axes, drawn = last[name]
            color_bar(page, drawn, axes, 0.12, name)

    height = min(PANEL_IN, WIDEST_IN / max(aspects), (width_in - bars_in) / sum(aspects))
    lines = 1 + max(one.title.count("\n") for one in panels)
    return figure("png", height * sum(aspects) + bars_in, height + lines * TITLE_IN, draw)
