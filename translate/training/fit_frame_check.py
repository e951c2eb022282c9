"""Trains the frame check of a field run (networks.frame_check) on the frames of a dataset.

Right frames, and wrong ones made of them, are given with the unit's background frame and without.
A right frame with another unit's background frame is wrong too. The limits are set on units that
the check was not trained on.

Shape letters: R right frames, W wrong frames, H side of the check's images.
"""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import nn
from torch.nn import functional

from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.dataset.columns import BACKGROUND, IMAGE, column
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import to_input, to_pixels
from t2twin.translate.data.pairs import has_backgrounds
from t2twin.translate.networks.frame_check import (
    CLASSES,
    SIDE,
    WITHOUT,
    FrameCheck,
    scores,
)
from t2twin.translate.runs.checkpoint import save_weights
from t2twin.translate.runs.config import FRAME_CHECK, load_config
from t2twin.translate.training.wrong_frames import FORWARD, other_frame
from t2twin.translate.uncertainty.ood import OODClass

MAX_FRAMES = 15_000
"""Right frames that the check is trained on, at most (assumed: a few minutes of two cores)."""

MIN_FRAMES = 300
"""Right frames without which a run has no check (assumed)."""

OTHERS_EVERY = 3
"""Right frames for each wrong one that is no transform (assumed: these are slow to make)."""

MAX_SHARDS = 40
"""Shards that they are read from, at most (assumed)."""

SHARES = {"transformed": 0.35, "other": 0.1, "other unit": 0.06}
"""Shares of the wrong frames of a batch, without background frame less the last (assumed)."""

WITH_SHARE = 0.4
"""Share of the batches with background frames (assumed: these are easier)."""

HELD_OUT_SHARE = 0.15
"""Share of the units that the limits are set on."""

MIN_UNITS = 10
"""Units below which frames are held out, and not units (assumed)."""

REFUSED_SHARE = 0.003
"""Share of these units' right frames that is above a limit (assumed: less than one percent, as
other statistics refuse some too)."""

EPOCHS, BATCH, LEARNING_RATE, WEIGHT_DECAY = 20, 128, 4e-3, 0.1
"""Of the training (assumed)."""

GAIN, NOISE = 0.1, 0.02
"""Standard deviations of the gain of a frame and of noise on its normalized pixels (assumed)."""


@dataclass(frozen=True)
class Frames:
    """Frames for a check, float32, normalized, channels last.

    right: (R, H, H, 3). backgrounds: (R, H, H, 3) of their units; None without. others: (W, H, H,
    3) wrong frames that are no transforms. origins: (W,) the right frames that these are made of.
    units: (R,) number of the unit of a right frame.
    """

    right: np.ndarray
    backgrounds: np.ndarray | None
    others: np.ndarray
    origins: np.ndarray
    units: np.ndarray

    def subset(self, keep: np.ndarray) -> "Frames":
        """Those of the right frames where keep, (R,) bool, is true."""
        kept, places = keep[self.origins], np.cumsum(keep) - 1
        backgrounds = None if self.backgrounds is None else self.backgrounds[keep]
        origins = places[self.origins[kept]]
        return Frames(self.right[keep], backgrounds, self.others[kept], origins, self.units[keep])


def complete(run_dir: Path, data_dir: Path) -> None:
    """Gives a finished field run its frame check, if it has none."""
    if load_config(run_dir).model == "field" and not (run_dir / FRAME_CHECK).is_file():
        fit_frame_check(run_dir, data_dir)


def fit_frame_check(run_dir: Path, data_dir: Path) -> bool:
    """Writes the frame check of a field run; False for too few frames.

    data_dir: a dataset of the run's gel camera, whose train split is used. Raises T2TwinError for
    a dataset that cannot be read.
    """
    info, config = read_info(data_dir), load_config(run_dir)
    if info.pairs["train"] < MIN_FRAMES:
        return False
    frames = _read(data_dir, info, config.preset.size, np.random.default_rng(config.seed))
    save_weights(run_dir / FRAME_CHECK, trained(frames, config.seed))
    return True


