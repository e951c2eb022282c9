"""A field run's standard deviations put right anew, on validation presses of several worlds.

A training does it on the validation presses of its own world, which may be of one kin only: those
of `union` are primitives. Of other presses intervals then hold less than they say. Here each
world's validation has the same say. Test presses are never looked at.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.files import locked
from t2twin.translate.data.pairs import Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.runs.build import build
from t2twin.translate.runs.card import write_card
from t2twin.translate.runs.checkpoint import load_weights, save_weights
from t2twin.translate.runs.config import BEST, load_config

SEED = 0
"""Of which presses of a larger validation are taken."""


def temper(run_dir: str | Path, data_dirs: Sequence[str | Path]) -> int:
    """Fits what makes a field run's spreads standard deviations, and how its errors go together,
    anew (module calibrated); they are kept with its best weights, and its card is written again.

    data_dirs: datasets whose pairs hold the field, of any world, the run's own among them. Of each
    as many validation presses are taken as the smallest has. Returns how many these are in all.
    Raises T2TwinError for a run of another translator, a dataset without a field or validation
    pairs, and where the run's own dataset is not given.
    """
    run_dir, folders = Path(run_dir), [Path(folder) for folder in data_dirs]
    config = load_config(run_dir)
    own = [folder for folder in folders if load_info(folder).sha256 == config.data.sha256]
    if not own:
        raise T2TwinError(
            f"the dataset that {run_dir} was trained on is not given; give it beside the others"
        )
    translator = build(config)
    if not isinstance(translator, FieldTranslator):
        raise T2TwinError(
            f"{run_dir} is a {config.model} run, which has no standard deviations; a field run has"
        )
    with locked(run_dir):
        load_weights(run_dir / BEST, translator.predictor)
        sets = [
            load_pairs(each, "val", config.preset.size, False, usable_cache(each, run_dir), True)
            for each in folders
        ]
        taken = _as_many_of_each(sets)
        translator.calibrate(*taken)
        save_weights(run_dir / BEST, translator.predictor)
        write_card(run_dir, own[0])
    return sum(map(len, taken))


def _as_many_of_each(sets: Sequence[Pairs]) -> list[Pairs]:
    fewest = min(len(pairs) for pairs in sets)
    rng = np.random.default_rng(SEED)
    return [pairs.some(np.sort(rng.choice(len(pairs), fewest, replace=False))) for pairs in sets]
