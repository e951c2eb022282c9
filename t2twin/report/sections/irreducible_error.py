"""How far presses that look alike differ in taxels: what no translator can know."""

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
"""Colour and mark of where the look-alikes come from."""

WHERE = {"under": "under the DIGIT's view", "near": "near it", "beyond": "beyond"}


def section(report: ReportData) -> str:
    """The curves, and what they bound; of evaluations that have look-alikes."""
    lookalikes = {split: one.irreducible_error for split, one in report.evaluations.items()}
    known = {split: one for split, one in lookalikes.items() if one is not None}
    content = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, report, known))
    text = (
        "For every press the pictures nearest to its own are looked up, among presses of the same "
        "split on other shapes and among the training pairs, and the counts of the two compared. "
        "A translator gives one answer to pictures that it cannot tell apart; if the two presses "
        "are two draws of what such a picture may mean, its RMSE is at least sqrt(mean squared "
        "difference / 2). That is what is drawn, against the distance of the pictures."
    )
    note = (
        f"Distance: root mean square, of pictures made {FEATURE_SIZE} × {FEATURE_SIZE}, in RGB. "
        f"Points: groups of as many pairs each, of the {NEIGHBORS} nearest of every press. "
        "Square: half the squared difference as a straight line of the squared distance, fitted to "
        f"the nearest {100 * FITTED_SHARE:.0f} % of the pairs of each shape, read at the distance "
        "that noise alone makes; with its interval over shapes. Level lines: what the models reach."
    )
    if (report.forces_n == 0).any():
        note += " Presses that touch nothing, which look and feel alike, are left out."
    bounds = (
        "It bounds what can be known from the picture at that size, on average over presses that "
        "something resembles, for a translator that has seen such presses. It does not bound a "
        "network that sees finer detail, says nothing of presses that nothing resembles, and where "
        "the nearest picture is many times the noise away, the extrapolated figure is an estimate "
        "with the line's assumption in it. Among training pairs it also holds what training on "
        "other shapes misleads about."
    )
    return markup.section(
        "lookalikes",
        "What the picture does not say",
        [
            markup.paragraph(text),
            markup.picture(
                content, "svg", "Difference of counts against distance of pictures", note=note
            ),
            markup.items(sentences(known)),
            markup.paragraph(bounds, "note"),
        ],
    )


def sentences(lookalikes: Mapping[str, IrreducibleError]) -> list[str]:
    """What the look-alikes say, one sentence a split and a place to look. lookalikes: by split."""
    said = []
    for split, one in lookalikes.items():
        places = {"other shapes of the same split": one.split, "training pairs": one.training}
        for place, floor in places.items():
            what = "there are none." if floor is None else _sentence(floor, one.close_grey)
            said.append(f"{SPLIT_NAMES[split].capitalize()}, {place}: {what}")
    return said


def _sentence(floor: IrreducibleErrorFloor, close_grey: float) -> str:
    near, close = floor.nearest, floor.close
    within = (
        f"{close.pairs:,} of {near.pairs:,} presses have a picture within {close_grey:.2f} grey "
        f"levels, {CLOSE:g} times the distance that noise makes"
    )
    if close.pairs:
        within += f", and those say {close.rmse_counts:,.0f} counts"
    line = ""
    value, span = floor.extrapolated_rmse_counts, floor.interval
    if value is not None:
        between = "" if span is None else f" ({span.low:,.0f} to {span.high:,.0f})"
        groups = ", ".join(
            f"{alone:,.0f} {WHERE[name]}"
            for name, alone in floor.parts.items()
            if alone is not None
        )
        line = f" Extrapolated to the noise's distance: {value:,.0f} counts{between}"
        line += f"; of the taxels alone {groups}." if groups else "."
    return (
        f"the nearest picture is {near.distance_grey:.1f} grey levels away in the median, and says "
        f"{near.rmse_counts:,.0f} counts; {within}.{line}"
    )


def _draw(page: Figure, report: ReportData, lookalikes: Mapping[str, IrreducibleError]) -> None:
    places = page.subplots(1, len(lookalikes), sharey=True, squeeze=False)[0]
    for axes, split in zip(places, lookalikes, strict=True):
        _curves(axes, report, split, lookalikes[split])
    places[0].set_ylim(0, None)
    places[0].set_ylabel("sqrt(mean squared difference / 2), counts")
    page.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


def _curves(axes: Axes, report: ReportData, split: str, lookalikes: IrreducibleError) -> None:
    noise = lookalikes.noise_grey
    for floor, style, label in (
        (lookalikes.split, SPLIT_STYLE, "other shapes of the split"),
        (lookalikes.training, TRAINING_STYLE, "training pairs"),
    ):
        if floor is not None:
            _curve(axes, floor, style, label, noise)
    models = report.evaluations[split].models
    for name, color in colors(list(report.runs)).items():
        if name in report.runs:
            level = models[name].overall.rmse_counts
            axes.axhline(level, color=color, linewidth=1, label=name_of(name))
    axes.axvline(noise, color="#999999", linewidth=0.8, linestyle=":", label="noise")
    axes.set(xlabel="distance of the pictures, grey levels", title=SPLIT_NAMES[split])
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
