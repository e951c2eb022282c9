"""The training loop of all translators, its batches, when it ends, and its result.

Shape letters: B batch, P pairs, S image side, c channels, N taxels, n values of a prediction.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from msgspec.structs import replace

from t2twin.core.errors import T2TwinError, counted
from t2twin.core.progress import Progress
from t2twin.translate.data.images import COLORS, WHITE_GREY, augment, on_device, to_input, to_scaled
from t2twin.translate.data.pairs import Examples, ImageFile, Pairs
from t2twin.translate.models import distributed
from t2twin.translate.models.base import Translator
from t2twin.translate.models.presets import FIXED, MAX_EPOCHS, Preset
from t2twin.translate.networks.field_net import CONTACT, SHEAR
from t2twin.translate.runs.checkpoint import (
    build,
    load_state,
    load_weights,
    save_state,
    save_weights,
)
from t2twin.translate.runs.config import BEST, LAST, TENSORBOARD, RunConfig
from t2twin.translate.runs.log import EpochPart, EpochRecord, best_epoch, write_log
from t2twin.translate.uncertainty.ood import OODDetector, fit_ood_detector

# Pairs in one batch of validation by the type of the device; bounds memory
VALIDATION_BATCH = {"cpu": 64, "cuda": 256}
# Minimum number of epochs that a preset's steps are divided into (assumed: those of ResNet18 on
# the paper's dataset): learning rates and the choice of the best weights depend on epochs
MIN_EPOCHS = 12
MIN_STEPS = 100  # Of a shortened epoch (assumed: with fewer, validation takes longer)
SAVE_SECONDS = 600.0  # Between two states within an epoch (assumed: one takes a few to write)
TIMED_STEPS = 3  # Steps of the time estimate, after one that is not counted


@dataclass(frozen=True)
class TrainingResult:
    """Result of a finished training.

    best_rmse_counts: RMSE on the validation split, counts, or best_rmse_grey, grey levels of a run
    that predicts images. best_rmse_percent: the same in percent of full scale.
    """

    run_dir: Path
    epochs: int
    best_epoch: int
    best_rmse_counts: float | None
    best_rmse_percent: float
    stop_reason: str
    best_rmse_grey: float | None = None

    @property
    def summary(self) -> str:
        """The result as one clause."""
        grey = self.best_rmse_grey
        rmse = f"{self.best_rmse_counts:.0f} counts" if grey is None else f"{grey:.1f} grey levels"
        return (
            f"{self.stop_reason}; the best of {counted(self.epochs, 'epoch')} is "
            f"{self.best_epoch}, with a validation RMSE of {rmse} ({self.best_rmse_percent:.2f} %)"
        )


def training_result(run_dir: Path, history: list[EpochRecord], reason: str) -> TrainingResult:
    """The result of a run with at least one epoch."""
    best = best_epoch(history)
    counts, grey, percent = best.val_rmse_counts, best.val_rmse_grey, best.val_rmse_percent
    return TrainingResult(run_dir, len(history), best.epoch, counts, percent, reason, grey)


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


class Batches:
    """The batches of the pairs of one split, on a device, which also augments them."""

    def __init__(self, pairs: Pairs, preset: Preset, device: torch.device) -> None:
        self.preset, self.pairs, self.device = preset, pairs, device
        self.inputs = pairs.inputs
        self.more = (pairs.dense_counts, pairs.force_n, pairs.shear_n, pairs.contact)

    def examples(
        self,
        batch: np.ndarray,
        rng: np.random.Generator | None,
        to_input: Callable[[torch.Tensor], torch.Tensor] = to_input,
    ) -> Examples:
        """The pairs with these indices, (B,); with rng, augmented as the preset defines.

        Augmentation is for images of the source; counts and targets stay as they are.
        """
        batch, preset = np.sort(batch), self.preset  # the order on disk
        inputs, target = self.readings(batch)
        pixels = inputs.float() / WHITE_GREY
        more = [None if each is None else self._tensor(each[batch]).float() for each in self.more]
        if rng is not None and self.pairs.pictures is None:
            if preset.background_share and self.pairs.backgrounds is not None:
                drawn = rng.random(len(batch)) < preset.background_share
                replaced = on_device(np.flatnonzero(drawn), pixels.device)
                pixels[replaced, ..., :COLORS] = pixels[replaced, ..., COLORS:]
                for each in more:
                    if each is not None:
                        each[replaced] = 0.0
            if preset.brightness or preset.contrast or preset.noise or preset.drift:
                pixels = augment(
                    pixels, rng, preset.brightness, preset.contrast, preset.noise, preset.drift
                )
        if isinstance(self.pairs.target, ImageFile):
            target = to_scaled(target.float() / WHITE_GREY)
        return Examples(to_input(pixels), target, *more)

    def readings(self, batch: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        """The stored pictures and targets of pairs with these indices, (B,)."""
        return self._tensor(self.inputs[batch]), self._tensor(self.pairs.target[batch])

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        """Pictures as uint8, contact maps as float16, other values as float32."""
        if values.dtype not in (np.uint8, np.float16):
            values = values.astype(np.float32, copy=False)
        return torch.from_numpy(values).to(self.device)


class Trainer:
    """The training of one run, in one of its processes. weights: initial ones, None for random."""

    def __init__(
        self,
        config: RunConfig,
        out_dir: Path,
        pairs: Pairs,
        validation: Pairs,
        rank: int,
        weights: Path | None = None,
    ) -> None:
        self.config, self.out_dir = config, out_dir
        self.rank, self.weights = rank, weights
        self.pairs, self.validation = pairs, validation
        self.data, self.validation_data = (
            Batches(each, config.preset, distributed.device()) for each in (pairs, validation)
        )
        most = min(config.preset.batch, len(pairs))
        self.batch = most - most % config.processes
        self.batches = len(pairs) // self.batch  # no smaller last batch: bad for batch norm
        self.steps = steps_of_epoch(self.batches, config.budget)
        self.history: list[EpochRecord] = []
        self.part = EpochPart()

    def run(self) -> TrainingResult:
        """Trains until the run is finished; starts from the saved state if there is one."""
        resumed = (self.out_dir / LAST).is_file()
        if resumed:
            assert self.config.epoch_steps is not None
            self.steps = self.config.epoch_steps
        epoch_seconds = self._measure()
        if not resumed:
            self.config = replace(
                self.config,
                planned_epochs=self._planned_epochs(epoch_seconds),
                epoch_steps=self.steps,
                ood_detector=self._ood_detector(),
            )
        self.translator = build(self.config)
        if self.weights is not None:
            load_initial_weights(self.weights, self.translator)
        if resumed:
            self.history, self.part = load_state(self.out_dir / LAST, self.translator)
        else:
            self.translator.prepare(self.pairs)
            if self.rank == 0:
                self.config.save(self.out_dir)
        self._announce(epoch_seconds)
        self._train()
        reason = stop_reason(self.config, self.history)
        assert reason is not None
        result = training_result(self.out_dir, self.history, reason)
        if self.rank == 0:
            print(f"{self.out_dir}: {result.summary}.")
        return result

    def _ood_detector(self) -> OODDetector | None:
        """Statistics of the training images; of layers on another run's, that run's."""
        if self.config.contact_data is not None or self.pairs.pictures is not None:
            return self.config.ood_detector
        return fit_ood_detector(self.pairs.images)

    def _planned_epochs(self, epoch_seconds: float) -> int:
        """The user's number of epochs or the preset's."""
        config, planned = self.config, self.config.planned_epochs
        if config.steps is not None:
            planned = round(config.steps / self.steps)
        elif config.epochs is None and config.preset.steps:
            planned = min(planned, round(config.preset.steps / self.steps))
        if config.minutes is not None and config.preset.schedule != FIXED:
            planned = min(planned, int(config.minutes * 60 / epoch_seconds))
        return min(max(1, planned), MAX_EPOCHS)

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
                bar.print_line(self._progress())
                bar.set_postfix_str(f"val {record.val_rmse_percent:.2f} %")
                if board is not None:
                    # The best weights first: if killed in between, the epoch is repeated.
                    if best_epoch(self.history) is record:
                        self.translator.in_float32().calibrate(self.validation)
                        save_weights(self.out_dir / BEST, self.translator.predictor)
                    save_state(self.out_dir / LAST, self.translator, self.history, self.part)
                    write_log(self.out_dir, self.history)
                    for name, value in record.numbers.items():
                        board.add_scalar(name, value, record.epoch)
                    board.flush()
                distributed.wait()
        if board is not None:
            board.close()

    def _progress(self) -> str:
        """The last epoch as one line."""
        last, best = self.history[-1], best_epoch(self.history)
        total = self.config.planned_epochs
        minutes = sum(record.seconds for record in self.history) / 60
        error_mm, best_mm = last.val_contact_error_mm, best.val_contact_error_mm
        contact = "" if error_mm is None else f", depth {error_mm:.4f} mm, then {best_mm:.4f} mm"
        return (
            f"epoch {last.epoch:,} of {total:,}, step {last.epoch * self.steps:,} of "
            f"{total * self.steps:,}, {minutes:.1f} minutes, validation RMSE "
            f"{last.val_rmse_percent:.2f} %, best {best.val_rmse_percent:.2f} % in epoch "
            f"{best.epoch:,}{contact}"
        )

    def _epoch(self, epoch: int, bar: Progress) -> EpochRecord:
        """Trains for the rest of an epoch and validates. Returns the record of the epoch."""
        started = time.perf_counter() - self.part.seconds
        config, translator = self.config, self.translator
        share = _learning_rate_share(config, epoch)
        for optimizer in translator.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = share * optimizer.defaults["lr"]
        for network in translator.networks.values():
            network.train()
        sums: dict[str, float | torch.Tensor] = dict(self.part.losses)
        saved = time.perf_counter()
        first = self.part.steps
        for step, batch in enumerate(islice(self._batches(epoch), first, None), first):
            rng = np.random.default_rng([config.seed, epoch, step, 1 + self.rank])
            torch.manual_seed(int(rng.integers(2**63)))  # dropout
            losses = translator.step(self._examples(translator, batch, rng))
            for name, loss in losses.items():
                sums[name] = sums.get(name, 0.0) + loss.double()  # does not wait for a GPU
            bar.update()
            now = time.perf_counter()
            if config.processes == 1 and now - saved >= SAVE_SECONDS and step + 1 < self.steps:
                part = EpochPart(step + 1, _numbers(sums), now - started)
                save_state(self.out_dir / LAST, translator, self.history, part)
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
            val_rmse_percent=100.0 * rmse / config.full_scale,
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

    def _examples(
        self, translator: Translator, batch: np.ndarray, rng: np.random.Generator
    ) -> Examples:
        """This process's part of the pairs with these indices."""
        mine = batch[self.rank :: self.config.processes]
        return self.data.examples(mine, rng, translator.to_input)

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
        """(b, n) errors of predictions in float32, of the validation pairs with these indices."""
        return translator.in_float32().errors(*self.validation_data.readings(index))

    def _measure(self) -> float:
        """Estimated seconds per epoch, from a few steps of other networks."""
        translator = build(self.config)
        rng = np.random.default_rng(self.config.seed)
        batch, started = np.arange(self.batch), 0.0
        for step in range(1 + TIMED_STEPS):
            if step == 1:
                started = time.perf_counter()
            _numbers(translator.step(self._examples(translator, batch, rng)))  # waits for a GPU
        step_seconds = (time.perf_counter() - started) / TIMED_STEPS
        few = np.arange(min(VALIDATION_BATCH[translator.device.type], len(self.validation)))
        started = time.perf_counter()
        self._errors(translator, few)
        image_seconds = (time.perf_counter() - started) / len(few)
        validate_seconds = image_seconds * len(self.validation) / self.config.processes
        return distributed.reduced(self.steps * step_seconds + validate_seconds, "MAX")

    def _announce(self, epoch_seconds: float) -> None:
        if self.rank > 0:
            return
        config, done, resumes = self.config, len(self.history), ""
        seconds = (config.planned_epochs - done) * epoch_seconds
        if config.minutes is not None:
            seconds = min(seconds, 60 * config.minutes + epoch_seconds)
        if done or self.part.steps:
            resumes = f" resumes after step {self.part.steps:,} of epoch {done + 1:,};"
        direction = "" if config.is_image_to_counts else f" {config.direction}"
        print(
            f"{config.model}{direction}, preset {config.preset.name}:{resumes} "
            f"{counted(len(self.pairs), 'pair')}, validated on {len(self.validation)}, "
            f"{counted(config.planned_epochs, 'epoch')} of {counted(self.steps, 'step')}, "
            f"{config.precision} on {self.translator.device.type}, "
            f"{counted(config.processes, 'process', 'processes')} of "
            f"{counted(torch.get_num_threads(), 'thread')}. At most {seconds / 60:.1f} minutes; it "
            f"stops after {counted(config.preset.patience, 'epoch')} without a better validation.",
            flush=True,
        )


def load_initial_weights(path: Path, translator: Translator) -> None:
    """Loads the weights of another run; of shear and contact only if both networks have them."""
    load_weights(path, translator.predictor, optional=(SHEAR, CONTACT))
    trained = next(iter(translator.networks.values()))
    if trained is not translator.predictor:  # the predictor is its weight average
        trained.load_state_dict(translator.predictor.state_dict())


def _numbers(losses: Mapping[str, float | torch.Tensor]) -> dict[str, float]:
    return {name: float(loss) for name, loss in losses.items()}


def steps_of_epoch(batches: int, budget: int) -> int:
    """Steps per epoch: all batches, or with a budget of steps at most its share of an epoch."""
    return min(batches, max(budget // MIN_EPOCHS, MIN_STEPS)) if budget else batches


def _learning_rate_share(config: RunConfig, epoch: int) -> float:
    """Factor of the learning rate in an epoch (from 0): 1, or a half cosine to zero."""
    if config.preset.schedule == FIXED:
        return 1.0
    return 0.5 * (1.0 + math.cos(math.pi * epoch / config.planned_epochs))
