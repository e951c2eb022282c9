"""How sure runs are and whether they are so rightly: reliability, and risk against coverage."""

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
"""Of runs that say how sure they are, in turn."""


def is_said(evaluations: dict[str, Evaluation]) -> bool:
    """Whether any run says how sure it is."""
    return any(
        row.uncertainty is not None for one in evaluations.values() for row in one.runs.values()
    )


def section(report: ReportData) -> str:
    """Both charts, all splits in each, and what they come to in words."""
    evaluations = report.evaluations
    content = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, evaluations))
    text = (
        "A DIGIT sees less than the CySkin feels, so the same picture may mean several arrays. A "
        "field run gives each count a standard deviation, whose size was put right on the "
        "validation pairs of its own training world and nowhere else."
    )
    note = (
        "Left: of intervals that are said to hold a share of the counts, the share that they hold; "
        "on the diagonal they hold what they say. Right: the RMSE over the presses that the run is "
        "surest of, against how many those are; where it knows what it does not know, the line "
        "falls to the left."
    )
    said = [
        f"{SPLIT_NAMES[split].capitalize()}: {line}"
        for split, one in evaluations.items()
        for line in uncertainty_text({name_of(name): row for name, row in one.runs.items()})
    ]
    alt = "Shares held against shares said, and error against the share of presses kept"
    return markup.section(
        "sureness",
        "How sure",
        [
            markup.paragraph(text),
            markup.picture(content, "svg", alt, note=note),
            markup.items(said),
        ],
    )


def _draw(page: Figure, evaluations: dict[str, Evaluation]) -> None:
    left, right = page.subplots(1, 2)
    for split, evaluation in evaluations.items():
        sure = {
            n: row.uncertainty for n, row in evaluation.runs.items() if row.uncertainty is not None
        }
        for style, (name, one) in zip(STYLES * len(sure), sure.items(), strict=False):
            label = f"{name_of(name)}, {SPLIT_NAMES[split]}"
            _lines(left, right, one, style, SPLIT_COLORS[split], label)
    left.plot((0, 100), (0, 100), color="#999999", linewidth=0.8)
    left.set(xlabel="said, %", ylabel="held, %", xlim=(0, 100), ylim=(0, 100))
    right.axvline(100 * REPORTED_SHARE, color="#999999", linewidth=0.8)
    right.set(xlabel="presses kept, %", ylabel="RMSE, counts", xlim=(0, 100), ylim=(0, None))
    right.yaxis.set_major_formatter("{x:,.0f}")
    left.legend()
    right.legend()


def _lines(
    left: Axes, right: Axes, sure: UncertaintyMetrics, style: str, color: str, label: str
) -> None:
    percent = [
        [100 * share for share in shares] for shares in (sure.levels, sure.coverage, sure.retained)
    ]
    left.plot(percent[0], percent[1], style, color=color, marker="o", markersize=3, label=label)
    right.plot(percent[2], sure.retained_rmse_counts, style, color=color, label=label)
