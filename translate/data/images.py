"""DIGIT images: reading, resizing, augmentation and normalization."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from t2twin.core.errors import T2TwinError
from t2twin.core.files import open_regular, read_file
from t2twin.core.images import MAX_FILE_BYTES, check_image_header, decode_image
from t2twin.sim.digit.camera.gaussian_noise import standard_normal

RGB_MEAN = np.array([0.485, 0.456, 0.406], dtype=np.float32)
RGB_STD = np.array([0.229, 0.224, 0.225], dtype=np.float32)
"""Mean and standard deviation of ImageNet's channels, the usual normalization of ResNet18."""

WHITE_GREY = 255.0
"""Full scale of an image, grey levels."""


def open_image(path: Path) -> Image.Image:
    """Reads an image file as grey ("L") or RGB, 8 bits, upright.

    Reads grey, color, palette and 16-bit images; transparency is dropped. Raises T2TwinError for a
    file that is missing, not a complete PNG or JPEG, or far too large.
    """
    content = read_file(path, MAX_FILE_BYTES)
    with _named(path):
        image = decode_image(content)
    if image.mode.startswith("I"):  # 16 bits per pixel, which PIL would clip to 8 bits
        return Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    return image.convert("L" if image.mode in ("1", "L", "LA") else "RGB")


def check_image(path: Path) -> None:
    """Checks the header of an image file. Raises T2TwinError as `open_image` does."""
    with open_regular(path, MAX_FILE_BYTES) as file, _named(path):
        check_image_header(file)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Adds the name of an image file to exceptions."""
    try:
        yield
    except T2TwinError as error:
        raise T2TwinError(
            f"{path} cannot be read as an image: {error}; give PNG or JPEG files"
        ) from None


def to_pixels(image: Image.Image, size: int, grey: bool) -> np.ndarray:
    """Resizes an image with antialiasing. Returns (size, size, 1 or 3) uint8."""
    image = image.convert("L" if grey else "RGB")
    pixels = np.asarray(image.resize((size, size), Image.Resampling.BILINEAR))
    return pixels[:, :, None] if grey else pixels


def augment(
    pixels: np.ndarray,
    rng: np.random.Generator,
    brightness: float,
    contrast: float,
    noise: float,
    drift: float = 0.0,
) -> np.ndarray:
    """Applies random gain, offset and pixel noise to a batch, as a camera and its lights vary.

    pixels: (B, S, S, c) float32 in [0, 1]. Other arguments: see Preset. With c = 6, the background
    frame has the gain and offset of its image, without noise, and with drift. Returns the same
    shape, clipped.
    """
    if drift > 0:
        pixels = np.concatenate([pixels[..., :3], _drifted(pixels[..., 3:], rng, drift)], axis=-1)
    each = (pixels.shape[0], 1, 1, 1)
    gain = 1.0 + contrast * rng.standard_normal(each, dtype=np.float32)
    offset = brightness * rng.standard_normal(each, dtype=np.float32)
    jittered = (pixels - 0.5) * gain + (0.5 + offset)
    if noise > 0:
        image = jittered[..., : len(RGB_MEAN)]
        image += np.float32(noise) * standard_normal(rng, image.shape)
    return jittered.clip(0.0, 1.0)


def _drifted(frames: np.ndarray, rng: np.random.Generator, drift: float) -> np.ndarray:
    """Background frames, (B, S, S, 3 or 0), with other levels and gradients of each color."""
    across = np.linspace(-0.5, 0.5, frames.shape[1], dtype=np.float32)[:, None]
    level, down, right = drift * rng.standard_normal(
        (3, len(frames), 1, 1, frames.shape[-1]), dtype=np.float32
    )
    return frames * (1.0 + level + down * across[:, None] + right * across)


def to_input(pixels: np.ndarray) -> torch.Tensor:
    """The input of the networks.

    pixels: (B, S, S, c) float32 in [0, 1]: grey, RGB, or RGB followed by the background frame
    (c = 6). Returns (B, c, S, S) float32, channels last in memory: grey in [-1, 1], RGB normalized.
    """
    if pixels.shape[-1] == 1:
        scaled = 2.0 * pixels - 1.0
    else:
        images, side, columns, channels = pixels.shape
        rows = pixels.reshape(images, side, columns * channels)  # NumPy is slow on a last axis of 3
        times = rows.shape[-1] // len(RGB_MEAN)
        scaled = (rows - np.tile(RGB_MEAN, times)) / np.tile(RGB_STD, times)
    return torch.from_numpy(scaled.reshape(pixels.shape)).permute(0, 3, 1, 2)
