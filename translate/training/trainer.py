"""A training in progress: its epochs, one loop for all translators."""

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from t2twin.core.errors import T2TwinError
from t2twin.core.progress import Progress
from t2twin.translate.data.images import augment, to_input
from t2twin.translate.data.pairs import Examples, Pairs
from t2twin.translate.models import distributed
from t2twin.translate.models.base import Translator
from t2twin.translate.models.presets import CYSKIN_TO_DIGIT, Preset
from t2twin.translate.models.reverse import WHITE_GREY, CySkinToDigit
from t2twin.translate.runs.build import build
from t2twin.translate.runs.checkpoint import load_state, save_state, save_weights
from t2twin.translate.runs.config import BEST, LAST, TENSORBOARD, RunConfig
from t2twin.translate.runs.log import EpochRecord, best_epoch, to_json, write_log
from t2twin.translate.training.early_stopping import TrainingResult, outcome_of, stop_reason
from t2twin.translate.training.warm_start import WarmStart, begin_with
from t2twin.translate.uncertainty.ood import fit_ood_detector

PREDICT_AT_ONCE = 64
"""Images in one batch where nothing is learnt; bounds memory."""

EPOCHS_OF_STEPS = 12
"""Epochs that a preset's steps make at least: where the data has more batches than that leaves an
epoch, an epoch is cut short of the data, for the schedule and the choice of the best go by epochs
(assumed: as many as ResNet18's steps make of the paper's dataset)."""

MIN_STEPS = 100
"""Steps that an epoch is not cut below (assumed: validation would cost more than they do)."""

TIMED_STEPS = 3
"""Steps that the estimate of the time is taken from, after one that is not counted."""


