"""The findings of the paper, tested on an evaluation; intervals decide.

Grella et al. 2023 found that ResNet18 has the lower error, that touch2touch preserves the shape of
the contact better, and that both are worse on novel objects than on the validation split.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import get_args

import numpy as np

from t2twin.translate.evaluation.array_errors import (
    SEED,
    GroupedFigures,
    interval,
    resample_weights,
)
from t2twin.translate.evaluation.baselines import MEAN_ARRAY
from t2twin.translate.evaluation.records import (
    Answer,
    Difference,
    Evaluation,
    FigureName,
    Finding,
    ModelRow,
)

TOUCH2TOUCH, RESNET18 = "touch2touch", "resnet18"

DIFFERENCES: dict[str, tuple[FigureName, str]] = {
    "lower-error": ("rmse_counts", "Does ResNet18 have the lower error?"),
    "better-shape-ssim": ("ssim", "Does touch2touch keep the shape better, by SSIM?"),
    "better-shape-iou": ("contact_iou", "Does touch2touch keep the shape better, by contact IoU?"),
}
"""Findings about touch2touch minus ResNet18, with their figures; a positive difference is a yes."""

GAP = "gap"
GAP_QUESTION = "Is {} worse on the novel objects than on validation?"


def paired(
    models: Mapping[str, ModelRow], resampled: Mapping[str, GroupedFigures]
) -> dict[str, Difference]:
    """touch2touch minus ResNet18 in each overall figure that both have; empty without both.

    models: rows by name. resampled: figures of each row in the same resamples. Returns the
    differences by figure.
    """
    if not {TOUCH2TOUCH, RESNET18} <= models.keys():
        return {}
    differences = {}
    for figure in get_args(FigureName):
        one, two = (getattr(models[name].overall, figure) for name in (TOUCH2TOUCH, RESNET18))
        samples = (resampled[name][figure] for name in (TOUCH2TOUCH, RESNET18))
        if one is not None and two is not None:
            differences[figure] = Difference(one - two, interval(np.subtract(*samples)))
    return differences


def findings(
    models: Mapping[str, ModelRow], differences: Mapping[str, Difference]
) -> dict[str, Finding]:
    """The findings within one split, by name; empty without both models.

    models: rows by name. differences: of `paired`.
    """
    answers = {}
    for name, (figure, question) in DIFFERENCES.items():
        if figure in differences:
            both = (TOUCH2TOUCH, RESNET18)
            values = {model: getattr(models[model].overall, figure) for model in both}
            answers[name] = _finding(question, figure, differences[figure], values)
    return answers


def gap_between(evaluations: Mapping[str, Evaluation]) -> dict[str, Finding]:
    """`gap` of the evaluations of validation and test, by split.

    Empty without both splits, and for a dataset that does not follow the paper's protocol.
    """
    if set(evaluations) != {"val", "test"} or not all(one.paper for one in evaluations.values()):
        return {}
    return gap(evaluations["val"].models, evaluations["test"].models)


def gap(val: Mapping[str, ModelRow], test: Mapping[str, ModelRow]) -> dict[str, Finding]:
    """Difference of each run's error between novel objects and validation, by "gap-MODEL".

    val, test: rows of the two splits, whose shapes are resampled independently. Errors in percent
    of the mean array's account for the different difficulty of the splits.
    """
    answers = {}
    for name, on_test in test.items():
        if on_test.run is None or name not in val:
            continue
        figures = {"val": val[name].overall.counts, "test": on_test.overall.counts}
        of_mean = {
            "val": 100.0 * figures["val"] / val[MEAN_ARRAY].overall.counts,
            "test": 100.0 * figures["test"] / test[MEAN_ARRAY].overall.counts,
        }
        resampled = _rmse_counts(on_test, SEED) - _rmse_counts(val[name], SEED + 1)
        difference = Difference(figures["test"] - figures["val"], interval(resampled))
        finding = _finding(GAP_QUESTION.format(name), "rmse_counts", difference, figures)
        answers[f"{GAP}-{name}"] = replace(finding, model=name, percent_of_mean_array=of_mean)
    return answers


def _rmse_counts(model: ModelRow, seed: int) -> np.ndarray:
    """RMSE in each resample of the shapes, (B,), counts, from the figures of the shapes."""
    shapes = list(model.by_shape.values())
    pairs = np.array([shape.pairs for shape in shapes], dtype=float)
    squares = pairs * np.square([shape.counts for shape in shapes])
    weights = resample_weights(len(shapes), seed)
    return np.sqrt((weights @ squares) / (weights @ pairs))


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
