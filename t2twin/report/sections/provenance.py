"""The dataset, the runs, the machine, and the limitations."""

from collections.abc import Mapping
from typing import Any

from t2twin.core.machine import cores, processor
from t2twin.report.data import ReportData
from t2twin.report.html.labels import name_of
from t2twin.sim.cyskin.taxels import DIELECTRIC_MODULUS_MPA
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.digit.calibration import DEFAULT_PATH
from t2twin.translate.evaluation.table import training_data
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.runs.log import best_epoch

HEADS = [
    ["Run", "Trained on", "Pairs", "Steps", "Preset", "Image, px", "Parameters", "Epochs",
     "Best epoch", "Minutes"],
]  # fmt: skip


def about(report: ReportData, omitted: Mapping[str, str]) -> dict[str, Any]:
    """Data and runs. omitted: titles of omitted sections, with the data that they would require."""
    models, layout = report.evaluation.runs, report.layout.layout
    return {
        "shapes": {s: len(table["shape"].unique()) for s, table in report.tables.items()},
        "cores": cores(),
        "processor": processor(),
        "heads": HEADS,
        "rows": [_run(report, name) for name in report.runs],
        "other_layout": [
            f"{name_of(name)} ({model.trained_layout}, read from {_output(report, name)})"
            for name, model in models.items()
            if model.trained_layout != layout
        ],
        "other_data": [
            f"{name_of(name)} ({training_data(model)[0]})"
            for name, model in models.items()
            if not model.same_data
        ],
        "omitted": [f"{title} ({missing})" for title, missing in omitted.items()],
    }


def _output(report: ReportData, name: str) -> str:
    """Output from which the counts of another layout are computed."""
    is_field = isinstance(report.runs[name], FieldPredictor)
    return "the predicted field" if is_field else "the generated tactile images"


def _run(report: ReportData, name: str) -> list[str]:
    """Row of a run."""
    run, history = report.runs[name], report.histories[name]
    preset = run.config.preset
    parameters = sum(p.numel() for p in run.translator.predictor.parameters())
    seconds = sum(record.seconds for record in history)
    return [
        name_of(name),
        *training_data(report.evaluation.runs[name]),
        preset.name,
        f"{preset.size} × {preset.size}, {'grey' if preset.grey else 'RGB'}",
        f"{parameters / 1e6:.2f} M",
        f"{len(history)}",
        f"{best_epoch(history).epoch}",
        f"{seconds / 60:.1f}" if seconds < 600 else f"{seconds / 60:,.0f}",
    ]


def limits(report: ReportData) -> dict[str, Any]:
    """Assumed parameters of a simulated dataset, and whether its optics are the default ones."""
    parameters = report.info.parameters
    return {
        "parameters": parameters,
        "dielectric_mpa": DIELECTRIC_MODULUS_MPA,
        "is_default_calibration": parameters is not None
        and parameters.digit.calibration_sha256 == sha256_of(DEFAULT_PATH),
    }
