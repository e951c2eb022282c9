"""DIGIT images as the networks take them: read, resized, grey or RGB, scaled."""

from pathlib import Path

import numpy as np
import torch
from PIL import Image

from t2twin.core.errors import T2TwinError
from t2twin.core.images import check_image_header, decode_image
from t2twin.sim.digit.camera.gaussian_noise import white

RGB_MEAN = np.array([0.485, 0.456, 0.406], dtype=np.float32)
RGB_STD = np.array([0.229, 0.224, 0.225], dtype=np.float32)
"""Mean and standard deviation of ImageNet's channels: ResNet18's usual normalisation."""


def open_image(path: Path) -> Image.Image:
    """An image file as grey ("L") or RGB, 8 bits, upright.

    Takes grey, color, palette and 16-bit images, with or without transparency, which is dropped.
    Raises T2TwinError where the file is missing, is no whole PNG or JPEG, or is far too large.
    """
    try:
        image = decode_image(path)
    except T2TwinError as error:
        raise _unreadable(path, error) from None
    if image.mode.startswith("I"):  # 16 bits a pixel, which PIL would clip, not scale, to 8
        return Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    return image.convert("L" if image.mode in ("1", "L", "LA") else "RGB")


def check_image(path: Path) -> None:
    """Most of the same, from the file's header alone. Raises as `open_image` does."""
    try:
        check_image_header(path)
    except T2TwinError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, reason: Exception) -> T2TwinError:
    return T2TwinError(f"{path} cannot be read as an image: {reason}; give PNG or JPEG files")


def to_pixels(image: Image.Image, size: int, grey: bool) -> np.ndarray:
    """Resized with antialiasing to size x size. Returns (size, size, 1 or 3) uint8."""
    image = image.convert("L" if grey else "RGB")
    pixels = np.asarray(image.resize((size, size), Image.Resampling.BILINEAR))
    return pixels[:, :, None] if grey else pixels


def augment(
    pixels: np.ndarray,
    rng: np.random.Generator,
    brightness: float,
    contrast: float,
    noise: float,
) -> np.ndarray:
    """Jitters a batch as a camera and its lights would: gain, offset, pixel noise.

    pixels: (B, S, S, c) float32 in [0, 1]. The rest as in Preset. An untouched frame after the
    picture, c = 6, has its gain and offset and no noise. Returns the same shape, clipped.
    """
    each = (pixels.shape[0], 1, 1, 1)
    gain = 1.0 + contrast * rng.standard_normal(each, dtype=np.float32)
    offset = brightness * rng.standard_normal(each, dtype=np.float32)
    jittered = (pixels - 0.5) * gain + (0.5 + offset)
    if noise > 0:
        picture = jittered[..., : len(RGB_MEAN)]
        picture += np.float32(noise) * white(rng, picture.shape)
    return jittered.clip(0.0, 1.0)


def to_input(pixels: np.ndarray) -> torch.Tensor:
    """What the networks take. pixels: (B, S, S, c) float32 in [0, 1]: grey, RGB, or RGB with
    the DIGIT's untouched frame after the picture (c = 6).

    Returns (B, c, S, S) float32, channels last in memory: grey in [-1, 1], RGB normalized.
    """
    if pixels.shape[-1] == 1:
        scaled = 2.0 * pixels - 1.0
    else:
        images, side, columns, channels = pixels.shape
        rows = pixels.reshape(images, side, columns * channels)  # NumPy is slow on last axes of 3
        times = rows.shape[-1] // len(RGB_MEAN)
        scaled = (rows - np.tile(RGB_MEAN, times)) / np.tile(RGB_STD, times)
    return torch.from_numpy(scaled.reshape(pixels.shape)).permute(0, 3, 1, 2)
