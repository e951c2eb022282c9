"""Effect of a soft IoU loss of the tactile image on touch2touch.

    t2twin train touch2touch --data data/paper --epochs 3 --seed 0 --out plain-0
    t2twin train touch2touch --data data/paper --epochs 3 --seed 0 --iou-weight W --out shaped-0
    python -m benchmarks.networks.shape_loss --plain plain-0 ... --shaped shaped-0 ... \
        --data data/paper

The runs have the same seeds, steps and data; only the weight differs. Every figure is given for
each run and as the mean over the seeds. The gain is the difference of the means, with a bootstrap
interval over the shapes.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.evidence.record import Argument, Benchmark, Figure
from benchmarks.evidence.run import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.taxels.phi import Phi

if TYPE_CHECKING:
    from t2twin.translate.data.pairs import Pairs
    from t2twin.translate.inference.predictor import CountsPredictor
    from t2twin.translate.runs.config import RunConfig

BENCHMARK = Benchmark(
    module="benchmarks.networks.shape_loss",
    measures="Effect of a soft IoU loss of the tactile image on touch2touch.",
    minutes=4,
    sources=("primitives_cad", "sim", "translate"),
    figures=tuple(
        Figure(f"{split}.{part}.{name}", unit)
        for split in ("val", "test")
        for part in ("plain.mean", "shaped.mean", "gain.overall")
        for name, unit in (("contact_iou", ""), ("ssim", ""), ("rmse_percent", "%"))
    ),
    arguments=(
        Argument("--plain", "runs without", Path, nargs="+", required=True, metavar="RUN"),
        Argument("--shaped", "the same with", Path, nargs="+", required=True, metavar="RUN"),
        Argument("--data", "the dataset", Path, required=True, metavar="DIR"),
    ),
)

SPLITS = ("val", "test")

FIGURES = ("contact_iou", "ssim", "ssim_contact", "rmse_percent", "rmse_counts")
"""Of evaluation.records.Figures."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.translate.data.pairs import load_pairs
    from t2twin.translate.evaluation.evaluate import training_steps
    from t2twin.translate.inference.load import load_run

    plain, shaped = ([load_run(f) for f in each] for each in (options.plain, options.shaped))
    _check_alike(plain, shaped, options.data)
    preset = shaped[0].config.preset
    content: dict[str, Any] = {}
    for split in SPLITS:
        pairs = load_pairs(options.data, split, preset.size, preset.grey)
        content[split] = _split(plain, shaped, pairs)
    return content | {
        "seeds": [run.config.seed for run in plain],
        "shape_weight": preset.iou_weight,
        "l1_weight": preset.l1_weight,
        "steps": [training_steps(run, run.config.data.train_pairs) for run in (*plain, *shaped)],
    }


def _split(
    plain: Sequence[CountsPredictor], shaped: Sequence[CountsPredictor], pairs: Pairs
) -> dict[str, Any]:
    """Both kinds' figures of each run and their means, and what the loss brings."""
    from t2twin.translate.evaluation.array_errors import interval

    content, resampled = {}, {}
    for kind, runs in (("plain", plain), ("shaped", shaped)):
        each, of_runs = zip(*(_figures(run, pairs) for run in runs), strict=True)
        content[kind] = {
            "runs": list(each),
            "mean": {name: float(np.mean([one[name] for one in each])) for name in FIGURES},
        }
        resampled[kind] = {
            name: np.mean([one[name] for one in of_runs], axis=0) for name in FIGURES
        }
    means = [content[kind]["mean"] for kind in ("shaped", "plain")]
    gains = {name: resampled["shaped"][name] - resampled["plain"][name] for name in FIGURES}
    found = {name: interval(values) for name, values in gains.items()}
    return content | {
        "gain": {
            "overall": {name: means[0][name] - means[1][name] for name in FIGURES},
            "interval": {
                n: None if one is None else (one.low, one.high) for n, one in found.items()
            },
        }
    }


def _figures(run: CountsPredictor, pairs: Pairs) -> tuple[dict[str, float], Any]:
    """A run's figures, and the same in the resamples of the shapes."""
    from t2twin.translate.evaluation.array_errors import compare, replicates

    data = run.config.data.array
    predicted = run.predict_pixels(pairs.images, progress=run.run_dir.name)
    figures = compare(predicted, pairs.counts, Phi(data.x_mm, data.y_mm), data.full_scale_counts)
    overall = figures.summary(data.full_scale_counts)
    return (
        {name: getattr(overall, name) for name in FIGURES},
        replicates(figures, pairs.shapes, data.full_scale_counts),
    )


def _check_alike(
    plain: Sequence[CountsPredictor], shaped: Sequence[CountsPredictor], data: Path
) -> None:
    """Raises T2TwinError for runs that differ in more than the weight."""
    from t2twin.translate.data.pairs import load_info

    if len(plain) != len(shaped):
        raise T2TwinError(f"there are {len(plain)} runs without and {len(shaped)} with; pair them")
    weight, sha256 = shaped[0].config.preset.iou_weight, load_info(data).sha256
    for one, other in zip(plain, shaped, strict=True):
        if one.config.preset.iou_weight or other.config.preset.iou_weight != weight or not weight:
            raise T2TwinError(
                f"{one.run_dir} must have no shape weight, {other.run_dir} {weight:g}"
            )
        if _but_for_the_weight(one.config) != _but_for_the_weight(other.config):
            raise T2TwinError(
                f"{one.run_dir} and {other.run_dir} differ in more than the shape weight"
            )
        if one.config.data.sha256 != sha256:
            raise T2TwinError(f"{data} is not the data set that {one.run_dir} was trained on")


def _but_for_the_weight(config: RunConfig) -> tuple[Any, ...]:
    preset = replace(config.preset, iou_weight=0.0)
    return preset, config.model, config.seed, config.planned_epochs, config.epoch_steps


if __name__ == "__main__":
    main(BENCHMARK)
