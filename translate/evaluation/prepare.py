"""The inputs of an evaluation: runs, a dataset and background frames, checked before it starts.

Shape letters: S image side.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import read_info, sha256_of
from t2twin.sim.digit.calibration import DEFAULT_PATH
from t2twin.sim.digit.optics import DigitOptics
from t2twin.translate.data.images import open_image, to_pixels
from t2twin.translate.data.pairs import DataInfo, has_backgrounds, load_info
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import CountsPredictor, FieldPredictor

VAL, TEST = "val", "test"
SPLITS = (VAL, TEST)

OF_PAIRS, OF_CALIBRATION = "each pair's own", "that of the default calibration"
"""Sources of frames that are not files."""


@dataclass(frozen=True)
class FixedBackground:
    """One background frame for all pairs: frame, (S, S, 3) uint8."""

    frame: np.ndarray

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(S, S, 3) uint8, for any choice of pairs."""
        return self.frame


@dataclass(frozen=True)
class Background:
    """Background frames of a dataset.

    source: in words. image: one frame for all pairs, or None if each pair has its own.
    """

    source: str
    image: Image.Image | None

    def at_size(self, size: int) -> FixedBackground | None:
        """The frame at size x size, or None if each pair has its own."""
        if self.image is None:
            return None
        return FixedBackground(to_pixels(self.image, size, grey=False))


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


def background_of(data_dir: Path, file: str | Path | None = None) -> Background | None:
    """The background frames of a dataset, None if none are known.

    They are those of the pairs, if the pairs have them. Otherwise they are `file`, an image of the
    DIGIT without contact, or the frame of the default calibration, if all images were made with it.
    Raises T2TwinError for a file that is not an image, and for one with pairs that have their own.
    """
    info = read_info(data_dir)
    if has_backgrounds(info):
        if file is not None:
            raise T2TwinError(
                f"the pairs in {data_dir} contain their own background frames; --background is for "
                "datasets without them"
            )
        return Background(OF_PAIRS, None)
    if file is not None:
        return Background(str(file), open_image(arguments.path(file, "background")))
    if is_of_default_calibration(info):
        return Background(OF_CALIBRATION, Image.fromarray(DigitOptics.load().background))
    return None


def is_of_default_calibration(info: DatasetInfo) -> bool:
    """Whether all images of a dataset were made with the default calibration."""
    if info.parameters is None or not (info.world is None or info.world.light.kind == "fixed"):
        return False
    return info.parameters.digit.calibration_sha256 == sha256_of(DEFAULT_PATH)


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
