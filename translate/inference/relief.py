"""Draws the depth of a contact as a relief.

Shape letters: R rows and C columns of the image.
"""

import numpy as np
from PIL import Image, ImageDraw

from t2twin.sim.taxels.tactile_image import in_colors

RELIEF_LIGHT, RELIEF_SHARE = (-0.6, -0.8), 0.8
"""Direction that the light of the relief comes from, along x and y, and the change of brightness by
a slope of 1 (assumed)."""

GREY_SHARE = 0.3
"""Share of white in the colors, so that slopes of small depths are visible (assumed)."""

DARKEST, BRIGHTEST = 0.25, 1.6
"""Limits of that brightness (assumed)."""

MIN_SCALE_MM = 0.1
"""Least depth at the end of the relief's color scale, mm (assumed), so that noise stays dark."""

CAPTION_PX, FONT_SIZE = 34, 12
"""Height of the relief's caption, and its font."""


def relief(depth_mm: np.ndarray, mask: np.ndarray, view_mm: tuple[float, float]) -> Image.Image:
    """A picture of a depth, (R, C): colors from depth 0 to the largest, shaded as if lit from the
    upper left, with the outline of a mask."""
    rows, columns = depth_mm.shape
    down, across = np.gradient(-depth_mm, 2 * view_mm[1] / rows, 2 * view_mm[0] / columns)
    slope = -(RELIEF_LIGHT[0] * across + RELIEF_LIGHT[1] * down)
    shade = (1.0 - RELIEF_SHARE * slope).clip(DARKEST, BRIGHTEST)
    colors = in_colors(depth_mm / max(MIN_SCALE_MM, float(depth_mm.max()))).astype(float)
    inner = mask.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            inner &= np.roll(mask, step, axis)
    colors = (GREY_SHARE * 255.0 + (1.0 - GREY_SHARE) * colors) * shade[..., None]
    colors[mask & ~inner] = 255.0
    return Image.fromarray(colors.clip(0, 255).astype(np.uint8))


def captioned(picture: Image.Image, words: str) -> Image.Image:
    """A picture with words below it."""
    framed = Image.new("RGB", (picture.width, picture.height + CAPTION_PX), "white")
    framed.paste(picture)
    at = (picture.width / 2, picture.height + CAPTION_PX / 2)
    ImageDraw.Draw(framed).text(at, words, "black", anchor="mm", font_size=FONT_SIZE)
    return framed
