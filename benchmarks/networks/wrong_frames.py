"""Wrong frames that a field run names, and right frames that it takes for wrong.

    python -m benchmarks wrong_frames --data data/sampled-units

The dataset of 200 sampled units is made first if it is missing. Each of its frames is given as it
is, and changed in each of the ways in the table. It has the unit's background frame, the same
changed in the same way, or none. The frame check of the run was not trained on two of these ways: a
page of text, and dead leaves (Lee, Mumford and Huang 2001, a model of photographs).
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image, ImageDraw

from benchmarks.evidence import Argument, Benchmark, Figure

if TYPE_CHECKING:
    from t2twin.translate.inference.predictor import TrainedTranslator

Frames = list[np.ndarray]

BENCHMARK = Benchmark(
    module="benchmarks.networks.wrong_frames",
    minutes=8,
    sources=("sim", "translate"),
    figures=(
        Figure("right.with_percent", "%", most=1.0),
        Figure("right.without_percent", "%", most=1.0),
        Figure("mean.with_percent", "%", least=95.0),
        Figure("mean.without_percent", "%", least=95.0),
        Figure("mean.both_percent", "%"),
        Figure("other_unit.with_percent", "%", least=95.0),
        Figure("touched_background.with_percent", "%", least=95.0),
        Figure("wrong.*.with_percent", "%"),
        Figure("wrong.*.without_percent", "%"),
        Figure("wrong.*.both_percent", "%"),
    ),
    arguments=(
        Argument("--run", "field run, by default the pretrained one", default="field"),
        Argument("--data", "dataset of sampled units", Path, required=True, metavar="DIR"),
    ),
)

RECIPE = Path(__file__).with_name("sampled-units.toml")

TOUCHED_N = 1.0
"""Force from which a frame is a wrong background frame (assumed), N."""

LEAVES = 400
"""Disks of one image of dead leaves (assumed: they cover it)."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.core.images import decode_png
    from t2twin.sim.dataset.columns import BACKGROUND, IMAGE, column
    from t2twin.sim.dataset.generate import make_dataset
    from t2twin.sim.dataset.store import iter_images, read_info, read_split, split_shards
    from t2twin.translate.inference.load import load_run

    make_dataset(options.data, recipe=RECIPE)
    run = load_run(options.run)
    info = read_info(options.data)
    role = info.role_of(IMAGE)
    frames, backgrounds = (
        [
            decode_png(png)
            for shard in split_shards(info, "train")
            for png in iter_images(options.data, shard, column(role, name))
        ]
        for name in (IMAGE, BACKGROUND)
    )
    wrong = {name: _named(run, alter, frames, backgrounds) for name, alter in kinds().items()}
    modes = ("with_percent", "without_percent", "both_percent")
    means = {mode: float(np.mean([each[mode] for each in wrong.values()])) for mode in modes}
    found: dict[str, Any] = {"frames": len(frames), "wrong": wrong, "mean": means}
    others = backgrounds[1:] + backgrounds[:1]
    found["other_unit"] = {"with_percent": _share(run, frames, others)}
    forces_n = read_split(options.data, "train", ["force_n"])["force_n"].to_numpy()
    touched = [index for index, force_n in enumerate(forces_n) if force_n >= TOUCHED_N]
    swapped = ([each[index] for index in touched] for each in (backgrounds, frames))
    found["touched_background"] = {"with_percent": _share(run, *swapped)}
    found["right"] = _named(run, _as_it_is, frames, backgrounds)
    return found


Alter = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def kinds() -> dict[str, Alter]:
    """The ways to make a wrong frame, (h, w, 3) uint8, by name."""
    from t2twin.translate.training import fit_frame_check as ways

    def transform(undo: Callable[[np.ndarray], np.ndarray]) -> Alter:
        return lambda frame, _: np.ascontiguousarray(undo(frame[None])[0])

    kinds = ("cropped", "grey", "defocused", "saturated", "noise", "noise like photographs'")
    return {
        **{str(kind): transform(undo) for kind, undo in ways.FORWARD.items()},
        **{kind: ways.ALTERATIONS[kind] for kind in kinds},
        "dead leaves": _dead_leaves,
        "gradient": ways.gradient,
        "drawing": ways.drawing,
        "page of text": _page,
    }


def _as_it_is(frame: np.ndarray, _: np.random.Generator) -> np.ndarray:
    return frame


def _named(
    run: TrainedTranslator, alter: Alter, frames: Frames, backgrounds: Frames
) -> dict[str, float]:
    """Share of frames that are named when altered, with and without background frame, and with one
    that is altered in the same way, %."""
    altered, behind = (
        [
            np.ascontiguousarray(alter(frame, np.random.default_rng((0, number))))
            for number, frame in enumerate(each)
        ]
        for each in (frames, backgrounds)
    )
    return {
        "with_percent": _share(run, altered, backgrounds),
        "without_percent": _share(run, altered, None),
        "both_percent": _share(run, altered, behind),
    }


def _share(run: TrainedTranslator, frames: Frames, backgrounds: Frames | None) -> float:
    from t2twin.translate.uncertainty.ood import OODClass

    if backgrounds is None:
        classes = run.classify_frames(frames)
    else:
        pairs = zip(frames, backgrounds, strict=True)
        classes = [run.classify_frames(frame, background)[0] for frame, background in pairs]
    return 100.0 * float(np.mean([each != OODClass.IN_DISTRIBUTION for each in classes]))


def _dead_leaves(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Disks in front of each other, whose radii have a density of the power -3."""
    rows, columns = frame.shape[:2]
    image = Image.new("RGB", (columns, rows))
    draw = ImageDraw.Draw(image)
    least, most = 4.0, 0.5 * columns
    for share in rng.random(LEAVES):
        radius = (least**-2 + share * (most**-2 - least**-2)) ** -0.5
        x, y = rng.uniform((0, 0), (columns, rows))
        color = tuple(map(int, rng.integers(0, 256, 3)))
        draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=color)
    return np.asarray(image)


def _page(frame: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Dark lines of letters on white."""
    rows, columns = frame.shape[:2]
    image = Image.new("RGB", (columns, rows), (250, 250, 245))
    draw = ImageDraw.Draw(image)
    for top in range(4, rows, 13):
        draw.text((4, top), "".join(map(chr, rng.integers(97, 122, columns // 6))), fill=(20,) * 3)
    return np.asarray(image)
