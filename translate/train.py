"""Training, one loop for both translators.

    t2twin train resnet18 --data data/small --preset cpu --out runs/resnet18
    torchrun --nproc-per-node 2 -m t2twin.translate.train resnet18 data/small cpu runs/resnet18

A run that was stopped goes on from its last whole epoch, and ends as if it had not been stopped:
each epoch's order, dropout and augmentation are drawn from (seed, epoch). Another number of
threads adds in another order, so it changes the last digits.
"""

import json
import math
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file
from t2twin.translate import distributed
from t2twin.translate.data.images import augment, to_input
from t2twin.translate.data.pairs import Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.presets import Preset, find_preset
from t2twin.translate.resnet18 import ResNet18Translator
from t2twin.translate.runs.card import write_card
from t2twin.translate.runs.checkpoint import load_history, load_state, save_state, save_weights
from t2twin.translate.runs.config import (
    BEST,
    CONFIG,
    LAST,
    LOG,
    TENSORBOARD,
    RunConfig,
    build,
    has_bf16,
    load_config,
)
from t2twin.translate.touch2touch import Touch2Touch

PREDICT_AT_ONCE = 64
"""Images in one batch where nothing is learnt; bounds memory."""

TIMED_STEPS = 3
"""Steps that the estimate of the time is taken from, after one that is not counted."""

FEWEST_PAIRS = 8
"""Pairs that a training asks for (assumed: below this batch norm has nothing to average)."""

History = list[dict[str, Any]]


@dataclass(frozen=True)
class Outcome:
    """How a training ended. best_rmse_counts: sqrt(L3) on the validation split, counts."""

    run_dir: Path
    epochs: int
    best_epoch: int
    best_rmse_counts: float
    best_rmse_percent: float
    reason: str


def train(
    model: str,
    data_dir: Path,
    preset: str | Preset,
    out_dir: Path,
    seed: int = 0,
    epochs: int | None = None,
    minutes: float | None = None,
) -> Outcome:
    """Trains a translator on DIR's train split, watching its val split, into the folder out_dir.

    model: "touch2touch" or "resnet18". preset: a name of t2twin.translate.presets, or a Preset.
    epochs: most epochs; by default the preset's, and no more than its steps make. minutes: most
    minutes; as many epochs are planned as fit in, and the schedule of the learning rate follows
    the plan.
    Raises T2TwinError for an unknown model or preset, a data set that cannot be read, a folder that
    holds another run, and a loss that stops being a number.
    """
    settings = find_preset(model, preset)
    _check_limits(epochs, minutes, seed)
    info = load_info(data_dir)
    distributed.use_all_cores()
    with distributed.processes() as (rank, processes):
        if settings.batch % processes:
            raise T2TwinError(
                f"a batch of {settings.batch} cannot be shared by {processes} processes; their "
                "number must divide it"
            )
        config = RunConfig(
            model=model,
            preset=settings,
            seed=seed,
            data=info,
            epochs=epochs,
            minutes=minutes,
            planned_epochs=epochs or settings.epochs,
            bf16=settings.bf16 and has_bf16(),
            processes=processes,
        )
        earlier = _earlier_run(config, out_dir)
        if earlier is not None:
            config, history = earlier
            reason = reason_to_stop(config, history)
            if reason:
                outcome = _outcome(out_dir, history, reason)
                if rank == 0:
                    print(f"{out_dir} is finished: {_in_words(outcome)}. Nothing to do.")
                return outcome
        cache = usable_cache(data_dir, out_dir)
        if rank == 0:  # one process decodes, the others read what it wrote
            out_dir.mkdir(parents=True, exist_ok=True)
            _load_both(data_dir, settings, cache)
        distributed.wait()
        pairs, validation = _load_both(data_dir, settings, cache)
        outcome = _Training(config, out_dir, pairs, validation, rank).run()
        if rank == 0:
            write_card(out_dir, data_dir)
        return outcome


