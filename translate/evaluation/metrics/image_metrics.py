"""How near drawn DIGIT pictures are to the real ones, over the contact and by the size of detail.

Most of a picture is the same whatever touches the gel, so figures of the whole of it flatter
everybody. The contact is where the real picture differs from the untouched one.

Shape letters: P pictures, S their side, L scales of detail.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter
from skimage.metrics import structural_similarity

from t2twin.translate.evaluation.metrics.bootstrap import draws, interval

WHITE_GREY = 255.0
"""Full scale of a picture, grey levels."""

CONTACT_GREY = 8.0
"""A pixel is in contact where the real picture is farther from the untouched one than this, grey
levels (assumed: 3 % of full scale, eight times the most that the camera's noise does to a picture
of 64 pixels)."""

DETAILS_MM = (2.0, 1.0, 0.5)
"""Where detail is cut apart by its size, mm: standard deviations of Gaussians (assumed). The widest
keeps 0.70 of a wave of 15 mm, twice as long as the taxels are apart, and 0.25 of one of 7.5 mm."""

MIN_SQUARE = 1e-3
"""Least mean squared difference that a PSNR is taken of, grey levels^2 (assumed: of two pictures
that are the same it would be infinite)."""


@dataclass(frozen=True)
class PictureFigures:
    """Figures of each picture, (P,) each.

    square: mean squared difference over the picture, grey levels^2. square_contact, psnr_contact_db
    and ssim_contact: over its contact; SSIM as Wang et al. 2004, scikit-image's with its defaults,
    its map's mean over those pixels. NaN where there is no contact.
    """

    square: np.ndarray
    square_contact: np.ndarray
    psnr_contact_db: np.ndarray
    ssim_contact: np.ndarray


def compare_pictures(drawn: np.ndarray, real: np.ndarray, untouched: np.ndarray) -> PictureFigures:
    """Figures of each picture. drawn, real: (P, S, S) uint8. untouched: (S, S) uint8."""
    squares = np.square(drawn.astype(np.float32) - real)
    contact = in_contact(real, untouched)
    pixels = contact.sum(axis=(1, 2))
    nothing = np.full(len(real), np.nan)

    def over_contact(values: np.ndarray) -> np.ndarray:
        total = (values * contact).sum(axis=(1, 2), dtype=float)
        return np.divide(total, pixels, out=nothing.copy(), where=pixels > 0)

    similar = np.stack(
        [
            structural_similarity(a, b, data_range=WHITE_GREY, full=True)[1]
            for a, b in zip(drawn, real, strict=True)
        ]
    )
    square_contact = over_contact(squares)
    return PictureFigures(
        square=squares.mean(axis=(1, 2), dtype=float),
        square_contact=square_contact,
        psnr_contact_db=10.0 * np.log10(WHITE_GREY**2 / np.maximum(square_contact, MIN_SQUARE)),
        ssim_contact=over_contact(similar),
    )


def in_contact(real: np.ndarray, untouched: np.ndarray) -> np.ndarray:
    """(P, S, S) bool: where pictures, (P, S, S) uint8, show a contact."""
    return np.abs(real.astype(np.float32) - untouched) > CONTACT_GREY


@dataclass(frozen=True)
class PictureScores:
    """Figures over pictures. rmse_percent, rmse_contact_percent: root of the mean square, percent
    of full scale; the others are means over the pictures."""

    rmse_percent: float
    rmse_contact_percent: float
    psnr_contact_db: float
    ssim_contact: float


def scores(figures: PictureFigures) -> PictureScores:
    """Over all pictures."""
    means = {each.name: np.nanmean(getattr(figures, each.name)) for each in fields(figures)}
    return PictureScores(**{name: float(value) for name, value in _figures(means).items()})


def replicates(figures: PictureFigures, shapes: np.ndarray) -> dict[str, np.ndarray]:
    """Every figure of PictureScores in resamples of the shapes (evaluation.bootstrap), (B,) each.

    shapes: (P,) names. The same shapes give the same resamples, so that differences are paired.
    """
    names, place = np.unique(shapes, return_inverse=True)
    drawn = draws(names.size)
    means = {}
    for each in fields(figures):
        values = getattr(figures, each.name)
        known = ~np.isnan(values)
        total = np.bincount(place[known], values[known], names.size)
        pictures = np.bincount(place[known], minlength=names.size)
        means[each.name] = (drawn @ total) / (drawn @ pictures)
    return _figures(means)


def intervals(resampled: Mapping[str, np.ndarray]) -> dict[str, tuple[float, float] | None]:
    """The 95 % interval of every figure of `replicates`, None where there is none."""
    found = {name: interval(values) for name, values in resampled.items()}
    return {name: None if one is None else (one.low, one.high) for name, one in found.items()}


def explained_by_detail(
    drawn: np.ndarray, real: np.ndarray, mean: np.ndarray, mm_per_px: tuple[float, float]
) -> list[float]:
    """How much of what real pictures differ in from a mean one is drawn right, by size of detail.

    drawn, real: (P, S, S) uint8. mean: (S, S), the training's. mm_per_px: of rows and columns.
    Returns L = len(DETAILS_MM) + 1 parts, of the coarsest detail first: 1 where all of it is drawn,
    0 where the mean picture would do as well, below where it would do better.
    """
    off = _details(drawn.astype(np.float32) - real, mm_per_px)
    there = _details(real - mean.astype(np.float32), mm_per_px)
    return [
        1.0 - float(np.square(a).sum(dtype=float) / np.square(b).sum(dtype=float))
        for a, b in zip(off, there, strict=True)
    ]


def _details(pictures: np.ndarray, mm_per_px: tuple[float, float]) -> list[np.ndarray]:
    """Pictures, (P, S, S), as L sums of detail, of the coarsest first, which add up to them."""
    parts, left = [], pictures
    for size_mm in DETAILS_MM:
        sigma = (0.0, size_mm / mm_per_px[0], size_mm / mm_per_px[1])
        coarse = gaussian_filter(pictures, sigma, mode="nearest")
        parts.append(coarse - (pictures - left))
        left = pictures - coarse
    return [*parts, left]


def _figures(means: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """PictureScores' figures of the means of PictureFigures'."""
    return {
        "rmse_percent": 100.0 / WHITE_GREY * np.sqrt(means["square"]),
        "rmse_contact_percent": 100.0 / WHITE_GREY * np.sqrt(means["square_contact"]),
        "psnr_contact_db": means["psnr_contact_db"],
        "ssim_contact": means["ssim_contact"],
    }
