"""Errors of trained translators and sample images, from the folder of `t2twin report`.

    python -m benchmarks translation data/paper RUN... --report runs/paper/report
                                     [--layouts EVALUATION...]

The results have the errors of every row, overall with intervals and by shape, and the overall
errors on the taxel layouts of other folders of `t2twin evaluate`.
Writes docs/pictures/samples.png: samples of the report at fixed quantiles of the error.
"""

from __future__ import annotations

import io
from argparse import Namespace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from PIL import Image

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.files import atomic_write

if TYPE_CHECKING:
    from t2twin.report.run_report import ReportData

BENCHMARK = Benchmark(
    module="benchmarks.networks.translation",
    minutes=4,
    sources=("primitives_cad", "sim", "translate"),
    figures=(
        Figure("val.*.overall.rmse_percent", "%"),
        Figure("test.*.overall.rmse_percent", "%"),
        Figure("runs.*.minutes", "minutes"),
    ),
    arguments=(
        Argument("data", "the dataset", Path),
        Argument("runs", "folders of t2twin train", Path, nargs="+"),
        Argument("--report", "the report's folder", Path, required=True, metavar="DIR"),
        Argument("--layouts", "evaluations on other layouts", Path, (), "*", metavar="DIR"),
    ),
)

PICTURE = ROOT / "docs" / "pictures" / "samples.png"

SHOWN = {"val": (0.5, 1.0), "test": (0.1, 0.5, 0.9, 1.0)}
"""Quantiles of each split's error; the report has more."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.report.run_report import read_report_data

    report = read_report_data(options.report, options.data, options.runs)
    if not options.keep_nothing:
        draw(report)
    layouts = [on_layout(evaluation) for evaluation in options.layouts]
    return figures(report) | {"layouts": layouts}


def figures(report: ReportData) -> dict[str, Any]:
    """Epochs and minutes of each run, the figures of every row by split, the irreducible error."""
    from benchmarks.networks.irreducible_error import estimate_irreducible_error

    evaluations = {
        split: msgspec.to_builtins(evaluation) for split, evaluation in report.evaluations.items()
    }
    return {
        "runs": {
            name: {
                "preset": run.config.preset.name,
                "epochs": len(report.histories[name]),
                "minutes": sum(record.seconds for record in report.histories[name]) / 60.0,
            }
            for name, run in report.runs.items()
        },
        **{
            split: {
                name: {key: row[key] for key in ("overall", "interval", "by_shape")}
                for name, row in evaluation["models"].items()
            }
            for split, evaluation in evaluations.items()
        },
        "lookalikes": {
            split: estimate_irreducible_error(report.data, split) for split in evaluations
        },
    }


def on_layout(folder: Path) -> dict[str, Any]:
    """Figures of every row, overall, by split, from a folder of `t2twin evaluate`."""
    from t2twin.translate.evaluation.records import read_evaluation

    evaluations = {split: read_evaluation(folder / split) for split in SHOWN}
    return {"layout": evaluations["val"].layout} | {
        split: {name: row.overall for name, row in evaluation.models.items()}
        for split, evaluation in evaluations.items()
    }


def draw(report: ReportData) -> None:
    """The samples, one below another."""
    from t2twin.report.run_report import sample_image, samples_at_quantiles

    rows = []
    for split, quantiles in SHOWN.items():
        for row, quantile in samples_at_quantiles(report, split):
            if quantile in quantiles:
                with Image.open(io.BytesIO(sample_image(report, split, row))) as picture:
                    rows.append(np.asarray(picture.convert("RGB")))
    with atomic_write(PICTURE) as temporary:
        Image.fromarray(np.concatenate(rows)).save(temporary, optimize=True)
