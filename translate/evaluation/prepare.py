"""The inputs of an evaluation: runs, a dataset and background frames, checked before it starts."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import DataInfo, load_info
from t2twin.translate.evaluation.background import Background, background_of
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import CountsPredictor

VAL, TEST = "val", "test"
SPLITS = (VAL, TEST)


@dataclass(frozen=True)
class EvaluationInputs:
    """What an evaluation reads.

    trained: runs by name, at their own layouts. applied: the same at the dataset's layout.
    background: None if no run uses background frames or none are known.
    """

    data_dir: Path
    dataset: DatasetInfo
    info: DataInfo
    trained: dict[str, CountsPredictor]
    applied: dict[str, CountsPredictor]
    background: Background | None


def prepare(
    runs: Sequence[str | Path],
    data_dir: Path,
    splits: Sequence[str],
    background: str | Path | None = None,
) -> EvaluationInputs:
    """Loads and checks the inputs of an evaluation. Arguments, errors: as for `evaluate`."""
    if not arguments.paths(runs, "runs"):
        raise T2TwinError("there is no run to evaluate; give at least one folder of `train`")
    dataset = read_info(data_dir)
    for split in (*splits, "train"):
        if split in dataset.pairs and not dataset.pairs[split]:
            raise T2TwinError(
                f"{data_dir} has no {split} pairs; an evaluation needs some, and train pairs for "
                "the baselines"
            )
    info = load_info(data_dir)
    loaded = [load_run(run) for run in runs]
    trained = dict(zip(run_names(loaded), loaded, strict=True))
    applied = {
        name: run.at_layout(info.x_mm, info.y_mm, info.layout, info.pad_diameter_mm)
        for name, run in trained.items()
    }
    has_field = any(isinstance(run, FieldPredictor) for run in loaded)
    if background is not None and not has_field:
        raise T2TwinError(
            f"{background} is a background frame, which only field runs use; none of the runs is "
            "one"
        )
    frames = background_of(data_dir, background) if has_field else None
    return EvaluationInputs(data_dir, dataset, info, trained, applied, frames)


def run_names(runs: Sequence[CountsPredictor]) -> list[str]:
    """Names of runs: their models, with the folder for runs of the same model.

    Raises T2TwinError for a run that occurs twice.
    """
    folders = [run.run_dir.resolve() for run in runs]
    twice = [
        run.run_dir for run, folder in zip(runs, folders, strict=True) if folders.count(folder) > 1
    ]
    if twice:
        raise T2TwinError(f"{twice[0]} is named twice; name each run once")
    models = [run.config.model for run in runs]
    names = [
        model if models.count(model) == 1 else f"{model} ({run.run_dir.name})"
        for model, run in zip(models, runs, strict=True)
    ]
    if len(set(names)) < len(names):
        return [f"{run.config.model} ({run.run_dir})" for run in runs]
    return names


def splits_with_pairs(data_dir: Path) -> tuple[str, ...]:
    """Those of validation and test that have pairs.

    Raises T2TwinError if neither has, and if there is no dataset.
    """
    pairs = read_info(data_dir).pairs
    splits = tuple(split for split in SPLITS if pairs[split])
    if not splits:
        raise T2TwinError(
            f"{data_dir} has neither validation nor test pairs; an evaluation needs one of them"
        )
    return splits
