"""Predictions with uncertainty: counts, dense counts and force, each with its standard deviation.

Shape letters: B images, N taxels, F places of the dense counts.
"""

from dataclasses import dataclass, fields, replace
from statistics import NormalDist
from typing import Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.reading import expected_reading
from t2twin.sim.taxels.spec import CountsTable, Imperfections
from t2twin.sim.taxels.taxel_array import TaxelArray
from t2twin.translate.uncertainty.ood import OODClass


@dataclass(frozen=True)
class Estimate:
    """The prediction for one image, or for B images with B before every shape.

    counts: (N,) float32. All else may be None. counts_std: (N,) float32, their standard deviations.
    dense_counts, dense_counts_std: (F,) float32, the same at the places of the dense counts.
    force_n, force_std_n: () float32, N, unless the run was trained on presses of one force.
    shear_n, shear_std_n: (2,) float32, N, shear force on the gel camera along x and y.
    tactile_images, tactile_std: (R, C) float32, counts. full_scale_counts: where taxels saturate.
    ood_class: the OODClass, of B images (B,) objects. array: the taxel array as in datasets, with
    its imperfections.

    Counts and their standard deviations are of the noiseless array.
    """

    full_scale_counts: float
    counts: np.ndarray
    counts_std: Any = None
    dense_counts: Any = None
    dense_counts_std: Any = None
    force_n: Any = None
    force_std_n: Any = None
    shear_n: Any = None
    shear_std_n: Any = None
    tactile_images: Any = None
    tactile_std: Any = None
    ood_class: Any = None
    array: TaxelArray | None = None

    def __repr__(self) -> str:
        parts = [f"counts {self.counts.shape}"]
        if self.dense_counts is not None:
            parts.append(f"dense_counts {self.dense_counts.shape}")
        for name in ("force", "shear"):
            value, std = getattr(self, f"{name}_n"), getattr(self, f"{name}_std_n")
            if value is not None and std is not None:
                is_single = self.counts.ndim == 1
                parts.append(f"{name} {with_std(value, std) if is_single else value.shape} N")
        classes = [] if self.ood_class is None else np.atleast_1d(self.ood_class)
        found = dict.fromkeys(map(str, classes))  # each once
        parts += [name for name in found if name != OODClass.IN_DISTRIBUTION]
        return f"Estimate({', '.join(parts)})"

    def interval(self, level: float = 0.9, reading: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper ends of the central intervals of the counts, clipped to full scale.

        level: probability, between 0 and 1. reading: whether of a reading of the array, with its
        counts at rest and its noise. Raises T2TwinError for a reading of an unknown noise.
        """
        if self.counts_std is None:
            raise T2TwinError("the run predicts no uncertainty; an interval needs a field run")
        counts, std = self.counts, self.counts_std
        if arguments.flag(reading, "reading"):
            if self.array is None:
                raise T2TwinError(
                    "the noise of this run's array is unknown; reading=True needs a run on a "
                    "sensor of a file that this machine has"
                )
            counts, std = readings_of(self, self.array.flaws, self.array.spec.counts)
        half = half_width(level) * std
        low, high = counts - half, counts + half
        return low.clip(0.0, self.full_scale_counts), high.clip(0.0, self.full_scale_counts)

    def first(self) -> "Estimate":
        """The estimate of the first image alone."""
        return replace(self, **{name: getattr(self, name)[0] for name in _arrays(self)})


# Names of the predictions of an estimate
VALUES = tuple(
    each.name
    for each in fields(Estimate)
    if each.name not in ("full_scale_counts", "ood_class", "array")
)


def readings_of(
    estimate: Estimate, flaws: Imperfections, table: CountsTable
) -> tuple[np.ndarray, np.ndarray]:
    """Expected readings of an array, with its counts at rest, and their standard deviations."""
    mean, noise = expected_reading(flaws, table, estimate.counts)
    std = np.hypot(estimate.counts_std, noise)
    return mean.astype(np.float32), std.astype(np.float32)


def with_std(value: np.ndarray, std: np.ndarray) -> str:
    """Values and their standard deviations in words."""
    pairs = zip(np.atleast_1d(value), np.atleast_1d(std), strict=True)
    return ", ".join(f"{each:.3g} ± {spread:.2g}" for each, spread in pairs)


def half_width(level: float) -> float:
    """Half the width of a Gaussian's central interval, standard deviations."""
    level = arguments.real(level, "level")
    if not 0.0 < level < 1.0:
        raise T2TwinError(f"level is {level:g}; it must lie between 0 and 1")
    return NormalDist().inv_cdf(0.5 + level / 2)


def concatenate(parts: list[Estimate]) -> Estimate:
    """Concatenates one or more estimates of several images."""
    found = {name: [getattr(part, name) for part in parts] for name in _arrays(parts[0])}
    return replace(parts[0], **{name: np.concatenate(each) for name, each in found.items()})


def _arrays(estimate: Estimate) -> list[str]:
    """Names of the predictions that an estimate has."""
    return [name for name in (*VALUES, "ood_class") if getattr(estimate, name) is not None]
