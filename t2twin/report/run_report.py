"""The report of runs with their evaluation: one self-contained HTML page."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.core import arguments
from t2twin.core.draw import PALETTE, Panel, figure, panels_image
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.files import sha256_of
from t2twin.core.machine import cores, processor
from t2twin.core.tables import Table
from t2twin.report import dataset_report
from t2twin.report.dataset_report import Dataset, read_dataset
from t2twin.report.page import (
    BASELINE_COLORS,
    SPLIT_COLORS,
    SPLIT_NAMES,
    check_out,
    name_of,
    shape_name,
    write_page,
)
from t2twin.sim.dataset.info import COUNTS, SPLITS
from t2twin.sim.dataset.store import INFO
from t2twin.translate.evaluation.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.evaluate import (
    Predictions,
    bundled_in_own_light,
    evaluate,
    read_predictions,
    run_names,
    splits_with_pairs,
)
from t2twin.translate.evaluation.metrics import REPORTED_SHARE
from t2twin.translate.evaluation.records import Evaluation, read_evaluation
from t2twin.translate.evaluation.table import counts_form, results_tables, training_data
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.runs.config import (
    BEST,
    EpochRecord,
    best_epoch,
    load_config,
    read_log,
    resolve_run,
)
from t2twin.translate.training.train import stop_reason

SIBLING_FOLDER = "evaluate"  # next to the report's: `make evaluate` writes val and test into it
TITLE = "Touch-to-touch translation on a simulated bench"
IMPORTED_TITLE = "Touch-to-touch translation of the pairs in {}"

# Quantiles of the error at which samples are shown
QUANTILES = {"val": (0.1, 0.5, 0.9, 1.0), "test": (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)}
MAX_TITLE = 14  # characters of a run's folder in the title of a panel (assumed)
WIDTH_IN, HEIGHT_IN = 9.0, 3.4
SHAPES_IN, BAR_IN, MARGINS_IN = 4.2, 0.30, 1.3  # the chart by shape fits on a phone
MAX_SHAPES = 60  # bars of a chart (assumed: a printed page)

DASHED: dict[str, Any] = {"linestyle": (0, (6, 3)), "linewidth": 1.0}
MARKS: dict[str, dict[str, Any]] = {
    MEAN_ARRAY: {"marker": "|", "markersize": 13, "markeredgewidth": 2.0},
    NEAREST_NEIGHBOR: {"marker": "D", "markersize": 5, "markeredgecolor": "white"},
}
STYLES = ("-", "--", ":")  # of the lines of runs with uncertainty


@dataclass(frozen=True)
class ReportData(Dataset):
    """Data of the report of runs. Imported pairs may lack a split of "val" and "test"."""

    runs: dict[str, TrainedTranslator]  # by their names in the evaluation
    histories: dict[str, list[EpochRecord]]  # logs of the runs
    evaluations: dict[str, Evaluation]  # by split, as the next two
    predictions: dict[str, Predictions]
    folders: dict[str, Path]  # of the evaluations

    def counts(self, value: float) -> str:
        """A number of counts as text, with a decimal for a small full scale."""
        return counts_form(self.info.array.full_scale_counts).format(value)

    @property
    def colors(self) -> dict[str, str]:
        """Colors of runs and baselines."""
        return BASELINE_COLORS | {run: PALETTE[i % 5] for i, run in enumerate(self.runs)}


def read_report_data(
    out: Path, data: Path, runs: list[Path], evaluation: Path | None = None
) -> ReportData:
    """Reads the dataset, the runs and their evaluation. Raises T2TwinError, before anything is
    written, for a dataset, a run or an evaluation's folder that cannot be used."""
    check_out(out)
    if not runs:
        raise T2TwinError(
            "there is no run to report on; expected at least one folder of `t2twin train`"
        )
    if evaluation is not None and not any((evaluation / name).is_dir() for name in SPLITS):
        raise T2TwinError(
            f"{evaluation} contains no evaluation; expected a folder of "
            "`t2twin evaluate --split both`"
        )
    runs = [resolve_run(run) for run in runs]
    dataset, splits = read_dataset(data), splits_with_pairs(data)
    histories = [read_log(run) for run in runs]
    for run, history in zip(runs, histories, strict=True):
        config = load_config(run)
        if stop_reason(config, history) is None:
            raise T2TwinError(
                f"{run} is unfinished after {len(history)} of {config.planned_epochs} epochs; the "
                "same `t2twin train` command resumes it"
            )
    loaded = [load_run(run) for run in runs]
    names = run_names(loaded)
    found = {s: _find_or_evaluate(loaded, names, data, s, out, evaluation) for s in splits}
    unused = [s for s, each in found.items() if evaluation and each[0] != evaluation / s]
    if unused:
        said = f"{evaluation} is not used for {' and '.join(unused)}: it has no evaluation of these"
        warn(f"{said} runs, in this order, with their present weights, on {data}")
    return ReportData(
        **vars(dataset),
        runs=dict(zip(names, loaded, strict=True)),
        histories=dict(zip(names, histories, strict=True)),
        evaluations={split: each for split, (_, each, _) in found.items()},
        predictions={split: each for split, (_, _, each) in found.items()},
        folders={split: folder for split, (folder, _, _) in found.items()},
    )


