"""Trivial predictors, error floors, bins of force, groups of taxels, and the paper's results.

Shape letters: P pairs or queries, M stored pairs or training taxels, N taxels.
"""

from collections.abc import Iterable

import numpy as np
import pandas as pd
import torch
from scipy.spatial import KDTree

from t2twin.core.progress import Progress
from t2twin.sim.dataset.info import ArrayInfo
from t2twin.sim.taxels.phi import barycentric
from t2twin.sim.taxels.reading import expected_reading, read_after
from t2twin.translate.data.pairs import Pairs, Readings
from t2twin.translate.evaluation.records import Figures

MEAN_ARRAY, MEAN_ARRAY_OF_FORCE, NEAREST_NEIGHBOR, MEAN_IMAGE, NOISE_FLOOR, LAYOUT_FLOOR = (
    "mean-array", "mean-array-of-force", "nearest-neighbor", "mean-image", "noise-floor",
    "layout-floor",
)  # fmt: skip
"""Names of their rows; the second one with several forces only."""

FEATURE_SIZE = 32  # side of the RGB images for the search of neighbors, pixels (assumed)
NEIGHBORS = 8  # nearest images of each press, which are ordered by their exact distances
BATCH_SIZE = 256  # images compared together; bounds memory to 100 MB with 20,000 pairs

PAPER: dict[str, dict[str, Figures]] = {
    "val": {
        "touch2touch": {"rmse_counts": 4007, "rmse_percent": 10.01, "ssim": 0.96},
        "resnet18": {"rmse_counts": 3931, "rmse_percent": 9.83, "ssim": 0.95},
    },
    "test": {
        "touch2touch": {"rmse_counts": 6072, "rmse_percent": 15.18},
        "resnet18": {"rmse_counts": 4867, "rmse_percent": 12.17},
    },
}
"""Results of Grella et al. 2023 by split and model: root of L3, and one SSIM per model."""

TAXEL_GROUPS = ("under", "near", "beyond")  # the view; within one pitch of it; farther
SLACK = 1e-6  # tolerance of positions for rounding, fraction of a pitch
# Largest distance of a taxel outside its triangle of trained taxels, in barycentric coordinates
# (assumed: layouts.OUTSIDE_MM for a triangle 1 mm high)
OUTSIDE_PARTS = 0.01
SEED = 1  # of the second readings; the noise of datasets has other seeds
MAX_FORCES = 12  # forces with a bin each (assumed: the lines of a table)
DECIMALS = 2  # to which forces are rounded, N (assumed)
BINS_PER_DOUBLING = 2  # of the force: edges at 0.5, 0.71, 1, 1.41, 2 N (assumed)
# Minimum number of training presses for a mean array (assumed: its standard error is a seventh of
# the presses' standard deviation)
MIN_PRESSES = 50
# Minimum number of pairs of the split for its own mean (assumed: of five, RMSE is a tenth lower)
MIN_PAIRS = 5


def neighbors(
    stored: Readings,
    queries: Readings,
    k: int = 1,
    shapes: tuple[np.ndarray, np.ndarray] | None = None,
    progress: str | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the k stored images, or counts, nearest to each query, (P, k), the nearest first,
    and their RMS differences at FEATURE_SIZE, (P, k), infinite beyond the last. shapes: (M,) and
    (P,) names; stored images of the query's own shape are excluded. progress: title of a bar."""
    pixels = stored[:].reshape(len(stored), -1)
    # The mean image; subtracting it reduces rounding errors of distances.
    mean = pixels.mean(axis=0, dtype=float).astype(np.float32)
    features = torch.from_numpy(pixels - mean)
    found: list[tuple[torch.Tensor, torch.Tensor]] = []
    starts = range(0, len(queries), BATCH_SIZE)
    for start in Progress(starts, progress, unit="part", disable=progress is None):
        part = slice(start, start + BATCH_SIZE)
        batch = torch.from_numpy(queries[part].reshape(-1, mean.size) - mean)
        rough = torch.cdist(batch, features)
        if shapes is not None:
            rough[torch.from_numpy(shapes[1][part][:, None] == shapes[0])] = torch.inf
        values, near = rough.topk(min(k, len(stored)), largest=False)
        exact = (features[near] - batch[:, None]).double().square().mean(dim=2).sqrt()
        ordered = exact.where(values.isfinite(), torch.inf).sort(dim=1, stable=True)
        found.append((near.gather(1, ordered.indices), ordered.values))
    index, distance = (torch.cat(each).numpy() for each in zip(*found, strict=True))
    return index, distance


def view_on(
    x_mm: np.ndarray, y_mm: np.ndarray, view_mm: tuple[float, float]
) -> tuple[Figures, dict[str, np.ndarray]]:
    """The view of `Evaluation`, and the taxels by TAXEL_GROUPS, (N,) bool. view_mm: half of what
    the image shows. The pitch is the median distance of a taxel to its nearest neighbor."""
    half_width, half_height = view_mm
    points = np.column_stack([x_mm, y_mm])
    pitch = float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))
    distance_mm = np.hypot(
        np.maximum(np.abs(points[:, 0]) - half_width, 0.0),
        np.maximum(np.abs(points[:, 1]) - half_height, 0.0),
    )
    near = distance_mm <= pitch * (1.0 + SLACK)
    masks = (distance_mm == 0.0, near & (distance_mm > 0.0), ~near)
    groups: dict[str, np.ndarray] = dict(zip(TAXEL_GROUPS, masks, strict=True))
    view: Figures = {"width_mm": 2 * half_width, "height_mm": 2 * half_height, "pitch_mm": pitch}
    return view | {name: int(mask.sum()) for name, mask in groups.items()}, groups


