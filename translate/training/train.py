"""Training, one loop for all translators.

    t2twin train resnet18 --data data/small --preset cpu --out runs/resnet18
    torchrun --nproc-per-node 2 -m t2twin.translate.training.train resnet18 data/small cpu
    runs/resnet18

A run that was stopped goes on from its last whole epoch, and ends as if it had not been stopped:
each epoch's order, dropout and augmentation are drawn from (seed, epoch). Another number of
threads adds in another order, so it changes the last digits. The processes of torchrun share each
batch, each on a GPU of its own where the machine has GPUs.
"""

import math
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.core.files import LOCK, is_empty, locked
from t2twin.translate.data.pairs import CACHE, Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.models import distributed
from t2twin.translate.models.presets import (
    DIGIT_TO_CYSKIN,
    TURNS_ROUND,
    Preset,
    check_direction,
    find_preset,
)
from t2twin.translate.runs.build import TRANSLATORS, has_bf16
from t2twin.translate.runs.card import write_card
from t2twin.translate.runs.checkpoint import load_history
from t2twin.translate.runs.config import CONFIG, LAST, MAX_STEPS, RunConfig, load_config
from t2twin.translate.runs.log import EpochRecord
from t2twin.translate.training.early_stopping import TrainingResult, outcome_of, stop_reason
from t2twin.translate.training.trainer import Trainer
from t2twin.translate.training.warm_start import find_start, slower

MIN_PAIRS = 8
"""Pairs that a training asks for (assumed: below this batch norm has nothing to average)."""


