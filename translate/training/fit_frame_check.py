"""Trains the frame check of a field run (models.frame_check) on the frames of a dataset.

Right frames, and wrong ones made of them, are each given with the unit's background frame and with
the run's mean frame. A right frame with another unit's background frame is wrong too, unless all
units are near that of one optics file. The limits are set on units that the check was not trained
on. The second network is trained on frames as they are and transformed.

Shape letters: R right frames, n features, B images, S image side of the run, h rows, w columns.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from hashlib import sha256
from pathlib import Path
from typing import cast

import numpy as np
import torch
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter
from torch import nn
from torch.nn import functional

from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.dataset.columns import BACKGROUND, IMAGE, column
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import augment, resized, to_input
from t2twin.translate.data.pairs import has_backgrounds, load_pairs, usable_cache
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.frame_check import (
    CLASSES,
    SIDE,
    TRANSFORMED,
    WITH,
    FrameCheck,
    TransformNet,
    scores,
)
from t2twin.translate.runs.checkpoint import build, load_weights, save_weights
from t2twin.translate.runs.config import BEST, FRAME_CHECK, RunConfig, load_config
from t2twin.translate.uncertainty.ood import INVERSE_TRANSFORMS, OODClass

Alter = Callable[[np.ndarray, np.random.Generator], np.ndarray]  # Of a right frame, (h, w, 3)
# Shares of the wrong frames (assumed): transformed, the most frequent mistake of users; altered as
# their background frame, as users do; right but for their background frame
TRANSFORM_SHARE, BOTH_SHARE, OTHER_UNIT_SHARE = 0.5, 0.5, 0.12
# The transforms themselves; only the rotations are not their own inverse
FORWARD = INVERSE_TRANSFORMS | {
    OODClass.ROTATED_LEFT: INVERSE_TRANSFORMS[OODClass.ROTATED_RIGHT],
    OODClass.ROTATED_RIGHT: INVERSE_TRANSFORMS[OODClass.ROTATED_LEFT],
}


def wrong_frame(frame: np.ndarray, seed: int) -> tuple[np.ndarray, OODClass]:
    """A wrong frame made of a right one, (h, w, 3) uint8 of any h and w, and its class. One seed
    alters every frame in the same way."""
    rng = np.random.default_rng(seed)
    if rng.random() < TRANSFORM_SHARE:
        kind = list(FORWARD)[rng.integers(len(FORWARD))]
        return np.ascontiguousarray(FORWARD[kind](frame[None])[0]), kind
    alter = list(ALTERATIONS.values())[rng.integers(len(ALTERATIONS))]
    return np.ascontiguousarray(alter(frame, rng)), OODClass.OTHER


def cropped(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A part of the same aspect, at any place."""
    share = rng.uniform(0.4, 0.85)
    rows, columns = (round(share * side) for side in frame.shape[:2])
    top, left = rng.integers(frame.shape[0] - rows), rng.integers(frame.shape[1] - columns)
    return frame[top : top + rows, left : left + columns]


