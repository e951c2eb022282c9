"""Learning curves from the runs' logs."""

import math
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.report import markup
from t2twin.report.figures import figure
from t2twin.report.material import ReportData
from t2twin.report.names import BASELINE_COLOURS, colours, name_of
from t2twin.translate.evaluation.baselines import MEAN_ARRAY, NEAREST_NEIGHBOUR

WIDTH_IN, HEIGHT_IN = 9.0, 3.4
LOSSES = {"adversarial": "-", "l1": "--", "discriminator": ":"}
"""pix2pix's losses as a log names them, and how each is drawn."""


def section(material: ReportData) -> str:
    """sqrt(L3) an epoch on the left, the adversarial training's own losses on the right."""
    text = (
        "Left: sqrt(L3) on validation (solid; the dot is the epoch that was kept) and, for "
        "ResNet18, which trains on L3, on the training pairs as they were seen (dashed; with "
        "dropout or augmentation where the preset has them, so it may lie above). touch2touch "
        "never trains on L3; its own losses are on the right: what its generator pays for being "
        "found out, the L1 distance with its weight, and the discriminator's loss."
    )
    content = figure("svg", WIDTH_IN, HEIGHT_IN, lambda page: _draw(page, material))
    alt = "Validation and training error by epoch, with the trivial predictors as lines"
    return markup.section("curves", "Learning", [markup.picture(content, "svg", alt, note=text)])


def _draw(page: Figure, material: ReportData) -> None:
    adversarial = [name for name in material.runs if "train_l1" in material.histories[name][0]]
    axes = page.subplots(1, 2 if adversarial else 1, squeeze=False)[0]
    _errors(axes[0], material)
    if adversarial:
        _losses(axes[1], material, adversarial)


def _errors(axes: Axes, material: ReportData) -> None:
    colour_of = colours(list(material.runs))
    full_scale = material.layout.full_scale_counts
    for name, history in material.histories.items():
        epochs = [record["epoch"] for record in history]
        validation = [record["val_rmse_counts"] for record in history]
        marker = "o" if len(history) == 1 else ""
        label = f"{name_of(name)}, validation"
        axes.plot(epochs, validation, color=colour_of[name], label=label, marker=marker)
        best = min(range(len(history)), key=lambda i: validation[i])
        axes.plot(epochs[best], validation[best], "o", color=colour_of[name], markersize=5)
        if "train_l3" in history[0]:
            seen = [full_scale * math.sqrt(record["train_l3"]) for record in history]
            label = f"{name_of(name)}, training"
            axes.plot(epochs, seen, "--", color=colour_of[name], label=label, marker=marker)
    models = material.evaluated["val"].metrics["models"]
    for name in (MEAN_ARRAY, NEAREST_NEIGHBOUR):
        level = models[name]["overall"]["rmse_counts"]
        axes.axhline(
            level, color=BASELINE_COLOURS[name], linewidth=1, linestyle=(0, (6, 3)),
            label=f"{name_of(name)}, validation",
        )  # fmt: skip
    axes.set(xlabel="epoch", ylabel="sqrt(L3), counts", ylim=(0, None))
    axes.yaxis.set_major_formatter("{x:,.0f}")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()


def _losses(axes: Axes, material: ReportData, names: list[str]) -> None:
    colour_of = colours(list(material.runs))
    for name in names:
        weight = material.runs[name].config.preset.l1_weight
        factors = {"adversarial": 1.0, "l1": weight, "discriminator": 1.0}
        labels = {
            "adversarial": "generator, adversarial",
            "l1": f"generator, {weight:g} × L1",
            "discriminator": "discriminator",
        }
        for loss, style in LOSSES.items():
            values = _values(material.histories[name], f"train_{loss}", factors[loss])
            epochs = [record["epoch"] for record in material.histories[name]]
            axes.plot(
                epochs, values, style, color=colour_of[name],
                label=f"{name_of(name)}, {labels[loss]}",
            )  # fmt: skip
    axes.set(xlabel="epoch", ylabel="training loss", yscale="log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend()


def _values(history: list[dict[str, Any]], key: str, factor: float) -> list[float]:
    return [factor * record[key] for record in history]
