"""Estimate of the irreducible error, from presses with similar images."""

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.figures import figure
from t2twin.report.html.labels import SPLIT_NAMES, colors, name_of
from t2twin.translate.evaluation.metrics.baselines import FEATURE_SIZE
from t2twin.translate.evaluation.metrics.irreducible_error import (
    CLOSE,
    FITTED_SHARE,
    NEIGHBORS,
)
from t2twin.translate.evaluation.records import IrreducibleError, IrreducibleErrorFloor

WIDTH_IN, HEIGHT_IN = 9.0, 3.6
SPLIT_STYLE, TRAINING_STYLE = ("#222222", "o"), ("#009e73", "D")
"""Color and marker of the nearest neighbors in the split and in the training pairs."""

GROUPS = {"under": "under the field of view", "near": "near it", "beyond": "beyond"}


def section(report: ReportData) -> str:
    """Chart and summary of the evaluations with an estimate."""
    estimates = {
        split: one.irreducible_error
        for split, one in report.evaluations.items()
        if one.irreducible_error is not None
    }
    content = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, report, estimates))
    text = (
        "Each press is compared with the presses of the nearest images, among other shapes of the "
        "same split and among the training pairs. A translator predicts the same counts for "
        "indistinguishable images. If both presses are samples of the arrays that such an image "
        "may correspond to, its RMSE is at least sqrt(mean squared difference / 2). The chart "
        "shows this bound against the distance of the images."
    )
    note = (
        f"Distance: RMS difference of RGB images of {FEATURE_SIZE} × {FEATURE_SIZE} pixels. "
        f"Points: bins with equal numbers of pairs, from the {NEIGHBORS} nearest neighbors of each "
        "press. Square: extrapolation to the distance that noise alone causes, with its interval "
        "over shapes; it assumes that half the squared difference is linear in the squared "
        f"distance, and is fitted to the nearest {100 * FITTED_SHARE:.0f} % of the pairs of each "
        "shape. Horizontal lines: RMSE of the models."
    )
    if (report.forces_n == 0).any():
        note += " Presses without contact are excluded."
    bounds = (
        "The bound is an average over presses with similar neighbors, for images of this size. It "
        "does not apply to networks with larger images or to presses without similar neighbors. "
        "If the nearest image is much farther away than the noise, the extrapolation depends on "
        "the linear assumption. The estimate from training pairs also includes the bias of "
        "training on other shapes."
    )
    return markup.section(
        "irreducible-error",
        "Irreducible error",
        [
            markup.paragraph(text),
            markup.embed(
                content, "svg", "Difference of counts against distance of images", note=note
            ),
            markup.items(sentences(estimates)),
            markup.paragraph(bounds, "note"),
        ],
    )


def sentences(estimates: Mapping[str, IrreducibleError]) -> list[str]:
    """Summary of each split and source of neighbors. estimates: by split."""
    result = []
    for split, one in estimates.items():
        sources = {"other shapes of the same split": one.split, "training pairs": one.training}
        for source, floor in sources.items():
            text = "no neighbors." if floor is None else _sentence(floor, one.close_grey)
            result.append(f"{SPLIT_NAMES[split].capitalize()}, {source}: {text}")
    return result


def _sentence(floor: IrreducibleErrorFloor, close_grey: float) -> str:
    near, close = floor.nearest, floor.close
    within = (
        f"{close.pairs:,} of {near.pairs:,} presses have a neighbor within {close_grey:.2f} grey "
        f"levels, {CLOSE:g} times the distance that noise causes"
    )
    if close.pairs:
        within += f" (bound {close.rmse_counts:,.0f} counts)"
    line = ""
    value, span = floor.extrapolated_rmse_counts, floor.interval
    if value is not None:
        between = "" if span is None else f" ({span.low:,.0f} to {span.high:,.0f})"
        groups = ", ".join(
            f"{bound:,.0f} {GROUPS[name]}"
            for name, bound in floor.parts.items()
            if bound is not None
        )
        line = f" Extrapolated bound: {value:,.0f} counts{between}"
        line += f"; by group of taxels: {groups}." if groups else "."
    return (
        f"the median distance of the nearest image is {near.distance_grey:.1f} grey levels, with a "
        f"bound of {near.rmse_counts:,.0f} counts; {within}.{line}"
    )


def _draw(page: Figure, report: ReportData, estimates: Mapping[str, IrreducibleError]) -> None:
    places = page.subplots(1, len(estimates), sharey=True, squeeze=False)[0]
    for axes, split in zip(places, estimates, strict=True):
        _curves(axes, report, split, estimates[split])
    places[0].set_ylim(0, None)
    places[0].set_ylabel("sqrt(mean squared difference / 2), counts")
    page.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


def _curves(axes: Axes, report: ReportData, split: str, estimate: IrreducibleError) -> None:
    noise = estimate.noise_grey
    for floor, style, label in (
        (estimate.split, SPLIT_STYLE, "other shapes of the split"),
        (estimate.training, TRAINING_STYLE, "training pairs"),
    ):
        if floor is not None:
            _curve(axes, floor, style, label, noise)
    models = report.evaluations[split].models
    for name, color in colors(list(report.runs)).items():
        if name in report.runs:
            level = models[name].overall.rmse_counts
            axes.axhline(level, color=color, linewidth=1, label=name_of(name))
    axes.axvline(noise, color="#999999", linewidth=0.8, linestyle=":", label="noise")
    axes.set(xlabel="distance of the images, grey levels", title=SPLIT_NAMES[split])
    axes.set_xlim(0, None)
    axes.yaxis.set_major_formatter("{x:,.0f}")


def _curve(
    axes: Axes, floor: IrreducibleErrorFloor, style: tuple[str, str], label: str, noise_grey: float
) -> None:
    color, mark = style
    drawn = [
        (group.distance_grey, group.rmse_counts)
        for group in floor.curve
        if group.distance_grey is not None and group.rmse_counts is not None
    ]
    axes.plot(*zip(*drawn, strict=True), mark, color=color, markersize=4, label=label)
    value = floor.extrapolated_rmse_counts
    if value is not None:
        low, high = floor.interval or (value, value)
        axes.errorbar(
            noise_grey, value, [[max(value - low, 0.0)], [max(high - value, 0.0)]],
            color=color, marker="s", markersize=5, capsize=3, linewidth=1,
        )  # fmt: skip
