"""Out-of-distribution detection for images of gel cameras.

An image is compared with statistics of the cells of a run's training images, and with the
background frame of its sensor: along the border, where most contacts change little, and by the
fixed pattern of camera and gel.

Shape letters: B images, S image side, c channels, K = CELLS * CELLS * c values.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from enum import StrEnum
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct, field
from scipy import fft

from t2twin.core.errors import counted
from t2twin.core.images import BLACK, COLORLESS, NOISE, OVEREXPOSED, fault_of, is_colored, is_noise
from t2twin.translate.data.pairs import ImageFile

CELLS = 8  # Cells along each side of an image (assumed: a contact covers a few of them)
# Lower bound of a cell's standard deviation, grey levels (assumed: a camera's drift)
MIN_STD_GREY = 2.0
# Distance above which an image is out of distribution, divided by the largest distance of a
# training image (assumed). Measured at scale small: at most 0.9 for unseen shapes, at least 2.2
# for a real DIGIT with its own light, at least 4 for rotated images
MAX_DISTANCE_RATIO = 1.5
# Share of the cells along the border, those closest to the background frame, that a contact does
# not change much (assumed)
BORDER_SHARE = 0.4
# Largest difference of these cells from the background frame, grey levels (assumed). Measured: at
# most 13.2 in 1,200 frames of 240 units, 0.4 to 15 N; at least 14.8 for another unit's frame
MAX_BORDER_GREY = 14.0
# The same, without a common fixed pattern. Measured: 1 of the 1,200 frames is above
MAX_UNPATTERNED_GREY = 5.0
# Correlation of the fixed patterns from which they are the same (assumed). Measured: at most 0.034
# for another unit; at least 0.067 for 21 frames of a real unit; above in 98 % of the frames
MIN_PATTERN = 0.04
PATTERN_PX = 96  # Images of twice this side or more are averaged before patterns are compared
# Largest searched shift of a pattern, its pixels; its correlation there, and how far it exceeds
# that without a shift, also in standard deviations over the shifts, from which a frame or a half of
# it is shifted (assumed). Measured: no right frame of 200 sampled and a real unit, 0.5 and 0 % as
# JPEG of quality 75; 99 and 95 % of their frames shifted by 10 pixels; 99 and 14 % of those whose
# lower half is shifted by 40
MAX_SHIFT, MIN_SHIFTED, MIN_GAIN, DEVIATIONS = 24, 0.035, 0.025, 5.0
# Share of the background frame's mean pattern below which a frame without a common one is blurred
# (assumed). Measured: at least 0.95 for 100 sampled units, also as JPEG, and 250 real frames; at
# most 0.89 for frames that are defocused by 1.2 to 4 % of their height
MIN_SHARP = 0.9
ASPECT_TOLERANCE = 0.02  # Relative, of an image's width over its height (assumed: 5 px of 240)
# An image is transformed if undoing the transform reduces that difference below this share of it
# (assumed), or if the fixed patterns are then the same. It is not if they are the same before
TRANSFORMED_SHARE = 0.5
STORED_DECIMALS = 3  # Decimals of the statistics, which a run stores as text
MIN_IMAGES = 100  # Training images that the statistics need (assumed)
MAX_BACKGROUNDS = 64  # Number of background frames whose results are kept (assumed: 15 MB)
BATCH_SIZE = 1024  # Images in one batch; bounds memory


class OODClass(StrEnum):
    """Result of the classification of one image."""

    IN_DISTRIBUTION = "in distribution"
    NOT_COMPARED = "not compared with training images"
    UPSIDE_DOWN = "upside down"
    MIRRORED = "mirrored"
    UPSIDE_DOWN_MIRRORED = "upside down and mirrored"
    ROTATED_LEFT = "on its side"
    ROTATED_RIGHT = "on its other side"
    BLACK = BLACK
    OVEREXPOSED = OVEREXPOSED
    COLORLESS = COLORLESS
    FORCE = "of a force at or beyond the limits of the training"
    BLUE_FIRST = "with blue before red"
    UNLIKE_BACKGROUND = "of another sensor than its background frame"
    BLURRED = "less sharp than its background frame"
    SHIFTED = "shifted against its background frame, in whole or in half"
    OTHER_ORDER = "stored in another order of pixels or colors"
    TOUCHED_BACKGROUND = "with a background frame that shows a contact"
    NOISE = NOISE
    OTHER_ASPECT = "of another aspect ratio"
    OTHER = "of another light or sensor"

    @property
    def inside(self) -> bool | None:
        """Whether the image is like the training images; None if it is not compared with them."""
        return None if self == OODClass.NOT_COMPARED else self == OODClass.IN_DISTRIBUTION

    @property
    def entry(self) -> dict[str, Any]:
        """The JSON keys of an image: in_distribution, and ood_class unless it is true."""
        named = {} if self.inside else {"ood_class": str(self)}
        return {"in_distribution": self.inside, **named}


# Functions that undo each transform, (B, S, S, c) -> (B, S, S, c)
INVERSE_TRANSFORMS: dict[OODClass, Callable[[np.ndarray], np.ndarray]] = {
    OODClass.UPSIDE_DOWN: lambda pixels: pixels[:, ::-1, ::-1],
    OODClass.MIRRORED: lambda pixels: pixels[:, :, ::-1],
    OODClass.UPSIDE_DOWN_MIRRORED: lambda pixels: pixels[:, ::-1],
    OODClass.ROTATED_LEFT: lambda pixels: np.rot90(pixels, 1, (1, 2)),
    OODClass.ROTATED_RIGHT: lambda pixels: np.rot90(pixels, -1, (1, 2)),
    OODClass.BLUE_FIRST: lambda pixels: pixels[..., ::-1],
}


class OODDetector(Struct, frozen=True):
    """Statistics of a run's training images: (K,) grey levels, and their largest distance."""

    mean: np.ndarray = field(name="mean_grey")
    std: np.ndarray = field(name="std_grey")
    max_distance: Annotated[float, Meta(ge=0)]

    def check(self, channels: int) -> None:
        """Raises ValueError for statistics that are not those of images with these channels."""
        values = CELLS * CELLS * channels
        if not self.mean.size == self.std.size == values or self.std.min() <= 0:
            raise ValueError(
                f"ood_detector must have {values} values in mean_grey, and as many above 0 in "
                "std_grey"
            )

    def distances(self, pixels: np.ndarray) -> np.ndarray:
        """(B,) root mean squares of the cells' standardized differences from the mean."""
        cells = _cell_means(pixels).reshape(len(pixels), self.mean.size)
        return _distances(cells, self.mean, self.std)

    def classify(self, pixels: np.ndarray) -> list[OODClass]:
        """(B,) classes; of several transforms, that with the least distance."""
        limit, classes = MAX_DISTANCE_RATIO * self.max_distance, []
        colored = is_colored(self.mean.reshape(CELLS**2, -1))
        for image, distance in zip(pixels[:, None], self.distances(pixels), strict=True):
            found = OODClass(fault_of(image[0], colored) or OODClass.IN_DISTRIBUTION)
            if found == OODClass.IN_DISTRIBUTION and distance > limit:
                undone = ((self.distances(f(image))[0], k) for k, f in INVERSE_TRANSFORMS.items())
                least, kind = min(undone, key=lambda each: each[0])
                found = kind if least <= limit else OODClass.OTHER
            classes.append(found)
        return classes


