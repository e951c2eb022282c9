"""Warm start: the initial weights of a training are the best weights of another run.

With another DIGIT, another force or fewer pairs, a trained translator needs a tenth of the steps of
a new one.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.models.base import Translator
from t2twin.translate.models.layouts import same_layout
from t2twin.translate.models.presets import DIGIT_TO_CYSKIN, Preset
from t2twin.translate.networks.field_net import SHEAR
from t2twin.translate.runs.checkpoint import load_weights
from t2twin.translate.runs.config import BEST, RunConfig, load_config, resolve_run


@dataclass(frozen=True)
class WarmStart:
    """The best weights of another run. sha256: of their file."""

    weights: Path
    sha256: str


def find_warm_start(
    run: str | Path, model: str, preset: Preset, data: DataInfo, direction: str = DIGIT_TO_CYSKIN
) -> WarmStart:
    """The best weights of a run, for a training with this model, preset and dataset.

    run: its folder, or the name of a pretrained run. Raises T2TwinError for a folder that is not a
    run, and for a run of another model, direction, image size, width, layout or field.
    """
    run_dir, config = run_of_model(run, model)
    theirs, places = config.preset, config.data
    for difference, differs in (
        (f"a {config.direction} run, not {direction}", config.direction != direction),
        (
            f"a run of {theirs.size} pixels, base width {theirs.filters}, and preset {preset.name} "
            f"has {preset.size} and {preset.filters}",
            (theirs.size, theirs.grey, theirs.filters)
            != (preset.size, preset.grey, preset.filters),
        ),
        (
            f"a run of layout {places.layout}, and the dataset's is {data.layout}",
            not same_layout(places, data.x_mm, data.y_mm),
        ),
        (
            "a run of another field than the dataset's",
            model == "field"
            and not (
                _equal(places.field_x_mm, data.field_x_mm)
                and _equal(places.field_y_mm, data.field_y_mm)
            ),
        ),
    ):
        if differs:
            raise T2TwinError(f"{run_dir} is {difference}; expected a run like the new one")
    weights = run_dir / BEST
    if not weights.is_file():
        raise T2TwinError(f"{weights} does not exist; the run has not finished its first epoch")
    return WarmStart(weights, sha256_of(weights))


def run_of_model(run: str | Path, model: str) -> tuple[Path, RunConfig]:
    """The folder and configuration of a run. run: as for `find_warm_start`.

    Raises T2TwinError for a folder that is not a run, and for a run of another model.
    """
    run_dir = resolve_run(run)
    config = load_config(run_dir)
    if config.model != model:
        raise T2TwinError(
            f"{run_dir} is a {config.model} run, and the new run is a {model}; expected a run like "
            "the new one"
        )
    return run_dir, config


def apply_warm_start(start: WarmStart, translator: Translator) -> None:
    """Loads the weights; those of the shear only if both networks predict it.

    Raises T2TwinError for a file with the weights of another network.
    """
    load_weights(start.weights, translator.predictor, optional=(SHEAR,))
    trained = next(iter(translator.networks.values()))
    if trained is not translator.predictor:  # the predictor is its weight average
        trained.load_state_dict(translator.predictor.state_dict())


def _equal(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    return one is not None and other is not None and np.array_equal(one, other)
