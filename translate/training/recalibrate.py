"""Recalibrates the predicted uncertainty of a field run on validation presses of several datasets.

Training calibrates on the validation presses of its own dataset, which may have one family of
shapes only, such as primitives. Intervals of other presses then have too low a coverage. Here each
dataset has the same number of validation presses. Test presses are not used.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.files import locked
from t2twin.sim.dataset.columns import IMAGE
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.networks.field_net import side_of_maps
from t2twin.translate.runs.card import write_card
from t2twin.translate.runs.checkpoint import build, load_weights, save_weights
from t2twin.translate.runs.config import BEST, load_config
from t2twin.translate.training.fit_frame_check import complete

SEED = 0
"""Seed of the selection of presses from larger validation splits."""


def recalibrate(run_dir: str | Path, data_dirs: Sequence[str | Path]) -> int:
    """Fits the calibration of a field run again; writes its best weights and its card.

    data_dirs: datasets with dense counts, of any recipe, including the run's own. Each contributes
    as many validation presses as the smallest has. Returns the total number of presses. Of a run
    whose contact alone was trained, the contact alone is calibrated.
    Raises T2TwinError for a run of another model, a dataset without dense counts or validation
    pairs, and if the run's own dataset is missing.
    """
    run_dir, folders = Path(run_dir), [Path(folder) for folder in data_dirs]
    config = load_config(run_dir)
    trained_on = config.contact_data or config.data.sha256
    own = [folder for folder in folders if load_info(folder).sha256 == trained_on]
    if not own:
        raise T2TwinError(
            f"the dataset that {run_dir} was trained on is missing; give it with the others"
        )
    translator = build(config)
    if not isinstance(translator, FieldTranslator):
        raise T2TwinError(
            f"{run_dir} is a {config.model} run, which predicts no uncertainty; expected a field "
            "run"
        )
    with locked(run_dir):
        load_weights(run_dir / BEST, translator.predictor)
        sets = [
            load_pairs(
                each,
                "val",
                config.preset.size,
                False,
                usable_cache(each, run_dir),
                True,
                read_info(each).source.value != IMAGE,
                side_of_maps(config.preset.size) if config.data.has_contact else None,
            )
            for each in folders
        ]
        samples = _equal_samples(sets)
        translator.calibrate(*samples)
        save_weights(run_dir / BEST, translator.predictor)
        complete(run_dir, own[0])
        write_card(run_dir, own[0])
    return sum(map(len, samples))


def _equal_samples(sets: Sequence[Pairs]) -> list[Pairs]:
    number = min(len(pairs) for pairs in sets)
    rng = np.random.default_rng(SEED)
    return [pairs.subset(np.sort(rng.choice(len(pairs), number, replace=False))) for pairs in sets]
