"""Uncertainty of the predictions: reliability diagram and risk-coverage curve."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import SPLIT_COLORS, SPLIT_NAMES, name_of
from t2twin.translate.evaluation.metrics.reliability import REPORTED_SHARE, uncertainty_text
from t2twin.translate.evaluation.records import Evaluation, UncertaintyMetrics

WIDTH_IN, HEIGHT_IN = 9.0, 3.4
STYLES = ("-", "--", ":")
"""Line styles of the runs with uncertainty."""


def has_uncertainty(evaluations: dict[str, Evaluation]) -> bool:
    """Whether any run predicts uncertainty."""
    return any(
        row.uncertainty is not None for one in evaluations.values() for row in one.runs.values()
    )


def section(report: ReportData) -> str:
    """Both charts with all splits, and a summary."""
    evaluations = report.evaluations
    content = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, evaluations))
    text = (
        "The DIGIT's field of view is smaller than the CySkin, so one image may correspond to "
        "several arrays. A field run predicts a standard deviation for each count, calibrated on "
        "the validation pairs of its training world only."
    )
    note = (
        "Left: observed coverage of intervals against their nominal coverage; calibrated intervals "
        "lie on the diagonal. Right: RMSE over the presses with the lowest predicted uncertainty, "
        "against their share; if the uncertainty ranks the errors, the RMSE falls to the left."
    )
    sentences = [
        f"{SPLIT_NAMES[split].capitalize()}: {line}"
        for split, one in evaluations.items()
        for line in uncertainty_text({name_of(name): row for name, row in one.runs.items()})
    ]
    alt = "Reliability diagram, and RMSE against the share of presses"
    return markup.section(
        "uncertainty",
        "Uncertainty",
        [
            markup.paragraph(text),
            markup.embed(content, "svg", alt, note=note),
            markup.items(sentences),
        ],
    )


def _draw(page: Figure, evaluations: dict[str, Evaluation]) -> None:
    left, right = page.subplots(1, 2)
    for split, evaluation in evaluations.items():
        rows = {
            n: row.uncertainty for n, row in evaluation.runs.items() if row.uncertainty is not None
        }
        for style, (name, metrics) in zip(STYLES * len(rows), rows.items(), strict=False):
            label = f"{name_of(name)}, {SPLIT_NAMES[split]}"
            _lines(left, right, metrics, style, SPLIT_COLORS[split], label)
    left.plot((0, 100), (0, 100), color="#999999", linewidth=0.8)
    left.set(
        xlabel="nominal coverage, %", ylabel="observed coverage, %", xlim=(0, 100), ylim=(0, 100)
    )
    right.axvline(100 * REPORTED_SHARE, color="#999999", linewidth=0.8)
    right.set(
        xlabel="presses with the lowest uncertainty, %", ylabel="RMSE, counts", xlim=(0, 100),
        ylim=(0, None),
    )  # fmt: skip
    right.yaxis.set_major_formatter("{x:,.0f}")
    left.legend()
    right.legend()


def _lines(
    left: Axes, right: Axes, metrics: UncertaintyMetrics, style: str, color: str, label: str
) -> None:
    nominal, observed, kept = (
        [100 * share for share in shares]
        for shares in (metrics.levels, metrics.coverage, metrics.retained)
    )
    left.plot(nominal, observed, style, color=color, marker="o", markersize=3, label=label)
    right.plot(kept, metrics.retained_rmse_counts, style, color=color, label=label)
