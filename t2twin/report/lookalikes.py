"""How far presses that look alike differ in taxels: what no translator can know."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report import markup
from t2twin.report.figures import figure
from t2twin.report.material import SHOWN, ReportData
from t2twin.report.names import SPLIT_NAMES, colours, name_of
from t2twin.translate.evaluation.baselines import FEATURE_SIZE
from t2twin.translate.evaluation.lookalikes import CLOSE, FITTED, NEIGHBOURS, SPLIT, TRAINING

WIDTH_IN, HEIGHT_IN = 9.0, 3.6
STYLES = {SPLIT: ("#222222", "o"), TRAINING: ("#009e73", "D")}
"""Colour and mark of where the look-alikes come from."""


WHERE = {"under": "under the DIGIT's view", "near": "near it", "beyond": "beyond"}


def section(material: ReportData) -> str:
    """The curves, and what they bound."""
    found = {split: material.evaluated[split].metrics["lookalikes"] for split in SHOWN}
    if any(one is None for one in found.values()):
        parts = [markup.paragraph("The dataset does not name its pictures' noise.")]
        return markup.section("lookalikes", "What the picture does not say", parts)
    content = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, material))
    text = (
        "For every press the pictures nearest to its own are looked up, among presses of the same "
        "split on other shapes and among the training pairs, and the counts of the two compared. "
        "A translator gives one answer to pictures that it cannot tell apart; if the two presses "
        "are two draws of what such a picture may mean, its sqrt(L3) is at least sqrt(mean squared "
        "difference / 2). That is what is drawn, against the distance of the pictures."
    )
    note = (
        f"Distance: root mean square, of pictures made {FEATURE_SIZE} × {FEATURE_SIZE}, in RGB. "
        f"Points: groups of as many pairs each, of the {NEIGHBOURS} nearest of every press. "
        "Square: half the squared difference as a straight line of the squared distance, fitted to "
        f"the nearest {100 * FITTED:.0f} % of the pairs of each shape, read at the distance that "
        "noise alone makes; with its interval over shapes. Level lines: what the models reach."
    )
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
            markup.items(sentences({split: one for split, one in found.items() if one})),
            markup.paragraph(bounds, "note"),
        ],
    )


def sentences(found: dict[str, dict[str, Any]]) -> list[str]:
    """What was found, one sentence a split and a place to look. found: by split."""
    said = []
    for split, one in found.items():
        for key, place in ((SPLIT, "other shapes of the same split"), (TRAINING, "training pairs")):
            part = one[key]
            if part is None:
                said.append(f"{SPLIT_NAMES[split].capitalize()}, {place}: there are none.")
                continue
            near, close = part["nearest"], part["close"]
            number = f"{close['pairs']:,} of {near['pairs']:,} presses have"
            within = (
                f"{number} a picture within {one['close_grey']:.2f} grey levels, {CLOSE:g} times "
                "the distance that noise makes"
            )
            if close["pairs"]:
                within += f", and those say {close['rmse_counts']:,.0f} counts"
            value, span = part["extrapolated_rmse_counts"], part["interval"]
            line = ""
            if value is not None:
                between = "" if span is None else f" ({span[0]:,.0f} to {span[1]:,.0f})"
                groups = ", ".join(
                    f"{alone:,.0f} {WHERE[name]}"
                    for name, alone in part["parts"].items()
                    if alone is not None
                )
                line = f" Extrapolated to the noise's distance: {value:,.0f} counts{between}"
                line += f"; of the taxels alone {groups}." if groups else "."
            said.append(
                f"{SPLIT_NAMES[split].capitalize()}, {place}: the nearest picture is "
                f"{near['distance_grey']:.1f} grey levels away in the median, and says "
                f"{near['rmse_counts']:,.0f} counts; {within}.{line}"
            )
    return said


def _draw(page: Figure, material: ReportData) -> None:
    places = page.subplots(1, len(SHOWN), sharey=True)
    for axes, split in zip(places, SHOWN, strict=True):
        _curves(axes, material, split)
    places[0].set_ylim(0, None)
    places[0].set_ylabel("sqrt(mean squared difference / 2), counts")
    page.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)


def _curves(axes: Axes, material: ReportData, split: str) -> None:
    metrics = material.evaluated[split].metrics
    found = metrics["lookalikes"]
    noise = found["noise_grey"]
    labels = {SPLIT: "other shapes of the split", TRAINING: "training pairs"}
    for key, (colour, mark) in STYLES.items():
        part = found[key]
        if part is None:
            continue
        x = [group["distance_grey"] for group in part["curve"]]
        y = [group["rmse_counts"] for group in part["curve"]]
        axes.plot(x, y, mark, color=colour, markersize=4, label=labels[key])
        value, span = part["extrapolated_rmse_counts"], part["interval"]
        if value is not None:
            low, high = span or (value, value)
            axes.errorbar(
                noise, value, [[max(value - low, 0.0)], [max(high - value, 0.0)]],
                color=colour, marker="s", markersize=5, capsize=3, linewidth=1,
            )  # fmt: skip
    for name, colour in colours(list(material.runs)).items():
        if name in material.runs:
            level = metrics["models"][name]["overall"]["rmse_counts"]
            axes.axhline(level, color=colour, linewidth=1, label=name_of(name))
    axes.axvline(noise, color="#999999", linewidth=0.8, linestyle=":", label="noise")
    axes.set(xlabel="distance of the pictures, grey levels", title=SPLIT_NAMES[split])
    axes.set_xlim(0, None)
    axes.yaxis.set_major_formatter("{x:,.0f}")
