"""Does the paper's finding hold here? A row a question, answered by an interval."""

from collections.abc import Mapping

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, name_of
from t2twin.translate.evaluation.records import Evaluation, Finding
from t2twin.translate.evaluation.table import FORMS

GIVEN = {
    "lower-error": "ResNet18 has the lower error (RMSE, counts)",
    "better-shape-ssim": "touch2touch keeps the contact's shape better (SSIM)",
    "better-shape-iou": "touch2touch keeps the contact's shape better (contact IoU)",
}
GAP = "Novel objects are worse than validation (RMSE, counts)"


def section(report: ReportData) -> str:
    """The table, and what stands behind its answers."""
    how = report.evaluation.bootstrap
    shapes = " and ".join(
        f"{evaluation.bootstrap.shapes} of {SPLIT_NAMES[split]}"
        for split, evaluation in report.evaluations.items()
    )
    text = (
        "Grella et al. found that ResNet18 has the lower error, that touch2touch keeps the "
        "contact's shape better, and that both lose on novel objects. Here the difference of the "
        f"two models{', and of the two splits,' if report.gap else ''} is taken in "
        f"{how.resamples:,} bootstrap resamples of whole shapes ({shapes}), the same shapes for "
        f"both models. Yes or no where the {100 * how.confidence:.0f} % interval of the "
        "difference does not hold zero, else undecided. With so few shapes the intervals are "
        "rather too narrow than too wide; and they speak of these two trainings, not of others "
        "from another seed."
    )
    return markup.section(
        "finding",
        "Does the paper's finding hold here?",
        [
            markup.table(
                [[("", 1), ("Answer", 1), ("Difference", 1), ("Interval", 1), ("Figures", 1)]],
                answers(report.evaluations, report.gap),
            ),
            markup.paragraph(text, "note"),
        ],
    )


def answers(
    evaluations: Mapping[str, Evaluation], gap: Mapping[str, Finding]
) -> list[tuple[str, list[list[str]]]]:
    """What the paper found, each with its rows: of what, answer, difference, interval, figures.

    evaluations: by split. gap: between the two splits. Without both models there is that alone.
    """
    groups = [
        (
            statement,
            [
                _row(SPLIT_NAMES[split], evaluation.findings[name])
                for split, evaluation in evaluations.items()
                if name in evaluation.findings
            ],
        )
        for name, statement in GIVEN.items()
    ]
    gaps = []
    for finding in gap.values():
        row = _row(name_of(finding.model or ""), finding)
        of_mean = finding.percent_of_mean_array or {}
        row[-1] += f"; {of_mean['val']:.0f} % and {of_mean['test']:.0f} % of the mean array's"
        gaps.append(row)
    return [group for group in (*groups, (GAP, gaps)) if group[1]]


def _row(statement: str, finding: Finding) -> list[str]:
    how = FORMS[finding.figure].replace(":.0f", ":,.0f")
    span = finding.interval
    return [
        statement,
        finding.answer,
        _signed(how, finding.difference),
        "none" if span is None else f"{_signed(how, span.low)} to {_signed(how, span.high)}",
        ", ".join(
            f"{SPLIT_NAMES.get(name) or name_of(name)} {how.format(value)}"
            for name, value in finding.figures.items()
        ),
    ]


def _signed(how: str, value: float) -> str:
    return how.format(value).replace("-", "−")
