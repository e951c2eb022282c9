"""Images: reading, checks of arrays from callers, resizing, augmentation and normalization.

Shape letters: B images, h rows, w columns, S image side, c channels.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from t2twin.core.arguments import describe, instance
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.images import MAX_FILE_BYTES, decode_image
from t2twin.sim.optical.response import standard_normal

# Mean and standard deviation of ImageNet's channels, the usual normalization of ResNet18
RGB_MEAN = np.array([0.485, 0.456, 0.406], dtype=np.float32)
RGB_STD = np.array([0.229, 0.224, 0.225], dtype=np.float32)
COLORS = 3  # Channels of a color image: red, green, blue
WHITE_GREY = 255.0  # Full scale of an image, grey levels


def open_image(path: Path) -> Image.Image:
    """Reads an image file as grey ("L") or RGB, 8 bits, upright.

    Reads grey, color, palette and 16-bit images; transparency is dropped. Raises T2TwinError for a
    file that is missing, not a complete PNG or JPEG, or far too large.
    """
    content = read_file(path, MAX_FILE_BYTES)
    try:
        image = decode_image(content)
    except T2TwinError as error:
        raise T2TwinError(
            f"{path} cannot be read as an image: {error}; give PNG or JPEG files"
        ) from None
    if image.mode.startswith("I"):  # 16 bits per pixel, which PIL would clip to 8 bits
        return Image.fromarray((np.asarray(image) >> 8).astype(np.uint8))
    return image.convert("L" if image.mode in ("1", "L", "LA") else "RGB")


def read_image(path: Path, order: FrameOrder = UPRIGHT) -> np.ndarray:
    """(h, w) or (h, w, 3) uint8: a stored frame, upright; errors as for `open_image`."""
    return instance(order, "order", FrameOrder).upright(np.asarray(open_image(path)))


def to_pixels(image: Image.Image, size: int, grey: bool) -> np.ndarray:
    """Resizes an image with antialiasing. Returns (size, size, 1 or 3) uint8."""
    image = image.convert("L" if grey else "RGB")
    pixels = np.asarray(image.resize((size, size), Image.Resampling.BILINEAR))
    return pixels[:, :, None] if grey else pixels


def augment(
    pixels: torch.Tensor,
    rng: np.random.Generator,
    brightness: float,
    contrast: float,
    noise: float,
    drift: float = 0.0,
) -> torch.Tensor:
    """Applies random gain, offset and pixel noise to a batch, as a camera and its lights vary.

    pixels: (B, S, S, c) float32 in [0, 1]. Other arguments: see Preset. With c = 6, the background
    frame has the gain and offset of its image, without noise, and with drift. Returns the same
    shape, clipped. The pixel noise on a GPU differs from that on a CPU.
    """

    def normal(*shape: int) -> torch.Tensor:
        return on_device(rng.standard_normal(shape, dtype=np.float32), pixels.device)

    images = pixels.shape[0]
    if drift > 0:
        frames = pixels[..., COLORS:]
        level, down, right = drift * normal(3, images, 1, 1, frames.shape[-1])
        across = on_device(np.linspace(-0.5, 0.5, pixels.shape[1], dtype=np.float32), pixels.device)
        across = across[:, None]
        drifted = frames * (1.0 + level + down * across[:, None] + right * across)
        pixels = torch.cat([pixels[..., :COLORS], drifted], dim=-1)
    gain = 1.0 + contrast * normal(images, 1, 1, 1)
    offset = brightness * normal(images, 1, 1, 1)
    jittered = (pixels - 0.5) * gain + (0.5 + offset)
    if noise > 0:
        image = jittered[..., :COLORS]
        if image.device.type == "cpu":
            image += noise * torch.from_numpy(standard_normal(rng, tuple(image.shape)))
        else:
            generator = torch.Generator(image.device).manual_seed(int(rng.integers(2**63)))
            image += noise * torch.randn(image.shape, generator=generator, device=image.device)
    return jittered.clamp(0.0, 1.0)


def on_device(values: np.ndarray, device: torch.device) -> torch.Tensor:
    """A few values on a device, without waiting for what it computes."""
    return torch.from_numpy(values).to(device, non_blocking=True)


def to_input(pixels: np.ndarray | torch.Tensor) -> torch.Tensor:
    """The input of the networks, (B, c, S, S) float32, channels last in memory: grey in [-1, 1], or
    RGB normalized. pixels: (B, S, S, c) in [0, 1]; c = 6 is RGB and the background frame."""
    if pixels.shape[-1] == 1:
        return to_scaled(pixels)
    images, side, columns, channels = pixels.shape
    rows = torch.as_tensor(pixels).reshape(images, side, columns * channels)
    times = rows.shape[-1] // COLORS  # a last axis of 3 is slow
    mean, std = (on_device(np.tile(each, times), rows.device) for each in (RGB_MEAN, RGB_STD))
    return ((rows - mean) / std).reshape(pixels.shape).permute(0, 3, 1, 2)


def to_scaled(pixels: np.ndarray | torch.Tensor) -> torch.Tensor:
    """Pictures of any channels, (B, S, S, c) float32 in [0, 1], as (B, c, S, S) in [-1, 1]."""
    return (2.0 * torch.as_tensor(pixels) - 1.0).permute(0, 3, 1, 2)


# One image, a batch, or a list of images, as `image_list` takes them
Images = np.ndarray | Sequence[np.ndarray]
ONE = "an image of shape (h, w) or (h, w, 3)"
EXPECTED = f"{ONE}, a batch of shape (B, h, w, 3) or (B, h, w, 1), or a list of images"


def image_list(images: object, name: str = "images") -> tuple[list[np.ndarray], bool]:
    """A list of the images in an argument, and whether the argument was a single image.

    images: one image, (h, w) or (h, w, 3); a batch, (B, h, w, 3) or (B, h, w, 1); or a list or
    tuple of images, whose sizes may differ. All are NumPy arrays of uint8, channels red, green,
    blue. A batch and a list may be empty. name: of the argument, for messages.
    Raises T2TwinError for other values.
    """
    if isinstance(images, list | tuple):
        return [one_image(image, f"{name}[{n}]", ONE) for n, image in enumerate(images)], False
    array = _array(images, name, EXPECTED)
    if array.ndim != 4:
        return [one_image(array, name)], True
    if array.shape[3] not in (1, COLORS) or 0 in array.shape[1:]:
        raise _wrong_shape(array, name, EXPECTED)
    return list(array if array.shape[3] == COLORS else array[..., 0]), False


def one_image(image: object, name: str, expected: str = EXPECTED) -> np.ndarray:
    """The array of one image, (h, w) or (h, w, 3) uint8. Raises T2TwinError for other values.

    expected: the allowed values, for the message.
    """
    array = _array(image, name, expected)
    is_image = array.ndim == 2 or (array.ndim == 3 and array.shape[2] == COLORS)
    if not is_image or 0 in array.shape:
        raise _wrong_shape(array, name, expected)
    return array


def resized(frames: Sequence[np.ndarray], size: int, grey: bool) -> np.ndarray:
    """(B, size, size, 1 or 3) uint8, from the images of `image_list`."""
    pixels = [np.empty((0, size, size, 1 if grey else COLORS), np.uint8)]
    pixels += [to_pixels(Image.fromarray(frame), size, grey)[None] for frame in frames]
    return np.concatenate(pixels)


def check_pixels(pixels: np.ndarray, size: int, channels: Sequence[int]) -> None:
    """Raises T2TwinError for an array that is not (B, size, size, c) uint8, c one of channels."""
    array = _array(pixels, "pixels", f"an array of shape (B, {size}, {size}, c)")
    if array.ndim != 4 or array.shape[1:3] != (size, size) or array.shape[3] not in channels:
        allowed = " or ".join(f"(B, {size}, {size}, {each})" for each in channels)
        raise T2TwinError(
            f"pixels have shape {array.shape}; expected {allowed}, as pixels_of returns"
        )


def _array(value: object, name: str, expected: str) -> np.ndarray:
    is_masked = np.ma.is_masked(value)
    if isinstance(value, np.ndarray) and value.dtype == np.uint8 and not is_masked:
        return value
    found = f"of {value.dtype}" if type(value) is np.ndarray else describe(value)
    raise T2TwinError(
        f"{name} is {found}; expected {expected}, NumPy arrays of uint8 from 0 to 255"
    )


def _wrong_shape(array: np.ndarray, name: str, expected: str) -> T2TwinError:
    return T2TwinError(
        f"{name} has shape {array.shape}; expected {expected}, of uint8, with pixels, channels "
        "last, without transparency"
    )
