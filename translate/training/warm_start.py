"""What a training begins with: fresh weights, or those of another run.

Who has another DIGIT, another force or fewer pairs need not begin anew: a translator that knows one
world learns its neighbor's in a tenth of the steps.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.data.pairs import DataInfo
from t2twin.translate.models.base import Translator
from t2twin.translate.models.layouts import same_layout
from t2twin.translate.models.presets import DIGIT_TO_CYSKIN, Preset
from t2twin.translate.runs.checkpoint import load_weights
from t2twin.translate.runs.config import BEST, RunConfig, load_config
from t2twin.translate.runs.pretrained import resolve_run

RATE_SHARE = 0.3
"""Learning rate in parts of the preset's, where a training begins with another run's weights
(assumed)."""


@dataclass(frozen=True)
class WarmStart:
    """Another run's best weights. sha256: of their file."""

    weights: Path
    sha256: str


def find_start(
    run: str | Path, model: str, preset: Preset, data: DataInfo, direction: str = DIGIT_TO_CYSKIN
) -> WarmStart:
    """The best weights of a run, for a training of this model, preset and data set.

    run: its folder, or the name of a run that ships.
    Raises T2TwinError for a folder that holds no run, and for a run of another direction, model,
    image size, width, layout or field.
    """
    run_dir, config = run_of_model(run, model)
    there, places = config.preset, config.data
    for what, differs in (
        (f"a {config.direction} run, and not {direction}", config.direction != direction),
        (
            f"a run of {there.size} pixels, base width {there.filters}, and preset {preset.name} "
            f"has {preset.size} and {preset.filters}",
            (there.size, there.grey, there.filters) != (preset.size, preset.grey, preset.filters),
        ),
        (
            f"a run of layout {places.layout}, and the data set's is {data.layout}",
            not same_layout(places, data.x_mm, data.y_mm),
        ),
        (
            "a run of another field than the data set's",
            model == "field"
            and not (
                _same(places.field_x_mm, data.field_x_mm)
                and _same(places.field_y_mm, data.field_y_mm)
            ),
        ),
    ):
        if differs:
            raise T2TwinError(f"{run_dir} is {what}; start with a run like the one asked for")
    weights = run_dir / BEST
    if not weights.is_file():
        raise T2TwinError(f"{weights} is not there; the run has not finished its first epoch")
    return WarmStart(weights, sha256_of(weights))


def run_of_model(run: str | Path, model: str) -> tuple[Path, RunConfig]:
    """A run's folder and config. run: as for `find_start`. Raises T2TwinError for a folder that
    holds no run, and for a run of another model."""
    run_dir = resolve_run(run)
    config = load_config(run_dir)
    if config.model != model:
        raise T2TwinError(
            f"{run_dir} is a {config.model} run, and a {model} is to be trained; start with a run "
            "like the one asked for"
        )
    return run_dir, config


def slower(preset: Preset) -> Preset:
    """The preset for weights that know something already."""
    return replace(preset, learning_rate=RATE_SHARE * preset.learning_rate)


def begin_with(start: WarmStart, translator: Translator) -> None:
    """Puts the weights in. Raises T2TwinError for a file that holds other ones."""
    load_weights(start.weights, translator.predictor)
    learns = next(iter(translator.networks.values()))
    if learns is not translator.predictor:  # that is its running mean
        learns.load_state_dict(translator.predictor.state_dict())


def _same(one: np.ndarray | None, other: np.ndarray | None) -> bool:
    return one is not None and other is not None and np.array_equal(one, other)
