"""Training of a translator.

    torchrun --nproc-per-node 2 -m t2twin.translate.training.train resnet18 data/small cpu
    runs/resnet18

A stopped training resumes with the result of an uninterrupted one: order, dropout and augmentation
of each step depend on (seed, epoch, step). The number of threads changes the last digits.
"""

import shutil
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.core.files import LOCK, is_empty, locked
from t2twin.sim.dataset.columns import IMAGE
from t2twin.sim.dataset.info import COUNTS
from t2twin.sim.dataset.store import read_info, sha256_of
from t2twin.translate.data.pairs import CACHE, DataInfo, Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.models import distributed
from t2twin.translate.models.presets import (
    GENERATES,
    MAX_EPOCHS,
    SOURCE_TO_TARGET,
    Model,
    Preset,
    check_direction,
    find_model,
    find_preset,
    is_reverse,
)
from t2twin.translate.networks.field_net import side_of_maps
from t2twin.translate.runs.card import CARD, write_card
from t2twin.translate.runs.checkpoint import (
    build,
    has_bf16,
    load_history,
    load_weights,
    save_weights,
)
from t2twin.translate.runs.config import (
    BEST,
    CONFIG,
    FRAME_CHECK,
    LAST,
    MAX_STEPS,
    RunConfig,
    load_config,
    resolve_run,
)
from t2twin.translate.runs.log import EpochRecord
from t2twin.translate.training.frame_check import fit_frame_check
from t2twin.translate.training.trainer import Trainer, TrainingResult, stop_reason, training_result

MIN_PAIRS = 8  # Minimum number of training pairs (assumed: batch norm needs several)
# Learning rate after a warm start, divided by the preset's (assumed): a trained translator needs a
# tenth of the steps of a new one
WARM_START_SHARE = 0.3


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
    direction: str = SOURCE_TO_TARGET,
    iou_weight: float | None = None,
    contact_alone: bool = False,
    frame_check: bool = True,
) -> TrainingResult:
    """Trains a translator on a dataset, or resumes a stopped training.

    model: "touch2touch", "resnet18" or "field". preset: a name (models.presets), or a Preset.
    out_dir: folder of the run. epochs, minutes, steps: maxima in place of the preset's; more steps
    adapt the preset (`for_steps`). init_from: another run, whose best weights are the initial
    weights, at a lower learning rate. direction: "source-to-target" of the dataset, or
    "target-to-source"; for a gel camera and a taxel array also "image-to-counts" and
    "counts-to-image". iou_weight: of the soft IoU loss (models.touch2touch). contact_alone: train
    only the contact's layers of a field run, on those of init_from. frame_check: whether a field
    run gets one. Raises T2TwinError for arguments that do not fit together, an unreadable dataset,
    a folder with another run, and a loss that is not finite.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    _check_limits(epochs, minutes, steps, seed)
    name, settings = find_model(model), for_steps(find_preset(model, preset), steps)
    reverse = is_reverse(direction, **read_info(data_dir).values)
    info = load_info(data_dir, reverse)
    check_direction(info.direction, name)
    if isinstance(preset, str) and info.source.value == info.target.value == IMAGE:
        settings = replace(settings, grey=False)
    settings = _with_iou_weight(settings, iou_weight, name, info)
    weights = None
    if init_from is not None:
        weights = find_weights(init_from, model, settings, info)
        settings = replace(settings, learning_rate=WARM_START_SHARE * settings.learning_rate)
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
        init_from=None if weights is None else sha256_of(weights),
    )
    config = structs.replace(config, **_kept(contact_alone, model, init_from, info))
    return _run(config, data_dir, out_dir, weights, reverse, frame_check)


def _kept(
    contact_alone: bool, model: str, run: str | Path | None, info: DataInfo
) -> dict[str, Any]:
    """The fields of the configuration that a training of the contact alone takes from its run."""
    if not arguments.flag(contact_alone, "contact_alone"):
        return {}
    if model != "field" or run is None:
        raise T2TwinError(
            "the contact alone is trained on the layers of a field run; expected the model field, "
            "with --init-from"
        )
    if not info.has_contact:
        raise T2TwinError(
            "the pairs have no contact maps; make a dataset whose recipe has contact_maps = true, "
            "such as `t2twin simdata --recipe contact`"
        )
    theirs = load_config(resolve_run(run))
    return {
        "data": structs.replace(theirs.data, has_contact=True),
        "ood_detector": theirs.ood_detector,
        "contact_data": info.sha256,
    }


def _run(
    config: RunConfig, data_dir: Path, out_dir: Path, weights: Path | None, reverse: bool,
    frame_check: bool,
) -> TrainingResult:  # fmt: skip
    """Trains the run of a configuration, unless out_dir contains it finished."""
    distributed.use_all_cores()
    with distributed.processes() as rank:
        if config.preset.batch % config.processes:
            raise T2TwinError(
                f"a batch of {config.preset.batch} cannot be shared by {config.processes} "
                "processes; their number must divide it"
            )
        config, history = _earlier_run(config, out_dir) or (config, [])
        reason = stop_reason(config, history)
        if reason is not None:
            result = training_result(out_dir, history, reason)
            if rank == 0:
                _complete(config, out_dir, data_dir, weights, frame_check)
                print(f"{out_dir} is finished: {result.summary}. Nothing to do.")
            return result
        with locked(out_dir) if rank == 0 else nullcontext():
            _check_folder(out_dir)
            pairs, validation = _load_in_turn(data_dir, out_dir, config, rank, reverse)
            result = Trainer(config, out_dir, pairs, validation, rank, weights).run()
            if rank == 0:
                write_card(out_dir, data_dir)
                _complete(config, out_dir, data_dir, weights, frame_check)
            return result


def _complete(
    config: RunConfig, out_dir: Path, data_dir: Path, weights: Path | None, frame_check: bool
) -> None:
    """Gives a finished run what it lacks: its card, and a field run its frame check."""
    if not (out_dir / CARD).is_file():
        write_card(out_dir, data_dir)
    if not frame_check:
        return
    if config.contact_data is None:
        fit_frame_check(out_dir, data_dir)
    elif weights is not None and (weights.parent / FRAME_CHECK).is_file():
        shutil.copyfile(weights.parent / FRAME_CHECK, out_dir / FRAME_CHECK)


def _check_folder(out_dir: Path) -> None:
    """Raises T2TwinError for a folder with other files than a run's."""
    names = {path.name for path in out_dir.iterdir()} if out_dir.is_dir() else set()
    if CONFIG in names or names <= {LOCK, CACHE} or is_empty(out_dir):
        return
    raise T2TwinError(f"{out_dir} is not empty and contains no run; choose another folder")


