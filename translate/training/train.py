"""Training of a translator: its loop, its batches, when it ends, and its result.

    torchrun --nproc-per-node 2 -m t2twin.translate.training.train resnet18 data/small cpu
    runs/resnet18

A stopped training resumes with the result of an uninterrupted one: order, dropout and augmentation
of each step depend on (seed, epoch, step). The number of threads changes the last digits.
"""

import math
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cache
from itertools import islice
from operator import attrgetter
from os.path import lexists
from pathlib import Path
from typing import cast

import numpy as np
import torch
from msgspec import structs

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError, counted, warn
from t2twin.core.files import LOCK, is_empty, locked, sha256_of
from t2twin.core.progress import Progress
from t2twin.sim.dataset.info import COUNTS, IMAGE
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import CACHE, DataInfo, Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.inference.estimate import DIFFERENCES
from t2twin.translate.inference.load import load_run
from t2twin.translate.models import distributed, presets
from t2twin.translate.models.base import Translator
from t2twin.translate.models.field_net import CONTACT, SHEAR, side_of_maps
from t2twin.translate.models.presets import Model, Preset
from t2twin.translate.runs import checkpoint
from t2twin.translate.runs.card import CARD, write_card
from t2twin.translate.runs.config import (
    BEST,
    CONFIG,
    FRAME_CHECK,
    LAST,
    LOG,
    MAX_STEPS,
    TENSORBOARD,
    EpochPart,
    EpochRecord,
    RunConfig,
    TrainingState,
    best_epoch,
    load_config,
    resolve_run,
    write_log,
)
from t2twin.translate.training.fit_frame_check import fit_frame_check
from t2twin.translate.uncertainty.calibration import MIN_ERRORS
from t2twin.translate.uncertainty.ood import fit_ood_detector

MIN_PAIRS = 8  # Minimum number of training pairs (assumed: batch norm needs several)
# Learning rate after a warm start, divided by the preset's (assumed): a trained translator needs a
# tenth of the steps of a new one
WARM_START_SHARE = 0.3
VALIDATION_BATCH = {"cpu": 64, "cuda": 256}  # Pairs, by the type of the device; bounds memory
# Minimum number of epochs that a preset's steps are divided into (assumed: those of ResNet18 on
# the paper's dataset): learning rates and the choice of the best weights depend on epochs
MIN_EPOCHS = 12
MIN_STEPS = 100  # Of a shortened epoch (assumed: with fewer, validation takes longer)
SAVE_SECONDS = 600.0  # Between two states within an epoch (assumed: one takes a few to write)
# What a resumed training has in common with the stopped one: fields by their names in messages
GIVEN = {
    "model": "model", "direction": "direction", "source": "data.source.name", "preset": "preset",
    "seed": "seed", "dataset": "data.sha256", "dataset of the contact": "contact_data",
    "number of epochs": "epochs", "number of steps": "steps", "limit in minutes": "minutes",
    "number of processes": "processes", "warm start": "init_from",
}  # fmt: skip
DIFFERING_QUANTILES = (0.01, 0.99)  # Of validation contacts, the ends of a range (assumed)
TIMED_STEPS = 3  # Steps of the time estimate, after one that is not counted
warn_once = cache(warn)  # an adaptation finds its initial weights twice