def _find_or_evaluate(
    runs: Sequence[TrainedTranslator],
    names: Sequence[str],
    data: Path,
    split: str,
    out: Path,
    given: Path | None,
) -> tuple[Path, Evaluation, Predictions]:
    """Folder and evaluation of runs on one split: of these weights, in this order, on this dataset,
    in given, the sibling folder of `out` or out/evaluate-SPLIT, else evaluated into the last."""
    weights, info_sha256 = [sha256_of(run.run_dir / BEST) for run in runs], sha256_of(data / INFO)
    own = out / f"evaluate-{split}"
    folders = [out.parent / SIBLING_FOLDER / split, own]
    for folder in folders if given is None else [given / split, *folders]:
        try:
            evaluation, predictions = read_evaluation(folder), read_predictions(folder)
        except T2TwinError:
            continue  # there is no evaluation that this version can read
        if (
            evaluation.split == split
            and evaluation.info_sha256 == info_sha256
            and list(evaluation.runs) == names
            and [row.weights_sha256 for row in evaluation.runs.values()] == weights
            and list(predictions.by_model) == list(evaluation.models)
            and len(predictions.truth) == evaluation.pairs
        ):
            return folder, evaluation, predictions
    evaluation = evaluate([run.run_dir for run in runs], data, split, own)
    return own, evaluation, read_predictions(own)


def about(report: ReportData) -> dict[str, Any]:
    """Pairs and shapes by split, table of the runs, and runs with other training data."""
    groups = report.table.groupby("split", sort=False)
    models = next(iter(report.evaluations.values())).runs
    rows = []
    for name, run in report.runs.items():
        history, preset = report.histories[name], run.config.preset
        parameters = sum(p.numel() for p in run.translator.predictor.parameters())
        minutes = sum(record.seconds for record in history) / 60
        rows.append(
            {
                "Run": name_of(name),
                "Preset": preset.name,
                "Image, px": f"{preset.size} × {preset.size}, {'grey' if preset.grey else 'RGB'}",
                "Parameters": f"{parameters / 1e6:.2f} M",
                "Epochs": f"{len(history)}",
                "Best epoch": f"{best_epoch(history).epoch}",
                "Minutes": f"{minutes:.1f}" if minutes < 10 else f"{minutes:,.0f}",
            }
        )
    return {
        "pairs": groups.size().to_dict(),
        "shapes": groups["shape"].nunique().to_dict(),
        "machine": f"{cores()} cores, {processor()}",
        "table": Table([*rows[0]], {"": [[*row.values()] for row in rows]}),
        "other_data": [
            f"{name_of(name)} ({training_data(model)})"
            for name, model in models.items()
            if not model.same_data
        ],
    }


def results(report: ReportData) -> dict[str, Any]:
    """The tables of the evaluation."""
    first = next(iter(report.evaluations.values()))
    return {"first": first, "tables": results_tables(report.evaluations, name_of)}


