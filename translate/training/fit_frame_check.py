"""Trains the frame check of a field run (networks.frame_check) on the frames of a dataset.

Right frames, and wrong ones made of them, are each given with the unit's background frame and with
the run's mean frame. The background frame drifts as in the training of the run. That of a wrong
frame may be altered in the same way. A right frame with
another unit's background frame is wrong too, unless all units are near that of one optics file,
whose own light drifts as much. The limits are set on units that the check was not trained on. Its
second network: fit_transform_net.

Shape letters: R right frames, n features.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import nn

from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.dataset.columns import BACKGROUND, IMAGE, column
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import augment, to_input, to_pixels
from t2twin.translate.data.pairs import has_backgrounds
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.networks.frame_check import CLASSES, WITH, WITHOUT, FrameCheck, scores
from t2twin.translate.runs.checkpoint import build, load_weights, save_weights
from t2twin.translate.runs.config import BEST, FRAME_CHECK, RunConfig, load_config
from t2twin.translate.training.fit_transform_net import fit_transform_net
from t2twin.translate.training.wrong_frames import wrong_frame
from t2twin.translate.uncertainty.ood import OODClass

MAX_FRAMES = 5000
"""Right frames that the check is trained on, at most (assumed: a few minutes of a core)."""

MIN_FRAMES = 300
"""Right frames without which a run has no check (assumed)."""

MAX_SHARDS = 40
"""Shards that they are read from, at most (assumed)."""

BOTH_SHARE = 0.5
"""Share of the wrong frames whose background frame is altered in the same way (assumed: a
user who mirrors or crops frames does so with both)."""

OTHER_UNIT_SHARE = 0.12
"""Share of the wrong frames that are right but for their background frame (assumed)."""

HELD_OUT_SHARE = 0.2
"""Share of the units that the limits are set on."""

MIN_UNITS = 10
"""Units below which frames are held out, and not units (assumed)."""

REFUSED_SHARES = (0.003, 0.003)
"""Share of these units' right frames that is above the limits, without and with a background frame
(assumed: less than one percent, as other statistics refuse some too)."""

EPOCHS, BATCH, LEARNING_RATE, WEIGHT_DECAY = 30, 128, 2e-3, 0.1
"""Of the training (assumed)."""

MIN_SCALE = 0.01
"""Minimum standard deviation of a feature (assumed)."""

BATCH_SIZE = 64
"""Frames whose features are computed together; bounds memory."""


@dataclass(frozen=True)
class _Part:
    """Right frames of a shard, and a wrong one made of each.

    features: (R, n) of right and of wrong frames, without and, if there are any, with background
    frames. kinds: (R,) index of the wrong frames' classes. units: (R,) SHA-256 of the background
    frames, or of the frames without.
    """

    features: list[list[torch.Tensor]]
    kinds: np.ndarray
    units: list[bytes]


def complete(run_dir: Path, data_dir: Path) -> None:
    """Gives a finished field run its frame check, if it has none."""
    if load_config(run_dir).model == "field" and not (run_dir / FRAME_CHECK).is_file():
        fit_frame_check(run_dir, data_dir)


def fit_frame_check(run_dir: Path, data_dir: Path) -> bool:
    """Writes the frame check of a field run with finished weights; False for too few frames.

    data_dir: a dataset of the run's gel camera, whose train split is used. Raises T2TwinError for
    a dataset that cannot be read.
    """
    info, config = read_info(data_dir), load_config(run_dir)
    if info.pairs["train"] < MIN_FRAMES:
        return False
    translator = build(config)
    assert isinstance(translator, FieldTranslator)
    load_weights(run_dir / BEST, translator.predictor)
    rng = np.random.default_rng(config.seed)
    shards = split_shards(info, "train")
    chosen = np.unique(np.linspace(0, len(shards) - 1, MAX_SHARDS).astype(int))
    each = -(-MAX_FRAMES // chosen.size)
    bar = Progress(chosen, desc="frame check", unit="shard")
    parts = [_part(translator, config, data_dir, shards[n], info, each, rng) for n in bar]
    check = _trained(parts, config.seed)
    fit_transform_net(check, config, data_dir, run_dir)
    save_weights(run_dir / FRAME_CHECK, check)
    return True


def _part(
    translator: FieldTranslator, config: RunConfig, data_dir: Path, shard: str, info: DatasetInfo,
    limit: int, rng: np.random.Generator,
) -> _Part:  # fmt: skip
    """At most `limit` right frames of a shard, evenly spread. config: of the run."""
    size, drift = config.preset.size, config.preset.drift
    columns = [IMAGE, BACKGROUND] if has_backgrounds(info) else [IMAGE]
    stored = [
        list(iter_images(data_dir, shard, column(info.role_of(IMAGE), name))) for name in columns
    ]
    count = len(stored[0])
    rows = np.unique(np.linspace(0, count - 1, min(limit, count)).astype(int))
    images, *own = [[pngs[row] for row in rows] for pngs in stored]
    units = [sha256(png).digest() for png in (own[0] if own else images)]
    frames = [decode_png(png) for png in images]
    seeds = rng.integers(2**32, size=len(frames)).tolist()
    wrong, kinds = zip(*map(_altered, frames, seeds), strict=True)
    classes = np.array([CLASSES.index(kind) for kind in kinds])
    right, altered = _pixels(frames, size), _pixels(wrong, size)
    found = [[_features(translator, each) for each in (right, altered)]]
    if own:
        stills = [decode_png(png) for png in own[0]]
        backgrounds = _pixels(stills, size)
        others = rng.permutation(len(frames))
        differs = np.array([units[n] != units[other] for n, other in enumerate(others)])
        differs &= not _has_one_light(info)
        is_other = differs & (rng.random(len(frames)) < OTHER_UNIT_SHARE)
        classes[is_other] = CLASSES.index(OODClass.UNLIKE_BACKGROUND)
        altered[is_other] = right[is_other]
        behind = backgrounds[np.where(is_other, others, np.arange(len(frames)))]
        is_both = ~is_other & (rng.random(len(frames)) < BOTH_SHARE)
        for n in np.flatnonzero(is_both):
            behind[n] = _pixels([_altered(stills[n], seeds[n])[0]], size)[0]
        both = ((right, backgrounds), (altered, behind))
        found.append([_features(translator, _drifted(*each, drift, rng)) for each in both])
    return _Part(found, classes, units)


def _altered(frame: np.ndarray, seed: int) -> tuple[np.ndarray, OODClass]:
    """A wrong frame made of a right one. One seed alters every frame in the same way."""
    return wrong_frame(frame, np.random.default_rng(seed))


def _has_one_light(info: DatasetInfo) -> bool:
    """Whether the light of all units is near that of one optics file."""
    return info.recipe is not None and info.recipe.light.optics is not None


def _drifted(
    images: np.ndarray, backgrounds: np.ndarray, drift: float, rng: np.random.Generator
) -> np.ndarray:
    """(R, S, S, 6) uint8: images and their background frames, with the drift of `augment`."""
    both = np.concatenate([images, backgrounds], axis=-1)
    if drift == 0:
        return both
    varied = augment(torch.from_numpy(both / np.float32(255.0)), rng, 0.0, 0.0, 0.0, drift)
    return (varied * 255.0).round().to(torch.uint8).numpy()


def _pixels(frames: Sequence[np.ndarray], size: int) -> np.ndarray:
    return np.stack([to_pixels(Image.fromarray(frame), size, grey=False) for frame in frames])


def _features(translator: FieldTranslator, pixels: np.ndarray) -> torch.Tensor:
    parts = [pixels[start : start + BATCH_SIZE] for start in range(0, len(pixels), BATCH_SIZE)]
    inputs = (to_input(part.astype(np.float32) / 255.0) for part in parts)
    return torch.cat([translator.frame_features(each).cpu() for each in inputs])


def _trained(parts: Sequence[_Part], seed: int) -> FrameCheck:
    """The check, with its limits."""
    _, units = np.unique([unit for part in parts for unit in part.units], return_inverse=True)
    if units.max() < MIN_UNITS:  # frames of the same units are held out then
        units = np.arange(units.size)
    kinds = np.concatenate([part.kinds for part in parts])
    order = np.random.default_rng(seed).permutation(units.max() + 1)
    own = ~np.isin(units, order[: max(1, round(HELD_OUT_SHARE * order.size))])
    features = [
        [torch.cat([part.features[mode][n] for part in parts]) for n in (0, 1)]
        for mode in range(len(parts[0].features))
    ]
    inputs, classes = [], []
    for mode, (right, wrong) in enumerate(features):
        # Without a background frame, one of another unit cannot be seen.
        seen = kinds != CLASSES.index(OODClass.UNLIKE_BACKGROUND)
        used = own if mode == WITH else own & seen
        inputs += [right[torch.from_numpy(own)], wrong[torch.from_numpy(used)]]
        classes += [torch.zeros(own.sum(), dtype=torch.int64), torch.from_numpy(kinds[used])]
    check = FrameCheck(features[WITHOUT][0].shape[1])
    right = features[WITHOUT][0][torch.from_numpy(own)]
    check.center.copy_(right.mean(dim=0))
    check.scale.copy_(right.std(dim=0).clamp(min=MIN_SCALE))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for layer in (check.hidden, check.logits):
            layer.reset_parameters()
        _train(check, torch.cat(inputs), torch.cat(classes))
    check.eval()
    with torch.inference_mode():
        for mode, (right, _) in enumerate(features):
            found = scores(check(right[torch.from_numpy(~own)]))
            check.set_limit(mode, found, REFUSED_SHARES[mode])
    return check


def _train(check: FrameCheck, inputs: torch.Tensor, classes: torch.Tensor) -> None:
    optimizer = torch.optim.AdamW(check.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    steps = EPOCHS * -(-len(inputs) // BATCH)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    check.train()
    for _ in range(EPOCHS):
        for batch in torch.randperm(len(inputs)).split(BATCH):
            optimizer.zero_grad()
            nn.functional.cross_entropy(check(inputs[batch]), classes[batch]).backward()
            optimizer.step()
            schedule.step()
