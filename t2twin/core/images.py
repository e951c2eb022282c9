"""The one way in which an image is opened, whoever made it.

Pictures as PNG, small and quick for pictures whose entropy is camera noise.

Noise leaves nothing for LZ77 to find, so the search for repeats is left out: every row is
predicted from its left and upper neighbors, which halves the noise that a prediction adds, and
what is left is Huffman coded. On pictures of `t2twin simdata` that takes a quarter of the bytes and
two thirds of the time off Pillow's quickest setting.
"""

import io
import struct
import warnings
import zlib
from pathlib import Path
from threading import Lock

import numpy as np
from PIL import Image, ImageOps

from t2twin.core.errors import T2TwinError

MAX_PIXELS = 12_000_000
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
    of which image: no file, another format, damaged, or more than MAX_PIXELS.
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
        raise T2TwinError(f"it has more than {MAX_PIXELS:,} pixels, the most allowed") from None
    except _ERRORS:
        raise T2TwinError(f"it is no whole {' or '.join(formats)} image") from None
    width, height = image.size
    if width * height > MAX_PIXELS:
        image.close()
        raise T2TwinError(
            f"it is {width} wide, {height} high; at most {MAX_PIXELS:,} pixels are allowed"
        )
    return image


SIGNATURE = b"\x89PNG\r\n\x1a\n"
EIGHT_BIT_RGB = (8, 2, 0, 0, 0)
"""Bit depth, color type, and the one compression, filter method and interlace that are meant."""

AVERAGE = 3
"""Number of the row filter that predicts the mean of left and above (PNG specification, 9.2)."""

LEVEL, WINDOW_BITS, MEMORY_LEVEL = 1, 15, 8
"""zlib's; with Huffman coding alone the level and the window change nothing."""


def encode_png(image: np.ndarray) -> bytes:
    """PNG bytes of a (rows, columns, 3) uint8 picture.

    Raises T2TwinError for another shape or type.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise T2TwinError(
            f"a picture of {image.dtype} {image.shape} cannot be kept; it must be uint8, "
            "rows x columns x 3"
        )
    rows, columns, _ = image.shape
    deflate = zlib.compressobj(LEVEL, zlib.DEFLATED, WINDOW_BITS, MEMORY_LEVEL, zlib.Z_HUFFMAN_ONLY)
    body = deflate.compress(_filtered(image)) + deflate.flush()
    header = struct.pack(">II5B", columns, rows, *EIGHT_BIT_RGB)
    return SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", body) + _chunk(b"IEND", b"")


def decode_png(content: bytes) -> np.ndarray:
    """The (rows, columns, 3) uint8 picture in PNG bytes: the one way to read a stored picture.

    Raises T2TwinError where the bytes are no whole picture.
    """
    try:
        return np.asarray(open_picture(content, ("PNG",)).convert("RGB"))
    except T2TwinError as error:
        raise T2TwinError(
            "a stored picture cannot be decoded; `t2twin simdata --verify` names its shard"
        ) from error


def _filtered(image: np.ndarray) -> bytes:
    rows = image.shape[0]
    values = image.reshape(rows, -1)
    around = np.zeros(values.shape, np.uint16)
    around[:, 3:] = values[:, :-3]
    around[1:] += values[:-1]
    filtered = np.empty((rows, 1 + values.shape[1]), np.uint8)
    filtered[:, 0] = AVERAGE
    np.subtract(values, (around >> 1).astype(np.uint8), out=filtered[:, 1:])
    return filtered.tobytes()


def _chunk(kind: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)
