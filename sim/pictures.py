"""The one way in which an image is opened, whoever made it."""

import io
import warnings
from pathlib import Path
from threading import Lock

from PIL import Image, ImageOps

from t2twin.primitives_cad.errors import T2TwinError

MOST_PIXELS = 12_000_000
"""Most pixels of an image (assumed: 4,000 x 3,000, more than any tactile camera has). Their number
stands in a file's header, so that a small file cannot ask for all the memory."""

FORMATS = ("PNG", "JPEG")
"""Formats that a user's images may have."""

_ERRORS = (
    OSError,
    SyntaxError,
    ValueError,
    Image.DecompressionBombError,
    Image.DecompressionBombWarning,
)
"""What Pillow raises for files that are no images, damaged, cut short or far too large."""

PNG_END = b"IEND\xaeB`\x82"
"""The type and the checksum of a PNG file's last chunk, which is empty (PNG, third edition,
11.2.5). Pillow reads a file that is cut off before it, once all rows are there."""

MAX_FILE_BYTES = 100_000_000
"""Largest image file that is read, bytes (assumed: MAX_PIXELS uncompressed, of 64 bits each)."""

_opening = Lock()
"""Filters of warnings are the whole process's: one thread at a time changes them."""


def open_picture(source: Path | bytes, formats: tuple[str, ...] = FORMATS) -> Image.Image:
    """An image, decoded and upright (by EXIF), in the mode that it is stored in.

    source: a file, or its content. Raises T2TwinError with the reason alone, for the caller to say
    of which image: no file, another format, damaged, or more than MOST_PIXELS.
    """
    with _opened(source, formats) as image:
        try:
            image.load()
            whole = ImageOps.exif_transpose(image)
        except _ERRORS as error:
            raise T2TwinError(f"it is damaged ({error})") from error
    if image.format == "PNG" and PNG_END not in (
        source if isinstance(source, bytes) else source.read_bytes()
    ):
        raise T2TwinError("it is damaged (it is cut off before its end)")
    return whole


def check_picture(source: Path | bytes, formats: tuple[str, ...] = FORMATS) -> None:
    """The same checks of the header alone, without decoding. Raises as `open_picture` does."""
    _opened(source, formats).close()


def _opened(source: Path | bytes, formats: tuple[str, ...]) -> Image.Image:
    if isinstance(source, Path):
        if not source.is_file():
            raise T2TwinError("it is not there" if not source.exists() else "it is not a file")
        if (size := source.stat().st_size) > MAX_FILE_BYTES:
            raise T2TwinError(
                f"it has {size / 1e6:,.0f} MB; at most {MAX_FILE_BYTES / 1e6:,.0f} MB are allowed"
            )
    readable = io.BytesIO(source) if isinstance(source, bytes) else source
    try:
        with _opening, warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(readable, formats=formats)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise T2TwinError(f"it has more than {MOST_PIXELS:,} pixels, the most allowed") from None
    except _ERRORS:
        raise T2TwinError(f"it is no whole {' or '.join(formats)} image") from None
    width, height = image.size
    if width * height > MOST_PIXELS:
        image.close()
        raise T2TwinError(
            f"it is {width} wide, {height} high; at most {MOST_PIXELS:,} pixels are allowed"
        )
    return image
