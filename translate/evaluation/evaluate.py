"""The paper's table and what it lacks: every run, trivial predictors and floors on one split."""

from pathlib import Path
from typing import Any

import numpy as np

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.writing import whole_file, write_json
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import PRESS, DataInfo, Pairs, load_info, load_pairs, usable_cache
from t2twin.translate.evaluation import bootstrap
from t2twin.translate.evaluation.baselines import (
    FEATURE_SIZE,
    MEAN_ARRAY,
    NEAREST_NEIGHBOUR,
    Neighbours,
    mean_array,
    neighbours,
)
from t2twin.translate.evaluation.field_of_view import View, view_on
from t2twin.translate.evaluation.findings import findings, gap, paired
from t2twin.translate.evaluation.lookalikes import NEIGHBOURS, lookalikes
from t2twin.translate.evaluation.metrics import CONTACT_LEVEL, Figures, compare
from t2twin.translate.evaluation.noise_floor import second_reading
from t2twin.translate.evaluation.table import markdown
from t2twin.translate.layouts import for_layout, same_layout, seen_through
from t2twin.translate.phi import Phi
from t2twin.translate.predict import TrainedTranslator, load_run

METRICS = "metrics.json"
PREDICTIONS = "predictions.npz"
FINDINGS = "findings.json"
TABLE = "results.md"
FORMAT = 2
"""Version of what metrics.json holds."""

NOISE_FLOOR, LAYOUT_FLOOR = "noise-floor", "layout-floor"
"""Rows that no predictor is expected to pass; they are made from the truth."""

TRUTH = "truth"
SPLITS = ("val", "test")

PAPER: dict[str, dict[str, dict[str, float]]] = {
    "val": {
        "touch2touch": {"rmse_counts": 4007, "rmse_percent": 10.01, "ssim": 0.96},
        "resnet18": {"rmse_counts": 3931, "rmse_percent": 9.83, "ssim": 0.95},
    },
    "test": {
        "touch2touch": {"rmse_counts": 6072, "rmse_percent": 15.18},
        "resnet18": {"rmse_counts": 4867, "rmse_percent": 12.17},
    },
}
"""Results on the real sensors (Grella et al. 2023). The paper gives one SSIM a model."""


def evaluate(runs: list[Path], data_dir: Path, split: str, out_dir: Path) -> dict[str, Any]:
    """Compares runs and baselines on one split; writes metrics.json and predictions.npz.

    runs: folders that `train` has made. touch2touch runs may be of another taxel layout than the
    data set, which is then read from the images that they draw (translate.layouts). split: "val"
    or "test" (or "train"). Returns what metrics.json holds:

    - "format", "split", "pairs", "full_scale_counts", "contact_level", "info_sha256", "layout";
    - "view": the DIGIT's view on the taxels, how many lie under it, within a pitch of it, beyond;
    - "models": by name, each with "overall", "by_shape" and "by_family", whose figures
      metrics.Figures.summary describes, and "interval", of the overall figures, by
      bootstrap over shapes (module bootstrap); of a run also "run", "same_data" and
      "trained_layout". Beside the runs stand mean-array, nearest-neighbour, where the data set
      names its imperfections noise-floor (module noise_floor), and for runs of another layout
      layout-floor (layouts.seen_through);
    - "bootstrap": how the intervals are made;
    - "paired": touch2touch less ResNet18 in every figure, with intervals, where both are there;
    - "findings": the paper's findings, each answered (module findings);
    - "lookalikes": how far presses that look alike differ in taxels (module lookalikes);
    - "paper": the published figures of that split.

    predictions.npz holds "truth" and one (P, N) array a model, by the same names, and the presses:
    "shape", "family", "x_mm", "y_mm", "yaw_rad", "force_n".

    Raises T2TwinError for no runs, a folder that is no run, a layout that a run cannot give, and a
    missing split.
    """
    if not runs:
        raise T2TwinError("there is no run to evaluate; give at least one folder of `train`")
    info = load_info(data_dir)
    trained = _named(runs)
    applied = {
        name: for_layout(run, info.x_mm, info.y_mm, info.layout) for name, run in trained.items()
    }
    cache = usable_cache(data_dir, out_dir)
    pairs, train = (load_pairs(data_dir, s, FEATURE_SIZE, False, cache) for s in (split, "train"))
    near = neighbours(train.images, pairs.images, NEIGHBOURS, progress=NEAREST_NEIGHBOUR)
    predictions = _without_runs(data_dir, pairs, train, near)
    predictions |= _layout_floor(list(trained.values()), info, pairs)
    for name, run in applied.items():
        preset = run.config.preset
        own = load_pairs(data_dir, split, preset.size, preset.grey, cache)
        predictions[name] = run.predict_pixels(own.images, progress=name)
    view = view_on(info.x_mm, info.y_mm)
    phi = Phi(info.x_mm, info.y_mm)
    models: dict[str, Any] = {}
    resampled: dict[str, dict[str, np.ndarray]] = {}
    for name, predicted in predictions.items():
        figures = compare(
            predicted, pairs.counts, phi, info.full_scale_counts, f"figures of {name}", view.groups
        )
        resampled[name] = bootstrap.replicates(figures, pairs.shapes, info.full_scale_counts)
        models[name] = _summaries(figures, pairs, info.full_scale_counts) | {
            "interval": {k: bootstrap.interval(v) for k, v in resampled[name].items()}
        }
    for name, run in trained.items():
        own_data = run.config.data
        models[name]["run"] = str(run.run_dir)
        models[name]["same_data"] = own_data.sha256 == info.sha256
        models[name]["trained_layout"] = own_data.layout
    metrics = {
        "format": FORMAT,
        "split": split,
        "pairs": len(pairs),
        "full_scale_counts": info.full_scale_counts,
        "contact_level": CONTACT_LEVEL,
        "info_sha256": info.sha256,
        "layout": info.layout,
        "view": _json_of_view(view),
        "models": models,
        "bootstrap": {
            "over": "shapes",
            "shapes": int(np.unique(pairs.shapes).size),
            "resamples": bootstrap.RESAMPLES,
            "seed": bootstrap.SEED,
            "confidence": bootstrap.CONFIDENCE,
        },
        "paired": paired(models, resampled),
        "lookalikes": (
            None  # every pair is its own nearest
            if split == "train"
            else lookalikes(data_dir, split, pairs, train, near, view.groups)
        ),
        "paper": PAPER.get(split, {}),
    }
    metrics["findings"] = findings(metrics)
    _write_predictions(out_dir / PREDICTIONS, predictions, pairs)
    write_json(out_dir / METRICS, metrics)
    return metrics