@dataclass(frozen=True)
class TrainingResult:
    """Result of a finished training."""

    run_dir: Path
    epochs: int
    best_epoch: int
    best_rmse_counts: float | None  # on the validation split; None of a run that predicts images
    best_rmse_percent: float  # of full scale
    stop_reason: str
    best_rmse_grey: float | None = None  # grey levels, of a run that predicts images

    @property
    def summary(self) -> str:
        """The result as one clause."""
        grey = self.best_rmse_grey
        rmse = f"{self.best_rmse_counts:.0f} counts" if grey is None else f"{grey:.1f} grey levels"
        return (
            f"{self.stop_reason}; the best of {counted(self.epochs, 'epoch')} is "
            f"{self.best_epoch}, with a validation RMSE of {rmse} ({self.best_rmse_percent:.2f} %)"
        )


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
    direction: str = presets.SOURCE_TO_TARGET,
    iou_weight: float | None = None,
    contact_alone: bool = False,
    frame_check: bool = True,
) -> TrainingResult:
    """Trains a translator on the dataset in data_dir, or resumes a stopped training.

    model: "touch2touch", "resnet18" or "field". preset: a name (models.presets), or a Preset.
    out_dir: of the run. seed: of sampling. epochs, minutes, steps: maxima in place of the preset's;
    more steps adapt the preset (`for_steps`). init_from: another run, whose best weights are the
    initial weights, at a lower learning rate. direction: "source-to-target" of the dataset, or
    "target-to-source"; for a gel camera and a taxel array also "image-to-counts" and
    "counts-to-image". iou_weight: of the soft IoU loss (models.touch2touch). contact_alone: train
    only the contact's layers of a field run, on those of init_from. frame_check: whether a field
    run gets one. Raises T2TwinError for arguments that do not fit together, an unreadable dataset,
    a folder with another run, and a loss that is not finite.
    """
    data_dir, out_dir = arguments.path(data_dir, "data_dir"), arguments.path(out_dir, "out_dir")
    for name, value, most in (("steps", steps, MAX_STEPS), ("epochs", epochs, presets.MAX_EPOCHS)):
        if value is not None:
            arguments.whole_number(value, name, 1, most)
    if steps is not None and epochs is not None:
        raise T2TwinError("epochs and steps are both given; expected at most one of them")
    if minutes is not None and arguments.number(minutes, "minutes") <= 0:
        raise T2TwinError(f"minutes is {minutes:g}; it must be more than 0")
    check_seed(seed)
    frame_check = arguments.flag(frame_check, "frame_check")
    settings, name = for_steps(presets.find_preset(model, preset), steps), cast(Model, model)
    reverse = presets.is_reverse(direction, **read_info(data_dir).values)
    info = load_info(data_dir, reverse)
    presets.check_direction(info.direction, name)
    if isinstance(preset, str) and info.source.value == info.target.value == IMAGE:
        settings = replace(settings, grey=False)
    settings = _with_iou_weight(settings, iou_weight, name, info)
    weights = None
    if init_from is not None:
        weights = find_weights(init_from, model, settings, info)
        settings = replace(settings, learning_rate=WARM_START_SHARE * settings.learning_rate)
    config = RunConfig(
        name, settings, seed, info, epochs, minutes, epochs or settings.epochs,
        bf16=settings.bf16 and checkpoint.has_bf16(),
        processes=distributed.process_count(),
        steps=steps,
        init_from=None if weights is None else sha256_of(weights),
    )  # fmt: skip
    if arguments.flag(contact_alone, "contact_alone"):
        config = _of_contact_alone(config, weights)
    return _run(config, data_dir, out_dir, weights, reverse, frame_check)


def _of_contact_alone(config: RunConfig, weights: Path | None) -> RunConfig:
    """The configuration of a training of the contact alone, with the data of the initial run."""
    if config.model != "field" or weights is None:
        raise T2TwinError(
            "the contact alone is trained on the layers of a field run; expected the model field, "
            "with --init-from"
        )
    if not config.data.has_contact:
        raise T2TwinError(
            "the pairs have no contact maps; make a dataset whose recipe has contact_maps = true, "
            "such as `t2twin simdata --recipe contact`"
        )
    theirs = load_config(weights.parent)
    return structs.replace(
        config,
        data=structs.replace(theirs.data, has_contact=True),
        ood_detector=theirs.ood_detector,
        contact_data=config.data.sha256,
    )


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
        finished = stop_reason(config, history)
        if finished is None:
            with locked(out_dir) if rank == 0 else nullcontext():
                names = {path.name for path in out_dir.iterdir()} if out_dir.is_dir() else set()
                if not (CONFIG in names or names <= {LOCK, CACHE} or is_empty(out_dir)):
                    raise T2TwinError(f"{out_dir} contains no run; choose another folder")
                if rank > 0:  # while the first process decodes the images
                    distributed.wait()
                pairs, validation = (
                    _load(data_dir, split, config, out_dir, reverse) for split in ("train", "val")
                )
                if rank == 0:
                    distributed.wait()
                if len(pairs) < MIN_PAIRS:
                    found = counted(len(pairs), "training pair")
                    raise T2TwinError(f"{data_dir} has {found}; training needs {MIN_PAIRS}")
                trainer = Trainer(config, out_dir, pairs, validation, rank, weights)
                config, history = trainer.run()
        best = best_epoch(history)
        result = TrainingResult(
            out_dir, len(history), best.epoch, best.val_rmse_counts, best.val_rmse_percent,
            stop_reason(config, history) or "", best.val_rmse_grey,
        )  # fmt: skip
        if rank > 0:
            return result
        # What a finished run may lack after a kill
        if finished is None or not (out_dir / CARD).is_file():
            if config.has_uncertainty and config.data.has_contact:
                fit_agreement(out_dir, _load(data_dir, "val", config, out_dir, reverse))
            write_card(out_dir, data_dir)
        if frame_check and config.contact_data is None:
            fit_frame_check(out_dir, data_dir)
        elif frame_check and weights is not None and (weights.parent / FRAME_CHECK).is_file():
            shutil.copyfile(weights.parent / FRAME_CHECK, out_dir / FRAME_CHECK)
        state, rest = ("", "") if finished is None else (" is finished", " Nothing to do.")
        print(f"{out_dir}{state}: {result.summary}.{rest}")
        return result


