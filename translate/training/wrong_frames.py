"""Wrong frames, made of right ones, that a run must not take for touches of its sensor.

Shape letters: h rows, w columns.
"""

from collections.abc import Callable

import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

from t2twin.translate.uncertainty.ood import INVERSE_TRANSFORMS, OODClass

Alter = Callable[[np.ndarray, np.random.Generator], np.ndarray]
"""Makes a wrong frame of a right one, (h, w, 3) uint8."""

TRANSFORM_SHARE = 0.5
"""Share of the wrong frames that are transformed (assumed: the most frequent mistake of users)."""

FORWARD = INVERSE_TRANSFORMS | {
    OODClass.ROTATED_LEFT: INVERSE_TRANSFORMS[OODClass.ROTATED_RIGHT],
    OODClass.ROTATED_RIGHT: INVERSE_TRANSFORMS[OODClass.ROTATED_LEFT],
}
"""The transforms themselves; only the rotations are not their own inverse."""


def wrong_frame(frame: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, OODClass]:
    """A wrong frame, (h, w, 3) uint8 of any h and w, and its class.

    frame: a right one, (h, w, 3) uint8.
    """
    if rng.random() < TRANSFORM_SHARE:
        kinds = list(FORWARD)
        kind = kinds[rng.integers(len(kinds))]
        return np.ascontiguousarray(FORWARD[kind](frame[None])[0]), kind
    alter = ALTERATIONS[rng.integers(len(ALTERATIONS))]
    return np.ascontiguousarray(alter(frame, rng)), OODClass.OTHER


def cropped(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A part of the same aspect, at any place."""
    share = rng.uniform(0.4, 0.85)
    rows, columns = (round(share * side) for side in frame.shape[:2])
    top, left = rng.integers(frame.shape[0] - rows), rng.integers(frame.shape[1] - columns)
    return frame[top : top + rows, left : left + columns]


def rolled(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Shifted, with what leaves the image on one side on the other."""
    steps = [int(rng.uniform(0.125, 0.875) * side) for side in frame.shape[:2]]
    return np.roll(frame, steps, axis=(0, 1))


def blurred(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    sigma = rng.uniform(0.012, 0.04) * frame.shape[0]
    return gaussian_filter(frame, (sigma, sigma, 0))


def bright(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.clip(frame * rng.uniform(1.8, 4.0), 0, 255).astype(np.uint8)


def dark(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return (frame * rng.uniform(0.08, 0.3)).astype(np.uint8)


def grey(frame: np.ndarray, _: np.random.Generator) -> np.ndarray:
    return np.repeat(frame.mean(axis=-1, keepdims=True), 3, axis=-1).astype(np.uint8)


def negative(frame: np.ndarray, _: np.random.Generator) -> np.ndarray:
    return 255 - frame


def exchanged(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """With two or three channels exchanged, other than blue with red."""
    orders = ((1, 0, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1))
    return frame[..., orders[rng.integers(len(orders))]]


def noise(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return rng.integers(0, 256, frame.shape, dtype=np.uint8)


def spectral(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise whose amplitudes fall with a power of the frequency, as those of photographs do, with
    colors that are more or less alike."""
    rows, columns = frame.shape[:2]
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(columns))
    frequency[0, 0] = 1.0 / max(rows, columns)
    power, share = rng.uniform(0.3, 1.8), rng.uniform()

    def drawn() -> np.ndarray:
        white = np.fft.fft2(rng.standard_normal((rows, columns)))
        values = np.fft.ifft2(white / frequency**power).real
        return values / values.std()

    common = drawn()
    colors = np.stack([share * common + (1.0 - share) * drawn() for _ in range(3)], axis=-1)
    grey = rng.uniform(50.0, 180.0, 3) + rng.uniform(8.0, 70.0) * colors
    return np.clip(grey, 0, 255).astype(np.uint8)


def gradient(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A color in each corner, interpolated, with some noise."""
    corners = rng.uniform(0.0, 255.0, (2, 2, 3))
    down, across = (np.linspace(0.0, 1.0, side) for side in frame.shape[:2])
    lines = (1.0 - down)[:, None, None] * corners[0] + down[:, None, None] * corners[1]
    grey = (1.0 - across)[:, None] * lines[:, None, 0] + across[:, None] * lines[:, None, 1]
    grey += rng.uniform(0.0, 4.0) * rng.standard_normal(grey.shape)
    return np.clip(grey, 0, 255).astype(np.uint8)


def drawing(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rectangles, ellipses, lines and text on an even ground, more or less sharp."""

    def color() -> tuple[int, ...]:
        return tuple(map(int, rng.integers(0, 256, 3)))

    rows, columns = frame.shape[:2]
    image = Image.new("RGB", (columns, rows), color())
    draw = ImageDraw.Draw(image)
    for _ in range(rng.integers(3, 25)):
        x, y = np.sort(rng.integers(0, (columns, rows), (2, 2)), axis=0).T.tolist()
        box = (x[0], y[0], x[1] + 1, y[1] + 1)
        match rng.integers(4):
            case 0:
                draw.rectangle(box, fill=color())
            case 1:
                draw.ellipse(box, fill=color())
            case 2:
                draw.line(box, fill=color(), width=int(rng.integers(1, 6)))
            case _:
                letters = "".join(map(chr, rng.integers(48, 122, 20)))
                draw.text(box[:2], letters, fill=color())
    sigma = rng.uniform(0.0, 2.0)
    return gaussian_filter(np.asarray(image), (sigma, sigma, 0))


ALTERATIONS: tuple[Alter, ...] = (
    cropped, rolled, blurred, bright, dark, grey, negative, exchanged, noise, spectral,
    gradient, drawing,
)  # fmt: skip
"""Their limits are assumed: what a user would call another frame."""