def classify_frame(
    frame: np.ndarray, aspect: float, background: np.ndarray | None = None,
    of_pixels: OODClass = OODClass.IN_DISTRIBUTION,
) -> OODClass:  # fmt: skip
    """The class of a frame at its own size, uint8: NOISE, OTHER_ASPECT or that of its pixels.

    aspect: width over height of the sensor's images. Of the background frame only that is checked.
    """
    if of_pixels in INVERSE_TRANSFORMS:
        return of_pixels
    if is_noise(frame):
        return OODClass.NOISE
    both = (frame,) if background is None else (frame, background)
    ratios = [each.shape[1] / each.shape[0] / aspect for each in both]
    is_own = all(abs(ratio - 1.0) <= ASPECT_TOLERANCE for ratio in ratios)
    return of_pixels if is_own else OODClass.OTHER_ASPECT


def unlike(classes: Sequence[OODClass], run: str, names: Sequence[object] = ()) -> str | None:
    """The warning for images that are out of distribution; None if there are none."""
    found = [n for n, each in enumerate(classes) if each.inside is False]
    if not found:
        return None
    example = f", such as {names[found[0]]}" if names else ""
    kinds = Counter(classes[n] for n in found).most_common()
    verb = "is" if len(found) == 1 else "are"
    return (
        f"{len(found)} of {counted(len(classes), 'image')} {verb} unlike all training images of "
        f"{run}{example} "
        f"({', '.join(f'{count} {name}' for name, count in kinds)}); their predictions are not "
        "reliable: expected upright frames, red before blue, not cropped, of the same "
        "sensor in the same light, its own background frame without contact, and forces of the "
        "training"
    )