class _Training:
    """One run in progress, in one of its processes."""

    def __init__(
        self, config: RunConfig, out_dir: Path, pairs: Pairs, validation: Pairs, rank: int
    ) -> None:
        self.config = config
        self.out_dir = out_dir
        self.pairs = pairs
        self.validation = validation
        self.rank = rank
        most = min(config.preset.batch, len(pairs))
        self.batch = most - most % config.processes
        self.steps = len(pairs) // self.batch  # a last, smaller batch would upset batch norm
        self.history: History = []

    def run(self) -> Outcome:
        resumed = (self.out_dir / LAST).is_file()
        epoch_seconds = self._measure()
        if not resumed:
            self.config = replace(self.config, planned_epochs=self._planned_epochs(epoch_seconds))
        self.translator = build(self.config)
        if resumed:
            self.history = load_state(self.out_dir / LAST, self.translator)
        elif self.rank == 0:
            self.config.save(self.out_dir)
        self._announce(epoch_seconds)
        self._train()
        reason = reason_to_stop(self.config, self.history)
        assert reason is not None
        outcome = _outcome(self.out_dir, self.history, reason)
        if self.rank == 0:
            print(f"{self.out_dir}: {_in_words(outcome)}.")
        return outcome

    def _planned_epochs(self, epoch_seconds: float) -> int:
        """As many as asked for, or as the preset allows; with a limit in minutes, what fits in."""
        config, planned = self.config, self.config.planned_epochs
        if config.epochs is None and config.preset.steps:
            planned = min(planned, round(config.preset.steps / self.steps))
        if config.minutes is not None:
            planned = min(planned, int(config.minutes * 60 / epoch_seconds))
        return max(1, planned)

    def _train(self) -> None:
        done = len(self.history)
        total = self.config.planned_epochs * self.steps
        log = _Log(self.out_dir, self.history) if self.rank == 0 else None
        with tqdm(
            total=total, initial=done * self.steps, desc=self.config.model, unit="step",
            disable=self.rank > 0, mininterval=0.5,
        ) as bar:  # fmt: skip
            while reason_to_stop(self.config, self.history) is None:
                record = self._epoch(len(self.history), bar)
                best = not self.history or record["val_rmse_counts"] < min(
                    earlier["val_rmse_counts"] for earlier in self.history
                )
                self.history.append(record)
                bar.set_postfix_str(f"val {record['val_rmse_percent']:.2f} %")
                if log is not None:
                    # The best weights first: killed in between, the epoch is simply done again.
                    if best:
                        save_weights(self.out_dir / BEST, self.translator.predictor)
                    save_state(self.out_dir / LAST, self.translator, self.history)
                    log.write(self.history)
                distributed.wait()
        if log is not None:
            log.close()

    def _epoch(self, epoch: int, bar: tqdm) -> dict[str, Any]:
        """Trains for one epoch and validates. Returns its record for the log."""
        started = time.perf_counter()
        config, translator = self.config, self.translator
        share = _share_of_rate(config, epoch)
        for optimizer in translator.optimizers.values():
            for group in optimizer.param_groups:
                group["lr"] = share * optimizer.defaults["lr"]
        order = np.random.default_rng([config.seed, epoch]).permutation(len(self.pairs))
        rng = np.random.default_rng([config.seed, epoch, 1 + self.rank])
        torch.manual_seed(int(rng.integers(2**63)))  # dropout
        for network in translator.networks.values():
            network.train()
        sums: dict[str, float] = {}
        for step in range(self.steps):
            batch = order[step * self.batch : (step + 1) * self.batch]
            losses = self._step(translator, batch[self.rank :: config.processes], rng)
            for name, loss in losses.items():
                sums[name] = sums.get(name, 0.0) + loss / self.steps
            bar.update()
        if not all(math.isfinite(loss) for loss in sums.values()):
            raise T2TwinError(
                f"the loss stopped being a number in epoch {epoch + 1}; train again with a preset "
                "of a lower learning rate"
            )
        for network in translator.networks.values():
            distributed.average_statistics(network)
        rmse = self._validate()
        return {
            "epoch": epoch + 1,
            "learning_rate": share * config.preset.learning_rate,
            **{f"train_{name}": loss for name, loss in sums.items()},
            "val_rmse_counts": rmse,
            "val_rmse_percent": 100.0 * rmse / config.data.full_scale_counts,
            "seconds": distributed.largest(time.perf_counter() - started),
        }

    def _step(
        self,
        translator: Touch2Touch | ResNet18Translator,
        batch: np.ndarray,
        rng: np.random.Generator,
    ) -> dict[str, float]:
        """One step on the pairs with these indices."""
        preset = self.config.preset
        batch = np.sort(batch)  # the order on disk
        pixels = self.pairs.images[batch].astype(np.float32) / 255.0
        if preset.brightness or preset.contrast or preset.noise:
            pixels = augment(pixels, rng, preset.brightness, preset.contrast, preset.noise)
        counts = torch.from_numpy(self.pairs.counts[batch])
        return translator.step(to_input(pixels), counts)

    def _validate(self) -> float:
        """sqrt(L3) on the validation split, counts; the processes share it."""
        mine = np.arange(len(self.validation))[self.rank :: self.config.processes]
        squares = 0.0
        for start in range(0, mine.size, PREDICT_AT_ONCE):
            index = mine[start : start + PREDICT_AT_ONCE]
            pixels = self.validation.images[index].astype(np.float32) / 255.0
            predicted = self.translator.predict(to_input(pixels)).cpu().numpy()
            squares += float(np.square(predicted - self.validation.counts[index]).sum(dtype=float))
        return math.sqrt(distributed.total(squares) / self.validation.counts.size)

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
        few = self.validation.images[: min(PREDICT_AT_ONCE, len(self.validation))]
        inputs = to_input(few.astype(np.float32) / 255.0)
        started = time.perf_counter()
        translator.predict(inputs)
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
        print(
            f"{config.model}, preset {config.preset.name}:{goes_on} {len(self.pairs)} pairs, "
            f"validated on {len(self.validation)}, {config.planned_epochs} epochs of {self.steps} "
            f"steps, {precision} on {self.translator.device.type}, {config.processes} process(es) "
            f"of {torch.get_num_threads()} thread(s). At most {left * epoch_seconds / 60:.1f} "
            f"minutes; it stops after {config.preset.patience} epochs without a better validation.",
            flush=True,
        )


