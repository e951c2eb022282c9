"""Summary of the report of runs: four paragraphs and an example translation."""

import numpy as np

from t2twin.report.data import ReportData
from t2twin.report.dataset.example import example
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, forces_text, name_of, shape_name
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.records import Evaluation

UNSEEN_SHAPES = {
    "val": "new versions of the training shapes",
    "test": "hand tools (new objects)",
}
PARTS = {"val": "the new versions", "test": "the hand tools"}
"""Content of the splits of the paper's protocol, for a run trained on the same dataset."""


def section(report: ReportData) -> str:
    """The paragraphs, and the press with the median error of the best run."""
    parts = [markup.paragraph(text) for text in paragraphs(report)]
    return markup.section("summary", "Summary", [*parts, _example(report)])


def paragraphs(report: ReportData) -> list[str]:
    """Task, errors, comparison with the baselines, and conclusion."""
    return [_task(report), _errors(report), _comparison(report), _conclusion(report)]


def best_run(evaluation: Evaluation) -> str:
    """Name of the run with the lowest RMSE on a split."""
    return min(evaluation.runs, key=lambda name: evaluation.runs[name].overall.rmse_counts)


def _task(report: ReportData) -> str:
    taxels, full_scale = report.layout.x_mm.size, report.layout.full_scale_counts
    names = [name_of(name) for name in report.runs]
    network = f"the network {names[0]}" if len(names) == 1 else f"the networks {_and(names)}"
    predicts = "predicts" if len(names) == 1 else "predict"
    several = report.forces_n.size > 1
    forces = f" The forces are {forces_text(report.forces_n)}." if several else ""
    if report.info.is_simulated:
        return (
            "A simulated DIGIT (a camera behind a soft gel) and a simulated CySkin (an array of "
            f"{taxels} pressure sensors, called taxels, under a soft cover) touch the same shapes. "
            f"From a DIGIT image, {network} {predicts} the {taxels} counts of the CySkin, each "
            f"from 0 to {full_scale:,.0f}.{forces}"
        )
    return (
        "The pairs were imported: the image of a camera-based tactile sensor (DIGIT) and the "
        f"counts, each from 0 to {full_scale:,.0f}, of an array of {taxels} pressure sensors, "
        f"called taxels (CySkin), of the same touch. From an image, {network} {predicts} the "
        "counts."
    )


def _errors(report: ReportData) -> str:
    parts = []
    for split, evaluation in report.evaluations.items():
        rows = sorted(evaluation.runs.items(), key=lambda item: item[1].overall.rmse_counts)
        errors = [f"{row.overall.rmse_percent:.2f} % for {name_of(name)}" for name, row in rows]
        parts.append(f"{_and(errors)} on {_where(report, split)}")
    order = " (lower first)" if len(report.runs) > 1 else ""
    return (
        "The error is the RMSE (root of the mean squared difference between predicted and true "
        f"counts), in percent of full scale{order}: {'; '.join(parts)}."
    )


def _comparison(report: ReportData) -> str:
    mean, nearest = (
        " and ".join(
            f"{evaluation.models[name].overall.rmse_percent:.2f} %"
            for evaluation in report.evaluations.values()
        )
        for name in (MEAN_ARRAY, NEAREST_NEIGHBOR)
    )
    splits = " and ".join(SPLIT_NAMES[split] for split in report.evaluations)
    ratios = " and ".join(f"{_ratio(one):.2f}" for one in report.evaluations.values())
    return (
        f"Baselines ({splits}): the mean of all training presses (mean array) has an RMSE of "
        f"{mean}, the training press with the most similar image (nearest neighbor) {nearest}. The "
        f"RMSE of the {_best(report)} is {ratios} times that of the better baseline."
    )


def _conclusion(report: ReportData) -> str:
    below = [split for split, one in report.evaluations.items() if _ratio(one) < 1.0]
    if below:
        parts = PARTS if report.info.is_protocol else SPLIT_NAMES
        only = "" if len(below) == len(report.evaluations) else f" on {parts[below[0]]} only"
        verdict = f"The {_best(report)} is better than both baselines{only}"
    else:
        verdict = f"The {_best(report)} is not better than both baselines"
    if report.info.is_simulated:
        return (
            f"{verdict}. All data are simulated, with one sensor of each kind: they compare "
            "methods, and do not predict the error on real sensors."
        )
    return f"{verdict}. This holds for these two sensors and similar presses only."


def _best(report: ReportData) -> str:
    return "best network" if len(report.runs) > 1 else "network"


def _where(report: ReportData, split: str) -> str:
    """Content of a split, and whether its shapes are in the training split, if known."""
    evaluation = report.evaluations[split]
    pairs = f"the {evaluation.pairs:,} {SPLIT_NAMES[split]} pairs"
    if not all(row.same_data for row in evaluation.runs.values()):
        return pairs
    own, trained = (set(report.tables[s]["shape"].to_pylist()) for s in (split, "train"))
    if own <= trained:
        return f"{pairs} (of training shapes)"
    if own & trained:
        return f"{pairs} (some of training shapes)"
    if report.info.is_protocol:
        return UNSEEN_SHAPES[split]
    return f"{pairs} (of unseen shapes)"


def _ratio(evaluation: Evaluation) -> float:
    """RMSE of the best run relative to that of the better baseline."""
    baselines = (evaluation.models[name] for name in (MEAN_ARRAY, NEAREST_NEIGHBOR))
    lowest = min(row.overall.rmse_counts for row in baselines)
    best = evaluation.runs[best_run(evaluation)].overall.rmse_counts
    return best / lowest if lowest else float("inf")


def _example(report: ReportData) -> str:
    split, evaluation = next(iter(report.evaluations.items()))
    name, predictions = best_run(evaluation), report.predictions[split]
    errors = predictions.rmse_counts(name)
    row = int(np.argsort(errors, kind="stable")[(errors.size - 1) // 2])
    shape = shape_name(report.shape(split, row))
    note = (
        f"Left: DIGIT image of a press of {shape}. Middle: true counts, interpolated between the "
        f"taxels (rings). Right: prediction of {name_of(name)}, RMSE {errors[row]:,.0f} counts, "
        f"the median of the {errors.size:,} {SPLIT_NAMES[split]} pairs. The color scale is in "
        "counts."
    )
    content = example(report, split, row, predictions.by_model[name][row])
    alt = "A DIGIT image, the true and the predicted tactile image"
    return markup.embed(content, "png", alt, "Example translation.", width="small", note=note)


def _and(items: list[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
