"""Results of an evaluation as records, and their file DIR/metrics.json.

Keys of the JSON file are the attributes of the records.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from t2twin.core.errors import T2TwinError
from t2twin.core.files import write_json
from t2twin.core.records import read_json

FORMAT = 5
"""Version of metrics.json."""

METRICS = "metrics.json"

MeanOf = Literal["training", "split"]

Values = dict[str, int | float | None]
"""Metrics by name; None if unknown."""


class Interval(NamedTuple):
    """An interval; a list of two numbers in the file."""

    low: float
    high: float


@dataclass(frozen=True)
class Figures:
    """Figures over a number of pairs; None if no pair has the figure.

    rmse_percent: RMSE in percent of full scale, and ssim: structural similarity of the predicted
    and the true picture, of any target. Of counts: rmse_counts; ssim_contact over the contact;
    contact_iou, intersection over union of the contacts; centroid_error_mm, distance of the images'
    centroids. total_error_percent: mean absolute error of the summed counts relative to their mean.
    RMSE of the taxels under the image's view, near, within one pitch of it, and beyond. Of images:
    rmse_grey, grey levels; mean PSNR over the picture and over its contact.
    """

    pairs: int
    rmse_percent: float
    ssim: float
    rmse_counts: float | None = None
    ssim_contact: float | None = None
    contact_iou: float | None = None
    centroid_error_mm: float | None = None
    total_error_percent: float | None = None
    rmse_under_counts: float | None = None
    rmse_near_counts: float | None = None
    rmse_beyond_counts: float | None = None
    rmse_grey: float | None = None
    psnr_db: float | None = None
    psnr_contact_db: float | None = None

    @property
    def counts(self) -> float:
        """RMSE of figures of counts."""
        assert self.rmse_counts is not None
        return self.rmse_counts


@dataclass(frozen=True)
class ForceFigures:
    """Figures over the pairs of one range of forces.

    low_n, high_n: its edges, N, equal for a single force; both 0 for presses without contact.
    mean_n: mean force, N. rmse_counts, with its interval over shapes. of_mean_array: RMSE relative
    to that of the mean array of the range; mean_of: whether that is the mean of training presses
    or, if these are too few, of the split's. Both are None without contact. phantom_counts: mean of
    the summed predicted counts without contact, None otherwise.
    """

    low_n: float
    high_n: float
    mean_n: float
    pairs: int
    rmse_counts: float
    rmse_percent: float
    interval: Interval | None
    of_mean_array: float | None
    mean_of: MeanOf | None
    phantom_counts: float | None

    @property
    def title(self) -> str:
        """As in "8 N", "0.71-1 N" or "no contact"."""
        if self.phantom_counts is not None:
            return "no contact"
        if self.low_n == self.high_n:
            return f"{self.low_n:g} N"
        return f"{self.low_n:.3g}-{self.high_n:.3g} N"


@dataclass(frozen=True)
class Uncertainty:
    """Calibration and sharpness of a run's predicted uncertainty; see module metrics.

    levels: nominal coverages of intervals; coverage: the observed ones. retained: shares of the
    presses, the most certain ones; retained_rmse_counts: RMSE over them. predicted_rmse_counts:
    RMSE according to the predicted standard deviations. force_median_error_percent,
    force_coverage_percent: for presses with contact, error relative to the true force, and coverage
    of the 90 % intervals; None for runs without force.
    """

    levels: tuple[float, ...]
    coverage: tuple[float, ...]
    retained: tuple[float, ...]
    retained_rmse_counts: tuple[float, ...]
    predicted_rmse_counts: float
    force_median_error_percent: float | None
    force_coverage_percent: float | None

    def coverage_at(self, level: float) -> float:
        """Observed coverage of the intervals of one of the levels."""
        return self.coverage[self.levels.index(level)]

    def sparsification_gain(self, retained: float) -> float:
        """Relative decrease of the RMSE with one of the shares retained."""
        whole = self.retained_rmse_counts[self.retained.index(1.0)]
        part = self.retained_rmse_counts[self.retained.index(retained)]
        return 1.0 - part / whole if whole else 0.0


@dataclass(frozen=True)
class ModelRow:
    """One row of the results: a trained run, a trivial predictor, or a floor.

    by_shape, by_family: figures by names of shapes and families; by_shape is empty with more than
    evaluate.MAX_SHAPES shapes. interval: of the overall figures. by_force: in ascending order;
    empty if no force is known. The rest is None for rows that are not runs. run: its folder as
    given. weights_sha256: of its best.safetensors. same_data: whether it was trained on the dataset
    of the evaluation. trained_layout, trained_data, trained_recipe, trained_pairs, trained_steps:
    the layout of its training dataset, SHA-256 of info.json, recipe and number of pairs, and the
    number of steps; None if unknown. uncertainty: of runs that predict it. by_motion: figures of
    "still" and "moving" pairs, and shear: of runs that predict it; None for a dataset without
    motion. contact: of runs that predict it; None for a dataset without contact maps.
    """

    overall: Figures
    by_shape: dict[str, Figures]
    by_family: dict[str, Figures]
    interval: dict[str, Interval | None]
    run: str | None = None
    weights_sha256: str | None = None
    same_data: bool | None = None
    trained_layout: str | None = None
    trained_data: str | None = None
    trained_recipe: str | None = None
    trained_pairs: int | None = None
    trained_steps: int | None = None
    by_force: tuple[ForceFigures, ...] = ()
    uncertainty: Uncertainty | None = None
    by_motion: dict[str, Values] | None = None
    shear: Values | None = None
    contact: Values | None = None


@dataclass(frozen=True)
class Evaluation:
    """Result of `evaluate` on one split.

    contact_level: a pixel above this fraction of its image's maximum is in contact. info_sha256: of
    the dataset's info.json. layout: name of its taxel layout. models: rows by name. bootstrap: the
    resampled unit, and numbers. paired: touch2touch minus ResNet18 by figure: difference, and low
    and high of its interval; empty without both. paper: figures of the paper's models, on hardware.
    view: size of the camera's view, pitch of the layout, and numbers of taxels "under" the view,
    "near" it, within one pitch, and "beyond"; None without a camera as source. recipe: of the
    dataset, None for imported pairs. background: source of the background frames of field runs, or
    of those that images are compared with. source, target: names of the sensors. pictures: what
    predicted images are compared as; None for counts. Full scale and layout are None for images.
    """

    format: int
    split: str
    pairs: int
    full_scale_counts: float | None
    contact_level: float
    info_sha256: str
    layout: str | None
    view: Values | None
    models: dict[str, ModelRow]
    bootstrap: dict[str, int | float | str]
    paired: dict[str, Values]
    paper: dict[str, Values]
    recipe: str | None = None
    background: str | None = None
    source: str | None = None
    target: str | None = None
    pictures: str | None = None

    @property
    def has_forces(self) -> bool:
        """Whether its pairs have several forces."""
        return any(len(row.by_force) > 1 for row in self.models.values())

    @property
    def runs(self) -> dict[str, ModelRow]:
        """The rows of trained runs, in the order of the arguments."""
        return {name: row for name, row in self.models.items() if row.run is not None}


def read_evaluation(folder: Path) -> Evaluation:
    """Reads the evaluation of one split from a folder.

    Raises T2TwinError if metrics.json is missing, damaged or of another version of t2twin.
    """
    path = folder / METRICS
    if not path.is_file():
        raise T2TwinError(
            f"{folder} contains no evaluation (no {METRICS}); make one with `evaluate`"
        )
    return read_json(path, Evaluation, FORMAT)


def write_evaluation(folder: Path, evaluation: Evaluation) -> None:
    """Writes folder/metrics.json."""
    write_json(folder / METRICS, msgspec.to_builtins(evaluation))
