"""Predictions with uncertainty: counts, dense counts and force, each with its standard deviation.

Shape letters: B images, N taxels, F places of the dense counts, R rows, C columns.
"""

from collections.abc import Sequence
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

    Counts and standard deviations are of the noiseless array. What a run does not predict is None.
    """

    full_scale_counts: float  # where taxels saturate
    counts: np.ndarray  # (N,) float32
    counts_std: Any = None  # (N,) float32, their standard deviations
    dense_counts: Any = None  # (F,) float32, at the places of the dense counts
    dense_counts_std: Any = None
    force_n: Any = None  # () float32, N, unless the run was trained on presses of one force
    force_std_n: Any = None
    shear_n: Any = None  # (2,) float32, N, shear force on the gel camera along x and y
    shear_std_n: Any = None
    tactile_images: Any = None  # (R, C) float32, counts
    tactile_std: Any = None
    ood_class: Any = None  # the OODClass, of B images (B,) objects
    contact: Any = None  # the ContactEstimate, of B images a list of them
    array: TaxelArray | None = None  # as in datasets, with its imperfections

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
        if arguments.flag(reading, "reading"):
            if self.array is None:
                raise T2TwinError(
                    "the noise of this run's array is unknown; reading=True needs a run on a "
                    "sensor of a file that this machine has"
                )
            return self.of_readings(self.array.flaws, self.array.spec.counts).interval(level)
        half = half_width(level) * self.counts_std
        low, high = self.counts - half, self.counts + half
        return low.clip(0.0, self.full_scale_counts), high.clip(0.0, self.full_scale_counts)

    def of_readings(self, flaws: Imperfections, table: CountsTable) -> "Estimate":
        """The same with the expected readings of an array, which have its counts at rest, and
        their standard deviations."""
        mean, noise = expected_reading(flaws, table, self.counts)
        std = np.hypot(self.counts_std, noise)
        return replace(self, counts=mean.astype(np.float32), counts_std=std.astype(np.float32))

    def first(self) -> "Estimate":
        """The estimate of the first image alone."""
        found = {name: getattr(self, name) for name in OF_IMAGES}
        return replace(self, **{n: each[0] for n, each in found.items() if each is not None})


# Names of what an estimate has of each image, and of what a network predicts directly
OF_IMAGES = tuple(f.name for f in fields(Estimate) if f.name not in ("full_scale_counts", "array"))
VALUES = tuple(name for name in OF_IMAGES if name not in ("ood_class", "contact"))


def concatenate(parts: Sequence[Estimate]) -> Estimate:
    """Concatenates one or more estimates of several images, which have no contact."""
    found = {name: [getattr(part, name) for part in parts] for name in (*VALUES, "ood_class")}
    return replace(
        parts[0], **{n: np.concatenate(each) for n, each in found.items() if each[0] is not None}
    )


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
