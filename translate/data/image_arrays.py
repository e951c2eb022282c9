"""Checks of image arrays that callers of the Python API pass.

Shape letters: B images, h rows, w columns.
"""

from collections.abc import Sequence
from os import PathLike

import numpy as np
import torch
from PIL import Image

from t2twin.core.arguments import describe
from t2twin.core.errors import T2TwinError
from t2twin.translate.data.images import to_pixels

Images = np.ndarray | Sequence[np.ndarray]
"""One image, a batch, or a list of images, as `image_list` takes them."""

COLORS = 3
"""Channels of a color image: red, green, blue."""

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
    if isinstance(value, np.ndarray):
        if value.dtype != np.uint8:
            raise T2TwinError(
                f"{name} has type {value.dtype}; expected {expected}, of uint8, from 0 to 255"
            )
        return value
    hint = ""
    if isinstance(value, torch.Tensor):
        hint = "; tensor.cpu().numpy() converts a tensor, channels must be last"
    elif isinstance(value, Image.Image):
        hint = "; numpy.asarray(image.convert('RGB')) converts a PIL image"
    elif isinstance(value, str | PathLike):
        hint = "; numpy.asarray(PIL.Image.open(path).convert('RGB')) reads a file"
    raise T2TwinError(
        f"{name} is {describe(value)}; expected {expected}, NumPy arrays of uint8{hint}"
    )


def _wrong_shape(array: np.ndarray, name: str, expected: str) -> T2TwinError:
    shape, hint = array.shape, ""
    if 0 in shape:
        hint = "; it has no pixels"
    elif array.ndim in (3, 4) and shape[-1] == 4:
        hint = "; image[..., :3] leaves out the transparency of an RGBA image"
    elif array.ndim in (3, 4) and shape[-3] in (1, COLORS):
        axes = (1, 2, 0) if array.ndim == 3 else (0, 2, 3, 1)
        hint = f"; it may be channels-first: images.transpose{axes} puts the channels last"
    elif array.ndim == 3:
        hint = "; a batch of grey images is (B, h, w, 1), made by images[..., None]"
    return T2TwinError(f"{name} has shape {shape}; expected {expected}, of uint8{hint}")