def _read(data_dir: Path, info: DatasetInfo, size: int, rng: np.random.Generator) -> Frames:
    """Right frames of a dataset, evenly spread, and wrong ones. size: of the run's images."""
    shards = split_shards(info, "train")
    chosen = np.unique(np.linspace(0, len(shards) - 1, MAX_SHARDS).astype(int))
    limit = -(-MAX_FRAMES // chosen.size)
    columns = [IMAGE, BACKGROUND] if has_backgrounds(info) else [IMAGE]
    right, backgrounds, others, origins, units = [], [], [], [], []
    behind: dict[bytes, np.ndarray] = {}  # of the last shards' units
    for number in Progress(chosen, desc="frame check", unit="shard"):
        stored = [
            list(iter_images(data_dir, shards[number], column(info.role_of(IMAGE), name)))
            for name in columns
        ]
        count = len(stored[0])
        for row in np.unique(np.linspace(0, count - 1, min(limit, count)).astype(int)):
            frame, background = decode_png(stored[0][row]), stored[-1][row]
            if len(right) % OTHERS_EVERY == 0:
                origins.append(len(right))
                others.append(_small(other_frame(frame, rng), size))
            right.append(_small(frame, size))
            units.append(sha256(background).digest())
            if len(stored) > 1:
                if units[-1] not in behind:
                    behind[units[-1]] = _small(decode_png(background), size)
                backgrounds.append(behind[units[-1]])
    return Frames(
        np.stack(right),
        np.stack(backgrounds) if backgrounds else None,
        np.stack(others),
        np.array(origins),
        np.unique(units, return_inverse=True)[1],
    )


def _small(frame: np.ndarray, size: int) -> np.ndarray:
    """(H, H, 3): what the check sees of a frame, (h, w, 3) uint8."""
    pixels = to_pixels(Image.fromarray(frame), size, grey=False)
    inputs = to_input(pixels[None].astype(np.float32) / 255.0)
    return functional.adaptive_avg_pool2d(inputs, SIDE)[0].permute(1, 2, 0).numpy()


def trained(frames: Frames, seed: int) -> FrameCheck:
    """The check, with its limits."""
    units = frames.units
    if units.max() < MIN_UNITS:  # frames of the same units are held out then
        units = np.arange(units.size)
    rng = np.random.default_rng(seed)
    order = rng.permutation(units.max() + 1)
    held_out = np.isin(units, order[: max(1, round(HELD_OUT_SHARE * order.size))])
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        check = FrameCheck()
        _train(check, frames.subset(~held_out), rng)
    check.eval()
    right = frames.subset(held_out)
    inputs = [_inputs(right.right, None)]
    if right.backgrounds is not None:
        inputs.append(_inputs(right.right, right.backgrounds))
    with torch.inference_mode():
        for mode, each in enumerate(inputs, start=WITHOUT):
            check.limits[mode] = torch.quantile(scores(check(each)), 1.0 - REFUSED_SHARE)
    return check


def _train(check: FrameCheck, frames: Frames, rng: np.random.Generator) -> None:
    batches = max(1, len(frames.right) // BATCH)
    optimizer = torch.optim.AdamW(check.parameters(), weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, LEARNING_RATE, EPOCHS * batches, pct_start=0.2
    )
    check.train()
    for _ in Progress(range(EPOCHS), desc="frame check", unit="epoch"):
        for rows in np.array_split(rng.permutation(len(frames.right)), batches):
            inputs, classes = _batch(frames, rows, rng)
            optimizer.zero_grad()
            nn.functional.cross_entropy(check(inputs), classes).backward()
            optimizer.step()
            schedule.step()


def _batch(
    frames: Frames, rows: np.ndarray, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    """Inputs and classes of a batch: right frames of these rows, part of which become wrong."""
    images, backgrounds = frames.right[rows], None
    if frames.backgrounds is not None and rng.random() < WITH_SHARE:
        backgrounds = frames.backgrounds[rows]
    classes = np.zeros(rows.size, np.int64)
    ends = np.cumsum(list(SHARES.values()))
    drawn = np.searchsorted(ends, rng.random(rows.size), side="right")
    kinds = rng.integers(len(FORWARD), size=rows.size)
    for number, (kind, transform) in enumerate(FORWARD.items()):
        here = (drawn == 0) & (kinds == number)
        images[here] = transform(images[here])
        classes[here] = CLASSES.index(kind)
    here = drawn == 1
    wrong = rng.integers(len(frames.others), size=here.sum())
    images[here], classes[here] = frames.others[wrong], CLASSES.index(OODClass.OTHER)
    if backgrounds is not None and frames.backgrounds is not None:
        backgrounds[here] = frames.backgrounds[frames.origins[wrong]]
        another = rng.integers(len(frames.right), size=rows.size)
        here = (drawn == 2) & (frames.units[another] != frames.units[rows])
        backgrounds[here] = frames.backgrounds[another[here]]
        classes[here] = CLASSES.index(OODClass.UNLIKE_BACKGROUND)
    gain = 1.0 + GAIN * rng.standard_normal((rows.size, 1, 1, 1), np.float32)
    images = gain * images + NOISE * rng.standard_normal(images.shape, np.float32)
    return _inputs(images, backgrounds), torch.from_numpy(classes)


def _inputs(images: np.ndarray, backgrounds: np.ndarray | None) -> torch.Tensor:
    """(B, 3 or 6, H, H) of images, (B, H, H, 3)."""
    parts = [images] if backgrounds is None else [images, backgrounds]
    both = np.concatenate(parts, axis=-1)
    return torch.from_numpy(np.ascontiguousarray(both.transpose(0, 3, 1, 2)))
