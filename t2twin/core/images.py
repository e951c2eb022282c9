"""Opens and checks image files, encodes PNG images, and finds faults of frames."""

import io
import re
import struct
import zlib
from functools import reduce

import numpy as np
from PIL import Image, ImageOps
from zlib_ng import zlib_ng

from t2twin.core.errors import T2TwinError

MAX_PIXELS = 12_000_000  # of an image (assumed: 4,000 x 3,000, more than tactile cameras have)
FORMATS = ("PNG", "JPEG")  # allowed formats of images
SUFFIXES = (".png", ".jpg", ".jpeg")  # of images, lower or upper case
MAX_FILE_BYTES = 100_000_000  # of image files (assumed: MAX_PIXELS uncompressed, of 64 bits each)

# Exceptions of Pillow for files that are no images, damaged, truncated or too large
_BOMBS = Image.DecompressionBombError, Image.DecompressionBombWarning
_ERRORS = OSError, SyntaxError, ValueError, *_BOMBS

SIGNATURE = b"\x89PNG\r\n\x1a\n"
EIGHT_BIT_RGB = (8, 2, 0, 0, 0)  # bit depth, color type; compression, filter method, interlacing
AVERAGE = 3  # row filter that predicts the mean of left and above (PNG specification, 9.2)


def decode_image(content: bytes, formats: tuple[str, ...] = FORMATS) -> Image.Image:
    """A decoded image, rotated by its EXIF orientation, in its stored mode.

    Raises T2TwinError without the image's name, which the caller adds, for another format, a
    damaged image, a file of several, or more than MAX_PIXELS, which its header contains.
    """
    try:
        opened = Image.open(io.BytesIO(content), formats=formats)
    except _BOMBS as error:
        raise T2TwinError(f"at most {MAX_PIXELS:,} pixels are allowed ({error})") from error
    except _ERRORS as error:
        words = re.sub(r" <_io\.BytesIO[^>]*>", "", str(error))
        raise T2TwinError(f"it is no {' or '.join(formats)} image ({words})") from error
    with opened as image:
        if image.width * image.height > MAX_PIXELS:
            raise T2TwinError(
                f"it is {image.width} wide, {image.height} high; at most {MAX_PIXELS:,} pixels are "
                "allowed"
            )
        if (frames := getattr(image, "n_frames", 1)) > 1:
            raise T2TwinError(f"it contains {frames} images; expected one in each file")
        try:
            image.load()
            return ImageOps.exif_transpose(image)
        except _ERRORS as error:
            raise T2TwinError(f"it is damaged ({error})") from error


def encode_png(image: np.ndarray) -> bytes:
    """PNG bytes of a (rows, columns, 3) uint8 image with camera noise, in which LZ77 finds no
    repeats: Huffman codes of each row's differences from the mean of left and above."""
    rows, columns, _ = image.shape
    values = image.reshape(rows, -1)
    filtered = np.full((rows, 1 + 3 * columns), AVERAGE, np.uint8)
    left, above = np.zeros((2, *values.shape), np.uint8)
    left[:, 3:], above[1:] = values[:, :-3], values[:-1]
    np.subtract(values, (left & above) + ((left ^ above) >> 1), out=filtered[:, 1:])
    deflate = zlib_ng.compressobj(strategy=zlib_ng.Z_HUFFMAN_ONLY)
    body = deflate.compress(filtered) + deflate.flush()
    header = struct.pack(">II5B", columns, rows, *EIGHT_BIT_RGB)
    parts = [SIGNATURE]
    for kind, content in ((b"IHDR", header), (b"IDAT", body), (b"IEND", b"")):
        checksum = struct.pack(">I", zlib.crc32(content, zlib.crc32(kind)))
        parts += [struct.pack(">I", len(content)), kind, content, checksum]
    return b"".join(parts)


def decode_png(content: bytes) -> np.ndarray:
    """The (rows, columns, 3) uint8 image in PNG bytes of a dataset.

    Raises T2TwinError where the bytes are not a complete image.
    """
    try:
        return np.asarray(decode_image(content, ("PNG",)).convert("RGB"))
    except T2TwinError as error:
        raise T2TwinError(
            "an image of the dataset cannot be decoded; `t2twin simdata --verify` names its shard"
        ) from error


DARKEST_GREY = 12.0  # mean below which an image is black (assumed: images have 70 to 135)
# An image is overexposed above this share of values of at least this grey level (assumed)
BRIGHT_GREY, BRIGHT_SHARE = 250, 0.3

COLORED_GREY, COLORLESS_GREY = 6.0, 3.0
"""Median difference between the largest and the smallest color of a pixel, grey levels. A sensor
has colors if its mean image has at least the first; an image below the second has none (assumed).
The pretrained networks' mean images have 12 and 25, a grey image 0."""

NOISE_GREY = 20.0
"""Median difference of neighboring pixels above which an image is noise, grey levels (assumed:
a camera's noise of 7 has 7)."""

BLACK, OVEREXPOSED, COLORLESS, NOISE = "black", "overexposed", "without color", "noise"


def is_colored(image: np.ndarray) -> bool:
    """Whether a sensor with this mean image, (..., c) in grey levels, has colors."""
    return _color_grey(image) >= COLORED_GREY


def fault_of(image: np.ndarray, colored: bool) -> str | None:
    """BLACK, OVEREXPOSED, COLORLESS or None, at any size.

    image: (h, w, c) uint8. colored: whether the sensor has colors.
    """
    if image.mean() < DARKEST_GREY:
        return BLACK
    if (image >= BRIGHT_GREY).mean() > BRIGHT_SHARE:
        return OVEREXPOSED
    return COLORLESS if colored and _color_grey(image) < COLORLESS_GREY else None


def is_noise(frame: np.ndarray) -> bool:
    """Whether a frame at its own size, (h, w, c) or (h, w) uint8, is noise."""
    left, right = frame[:, :-1], frame[:, 1:]
    steps = np.maximum(left, right) - np.minimum(left, right)
    return bool(2 * np.count_nonzero(steps > NOISE_GREY) > steps.size)  # their median is above


def _color_grey(values: np.ndarray) -> float:
    """Median difference between the largest and the smallest of the last axis."""
    planes = np.moveaxis(values, -1, 0)  # a reduction over so short an axis is slow
    return float(np.median(reduce(np.maximum, planes) - reduce(np.minimum, planes)))
