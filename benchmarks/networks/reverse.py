"""Accuracy of DIGIT images that are predicted from 20 counts.

    t2twin train touch2touch --direction counts-to-image --data data/paper --steps 6000 --out RUN
    python -m benchmarks.networks.reverse RUN --data data/paper

The run is compared with three baselines: the mean image of the training pairs, the image of the
training pair with the nearest counts (Euclidean), and the background image. Scores are
those of the contact region, on the validation and test splits, with intervals over shapes. Writes
docs/pictures/reverse.png (module reverse_images).
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image
from scipy.spatial import KDTree

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.core.errors import T2TwinError
from t2twin.core.files import atomic_write
from t2twin.sim.sensors.pair import SensorPair

if TYPE_CHECKING:
    from benchmarks.networks.image_metrics import ImageFigures
    from t2twin.translate.data.pairs import Pairs

BENCHMARK = Benchmark(
    module="benchmarks.networks.reverse",
    measures="Accuracy of DIGIT images predicted from 20 counts.",
    minutes=2,
    sources=("primitives_cad", "sim", "translate"),
    figures=tuple(
        figure
        for split in ("val", "test")
        for figure in (
            Figure(f"{split}.rows.*.overall.psnr_contact_db", "dB"),
            Figure(f"{split}.rows.*.overall.ssim_contact"),
            Figure(f"{split}.rows.*.overall.rmse_percent", "%"),
            Figure(f"{split}.over_nearest.overall.psnr_contact_db", "dB"),
            Figure(f"{split}.over_nearest.overall.ssim_contact"),
            Figure(f"{split}.contact_percent", "%"),
        )
    ),
    arguments=(
        Argument("run", "folder of t2twin train --direction counts-to-image", Path),
        Argument("--data", "the dataset", Path, required=True, metavar="DIR"),
    ),
)

SPLITS = ("val", "test")

NETWORK, NEAREST, MEAN, BACKGROUND = "network", "nearest_neighbor", "mean_image", "background_frame"
"""The rows."""


def measure(options: Namespace) -> dict[str, Any]:
    from benchmarks.networks.image_metrics import (
        CONTACT_GREY,
        DETAILS_MM,
        compare_images,
        explained_by_detail,
        in_contact,
    )
    from benchmarks.networks.reverse_images import PICTURE, Split, draw
    from t2twin.translate.data.images import to_pixels
    from t2twin.translate.data.pairs import load_info, load_pairs
    from t2twin.translate.evaluation.evaluate import training_steps
    from t2twin.translate.inference.load import load
    from t2twin.translate.inference.picture_predictor import ImagePredictor
    from t2twin.translate.inference.predictor import require

    run = require(load(options.run), ImagePredictor, "the benchmark")
    if load_info(options.data).sha256 != run.config.data.sha256:
        raise T2TwinError(f"{options.data} is not the data set that {options.run} was trained on")
    size = run.config.preset.size
    train, *rest = (load_pairs(options.data, s, size, grey=True) for s in ("train", *SPLITS))
    mean = _mean(train)
    frame = Image.fromarray(SensorPair().camera.background_frame())
    background = to_pixels(frame, size, grey=True)[..., 0]
    mm_per_px = _mm_per_px(run.config.data.camera.view_mm, size)
    content, splits = {}, []
    for split, pairs in zip(SPLITS, rest, strict=True):
        real = pairs.images[:][..., 0]
        rows = {
            NETWORK: run.predict_image(pairs.counts),
            NEAREST: _nearest(train, pairs),
            MEAN: np.broadcast_to(mean, real.shape),
            BACKGROUND: np.broadcast_to(background, real.shape),
        }
        figures = {name: compare_images(row, real, background) for name, row in rows.items()}
        content[split] = _figures(figures, pairs) | {
            "contact_percent": 100.0 * float(in_contact(real, background).mean()),
            "explained": {
                name: explained_by_detail(rows[name], real, mean, mm_per_px)
                for name in (NETWORK, NEAREST)
            },
        }
        psnr_db = {name: one.psnr_contact_db for name, one in figures.items()}
        splits.append(Split(split, pairs, real, rows, psnr_db))
    if not options.keep_nothing:
        with atomic_write(PICTURE) as temporary:
            temporary.write_bytes(draw(splits, run.config.data))
    return content | {
        "pairs": {"train": len(train), **{s: len(p) for s, p in zip(SPLITS, rest, strict=True)}},
        "size_px": size,
        "contact_grey": CONTACT_GREY,
        "details_mm": DETAILS_MM,
        "steps": training_steps(run, len(train)),
    }


def _figures(figures: Mapping[str, ImageFigures], pairs: Pairs) -> dict[str, Any]:
    """Scores with their intervals, and the network's less those of the nearest neighbor."""
    from benchmarks.networks.image_metrics import intervals, replicates, scores

    resampled = {name: replicates(one, pairs.shapes) for name, one in figures.items()}
    rows = {name: asdict(scores(one)) for name, one in figures.items()}
    over = {name: rows[NETWORK][name] - value for name, value in rows[NEAREST].items()}
    apart = {name: values - resampled[NEAREST][name] for name, values in resampled[NETWORK].items()}
    return {
        "rows": {n: {"overall": rows[n], "interval": intervals(resampled[n])} for n in rows},
        "over_nearest": {"overall": over, "interval": intervals(apart)},
    }


def _mean(train: Pairs) -> np.ndarray:
    """(S, S) uint8: the training's mean picture."""
    return np.rint(train.images[:][..., 0].mean(axis=0, dtype=float)).astype(np.uint8)


def _nearest(train: Pairs, pairs: Pairs) -> np.ndarray:
    """(P, S, S) uint8: the pictures of the training pairs with the nearest counts."""
    index = np.asarray(KDTree(train.counts).query(pairs.counts)[1])
    return train.images[index][..., 0]


def _mm_per_px(view_mm: tuple[float, float], size: int) -> tuple[float, float]:
    """Millimeters that a row and a column of a square picture are apart. view_mm: half of what it
    shows along x and y."""
    half_width, half_height = view_mm
    return 2 * half_height / size, 2 * half_width / size


if __name__ == "__main__":
    main(BENCHMARK)
