"""The report of runs: one self-contained HTML page."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.draw import Panel, panels_image
from t2twin.core.machine import cores, processor
from t2twin.core.tables import Table
from t2twin.report import dataset_report, pairs, run_charts
from t2twin.report.data import ReportData, read_report_data
from t2twin.report.page import (
    KIND_NAMES,
    SPLIT_NAMES,
    listed,
    name_of,
    shortened,
    write_page,
)
from t2twin.sim.dataset.info import SensorInfo
from t2twin.translate.evaluation.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.predictions import bundled_in_own_light
from t2twin.translate.evaluation.records import Evaluation
from t2twin.translate.evaluation.table import (
    FURTHER,
    MAIN,
    figures_table,
    training_data,
)
from t2twin.translate.runs.log import best_epoch

TITLE = "Touch-to-touch translation on a simulated bench"
IMPORTED_TITLE = "Touch-to-touch translation of the pairs in {}"

UNSEEN_SHAPES = {
    "val": "new versions of the training shapes",
    "test": "hand tools (new objects)",
}
"""Content of the splits of the paper's protocol, for a run trained on the same dataset."""

TITLES = {"val": "Validation, unseen versions", "test": "Test, objects"}
"""Titles of the splits of the paper's protocol."""

TRANSDUCER = {
    "modulus_mpa": "modulus {:g} MPa",
    "largest_strain": "largest strain {:g}",
    "a_per_kpa": "a = {:g}/kPa",
    "b_per_kpa": "b = {:g}/kPa",
}
"""Constants of a transducer (t2twin.sim.taxels.spec.TransducerTable), in words."""

MAX_TITLE = 14
"""Largest number of characters of a run's folder in a title of a sample (assumed: fits a panel)."""

QUANTILES = {"val": (0.1, 0.5, 0.9, 1.0), "test": (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)}
"""Quantiles of the error at which samples are shown."""


