"""A tactile image as a picture: colors on a scale of counts, the taxels marked."""

from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from t2twin.sim.cyskin.phi import PX_PER_MM

SCALE = 2
"""Picture pixels a tactile pixel."""

MARGIN = 20
BAR_WIDTH = 18
LABELS_WIDTH = 60
TAXEL_RADIUS = 4
FONT_SIZE = 20
UNIT_SIZE = 18
"""Sizes of the picture's furniture, picture pixels."""

HALF_FADED_PART = 0.05
"""Standard deviation at which a color is half white, parts of full scale (assumed: the errors of
what lies beyond the view)."""

STEPS = 5
"""Labels on the color bar."""


def colored_tactile_image(
    image: np.ndarray,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    full_scale: float,
    std: np.ndarray | None = None,
) -> Image.Image:
    """RGB picture of a tactile image with a color bar.

    image: (R, C), counts. x_mm, y_mm: (N,) taxel positions, mm, marked with rings. The colors go
    from zero to full_scale (counts), so that pictures can be compared. std: (R, C), counts, its
    standard deviations; the colors fade to white where the image is not sure: half way at
    HALF_FADED_PART of full scale.
    """
    rows, columns = image.shape[0] * SCALE, image.shape[1] * SCALE
    picture = Image.new("RGB", (columns + 3 * MARGIN + BAR_WIDTH + LABELS_WIDTH, rows + 2 * MARGIN))
    picture.paste("white", (0, 0, *picture.size))
    colors = _colors(image / full_scale)
    if std is not None:
        colors = _faded(colors, std / full_scale)
    large = Image.fromarray(colors).resize((columns, rows), Image.Resampling.BILINEAR)
    picture.paste(large, (MARGIN, MARGIN))
    draw = ImageDraw.Draw(picture)
    for x, y in zip(x_mm, y_mm, strict=True):
        center = (MARGIN + columns / 2 + x * PX_PER_MM * SCALE,
                  MARGIN + rows / 2 + y * PX_PER_MM * SCALE)  # fmt: skip
        draw.circle(center, TAXEL_RADIUS, outline="white")
    left = columns + 2 * MARGIN
    bar = _colors(np.repeat(np.linspace(1.0, 0.0, rows)[:, None], BAR_WIDTH, axis=1))
    picture.paste(Image.fromarray(bar), (left, MARGIN))
    draw.text((left, MARGIN - 4), "counts", "black", anchor="ls", font_size=UNIT_SIZE)
    # The first and the last label stand within the bar's height, clear of the unit above it.
    anchors = ("lb", *("lm",) * (STEPS - 2), "lt")
    for part, anchor in zip(np.linspace(0.0, 1.0, STEPS), anchors, strict=True):
        at = (left + BAR_WIDTH + MARGIN / 3, MARGIN + (1.0 - part) * (rows - 1))
        label = f"{part * full_scale:,.0f}"
        draw.text(at, label, "black", anchor=anchor, font_size=FONT_SIZE)
    return picture


def _faded(colors: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(R, C, 3) uint8, the colors drawn to white by standard deviations, (R, C), parts of full
    scale."""
    kept = (HALF_FADED_PART / (HALF_FADED_PART + std))[..., None]
    return np.rint(kept * colors + (1.0 - kept) * 255.0).astype(np.uint8)


def _colors(values: np.ndarray) -> np.ndarray:
    """(R, C) in [0, 1] -> (R, C, 3) uint8, matplotlib's viridis."""
    colors = _viridis()
    return colors[np.minimum(values.clip(0.0, 1.0) * len(colors), len(colors) - 1).astype(int)]


@cache
def _viridis() -> np.ndarray:
    """(256, 3) uint8, as matplotlib has it, whose import takes as long as a press."""
    with np.load(Path(__file__).parent / "viridis.npz") as file:
        return file["colours"]
