"""What an evaluation found, as records: metrics.json and findings.json, read and written here.

    DIR/metrics.json      what `evaluate` found on one split: an Evaluation
    DIR/findings.json     the findings of both splits, and the gap between the two

Attributes are named as the files' keys. RMSE is the root of the mean squared error of the counts,
over pairs and taxels: the square root of the loss that Grella et al. 2023 call L3.

Records as JSON has them.
"""

from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from t2twin.core.errors import T2TwinError
from t2twin.core.files import write_json
from t2twin.core.records import read_json

METRICS = "metrics.json"
FINDINGS = "findings.json"
FORMAT = 4
"""Version of what metrics.json holds."""

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
]
Answer = Literal["yes", "no", "undecided"]
MeanOf = Literal["training", "split"]


class Interval(NamedTuple):
    """From low to high; a list of the two in the file."""

    low: float
    high: float


@dataclass(frozen=True)
class Figures:
    """Figures over a number of pairs; None where no pair has the figure.

    rmse_counts: the RMSE; rmse_percent: its part of full scale. ssim: structural similarity of the
    predicted tactile image with the true one, over the image; ssim_contact: over the true contact.
    contact_iou: intersection over union of the two contacts. centroid_error_mm: distance between
    the two images' centroids. total_error_percent: mean error of the summed counts, of their mean.
    rmse_under_counts, rmse_near_counts, rmse_beyond_counts: the RMSE of the taxels under the
    DIGIT's view, within a pitch of it, and beyond.
    """

    pairs: int
    rmse_counts: float
    rmse_percent: float
    ssim: float
    ssim_contact: float | None
    contact_iou: float | None
    centroid_error_mm: float | None
    total_error_percent: float | None
    rmse_under_counts: float | None
    rmse_near_counts: float | None
    rmse_beyond_counts: float | None

    def value(self, name: FigureName) -> float | None:
        """A figure by its name, for tables."""
        return getattr(self, name)


@dataclass(frozen=True)
class Intervals:
    """The interval of each of the overall figures; None where there is none."""

    rmse_counts: Interval | None
    rmse_percent: Interval | None
    ssim: Interval | None
    ssim_contact: Interval | None
    contact_iou: Interval | None
    centroid_error_mm: Interval | None
    total_error_percent: Interval | None
    rmse_under_counts: Interval | None
    rmse_near_counts: Interval | None
    rmse_beyond_counts: Interval | None

    def value(self, name: FigureName) -> Interval | None:
        """A figure's interval by its name, for tables."""
        return getattr(self, name)


@dataclass(frozen=True)
class ForceFigures:
    """Figures over the pairs of about one force; module forces says how they are put together.

    low_n, high_n: edges of the forces, N, the same where it is one force; both 0 of presses that
    touch nothing. mean_n: mean force, N. rmse_counts, with its interval over shapes; rmse_percent:
    its part of full scale. of_mean_array: the RMSE in parts of what the mean array of that force
    comes to; mean_of: whether that is the mean of the training presses or, of too few, of the
    split's own. Both None where nothing is touched: there phantom_counts is the mean of the summed
    predicted counts, else None.
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
    """How sure a run is, and how right it is in that (module certainty).

    levels: shares of the counts that its intervals are said to hold; held: those that they do.
    kept: shares of the presses, the surest; kept_rmse_counts: the RMSE over them. said_rmse_counts:
    what the RMSE over all would be if its standard deviations were right.
    force_median_error_percent, force_held_percent: of the presses that touch, in parts of the true
    force, and how many the 90 % interval holds; None of a run that tells no force.
    """

    levels: tuple[float, ...]
    held: tuple[float, ...]
    kept: tuple[float, ...]
    kept_rmse_counts: tuple[float, ...]
    said_rmse_counts: float
    force_median_error_percent: float | None
    force_held_percent: float | None

    def held_at(self, level: float) -> float:
        """What the intervals of one of the levels hold."""
        return self.held[self.levels.index(level)]

    def falls_by(self, kept: float) -> float:
        """The part by which the RMSE is lower where one of the shares is kept."""
        whole = self.kept_rmse_counts[self.kept.index(1.0)]
        return 1.0 - self.kept_rmse_counts[self.kept.index(kept)] / whole if whole else 0.0


@dataclass(frozen=True)
class ModelRow:
    """One row of the results: a trained run, a trivial predictor, or a floor.

    by_shape, by_family: figures by the names of shapes and of families; by_shape is empty where
    there are more than rows.MAX_SHAPES. interval: of the overall figures. by_force: by rising
    force; empty where no force is known, and in files of older versions. The rest is None where the
    row is no run. run: its folder as it was given. weights_sha256: of its best.safetensors.
    same_data: whether it was trained on the dataset that it is evaluated on. trained_layout: the
    taxel layout that it was trained on. trained_data: the SHA-256 of that dataset's info.json;
    trained_world: what made it, trained_pairs: how many pairs it has to train on, trained_steps:
    how many steps were taken, each None where it is not known. certainty: of a run that says how
    sure it is.
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
    trained_world: str | None = None
    trained_pairs: int | None = None
    trained_steps: int | None = None
    by_force: tuple[ForceFigures, ...] = ()
    certainty: UncertaintyMetrics | None = None


@dataclass(frozen=True)
class TaxelCounts:
    """How many taxels lie under the DIGIT's view, within a pitch of it, and beyond."""

    under: int
    near: int
    beyond: int


@dataclass(frozen=True)
class ViewSummary:
    """The rectangle that the DIGIT sees, the layout's pitch, and the taxels about it."""

    width_mm: float
    height_mm: float
    pitch_mm: float
    taxels: TaxelCounts


