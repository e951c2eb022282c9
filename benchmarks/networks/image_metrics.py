"""Metrics of predicted DIGIT images, over the contact and by scale of detail.

Most of an image does not change with contact, so figures over whole images are too optimistic. The
contact is where the real image differs from the background frame.

Shape letters: P images, S image side, L scales of detail.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter
from skimage.metrics import structural_similarity

from t2twin.translate.data.images import WHITE_GREY
from t2twin.translate.evaluation.array_errors import interval, resample_weights

CONTACT_GREY = 8.0
"""Difference of the real image from the background frame above which a pixel is in contact, grey
levels. Assumed: 3 % of full scale, eight times the largest effect of camera noise on an image of 64
pixels."""

DETAILS_MM = (2.0, 1.0, 0.5)
"""Standard deviations of the Gaussians that separate scales of detail, mm (assumed). The widest one
passes 0.70 of a wave of 15 mm, twice the pitch of the taxels, and 0.25 of one of 7.5 mm."""

MIN_SQUARE = 1e-3
"""Lower bound of the mean squared difference in a PSNR, grey levels^2 (assumed)."""


@dataclass(frozen=True)
class ImageFigures:
    """Figures of each image, (P,) each.

    square: mean squared difference over the image, grey levels^2. square_contact, psnr_contact_db
    and ssim_contact: over its contact, NaN without contact. SSIM (Wang et al. 2004) is the mean of
    the map of scikit-image, with its defaults, over these pixels.
    """

    square: np.ndarray
    square_contact: np.ndarray
    psnr_contact_db: np.ndarray
    ssim_contact: np.ndarray


def compare_images(predicted: np.ndarray, real: np.ndarray, background: np.ndarray) -> ImageFigures:
    """Figures of each image. predicted, real: (P, S, S) uint8. background: (S, S) uint8."""
    squares = np.square(predicted.astype(np.float32) - real)
    contact = in_contact(real, background)
    pixels = contact.sum(axis=(1, 2))
    nothing = np.full(len(real), np.nan)

    def over_contact(values: np.ndarray) -> np.ndarray:
        total = (values * contact).sum(axis=(1, 2), dtype=float)
        return np.divide(total, pixels, out=nothing.copy(), where=pixels > 0)

    similar = np.stack(
        [
            structural_similarity(a, b, data_range=WHITE_GREY, full=True)[1]
            for a, b in zip(predicted, real, strict=True)
        ]
    )
    square_contact = over_contact(squares)
    return ImageFigures(
        square=squares.mean(axis=(1, 2), dtype=float),
        square_contact=square_contact,
        psnr_contact_db=10.0 * np.log10(WHITE_GREY**2 / np.maximum(square_contact, MIN_SQUARE)),
        ssim_contact=over_contact(similar),
    )


def in_contact(real: np.ndarray, background: np.ndarray) -> np.ndarray:
    """(P, S, S) bool: pixels of images, (P, S, S) uint8, in contact."""
    return np.abs(real.astype(np.float32) - background) > CONTACT_GREY


@dataclass(frozen=True)
class ImageMetrics:
    """Figures over several images.

    rmse_percent, rmse_contact_percent: root of the mean square, percent of full scale. The others
    are means over the images.
    """

    rmse_percent: float
    rmse_contact_percent: float
    psnr_contact_db: float
    ssim_contact: float


def scores(figures: ImageFigures) -> ImageMetrics:
    """Figures over all images."""
    means = {each.name: np.nanmean(getattr(figures, each.name)) for each in fields(figures)}
    return ImageMetrics(**{name: float(value) for name, value in _figures(means).items()})


def replicates(figures: ImageFigures, shapes: np.ndarray) -> dict[str, np.ndarray]:
    """Every figure of ImageMetrics in resamples of the shapes (module bootstrap), (B,) each.

    shapes: (P,) names. Equal shapes result in equal resamples, so that differences are paired.
    """
    names, place = np.unique(shapes, return_inverse=True)
    weights = resample_weights(names.size)
    means = {}
    for each in fields(figures):
        values = getattr(figures, each.name)
        known = ~np.isnan(values)
        total = np.bincount(place[known], values[known], names.size)
        images = np.bincount(place[known], minlength=names.size)
        means[each.name] = (weights @ total) / (weights @ images)
    return _figures(means)


def intervals(resampled: Mapping[str, np.ndarray]) -> dict[str, tuple[float, float] | None]:
    """The 95 % interval of every figure of `replicates`, or None."""
    found = {name: interval(values) for name, values in resampled.items()}
    return {name: None if one is None else (one.low, one.high) for name, one in found.items()}


def explained_by_detail(
    predicted: np.ndarray, real: np.ndarray, mean: np.ndarray, mm_per_px: tuple[float, float]
) -> list[float]:
    """Explained share of the images' deviation from a mean image, by scale of detail.

    predicted, real: (P, S, S) uint8. mean: (S, S), of the training images. mm_per_px: of rows and
    columns. Returns L = len(DETAILS_MM) + 1 values, the coarsest scale first: 1 for a perfect
    prediction, 0 for the mean image, negative for worse ones.
    """
    errors = _details(predicted.astype(np.float32) - real, mm_per_px)
    deviations = _details(real - mean.astype(np.float32), mm_per_px)
    return [
        1.0 - float(np.square(a).sum(dtype=float) / np.square(b).sum(dtype=float))
        for a, b in zip(errors, deviations, strict=True)
    ]


def _details(images: np.ndarray, mm_per_px: tuple[float, float]) -> list[np.ndarray]:
    """Decomposes images, (P, S, S), into L scales of detail, the coarsest first."""
    parts, left = [], images
    for size_mm in DETAILS_MM:
        sigma = (0.0, size_mm / mm_per_px[0], size_mm / mm_per_px[1])
        coarse = gaussian_filter(images, sigma, mode="nearest")
        parts.append(coarse - (images - left))
        left = images - coarse
    return [*parts, left]


def _figures(means: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The figures of ImageMetrics from the means of ImageFigures."""
    return {
        "rmse_percent": 100.0 / WHITE_GREY * np.sqrt(means["square"]),
        "rmse_contact_percent": 100.0 / WHITE_GREY * np.sqrt(means["square_contact"]),
        "psnr_contact_db": means["psnr_contact_db"],
        "ssim_contact": means["ssim_contact"],
    }