class _Log:
    """log.jsonl and TensorBoard; what the killed part of an epoch left is overwritten."""

    def __init__(self, out_dir: Path, history: History) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self.path = out_dir / LOG
        self.board = SummaryWriter(str(out_dir / TENSORBOARD), purge_step=len(history) + 1)

    def write(self, history: History) -> None:
        with whole_file(self.path) as temporary:
            temporary.write_text("".join(json.dumps(record) + "\n" for record in history))
        for name, value in history[-1].items():
            if name != "epoch":
                self.board.add_scalar(name, value, history[-1]["epoch"])
        self.board.flush()

    def close(self) -> None:
        self.board.close()


def _check_limits(epochs: int | None, minutes: float | None, seed: int) -> None:
    if epochs is not None and epochs < 1:
        raise T2TwinError(f"epochs is {epochs}; it must be at least 1")
    if minutes is not None and not (minutes > 0 and math.isfinite(minutes)):
        raise T2TwinError(f"minutes is {minutes:g}; it must be more than 0")
    if seed < 0:
        raise T2TwinError(f"seed is {seed}; it must be 0 or more")


def _load_both(data_dir: Path, preset: Preset, cache: Path) -> tuple[Pairs, Pairs]:
    pairs, validation = (
        load_pairs(data_dir, split, preset.size, preset.grey, cache) for split in ("train", "val")
    )
    if len(pairs) < FEWEST_PAIRS:
        raise T2TwinError(
            f"the train split of {data_dir} has {len(pairs)} pair(s); training needs {FEWEST_PAIRS}"
        )
    return pairs, validation


def _earlier_run(config: RunConfig, out_dir: Path) -> tuple[RunConfig, History] | None:
    """The run that out_dir holds already, if any. Raises T2TwinError where it is another one."""
    if not (out_dir / CONFIG).is_file():
        return None
    earlier = load_config(out_dir)
    for what, was, asked in (
        ("model", earlier.model, config.model),
        ("preset", earlier.preset, config.preset),
        ("seed", earlier.seed, config.seed),
        ("data set", earlier.data.sha256, config.data.sha256),
        ("number of epochs", earlier.epochs, config.epochs),
        ("limit in minutes", earlier.minutes, config.minutes),
        ("number of processes", earlier.processes, config.processes),
    ):
        if was != asked:
            named = "" if isinstance(was, Preset) or what == "data set" else f" ({was})"
            raise T2TwinError(
                f"{out_dir} holds a run with another {what}{named}; give the same again, or "
                "another folder"
            )
    if not (out_dir / LAST).is_file():
        return None
    return earlier, load_history(out_dir / LAST)


def reason_to_stop(config: RunConfig, history: History) -> str | None:
    """Why a run with this history is finished, or None."""
    if len(history) >= config.planned_epochs:
        return "all its epochs are done"
    best = min(range(len(history)), key=lambda i: history[i]["val_rmse_counts"], default=0)
    if len(history) - 1 - best >= config.preset.patience:
        return f"{config.preset.patience} epochs brought no better validation"
    spent = sum(record["seconds"] for record in history)
    if config.minutes is not None and spent >= 60 * config.minutes:
        return f"its {config.minutes:g} minutes are over"
    return None


def _share_of_rate(config: RunConfig, epoch: int) -> float:
    """Parts of its learning rate that an epoch (from 0) has: all, or half a cosine that would reach
    0 after the last one."""
    if config.preset.schedule == "fixed":
        return 1.0
    return 0.5 * (1.0 + math.cos(math.pi * epoch / config.planned_epochs))


def _outcome(out_dir: Path, history: History, reason: str) -> Outcome:
    best = min(history, key=lambda record: record["val_rmse_counts"])
    return Outcome(
        run_dir=out_dir,
        epochs=len(history),
        best_epoch=best["epoch"],
        best_rmse_counts=best["val_rmse_counts"],
        best_rmse_percent=best["val_rmse_percent"],
        reason=reason,
    )


def _in_words(outcome: Outcome) -> str:
    return (
        f"{outcome.reason}; the best of {outcome.epochs} epochs is {outcome.best_epoch}, with a "
        f"validation sqrt(L3) of {outcome.best_rmse_counts:.0f} counts "
        f"({outcome.best_rmse_percent:.2f} %)"
    )


if __name__ == "__main__":  # for torchrun, which starts a module
    try:
        train(sys.argv[1], Path(sys.argv[2]), sys.argv[3], Path(sys.argv[4]))
    except T2TwinError as error:
        sys.exit(str(error))
