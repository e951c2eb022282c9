"""Errors of predictions in groups of pairs, with intervals; errors of uncertainty and shear force.

A table of values has a row for each pair and a column for each quantity. The figures of a group of
pairs, or of a resample of the bootstrap, follow from the means over the pairs that have a value.
Presses of one shape are similar, so whole shapes are resampled (percentile intervals of Efron and
Tibshirani 1993). Sparsification is El-Yaniv and Wiener's (2010) risk against coverage.

Shape letters: P pairs, N taxels, S side and c channels of a picture, B resamples.
"""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pandas as pd
from skimage.metrics import structural_similarity

from t2twin.core.machine import cores
from t2twin.core.progress import Progress
from t2twin.sim.taxels.phi import Phi
from t2twin.translate.data.images import COLORS, WHITE_GREY
from t2twin.translate.data.pairs import Pairs
from t2twin.translate.evaluation.records import Figures, ForceFigures, Interval, Uncertainty
from t2twin.translate.inference.estimate import Estimate, half_width

CONTACT_LEVEL = 0.1  # fraction of its image's maximum above which a pixel is in contact (assumed)
# Difference from the background frame above which a pixel is in contact, grey levels of the channel
# where it is largest (assumed: eight times a DIGIT's noise)
CONTACT_GREY = 8.0
MIN_SQUARE = 1e-3  # lower bound of the mean squared difference in a PSNR, grey levels^2 (assumed)
LUMA = (0.299, 0.587, 0.114)  # weights of a grey picture (ITU-R BT.601, as Pillow's)
BATCH_SIZE = 64  # pairs whose tactile images are computed together; bounds memory to 50 MB
RESAMPLES, SEED, CONFIDENCE = 1000, 0, 0.95  # number, seed; share of them in an interval
LEVELS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99)  # nominal coverages
RETAINED = tuple(round(1.0 - 0.05 * n, 2) for n in range(18))  # shares of the most certain presses
REPORTED_LEVEL, REPORTED_SHARE = 0.9, 0.8  # of LEVELS and RETAINED, in tables
MIN_SHEAR_N = 0.3  # true shear force above which its direction is compared (assumed)


def compare(
    predicted: np.ndarray,
    true: np.ndarray,
    phi: Phi,
    full_scale: float,
    progress: str | None = None,
    taxel_groups: Mapping[str, np.ndarray] | None = None,
    std: np.ndarray | None = None,
) -> pd.DataFrame:
    """Values of each pair. predicted, true: (P, N), counts; full_scale: SSIM's data range.

    squared_error: mean over the taxels, and over each of the taxel_groups, (N,) bool by name. ssim:
    of the tactile images. ssim_contact: over the true contact. Also contact_iou, centroid_error_mm,
    total_error and total, counts. Columns of the contact are NaN without contact. std: (P, N),
    predicted standard deviations, for the column coverage_percent.
    """
    predicted, true = predicted.astype(float), true.astype(float)
    squares = np.square(predicted - true)
    # phi is linear, so the moments of the images are products of the counts with those of phi. The
    # centroid of an empty prediction is the center of the image.
    x_mm, y_mm = np.meshgrid(*phi.centers_mm)
    weights = np.column_stack([np.ones(x_mm.size), x_mm.ravel(), y_mm.ravel()])
    a, b = (each @ (phi.matrix.T @ weights) for each in (predicted, true))
    found = a[:, 1:] / np.where(a[:, :1] > 0, a[:, :1], np.inf)
    off_mm = found - b[:, 1:] / np.where(b[:, :1] > 0, b[:, :1], np.nan)
    values = {
        "squared_error": squares.mean(axis=1),
        "centroid_error_mm": np.linalg.norm(off_mm, axis=1),
        "total_error": np.abs(predicted.sum(axis=1) - true.sum(axis=1)),
        "total": true.sum(axis=1),
    }
    for name, inside in (taxel_groups or {}).items():
        if inside.any():
            values[f"squared_error_{name}"] = squares[:, inside].mean(axis=1)
    if std is not None:
        values["coverage_percent"] = 100.0 * _covered(predicted - true, std).mean(axis=1)
    scores = []
    with (
        ThreadPoolExecutor(cores()) as pool,
        Progress(total=len(true), desc=progress, unit="pair", disable=progress is None) as bar,
    ):
        for start in range(0, len(true), BATCH_SIZE):
            part = slice(start, start + BATCH_SIZE)
            images = phi(predicted[part]), phi(true[part])
            scores += pool.map(lambda a, b: image_scores(a, b, full_scale), *images)
            bar.update(len(images[0]))
    names = ["ssim", "ssim_contact", "contact_iou"]
    return pd.DataFrame(values).join(pd.DataFrame(scores, columns=names))


