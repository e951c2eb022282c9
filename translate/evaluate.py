"""The paper's table and what it lacks: every run and two trivial predictors on one split."""

from pathlib import Path
from typing import Any

import numpy as np

from primitives_cad.errors import T2TwinError
from primitives_cad.writing import whole_file
from translate.baselines import FEATURE_SIZE, mean_array, nearest_neighbour
from translate.data import PRESS, DataInfo, Pairs, load_info, load_pairs, usable_cache
from translate.files import write_json
from translate.metrics import CONTACT_LEVEL, compare
from translate.phi import Phi
from translate.predict import Run, load_run

METRICS = "metrics.json"
PREDICTIONS = "predictions.npz"

MEAN_ARRAY = "mean-array"
NEAREST_NEIGHBOUR = "nearest-neighbour"
TRUTH = "truth"

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

FIGURES = (
    ("rmse_counts", "sqrt(L3), counts", "{:.0f}"),
    ("rmse_percent", "%", "{:.2f}"),
    ("ssim", "SSIM", "{:.3f}"),
    ("ssim_contact", "in contact", "{:.3f}"),
    ("contact_iou", "IoU", "{:.3f}"),
    ("centroid_error_mm", "centroid, mm", "{:.2f}"),
    ("total_error_percent", "total, %", "{:.1f}"),
)


def evaluate(runs: list[Path], data_dir: Path, split: str, out_dir: Path) -> dict[str, Any]:
    """Compares runs and baselines on one split; writes metrics.json and predictions.npz.

    runs: folders that `train` has made, all with the data set's taxel layout. split: "val" or
    "test" (or "train"). Returns what metrics.json holds:

    - "split", "pairs", "full_scale_counts", "contact_level", "info_sha256";
    - "models": by name, each with "overall", "by_shape" and "by_family", whose figures
      translate.metrics.Figures.summary describes; "run" for a run, with "same_data";
    - "paper": the published figures of that split.

    predictions.npz holds "truth" and one (P, N) array a model, by the same names, and the presses:
    "shape", "family", "x_mm", "y_mm", "yaw_rad", "force_n".

    Raises T2TwinError for no runs, a folder that is no run, another layout, and a missing split.
    """
    if not runs:
        raise T2TwinError("there is no run to evaluate; give at least one folder of `train`")
    info = load_info(data_dir)
    loaded = _named(runs)
    for run in loaded.values():
        _check_layout(run, info, data_dir)
    cache = usable_cache(data_dir, out_dir)
    pairs = load_pairs(data_dir, split, FEATURE_SIZE, grey=False, cache_dir=cache)
    predictions = _trivial(pairs, data_dir, cache)
    for name, run in loaded.items():
        preset = run.config.preset
        own = load_pairs(data_dir, split, preset.size, preset.grey, cache)
        predictions[name] = run.predict_pixels(own.images, progress=name)
    phi = Phi(info.x_mm, info.y_mm)
    models = {
        name: _figures(name, predicted, pairs, phi, info.full_scale_counts)
        for name, predicted in predictions.items()
    }
    for name, run in loaded.items():
        models[name]["run"] = str(run.run_dir)
        models[name]["same_data"] = run.config.data.sha256 == info.sha256
    metrics = {
        "split": split,
        "pairs": len(pairs),
        "full_scale_counts": info.full_scale_counts,
        "contact_level": CONTACT_LEVEL,
        "info_sha256": info.sha256,
        "models": models,
        "paper": PAPER.get(split, {}),
    }
    with whole_file(out_dir / PREDICTIONS) as temporary, temporary.open("wb") as file:
        np.savez_compressed(
            file,
            allow_pickle=False,
            **{TRUTH: pairs.counts},
            **predictions,
            shape=pairs.shapes,
            family=pairs.families,
            **{name: getattr(pairs, name) for name in PRESS},
        )
    write_json(out_dir / METRICS, metrics)
    return metrics


def table(metrics: dict[str, Any]) -> str:
    """The overall figures of `evaluate` as lines of text, the paper's own below."""
    names = [*metrics["models"], *(f"{name} (paper, hardware)" for name in metrics["paper"])]
    rows = [model["overall"] for model in metrics["models"].values()]
    rows += list(metrics["paper"].values())
    cells = [["", *(title for _, title, _ in FIGURES)]]
    for name, row in zip(names, rows, strict=True):
        cells.append(
            [name]
            + [how.format(row[key]) if row.get(key) is not None else "-" for key, _, how in FIGURES]
        )
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    note = "The paper's rows are from real sensors and not to be compared one to one."
    return "\n".join([f"{metrics['split']}, {metrics['pairs']} pairs", *lines, note])


def _trivial(pairs: Pairs, data_dir: Path, cache: Path) -> dict[str, np.ndarray]:
    train = load_pairs(data_dir, "train", FEATURE_SIZE, grey=False, cache_dir=cache)
    return {
        MEAN_ARRAY: np.tile(mean_array(train), (len(pairs), 1)),
        NEAREST_NEIGHBOUR: nearest_neighbour(train, pairs.images),
    }


def _figures(
    name: str, predicted: np.ndarray, pairs: Pairs, phi: Phi, full_scale: float
) -> dict[str, Any]:
    figures = compare(predicted, pairs.counts, phi, full_scale, progress=f"figures of {name}")

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


def _named(runs: list[Path]) -> dict[str, Run]:
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


def _check_layout(run: Run, info: DataInfo, data_dir: Path) -> None:
    own = run.config.data
    same = own.x_mm.shape == info.x_mm.shape and np.allclose(own.x_mm, info.x_mm)
    if not (same and np.allclose(own.y_mm, info.y_mm)):
        raise T2TwinError(
            f"{run.run_dir} was trained for the taxel layout {own.layout} ({own.x_mm.size} taxels) "
            f"and {data_dir} has {info.layout} ({info.x_mm.size}); they must be the same"
        )
