"""Errors of predicted images, and the trivial predictors of images.

Images are compared as pictures of a run, (S, S, c), where several runs differ at the size of the
largest, and in grey if one run is. SSIM is that of the grey pictures. The contact is where the true
picture differs from the background frame; without a known frame it has no figures.

Shape letters: P pairs, S side and c channels of a picture.
"""

from dataclasses import dataclass

import numpy as np
from PIL import Image

from t2twin.translate.data.images import COLORS, WHITE_GREY, to_pixels
from t2twin.translate.data.pairs import ImageFile, Pairs
from t2twin.translate.evaluation.array_errors import (
    FiguresOfPairs,
    GroupedFigures,
    Sums,
    mean_of,
)
from t2twin.translate.evaluation.baselines import NEAREST_NEIGHBOR
from t2twin.translate.evaluation.ssim import image_scores

CONTACT_GREY = 8.0
"""Difference of a true picture from the background frame above which a pixel is in contact, grey
levels, of the channel where it is largest. Assumed: 3 % of full scale, eight times the
largest effect of a DIGIT's noise on a picture of 64 pixels."""

MIN_SQUARE = 1e-3
"""Lower bound of the mean squared difference in a PSNR, grey levels^2 (assumed)."""

MEAN_IMAGE = "mean-image"
"""Name of its row: the mean of the training images."""

LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in a grey picture (ITU-R BT.601, as Pillow's)."""


@dataclass(frozen=True)
class ImagesOfPairs(FiguresOfPairs):
    """Figures of each pair, (P,) each.

    squared_error: mean over the picture, grey levels^2; squared_error_contact: over its contact,
    NaN without. psnr_db, psnr_contact_db: from these. ssim: over the picture.
    """

    squared_error: np.ndarray
    squared_error_contact: np.ndarray
    psnr_db: np.ndarray
    psnr_contact_db: np.ndarray
    ssim: np.ndarray

    def figures_of(self, sums: Sums, full_scale: float) -> GroupedFigures:
        """See FiguresOfPairs."""
        means = {name: mean_of(*of_name) for name, of_name in sums.items()}
        rmse = np.sqrt(means["squared_error"])
        return {
            "rmse_grey": rmse,
            "rmse_percent": 100.0 * rmse / full_scale,
            "ssim": means["ssim"],
            "psnr_db": means["psnr_db"],
            "psnr_contact_db": means["psnr_contact_db"],
        }


def compare_images(
    predicted: np.ndarray, true: np.ndarray, background: np.ndarray | None
) -> ImagesOfPairs:
    """Figures of each pair. predicted, true: (P, S, S, c) uint8. background: (S, S, c) uint8."""
    square, in_contact, ssim = (np.full(len(true), np.nan) for _ in range(3))
    for place, (ours, theirs) in enumerate(zip(predicted, true, strict=True)):
        squares = np.square(ours.astype(np.float32) - theirs).mean(axis=-1, dtype=float)
        square[place] = squares.mean()
        ssim[place] = image_scores(_grey(ours), _grey(theirs), WHITE_GREY, 0.0).ssim
        if background is not None:
            change = np.abs(theirs.astype(np.float32) - background).max(axis=-1) > CONTACT_GREY
            in_contact[place] = squares[change].mean() if change.any() else np.nan
    return ImagesOfPairs(square, in_contact, _psnr_db(square), _psnr_db(in_contact), ssim)


def baselines(train: Pairs, nearest: np.ndarray) -> dict[str, np.ndarray]:
    """(P, S, S, c) uint8 images of the trivial predictors by row.

    nearest: (P,) indices of the training pairs with the nearest readings of the source.
    """
    images = images_of(train)
    mean = np.rint(images.mean()).astype(np.uint8)
    return {
        MEAN_IMAGE: np.broadcast_to(mean, (len(nearest), *mean.shape)),
        NEAREST_NEIGHBOR: images[nearest],
    }


def images_of(pairs: Pairs) -> ImageFile:
    """The images of the target."""
    assert isinstance(pairs.target, ImageFile)
    return pairs.target


def resized_to(images: np.ndarray, size: int, grey: bool) -> np.ndarray:
    """Predicted pictures, (P, S, S, c) uint8, at another size and in grey, if they differ."""
    if images.shape[1] == size and images.shape[-1] == (1 if grey else COLORS):
        return images
    shown = (each if each.shape[-1] == COLORS else each[..., 0] for each in images)
    return np.stack([to_pixels(Image.fromarray(each), size, grey) for each in shown])


def words(size: int, grey: bool) -> str:
    """The pictures that are compared."""
    return f"{size} x {size} pixels, {'grey' if grey else 'red, green and blue'}"


def _grey(picture: np.ndarray) -> np.ndarray:
    """(S, S) float32."""
    if picture.shape[-1] == COLORS:
        return (picture @ np.array(LUMA, np.float32)).astype(np.float32)
    return picture[..., 0].astype(np.float32)


def _psnr_db(square: np.ndarray) -> np.ndarray:
    return 10.0 * np.log10(WHITE_GREY**2 / np.maximum(square, MIN_SQUARE))