def image_scores(a: np.ndarray, b: np.ndarray, data_range: float) -> tuple[float, float, float]:
    """SSIM of two tactile images, SSIM over the contact of b, and IoU of the contacts.

    A pixel above CONTACT_LEVEL of its image's maximum is in contact; NaN without contact.
    """
    shares = (np.float32(each / data_range) for each in (a, b))
    found: Any = structural_similarity(*shares, data_range=1.0, full=True)
    ssim, local = found
    one, other = (image > CONTACT_LEVEL * max(image.max(), 0.0) for image in (a, b))
    either = (one | other).sum()
    in_contact = local[other].mean(dtype=float) if other.any() else np.nan
    return float(ssim), in_contact, (one & other).sum() / either if either else np.nan


def compare_images(
    predicted: np.ndarray, true: np.ndarray, background: np.ndarray | None
) -> pd.DataFrame:
    """Values of each pair. predicted, true: (P, S, S, c) uint8. background: (S, S, c) uint8; the
    contact is where the true picture differs from it. squared_error: grey levels^2."""
    rows = []
    for ours, theirs in zip(predicted, true, strict=True):
        squares = np.square(ours.astype(np.float32) - theirs).mean(axis=-1, dtype=float)
        ssim = structural_similarity(_grey(ours), _grey(theirs), data_range=WHITE_GREY)
        in_contact = np.nan
        if background is not None:
            change = np.abs(theirs.astype(np.float32) - background).max(axis=-1) > CONTACT_GREY
            in_contact = squares[change].mean() if change.any() else np.nan
        rows.append((squares.mean(), _psnr_db(squares.mean()), _psnr_db(in_contact), ssim))
    return pd.DataFrame(rows, columns=["squared_error", "psnr_db", "psnr_contact_db", "ssim"])


def _grey(picture: np.ndarray) -> np.ndarray:
    return picture @ np.array(LUMA if picture.shape[-1] == COLORS else (1.0,))


def _psnr_db(square: float) -> float:
    return 10.0 * np.log10(WHITE_GREY**2 / max(square, MIN_SQUARE)) if square == square else np.nan


def figures_of(means: pd.DataFrame, full_scale: float) -> pd.DataFrame:
    """The figures from the means of the values, a row for each group. A column that is no error or
    total of counts is a figure itself. full_scale: of the target, counts or grey levels."""
    rmse = pd.DataFrame(np.sqrt(means.filter(like="squared_error")))
    unit = "grey" if "psnr_db" in means else "counts"
    figures = rmse.rename(columns=lambda name: f"{name.replace('squared_error', 'rmse')}_{unit}")
    figures["rmse_percent"] = 100.0 * rmse["squared_error"] / full_scale
    if "total" in means:
        total = means["total"].where(means["total"] > 0)
        figures["total_error_percent"] = 100.0 * means["total_error"] / total
    others = means.columns.difference([*rmse, "total", "total_error"], sort=False)
    return figures.join(means[others])


def by_name(values: pd.DataFrame, full_scale: float, names: np.ndarray) -> dict[str, Figures]:
    """Figures over the pairs of each name. names: (P,), as of shapes."""
    groups = values.groupby(names)
    figures = figures_of(groups.mean(), full_scale).assign(pairs=groups.size())
    return {str(name): known(row) for name, row in figures.to_dict("index").items()}