def _load(data_dir: Path, split: str, config: RunConfig, run_dir: Path, reverse: bool) -> Pairs:
    """The pairs of a split, with what the model learns."""
    preset, dense = config.preset, config.has_uncertainty
    cache = usable_cache(data_dir, run_dir)
    side = side_of_maps(preset.size) if dense and config.data.has_contact else None
    return load_pairs(data_dir, split, preset.size, preset.grey, cache, dense, reverse, side)


def _earlier_run(config: RunConfig, out_dir: Path) -> tuple[RunConfig, list[EpochRecord]] | None:
    """The run in out_dir, if any. Raises T2TwinError if its configuration differs."""
    if not (out_dir / CONFIG).is_file():
        return None
    earlier = load_config(out_dir)
    fields = {name: attrgetter(field) for name, field in GIVEN.items()}
    others = [name for name, field in fields.items() if field(earlier) != field(config)]
    if others:
        raise T2TwinError(
            f"{out_dir} holds a run with another {', '.join(others)}; give the same again, or "
            "another folder"
        )
    state = out_dir / LAST
    if state.is_file():
        return earlier, checkpoint.load_progress(state).history
    if lexists(state) or (out_dir / LOG).exists():  # best weights alone may be of a killed process
        raise T2TwinError(
            f"{state} is missing or no file, so that the training cannot continue; choose another "
            "folder, or remove this one to train again"
        )
    return None


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
    if weight and not (model == presets.GENERATES and info.target.value == COUNTS):
        raise T2TwinError(
            f"iou_weight is {weight:g}, but a {model} {info.direction} run predicts no tactile "
            f"image; expected 0, or {presets.GENERATES} to counts"
        )
    return replace(preset, iou_weight=weight)


def find_weights(run: str | Path, model: str, preset: Preset, data: DataInfo) -> Path:
    """The best weights of a run, as initial ones of a training; T2TwinError if they do not fit, and
    a warning if they are of another sensor."""
    run_dir = resolve_run(run)
    config = load_config(run_dir)
    if config.model != model:
        raise T2TwinError(f"{run_dir} is a {config.model} run; expected a {model} run")
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
    is_dense = model != "field" or own.array.dense == data.array.dense
    if not (is_dense and all(one.fits(other) for one, other in sides)):
        raise T2TwinError(f"{run_dir} is a run of another layout or other dense counts than these")
    for one, other in sides:
        if found := one.differences(other):
            words = f"{one.words}, and the new run of {other.words}"
            warn_once(f"{run_dir} is a run of {words}, another sensor ({', '.join(found)})")
    weights = run_dir / BEST
    if not weights.is_file():
        raise T2TwinError(f"{weights} does not exist; the run has not finished its first epoch")
    return weights


def stop_reason(config: RunConfig, history: list[EpochRecord]) -> str | None:
    """Why a run with this history is finished, or None."""
    if not history:
        return None
    if len(history) >= config.planned_epochs:
        return "all its epochs are done"
    if len(history) - best_epoch(history).epoch >= config.preset.patience:
        return f"{counted(config.preset.patience, 'epoch')} brought no better validation"
    seconds = sum(record.seconds for record in history)
    if config.minutes is not None and seconds >= 60 * config.minutes:
        return f"its {config.minutes:g} minutes are over"
    return None


