"""Texts from Jinja templates, which lie next to the modules that compute their values."""

import base64
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

PACKAGE = Path(__file__).parents[1]
"""Folder of the package t2twin. Names of templates are relative to it."""

MEDIA_TYPES = {b"\x89P": "image/png", b"\xff\xd8": "image/jpeg", b"<?": "image/svg+xml"}
"""Media types of image files by their first two bytes."""


def render(template: str, /, **values: Any) -> str:
    """Text of a template, such as "sim/dataset/card.md", with these values.

    Values are escaped in HTML only. Raises jinja2.UndefinedError for a missing value.
    """
    return environment().get_template(template).render(values)


@cache
def environment() -> "Environment":
    """The Jinja environment. Filters: f formats as an f-string, data_uri embeds an image file."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

    result = Environment(
        loader=FileSystemLoader(PACKAGE),
        autoescape=select_autoescape(("html",)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    result.filters |= {"f": format, "data_uri": data_uri}
    return result


def data_uri(content: bytes) -> str:
    """Data URI of a PNG, JPEG or SVG file."""
    return f"data:{MEDIA_TYPES[content[:2]]};base64,{base64.b64encode(content).decode('ascii')}"