def known(figures: Mapping[Any, float]) -> Figures:
    """The figures that are not NaN."""
    numbers = {name: value for name, value in figures.items() if not np.isnan(value)}
    return {n: value if isinstance(value, int) else float(value) for n, value in numbers.items()}


def overall(values: pd.DataFrame, full_scale: float) -> Figures:
    """Figures over all pairs."""
    return by_name(values, full_scale, np.zeros(len(values), int))["0"]


def resample_weights(shapes: int, seed: int = SEED) -> np.ndarray:
    """Multiplicity of each of K shapes in each resample: (B, K); rows sum to K."""
    shares = np.full(shapes, 1.0 / shapes)
    return np.random.default_rng(seed).multinomial(shapes, shares, size=RESAMPLES).astype(float)


def resampled_means(values: pd.DataFrame, shapes: np.ndarray) -> pd.DataFrame:
    """Means of the values in each resample of the (P,) shapes, B rows. Equal shapes result in equal
    resamples, so that differences between two models are paired."""
    groups = values.groupby(shapes)
    weights = resample_weights(groups.ngroups)
    pairs = weights @ groups.count().to_numpy(float)
    totals = weights @ groups.sum().to_numpy()
    means = np.divide(totals, pairs, out=np.full(totals.shape, np.nan), where=pairs > 0)
    return pd.DataFrame(means, columns=values.columns)


