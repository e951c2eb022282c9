"""The paper's finding, tested on this dataset with bootstrap intervals."""

from collections.abc import Mapping

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, name_of
from t2twin.translate.evaluation.records import Evaluation, Finding
from t2twin.translate.evaluation.table import FORMS

STATEMENTS = {
    "lower-error": "ResNet18 has the lower error (RMSE, counts)",
    "better-shape-ssim": "touch2touch preserves the shape of the contact better (SSIM)",
    "better-shape-iou": "touch2touch preserves the shape of the contact better (contact IoU)",
}
GAP = "Novel objects are worse than validation (RMSE, counts)"


def section(report: ReportData) -> str:
    """Table of the answers, and their method."""
    how = report.evaluation.bootstrap
    shapes = " and ".join(
        f"{evaluation.bootstrap.shapes} of {SPLIT_NAMES[split]}"
        for split, evaluation in report.evaluations.items()
    )
    text = (
        "Grella et al. found that ResNet18 has the lower error, that touch2touch preserves the "
        "shape of the contact better, and that both perform worse on novel objects. Here the "
        f"difference of the two models{', and of the two splits,' if report.gap else ''} is "
        f"computed for {how.resamples:,} bootstrap resamples of shapes ({shapes}), identical for "
        f"both models. The answer is undecided if the {100 * how.confidence:.0f} % interval of the "
        "difference includes zero. With few shapes the intervals tend to be too narrow. They do "
        "not include the variation between trainings with different seeds."
    )
    return markup.section(
        "finding",
        "Does the paper's finding hold here?",
        [
            markup.table(
                [[("", 1), ("Answer", 1), ("Difference", 1), ("Interval", 1), ("Figures", 1)]],
                finding_rows(report.evaluations, report.gap),
            ),
            markup.paragraph(text, "note"),
        ],
    )


def finding_rows(
    evaluations: Mapping[str, Evaluation], gap: Mapping[str, Finding]
) -> list[tuple[str, list[list[str]]]]:
    """Rows by statement of the paper: split or model, answer, difference, interval, figures.

    evaluations: by split. gap: differences between the splits. Statements about both models require
    both.
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
        for name, statement in STATEMENTS.items()
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
