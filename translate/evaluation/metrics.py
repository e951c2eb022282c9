"""How far predicted arrays are from the true ones, and their tactile images with them.

Shape letters: P pairs, N taxels, K groups of pairs.
"""

import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from tqdm import tqdm

from t2twin.translate.evaluation.similarity import alike
from t2twin.translate.phi import Phi

CONTACT_LEVEL = 0.1
"""A pixel is in contact above this part of its own image's maximum (assumed)."""

AT_ONCE = 64
"""Pairs whose tactile images are made together; bounds the memory to 50 MB."""

COUNTED = "/pairs"
"""What the name of a sum ends in that counts the pairs which have the figure."""


@dataclass(frozen=True)
class Figures:
    """Figures of each pair, (P,) each.

    squared_error: mean over the taxels, counts^2; squared_error_of: the same over a part of the
    taxels, by its name, NaN where it has none. ssim: of phi(predicted) against phi(true), over
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
    squared_error_of: dict[str, np.ndarray] = field(default_factory=dict)

    def summary(self, full_scale: float, which: np.ndarray | None = None) -> dict[str, float]:
        """Over the pairs `which` ((P,) bool), by default all.

        rmse_counts is sqrt(L3), rmse_percent its part of full_scale (counts), rmse_PART_counts that
        of a part of the taxels; total_error_percent is the mean error of the total response, of
        the mean total response. Figures for which no pair qualifies are NaN.
        """
        chosen = np.ones(self.total.size, bool) if which is None else which
        sums = {name: float(v[1]) for name, v in self.sums(chosen.astype(int), 2).items()}
        found = {name: float(v) for name, v in self.of_sums(sums, full_scale).items()}
        return {"pairs": int(chosen.sum()), **found}

    def sums(self, place: np.ndarray, groups: int) -> dict[str, np.ndarray]:
        """What the figures of any union of groups follow from: sums by group, (K,) by name.

        place: (P,) the group of each pair, 0 to groups - 1.
        """
        columns = {
            "squared_error": self.squared_error,
            **{f"squared_error_{part}": v for part, v in self.squared_error_of.items()},
            "ssim": self.ssim,
            "ssim_contact": self.ssim_contact,
            "contact_iou": self.contact_iou,
            "centroid_error_mm": self.centroid_error_mm,
            "total_error": self.total_error,
            "total": self.total,
        }
        found = {}
        for name, values in columns.items():
            known = ~np.isnan(values)
            found[name] = np.bincount(place[known], values[known], groups)
            found[name + COUNTED] = np.bincount(place[known], minlength=groups).astype(float)
        return found

    def of_sums(
        self, sums: Mapping[str, np.ndarray | float], full_scale: float
    ) -> dict[str, np.ndarray]:
        """The figures of `summary` from sums of any one shape, elementwise."""

        def mean(name: str) -> np.ndarray:
            total, pairs = np.asarray(sums[name]), np.asarray(sums[name + COUNTED])
            return np.divide(total, pairs, out=np.full(total.shape, np.nan), where=pairs > 0)

        rmse = np.sqrt(mean("squared_error"))
        error, total = np.asarray(sums["total_error"]), np.asarray(sums["total"])
        return {
            "rmse_counts": rmse,
            "rmse_percent": 100.0 * rmse / full_scale,
            "ssim": mean("ssim"),
            "ssim_contact": mean("ssim_contact"),
            "contact_iou": mean("contact_iou"),
            "centroid_error_mm": mean("centroid_error_mm"),
            "total_error_percent": np.divide(
                100.0 * error, total, out=np.full(total.shape, np.nan), where=total > 0
            ),
            **{
                f"rmse_{part}_counts": np.sqrt(mean(f"squared_error_{part}"))
                for part in self.squared_error_of
            },
        }


def compare(
    predicted: np.ndarray,
    true: np.ndarray,
    phi: Phi,
    full_scale: float,
    progress: str | None = None,
    parts: Mapping[str, np.ndarray] | None = None,
) -> Figures:
    """Figures of each pair. predicted, true: (P, N), counts; full_scale: SSIM's data range.

    progress: a name to show a bar under, or None. parts: (N,) bool by name, the parts of the taxels
    whose errors are kept apart.
    """
    predicted, true = predicted.astype(float), true.astype(float)
    squares = np.square(predicted - true)
    of_images = _of_images(predicted, true, phi, full_scale, progress)
    return Figures(
        squared_error=squares.mean(axis=1),
        squared_error_of={
            name: squares[:, part].mean(axis=1) if part.any() else np.full(len(true), np.nan)
            for name, part in (parts or {}).items()
        },
        ssim=of_images[:, 0],
        ssim_contact=of_images[:, 1],
        contact_iou=of_images[:, 2],
        centroid_error_mm=_centroid_error_mm(predicted, true, phi),
        total_error=np.abs(predicted.sum(axis=1) - true.sum(axis=1)),
        total=true.sum(axis=1),
    )


def _of_images(
    predicted: np.ndarray, true: np.ndarray, phi: Phi, full_scale: float, progress: str | None
) -> np.ndarray:
    """(P, 3): SSIM over the image and over the true contact, and the contacts' IoU."""
    found = np.empty((len(true), 3))
    workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    with (
        ThreadPoolExecutor(workers) as pool,
        tqdm(total=len(true), desc=progress, unit="pair", disable=progress is None) as bar,
    ):
        for start in range(0, len(true), AT_ONCE):
            part = slice(start, start + AT_ONCE)
            images = pool.map(
                lambda a, b: alike(a, b, full_scale, CONTACT_LEVEL),
                phi(predicted[part]),
                phi(true[part]),
            )
            for row, figures in enumerate(images, start):
                found[row] = figures
            bar.update(len(true[part]))
    return found


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