class Trainer:
    """The training of one run, in one of its processes. weights: initial ones, None for random."""

    def __init__(
        self, config: RunConfig, out_dir: Path, pairs: Pairs, validation: Pairs, rank: int,
        weights: Path | None = None,
    ) -> None:  # fmt: skip
        self.config, self.out_dir, self.rank, self.weights = config, out_dir, rank, weights
        self.pairs, self.validation = pairs, validation
        most = min(config.preset.batch, len(pairs))
        self.batch = most - most % config.processes
        self.batches = len(pairs) // self.batch  # no smaller last batch: bad for batch norm
        self.steps = config.epoch_steps or steps_of_epoch(self.batches, config.budget)
        self.history: list[EpochRecord] = []
        self.part = EpochPart()

    def run(self) -> tuple[RunConfig, list[EpochRecord]]:
        """Trains until the run is finished; starts from the saved state if there is one."""
        state, config, epoch_seconds = self.out_dir / LAST, self.config, self._measure()
        resumed = state.is_file()
        if not resumed:
            planned, detector = config.planned_epochs, config.ood_detector
            if config.steps is not None:
                planned = round(config.steps / self.steps)
            elif config.epochs is None and config.preset.steps:
                planned = min(planned, round(config.preset.steps / self.steps))
            if config.minutes is not None and config.preset.schedule != presets.FIXED:
                planned = min(planned, int(config.minutes * 60 / epoch_seconds))
            # Layers on another run's have the statistics of that run's images.
            if config.contact_data is None and self.pairs.pictures is None:
                detector = fit_ood_detector(self.pairs.images)
            self.config = structs.replace(
                config,
                planned_epochs=min(max(1, planned), presets.MAX_EPOCHS),
                epoch_steps=self.steps,
                ood_detector=detector,
            )
        self.translator = checkpoint.build(self.config)
        if self.weights is not None:
            load_initial_weights(self.weights, self.translator)
        if resumed:
            progress = checkpoint.load_state(state, self.translator)
            self.history, self.part = progress.history, progress.part
        else:
            self.translator.prepare(self.pairs)
            if self.rank == 0:
                self.config.save(self.out_dir)
        if self.rank == 0:
            self._announce(epoch_seconds)
        self._train()
        return self.config, self.history

    def _train(self) -> None:
        done = len(self.history) * self.steps + self.part.steps
        total, board = self.config.planned_epochs * self.steps, None
        if self.rank == 0:
            from torch.utils.tensorboard import SummaryWriter

            # Entries of an interrupted epoch are overwritten.
            board = SummaryWriter(str(self.out_dir / TENSORBOARD), purge_step=len(self.history) + 1)
        with Progress(
            total=total, initial=done, desc=self.config.model, unit="step",
            disable=self.rank > 0, mininterval=0.5,
        ) as bar:  # fmt: skip
            while stop_reason(self.config, self.history) is None:
                record = self._epoch(len(self.history), bar)
                self.history.append(record)
                self.part = EpochPart()
                best, depth_mm = best_epoch(self.history), record.val_contact_error_mm
                minutes = sum(each.seconds for each in self.history) / 60
                bar.print_line(
                    f"epoch {record.epoch:,} of {self.config.planned_epochs:,}, {minutes:.1f} "
                    f"minutes, validation RMSE {record.val_rmse_percent:.2f} %, best "
                    f"{best.val_rmse_percent:.2f} % in epoch {best.epoch:,}"
                    + ("" if depth_mm is None else f", depth {depth_mm:.4f} mm")
                )
                if board is not None:
                    # The best weights first: if killed in between, the epoch is repeated.
                    if best is record:
                        self.translator.in_float32().calibrate(self.validation)
                        checkpoint.save_weights(
                            self.out_dir / BEST, self.translator.predictor.state_dict()
                        )
                    state = TrainingState(self.history, self.part)
                    checkpoint.save_state(self.out_dir / LAST, self.translator, state)
                    write_log(self.out_dir, self.history)
                    for name, value in record.numbers.items():
                        board.add_scalar(name, value, record.epoch)
                    board.flush()
                distributed.wait()
        if board is not None:
            board.close()

    def _epoch(self, epoch: int, bar: Progress) -> EpochRecord:
        """Trains for the rest of an epoch and validates. Returns the record of the epoch."""
        started = time.perf_counter() - self.part.seconds
        config, translator = self.config, self.translator
        share = 1.0
        if config.preset.schedule != presets.FIXED:  # half a cosine to zero
            share = 0.5 * (1.0 + math.cos(math.pi * epoch / config.planned_epochs))
        for optimizer in translator.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = share * optimizer.defaults["lr"]
        for network in translator.networks.values():
            network.train()
        sums: dict[str, float | torch.Tensor] = dict(self.part.losses)
        saved, first = time.perf_counter(), self.part.steps
        for step, batch in enumerate(islice(self._batches(epoch), first, None), first):
            rng = np.random.default_rng([config.seed, epoch, step, 1 + self.rank])
            torch.manual_seed(int(rng.integers(2**63)))  # dropout
            mine = batch[self.rank :: config.processes]
            losses = translator.step(translator.examples(self.pairs, mine, rng))
            for name, loss in losses.items():
                sums[name] = sums.get(name, 0.0) + loss.double()  # does not wait for a GPU
            bar.update()
            now = time.perf_counter()
            if config.processes == 1 and now - saved >= SAVE_SECONDS and step + 1 < self.steps:
                part = EpochPart(step + 1, _numbers(sums), now - started)
                checkpoint.save_state(
                    self.out_dir / LAST, translator, TrainingState(self.history, part)
                )
                saved = now
        for network in dict.fromkeys((*translator.networks.values(), translator.predictor)):
            distributed.average([each for each in network.buffers() if each.is_floating_point()])
        rmse, exact, losses = self._validate(), translator.in_float32(), _numbers(sums)
        if not all(map(math.isfinite, (rmse, *losses.values()))):
            raise T2TwinError(
                f"the loss is not finite in epoch {epoch + 1}; train again with a preset of a "
                "lower learning rate"
            )
        further = exact.further_errors(self.validation)
        return EpochRecord(
            epoch=epoch + 1,
            learning_rate=share * config.preset.learning_rate,
            train={name: total / self.steps for name, total in losses.items()},
            val_rmse_counts=None if config.predicts_images else rmse,
            val_rmse_percent=100.0 * rmse / config.data.target.full_scale,
            seconds=distributed.reduced(time.perf_counter() - started, "MAX"),
            val_rmse_grey=rmse if config.predicts_images else None,
            **{name: distributed.reduced(error, "MAX") for name, error in further.items()},
        )

    def _batches(self, epoch: int) -> Iterator[np.ndarray]:
        """Indices of the pairs of each step of an epoch, (b,)."""
        current, order = -1, np.empty(0, int)
        for step in range(epoch * self.steps, (epoch + 1) * self.steps):
            data_pass, place = divmod(step, self.batches)
            if data_pass != current:
                rng = np.random.default_rng([self.config.seed, data_pass])
                current, order = data_pass, rng.permutation(len(self.pairs))
            yield order[place * self.batch : (place + 1) * self.batch]

    def _validate(self) -> float:
        """RMSE on the validation split, counts or grey levels; the processes share the pairs."""
        mine = np.arange(len(self.validation))[self.rank :: self.config.processes]
        squares, values, batch = 0.0, 0, VALIDATION_BATCH[self.translator.device.type]
        for start in range(0, mine.size, batch):
            errors = self._errors(self.translator, mine[start : start + batch])
            squares += float(errors.square().sum(dtype=torch.float64))
            values += errors.numel()
        squares, total = (distributed.reduced(each, "SUM") for each in (squares, values))
        return math.sqrt(squares / total)

    def _errors(self, translator: Translator, index: np.ndarray) -> torch.Tensor:
        """Predictions in float32 minus targets of validation pairs, counts or grey levels."""
        examples = translator.examples(self.validation, index)
        return translator.in_float32().predict(examples.images) - examples.targets

    def _measure(self) -> float:
        """Estimated seconds per epoch, from a few steps of other networks."""
        translator, processes = checkpoint.build(self.config), self.config.processes
        rng, started = np.random.default_rng(self.config.seed), 0.0
        mine = np.arange(self.batch)[self.rank :: processes]
        for step in range(1 + TIMED_STEPS):
            if step == 1:
                started = time.perf_counter()
            losses = translator.step(translator.examples(self.pairs, mine, rng))
            _numbers(losses)  # waits for a GPU
        step_seconds = (time.perf_counter() - started) / TIMED_STEPS
        few = np.arange(min(VALIDATION_BATCH[translator.device.type], len(self.validation)))
        started = time.perf_counter()
        self._errors(translator, few)
        image_seconds = (time.perf_counter() - started) / len(few)
        validate_seconds = image_seconds * len(self.validation) / processes
        return distributed.reduced(self.steps * step_seconds + validate_seconds, "MAX")

    def _announce(self, epoch_seconds: float) -> None:
        """Prints what is trained, on what and for how long."""
        config, done, device = self.config, len(self.history), self.translator.device.type
        seconds = (config.planned_epochs - done) * epoch_seconds
        if config.minutes is not None:
            seconds = min(seconds, 60 * config.minutes + epoch_seconds)
        resumes = f" resumes after step {self.part.steps:,} of epoch {done + 1:,};"
        print(
            f"{config.model} {config.direction}, preset {config.preset.name}:"
            f"{resumes if done or self.part.steps else ''} {counted(len(self.pairs), 'pair')}, "
            f"validated on {len(self.validation)}, {counted(config.planned_epochs, 'epoch')} of "
            f"{counted(self.steps, 'step')}, {config.precision} on {device}, "
            f"{counted(config.processes, 'process', 'processes')} of "
            f"{counted(torch.get_num_threads(), 'thread')}. At most {max(0.1, seconds / 60):.1f} "
            f"minutes; it stops after {counted(config.preset.patience, 'epoch')} without a better "
            "validation.",
            flush=True,
        )


