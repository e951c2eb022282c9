"""Trains the frame check's second network on the frames of a dataset, as they are and transformed.

Each epoch draws other transforms. The limit is set on the validation split.

Shape letters: B images, S image side of the run.
"""

from pathlib import Path

import numpy as np
import torch
from torch.nn import functional

from t2twin.core.progress import Progress
from t2twin.translate.data.images import augment, to_input
from t2twin.translate.data.pairs import load_pairs, usable_cache
from t2twin.translate.networks.frame_check import (
    CLASSES,
    SIDE,
    TRANSFORMED,
    FrameCheck,
    TransformNet,
    scores,
)
from t2twin.translate.runs.config import RunConfig
from t2twin.translate.training.wrong_frames import FORWARD

MAX_FRAMES = 30_000
"""Training frames, at most (assumed: five minutes of a core)."""

EPOCHS, BATCH, LEARNING_RATE, WEIGHT_DECAY, WARM_UP = 12, 128, 4e-3, 0.1, 0.2
"""Of the training: epochs, frames of a step, largest learning rate, weight decay, and share of the
steps in which the learning rate increases (assumed)."""

TRANSFORMED_SHARE = 0.5
"""Share of the frames that are transformed (assumed)."""

REFUSED_SHARE, MARGIN = 0.002, 1.5
"""Share of the validation frames above the limit, and a margin that is added (assumed). Without it,
2 % of the right frames of used units are refused."""


def fit_transform_net(check: FrameCheck, config: RunConfig, data_dir: Path, run_dir: Path) -> None:
    """Trains the network of a frame check and sets its limit, in place.

    data_dir: a dataset of the run's gel camera. run_dir: for the decoded images of a dataset that
    is read-only.
    """
    frames, held_out = (
        _frames(data_dir, split, config.preset.size, usable_cache(data_dir, run_dir))
        for split in ("train", "val")
    )
    if len(held_out) == 0:
        return
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        check.transforms = TransformNet()
        _train(check.transforms, frames, config)
    check.transforms.eval()
    with torch.inference_mode():
        found = scores(check.transforms(to_input(held_out.astype(np.float32))))
    check.set_limit(TRANSFORMED, found, REFUSED_SHARE, MARGIN)


def _train(network: TransformNet, frames: np.ndarray, config: RunConfig) -> None:
    preset, rng = config.preset, np.random.default_rng(config.seed)
    parts = -(-len(frames) // BATCH)
    optimizer = torch.optim.AdamW(network.parameters(), weight_decay=WEIGHT_DECAY)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, LEARNING_RATE, EPOCHS * parts, pct_start=WARM_UP
    )
    network.train()
    for _ in Progress(range(EPOCHS), desc="frame check", unit="epoch"):
        for chosen in np.array_split(rng.permutation(len(frames)), parts):
            pixels, classes = _transformed(frames[chosen].astype(np.float32), rng)
            varied = augment(
                torch.from_numpy(pixels), rng, preset.brightness, preset.contrast, preset.noise
            )
            optimizer.zero_grad()
            functional.cross_entropy(network(to_input(varied)), classes).backward()
            optimizer.step()
            schedule.step()


def _transformed(frames: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, torch.Tensor]:
    """Frames, (B, SIDE, SIDE, 3), a share of them transformed, and the indices of their classes."""
    which = rng.integers(1, 1 + len(FORWARD), len(frames))
    which[rng.random(len(frames)) >= TRANSFORMED_SHARE] = 0
    for n, kind in enumerate(CLASSES):
        if kind in FORWARD:
            frames[which == n] = FORWARD[kind](frames[which == n])
    return frames, torch.from_numpy(which)


def _frames(data_dir: Path, split: str, size: int, cache_dir: Path) -> np.ndarray:
    """(B, SIDE, SIDE, 3) float16 frames of a split in [0, 1], at most MAX_FRAMES."""
    pairs = load_pairs(data_dir, split, size, False, cache_dir)
    count = len(pairs)
    rows = np.unique(np.linspace(0, count - 1, min(MAX_FRAMES, count)).astype(int))
    small = np.empty((rows.size, SIDE, SIDE, 3), np.float16)
    for start in range(0, rows.size, BATCH):
        part = slice(start, start + BATCH)
        pixels = torch.from_numpy(pairs.inputs[rows[part]]).permute(0, 3, 1, 2).float() / 255.0
        small[part] = functional.adaptive_avg_pool2d(pixels, SIDE).permute(0, 2, 3, 1)
    return small
