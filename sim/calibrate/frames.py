"""Frames of a user's gel camera: markers, contact, background, noise, scores, and coverage.

Frames are (n, rows, columns, 3) uint8. An optics file is fitted to the light around the presses.
Farther away it is extrapolated.
"""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from os.path import realpath  # a link to itself does not raise
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter, grey_closing, maximum_filter, shift
from scipy.optimize import least_squares
from scipy.sparse.csgraph import connected_components
from skimage.metrics import structural_similarity

from t2twin.core.arguments import instance
from t2twin.core.errors import T2TwinError
from t2twin.core.files import read_file
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.images import COLORLESS, MAX_FILE_BYTES, NOISE, decode_image, fault_of, is_noise
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.response import REACH, TAPS, Noise

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp")
FORMATS = ("PNG", "JPEG", "BMP")
CROP_PX = 100  # side of the crop around a contact on which scores are computed, px
BLOB_BLUR_PX = 4.0  # blur of the change before the contact is detected, px (assumed)
# Smallest blurred difference of a contact, summed over the colors, grey levels (assumed: drift of
VISIBLE_GREY = 40.0  # the light is below a third of it, a ball 0.2 mm deep several times above)
BLOB_SHARE = 0.35  # of the largest change, from which a pixel belongs to the contact (assumed)
CONTACT_GREY = 10.0  # blurred change from which a pixel is not background (assumed)
CONTACT_MARGIN_PX = 8  # distance to such a pixel within which others are excluded too, px (assumed)
PATTERN_BLUR_PX = 4.0  # length that separates fixed pattern and light, px (assumed)
DRIFT_BLUR_PX = 7.0  # over which drift is averaged, px (of 4, 7, 10, 15 the best by a little)
MIN_WEIGHT = 1e-3  # smallest blurred number of frames that a drift is divided by (assumed)
DRIFT_PX = 8.0  # length scale above which variation is drift of the light, not noise, px (assumed)
LAGS = 4  # largest lag of the autocorrelation along an axis, px
MIN_PIXELS = 2_000  # smallest number of background pixels of a frame (assumed)
QUIETEST_GREY = 0.05  # noise of frames without any, such as edited ones, grey levels

# Distance of presses of one place (assumed: the middle of the visible change moves by up to 0.3 mm
SAME_PLACE_MM = 0.4  # with the depth, measured on simulated presses)
MARKER_MM, FILL_MM = 1.5, 0.3  # largest diameter of a marker, and blur that fills it in (assumed)
INK, MIN_INK, DARK_GREY = 0.75, 0.01, 4.0
"""A pixel is ink where each color plus DARK_GREY is below INK of that of its surroundings: none in
frames of real sensors without markers, 9 % and more with markers (measured). The gel has markers
from a share of MIN_INK of the pixels on."""
STEPS = 40  # places across the shorter side of the image that are compared with the presses
ENOUGH = 0.95  # share of the gel in view from which on no more presses are needed (assumed)
MOST = 12  # largest number of next presses
BRIGHT_GREY, SHADE = 110.0, 0.35  # mean of the picture's background, and factor of its shaded part
PICTURE_PX = 720  # longer side of the picture, at least, px
PRESSED, NEXT = (255, 255, 255), (255, 220, 0)  # colors of the presses and of the next ones


@dataclass(frozen=True)
class Score:
    """l1: mean absolute difference, grey levels. psnr_db: peak signal-to-noise ratio."""

    l1: float
    ssim: float
    psnr_db: float

    def __str__(self) -> str:
        return f"{self.psnr_db:.1f} dB, SSIM {self.ssim:.3f}"


def read_frame(path: Path, order: FrameOrder = UPRIGHT) -> np.ndarray:
    """(rows, columns, 3) uint8, of a stored frame. Raises T2TwinError for a file that is not an
    image of 8 bits."""
    content = read_file(path, MAX_FILE_BYTES)
    try:
        image = decode_image(content, FORMATS)
    except T2TwinError as error:
        raise T2TwinError(
            f"{path} is not an image: {error}; allowed are {', '.join(FORMATS)}"
        ) from error
    if image.mode[0] in "IF":
        raise T2TwinError(f"{path} has more than 8 bits a channel; save it with 8")
    return instance(order, "order", FrameOrder).upright(np.array(image.convert("RGB")))