def load_initial_weights(path: Path, translator: Translator) -> None:
    """Loads the weights of another run; of shear and contact only if both networks have them."""
    checkpoint.load_weights(path, translator.predictor, optional=(SHEAR, CONTACT))
    trained = next(iter(translator.networks.values()))
    if trained is not translator.predictor:  # the predictor is its weight average
        trained.load_state_dict(translator.predictor.state_dict())


def _numbers(losses: Mapping[str, float | torch.Tensor]) -> dict[str, float]:
    return {name: float(loss) for name, loss in losses.items()}


def steps_of_epoch(batches: int, budget: int) -> int:
    """Steps per epoch: all batches, or with a budget of steps at most its share of an epoch."""
    return min(batches, max(budget // MIN_EPOCHS, MIN_STEPS)) if budget else batches


def fit_agreement(run_dir: Path, *sets: Pairs) -> None:
    """Sets the ranges of differences of counts and contact of a run that predicts both, by
    validation pairs."""
    run, agreement = load_run(run_dir), {}
    found = [run._differences(run._outputs(pairs.inputs, contact=True)) for pairs in sets]
    for name in DIFFERENCES:
        values = np.concatenate([each[name][np.isfinite(each[name])] for each in found])
        if values.size >= MIN_ERRORS:
            low, high = np.quantile(values, DIFFERING_QUANTILES).tolist()
            agreement[name] = (0.0 if name == DIFFERENCES[0] else low, high)
    structs.replace(run.config, agreement=agreement).save(run_dir)


def recalibrate(run_dir: str | Path, data_dirs: Sequence[str | Path]) -> int:
    """Fits the calibration of a field run again; writes its best weights and its card.

    data_dirs: datasets with dense counts, of any recipe, including the run's own. Each contributes
    as many validation presses as the smallest has. Returns the total number of presses. Of a run
    whose contact alone was trained, the contact alone is calibrated.
    """
    run_dir, folders = Path(run_dir), [Path(folder) for folder in data_dirs]
    config = load_config(run_dir)
    folder_of: dict[str, Path] = {}
    for folder in folders:
        first = folder_of.setdefault(load_info(folder).sha256, folder)
        if first is not folder:
            raise T2TwinError(f"{first} and {folder} are the same dataset; give it once")
    own = folder_of.get(config.contact_data or config.data.sha256)
    if own is None:
        raise T2TwinError(
            f"the dataset that {run_dir} was trained on is missing; give it with the others"
        )
    config.need(config.has_uncertainty, run_dir, "the calibration of uncertainty", "a field run")
    translator = checkpoint.build(config)
    with locked(run_dir):
        checkpoint.load_weights(run_dir / BEST, translator.predictor)
        sets = [
            _load(folder, "val", config, run_dir, read_info(folder).source.value != IMAGE)
            for folder in folders
        ]
        number, rng = min(map(len, sets)), np.random.default_rng(0)
        samples = [
            pairs.subset(np.sort(rng.choice(len(pairs), number, replace=False))) for pairs in sets
        ]
        translator.calibrate(*samples)
        checkpoint.save_weights(run_dir / BEST, translator.predictor.state_dict())
        if config.data.has_contact:
            fit_agreement(run_dir, *samples)
        fit_frame_check(run_dir, own)
        write_card(run_dir, own)
    return sum(map(len, samples))


if __name__ == "__main__":  # for torchrun, which starts a module
    try:
        train(sys.argv[1], Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))
    except T2TwinError as error:
        sys.exit(str(error))