def uncertainty(report: ReportData) -> dict[str, Any] | None:
    """Reliability diagram and risk-coverage curve; None if no run predicts uncertainty."""
    if not any(run.config.has_uncertainty for run in report.runs.values()):
        return None

    def draw(page: Figure) -> None:
        left, right = page.subplots(1, 2)
        for split, evaluation in report.evaluations.items():
            rows = {n: row.uncertainty for n, row in evaluation.runs.items() if row.uncertainty}
            for style, (name, found) in zip(STYLES * len(rows), rows.items(), strict=False):
                nominal, observed, kept = (
                    100 * np.array(shares)
                    for shares in (found.levels, found.coverage, found.retained)
                )
                label = f"{name_of(name)}, {SPLIT_NAMES[split]}"
                look: Any = {"color": SPLIT_COLORS[split], "label": label, "linestyle": style}
                left.plot(nominal, observed, marker="o", markersize=3, **look)
                right.plot(kept, found.retained_rmse_counts, **look)
        left.plot((0, 100), (0, 100), color="#999999", linewidth=0.8)
        left.set(xlabel="nominal coverage, %", ylabel="observed coverage, %")
        left.set(xlim=(0, 100), ylim=(0, 100))
        right.axvline(100 * REPORTED_SHARE, color="#999999", linewidth=0.8)
        right.set(xlabel="presses with the lowest uncertainty, %", ylabel="RMSE, counts")
        right.set(xlim=(0, 100), ylim=(0, None))
        right.yaxis.set_major_formatter("{x:,g}")
        left.legend()
        right.legend()

    return {"chart": figure("svg", WIDTH_IN, HEIGHT_IN, draw)}


