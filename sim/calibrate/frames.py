"""Frames of a user's gel camera: contact, cleaned background and noise.

Frames are (n, rows, columns, 3) uint8.
"""

from collections.abc import Sequence
from os.path import realpath  # a link to itself does not raise
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, maximum_filter
from scipy.optimize import least_squares

from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.images import COLORLESS, MAX_FILE_BYTES, NOISE, decode_image, fault_of, is_noise
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.response import REACH, TAPS, Noise

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
FORMATS = ("PNG", "JPEG", "BMP")
CROP_PX = 100  # side of the crop around a contact on which scores are computed, px
BLOB_BLUR_PX = 4.0
"""Blur of the difference to the background before the contact is detected, px (assumed)."""
VISIBLE_GREY = 40.0
"""Smallest blurred difference of a contact, summed over the colors, grey levels (assumed from real
frames). Drift of the light is below a third of it, a ball 0.2 mm deep several times above."""
BLOB_SHARE = 0.35
"""Fraction of the largest difference from which a pixel belongs to the contact (assumed)."""
CONTACT_GREY = 10.0
"""Blurred difference from which a pixel does not show the background, grey levels (assumed)."""
CONTACT_MARGIN_PX = 8  # distance to such a pixel within which others are excluded too, px (assumed)
PATTERN_BLUR_PX = 4.0
"""Length scale that separates the background's fixed pattern from its light, px (assumed)."""
DRIFT_BLUR_PX = 7.0
"""Length over which the drift of the light is averaged, px (of 4, 7, 10 and 15 px slightly the best
in cross-validation)."""
MIN_WEIGHT = 1e-3  # smallest blurred number of frames that a drift is divided by (assumed)
DRIFT_PX = 8.0  # length scale above which variation is drift of the light, not noise, px (assumed)
LAGS = 4  # largest lag of the autocorrelation along an axis, px
MIN_PIXELS = 2_000  # smallest number of background pixels of a frame (assumed)
QUIETEST_GREY = 0.05
"""Standard deviation of the noise of frames without any, such as edited ones, grey levels."""


def read_frame(path: Path) -> np.ndarray:
    """(rows, columns, 3) uint8. Raises T2TwinError for a file that is not an image of 8 bits."""
    content = read_file(path, MAX_FILE_BYTES)
    try:
        image = decode_image(content, FORMATS)
    except T2TwinError as error:
        raise T2TwinError(
            f"{path} is not an image: {error}; allowed are {', '.join(FORMATS)}"
        ) from error
    if image.mode[0] in "IF":
        raise T2TwinError(f"{path} has more than 8 bits a channel; save it with 8")
    return np.array(image.convert("RGB"))