def summary(report: ReportData) -> dict[str, Any]:
    """Errors by split, and the press with the median error of the best run."""
    split, evaluation = next(iter(report.evaluations.items()))
    name, predictions = best_run(evaluation), report.predictions[split]
    errors = predictions.rmse_counts(name)
    row = int(np.argsort(errors, kind="stable")[(errors.size - 1) // 2])
    ratios = {s: _ratio(one) for s, one in report.evaluations.items()}
    return {
        "runs": [name_of(run) for run in report.runs],
        "pairs": {split: _pairs(report, split) for split in report.evaluations},
        "baselines": (MEAN_ARRAY, NEAREST_NEIGHBOR),
        "ratios": ratios,
        "better": [split for split, ratio in ratios.items() if ratio < 1.0],
        "split": split,
        "best": name,
        "errors": errors,
        "row": row,
        "example": pairs.translation(report, split, row, predictions.by_model[name][row]),
    }


def best_run(evaluation: Evaluation) -> str:
    """Name of the run with the lowest RMSE on a split."""
    return min(evaluation.runs, key=lambda name: evaluation.runs[name].overall.counts)


def _pairs(report: ReportData, split: str) -> str:
    """Content of a split, and whether its shapes are in the training split, if recorded."""
    evaluation = report.evaluations[split]
    pairs = f"the {evaluation.pairs:,} {SPLIT_NAMES[split]} pairs"
    if not all(row.same_data for row in evaluation.runs.values()):
        return pairs
    own, trained = (set(report.tables[s]["shape"].to_pylist()) for s in (split, "train"))
    if own <= trained:
        return f"{pairs} (of training shapes)"
    if own & trained:
        return f"{pairs} (some of training shapes)"
    return UNSEEN_SHAPES[split] if report.info.is_protocol else f"{pairs} (of unseen shapes)"


def _ratio(evaluation: Evaluation) -> float:
    """RMSE of the best run relative to that of the better baseline."""
    baselines = (evaluation.models[name] for name in (MEAN_ARRAY, NEAREST_NEIGHBOR))
    lowest = min(row.overall.counts for row in baselines)
    best = evaluation.runs[best_run(evaluation)].overall.counts
    return best / lowest if lowest else float("inf")


def about(report: ReportData) -> dict[str, Any]:
    """Shapes by split, table of the runs, and runs with other training data."""
    models = report.evaluation.runs
    rows = [_run(report, name) for name in report.runs]
    return {
        "shapes": {s: len(table["shape"].unique()) for s, table in report.tables.items()},
        "cores": cores(),
        "processor": processor(),
        "table": Table([*rows[0]], {"": [[*row.values()] for row in rows]}),
        "other_data": [
            f"{name_of(name)} ({training_data(model)[0]})"
            for name, model in models.items()
            if not model.same_data
        ],
    }


def _run(report: ReportData, name: str) -> dict[str, str]:
    """Row of a run, by the titles of the columns."""
    run, history = report.runs[name], report.histories[name]
    preset = run.config.preset
    parameters = sum(p.numel() for p in run.translator.predictor.parameters())
    seconds = sum(record.seconds for record in history)
    recipe, pairs, steps = training_data(report.evaluation.runs[name])
    return {
        "Run": name_of(name),
        "Trained on": recipe,
        "Pairs": pairs,
        "Steps": steps,
        "Preset": preset.name,
        "Image, px": f"{preset.size} × {preset.size}, {'grey' if preset.grey else 'RGB'}",
        "Parameters": f"{parameters / 1e6:.2f} M",
        "Epochs": f"{len(history)}",
        "Best epoch": f"{best_epoch(history).epoch}",
        "Minutes": f"{seconds / 60:.1f}" if seconds < 600 else f"{seconds / 60:,.0f}",
    }


def limits(report: ReportData) -> dict[str, Any]:
    """Known parameters of simulated sensors, and whether the light is that of the sensor's file."""
    info = report.info
    if not info.is_simulated:
        return {}
    laws = [(sensor.elastomer or {}).get("law") for sensor in info.sensors.values()]
    return {
        "sensors": [
            {
                "kind": KIND_NAMES[sensor.value],
                "name": report.label(role),
                "known": known_values(sensor),
            }
            for role, sensor in info.sensors.items()
        ],
        "is_stiffening": "stiffening" in laws,
        # of LEDs, or a bundled sensor's own
        "is_own_light": info.camera.optics_sha256 is None or bundled_in_own_light(info.camera),
    }


def known_values(sensor: SensorInfo) -> list[str]:
    """What a dataset records of a simulated sensor, in words; less for a dataset of format 1."""
    values, layer, spec = [], sensor.elastomer, sensor.spec or {}
    if layer is not None:
        values.append(
            f"a layer of {layer['thickness_mm']:g} mm with a modulus of {layer['young_mpa']:g} MPa "
            f"and a Poisson's ratio of {layer['poisson']:g}"
        )
    if sensor.noise_grey is not None:
        values.append(f"image noise of {sensor.noise_grey:.2g} grey levels")
    if sensor.pad_diameter_mm is not None:
        pads = sorted(set(sensor.pad_diameter_mm))
        values.append(f"pads with a diameter of {listed([f'{pad:.3g}' for pad in pads])} mm")
    if (transducer := spec.get("transducer")) is not None:
        constants = [
            text.format(transducer[name]) for name, text in TRANSDUCER.items() if name in transducer
        ]
        values.append(f"{transducer['law']} taxels ({', '.join(constants)})")
    if (counts := spec.get("counts")) is not None:
        values.append(f"{counts['gain']:,g} counts for a signal of 1")
    return values


def results(report: ReportData) -> dict[str, Any]:
    """Two tables of the figures."""
    evaluations = report.evaluations
    titles = {
        split: TITLES[split] if report.info.is_protocol else name_of(split).capitalize()
        for split in evaluations
    }
    with_pairs = {s: f"{titles[s]} ({one.pairs:,} pairs)" for s, one in evaluations.items()}
    own = "This dataset" + ", simulated" * report.info.is_simulated
    return {
        "main": figures_table(evaluations, MAIN, with_pairs, name_of, own=own),
        "further": figures_table(evaluations, FURTHER, titles, name_of),
    }


def samples(report: ReportData) -> dict[str, Any]:
    """Split, quantile, values, errors by run, and figure of each sample."""
    return {
        "samples": [
            (
                split,
                quantile,
                report.row(split, row),
                {name: report.predictions[split].rmse_counts(name)[row] for name in report.runs},
                sample_image(report, split, row),
            )
            for split in report.evaluations
            for row, quantile in samples_at_quantiles(report, split)
        ]
    }


def samples_at_quantiles(report: ReportData, split: str) -> list[tuple[int, float]]:
    """Unique rows at QUANTILES of the error, with their quantile."""
    predictions = report.predictions[split]
    error = np.mean([predictions.rmse_counts(name) for name in report.runs], axis=0)
    order = np.argsort(error, kind="stable")
    rows: dict[int, float] = {}
    for quantile in QUANTILES[split]:
        rows.setdefault(int(order[round(quantile * (order.size - 1))]), quantile)
    return list(rows.items())


def sample_image(report: ReportData, split: str, row: int) -> bytes:
    """One sample as PNG: X, generated images, phi of the predicted counts, differences, and I."""
    predictions, phi = report.predictions[split], report.array.phi
    image, truth = report.image(split, row), phi(predictions.truth[row])
    panels = [Panel(f"X\n{report.camera_name}", image)]
    for name, run in report.runs.items():
        predicted = phi(predictions.by_model[name][row])
        model, _, folder = name_of(name).partition(" ")
        lines = f"{model}\n{shortened(folder, MAX_TITLE)}" if folder else model
        if run.reads_any_layout:
            panels.append(Panel(f"{lines}\ngenerated", run.tactile_images([image])[0]))
        error = predictions.rmse_counts(name)[row]
        panels.append(Panel(f"φ(Ŷ) {lines}\n{report.counts(error)} counts", predicted))
        panels.append(Panel("φ(Ŷ) − I\n", predicted - truth, is_difference=True))
    panels.append(Panel("I = φ(Y)\ntrue", truth))
    layout = report.array.layout
    return panels_image(panels, phi.centers_mm, layout.x_mm, layout.y_mm)


TEMPLATES = ("report/templates/runs.html", *dataset_report.TEMPLATES)

SECTIONS: dict[str, tuple[str, Callable[[ReportData], Mapping[str, Any] | None]]] = {
    "summary": ("", summary),
    "about": ("", about),
    "results": ("Results", results),
    "by-force": ("By force", run_charts.by_force),
    "uncertainty": ("Uncertainty", run_charts.uncertainty),
    "samples": ("Samples", samples),
    "pairs": ("Pairs", pairs.section),
    "curves": ("Learning", run_charts.learning_curves),
    "forces": ("Forces", dataset_report.forces),
    "by-shape": ("By shape", run_charts.by_shape),
    "limits": ("Limits", limits),
}
"""Title of the link to each section, and its values; two are also in the report of a dataset."""


def write_report(
    out: str | Path,
    data: str | Path,
    runs: Sequence[str | Path],
    evaluation: str | Path | None = None,
) -> Path:
    """Writes out/index.html, a self-contained page, and returns its path.

    data: a finished dataset, simulated or imported, with training pairs and validation pairs, test
    pairs or both. runs: folders of finished trainings. evaluation: a folder of
    `t2twin evaluate --split both`. The report uses it if it evaluates these runs on this dataset,
    else the folder `evaluate` next to `out`; else it evaluates the runs into out/evaluate-val and
    out/evaluate-test.
    Raises T2TwinError, before anything is written, for a missing or unfinished dataset or run, and
    for a run that cannot predict the dataset's taxel layout.
    """
    folder, data = arguments.path(out, "out"), arguments.path(data, "data")
    given = None if evaluation is None else arguments.path(evaluation, "evaluation")
    report = read_report_data(folder, data, arguments.paths(runs, "runs"), given)
    return draw_report(folder, report)


def draw_report(out: Path, report: ReportData) -> Path:
    """Writes out/index.html and returns its path."""
    info = report.info
    title = TITLE if info.is_simulated else IMPORTED_TITLE.format(report.data)
    if info.is_simulated and not info.is_protocol:
        title += f", recipe {info.recipe_name}"
    sections = {name: (link, partial(values, report)) for name, (link, values) in SECTIONS.items()}
    return write_page(out, title, TEMPLATES, sections, report=report, dataset=report)
