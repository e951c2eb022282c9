"""A user's own frames: reading them, finding the touched patch, cleaning the background.

Frames are (n, ROWS, COLUMNS, 3) uint8.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, maximum_filter

from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_image
from t2twin.sim.digit.camera.pinhole import COLUMNS, ROWS

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
FORMATS = ("PNG", "JPEG", "BMP")
CROP_PX = 100
"""Side of the square in which contacts are scored, px."""
BLOB_BLUR_PX = 4.0
"""Blur of a difference before the touched patch is looked for, px, against its noise (assumed)."""
VISIBLE_GREY = 40.0
"""Least blurred difference, summed over the colors, that counts as a contact, grey levels: a
drift of the light stays under a third of it, a ball 0.2 mm deep makes several times as much
(assumed from real frames)."""
BLOB_SHARE = 0.35
"""Part of the greatest difference above which a pixel belongs to the patch (assumed)."""
TOUCHED_GREY = 10.0
"""Blurred difference from which a pixel is left out of the background's pattern, grey levels
(assumed)."""
TOUCHED_MARGIN_PX = 8
"""How far from such a pixel others are left out too, px (assumed)."""
PATTERN_BLUR_PX = 4.0
"""What varies over less than this is the background's fixed pattern, px; the rest is light
(assumed)."""
DRIFT_BLUR_PX = 7.0
"""The drift of the light is taken as even over this, px (of 4, 7, 10 and 15 px the best for presses
left out, by little)."""
MIN_NEAR = 1e-3
"""Least frames, in parts, that a place's drift is a mean of (assumed)."""


def read_frame(path: Path) -> np.ndarray:
    """(rows, columns, 3) uint8, upright. Raises T2TwinError if it is not a picture of 8 bits."""
    if not path.exists():
        raise T2TwinError(f"{path} does not exist")
    try:
        image = decode_image(path, FORMATS)
    except T2TwinError as error:
        raise T2TwinError(
            f"{path} is not a picture: {error}; {', '.join(FORMATS)} files are read"
        ) from error
    if image.mode[0] in "IF":
        raise T2TwinError(f"{path} has more than 8 bits a channel; save it with 8")
    return np.array(image.convert("RGB"))


def read_frames(background: Path, folder: Path) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The background, the presses in the order of their names, all upright, and those names.

    The background's own file may lie among them. Raises T2TwinError for what is no picture, for
    another size than the background's or one that upright_frame refuses, and where there are no
    pictures.
    """
    untouched = read_frame(background)
    if not folder.is_dir():
        raise T2TwinError(f"{folder} is not a folder; --presses takes a folder of pictures")
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and path.resolve() != background.resolve()
    )
    if not paths:
        raise T2TwinError(f"{folder} holds no pictures; {', '.join(FORMATS)} files are read")
    frames = []
    for path in paths:
        frame = read_frame(path)
        if frame.shape != untouched.shape:
            raise T2TwinError(
                f"{path.name} is {_size(frame)}, but the background is {_size(untouched)}; "
                "all must be of one size"
            )
        frames.append(frame)
    upright = np.array([upright_frame(frame) for frame in (untouched, *frames)])
    return upright[0], upright[1:], [path.name for path in paths]


def upright_frame(frame: np.ndarray) -> np.ndarray:
    """(ROWS, COLUMNS, 3): a frame (rows, columns, 3) as the maker's interface gives it.

    The camera's own frames lie on their side, 320 x 240 or 640 x 480; the interface turns them a
    quarter against the clock. Larger ones are averaged down.
    Raises T2TwinError for frames that are smaller or of other proportions.
    """
    size = _size(frame)
    if frame.shape[0] < frame.shape[1]:
        frame = np.rot90(frame)
    rows, columns = frame.shape[:2]
    if rows < ROWS or rows * COLUMNS != columns * ROWS:
        raise T2TwinError(
            f"the frames are {size}; they must be {COLUMNS} wide, {ROWS} high, as the maker's "
            "interface gives them, or larger in these proportions, upright or on their side as the "
            "camera has them"
        )
    if rows == ROWS:
        return np.ascontiguousarray(frame)
    image = Image.fromarray(np.ascontiguousarray(frame))
    return np.array(image.resize((COLUMNS, ROWS), Image.Resampling.BOX))


def _size(frame: np.ndarray) -> str:
    return f"{frame.shape[1]} wide, {frame.shape[0]} high"


def touched_patch(frame: np.ndarray, background: np.ndarray) -> tuple[float, float] | None:
    """(row, column) of the middle of what differs from the background, px; None if nothing does."""
    difference = np.abs(_blurred_change(frame, background)).sum(axis=-1)
    peak = float(difference.max())
    if peak < VISIBLE_GREY:
        return None
    weight = np.where(difference > BLOB_SHARE * peak, difference, 0.0)
    rows, columns = np.indices(weight.shape)
    total = float(weight.sum())
    return float((rows * weight).sum()) / total, float((columns * weight).sum()) / total


def _blurred_change(frame: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Change of the frame without its drift: medians of the colors are taken off."""
    change = frame.astype(float) - background
    change -= np.median(change, axis=(0, 1))
    return gaussian_filter(change, (BLOB_BLUR_PX, BLOB_BLUR_PX, 0.0))


def untouched_pixels(frame: np.ndarray, background: np.ndarray) -> np.ndarray:
    """(ROWS, COLUMNS) bool: where a frame shows the background, but for noise and drift."""
    apart = np.abs(_blurred_change(frame, background)).max(axis=-1)
    return maximum_filter(apart, 2 * TOUCHED_MARGIN_PX + 1) < TOUCHED_GREY


def clean_background(background: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """The untouched gel as it is when the frames are taken, its noise averaged out, uint8.

    Its light is the background's own, blurred by PATTERN_BLUR_PX, and the frames' mean drift from
    it: an LED grows warm, and light moves by some grey levels between one frame and the next
    minutes. Where no frame leaves a place near untouched there is no drift. The fixed pattern
    beside the light is averaged over the background and the untouched pixels of the frames.
    """
    light, pattern = _split(background.astype(float))
    weight, free = np.ones(background.shape[:2]), np.zeros(background.shape[:2])
    change = np.zeros_like(light)
    for frame in frames:
        untouched = untouched_pixels(frame, background)
        chosen = untouched[..., None]
        pattern += np.where(chosen, _split(frame.astype(float))[1], 0.0)
        weight += untouched
        change += np.where(chosen, frame.astype(float) - background, 0.0)
        free += untouched
    blur = (DRIFT_BLUR_PX, DRIFT_BLUR_PX, 0.0)
    near = gaussian_filter(free, DRIFT_BLUR_PX, mode="nearest")
    drift = gaussian_filter(change, blur, mode="nearest") / np.maximum(near, MIN_NEAR)[..., None]
    clean = light + pattern / weight[..., None] + drift
    return np.clip(np.rint(clean), 0, 255).astype(np.uint8)


def _split(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    light = gaussian_filter(picture, (PATTERN_BLUR_PX, PATTERN_BLUR_PX, 0.0), mode="nearest")
    return light, picture - light


def crop(picture: np.ndarray, place: Sequence[float] | np.ndarray) -> np.ndarray:
    """The CROP_PX square around a place (row, column), moved in from the picture's edges."""
    half = CROP_PX // 2
    row, column = (
        round(min(max(middle, half), count - half))
        for middle, count in zip(place, picture.shape[:2], strict=True)
    )
    return picture[row - half : row + half, column - half : column + half]