class Trainer:
    """One run in progress, in one of its processes."""

    def __init__(
        self,
        config: RunConfig,
        out_dir: Path,
        pairs: Pairs,
        validation: Pairs,
        rank: int,
        start: WarmStart | None = None,
    ) -> None:
        self.config = config
        self.out_dir = out_dir
        self.pairs = pairs
        self.validation = validation
        self.rank = rank
        self.start = start
        most = min(config.preset.batch, len(pairs))
        self.batch = most - most % config.processes
        self.batches = len(pairs) // self.batch  # a last, smaller one would upset batch norm
        self.steps = steps_of_epoch(self.batches, config.budget)
        self.draws_pictures = config.direction == CYSKIN_TO_DIGIT
        self.full_scale = WHITE_GREY if self.draws_pictures else config.data.full_scale_counts
        self.history: list[EpochRecord] = []

    def run(self) -> TrainingResult:
        resumed = (self.out_dir / LAST).is_file()
        if resumed:  # older runs do not say, and went through all of the data
            self.steps = self.config.epoch_steps or self.batches
        epoch_seconds = self._measure()
        if not resumed:
            planned = self._planned_epochs(epoch_seconds)
            pictures = fit_ood_detector(self.pairs.images)
            self.config = replace(
                self.config, planned_epochs=planned, epoch_steps=self.steps, pictures=pictures
            )
        self.translator = build(self.config)
        if resumed:
            self.history = load_state(self.out_dir / LAST, self.translator)
        else:
            if self.start is not None:
                begin_with(self.start, self.translator)
            self.translator.prepare(self.pairs)
            if self.rank == 0:
                self.config.save(self.out_dir)
        self._announce(epoch_seconds)
        self._train()
        reason = stop_reason(self.config, self.history)
        assert reason is not None
        outcome = outcome_of(self.out_dir, self.history, reason)
        if self.rank == 0:
            print(f"{self.out_dir}: {outcome.in_words()}.")
        return outcome

    def _planned_epochs(self, epoch_seconds: float) -> int:
        """As many as asked for, or as the preset allows; with a limit in minutes, what fits in."""
        config, planned = self.config, self.config.planned_epochs
        if config.steps is not None:
            planned = round(config.steps / self.steps)
        elif config.epochs is None and config.preset.steps:
            planned = min(planned, round(config.preset.steps / self.steps))
        if config.minutes is not None:
            planned = min(planned, int(config.minutes * 60 / epoch_seconds))
        return max(1, planned)

    def _train(self) -> None:
        done = len(self.history)
        total = self.config.planned_epochs * self.steps
        log = _Log(self.out_dir, self.history) if self.rank == 0 else None
        with Progress(
            total=total, initial=done * self.steps, desc=self.config.model, unit="step",
            disable=self.rank > 0, mininterval=0.5,
        ) as bar:  # fmt: skip
            while stop_reason(self.config, self.history) is None:
                record = self._epoch(len(self.history), bar)
                self.history.append(record)
                best = best_epoch(self.history) is record
                bar.set_postfix_str(f"val {record.val_rmse_percent:.2f} %")
                if log is not None:
                    # The best weights first: killed in between, the epoch is simply done again.
                    if best:
                        self.translator.calibrate(self.validation)
                        save_weights(self.out_dir / BEST, self.translator.predictor)
                    save_state(self.out_dir / LAST, self.translator, self.history)
                    log.write(self.history)
                distributed.wait()
        if log is not None:
            log.close()

    def _epoch(self, epoch: int, bar: Progress) -> EpochRecord:
        """Trains for one epoch and validates. Returns its record for the log."""
        started = time.perf_counter()
        config, translator = self.config, self.translator
        share = _share_of_rate(config, epoch)
        for optimizer in translator.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = share * optimizer.defaults["lr"]
        batches = self._batches(epoch)
        rng = np.random.default_rng([config.seed, epoch, 1 + self.rank])
        torch.manual_seed(int(rng.integers(2**63)))  # dropout
        for network in translator.networks.values():
            network.train()
        sums: dict[str, float] = {}
        for batch in batches:
            losses = self._step(translator, batch[self.rank :: config.processes], rng)
            for name, loss in losses.items():
                sums[name] = sums.get(name, 0.0) + loss / self.steps
            bar.update()
        if not all(math.isfinite(loss) for loss in sums.values()):
            raise T2TwinError(
                f"the loss stopped being a number in epoch {epoch + 1}; train again with a preset "
                "of a lower learning rate"
            )
        for network in dict.fromkeys((*translator.networks.values(), translator.predictor)):
            distributed.average_statistics(network)
        rmse = self._validate()
        return EpochRecord(
            epoch=epoch + 1,
            learning_rate=share * config.preset.learning_rate,
            train=sums,
            val_rmse_counts=None if self.draws_pictures else rmse,
            val_rmse_percent=100.0 * rmse / self.full_scale,
            seconds=distributed.largest(time.perf_counter() - started),
            val_rmse_grey=rmse if self.draws_pictures else None,
        )

    def _batches(self, epoch: int) -> Iterator[np.ndarray]:
        """Indices of the pairs of each of an epoch's steps, (b,).

        All pairs are gone through in an order drawn from (seed, pass) before any comes again, over
        as many epochs as that takes. An epoch as long as the data is one pass.
        """
        drawn, order = -1, np.empty(0, int)
        for step in range(epoch * self.steps, (epoch + 1) * self.steps):
            turn, place = divmod(step, self.batches)
            if turn != drawn:
                rng = np.random.default_rng([self.config.seed, turn])
                drawn, order = turn, rng.permutation(len(self.pairs))
            yield order[place * self.batch : (place + 1) * self.batch]

    def _step(
        self,
        translator: Translator,
        batch: np.ndarray,
        rng: np.random.Generator,
    ) -> dict[str, float]:
        """One step on the pairs with these indices."""
        # Jitter is of what is seen; of what is to be drawn it would only blur the truth.
        jitter = None if self.draws_pictures else rng
        return translator.step(load_examples(self.pairs, batch, self.config.preset, jitter))

    def _validate(self) -> float:
        """RMSE on the validation split, counts, or grey levels where it draws pictures; the
        processes share it."""
        mine = np.arange(len(self.validation))[self.rank :: self.config.processes]
        squares, values = 0.0, 0
        for start in range(0, mine.size, PREDICT_AT_ONCE):
            off = self._off(self.translator, mine[start : start + PREDICT_AT_ONCE])
            squares += float(np.square(off).sum(dtype=float))
            values += off.size
        return math.sqrt(distributed.total(squares) / distributed.total(values))

    def _off(self, translator: Translator, index: np.ndarray) -> np.ndarray:
        """(b, n) what is predicted of validation pairs less what is true: counts, or grey levels
        where it draws pictures."""
        pixels, counts = self.validation.pictures[index], self.validation.counts[index]
        if isinstance(translator, CySkinToDigit):
            drawn = translator.pictures(torch.from_numpy(counts)).cpu().numpy()
            return drawn.reshape(pixels.shape[0], -1) - pixels.reshape(pixels.shape[0], -1)
        return (
            translator.predict(to_input(pixels.astype(np.float32) / 255.0)).cpu().numpy() - counts
        )

    def _measure(self) -> float:
        """Seconds that an epoch takes, from a few steps of networks that are thrown away."""
        translator = build(self.config)
        rng = np.random.default_rng(self.config.seed)
        mine = np.arange(self.batch)[self.rank :: self.config.processes]
        self._step(translator, mine, rng)
        started = time.perf_counter()
        for _ in range(TIMED_STEPS):
            self._step(translator, mine, rng)
        step_seconds = (time.perf_counter() - started) / TIMED_STEPS
        few = np.arange(min(PREDICT_AT_ONCE, len(self.validation)))
        started = time.perf_counter()
        self._off(translator, few)
        image_seconds = (time.perf_counter() - started) / len(few)
        validate_seconds = image_seconds * len(self.validation) / self.config.processes
        return distributed.largest(self.steps * step_seconds + validate_seconds)

    def _announce(self, epoch_seconds: float) -> None:
        if self.rank > 0:
            return
        config, done = self.config, len(self.history)
        left = config.planned_epochs - done
        goes_on = f" goes on after epoch {done};" if done else ""
        precision = "bf16" if config.bf16 else "fp32"
        way = f" {config.direction}" if self.draws_pictures else ""
        print(
            f"{config.model}{way}, preset {config.preset.name}:{goes_on} {len(self.pairs)} pairs, "
            f"validated on {len(self.validation)}, {config.planned_epochs} epochs of {self.steps} "
            f"steps, {precision} on {self.translator.device.type}, {config.processes} process(es) "
            f"of {torch.get_num_threads()} thread(s). At most {left * epoch_seconds / 60:.1f} "
            f"minutes; it stops after {config.preset.patience} epochs without a better validation.",
            flush=True,
        )


