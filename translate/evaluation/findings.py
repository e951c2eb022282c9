"""Does the paper's finding hold here? Each part of it answered by an interval.

Grella et al. 2023 found that ResNet18 has the lower error, that touch2touch keeps the shape of the
contact better, and that both lose from the validation split to the novel objects.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import numpy as np

from t2twin.translate.evaluation.metrics.array_errors import GroupedFigures
from t2twin.translate.evaluation.metrics.baselines import MEAN_ARRAY
from t2twin.translate.evaluation.metrics.bootstrap import SEED, draws, interval
from t2twin.translate.evaluation.records import (
    Answer,
    Difference,
    FigureName,
    Finding,
    ModelRow,
)

TOUCH2TOUCH, RESNET18 = "touch2touch", "resnet18"

DIFFERENCES: dict[str, tuple[FigureName, str]] = {
    "lower-error": ("rmse_counts", "Has ResNet18 the lower error?"),
    "better-shape-ssim": ("ssim", "Does touch2touch keep the shape better, by SSIM?"),
    "better-shape-iou": ("contact_iou", "Does touch2touch keep the shape better, by contact IoU?"),
}
"""Findings about touch2touch less ResNet18, with the figure that each is read from: a difference
above zero says yes."""

GAP = "gap"
GAP_QUESTION = "Is {} worse on the novel objects than on validation?"


def paired(
    models: Mapping[str, ModelRow], resampled: Mapping[str, GroupedFigures]
) -> dict[str, Difference]:
    """touch2touch less ResNet18 in every overall figure that both have; empty without both.

    models: the rows by name. resampled: each row's figures in the same resamples.
    Returns the differences by figure.
    """
    if not {TOUCH2TOUCH, RESNET18} <= models.keys():
        return {}
    differences = {}
    for figure in get_args(FigureName):
        one, two = (models[name].overall.value(figure) for name in (TOUCH2TOUCH, RESNET18))
        drawn = (getattr(resampled[name], figure) for name in (TOUCH2TOUCH, RESNET18))
        if one is not None and two is not None:
            differences[figure] = Difference(one - two, interval(np.subtract(*drawn)))
    return differences


def findings(
    models: Mapping[str, ModelRow], differences: Mapping[str, Difference]
) -> dict[str, Finding]:
    """The findings that one split can speak of, by name; empty without both models.

    models: the rows by name. differences: what `paired` says of them.
    """
    answers = {}
    for name, (figure, question) in DIFFERENCES.items():
        if figure in differences:
            values = {
                model: models[model].overall.value(figure) for model in (TOUCH2TOUCH, RESNET18)
            }
            known = {model: value for model, value in values.items() if value is not None}
            answers[name] = _finding(question, figure, differences[figure], known)
    return answers


def gap(val: Mapping[str, ModelRow], test: Mapping[str, ModelRow]) -> dict[str, Finding]:
    """How much worse each run is on the objects: findings by "gap-MODEL".

    val, test: the rows of the two splits, whose shapes are resampled apart. The errors in percent
    of the mean array's stand beside, for the splits are not equally hard for one that learns
    nothing.
    """
    answers = {}
    for name, on_test in test.items():
        if on_test.run is None or name not in val:
            continue
        figures = {"val": val[name].overall.rmse_counts, "test": on_test.overall.rmse_counts}
        of_mean = {
            "val": 100.0 * figures["val"] / val[MEAN_ARRAY].overall.rmse_counts,
            "test": 100.0 * figures["test"] / test[MEAN_ARRAY].overall.rmse_counts,
        }
        resampled = _rmse_counts(on_test, SEED) - _rmse_counts(val[name], SEED + 1)
        difference = Difference(figures["test"] - figures["val"], interval(resampled))
        finding = _finding(GAP_QUESTION.format(name), "rmse_counts", difference, figures)
        answers[f"{GAP}-{name}"] = replace(finding, model=name, percent_of_mean_array=of_mean)
    return answers


def _rmse_counts(model: ModelRow, seed: int) -> np.ndarray:
    """The RMSE in every resample of the shapes, (B,) counts, from the figures of each shape."""
    shapes = list(model.by_shape.values())
    pairs = np.array([shape.pairs for shape in shapes], dtype=float)
    squares = pairs * np.square([shape.rmse_counts for shape in shapes])
    drawn = draws(len(shapes), seed)
    return np.sqrt((drawn @ squares) / (drawn @ pairs))


def _finding(
    question: str, figure: FigureName, difference: Difference, figures: dict[str, float]
) -> Finding:
    span = difference.interval
    answer: Answer
    if span is None or span.low <= 0 <= span.high:
        answer = "undecided"
    else:
        answer = "yes" if span.low > 0 else "no"
    return Finding(question, answer, figure, difference.difference, span, figures)
