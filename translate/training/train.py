"""Training of a translator.

    t2twin train resnet18 --data data/small --preset cpu --out runs/resnet18
    torchrun --nproc-per-node 2 -m t2twin.translate.training.train resnet18 data/small cpu
    runs/resnet18

A stopped training resumes after its last complete epoch, with the result of an uninterrupted one:
order, dropout and augmentation of each epoch depend on (seed, epoch). The number of threads changes
the order of sums and thereby the last digits. The processes of torchrun share each batch, each on
its own GPU if the machine has GPUs.
"""

import sys
from contextlib import nullcontext
from os.path import lexists
from pathlib import Path

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import LOCK, is_empty, locked
from t2twin.translate.data.pairs import CACHE, Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.models import distributed
from t2twin.translate.models.presets import DIGIT_TO_CYSKIN, Preset, check_direction, find_preset
from t2twin.translate.runs.card import write_card
from t2twin.translate.runs.checkpoint import TRANSLATORS, has_bf16, load_history
from t2twin.translate.runs.config import CONFIG, LAST, RunConfig, load_config
from t2twin.translate.runs.log import EpochRecord
from t2twin.translate.training.early_stopping import TrainingResult, stop_reason, training_result
from t2twin.translate.training.settings import (
    after_warm_start,
    check_limits,
    check_processes,
    for_steps,
    with_iou_weight,
)
from t2twin.translate.training.trainer import Trainer
from t2twin.translate.training.warm_start import WarmStart, find_warm_start

MIN_PAIRS = 8
"""Minimum number of training pairs (assumed: batch norm needs several)."""


def train(
    model: str,
    data_dir: str | Path,
    preset: str | Preset,
    out_dir: str | Path,
    seed: int = 0,
    epochs: int | None = None,
    minutes: float | None = None,
    steps: int | None = None,
    init_from: str | Path | None = None,
    direction: str = DIGIT_TO_CYSKIN,
    iou_weight: float | None = None,
) -> TrainingResult:
    """Trains a translator on a dataset, or resumes a stopped training.

    model: "touch2touch", "resnet18" or "field". preset: a name (models.presets), or a Preset.
    out_dir: folder of the run. epochs: maximum epochs, by default the preset's. minutes: maximum
    minutes; the epochs, and with them the learning rate's schedule, are planned to fit. steps:
    maximum steps in place of the preset's, rounded to whole epochs; a larger number adapts the
    preset (settings.for_steps). init_from: another run, whose best weights are the initial weights,
    at a lower learning rate. direction: "digit-to-cyskin", or "cyskin-to-digit" for DIGIT images
    from counts, validated by the RMSE of their pixels. iou_weight: weight of the soft IoU loss
    (models.touch2touch), by default the preset's.
    Raises T2TwinError for arguments that are invalid or do not fit together, and an init_from of
    another kind. It also does for an unreadable dataset, a folder with another run, and a loss that
    is not finite.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    check_limits(epochs, minutes, steps, seed)
    settings = for_steps(find_preset(model, preset), steps)
    check_direction(direction, model)
    settings = with_iou_weight(settings, iou_weight, model, direction)
    info = load_info(data_dir)
    warm_start = None
    if init_from is not None:
        warm_start = find_warm_start(init_from, model, settings, info, direction)
        settings = after_warm_start(settings)
    config = RunConfig(
        model=model,
        preset=settings,
        seed=seed,
        data=info,
        epochs=epochs,
        minutes=minutes,
        steps=steps,
        planned_epochs=epochs or settings.epochs,
        bf16=settings.bf16 and has_bf16(),
        processes=distributed.process_count(),
        init_from=None if warm_start is None else warm_start.sha256,
        direction=direction,
    )
    return _run(config, data_dir, out_dir, warm_start)


def _run(
    config: RunConfig, data_dir: Path, out_dir: Path, warm_start: WarmStart | None
) -> TrainingResult:
    """Trains the run of a configuration, unless out_dir contains it finished."""
    distributed.use_all_cores()
    distributed.keep_memory()
    with distributed.processes() as rank:
        check_processes(config.preset, config.processes)
        config, history = _earlier_run(config, out_dir) or (config, [])
        reason = stop_reason(config, history)
        if reason is not None:
            result = training_result(out_dir, history, reason)
            if rank == 0:
                print(f"{out_dir} is finished: {result.summary}. Nothing to do.")
            return result
        with locked(out_dir) if rank == 0 else nullcontext():
            _check_folder(out_dir)
            pairs, validation = _load_in_turn(data_dir, out_dir, config, rank)
            result = Trainer(config, out_dir, pairs, validation, rank, warm_start).run()
            if rank == 0:
                write_card(out_dir, data_dir)
            return result


def _check_folder(out_dir: Path) -> None:
    """Raises T2TwinError for a folder with other files than a run's."""
    names = {path.name for path in out_dir.iterdir()} if out_dir.is_dir() else set()
    if CONFIG in names or names <= {LOCK, CACHE} or is_empty(out_dir):
        return
    raise T2TwinError(f"{out_dir} is not empty and contains no run; choose another folder")


def _load_in_turn(
    data_dir: Path, out_dir: Path, config: RunConfig, rank: int
) -> tuple[Pairs, Pairs]:
    """Training and validation pairs. The first process decodes them, the others wait for it."""
    cache = usable_cache(data_dir, out_dir)
    if rank == 0:
        _load(data_dir, config, cache)
    distributed.wait()
    return _load(data_dir, config, cache)


def _load(data_dir: Path, config: RunConfig, cache: Path) -> tuple[Pairs, Pairs]:
    preset, with_field = config.preset, TRANSLATORS[config.model].learns_field
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
    """The run in out_dir, if any. Raises T2TwinError if its configuration differs."""
    if not (out_dir / CONFIG).is_file():
        return None
    earlier = load_config(out_dir)
    for name, theirs, ours in (
        ("model", earlier.model, config.model),
        ("direction", earlier.direction, config.direction),
        ("IoU weight", earlier.preset.iou_weight, config.preset.iou_weight),
        ("preset", earlier.preset, config.preset),
        ("seed", earlier.seed, config.seed),
        ("dataset", earlier.data.sha256, config.data.sha256),
        ("number of epochs", earlier.epochs, config.epochs),
        ("number of steps", earlier.steps, config.steps),
        ("limit in minutes", earlier.minutes, config.minutes),
        ("number of processes", earlier.processes, config.processes),
        ("warm start", earlier.init_from, config.init_from),
    ):
        if theirs != ours:
            hidden = name in ("preset", "dataset", "warm start")
            value = "" if hidden else f" ({theirs})"
            raise T2TwinError(
                f"{out_dir} holds a run with another {name}{value}; give the same again, or "
                "another folder"
            )
    state = out_dir / LAST
    if not lexists(state):
        return None
    if not state.is_file():
        raise T2TwinError(f"{state} is not a file; remove {out_dir} to train again")
    return earlier, load_history(state)


if __name__ == "__main__":  # for torchrun, which starts a module
    try:
        train(sys.argv[1], Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))
    except T2TwinError as error:
        sys.exit(str(error))