def _load_in_turn(
    data_dir: Path, out_dir: Path, config: RunConfig, rank: int, reverse: bool
) -> list[Pairs]:
    """Training and validation pairs; the first process decodes them, while the others wait."""
    cache = usable_cache(data_dir, out_dir)
    if rank > 0:
        distributed.wait()
    found = [_load(data_dir, split, config, cache, reverse) for split in ("train", "val")]
    if rank == 0:
        distributed.wait()
    if len(found[0]) < MIN_PAIRS:
        raise T2TwinError(
            f"the train split of {data_dir} has {len(found[0])} pair(s); training needs {MIN_PAIRS}"
        )
    return found


def _load(data_dir: Path, split: str, config: RunConfig, cache: Path, reverse: bool) -> Pairs:
    preset, dense = config.preset, config.has_uncertainty
    side = side_of_maps(preset.size) if dense and config.data.has_contact else None
    return load_pairs(data_dir, split, preset.size, preset.grey, cache, dense, reverse, side)


def _earlier_run(config: RunConfig, out_dir: Path) -> tuple[RunConfig, list[EpochRecord]] | None:
    """The run in out_dir, if any. Raises T2TwinError if its configuration differs."""
    if not (out_dir / CONFIG).is_file():
        return None
    earlier = load_config(out_dir)
    theirs, ours = _given(earlier), _given(config)
    others = [name for name, value in ours.items() if theirs[name] != value]
    if others:
        raise T2TwinError(
            f"{out_dir} holds a run with another {', '.join(others)}; give the same again, or "
            "another folder"
        )
    state = out_dir / LAST
    return (earlier, load_history(state)) if state.is_file() else None


def _given(config: RunConfig) -> dict[str, Any]:
    """What a resumed training has in common with the stopped one, by its names in messages."""
    return {
        "model": config.model,
        "direction": config.direction,
        "source": config.data.source.name,
        "preset": config.preset,
        "seed": config.seed,
        "dataset": (config.data.sha256, config.contact_data),
        "number of epochs": config.epochs,
        "number of steps": config.steps,
        "limit in minutes": config.minutes,
        "number of processes": config.processes,
        "warm start": config.init_from,
    }