def representable(trained: ArrayInfo, x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """(N, N) projection of counts of taxels inside the trained layout's hull onto those that its
    images can represent: the least-squares approximation by interpolations of M trained taxels."""
    points = np.column_stack([trained.x_mm, trained.y_mm])
    weights = barycentric(points, np.column_stack([x_mm, y_mm]), OUTSIDE_PARTS).toarray()
    return weights @ np.linalg.pinv(weights)


def second_reading(counts: np.ndarray, array: ArrayInfo) -> np.ndarray | None:
    """A second reading of each press, (P, N) float32; None without known imperfections.

    Two readings of each of the (P, N) counts are simulated, as if it were noiseless, and their
    difference is added to it. Permanent imperfections cancel.
    """
    if array.imperfections is None:
        return None
    layout, flaws, table = array.taxels, array.imperfections, array.reading
    at_rest, _ = expected_reading(flaws, table, np.zeros(layout.size))
    rng = np.random.default_rng(SEED)
    repeated = np.empty(counts.shape, np.float32)
    for row, stored in enumerate(counts.astype(float)):
        touched = np.maximum(stored - at_rest, 0.0)
        one, two = (
            read_after(None, touched, layout, flaws, table, rng)[0].astype(float) for _ in range(2)
        )
        repeated[row] = stored + (two - one)
    return repeated


def force_bins(pairs: Pairs, train: Pairs) -> tuple[pd.DataFrame, np.ndarray]:
    """The bin of each pair, P rows, and the mean array of its force, (P, N) float32, counts.

    low_n, high_n: edges, equal for a single force, 0 without contact and NaN for an unknown force.
    mean_of: the "training" presses in this bin, or the pairs of the "split" themselves where there
    are fewer than MIN_PRESSES. Of fewer than MIN_PAIRS of them the mean array is NaN, unknown.
    Pairs without a bin have the mean of all training presses.
    """
    force_n = np.concatenate([pairs.force_n, train.force_n])
    single = np.unique(force_n[force_n > 0].round(DECIMALS)).size <= MAX_FORCES
    edges_n = force_n.astype(float).round(DECIMALS)
    if not single:
        steps = np.floor(BINS_PER_DOUBLING * np.log2(force_n[force_n > 0]))
        edges_n = np.where(np.isnan(force_n), np.nan, 0.0)
        edges_n[force_n > 0] = 2.0 ** (steps / BINS_PER_DOUBLING)
    low_n, trained_n = np.split(edges_n, [len(pairs)])  # NaN for unknown forces
    high_n = low_n if single else low_n * 2 ** (1 / BINS_PER_DOUBLING)
    bins = pd.DataFrame({"low_n": low_n, "high_n": high_n, "mean_of": "training"})
    arrays = np.tile(train.counts.mean(axis=0, dtype=float), (len(pairs), 1)).astype(np.float32)
    for edge in np.unique(low_n[~np.isnan(low_n)]):
        members, counts = low_n == edge, train.counts[trained_n == edge]
        if len(counts) < MIN_PRESSES:
            bins.loc[members, "mean_of"] = "split"
            counts = pairs.counts[members]
        arrays[members] = counts.mean(axis=0, dtype=float) if len(counts) >= MIN_PAIRS else np.nan
    return bins, arrays


def predict_baselines(
    pairs: Pairs,
    train: Pairs,
    nearest: np.ndarray,
    of_force: np.ndarray | None,
    own: ArrayInfo,
    trained_layouts: Iterable[ArrayInfo],
) -> dict[str, np.ndarray]:
    """(P, N) counts of the trivial predictors and of the floors that are known, by row.

    nearest: (P,) indices of training pairs. of_force: of `force_bins`, None with one force only.
    own: the dataset's array. trained_layouts: of runs that interpolate between their own taxels;
    the first unlike the dataset's has a floor.
    """
    mean = train.counts.mean(axis=0, dtype=float).astype(np.float32)
    rows = {MEAN_ARRAY: np.tile(mean, (len(pairs), 1))}
    if of_force is not None:
        rows[MEAN_ARRAY_OF_FORCE] = of_force
    rows[NEAREST_NEIGHBOR] = train.counts[nearest]
    repeated = second_reading(pairs.counts, own)
    if repeated is not None:
        rows[NOISE_FLOOR] = repeated
    for array in trained_layouts:
        if not array.fits(own):
            projection = representable(array, own.x_mm, own.y_mm)
            rows[LAYOUT_FLOOR] = (pairs.counts @ projection.T).astype(np.float32)
            break
    return rows