def samples(report: ReportData) -> dict[str, Any]:
    """Split, quantile, values, errors by run, and picture of each sample."""
    return {
        "samples": [
            (
                split,
                quantile,
                report.table.iloc[report.pairs_of(split)[row]].to_dict(),
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
    predictions, layout = report.predictions[split], report.info.array.taxels
    phi = report.phis[report.info.role_of(COUNTS)]
    image = report.image(int(report.pairs_of(split)[row]))
    truth = phi(predictions.truth[row])
    panels = [Panel(f"X\n{report.camera_name}", image)]
    for name, run in report.runs.items():
        predicted = phi(predictions.by_model[name][row])
        model, _, folder = name_of(name).partition(" ")
        lines = f"{model}\n{shape_name(folder, MAX_TITLE)}" if folder else model
        if run.translator.reads_any_layout:
            drawn = run.tactile_images([image])[0]
            panels.append(Panel(f"{lines}\ngenerated", drawn, phi, layout, "counts"))
        error = report.counts(predictions.rmse_counts(name)[row])
        title = f"φ(Ŷ) {lines}\n{error} counts"
        panels.append(Panel(title, predicted, phi, layout, "counts"))
        off = predicted - truth
        panels.append(Panel("φ(Ŷ) − I\n", off, phi, layout, "difference, counts"))
    panels.append(Panel("I = φ(Y)\ntrue", truth, phi, layout, "counts"))
    return panels_image(panels)


def learning_curves(report: ReportData) -> dict[str, Any]:
    """Chart of the RMSE by epoch, from the logs of the runs."""
    colors, full_scale = report.colors, report.info.array.full_scale_counts

    def draw(page: Figure) -> None:
        axes = page.subplots()
        for name, history in report.histories.items():
            epochs = [record.epoch for record in history]
            look: Any = {"color": colors[name], "marker": "o" if len(history) == 1 else ""}
            rmse = [full_scale * record.val_rmse_percent / 100 for record in history]
            axes.plot(epochs, rmse, label=f"{name_of(name)}, validation", **look)
            best = best_epoch(history)
            lowest = full_scale * best.val_rmse_percent / 100
            axes.plot(best.epoch, lowest, "o", color=colors[name], markersize=5)
            if "l3" in history[0].train:
                seen = [full_scale * math.sqrt(record.train["l3"]) for record in history]
                axes.plot(epochs, seen, "--", label=f"{name_of(name)}, training", **look)
        evaluation = report.evaluations.get("val")
        if evaluation is not None and all(row.same_data for row in evaluation.runs.values()):
            for name in (MEAN_ARRAY, NEAREST_NEIGHBOR):
                look = {"color": colors[name], "label": f"{name_of(name)}, validation"} | DASHED
                axes.axhline(evaluation.models[name].overall["rmse_counts"], **look)
        axes.set(xlabel="epoch", ylabel="RMSE, counts", ylim=(0, None))
        axes.yaxis.set_major_formatter("{x:,g}")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend()

    return {"chart": figure("svg", WIDTH_IN, HEIGHT_IN, draw)}


def by_shape(report: ReportData) -> dict[str, Any]:
    """A chart per split, with bars for the runs and marks for the baselines, by shape, or by family
    if there are too many shapes or none."""
    tables = {split: _by_shape(one) for split, one in report.evaluations.items()}
    high = max(table.to_numpy().max() for table in tables.values())
    colors, charts = report.colors, {}

    def draw(page: Figure, table: pd.DataFrame) -> None:
        axes, places = page.subplots(), np.arange(len(table))
        bars = table[list(report.runs)].rename(columns=name_of)
        bars.plot.barh(ax=axes, width=0.8, color=[colors[run] for run in report.runs], legend=False)
        for baseline, style in MARKS.items():
            look = {"color": colors[baseline], "label": name_of(baseline), "linestyle": "none"}
            axes.plot(table[baseline], places, **look, **style)
        axes.set_yticks(places, [shape_name(name) for name in table.index])
        axes.set(xlabel="RMSE, counts", xlim=(0, 1.05 * high or 1), ylim=(len(table) - 0.4, -0.6))
        axes.xaxis.set_major_locator(MaxNLocator(4))
        axes.xaxis.set_major_formatter("{x:,g}")
        page.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)

    for split, table in tables.items():
        height_in = MARGINS_IN + BAR_IN * len(table)
        charts[split] = figure("svg", SHAPES_IN, height_in, partial(draw, table=table))
    return {"charts": charts, "max_shapes": MAX_SHAPES}


def _by_shape(evaluation: Evaluation) -> pd.DataFrame:
    """RMSE by model, counts; a row for each shape, or for the families with the most pairs."""
    few = 0 < len(evaluation.models[MEAN_ARRAY].by_shape) <= MAX_SHAPES
    groups = {n: one.by_shape if few else one.by_family for n, one in evaluation.models.items()}
    pairs = {name: figures["pairs"] for name, figures in groups[MEAN_ARRAY].items()}
    names = [*pairs] if few else sorted(pairs, key=lambda name: -pairs[name])[:MAX_SHAPES]
    return pd.DataFrame(
        {model: [one[name]["rmse_counts"] for name in names] for model, one in groups.items()},
        index=names,
    )


def limits(report: ReportData) -> dict[str, Any]:
    """Whether the light of simulated images is that of the sensor's file."""
    camera = report.info.camera
    # of LEDs, or a bundled sensor's own
    return {"is_own_light": camera.optics_sha256 is None or bundled_in_own_light(camera)}


TEMPLATES = ("report/templates/runs.html", *dataset_report.TEMPLATES)

SECTIONS: dict[str, tuple[str, Callable[[ReportData], Mapping[str, Any] | None]]] = {
    "summary": ("", lambda _: {}),
    "about": ("", about),
    "results": ("Results", results),
    "uncertainty": ("Uncertainty", uncertainty),
    "samples": ("Samples", samples),
    "pairs": ("Pairs", dataset_report.pairs),
    "curves": ("Learning", learning_curves),
    "forces": ("Forces", dataset_report.forces),
    "by-shape": ("By shape", by_shape),
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
    title = TITLE if info.recipe else IMPORTED_TITLE.format(report.data)
    if info.recipe and not info.scale:
        title += f", recipe {info.recipe_name}"
    sections = {name: (link, partial(values, report)) for name, (link, values) in SECTIONS.items()}
    return write_page(out, title, TEMPLATES, sections, report=report, dataset=report)
