"""Results of an evaluation as records, and their files.

    DIR/metrics.json      the result of `evaluate` on one split: an Evaluation
    DIR/findings.json     the findings of both splits, and the gap between the two
    DIR/results.md        both splits in one table

Keys of the JSON files are the attributes of the records. RMSE is the root of the mean squared error
of the counts over pairs and taxels: the square root of the loss that Grella et al. 2023 call L3.
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from t2twin.core.errors import T2TwinError
from t2twin.core.files import write_json
from t2twin.core.records import read_json

FORMAT = 5
"""Version of metrics.json."""

METRICS = "metrics.json"
FINDINGS = "findings.json"

FigureName = Literal[
    "rmse_counts",
    "rmse_percent",
    "ssim",
    "ssim_contact",
    "contact_iou",
    "centroid_error_mm",
    "total_error_percent",
    "rmse_under_counts",
    "rmse_near_counts",
    "rmse_beyond_counts",
    "rmse_grey",
    "psnr_db",
    "psnr_contact_db",
]
Answer = Literal["yes", "no", "undecided"]
MeanOf = Literal["training", "split"]


class Interval(NamedTuple):
    """An interval; a list of two numbers in the file."""

    low: float
    high: float


@dataclass(frozen=True)
class Figures:
    """Figures over a number of pairs; None if no pair has the figure.

    rmse_percent: RMSE in percent of full scale, and ssim: structural similarity of the predicted
    and the true picture, of any target. Of counts: rmse_counts: RMSE. ssim_contact: over contact.
    contact_iou: intersection over union of the two contacts. centroid_error_mm: distance of the
    images' centroids. total_error_percent: mean absolute error of the summed counts, relative to
    their mean. rmse_under_counts, rmse_near_counts, rmse_beyond_counts: RMSE of the taxels under
    the image's view, within one pitch of it, and beyond. Of images (module image_errors):
    rmse_grey: RMSE, grey levels. psnr_db, psnr_contact_db: mean PSNR over the picture, and over its
    contact.
    """

    pairs: int
    rmse_counts: float | None
    rmse_percent: float
    ssim: float
    ssim_contact: float | None
    contact_iou: float | None
    centroid_error_mm: float | None
    total_error_percent: float | None
    rmse_under_counts: float | None
    rmse_near_counts: float | None
    rmse_beyond_counts: float | None
    rmse_grey: float | None = None
    psnr_db: float | None = None
    psnr_contact_db: float | None = None

    @property
    def counts(self) -> float:
        """RMSE of figures of counts."""
        assert self.rmse_counts is not None
        return self.rmse_counts


Intervals = dict[FigureName, Interval | None]
"""The interval of each overall figure, or None."""


@dataclass(frozen=True)
class ForceFigures:
    """Figures over the pairs of one force bin; see module array_errors.

    low_n, high_n: edges of the bin, N, equal for a single force; both 0 for presses without
    contact. mean_n: mean force, N. rmse_counts, with its interval over shapes; rmse_percent: in
    percent of full scale. of_mean_array: RMSE relative to that of the mean array of the bin;
    mean_of: whether that is the mean of training presses or, if these are too few, of the split's.
    Both are None without contact; phantom_counts is the mean of the summed predicted counts
    without contact, None otherwise.
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


