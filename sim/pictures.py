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

PNG_END = b"IEND\xae\x42\x60\x82"
"""The end of a PNG's last chunk, whose checksum is always the same (PNG specification, 11.2.5)."""

READ_BYTES = 2**20
"""Bytes that are searched at a time, so that a large file takes little memory (assumed)."""

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
            if image.format == "PNG" and not _has_end(source):
                raise OSError("image file is truncated")
            return ImageOps.exif_transpose(image)
        except _ERRORS as error:
            raise T2TwinError(f"it is damaged ({error})") from error


def check_picture(source: Path | bytes, formats: tuple[str, ...] = FORMATS) -> None:
    """The same checks of the header alone, without decoding. Raises as `open_picture` does."""
    _opened(source, formats).close()


def _has_end(source: Path | bytes) -> bool:
    """Whether the last chunk of a PNG is there: Pillow takes a file that was cut before it."""
    tail = b""
    with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file:
        while block := file.read(READ_BYTES):
            if PNG_END in tail + block:
                return True
            tail = block[-len(PNG_END) :]
    return False


def _opened(source: Path | bytes, formats: tuple[str, ...]) -> Image.Image:
    if isinstance(source, Path) and not source.is_file():
        raise T2TwinError("it is not there" if not source.exists() else "it is not a file")
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
