"""Does the paper's finding hold here? Each part of it answered by an interval.

Grella et al. 2023 found that ResNet18 has the lower error, that touch2touch keeps the shape of the
contact better, and that both lose from the validation split to the novel objects.
"""

from typing import Any

import numpy as np

from t2twin.translate.evaluation.baselines import MEAN_ARRAY
from t2twin.translate.evaluation.bootstrap import SEED, draws, interval

TOUCH2TOUCH, RESNET18 = "touch2touch", "resnet18"

DIFFERENCES = {
    "lower-error": ("rmse_counts", "Has ResNet18 the lower error?"),
    "better-shape-ssim": ("ssim", "Does touch2touch keep the shape better, by SSIM?"),
    "better-shape-iou": ("contact_iou", "Does touch2touch keep the shape better, by contact IoU?"),
}
"""Findings about touch2touch less ResNet18, with the figure that each is read from: a difference
above nought says yes."""

GAP = "gap"
GAP_QUESTION = "Is {} worse on the novel objects than on validation?"


def paired(models: dict[str, Any], replicates: dict[str, dict[str, np.ndarray]]) -> dict[str, Any]:
    """touch2touch less ResNet18 in every overall figure; empty where not both are there, once each.

    models: what `evaluate` says of each. replicates: of each model, its figures in the same
    resamples. Returns {figure: {"difference", "interval"}}.
    """
    if not {TOUCH2TOUCH, RESNET18} <= models.keys():
        return {}
    one, two = (models[name]["overall"] for name in (TOUCH2TOUCH, RESNET18))
    return {
        figure: {
            "difference": one[figure] - two[figure],
            "interval": interval(replicates[TOUCH2TOUCH][figure] - replicates[RESNET18][figure]),
        }
        for figure in replicates[TOUCH2TOUCH]
        if one[figure] is not None and two[figure] is not None
    }


def findings(metrics: dict[str, Any]) -> dict[str, Any]:
    """The findings that one split can speak of, by name; empty without both models.

    metrics: what `evaluate` returns, with its "paired". Each finding has "question", "answer" (yes,
    no or undecided: the interval holds nought), "figure", "difference", "interval", "figures".
    """
    found = {}
    for name, (figure, question) in DIFFERENCES.items():
        if figure in metrics["paired"]:
            found[name] = _finding(
                question,
                figure,
                metrics["paired"][figure],
                {m: metrics["models"][m]["overall"][figure] for m in (TOUCH2TOUCH, RESNET18)},
            )
    return found


def gap(val: dict[str, Any], test: dict[str, Any]) -> dict[str, Any]:
    """How much worse each run is on the objects: findings by "gap-MODEL".

    val, test: what `evaluate` returns of the two splits, whose shapes are resampled apart. The
    errors in percent of the mean array's stand beside, as "percent_of_mean_array", for the splits
    are not equally hard for one that learns nothing.
    """
    found = {}
    for name, model in test["models"].items():
        if "run" not in model or name not in val["models"]:
            continue
        of = {"val": val["models"][name], "test": model}
        figures = {split: one["overall"]["rmse_counts"] for split, one in of.items()}
        found[f"{GAP}-{name}"] = _finding(
            GAP_QUESTION.format(name),
            "rmse_counts",
            {
                "difference": figures["test"] - figures["val"],
                "interval": interval(
                    _rmse_counts(of["test"], SEED) - _rmse_counts(of["val"], SEED + 1)
                ),
            },
            figures,
        )
        found[f"{GAP}-{name}"] |= {
            "model": name,
            "percent_of_mean_array": {
                split: 100.0 * figures[split] / one["models"][MEAN_ARRAY]["overall"]["rmse_counts"]
                for split, one in (("val", val), ("test", test))
            },
        }
    return found


def _rmse_counts(model: dict[str, Any], seed: int) -> np.ndarray:
    """sqrt(L3) in every resample of the shapes, from the figures of each shape."""
    shapes = list(model["by_shape"].values())
    pairs = np.array([shape["pairs"] for shape in shapes], dtype=float)
    squares = pairs * np.square([shape["rmse_counts"] for shape in shapes])
    drawn = draws(len(shapes), seed)
    return np.sqrt((drawn @ squares) / (drawn @ pairs))


def _finding(
    question: str, figure: str, difference: dict[str, Any], figures: dict[str, float]
) -> dict[str, Any]:
    span = difference["interval"]
    if span is None or span[0] <= 0 <= span[1]:
        answer = "undecided"
    else:
        answer = "yes" if span[0] > 0 else "no"
    return {"question": question, "answer": answer, "figure": figure, **difference,
            "figures": figures}  # fmt: skip
