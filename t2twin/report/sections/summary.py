"""What the page of runs begins with: four sentences and a picture for one who knows nothing yet."""

import numpy as np

from t2twin.report.data import ReportData
from t2twin.report.dataset.example import example
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, forces_in_words, name_of, shape_name
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY, NEAREST_NEIGHBOR
from t2twin.translate.evaluation.records import Evaluation

NEVER_TRAINED_ON = {
    "val": "shapes never trained on (new versions of known ones)",
    "test": "hand tools (new objects altogether)",
}
PARTS = {"val": "the new versions", "test": "the hand tools"}
"""What the splits of the paper's protocol hold, to a run trained on the same dataset, in short."""


def section(report: ReportData) -> str:
    """The sentences, then a press whose error is the middle one of the better run's."""
    parts = [markup.paragraph(sentence) for sentence in sentences(report)]
    return markup.section("summary", "In short", [*parts, _picture(report)])


def sentences(report: ReportData) -> list[str]:
    """What was translated into what; how well; beside what; what that means. All from metrics."""
    return [_task(report), _errors(report), _comparison(report), _meaning(report)]


def better_run(evaluation: Evaluation) -> str:
    """The name of the run with the lower RMSE on a split, the first of equals."""
    return min(evaluation.runs, key=lambda name: evaluation.runs[name].overall.rmse_counts)


def _task(report: ReportData) -> str:
    taxels, full_scale = report.layout.x_mm.size, report.layout.full_scale_counts
    names = [name_of(name) for name in report.runs]
    learned = (
        f"the network {names[0]} has" if len(names) == 1 else f"the networks {_and(names)} have"
    )
    several = report.forces_n.size > 1
    forces = f" They press with {forces_in_words(report.forces_n)}." if several else ""
    if report.info.is_simulated:
        return (
            "A DIGIT (a camera that films a soft gel from behind) and a CySkin (an array of "
            f"{taxels} pressure pads, called taxels, under a soft cover) touch the same shapes in "
            f"simulation, and {learned} learned to translate the DIGIT's picture of a press into "
            f"the {taxels} counts, each from 0 to {full_scale:,.0f}, that the CySkin gives.{forces}"
        )
    return (
        "The pairs were brought in by their owner: the picture of a camera-based touch sensor "
        f"(DIGIT) and the counts, each from 0 to {full_scale:,.0f}, of an array of {taxels} "
        f"pressure pads, called taxels (CySkin), at the same touch; {learned} learned to translate "
        "the picture into the counts."
    )


def _errors(report: ReportData) -> str:
    parts = []
    for split, evaluation in report.evaluations.items():
        rows = sorted(evaluation.runs.items(), key=lambda item: item[1].overall.rmse_counts)
        errors = [f"{row.overall.rmse_percent:.2f} % for {name_of(name)}" for name, row in rows]
        parts.append(f"{_and(errors)} on {_where(report, split)}")
    order = " (lower first)" if len(report.runs) > 1 else ""
    return (
        "The error, as RMSE (root of the mean squared difference between translated and true "
        f"counts) in percent of full scale, is{order} {', and '.join(parts)}."
    )


def _comparison(report: ReportData) -> str:
    mean, nearest = (
        " and ".join(
            f"{evaluation.models[name].overall.rmse_percent:.2f} %"
            for evaluation in report.evaluations.values()
        )
        for name in (MEAN_ARRAY, NEAREST_NEIGHBOR)
    )
    order = ", in the same order" if len(report.evaluations) > 1 else ""
    ratios = " and ".join(f"{_ratio(one):.2f}" for one in report.evaluations.values())
    return (
        f"Two rules that learn nothing stand beside that{order}: the mean of all training presses "
        f"(mean array) is off by {mean}, the training press whose picture is most alike (nearest "
        f"neighbour) by {nearest}, and the error of the {_best(report)} is {ratios} times the "
        "lower of the two."
    )


def _meaning(report: ReportData) -> str:
    below = [split for split, one in report.evaluations.items() if _ratio(one) < 1.0]
    if below:
        parts = PARTS if report.info.is_protocol else SPLIT_NAMES
        only = "" if len(below) == len(report.evaluations) else f" on {parts[below[0]]} only"
        verdict = f"So the {_best(report)} beats both rules{only}"
    else:
        verdict = f"So the {_best(report)} does not beat both rules"
    if report.info.is_simulated:
        return (
            f"{verdict}; since all of it is simulated, with one sensor of each kind, that says "
            "which method copes better, not how far it would be off with two real sensors."
        )
    return (
        f"{verdict}; that holds for these two sensors and presses like these, and says nothing of "
        "others."
    )


def _best(report: ReportData) -> str:
    return "better network" if len(report.runs) > 1 else "network"


def _where(report: ReportData, split: str) -> str:
    """What a split holds, and whether its shapes were trained on, where that is known."""
    evaluation = report.evaluations[split]
    pairs = f"the {evaluation.pairs:,} {SPLIT_NAMES[split]} pairs"
    if not all(row.same_data for row in evaluation.runs.values()):
        return pairs
    own, trained = (set(report.tables[s]["shape"].to_pylist()) for s in (split, "train"))
    if own <= trained:
        return f"{pairs} (of shapes that were trained on)"
    if own & trained:
        return f"{pairs} (some of shapes that were trained on)"
    if report.info.is_protocol:
        return NEVER_TRAINED_ON[split]
    return f"{pairs} (of shapes never trained on)"


def _ratio(evaluation: Evaluation) -> float:
    """The better run's RMSE in parts of the lower one of the two rules'."""
    trivial = (evaluation.models[name] for name in (MEAN_ARRAY, NEAREST_NEIGHBOR))
    lowest = min(row.overall.rmse_counts for row in trivial)
    best = evaluation.runs[better_run(evaluation)].overall.rmse_counts
    return best / lowest if lowest else float("inf")


def _picture(report: ReportData) -> str:
    split, evaluation = next(iter(report.evaluations.items()))
    name, predictions = better_run(evaluation), report.predictions[split]
    errors = predictions.rmse_counts(name)
    row = int(np.argsort(errors, kind="stable")[(errors.size - 1) // 2])
    shape = shape_name(report.shape(split, row))
    note = (
        f"Left: the picture that {name_of(name)} was given, a press of {shape}. Middle: what the "
        "taxels (draw_taxels) really counted, interpolated between them. Right: what it translated the "
        f"picture into, {errors[row]:,.0f} counts off (RMSE): of {errors.size:,} "
        f"{SPLIT_NAMES[split]} pairs the one whose error is in the middle. The colors of both are "
        "counts, by the scale on the right."
    )
    content = example(report, split, row, predictions.by_model[name][row])
    alt = "A DIGIT picture, the true tactile image and the translated one"
    return markup.embed(content, "png", alt, "One translation.", width="small", note=note)


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
