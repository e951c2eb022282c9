"""Colours of counts, pressures and differences, and pictures as a page takes them.

Counts and pressures are drawn in viridis, as in the project's other pictures, differences in a
diverging map.
"""

import base64
import io
from functools import cache

import numpy as np
from PIL import Image

from t2twin.core.cache_dir import configure_matplotlib_dir

SEQUENTIAL, DIVERGING = "viridis", "RdBu_r"
"""Names of matplotlib's color maps."""

LEVELS = 256
"""Colours of a map."""

FAST = 1
"""Compression of PNG that takes least time."""


@cache
def color_table(name: str = SEQUENTIAL) -> np.ndarray:
    """(LEVELS, 3) uint8: a map's colors from its low end to its high one."""
    configure_matplotlib_dir()
    from matplotlib import colormaps

    return colormaps[name](np.arange(LEVELS), bytes=True)[:, :3]


def colored(values: np.ndarray, most: float, name: str = SEQUENTIAL) -> np.ndarray:
    """(..., 3) uint8: values from 0 to most (of the diverging map from -most) in colors."""
    return color_table(name)[_levels(values, most, name)]


def colored_address(values: np.ndarray, most: float) -> str:
    """(h, w) values from 0 to most as the address of a page's picture in colors: a PNG with the
    map as its palette, in a third of the time of one with all colors."""
    picture = Image.fromarray(_levels(values, most, SEQUENTIAL))
    picture.putpalette(color_table().tobytes())
    return _address(picture)


def data_address(pixels: np.ndarray) -> str:
    """A PNG of (h, w, 3) or (h, w) uint8 as the address of a page's picture, pixel for pixel."""
    return _address(Image.fromarray(pixels))


@cache
def gradient(name: str = SEQUENTIAL, stops: int = 9) -> str:
    """A map as a CSS gradient from left to right."""
    places = np.linspace(0, LEVELS - 1, stops).astype(int)
    return (
        "linear-gradient(to right,"
        + ",".join("#" + "".join(f"{part:02x}" for part in color_table(name)[n]) for n in places)
        + ")"
    )


def _levels(values: np.ndarray, most: float, name: str) -> np.ndarray:
    """Places in a map, (...) uint8."""
    low = -most if name == DIVERGING else 0.0
    places = (values - low) * ((LEVELS - 1) / max(most - low, 1e-9))
    return np.clip(np.rint(places), 0, LEVELS - 1).astype(np.uint8)


def _address(picture: Image.Image) -> str:
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", compress_level=FAST)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