def _check_limits(epochs: int | None, minutes: float | None, steps: int | None, seed: int) -> None:
    """Raises T2TwinError for limits and seeds out of range, and for epochs with steps."""
    for name, value, most in (("steps", steps, MAX_STEPS), ("epochs", epochs, MAX_EPOCHS)):
        if value is not None:
            arguments.whole_number(value, name, 1, most)
    if steps is not None and epochs is not None:
        raise T2TwinError("epochs and steps are both given; expected at most one of them")
    if minutes is not None and arguments.number(minutes, "minutes") <= 0:
        raise T2TwinError(f"minutes is {minutes:g}; it must be more than 0")
    check_seed(seed)


def for_steps(preset: Preset, steps: int | None) -> Preset:
    """The preset for a number of steps, None for its own.

    The more steps, the slower the discriminator learns: otherwise it dominates in the second half.
    """
    if preset.l1_weight == 0.0 or not preset.steps or steps is None or steps <= preset.steps:
        return preset
    return replace(preset, discriminator_share=preset.discriminator_share * preset.steps / steps)


def _with_iou_weight(preset: Preset, weight: float | None, model: Model, info: DataInfo) -> Preset:
    """The preset with a weight of the soft IoU loss, None for its own."""
    weight = arguments.number(preset.iou_weight if weight is None else weight, "iou_weight", 0.0)
    if weight and not (model == GENERATES and info.target.value == COUNTS):
        raise T2TwinError(
            f"iou_weight is {weight:g}, but a {model} {info.direction} run predicts no tactile "
            f"image; expected 0, or {GENERATES} to counts"
        )
    return replace(preset, iou_weight=weight)


def find_weights(run: str | Path, model: str, preset: Preset, data: DataInfo) -> Path:
    """The best weights of a run, as initial ones of a training; T2TwinError if they do not fit."""
    run_dir, config = run_of_model(run, model)
    theirs, own = config.preset, config.data
    sides = ((own.source, data.source), (own.target, data.target))
    for name, one, other in (
        ("direction", own.direction, data.direction),
        ("image size", theirs.size, preset.size),
        ("color", theirs.grey, preset.grey),
        ("base width", theirs.filters, preset.filters),
    ):
        if one != other:
            raise T2TwinError(
                f"{run_dir} has the {name} {one}, and the new run has {other}; expected equal ones"
            )
    if not all(one.fits(other) for one, other in sides):
        raise T2TwinError(f"{run_dir} is a run of another layout than the dataset's")
    if model == "field" and not own.array.same_dense(data.array):
        raise T2TwinError(f"{run_dir} is a run of other dense counts than the dataset's")
    weights = run_dir / BEST
    if not weights.is_file():
        raise T2TwinError(f"{weights} does not exist; the run has not finished its first epoch")
    return weights


def run_of_model(run: str | Path, model: str) -> tuple[Path, RunConfig]:
    """The folder and configuration of a run; T2TwinError for a run of another model."""
    run_dir = resolve_run(run)
    config = load_config(run_dir)
    if config.model != model:
        raise T2TwinError(
            f"{run_dir} is a {config.model} run, and the new run is a {model}; expected a run like "
            "the new one"
        )
    return run_dir, config


def recalibrate(run_dir: str | Path, data_dirs: Sequence[str | Path]) -> int:
    """Fits the calibration of a field run again; writes its best weights and its card.

    data_dirs: datasets with dense counts, of any recipe, including the run's own. Each contributes
    as many validation presses as the smallest has. Returns the total number of presses. Of a run
    whose contact alone was trained, the contact alone is calibrated.
    """
    run_dir, folders = Path(run_dir), [Path(folder) for folder in data_dirs]
    config = load_config(run_dir)
    trained_on = config.contact_data or config.data.sha256
    own = [folder for folder in folders if load_info(folder).sha256 == trained_on]
    if not own:
        raise T2TwinError(
            f"the dataset that {run_dir} was trained on is missing; give it with the others"
        )
    config.need(config.has_uncertainty, run_dir, "the calibration of uncertainty", "a field run")
    translator = build(config)
    with locked(run_dir):
        load_weights(run_dir / BEST, translator.predictor)
        sets = []
        for folder in folders:
            reverse = read_info(folder).source.value != IMAGE
            cache = usable_cache(folder, run_dir)
            sets.append(_load(folder, "val", config, cache, reverse))
        number, rng = min(map(len, sets)), np.random.default_rng(0)
        samples = [
            pairs.subset(np.sort(rng.choice(len(pairs), number, replace=False))) for pairs in sets
        ]
        translator.calibrate(*samples)
        save_weights(run_dir / BEST, translator.predictor)
        fit_frame_check(run_dir, own[0])
        write_card(run_dir, own[0])
    return sum(map(len, samples))


if __name__ == "__main__":  # for torchrun, which starts a module
    try:
        train(sys.argv[1], Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))
    except T2TwinError as error:
        sys.exit(str(error))