def evaluate_both(runs: list[Path], data_dir: Path, out_dir: Path) -> dict[str, dict[str, Any]]:
    """`evaluate` of validation and test, into out_dir/val and out_dir/test.

    Beside them go findings.json and results.md, a table in Markdown.

    Returns both, by split. Raises T2TwinError as `evaluate` does.
    """
    metrics = {split: evaluate(runs, data_dir, split, out_dir / split) for split in SPLITS}
    write_findings(metrics, out_dir)
    with whole_file(out_dir / TABLE) as temporary:
        temporary.write_text(markdown(metrics))
    return metrics


def write_findings(metrics: dict[str, dict[str, Any]], out_dir: Path) -> None:
    """findings.json: each split's findings by its name, and "gap" between the two.

    metrics: what `evaluate` returns, by split.
    """
    content = {split: metrics[split]["findings"] for split in SPLITS}
    write_json(out_dir / FINDINGS, content | {"gap": gap(metrics["val"], metrics["test"])})


def _without_runs(
    data_dir: Path, pairs: Pairs, train: Pairs, near: Neighbours
) -> dict[str, np.ndarray]:
    found = {
        MEAN_ARRAY: np.tile(mean_array(train), (len(pairs), 1)),
        NEAREST_NEIGHBOUR: train.counts[near.index[:, 0]],
    }
    again = second_reading(pairs.counts, read_info(data_dir))
    return found if again is None else found | {NOISE_FLOOR: again}


def _layout_floor(
    trained: list[TrainedTranslator], info: DataInfo, pairs: Pairs
) -> dict[str, np.ndarray]:
    """Of the first run that was trained on another layout, if any was."""
    for run in trained:
        if not same_layout(run.config.data, info.x_mm, info.y_mm):
            kept = seen_through(run.config.data, info.x_mm, info.y_mm)
            return {LAYOUT_FLOOR: (pairs.counts @ kept.T).astype(np.float32)}
    return {}


def _summaries(figures: Figures, pairs: Pairs, full_scale: float) -> dict[str, Any]:
    def each(names: np.ndarray) -> dict[str, dict[str, float | None]]:
        return {
            str(name): _json(figures.summary(full_scale, names == name))
            for name in np.unique(names)
        }

    return {
        "overall": _json(figures.summary(full_scale)),
        "by_shape": each(pairs.shapes),
        "by_family": each(pairs.families),
    }


def _json(summary: dict[str, float]) -> dict[str, float | None]:
    """JSON has no NaN."""
    return {name: None if np.isnan(value) else value for name, value in summary.items()}


def _json_of_view(view: View) -> dict[str, Any]:
    return {
        "width_mm": 2 * view.half_width_mm,
        "height_mm": 2 * view.half_height_mm,
        "pitch_mm": view.pitch_mm,
        "taxels": {name: int(mask.sum()) for name, mask in view.groups.items()},
    }


def _write_predictions(path: Path, predictions: dict[str, np.ndarray], pairs: Pairs) -> None:
    with whole_file(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **{TRUTH: pairs.counts},
            **predictions,
            shape=pairs.shapes,
            family=pairs.families,
            **{name: getattr(pairs, name) for name in PRESS},
        )


def _named(runs: list[Path]) -> dict[str, TrainedTranslator]:
    """By model, and by folder too where two runs are of one model."""
    loaded = [load_run(run) for run in runs]
    models = [run.config.model for run in loaded]
    names = [
        model if models.count(model) == 1 else f"{model} ({run.run_dir.name})"
        for model, run in zip(models, loaded, strict=True)
    ]
    if len(set(names)) < len(names):
        names = [f"{run.config.model} ({run.run_dir})" for run in loaded]
    return dict(zip(names, loaded, strict=True))