def compare_with_background(pixels: np.ndarray, frames: np.ndarray) -> list[OODClass]:
    """(B,) classes of images by their difference from their own background frames."""
    return [_compare(*each) for each in zip(pixels[:, None], frames, strict=True)]


def _compare(image: np.ndarray, frame: np.ndarray) -> OODClass:
    """image: (1, S, S, c). frame: (S, S, c)."""
    cells, pattern = _cell_means(image), _pattern(image)
    of_frame, fixed, spectra = _of_background(frame.tobytes(), frame.shape)
    undone = [undo(cells) for undo in INVERSE_TRANSFORMS.values()]
    off = np.sqrt(np.square(np.concatenate([cells, *undone]) - of_frame).mean(axis=-1))
    sides = [off[:, [0, -1]], off[:, 1:-1, [0, -1]]]
    border = np.concatenate([each.reshape(len(off), -1) for each in sides], axis=1)
    difference, *others = np.quantile(border, BORDER_SHARE, axis=1).tolist()
    differences = dict(zip(INVERSE_TRANSFORMS, others, strict=True))
    has_pattern = _correlation(pattern, fixed) >= MIN_PATTERN
    if has_pattern:  # that of a grey gel is the same with blue before red
        differences = {OODClass.BLUE_FIRST: differences[OODClass.BLUE_FIRST]}
    else:
        alike = {k: _correlation(undo(pattern), fixed) for k, undo in INVERSE_TRANSFORMS.items()}
        nearest = max(alike, key=lambda kind: alike[kind])
        if alike[nearest] >= MIN_PATTERN and differences[nearest] <= MAX_BORDER_GREY:
            return nearest
        if np.abs(pattern).mean() < MIN_SHARP * np.abs(fixed).mean():
            return OODClass.BLURRED
    nearest = min(differences, key=lambda kind: differences[kind])
    if differences[nearest] < TRANSFORMED_SHARE * difference:
        return nearest
    if _is_shifted(_spectra(pattern[0]), spectra):
        return OODClass.SHIFTED
    limit = MAX_BORDER_GREY if has_pattern else MAX_UNPATTERNED_GREY
    return OODClass.IN_DISTRIBUTION if difference <= limit else OODClass.UNLIKE_BACKGROUND


@lru_cache(MAX_BACKGROUNDS)
def _of_background(content: bytes, shape: tuple[int, ...]) -> tuple[Any, ...]:
    frame = np.frombuffer(content, np.uint8).reshape(1, *shape)
    pattern = _pattern(frame)
    return _cell_means(frame), pattern, _spectra(pattern[0])


def fit_ood_detector(images: ImageFile | np.ndarray) -> OODDetector | None:
    """Statistics of images, (B, S, S, c) uint8; None for fewer than MIN_IMAGES."""
    if len(images) < MIN_IMAGES:
        return None
    parts = [slice(start, start + BATCH_SIZE) for start in range(0, len(images), BATCH_SIZE)]
    cells = np.concatenate([_cell_means(images[part]) for part in parts]).reshape(len(images), -1)
    mean = cells.mean(axis=0).round(STORED_DECIMALS)
    std = np.maximum(cells.std(axis=0), MIN_STD_GREY).round(STORED_DECIMALS)
    return OODDetector(mean, std, float(_distances(cells, mean, std).max()))