def load_examples(
    pairs: Pairs, batch: np.ndarray, preset: Preset, rng: np.random.Generator | None
) -> Examples:
    """The pairs with these indices; their pictures are jittered as the preset says, with rng."""
    batch, field = np.sort(batch), pairs.field  # the order on disk
    pixels = pairs.pictures[batch].astype(np.float32) / 255.0
    if rng is not None and (preset.brightness or preset.contrast or preset.noise):
        pixels = augment(pixels, rng, preset.brightness, preset.contrast, preset.noise)
    return Examples(
        to_input(pixels),
        torch.from_numpy(pairs.counts[batch]),
        None if field is None else torch.from_numpy(field[batch].astype(np.float32)),
        torch.from_numpy(pairs.force_n[batch].astype(np.float32)),
    )


def steps_of_epoch(batches: int, budget: int) -> int:
    """Steps after which is validated and saved: all batches of the data, or fewer of many.

    batches: that the data has. budget: most steps of the training, 0 for any number; module
    constants say into how many epochs at least it is divided.
    """
    return min(batches, max(budget // EPOCHS_OF_STEPS, MIN_STEPS)) if budget else batches


class _Log:
    """log.jsonl and TensorBoard; what the killed part of an epoch left is overwritten."""

    def __init__(self, out_dir: Path, history: list[EpochRecord]) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self.out_dir = out_dir
        self.board = SummaryWriter(str(out_dir / TENSORBOARD), purge_step=len(history) + 1)

    def write(self, history: list[EpochRecord]) -> None:
        write_log(self.out_dir, history)
        for name, value in to_json(history[-1]).items():
            if name != "epoch":
                self.board.add_scalar(name, value, history[-1].epoch)
        self.board.flush()

    def close(self) -> None:
        self.board.close()


def _share_of_rate(config: RunConfig, epoch: int) -> float:
    """Parts of its learning rate that an epoch (from 0) has: all, or half a cosine that would reach
    zero after the last one."""
    if config.preset.schedule == "fixed":
        return 1.0
    return 0.5 * (1.0 + math.cos(math.pi * epoch / config.planned_epochs))
