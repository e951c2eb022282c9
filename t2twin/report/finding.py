"""Does the paper's finding hold here? A row a question, answered by an interval."""

from typing import Any

from t2twin.report import markup
from t2twin.report.material import SHOWN, ReportData
from t2twin.report.names import SPLIT_NAMES, name_of
from t2twin.translate.evaluation.findings import gap
from t2twin.translate.evaluation.table import HOW

GIVEN = {
    "lower-error": "ResNet18 has the lower error (sqrt(L3), counts)",
    "better-shape-ssim": "touch2touch keeps the contact's shape better (SSIM)",
    "better-shape-iou": "touch2touch keeps the contact's shape better (contact IoU)",
}
GAP = "Novel objects are worse than validation (sqrt(L3), counts)"


def section(material: ReportData) -> str:
    """The table, and what stands behind its answers."""
    metrics = {split: material.evaluated[split].metrics for split in SHOWN}
    groups = answers(metrics)
    how, shapes = metrics["val"]["bootstrap"], [metrics[s]["bootstrap"]["shapes"] for s in SHOWN]
    text = (
        "Grella et al. found that ResNet18 has the lower error, that touch2touch keeps the "
        "contact's shape better, and that both lose on novel objects. Here the difference of the "
        f"two models, and of the two splits, is taken in {how['resamples']:,} bootstrap resamples "
        f"of whole shapes ({shapes[0]} of validation, {shapes[1]} of test), the same shapes for "
        f"both models. Yes or no where the {100 * how['confidence']:.0f} % interval of the "
        "difference does not hold nought, else undecided. With so few shapes the intervals are "
        "rather too narrow than too wide; and they speak of these two trainings, not of others "
        "from another seed."
    )
    return markup.section(
        "finding",
        "Does the paper's finding hold here?",
        [
            markup.table(
                [[("", 1), ("Answer", 1), ("Difference", 1), ("Interval", 1), ("Figures", 1)]],
                groups,
            ),
            markup.paragraph(text, "note"),
        ],
    )


def answers(metrics: dict[str, dict[str, Any]]) -> list[tuple[str, list[list[str]]]]:
    """What the paper found, each with its rows: of what, answer, difference, interval, figures.

    metrics: by split, what `evaluate` returns. Without both models there is the gap alone.
    """
    groups = [
        (
            statement,
            [
                _row(SPLIT_NAMES[split], metrics[split]["findings"][name])
                for split in SHOWN
                if name in metrics[split]["findings"]
            ],
        )
        for name, statement in GIVEN.items()
    ]
    gaps = []
    for finding in gap(metrics["val"], metrics["test"]).values():
        row = _row(name_of(finding["model"]), finding)
        of_mean = finding["percent_of_mean_array"]
        row[-1] += f"; {of_mean['val']:.0f} % and {of_mean['test']:.0f} % of the mean array's"
        gaps.append(row)
    return [group for group in (*groups, (GAP, gaps)) if group[1]]


def _row(statement: str, finding: dict[str, Any]) -> list[str]:
    how = HOW[finding["figure"]].replace(":.0f", ":,.0f")
    span = finding["interval"]
    return [
        statement,
        finding["answer"],
        _signed(how, finding["difference"]),
        "none" if span is None else f"{_signed(how, span[0])} to {_signed(how, span[1])}",
        ", ".join(
            f"{SPLIT_NAMES.get(name) or name_of(name)} {how.format(value)}"
            for name, value in finding["figures"].items()
        ),
    ]


def _signed(how: str, value: float) -> str:
    return how.format(value).replace("-", "−")