@dataclass(frozen=True)
class Bootstrap:
    """How the intervals are made: what is resampled, and how many of it there are."""

    over: str
    shapes: int
    resamples: int
    seed: int
    confidence: float


@dataclass(frozen=True)
class Difference:
    """One model's figure less another's."""

    difference: float
    interval: Interval | None


@dataclass(frozen=True)
class Finding:
    """A question of the paper's, answered: undecided where the interval holds zero.

    figure: what it is read from. figures: the two values of which the difference is taken, by
    model or by split. model, percent_of_mean_array (by split): of the gap between splits alone.
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
class AlikePairs:
    """Pairs of presses that look alike: median distance of the pictures, difference of the counts.

    rmse_counts: the root of half the mean squared difference. Both None of no pairs.
    """

    pairs: int
    distance_grey: float | None
    rmse_counts: float | None


@dataclass(frozen=True)
class ShapeFloor:
    """What one shape's look-alikes say."""

    nearest: AlikePairs
    extrapolated_rmse_counts: float | None


@dataclass(frozen=True)
class IrreducibleErrorFloor:
    """What the look-alikes in one place say; module lookalikes says how.

    nearest: each press and its nearest. close: those of them within the noise. curve: groups of
    all neighbors by distance. extrapolated_rmse_counts, with its interval over shapes: the
    difference read at the noise's distance; parts: the same of each group of taxels.
    """

    nearest: AlikePairs
    close: AlikePairs
    curve: tuple[AlikePairs, ...]
    extrapolated_rmse_counts: float | None
    interval: Interval | None
    parts: dict[str, float | None]
    by_shape: dict[str, ShapeFloor]


@dataclass(frozen=True)
class IrreducibleError:
    """Presses that look alike, among other shapes of the split and among training pairs.

    noise_grey: distance of two pictures of one press. close_grey: below it two pictures count as
    nearly the same. split, training: None where there are no neighbors.
    """

    noise_grey: float
    close_grey: float
    split: IrreducibleErrorFloor | None
    training: IrreducibleErrorFloor | None


@dataclass(frozen=True)
class PaperRow:
    """A row of the paper's table, measured on hardware."""

    rmse_counts: float
    rmse_percent: float
    ssim: float | None = None

    def value(self, name: FigureName) -> float | None:
        """A figure by its name, None where the paper does not give it."""
        return getattr(self, name, None)


@dataclass(frozen=True)
class Evaluation:
    """What `evaluate` found on one split.

    pairs: how many. contact_level: a pixel is in contact above this part of its image's maximum.
    info_sha256: of the dataset's info.json. layout: its taxel layout's name. models: the rows by
    name. paired: touch2touch less ResNet18, by figure. lookalikes: None for the training split,
    and for a dataset that does not name its pictures' noise. paper, findings: by name. world: what
    made the dataset (data.origin), None of imported pairs. background: the source of the DIGIT's
    background frames that field runs were given, None where there was none.
    """

    format: int
    split: str
    pairs: int
    full_scale_counts: float
    contact_level: float
    info_sha256: str
    layout: str
    view: ViewSummary
    models: dict[str, ModelRow]
    bootstrap: Bootstrap
    paired: dict[str, Difference]
    lookalikes: IrreducibleError | None
    paper: dict[str, PaperRow]
    findings: dict[str, Finding]
    world: str | None = None
    background: str | None = None

    @property
    def has_forces(self) -> bool:
        """Whether its pairs are of several forces."""
        return any(len(row.by_force) > 1 for row in self.models.values())

    @property
    def world_shown(self) -> str:
        """The world's name, or the first digits of the dataset's where it has none."""
        return self.world or f"data set {self.info_sha256[:8]}"

    @property
    def runs(self) -> dict[str, ModelRow]:
        """The rows that are trained runs, in the order in which they were given."""
        return {name: row for name, row in self.models.items() if row.run is not None}


def read_evaluation(folder: Path) -> Evaluation:
    """The evaluation of one split in a folder.

    Raises T2TwinError where there is none, where another version of t2twin wrote it, and where
    metrics.json is damaged.
    """
    path = folder / METRICS
    if not path.is_file():
        raise T2TwinError(f"{folder} holds no evaluation (no {METRICS}); make one with `evaluate`")
    return read_json(path, Evaluation, FORMAT)


def write_evaluation(folder: Path, evaluation: Evaluation) -> None:
    """Writes folder/metrics.json, whole or not at all."""
    write_json(folder / METRICS, as_json(evaluation))


def write_findings(
    folder: Path, evaluations: Mapping[str, Evaluation], gap: Mapping[str, Finding]
) -> None:
    """Writes folder/findings.json: each split's findings by name, and "gap" between the two.

    evaluations: by split.
    """
    findings = {split: evaluation.findings for split, evaluation in evaluations.items()}
    write_json(folder / FINDINGS, as_json(findings | {"gap": gap}))


def as_json(value: Any) -> Any:
    """A record, or a dict of them, in dicts, lists and numbers, as its file holds it.

    A field that may be left out, its default being None, is left out where it is None.
    """
    if is_dataclass(value):
        content = {field.name: getattr(value, field.name) for field in fields(value)}
        optional = {field.name for field in fields(value) if field.default is not MISSING}
        return {
            name: as_json(part)
            for name, part in content.items()
            if not (part is None and name in optional)
        }
    if isinstance(value, Mapping):
        return {name: as_json(part) for name, part in value.items()}
    if isinstance(value, (tuple, list)):
        return [as_json(part) for part in value]
    return value