def interval(values: np.ndarray) -> Interval | None:
    """The percentile interval that contains CONFIDENCE of (B,) values; None if all are equal, as
    for a single shape, or less than half are finite."""
    known = values[np.isfinite(values)]
    if known.size < values.size / 2 or np.ptp(known) == 0:
        return None
    low, high = np.quantile(known, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def intervals(
    values: pd.DataFrame, full_scale: float, shapes: np.ndarray
) -> dict[str, Interval | None]:
    """The interval of each figure over resamples of the shapes. Arguments as for `by_name`."""
    resampled = figures_of(resampled_means(values, shapes), full_scale)
    return {str(name): interval(each.to_numpy()) for name, each in resampled.items()}


def paired(
    one: pd.DataFrame, two: pd.DataFrame, full_scale: float, shapes: np.ndarray
) -> dict[str, Figures]:
    """Differences of the figures of two models, with intervals from the same resamples."""
    first, second = (overall(each, full_scale) for each in (one, two))
    drawn = [figures_of(resampled_means(each, shapes), full_scale) for each in (one, two)]
    samples, differences = drawn[0] - drawn[1], {}
    for name, value in first.items():
        if name in second and name in samples:
            span = interval(samples[name].to_numpy()) or ()
            ends = dict(zip(("low", "high"), span, strict=False))
            differences[name] = {"difference": value - second[name]} | ends
    return differences


def by_force(
    predicted: np.ndarray,
    values: pd.DataFrame,
    pairs: Pairs,
    bins: tuple[pd.DataFrame, np.ndarray],
    full_scale: float,
) -> tuple[ForceFigures, ...]:
    """Errors of one model in each bin of `force_bins`. predicted: (P, N) counts. values: of
    `compare`."""
    of_pairs, mean_arrays = bins
    table = of_pairs.assign(
        square=values["squared_error"],
        of_mean=np.square(mean_arrays - pairs.counts.astype(float)).mean(axis=1),
        total=predicted.sum(axis=1, dtype=float),
        force_n=pairs.force_n,
    ).dropna(subset="low_n")
    if table.empty:
        return ()
    squares = table.pivot(columns="low_n", values="square")
    resampled = np.sqrt(resampled_means(squares, pairs.shapes[squares.index]))
    groups = table.groupby("low_n")
    first = groups[["high_n", "mean_of"]].first().assign(pairs=groups.size())
    means = groups[["square", "of_mean", "total", "force_n"]].mean()
    rows = []
    for one in first.join(means).reset_index().to_dict("records"):
        rmse, level, touches = np.sqrt(one["square"]), np.sqrt(one["of_mean"]), one["high_n"] > 0
        rows.append(
            ForceFigures(
                low_n=one["low_n"],
                high_n=one["high_n"],
                mean_n=one["force_n"],
                pairs=one["pairs"],
                rmse_counts=float(rmse),
                rmse_percent=float(100.0 * rmse / full_scale),
                interval=interval(np.asarray(resampled[one["low_n"]])),
                of_mean_array=float(rmse / level) if touches and level > 0 else None,
                mean_of=one["mean_of"] if touches else None,
                phantom_counts=None if touches else one["total"],
            )
        )
    return tuple(rows)


def _covered(errors: np.ndarray, std: np.ndarray, level: float = REPORTED_LEVEL) -> np.ndarray:
    """Whether errors are within the intervals of a level, which are not clipped: counts of zero and
    full scale lie on the ends of clipped ones."""
    return np.abs(errors) <= half_width(level) * std


def uncertainty_metrics(estimate: Estimate, counts: np.ndarray, force_n: np.ndarray) -> Uncertainty:
    """Metrics of an estimate of P pairs with true counts, (P, N), and forces, (P,). A press's
    uncertainty is the root mean square of its taxels' standard deviations."""
    errors, std = counts - estimate.counts.astype(float), estimate.counts_std
    squares = np.square(errors).mean(axis=1)
    uncertainty = np.sqrt(np.square(std.astype(float)).mean(axis=1))
    order = np.argsort(uncertainty, kind="stable")
    numbers = [max(1, round(share * order.size)) for share in RETAINED]
    coverage = [float(_covered(errors, std, level).mean()) for level in LEVELS]
    rmse = [float(np.sqrt(squares[order[:n]].mean())) for n in numbers]
    part = rmse[RETAINED.index(REPORTED_SHARE)]
    figures = {
        "coverage_percent": 100.0 * coverage[LEVELS.index(REPORTED_LEVEL)],
        "gain_percent": 100.0 * (1.0 - part / rmse[0]) if rmse[0] else 0.0,
        "predicted_rmse_counts": float(np.sqrt(np.square(uncertainty).mean())),
    }
    touching = force_n > 0
    if estimate.force_n is not None and estimate.force_std_n is not None and touching.any():
        off_n = np.abs(estimate.force_n - force_n)[touching]
        figures |= {
            "force_median_error_percent": float(100.0 * np.median(off_n / force_n[touching])),
            "force_coverage_percent": float(
                100.0 * _covered(off_n, estimate.force_std_n[touching]).mean()
            ),
        }
    return Uncertainty(figures, LEVELS, tuple(coverage), RETAINED, tuple(rmse))


def shear_metrics(estimate: Estimate, pairs: Pairs) -> Figures | None:
    """Errors of the predicted shear force on the moving pairs, None where there are none.

    Medians of direction and magnitude are over the pairs above min_shear_n, missing without.
    """
    moving = pairs.is_moving
    if estimate.shear_n is None or pairs.shear_n is None or moving is None or not moving.any():
        return None
    true, found = pairs.shear_n[moving], estimate.shear_n[moving].astype(float)
    covered = _covered(found - true, estimate.shear_std_n[moving])
    large = np.hypot(*true.T) > MIN_SHEAR_N
    true, found = true[large], found[large]
    turn = np.arctan2(true[:, 0] * found[:, 1] - true[:, 1] * found[:, 0], (true * found).sum(1))
    error = np.abs(np.hypot(*found.T) / np.hypot(*true.T) - 1.0)
    return known(
        {
            "pairs": int(large.sum()),
            "min_shear_n": MIN_SHEAR_N,
            "direction_error_deg": np.degrees(pd.Series(np.abs(turn)).median()),
            "magnitude_error_percent": 100.0 * pd.Series(error).median(),
            "coverage_percent": float(100.0 * covered.mean()),
        }
    )