@dataclass(frozen=True)
class UncertaintyMetrics:
    """Calibration and sharpness of a run's predicted uncertainty; see module array_errors.

    levels: nominal coverages of intervals; coverage: the observed ones. retained: shares of the
    presses, the most certain ones; retained_rmse_counts: RMSE over them. predicted_rmse_counts:
    RMSE according to the predicted standard deviations.
    force_median_error_percent, force_coverage_percent: for presses with contact, error relative to
    the true force, and coverage of the 90 % intervals; None for runs without force.
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
class MotionFigures:
    """Figures over still or moving pairs. coverage_percent: of the 90 %
    intervals of the counts, None without uncertainty."""

    pairs: int
    rmse_counts: float
    rmse_percent: float
    coverage_percent: float | None


@dataclass(frozen=True)
class ShearMetrics:
    """Errors of the predicted shear force on the gel camera.

    pairs: number of moving pairs with a true shear force above min_shear_n, N.
    direction_error_deg, magnitude_error_percent: medians over these pairs, the magnitude's relative
    to the true one; None without such pairs. coverage_percent: of the 90 % intervals of the
    components, over all moving pairs.
    """

    pairs: int
    min_shear_n: float
    direction_error_deg: float | None
    magnitude_error_percent: float | None
    coverage_percent: float


@dataclass(frozen=True)
class ContactMetrics:
    """Errors of the predicted contact in the camera's view; see module contact_errors.

    pairs: number of pairs with a contact in the view; each has the same weight. depth_rmse_mm,
    depth_mean_rmse_mm: median and mean of the RMSE of the depth in the true contact.
    deepest_error_percent, deepest_worst_percent: median and largest error of the largest depth,
    relative to it. iou: mean intersection over union of the masks. force_in_view_error_percent:
    median error of the integral of the pressure, relative to it. center_error_mm: median distance
    of the center of pressure, None if no contact was found. depth_coverage_percent,
    center_coverage_percent: of the 90 % intervals, in the true contact. missed_percent: share of
    the pairs in which no contact was found. false_percent: share of the pairs without force in
    which one was found; None without such pairs.
    """

    pairs: int
    depth_rmse_mm: float
    depth_mean_rmse_mm: float
    deepest_error_percent: float
    deepest_worst_percent: float
    iou: float
    force_in_view_error_percent: float
    center_error_mm: float | None
    depth_coverage_percent: float
    center_coverage_percent: float
    missed_percent: float
    false_percent: float | None


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
    interval: Intervals
    run: str | None = None
    weights_sha256: str | None = None
    same_data: bool | None = None
    trained_layout: str | None = None
    trained_data: str | None = None
    trained_recipe: str | None = None
    trained_pairs: int | None = None
    trained_steps: int | None = None
    by_force: tuple[ForceFigures, ...] = ()
    uncertainty: UncertaintyMetrics | None = None
    by_motion: dict[str, MotionFigures] | None = None
    shear: ShearMetrics | None = None
    contact: ContactMetrics | None = None


@dataclass(frozen=True)
class ViewSummary:
    """The camera's field of view, the layout's pitch, and the numbers of taxels "under" the view,
    "near" it, within one pitch, and "beyond"."""

    width_mm: float
    height_mm: float
    pitch_mm: float
    taxels: dict[str, int]


@dataclass(frozen=True)
class Bootstrap:
    """Settings of the bootstrap intervals: resampled unit, and numbers."""

    over: str
    shapes: int
    resamples: int
    seed: int
    confidence: float


@dataclass(frozen=True)
class Difference:
    """Difference of a figure between two models."""

    difference: float
    interval: Interval | None


@dataclass(frozen=True)
class Finding:
    """A finding of the paper as a question with an answer; undecided if the interval contains zero.

    figure: that decides it. figures: the two values of the difference, by model or by split. model,
    percent_of_mean_array (by split): only for the gap between splits.
    """

    question: str
    answer: Answer
    figure: FigureName
    difference: float
    interval: Interval | None
    figures: dict[str, float]
    model: str | None = None
    percent_of_mean_array: dict[str, float] | None = None


@dataclass(frozen=True)
class PaperRow:
    """A row of the paper's table, measured on real sensors."""

    rmse_counts: float
    rmse_percent: float
    ssim: float | None = None


@dataclass(frozen=True)
class Evaluation:
    """Result of `evaluate` on one split.

    pairs: number of pairs. contact_level: a pixel above this fraction of its image's maximum is in
    contact. info_sha256: of the dataset's info.json. layout: name of its taxel layout. models: rows
    by name. paired: touch2touch minus ResNet18, by figure. paper, findings: by name. recipe: of the
    dataset, None for imported pairs. background: source of the background frames of field runs, or
    of those that images are compared with, None without. source, target: names of the sensors, None
    in older files. pictures: of predicted images, which are compared; None for counts, whose full
    scale and layout are None otherwise. view: None without a camera as source.
    """

    format: int
    split: str
    pairs: int
    full_scale_counts: float | None
    contact_level: float
    info_sha256: str
    layout: str | None
    view: ViewSummary | None
    models: dict[str, ModelRow]
    bootstrap: Bootstrap
    paired: dict[str, Difference]
    paper: dict[str, PaperRow]
    findings: dict[str, Finding]
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
    def recipe_shown(self) -> str:
        """Name of the recipe, or first digits of the dataset's SHA-256."""
        return self.recipe or f"dataset {self.info_sha256[:8]}"

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
    write_json(folder / METRICS, as_json(evaluation))


def write_findings(
    folder: Path, evaluations: Mapping[str, Evaluation], gap: Mapping[str, Finding]
) -> None:
    """Writes folder/findings.json: the findings of each split by name, and the "gap".

    evaluations: by split.
    """
    findings = {split: evaluation.findings for split, evaluation in evaluations.items()}
    write_json(folder / FINDINGS, as_json(findings | {"gap": gap}))


def as_json(value: Any) -> Any:
    """A record, or a dict of them, as JSON content. Fields that are None by default are omitted."""
    if is_dataclass(value):
        return {
            field.name: as_json(getattr(value, field.name))
            for field in fields(value)
            if getattr(value, field.name) is not None or field.default is MISSING
        }
    if isinstance(value, Mapping):
        return {name: as_json(part) for name, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [as_json(part) for part in value]
    return value