def train(
    model: str,
    data_dir: str | Path,
    preset: str | Preset,
    out_dir: str | Path,
    seed: int = 0,
    epochs: int | None = None,
    minutes: float | None = None,
    steps: int | None = None,
    start: str | Path | None = None,
    direction: str = DIGIT_TO_CYSKIN,
    shape_weight: float | None = None,
) -> TrainingResult:
    """Trains a translator on DIR's train split, watching its val split, into the folder out_dir.

    model: "touch2touch", "resnet18" or "field". preset: a name of t2twin.translate.models.presets,
    or a Preset. epochs: most epochs; by default the preset's, and no more than its steps make.
    minutes:
    most minutes; as many epochs are planned as fit in, and the schedule of the learning rate
    follows the plan. steps: most steps, instead of the preset's steps and epochs, rounded to whole
    epochs. An epoch goes through all pairs; of so many that the steps would make few epochs,
    through a part of them, and the next goes on where it ended (loop.steps_of_epoch). For steps
    beyond its own a preset is changed by `for_steps`. start: another run, whose best weights this
    one begins with, and with a lower learning rate (t2twin.translate.training.warm_start).
    direction: "digit-to-cyskin", or "cyskin-to-digit", touch2touch turned round: from counts to
    pictures, validated by the RMSE of their pixels. shape_weight: weight of the loss of shape
    (t2twin.translate.models.soft_iou_loss), the preset's unless given; of touch2touch from DIGIT to
    CySkin only.
    Raises T2TwinError for an unknown model, preset or direction, a weight that is negative or has
    nothing to weigh, a data set that cannot be read, a folder that holds another run, a start that
    is not of this kind, and a loss that stops being a number.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    _check_limits(epochs, minutes, steps, seed)
    settings = for_steps(find_preset(model, preset), steps)
    check_direction(direction, model)
    settings = _with_shape(settings, shape_weight, model, direction)
    info = load_info(data_dir)
    begun = None if start is None else find_start(start, model, settings, info, direction)
    settings = settings if begun is None else slower(settings)
    distributed.use_all_cores()
    distributed.keep_memory()
    with distributed.processes() as (rank, processes):
        _check_shares(settings, processes)
        asked = RunConfig(
            model=model,
            preset=settings,
            seed=seed,
            data=info,
            epochs=epochs,
            minutes=minutes,
            steps=steps,
            planned_epochs=epochs or settings.epochs,
            bf16=settings.bf16 and has_bf16(),
            processes=processes,
            start=None if begun is None else begun.sha256,
            direction=direction,
        )
        config, history = _earlier_run(asked, out_dir) or (asked, [])
        reason = stop_reason(config, history)
        if reason is not None:
            outcome = outcome_of(out_dir, history, reason)
            if rank == 0:
                print(f"{out_dir} is finished: {outcome.in_words()}. Nothing to do.")
            return outcome
        with locked(out_dir) if rank == 0 else nullcontext():
            _check_own(out_dir)
            learns_field = TRANSLATORS[model].learns_field
            pairs, validation = _load_in_turn(data_dir, out_dir, settings, learns_field, rank)
            outcome = Trainer(config, out_dir, pairs, validation, rank, begun).run()
            if rank == 0:
                write_card(out_dir, data_dir)
            return outcome


def for_steps(preset: Preset, steps: int | None) -> Preset:
    """The preset for a training of so many steps, None for its own.

    In more steps than its own a discriminator learns as much in all as in those: at its own rate it
    won in the second half of three times the steps, and L1 and validation grew worse again.
    """
    if preset.l1_weight == 0.0 or not preset.steps or steps is None or steps <= preset.steps:
        return preset
    share = preset.discriminator_share * preset.steps / steps
    return replace(preset, discriminator_share=share)


def _with_shape(preset: Preset, weight: float | None, model: str, direction: str) -> Preset:
    """The preset with that weight of the loss of shape, None for its own."""
    weight = preset.shape_weight if weight is None else arguments.real(weight, "shape_weight")
    if not (weight >= 0 and math.isfinite(weight)):
        raise T2TwinError(f"the shape weight is {weight:g}; it must be 0 or more")
    if weight and not (model == TURNS_ROUND and direction == DIGIT_TO_CYSKIN):
        raise T2TwinError(
            f"the shape weight is {weight:g} and a {model} {direction} draws no tactile image; "
            f"give it to {TURNS_ROUND} {DIGIT_TO_CYSKIN}, or leave it out"
        )
    return replace(preset, shape_weight=weight)


def _check_own(out_dir: Path) -> None:
    """Raises T2TwinError for a folder that holds other things than a run."""
    there = {path.name for path in out_dir.iterdir()} if out_dir.is_dir() else set()
    if CONFIG in there or there <= {LOCK, CACHE} or is_empty(out_dir):
        return
    raise T2TwinError(f"{out_dir} is not empty and holds no run; choose another folder")


def _check_limits(epochs: int | None, minutes: float | None, steps: int | None, seed: int) -> None:
    for name, value in (("steps", steps), ("epochs", epochs)):
        if value is not None:
            arguments.whole_number(value, name)
    if minutes is not None:
        minutes = arguments.real(minutes, "minutes")
    if steps is not None and not 1 <= steps <= MAX_STEPS:
        raise T2TwinError(f"steps is {steps}; it must be from 1 to {MAX_STEPS:,}")
    if steps is not None and epochs is not None:
        raise T2TwinError("epochs and steps are both given; one of them bounds a training")
    if epochs is not None and epochs < 1:
        raise T2TwinError(f"epochs is {epochs}; it must be at least 1")
    if minutes is not None and not (minutes > 0 and math.isfinite(minutes)):
        raise T2TwinError(f"minutes is {minutes:g}; it must be more than 0")
    check_seed(seed)


def _check_shares(preset: Preset, processes: int) -> None:
    if preset.batch % processes:
        raise T2TwinError(
            f"a batch of {preset.batch} cannot be shared by {processes} processes; their number "
            "must divide it"
        )


def _load_in_turn(
    data_dir: Path, out_dir: Path, preset: Preset, with_field: bool, rank: int
) -> tuple[Pairs, Pairs]:
    """Both splits: the first process decodes them, the others read what it wrote."""
    cache = usable_cache(data_dir, out_dir)
    if rank == 0:
        _load_both(data_dir, preset, with_field, cache)
    distributed.wait()
    return _load_both(data_dir, preset, with_field, cache)


def _load_both(
    data_dir: Path, preset: Preset, with_field: bool, cache: Path
) -> tuple[Pairs, Pairs]:
    pairs, validation = (
        load_pairs(data_dir, split, preset.size, preset.grey, cache, with_field)
        for split in ("train", "val")
    )
    if len(pairs) < MIN_PAIRS:
        raise T2TwinError(
            f"the train split of {data_dir} has {len(pairs)} pair(s); training needs {MIN_PAIRS}"
        )
    return pairs, validation


def _earlier_run(config: RunConfig, out_dir: Path) -> tuple[RunConfig, list[EpochRecord]] | None:
    """The run that out_dir holds already, if any. Raises T2TwinError where it is another one."""
    if not (out_dir / CONFIG).is_file():
        return None
    earlier = load_config(out_dir)
    for what, was, asked in (
        ("model", earlier.model, config.model),
        ("direction", earlier.direction, config.direction),
        ("shape weight", earlier.preset.shape_weight, config.preset.shape_weight),
        ("preset", earlier.preset, config.preset),
        ("seed", earlier.seed, config.seed),
        ("data set", earlier.data.sha256, config.data.sha256),
        ("number of epochs", earlier.epochs, config.epochs),
        ("number of steps", earlier.steps, config.steps),
        ("limit in minutes", earlier.minutes, config.minutes),
        ("number of processes", earlier.processes, config.processes),
        ("start", earlier.start, config.start),
    ):
        if was != asked:
            named = "" if isinstance(was, Preset) or what in ("data set", "start") else f" ({was})"
            raise T2TwinError(
                f"{out_dir} holds a run with another {what}{named}; give the same again, or "
                "another folder"
            )
    if not (out_dir / LAST).is_file():
        return None
    return earlier, load_history(out_dir / LAST)


if __name__ == "__main__":  # for torchrun, which starts a module
    try:
        train(sys.argv[1], Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))
    except T2TwinError as error:
        sys.exit(str(error))