def read_frames(
    background: Path, folder: Path, camera: Camera, order: FrameOrder = UPRIGHT
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """The background, the presses sorted by name, without the background, upright, and names."""
    if not folder.is_dir():
        raise T2TwinError(f"{folder} is not a folder; --presses takes a folder of images")
    paths = sorted(
        path
        for path in folder.iterdir()
        if path.suffix.lower() in SUFFIXES and realpath(path) != realpath(background)
    )
    if not paths:
        raise T2TwinError(f"{folder} contains no images; {', '.join(FORMATS)} files are read")
    first, *others = (read_frame(path, order) for path in (background, *paths))
    for path, frame in zip(paths, others, strict=True):
        if frame.shape != first.shape:
            sizes = f"is {_size(frame)}, but the background is {_size(first)}"
            raise T2TwinError(f"{path.name} {sizes}; all must be of one size")
    sized = np.array([sized_frame(frame, camera) for frame in (first, *others)])
    return sized[0], sized[1:], [path.name for path in paths]


def sized_frame(frame: np.ndarray, camera: Camera, advice: str | None = None) -> np.ndarray:
    """(rows, columns, 3): a frame in the size of the camera's images; larger ones are averaged.
    advice: of the order in which frames that lie on their side are probably stored."""
    rows, columns = frame.shape[:2]

    def fits(high: int, wide: int) -> bool:
        off = abs(high * camera.columns - wide * camera.rows) / camera.rows  # columns
        return high >= camera.rows and off <= 0.5  # sizes are whole numbers

    if not fits(rows, columns):
        advice = advice or "they lie on their side; --turn-deg turns them by 90 or 270 degrees"
        raise T2TwinError(
            f"the frames are {_size(frame)}; they must be {camera.columns} wide, {camera.rows} "
            "high, as the sensor's file says, or larger in these proportions"
            + (f"; {advice}" if fits(columns, rows) else "")
        )
    if (rows, columns) == (camera.rows, camera.columns):
        return np.ascontiguousarray(frame)
    image = Image.fromarray(np.ascontiguousarray(frame))
    return np.array(image.resize((camera.columns, camera.rows), Image.Resampling.BOX))


def check_usable(frame: np.ndarray, name: str, colored: bool) -> None:
    """Raises T2TwinError for a frame that no sensor with, or without, colors takes."""
    fault = NOISE if is_noise(frame) else fault_of(frame, colored)
    if fault is not None:
        light = "colored light" if fault == COLORLESS else "light"
        raise T2TwinError(f"{name} is {fault}; expected frames of the sensor in its own {light}")


def _size(frame: np.ndarray) -> str:
    return f"{frame.shape[1]} wide, {frame.shape[0]} high"


def without_markers(frames: Sequence[np.ndarray], camera: Camera) -> tuple[np.ndarray, bool]:
    """The frames (n, ...) with printed markers filled in, and whether the first one shows any."""
    scale, filled = camera.scale_px_per_mm, []
    for frame in frames:
        smooth = gaussian_filter(frame.astype(float), (1.0, 1.0, 0.0))
        around = grey_closing(smooth, (*[2 * round(MARKER_MM * scale / 2) + 1] * 2, 1))
        ink = ((smooth + DARK_GREY) / (around + DARK_GREY)).max(axis=-1) < INK
        if not filled and ink.mean() < MIN_INK:
            return np.array(frames), False
        wide = maximum_filter(ink, 2 * max(round(FILL_MM * scale / 3), 1) + 1)
        clear = np.logical_not(wide)[..., None]
        near = _light(clear, FILL_MM * scale)
        light = _light(np.where(clear, frame, 0), FILL_MM * scale) / np.maximum(near, MIN_WEIGHT)
        filled.append(np.where(clear, frame, np.rint(light)).astype(np.uint8))
    return np.array(filled), True


def contact_patch(frame: np.ndarray, background: np.ndarray) -> tuple[float, float] | None:
    """(row, column) of the middle of the contact, px; None if none is visible."""
    weight = _contact_change(frame, background)
    if weight.max() < VISIBLE_GREY:
        return None
    rows, columns = np.indices(weight.shape)
    total = float(weight.sum())
    return float((rows * weight).sum()) / total, float((columns * weight).sum()) / total


def contact_width_px(frame: np.ndarray, background: np.ndarray) -> float:
    """Width of the visible change: that of the contact, or up to 1.4 times as much (measured)."""
    area = np.count_nonzero(_contact_change(frame, background))
    return 2.0 * float(np.sqrt(area / np.pi))


def _contact_change(frame: np.ndarray, background: np.ndarray) -> np.ndarray:
    """(rows, columns) blurred change, summed over the colors, where it belongs to the contact."""
    change = np.abs(_blurred_change(frame, background)).sum(axis=-1)
    return np.where(change > BLOB_SHARE * change.max(), change, 0.0)


def same_places(patches_mm: np.ndarray) -> np.ndarray:
    """(n,) number of the place of each contact (n, 2), in the order of their first contacts."""
    return connected_components(_apart_mm(patches_mm, patches_mm) <= SAME_PLACE_MM)[1]


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
    """uint8: the background at the time of the frames, with its noise averaged out. The light is
    the background's, blurred, plus the frames' mean drift, as LEDs warm up."""
    light = _light(background, PATTERN_BLUR_PX)
    pattern, change, count = background - light, np.zeros_like(light), np.zeros(light.shape[:2])
    for frame in frames:
        shows_background = background_pixels(frame, background)
        mask = shows_background[..., None]
        pattern += np.where(mask, frame - _light(frame, PATTERN_BLUR_PX), 0.0)
        change += np.where(mask, frame.astype(float) - background, 0.0)
        count += shows_background
    near = gaussian_filter(count, DRIFT_BLUR_PX, mode="nearest")
    drift = _light(change, DRIFT_BLUR_PX) / np.maximum(near, MIN_WEIGHT)[..., None]
    clean = light + pattern / (1.0 + count)[..., None] + drift
    return np.clip(np.rint(clean), 0, 255).astype(np.uint8)


def _light(image: np.ndarray, blur_px: float) -> np.ndarray:
    """(rows, columns, 3) float64: an image, blurred."""
    return gaussian_filter(image.astype(float), (blur_px, blur_px, 0.0), mode="nearest")


def crop(image: np.ndarray, place: Sequence[float] | np.ndarray) -> np.ndarray:
    """The square of CROP_PX, or less, around a place (row, column), moved into the image."""
    half = min(CROP_PX, *image.shape[:2]) // 2
    row, column = (
        round(min(max(middle, half), count - half))
        for middle, count in zip(place, image.shape[:2], strict=True)
    )
    return image[row - half : row + half, column - half : column + half]


def measure_noise(clean: np.ndarray, frames: np.ndarray, background: np.ndarray) -> Noise | None:
    """The noise of frames, from their background pixels; None if no frame has MIN_PIXELS. clean:
    the background with its noise averaged out. background: the frame."""
    covariance, autocovariance, count = np.zeros((3, 3)), np.zeros((LAGS, 3)), 0
    for frame in frames:
        mask = background_pixels(frame, background)
        if np.count_nonzero(mask) < MIN_PIXELS:
            continue
        noise = frame.astype(float) - clean
        noise -= _light(noise, DRIFT_PX)
        noise -= noise[mask].mean(axis=0)
        covariance += noise[mask].T @ noise[mask] / np.count_nonzero(mask)
        for lag in range(1, LAGS + 1):
            along_both = (np.s_[:-lag], np.s_[lag:]), (np.s_[:, :-lag], np.s_[:, lag:])
            products = [
                (noise[one] * noise[other])[mask[one] & mask[other]].mean(axis=0)
                for one, other in along_both
            ]
            autocovariance[lag - 1] += np.mean(products, axis=0)
        count += 1
    if not count:
        return None
    covariance = covariance / count + QUIETEST_GREY**2 * np.eye(3)
    correlation = (autocovariance / count / np.diag(covariance)).mean(axis=1)
    return Noise(np.linalg.cholesky(covariance), _taps(correlation))


def _taps(correlation: np.ndarray) -> np.ndarray:
    """(TAPS,) symmetric weights of unit energy with this autocorrelation, (LAGS,)."""

    def weights(sides: np.ndarray) -> np.ndarray:
        taps = np.concatenate([sides[::-1], [1.0], sides])
        return taps / np.sqrt(np.sum(taps**2))

    def residual(sides: np.ndarray) -> np.ndarray:
        taps = weights(sides)
        return np.correlate(taps, taps, "full")[TAPS : TAPS + LAGS] - correlation

    fit = least_squares(residual, np.full(REACH, 0.3), bounds=(-1.0, 1.0))
    return weights(fit.x)


def score(real: np.ndarray, other: np.ndarray) -> Score:
    """The score of two uint8 images of one shape (rows, columns, 3)."""
    difference = real.astype(float) - other
    error = max(float(np.mean(difference**2)), 1e-12)
    return Score(
        l1=float(np.abs(difference).mean()),
        ssim=float(np.mean(structural_similarity(real, other, channel_axis=2, data_range=255))),
        psnr_db=float(10.0 * np.log10(255.0**2 / error)),
    )


def mean_score(scores: Sequence[Score]) -> Score:
    """The mean of each metric."""
    return Score(*np.mean([astuple(each) for each in scores], axis=0).tolist())


def crop_scores(real: np.ndarray, other: np.ndarray, places: np.ndarray) -> list[Score]:
    """Scores of frames (n, ...) on the crops around places (n, 2), row and column."""
    return [
        score(crop(a, place), crop(b, place))
        for a, b, place in zip(real, other, places, strict=True)
    ]


def cut_and_paste(
    background: np.ndarray, training: np.ndarray, from_px: np.ndarray, to_px: np.ndarray
) -> np.ndarray:
    """(m, ...) uint8: the background with the presses' mean change, moved by whole pixels."""
    changes = np.concatenate(  # the last channel counts the presses that a pixel shows
        [training.astype(float) - background, np.ones((*training.shape[:3], 1))], axis=-1
    )
    pasted = []
    for place in np.rint(to_px):
        moves = place - np.rint(from_px)
        moved = sum(shift(each, (*by, 0), order=0) for each, by in zip(changes, moves, strict=True))
        change, count = np.split(np.asarray(moved), [3], axis=-1)
        pasted.append(background + change / np.maximum(count, 1.0))
    return np.clip(np.rint(pasted), 0, 255).astype(np.uint8)


def coverage_of(
    camera: Camera, gel: Elastomer, poses: np.ndarray, diameters_mm: np.ndarray
) -> tuple[np.ndarray, float, list[tuple[float, float]]]:
    """Radii (n,) of contacts, the share of the gel in view that they cover, and places, mm.
    Presses there, of the median radius and all in view, would cover the rest; the best first."""
    radii_mm, depths_mm = diameters_mm / 2.0, np.minimum(poses[:, 2], diameters_mm / 2.0)
    contacts_mm = np.sqrt(radii_mm**2 - (radii_mm - depths_mm) ** 2)
    next_mm = float(np.median(contacts_mm))
    places, room_mm = _places(camera, gel, max(min(camera.rows, camera.columns) // STEPS, 1))
    candidates = places[room_mm >= min(next_mm, room_mm.max())]
    near = _apart_mm(places, candidates) <= next_mm
    pressed = (_apart_mm(places, poses[:, :2]) <= contacts_mm).any(axis=1)
    bare = near.any(axis=1) & ~pressed
    count = np.count_nonzero(bare | pressed)
    covered = 1.0 - np.count_nonzero(bare) / count
    free_mm = _apart_mm(candidates, poses[:, :2]).min(axis=1)
    chosen: list[tuple[float, float]] = []
    while len(chosen) < MOST and np.count_nonzero(bare) > (1.0 - ENOUGH) * count:
        # among those that cover most, the one farthest from all others
        gain = near[bare].sum(axis=0) + free_mm / (1.0 + free_mm.max())
        best = int(np.argmax(gain))
        chosen.append(tuple(candidates[best].round(3).tolist()))
        free_mm = np.minimum(free_mm, _apart_mm(candidates, candidates[[best]])[:, 0])
        bare &= ~near[:, best]
    return contacts_mm, covered, chosen


def _places(camera: Camera, gel: Elastomer, step: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) mm of the gel at each step-th pixel, and (n,) distances to the edge in view, mm."""
    columns, rows = (np.arange(step / 2, count, step) for count in (camera.columns, camera.rows))
    x, y, _ = camera.gel_points(gel, columns, rows)
    half_x, half_y = gel.width_mm / 2, gel.length_mm / 2
    room_mm = np.min(
        [
            x - np.maximum(x[:, :1], -half_x), np.minimum(x[:, -1:], half_x) - x,
            y - np.maximum(y[:1], -half_y), np.minimum(y[-1:], half_y) - y,
        ],
        axis=0,
    )  # fmt: skip
    return np.stack([x.ravel(), y.ravel()], axis=1), room_mm.ravel()


def _apart_mm(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(n, m) distances of places (n, 2) to others (m, 2)."""
    return np.hypot(*np.moveaxis(places[:, None] - others, -1, 0))


def coverage_sentences(covered: float, next_mm: Sequence[tuple[float, float]]) -> list[str]:
    """Which part of the gel no contact covers, and where the next presses belong."""
    bare = 100.0 * (1.0 - covered)
    if not next_mm:
        return [f"The contacts cover the gel in the image, except for {bare:.0f} % of it."]
    places = [
        f"{abs(x_mm):.1f} {'left' if x_mm < 0 else 'right'}, "
        f"{abs(y_mm):.1f} {'up' if y_mm < 0 else 'down'}"
        for x_mm, y_mm in next_mm
    ]
    return [
        f"No contact covers {bare:.0f} % of the gel in the image, where light is extrapolated.",
        f"Press next, in mm from the middle of the image: {'; '.join(places)}.",
    ]


def coverage_picture(
    optics: Optics, gel: Elastomer, poses: np.ndarray, radii_mm: np.ndarray,
    next_mm: Sequence[tuple[float, float]],
) -> Image.Image:  # fmt: skip
    """The background with the contacts, the uncovered part shaded, and the next presses."""
    background, camera = optics.background, optics.camera
    places, _ = _places(camera, gel, 1)
    covered = np.zeros(len(places), dtype=bool)
    for pose, radius_mm in zip(poses, radii_mm, strict=True):
        covered |= _apart_mm(places, pose[None, :2])[:, 0] <= radius_mm
    light = background * np.clip(BRIGHT_GREY / max(float(background.mean()), 1.0), 1.0, 4.0)
    shown = np.where(covered.reshape(*light.shape[:2], 1), light, SHADE * light)
    zoom = -(-PICTURE_PX // max(shown.shape[:2]))
    image = Image.fromarray(np.clip(np.rint(shown), 0, 255).astype(np.uint8))
    image = image.resize((zoom * camera.columns, zoom * camera.rows))
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(14)
    circles = [
        *((*each, PRESSED, f"{n + 1}") for n, each in enumerate(zip(poses, radii_mm, strict=True))),
        *((place, np.median(radii_mm), NEXT, f"next {n + 1}") for n, place in enumerate(next_mm)),
    ]
    for (x_mm, y_mm, *_), radius_mm, color, label in circles:
        row, column = (zoom * float(at) for at in camera.project(x_mm, y_mm, np.zeros(())))
        radius = zoom * float(radius_mm) * camera.scale_px_per_mm
        pen.circle((column, row), radius, outline=color, width=2)
        pen.text((column, row), label, fill=color, font=font, anchor="mm")
    return image
