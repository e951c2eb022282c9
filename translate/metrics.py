"""How far predicted arrays are from the true ones, and their tactile images with them.

Shape letters: P pairs, R rows, C columns, N taxels.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from skimage.metrics import structural_similarity
from tqdm import tqdm

from translate.phi import Phi

CONTACT_LEVEL = 0.1
"""A pixel is in contact above this part of its own image's maximum (assumed)."""


@dataclass(frozen=True)
class Figures:
    """Figures of each pair, (P,) each.

    squared_error: mean over the taxels, counts^2. ssim: of phi(predicted) against phi(true), over
    the image. ssim_contact: over the true contact. contact_iou: intersection over union of the two
    contacts. centroid_error_mm: between the two images' centroids. total_error: difference of
    the summed counts, absolute. total: the true sum. What needs a contact is NaN where there is
    none.
    """

    squared_error: np.ndarray
    ssim: np.ndarray
    ssim_contact: np.ndarray
    contact_iou: np.ndarray
    centroid_error_mm: np.ndarray
    total_error: np.ndarray
    total: np.ndarray

    def summary(self, full_scale: float, which: np.ndarray | None = None) -> dict[str, float]:
        """Over the pairs `which` ((P,) bool), by default all.

        rmse_counts is sqrt(L3), rmse_percent its part of full_scale (counts);
        total_error_percent is the mean error of the total response, of the mean total response.
        Figures for which no pair qualifies are NaN.
        """
        chosen = slice(None) if which is None else which
        rmse = float(np.sqrt(self.squared_error[chosen].mean()))
        total = self.total[chosen].mean()
        return {
            "pairs": int(self.squared_error[chosen].size),
            "rmse_counts": rmse,
            "rmse_percent": 100.0 * rmse / full_scale,
            "ssim": float(self.ssim[chosen].mean()),
            "ssim_contact": _mean(self.ssim_contact[chosen]),
            "contact_iou": _mean(self.contact_iou[chosen]),
            "centroid_error_mm": _mean(self.centroid_error_mm[chosen]),
            "total_error_percent": (
                float(100.0 * self.total_error[chosen].mean() / total) if total > 0 else np.nan
            ),
        }


def compare(
    predicted: np.ndarray,
    true: np.ndarray,
    phi: Phi,
    full_scale: float,
    progress: str | None = None,
) -> Figures:
    """Figures of each pair. predicted, true: (P, N), counts; full_scale: SSIM's data range.

    progress: a name to show a bar under, or None.
    """
    predicted, true = predicted.astype(float), true.astype(float)
    with ThreadPoolExecutor() as pool:
        found = pool.map(lambda a, b: _of_images(a, b, phi, full_scale), predicted, true)
        bar = tqdm(found, progress, len(true), unit="pair", disable=progress is None)
        of_images = np.array(list(bar)).reshape(-1, 3)
    return Figures(
        squared_error=np.square(predicted - true).mean(axis=1),
        ssim=of_images[:, 0],
        ssim_contact=of_images[:, 1],
        contact_iou=of_images[:, 2],
        centroid_error_mm=_centroid_error_mm(predicted, true, phi),
        total_error=np.abs(predicted.sum(axis=1) - true.sum(axis=1)),
        total=true.sum(axis=1),
    )


def _of_images(
    predicted: np.ndarray, true: np.ndarray, phi: Phi, full_scale: float
) -> tuple[float, float, float]:
    """SSIM over the image and over the true contact, and the contacts' IoU. Both arrays: (N,)."""
    a, b = phi(predicted), phi(true)
    over_image, local, *_ = structural_similarity(a, b, data_range=full_scale, full=True)
    contact_a, contact_b = _contact(a), _contact(b)
    either = np.count_nonzero(contact_a | contact_b)
    return (
        float(over_image),
        float(local[contact_b].mean()) if contact_b.any() else np.nan,
        np.count_nonzero(contact_a & contact_b) / either if either else np.nan,
    )


def _contact(image: np.ndarray) -> np.ndarray:
    return image > CONTACT_LEVEL * max(float(image.max()), 0.0)


def _centroid_error_mm(predicted: np.ndarray, true: np.ndarray, phi: Phi) -> np.ndarray:
    """(P,) distance, mm; an empty prediction counts as the middle of the image.

    phi is linear, so the images' moments are products of the counts with phi's own.
    """
    columns_mm, rows_mm = phi.centres_mm
    x_mm, y_mm = np.meshgrid(columns_mm, rows_mm)
    weights = np.column_stack([np.ones(x_mm.size), x_mm.ravel(), y_mm.ravel()])
    moments = phi.matrix.T @ weights  # (N, 3)
    of_predicted, of_true = predicted @ moments, true @ moments
    empty = of_true[:, 0] <= 0
    a = of_predicted[:, 1:] / np.where(of_predicted[:, :1] > 0, of_predicted[:, :1], np.inf)
    b = of_true[:, 1:] / np.where(empty[:, None], np.inf, of_true[:, :1])
    return np.where(empty, np.nan, np.linalg.norm(a - b, axis=1))


def _mean(values: np.ndarray) -> float:
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else np.nan