def read_frames(
    background: Path, folder: Path, camera: Camera
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The background, the presses sorted by name, all upright, and their names.

    The folder may contain the background's file. Raises T2TwinError for files that are not images,
    for frames of another size than the background or refused by upright_frame, and for a folder
    without images.
    """
    if not folder.is_dir():
        raise T2TwinError(f"{folder} is not a folder; --presses takes a folder of images")
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and realpath(path) != realpath(background)
    )
    if not paths:
        raise T2TwinError(f"{folder} contains no images; {', '.join(FORMATS)} files are read")
    first, *others = (read_frame(path) for path in (background, *paths))
    for path, frame in zip(paths, others, strict=True):
        if frame.shape != first.shape:
            raise T2TwinError(
                f"{path.name} is {_size(frame)}, but the background is {_size(first)}; all must be "
                "of one size"
            )
    upright = np.array([upright_frame(frame, camera) for frame in (first, *others)])
    return upright[0], upright[1:], [path.name for path in paths]


def upright_frame(frame: np.ndarray, camera: Camera) -> np.ndarray:
    """(rows, columns, 3): a frame in the size of the camera's images.

    Sensors with upright images have a wide camera, whose own frames are rotated by a quarter turn
    counterclockwise, as the interface of the default sensor does. Larger frames are averaged down.
    Raises T2TwinError for smaller frames and other proportions.
    """
    size = _size(frame)
    is_upright = camera.rows > camera.columns
    if is_upright and frame.shape[0] < frame.shape[1]:
        frame = np.rot90(frame)
    rows, columns = frame.shape[:2]
    if rows < camera.rows or rows * camera.columns != columns * camera.rows:
        raise T2TwinError(
            f"the frames are {size}; they must be {camera.columns} wide, {camera.rows} high, as "
            "the sensor's file says, or larger in these proportions"
            + (", upright or on their side" if is_upright else "")
        )
    if rows == camera.rows:
        return np.ascontiguousarray(frame)
    image = Image.fromarray(np.ascontiguousarray(frame))
    return np.array(image.resize((camera.columns, camera.rows), Image.Resampling.BOX))


def check_usable(frame: np.ndarray, name: str, colored: bool) -> None:
    """Raises T2TwinError for a frame that no gel camera takes. colored: whether its sensor has
    colors."""
    fault = NOISE if is_noise(frame) else fault_of(frame, colored)
    if fault is not None:
        light = "colored light" if fault == COLORLESS else "light"
        raise T2TwinError(f"{name} is {fault}; expected frames of the sensor in its own {light}")


def _size(frame: np.ndarray) -> str:
    return f"{frame.shape[1]} wide, {frame.shape[0]} high"


def contact_patch(frame: np.ndarray, background: np.ndarray) -> tuple[float, float] | None:
    """(row, column) of the middle of the contact, px; None if none is visible."""
    difference = np.abs(_blurred_change(frame, background)).sum(axis=-1)
    peak = float(difference.max())
    if peak < VISIBLE_GREY:
        return None
    weight = np.where(difference > BLOB_SHARE * peak, difference, 0.0)
    rows, columns = np.indices(weight.shape)
    total = float(weight.sum())
    return float((rows * weight).sum()) / total, float((columns * weight).sum()) / total


def _blurred_change(frame: np.ndarray, background: np.ndarray) -> np.ndarray:
    """Blurred difference to the background without drift: each color's median is subtracted."""
    change = frame.astype(float) - background
    change -= np.median(change, axis=(0, 1))
    return gaussian_filter(change, (BLOB_BLUR_PX, BLOB_BLUR_PX, 0.0))


def background_pixels(frame: np.ndarray, background: np.ndarray) -> np.ndarray:
    """(rows, columns) bool: pixels that show the background, apart from noise and drift."""
    difference = np.abs(_blurred_change(frame, background)).max(axis=-1)
    return maximum_filter(difference, 2 * CONTACT_MARGIN_PX + 1) < CONTACT_GREY


def clean_background(background: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """uint8: the background at the time of the frames, with its noise averaged out.

    The light is the background's, blurred by PATTERN_BLUR_PX, plus the frames' mean drift: LEDs
    warm up, which changes it by some grey levels within minutes. The drift is 0 where no frame
    shows the background nearby. The fixed pattern is averaged over the background and the frames'
    background pixels.
    """
    light, pattern = _split(background.astype(float))
    weight, count = np.ones(background.shape[:2]), np.zeros(background.shape[:2])
    change = np.zeros_like(light)
    for frame in frames:
        shows_background = background_pixels(frame, background)
        mask = shows_background[..., None]
        pattern += np.where(mask, _split(frame.astype(float))[1], 0.0)
        weight += shows_background
        change += np.where(mask, frame.astype(float) - background, 0.0)
        count += shows_background
    blur = (DRIFT_BLUR_PX, DRIFT_BLUR_PX, 0.0)
    near = gaussian_filter(count, DRIFT_BLUR_PX, mode="nearest")
    drift = gaussian_filter(change, blur, mode="nearest") / np.maximum(near, MIN_WEIGHT)[..., None]
    clean = light + pattern / weight[..., None] + drift
    return np.clip(np.rint(clean), 0, 255).astype(np.uint8)


def _split(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Light and fixed pattern."""
    light = gaussian_filter(image, (PATTERN_BLUR_PX, PATTERN_BLUR_PX, 0.0), mode="nearest")
    return light, image - light


def crop(image: np.ndarray, place: Sequence[float] | np.ndarray) -> np.ndarray:
    """The square of CROP_PX, or as large as the image, around a place (row, column), moved into
    the image."""
    half = min(CROP_PX, *image.shape[:2]) // 2
    row, column = (
        round(min(max(middle, half), count - half))
        for middle, count in zip(place, image.shape[:2], strict=True)
    )
    return image[row - half : row + half, column - half : column + half]


def measure_noise(clean: np.ndarray, frames: np.ndarray, background: np.ndarray) -> Noise | None:
    """The noise of frames (n, rows, columns, 3) uint8, from their background pixels.

    clean: the background with its noise averaged out. background: the frame. Returns None if no
    frame has MIN_PIXELS.
    """
    covariance, autocovariance, count = np.zeros((3, 3)), np.zeros((LAGS, 3)), 0
    for frame in frames:
        mask = background_pixels(frame, background)
        if np.count_nonzero(mask) < MIN_PIXELS:
            continue
        noise = frame.astype(float) - clean
        noise -= gaussian_filter(noise, (DRIFT_PX, DRIFT_PX, 0.0), mode="nearest")
        noise -= noise[mask].mean(axis=0)
        covariance += noise[mask].T @ noise[mask] / np.count_nonzero(mask)
        autocovariance += [_autocovariance(noise, mask, lag) for lag in range(1, LAGS + 1)]
        count += 1
    if not count:
        return None
    covariance = covariance / count + QUIETEST_GREY**2 * np.eye(3)
    correlation = (autocovariance / count / np.diag(covariance)).mean(axis=1)
    return Noise(np.linalg.cholesky(covariance), _taps(correlation))


def _autocovariance(noise: np.ndarray, mask: np.ndarray, lag: int) -> np.ndarray:
    """(RGB) mean product of the noise of masked pixels at a lag along an axis."""
    products = []
    for first, second in ((np.s_[:-lag], np.s_[lag:]), (np.s_[:, :-lag], np.s_[:, lag:])):
        both = mask[first] & mask[second]
        products.append((noise[first] * noise[second])[both].mean(axis=0))
    return np.mean(products, axis=0)


def _taps(correlation: np.ndarray) -> np.ndarray:
    """(TAPS,) symmetric weights of unit energy whose output on white noise has this
    autocorrelation, (LAGS,)."""

    def weights(sides: np.ndarray) -> np.ndarray:
        taps = np.concatenate([sides[::-1], [1.0], sides])
        return taps / np.sqrt(np.sum(taps**2))

    def residual(sides: np.ndarray) -> np.ndarray:
        taps = weights(sides)
        own = np.correlate(taps, taps, "full")[TAPS : TAPS + LAGS]
        return own - correlation

    fit = least_squares(residual, np.full(REACH, 0.3), bounds=(-1.0, 1.0))
    return weights(fit.x)
