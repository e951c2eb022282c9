"""Elements of the cards as HTML, with colors of counts, pressures and differences.

All texts are escaped here. Text has the page's own color, for the light and the dark theme.
"""

import io
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from typing import Any

import numpy as np
from PIL import Image

from t2twin.core.cache_dir import configure_matplotlib_dir
from t2twin.core.templates import data_uri

STYLE = """<style>
.t2 { font-size: 0.8rem; line-height: 1.4; padding: 0.5rem 1.1rem 0.3rem 0.7rem; }
.t2 h4 { margin: 0.9rem 0 0.3rem; font-size: 0.85rem; font-weight: 600; }
.t2 .row { display: grid; grid-template-columns: 1fr 1fr 1fr; gap: 0.7rem;
  margin-bottom: 0.7rem; }
.t2 .two { grid-template-columns: 1fr 1fr; }
.t2 .row > * { margin: 0; min-width: 0; overflow-wrap: anywhere; }
.t2 b { display: block; font-weight: 600; }
.t2 img, .t2 svg { display: block; width: 100%; border-radius: 3px; }
.t2 .soft { opacity: 0.75; }
.t2 .bar { margin-bottom: 0.55rem; }
.t2 .bar i { display: block; height: 0.55rem; border-radius: 2px; margin: 0.15rem 0; }
.t2 .ends { display: flex; justify-content: space-between; }
.t2 .key { display: inline-block; width: 0.7rem; height: 0.7rem; border-radius: 2px; }
.t2 td, .t2 .ends { font-variant-numeric: tabular-nums; }
.t2 table { width: 100%; border-collapse: collapse; }
.t2 th { font-weight: 400; text-align: left; opacity: 0.75; }
.t2 td, .t2 thead th { text-align: right; }
.t2 tbody tr { border-top: 1px solid rgba(128, 128, 128, 0.25); }
.t2 .wide { grid-column: span 2; }
.t2 > figure { margin: 0.4rem 0 0.9rem; }
.t2 p { margin: 0.3rem 0; }
.t2 code { font-size: 0.75rem; overflow-wrap: anywhere; }
.t2-drop::after { content: "Drop the file here"; position: fixed; inset: 0.6rem; z-index: 9999;
  display: grid; place-items: center; border: 3px dashed currentColor; border-radius: 8px;
  background: rgba(128, 128, 128, 0.35); font: 600 1.4rem sans-serif; pointer-events: none; }
@media (max-width: 36em) {
  .mantine-Paper-root:has(.t2) { left: 0 !important; width: 100% !important; }
  .mantine-Paper-root:has(.t2) .mantine-ScrollArea-content > div { width: 100% !important; }
}
</style>"""
"""Style of the cards. On a phone, viser's panel of controls is widened to the screen."""

SEQUENTIAL, DIVERGING = "viridis", "RdBu_r"
"""Names of matplotlib color maps: for counts and pressures, and for differences."""

LEVELS = 256
"""Number of colors of a map."""

PNG_COMPRESSION = 1
"""Fastest compression level."""


def page(parts: Iterable[str]) -> str:
    return f'<div class="t2">{"".join(parts)}</div>'


def row(*cells: str, kind: str = "row") -> str:
    return f'<div class="{kind}">{"".join(cells)}</div>'


def figure(title: str, note: str, url: str, name: str) -> str:
    """An image with its title and a note. name: for scripts and tests."""
    return (
        f"<figure><b>{escape(title)}</b>"
        f'<img decoding="sync" alt="{escape(title)}" data-name="{name}" src="{url}">'
        f'<span class="soft">{escape(note)}</span></figure>'
    )


def heading(text: str) -> str:
    return f"<h4>{escape(text)}</h4>"


def paragraph(text: str) -> str:
    return f'<p class="soft">{escape(text)}</p>'


def code(text: str) -> str:
    return f"<p><code>{escape(text)}</code></p>"


def key(color: str, name: str) -> str:
    """A color of a legend with its name."""
    return f'<i class="key" style="background:{color}"></i> {escape(name)}'


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], name: str) -> str:
    """heads: of all columns but the first. rows: the first cell is the name of the row."""
    head = "".join(f"<th>{escape(each)}</th>" for each in ("", *heads))
    body = ""
    for first, *cells in rows:
        values = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
        body += f"<tr><th>{escape(first)}</th>{values}</tr>"
    return f'<table data-name="{name}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


@cache
def color_table(name: str = SEQUENTIAL) -> np.ndarray:
    """(LEVELS, 3) uint8: colors of a map, from low to high values."""
    configure_matplotlib_dir()
    from matplotlib import colormaps

    return colormaps[name](np.arange(LEVELS), bytes=True)[:, :3]


def color_values(values: np.ndarray, high: float, name: str = SEQUENTIAL) -> np.ndarray:
    """(..., 3) uint8: colors of values from 0 to high; of the diverging map, from -high to high."""
    return color_table(name)[_levels(values, high, name)]


def color_image_url(values: np.ndarray, high: float) -> str:
    """Data URL of (h, w) values from 0 to high in colors.

    It is a PNG with the map as its palette, which takes a third of the time of a PNG in RGB.
    """
    image = Image.fromarray(_levels(values, high, SEQUENTIAL))
    image.putpalette(color_table().tobytes())
    return data_url(image)


def image_url(pixels: np.ndarray) -> str:
    """Data URL of a PNG of (h, w, 3) or (h, w) uint8."""
    return data_url(Image.fromarray(pixels))


@cache
def gradient(name: str = SEQUENTIAL, stops: int = 9) -> str:
    """CSS gradient of a map, from left to right."""
    levels = np.linspace(0, LEVELS - 1, stops).astype(int)
    colors = ("#" + "".join(f"{part:02x}" for part in color_table(name)[n]) for n in levels)
    return f"linear-gradient(to right,{','.join(colors)})"


def _levels(values: np.ndarray, high: float, name: str) -> np.ndarray:
    """Indices of the colors in the map, (...) uint8."""
    low = -high if name == DIVERGING else 0.0
    levels = (values - low) * ((LEVELS - 1) / max(high - low, 1e-9))
    return np.clip(np.rint(levels), 0, LEVELS - 1).astype(np.uint8)


def data_url(image: Image.Image, **options: Any) -> str:
    """Data URL of a PNG. options: of `Image.save`."""
    buffer = io.BytesIO()
    image.save(buffer, "PNG", compress_level=PNG_COMPRESSION, **options)
    return data_uri(buffer.getvalue())
