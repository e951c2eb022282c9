"""Results of an evaluation as records. Keys of their file metrics.json are their attributes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from t2twin.core.errors import T2TwinError
from t2twin.core.records import FORMAT, read_json

METRICS = "metrics.json"

# Metrics by name; docs/reference/metrics.md defines them. Unknown ones are missing
Figures = dict[str, int | float]
Interval = tuple[float, float]


@dataclass(frozen=True)
class ForceFigures:
    """Figures over the pairs of one range of forces."""

    low_n: float  # edges of the range, equal for a single force; both 0 without contact
    high_n: float
    mean_n: float
    pairs: int
    rmse_counts: float
    rmse_percent: float
    interval: Interval | None  # of rmse_counts, over shapes
    of_mean_array: float | None  # RMSE relative to that of the range's mean array
    mean_of: Literal["training", "split"] | None  # whose mean: the split's if training has too few
    phantom_counts: float | None  # mean of the summed predicted counts, without contact only

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
    """Calibration and sharpness of a run's predicted uncertainty; see module metrics."""

    figures: Figures
    levels: tuple[float, ...]  # nominal coverages of intervals
    coverage: tuple[float, ...]  # observed ones
    retained: tuple[float, ...]  # shares of the presses, the most certain ones
    retained_rmse_counts: tuple[float, ...]  # RMSE over them


@dataclass(frozen=True)
class ModelRow:
    """One row of the results: a trained run, a trivial predictor, or a floor.

    What follows `run` is unknown, or None for rows that are not runs.
    """

    overall: Figures
    interval: dict[str, Interval | None]  # of the overall figures
    by_family: dict[str, Figures]
    by_shape: dict[str, Figures] = field(default_factory=dict)  # none above evaluate.MAX_SHAPES
    by_force: tuple[ForceFigures, ...] = ()  # in ascending order; empty if no force is known
    by_motion: dict[str, Figures] | None = None  # "still" and "moving" pairs, if any move
    run: str | None = None  # its name, or its folder as given
    weights_sha256: str | None = None  # of its best.safetensors
    same_data: bool | None = None  # whether it was trained on the dataset of the evaluation
    trained_layout: str | None = None  # of its training dataset
    trained_data: str | None = None  # SHA-256 of its info.json
    trained_recipe: str | None = None
    trained_pairs: int | None = None
    trained_steps: int | None = None
    uncertainty: Uncertainty | None = None
    shear: Figures | None = None
    contact: Figures | None = None


@dataclass(frozen=True)
class Evaluation:
    """Result of `evaluate` on one split. Full scale and layout are None for images."""

    split: str
    pairs: int
    contact_level: float  # a pixel above this fraction of its image's maximum is in contact
    info_sha256: str  # of the dataset's info.json
    models: dict[str, ModelRow]
    shapes: int  # number of shapes, which the bootstrap resamples
    paired: dict[str, Figures]  # touch2touch minus ResNet18: difference, low and high, by figure
    paper: dict[str, Figures]  # figures of the paper's models, on hardware
    full_scale_counts: float | None = None
    layout: str | None = None
    view: Figures | None = None  # of the camera; its size, the pitch, taxels by TAXEL_GROUPS
    recipe: str | None = None  # of the dataset, None for imported pairs
    background: str | None = None  # source of the background frames
    source: str | None = None
    target: str | None = None
    pictures: str | None = None  # what predicted images are compared as; None for counts
    format: str = FORMAT

    @property
    def runs(self) -> dict[str, ModelRow]:
        """The rows of trained runs, in the order of the arguments."""
        return {name: row for name, row in self.models.items() if row.run is not None}


def read_evaluation(folder: Path) -> Evaluation:
    """The evaluation of one split in a folder; an error if it is missing, damaged or older."""
    path = folder / METRICS
    if not path.is_file():
        raise T2TwinError(
            f"{folder} contains no evaluation (no {METRICS}); make one with `t2twin evaluate`"
        )
    return read_json(path, Evaluation, "`t2twin evaluate`")