def _distances(cells: np.ndarray, mean: np.ndarray, std: np.ndarray) -> np.ndarray:
    """(B,), see OODDetector.distances."""
    return np.sqrt(np.square((cells - mean) / std).mean(axis=1))


def _pattern(image: np.ndarray) -> np.ndarray:
    """(1, s, s, c): differences from four neighbors, limited, as the edges of a contact exceed."""
    step = max(1, image.shape[1] // PATTERN_PX)
    side = image.shape[1] // step
    grey = np.ascontiguousarray(image[0, : side * step, : side * step].transpose(2, 0, 1))
    grey = grey.astype(np.float32)  # each channel contiguous, which is fast
    if step > 1:
        grey = grey.reshape(-1, side, step, side, step).mean(axis=(2, 4))
    pattern = 4.0 * grey[:, 1:-1, 1:-1] - grey[:, 2:, 1:-1] - grey[:, :-2, 1:-1]
    pattern = pattern - grey[:, 1:-1, 2:] - grey[:, 1:-1, :-2]
    limit = 3.0 * 1.48 * np.median(np.abs(pattern), axis=(1, 2))[:, None, None]  # 1.48: Gaussian
    return np.clip(pattern, -limit, limit).transpose(1, 2, 0)[None]


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Of two patterns, -1 to 1; 0 for an even image."""
    norm = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float((one * other).sum()) / norm if norm > 0 else 0.0


def _spectra(pattern: np.ndarray) -> tuple[Any, list[float], list[Any]] | None:
    """Of a pattern's upper and lower half: spectra, sums of squares, shape; None if too small."""
    if len(pattern) < PATTERN_PX - 2:
        return None
    half = len(pattern) // 2
    halves = pattern[: 2 * half].reshape(2, half, *pattern.shape[1:]).transpose(0, 3, 1, 2)
    shape = [fft.next_fast_len(length, real=True) for length in halves.shape[2:]]
    return fft.rfft2(halves, shape), [float(np.square(each).sum()) for each in halves], shape


def _is_shifted(one: Any, fixed: Any) -> bool:
    """Whether a pattern, or a half of it, is the fixed one somewhere else, by their `_spectra`."""
    if one is None:
        return False
    halves: Any = fft.irfft2((one[0] * fixed[0].conj()).sum(axis=1), one[2])
    found = np.stack([halves.sum(axis=0), *halves])
    squares = [np.array([sum(each[1]), *each[1]]) for each in (one, fixed)]
    found = np.roll(found, (MAX_SHIFT, MAX_SHIFT), (1, 2))[:, : 2 * MAX_SHIFT, : 2 * MAX_SHIFT]
    near = found / np.sqrt(squares[0] * squares[1]).clip(min=1e-9)[:, None, None]
    unshifted = near[:, MAX_SHIFT, MAX_SHIFT].copy()
    near[:, MAX_SHIFT - 1 : MAX_SHIFT + 2, MAX_SHIFT - 1 : MAX_SHIFT + 2] = 0.0  # of drift
    gain = np.maximum(MIN_GAIN, DEVIATIONS * near.std(axis=(1, 2)))
    return bool((near.max(axis=(1, 2)) >= np.maximum(MIN_SHIFTED, unshifted + gain)).any())


def _cell_means(pixels: np.ndarray) -> np.ndarray:
    """(B, CELLS, CELLS, c) means."""
    ends = np.linspace(0, pixels.shape[1], CELLS + 1).astype(int)
    rows = [pixels[:, a:b].sum(axis=1, dtype=np.uint32) for a, b in pairwise(ends)]
    sums = np.add.reduceat(np.stack(rows, axis=1), ends[:-1], axis=2)
    sizes = np.diff(ends)
    return sums / (sizes[:, None, None] * sizes[None, :, None])
