"""Renders tactile images in colors, with a color bar and marked taxels."""

from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from t2twin.sim.taxels.phi import PX_PER_MM

SCALE = 2
"""Rendered pixels per pixel of the tactile image."""

MARGIN = 20
BAR_WIDTH = 18
LABELS_WIDTH = 60
TAXEL_RADIUS = 4
FONT_SIZE = 20
UNIT_SIZE = 18
"""Sizes of the color bar, labels and marks, rendered pixels."""

HALF_FADED_SHARE = 0.05
"""Standard deviation at which a color is half white, as a share of full scale (assumed: the error
outside the view)."""

STEPS = 5
"""Labels on the color bar."""


def colored_tactile_image(
    image: np.ndarray,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    full_scale: float,
    std: np.ndarray | None = None,
    px_per_mm: float = PX_PER_MM,
) -> Image.Image:
    """A tactile image in colors, with a color bar.

    image: (R, C), counts. x_mm, y_mm: (N,) taxel positions, mm, which are marked with rings. The
    color scale is from zero to full_scale, counts. std: (R, C) standard deviations, counts; colors
    fade to white with them, half way at HALF_FADED_SHARE of full scale. px_per_mm: scale of the
    image.
    """
    rows, columns = image.shape[0] * SCALE, image.shape[1] * SCALE
    width = columns + 3 * MARGIN + BAR_WIDTH + LABELS_WIDTH
    rendered = Image.new("RGB", (width, rows + 2 * MARGIN), "white")
    colors = in_colors(image / full_scale)
    if std is not None:
        colors = _faded(colors, std / full_scale)
    large = Image.fromarray(colors).resize((columns, rows), Image.Resampling.BILINEAR)
    rendered.paste(large, (MARGIN, MARGIN))
    pen = ImageDraw.Draw(rendered)
    for x, y in zip(x_mm, y_mm, strict=True):
        center = (MARGIN + columns / 2 + x * px_per_mm * SCALE,
                  MARGIN + rows / 2 + y * px_per_mm * SCALE)  # fmt: skip
        pen.circle(center, TAXEL_RADIUS, outline="white")
    left = columns + 2 * MARGIN
    bar = in_colors(np.repeat(np.linspace(1.0, 0.0, rows)[:, None], BAR_WIDTH, axis=1))
    rendered.paste(Image.fromarray(bar), (left, MARGIN))
    pen.text((left, MARGIN - 4), "counts", "black", anchor="ls", font_size=UNIT_SIZE)
    # The first and the last label lie within the bar's height, clear of the unit above it.
    anchors = ("lb", *("lm",) * (STEPS - 2), "lt")
    for part, anchor in zip(np.linspace(0.0, 1.0, STEPS), anchors, strict=True):
        at = (left + BAR_WIDTH + MARGIN / 3, MARGIN + (1.0 - part) * (rows - 1))
        label = f"{part * full_scale:,.0f}"
        pen.text(at, label, "black", anchor=anchor, font_size=FONT_SIZE)
    return rendered


def _faded(colors: np.ndarray, std: np.ndarray) -> np.ndarray:
    """Colors, (R, C, 3) uint8, faded by standard deviations, (R, C), as shares of full scale."""
    kept = (HALF_FADED_SHARE / (HALF_FADED_SHARE + std))[..., None]
    return np.rint(kept * colors + (1.0 - kept) * 255.0).astype(np.uint8)


def in_colors(values: np.ndarray) -> np.ndarray:
    """Colors (R, C, 3) uint8 of values (R, C) in [0, 1], by matplotlib's viridis."""
    colors = _viridis()
    return colors[np.minimum(values.clip(0.0, 1.0) * len(colors), len(colors) - 1).astype(int)]


@cache
def _viridis() -> np.ndarray:
    """matplotlib's colormap, (256, 3) uint8; importing matplotlib takes as long as a press."""
    with np.load(Path(__file__).parent / "viridis.npz") as file:
        return file["colours"]