def rolled(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Shifted, with what leaves the image on one side on the other."""
    steps = [int(rng.uniform(0.125, 0.875) * side) for side in frame.shape[:2]]
    return np.roll(frame, steps, axis=(0, 1))


def spectral(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Noise whose amplitudes fall with a power of the frequency, as those of photographs do."""
    rows, columns = frame.shape[:2]
    frequency = np.hypot(np.fft.fftfreq(rows)[:, None], np.fft.fftfreq(columns))
    frequency[0, 0] = 1.0 / max(rows, columns)
    power, share = rng.uniform(0.3, 1.8), rng.uniform()

    def drawn() -> np.ndarray:
        white = np.fft.fft2(rng.standard_normal((rows, columns)))
        values = np.fft.ifft2(white / frequency**power).real
        return values / values.std()

    common = drawn()
    colors = np.stack([share * common + (1.0 - share) * drawn() for _ in range(3)], axis=-1)
    grey = rng.uniform(50.0, 180.0, 3) + rng.uniform(8.0, 70.0) * colors
    return np.clip(grey, 0, 255).astype(np.uint8)


def gradient(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A color in each corner, interpolated, with some noise."""
    corners = rng.uniform(0.0, 255.0, (2, 2, 3))
    down, across = (np.linspace(0.0, 1.0, side) for side in frame.shape[:2])
    lines = (1.0 - down)[:, None, None] * corners[0] + down[:, None, None] * corners[1]
    grey = (1.0 - across)[:, None] * lines[:, None, 0] + across[:, None] * lines[:, None, 1]
    grey += rng.uniform(0.0, 4.0) * rng.standard_normal(grey.shape)
    return np.clip(grey, 0, 255).astype(np.uint8)


def drawing(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rectangles, ellipses, lines and text on an even ground, more or less sharp."""

    def color() -> tuple[int, ...]:
        return tuple(map(int, rng.integers(0, 256, 3)))

    rows, columns = frame.shape[:2]
    image = Image.new("RGB", (columns, rows), color())
    draw = ImageDraw.Draw(image)
    for _ in range(rng.integers(3, 25)):
        x, y = np.sort(rng.integers(0, (columns, rows), (2, 2)), axis=0).T.tolist()
        box = (x[0], y[0], x[1] + 1, y[1] + 1)
        match rng.integers(4):
            case 0:
                draw.rectangle(box, fill=color())
            case 1:
                draw.ellipse(box, fill=color())
            case 2:
                draw.line(box, fill=color(), width=int(rng.integers(1, 6)))
            case _:
                letters = "".join(map(chr, rng.integers(48, 122, 20)))
                draw.text(box[:2], letters, fill=color())
    return gaussian_filter(np.asarray(image), rng.uniform(0.0, 2.0), axes=(0, 1))


# Channels exchanged, other than blue with red
ORDERS = ((1, 0, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1))
# Makers of other wrong frames; their limits are assumed: what a user would call another frame
ALTERATIONS: dict[str, Alter] = {
    "cropped": cropped,
    "rolled": rolled,
    "defocused": lambda frame, rng: gaussian_filter(
        frame, rng.uniform(0.012, 0.04) * len(frame), axes=(0, 1)
    ),
    "saturated": lambda frame, rng: np.clip(frame * rng.uniform(1.8, 4.0), 0, 255).astype(np.uint8),
    "dark": lambda frame, rng: (frame * rng.uniform(0.08, 0.3)).astype(np.uint8),
    "grey": lambda frame, _: np.repeat(frame.mean(-1, keepdims=True), 3, axis=-1).astype(np.uint8),
    "negative": lambda frame, _: 255 - frame,
    "other channels": lambda frame, rng: frame[..., ORDERS[rng.integers(len(ORDERS))]],
    "noise": lambda frame, rng: rng.integers(0, 256, frame.shape, dtype=np.uint8),
    "noise like photographs'": spectral,
    "gradient": gradient,
    "drawing": drawing,
}

# Right frames that the check is trained on, at most (assumed: a few minutes of a core)
MAX_FRAMES = 5000
MIN_FRAMES = 300  # Right frames without which a run has no check (assumed)
MAX_SHARDS = 40  # Shards that they are read from, at most (assumed)
HELD_OUT_SHARE = 0.2  # Share of the units that the limits are set on
MIN_UNITS = 10  # Units below which frames are held out, and not units (assumed)
# Share of these units' right frames that is above the limits, without and with a background frame
# (assumed: less than one percent, as other statistics refuse some too)
REFUSED_SHARES = (0.003, 0.003)
EPOCHS, BATCH, LEARNING_RATE, WEIGHT_DECAY = 30, 128, 2e-3, 0.1  # Of the training (assumed)
MIN_SCALE = 0.01  # Minimum standard deviation of a feature (assumed)
MAX_TRANSFORM_FRAMES = 30_000  # Training frames, at most (assumed: five minutes of a core)
# Of its training: epochs, largest learning rate, and share of its increase (assumed)
TRANSFORM_EPOCHS, TRANSFORM_RATE, WARM_UP = 12, 4e-3, 0.2
TRANSFORMED_SHARE = 0.5  # Share of the frames that are transformed (assumed)
# Share of the validation frames above the limit, and a margin that is added (assumed). Without it,
# 2 % of the right frames of used units are refused
TRANSFORM_REFUSED, MARGIN = 0.002, 1.5
BATCH_SIZE = 64  # Frames whose features are computed together; bounds memory


# Features of right frames of a shard and of a wrong one made of each, (R, n), without and with
# background frames; the classes of the wrong ones, (R,), and the units of the right ones
Part = tuple[list[list[torch.Tensor]], np.ndarray, list[bytes]]


def fit_frame_check(run_dir: Path, data_dir: Path) -> None:
    """Writes the frame check of a field run that has none, if the dataset is large enough."""
    info, config = read_info(data_dir), load_config(run_dir)
    done = not config.has_uncertainty or (run_dir / FRAME_CHECK).is_file()
    if done or info.pairs["train"] < MIN_FRAMES:
        return
    translator = cast(FieldTranslator, build(config))
    load_weights(run_dir / BEST, translator.predictor)
    rng = np.random.default_rng(config.seed)
    shards = split_shards(info, "train")
    chosen = np.unique(np.linspace(0, len(shards) - 1, MAX_SHARDS).astype(int))
    each = -(-MAX_FRAMES // chosen.size)
    bar = Progress(chosen, desc="frame check", unit="shard")
    parts = [_part(translator, config, data_dir, shards[n], info, each, rng) for n in bar]
    check = _trained(parts, config.seed)
    _fit_transform_net(check, config, data_dir, run_dir)
    save_weights(run_dir / FRAME_CHECK, check.state_dict())


def _part(
    translator: FieldTranslator, config: RunConfig, data_dir: Path, shard: str, info: DatasetInfo,
    limit: int, rng: np.random.Generator,
) -> Part:  # fmt: skip
    """Of at most `limit` right frames of a shard, evenly spread."""
    size, drift = config.preset.size, config.preset.drift
    columns = [IMAGE, BACKGROUND] if has_backgrounds(info) else [IMAGE]
    stored = [
        list(iter_images(data_dir, shard, column(info.role_of(IMAGE), name))) for name in columns
    ]
    count = len(stored[0])
    rows = np.unique(np.linspace(0, count - 1, min(limit, count)).astype(int))
    pngs = [[each[row] for row in rows] for each in stored]
    units = [sha256(png).digest() for png in pngs[-1]]
    frames, *stills = ([decode_png(png) for png in each] for each in pngs)
    seeds = rng.integers(2**32, size=len(frames)).tolist()
    made = [wrong_frame(frame, seed) for frame, seed in zip(frames, seeds, strict=True)]
    classes = np.array([CLASSES.index(kind) for _, kind in made])
    right, altered = (resized(each, size, False) for each in (frames, [each for each, _ in made]))
    found = [[_features(translator, each) for each in (right, altered)]]
    if stills:
        backgrounds = resized(stills[0], size, False)
        others = rng.permutation(len(frames))
        differs = np.array([units[n] != units[other] for n, other in enumerate(others)])
        # An optics file: the light of all units is near its own.
        differs &= info.recipe is None or info.recipe.light.optics is None
        is_other = differs & (rng.random(len(frames)) < OTHER_UNIT_SHARE)
        classes[is_other] = CLASSES.index(OODClass.UNLIKE_BACKGROUND)
        altered[is_other] = right[is_other]
        behind = backgrounds[np.where(is_other, others, np.arange(len(frames)))]
        is_both = ~is_other & (rng.random(len(frames)) < BOTH_SHARE)
        for n in np.flatnonzero(is_both):
            behind[n] = resized([wrong_frame(stills[0][n], seeds[n])[0]], size, False)[0]
        pairs = [
            np.concatenate(each, axis=-1) for each in ((right, backgrounds), (altered, behind))
        ]
        if drift > 0:
            floats = (torch.from_numpy(each / np.float32(255.0)) for each in pairs)
            varied = (augment(each, rng, 0.0, 0.0, 0.0, drift) for each in floats)
            pairs = [(each * 255.0).round().to(torch.uint8).numpy() for each in varied]
        found.append([_features(translator, each) for each in pairs])
    return found, classes, units


def _features(translator: FieldTranslator, pixels: np.ndarray) -> torch.Tensor:
    parts = [pixels[start : start + BATCH_SIZE] for start in range(0, len(pixels), BATCH_SIZE)]
    inputs = (to_input(part.astype(np.float32) / 255.0) for part in parts)
    return torch.cat([translator.outputs(each, False, True)["features"].cpu() for each in inputs])


def _trained(parts: Sequence[Part], seed: int) -> FrameCheck:
    """The check, with its limits."""
    _, units = np.unique([unit for part in parts for unit in part[2]], return_inverse=True)
    if units.max() < MIN_UNITS:  # frames of the same units are held out then
        units = np.arange(units.size)
    kinds = torch.from_numpy(np.concatenate([part[1] for part in parts]))
    order = np.random.default_rng(seed).permutation(units.max() + 1)
    held_out = order[: max(1, round(HELD_OUT_SHARE * order.size))]
    own = torch.from_numpy(~np.isin(units, held_out))
    features = [
        [torch.cat(each) for each in zip(*(part[0][mode] for part in parts), strict=True)]
        for mode in range(len(parts[0][0]))
    ]
    # Without a background frame, one of another unit cannot be seen.
    seen = kinds != CLASSES.index(OODClass.UNLIKE_BACKGROUND)
    inputs, classes = [], []
    for mode, (right, wrong) in enumerate(features):
        used = own if mode == WITH else own & seen
        inputs += [right[own], wrong[used]]
        classes += [torch.zeros_like(kinds[own]), kinds[used]]
    check = FrameCheck(inputs[0].shape[1])
    check.center.copy_(inputs[0].mean(dim=0))
    check.scale.copy_(inputs[0].std(dim=0).clamp(min=MIN_SCALE))
    known, labels = torch.cat(inputs), torch.cat(classes)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        for layer in (check.hidden, check.logits):
            layer.reset_parameters()
        optimizer = torch.optim.AdamW(check.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY)
        steps = EPOCHS * -(-len(known) // BATCH)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        batches = (each for _ in range(EPOCHS) for each in torch.randperm(len(known)).split(BATCH))
        _descend(check, optimizer, schedule, ((known[batch], labels[batch]) for batch in batches))
    with torch.inference_mode():
        for mode, (right, _) in enumerate(features):
            check.set_limit(mode, scores(check(right[~own])), REFUSED_SHARES[mode])
    return check


def _descend(
    network: nn.Module, optimizer: torch.optim.Optimizer,
    schedule: torch.optim.lr_scheduler.LRScheduler,
    batches: Iterable[tuple[torch.Tensor, torch.Tensor]],
) -> None:  # fmt: skip
    """Trains a network on the classes of inputs; in evaluation mode afterwards."""
    network.train()
    for inputs, classes in batches:
        optimizer.zero_grad()
        functional.cross_entropy(network(inputs), classes).backward()
        optimizer.step()
        schedule.step()
    network.eval()


def _fit_transform_net(check: FrameCheck, config: RunConfig, data_dir: Path, run_dir: Path) -> None:
    """Trains the second network of a frame check and sets its limit, in place."""
    preset, rng = config.preset, np.random.default_rng(config.seed)
    frames, held_out = (
        _small_frames(data_dir, split, preset.size, usable_cache(data_dir, run_dir))
        for split in ("train", "val")
    )
    if len(held_out) == 0:
        return
    parts = -(-len(frames) // BATCH)

    def batches() -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        """A share of the frames transformed, and the indices of their classes."""
        for _ in Progress(range(TRANSFORM_EPOCHS), desc="frame check", unit="epoch"):
            for chosen in np.array_split(rng.permutation(len(frames)), parts):
                pixels = frames[chosen].astype(np.float32)
                which = rng.integers(1, 1 + len(FORWARD), len(pixels))
                which[rng.random(len(pixels)) >= TRANSFORMED_SHARE] = 0
                for n, kind in enumerate(CLASSES):
                    if kind in FORWARD:
                        pixels[which == n] = FORWARD[kind](pixels[which == n])
                varied = augment(
                    torch.from_numpy(pixels), rng, preset.brightness, preset.contrast, preset.noise
                )
                yield to_input(varied), torch.from_numpy(which)

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        check.transforms = network = TransformNet()
        optimizer = torch.optim.AdamW(network.parameters(), weight_decay=WEIGHT_DECAY)
        schedule = torch.optim.lr_scheduler.OneCycleLR(
            optimizer, TRANSFORM_RATE, TRANSFORM_EPOCHS * parts, pct_start=WARM_UP
        )
        _descend(network, optimizer, schedule, batches())
    with torch.inference_mode():
        found = scores(network(to_input(held_out.astype(np.float32))))
    check.set_limit(TRANSFORMED, found, TRANSFORM_REFUSED, MARGIN)


def _small_frames(data_dir: Path, split: str, size: int, cache_dir: Path) -> np.ndarray:
    """(B, SIDE, SIDE, 3) float16 frames of a split in [0, 1], at most MAX_TRANSFORM_FRAMES."""
    pairs = load_pairs(data_dir, split, size, False, cache_dir)
    count = len(pairs)
    rows = np.unique(np.linspace(0, count - 1, min(MAX_TRANSFORM_FRAMES, count)).astype(int))
    small = np.empty((rows.size, SIDE, SIDE, 3), np.float16)
    for start in range(0, rows.size, BATCH):
        part = slice(start, start + BATCH)
        pixels = torch.from_numpy(pairs.inputs[rows[part]]).permute(0, 3, 1, 2).float() / 255.0
        small[part] = functional.adaptive_avg_pool2d(pixels, SIDE).permute(0, 2, 3, 1)
    return small
