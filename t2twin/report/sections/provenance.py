"""The dataset, the runs, the machine, and the omitted sections."""

from collections.abc import Mapping

from t2twin.core.machine import cores, processor
from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, forces_text, name_of
from t2twin.translate.evaluation.table import training_data
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.runs.log import best_epoch

NETWORKS = (
    "Both networks are those of Grella, Albini, Cannata and Maiolino, Touch-to-Touch Translation "
    "(IROS 2023)"
)
WORLD = (
    f"{NETWORKS}; the presses are those of the world {{}}. Everything is simulated: no value below "
    "was measured on a sensor."
)
SIMULATED = (
    f"{NETWORKS}, and so is the protocol. Everything is simulated: no value below was measured on "
    "a sensor, unless stated otherwise."
)
IMPORTED = f"{NETWORKS}. The pairs were imported with `t2twin import-pairs`."

PRIMITIVES_AND_TOOLS = {
    "train": "{pairs:,} pairs of {shapes} primitives",
    "val": "{pairs:,} pairs of {shapes} primitives, versions outside the training split",
    "test": "{pairs:,} pairs of hand tools, at {shapes} keypoints",
}
OF_SHAPES = "{pairs:,} pairs of {shapes:,} shapes"


def section(report: ReportData, omitted: Mapping[str, str]) -> str:
    """Data and runs. omitted: titles of omitted sections, with the data that they would require."""
    parts = [markup.paragraph(_origin(report)), _dataset(report), *_runs(report)]
    if omitted:
        listed = ", ".join(f"{title} ({missing})" for title, missing in omitted.items())
        parts.append(markup.paragraph(f"Omitted sections, with the missing data: {listed}."))
    return markup.section("about", "Data and runs", parts)


def _origin(report: ReportData) -> str:
    if report.info.is_protocol:
        return SIMULATED
    return WORLD.format(report.info.world_name) if report.info.is_simulated else IMPORTED


def _dataset(report: ReportData) -> str:
    info = report.info
    versions = ", ".join(f"{name} {version}" for name, version in info.versions.items())
    kind = "Scale" if info.is_protocol else "World"
    scale = [(kind, f"{info.world_name}, seed {info.seed}")] if info.is_simulated else []
    forces = report.forces_n
    pressed = [("Forces", forces_text(forces))] if forces.size else []
    return markup.facts(
        [
            *scale,
            *((SPLIT_NAMES[split].capitalize(), _pairs(report, split)) for split in report.tables),
            *pressed,
            (
                "Taxels",
                f"{report.layout.x_mm.size} (layout {report.layout.layout}), saturated at "
                f"{report.layout.full_scale_counts:,.0f} counts",
            ),
            ("Versions", versions),
            ("Machine of this report", f"{cores()} cores, {processor()}"),
        ]
    )


def _pairs(report: ReportData, split: str) -> str:
    shapes = report.tables[split]["shape"].to_pylist()
    template = PRIMITIVES_AND_TOOLS[split] if report.info.is_protocol else OF_SHAPES
    return template.format(pairs=len(shapes), shapes=len(set(shapes)))


def _runs(report: ReportData) -> list[str]:
    """Table of the runs, with notes on runs with other training data."""
    titles = (
        "Run", "Trained on", "Pairs", "Steps", "Preset", "Image, px", "Parameters", "Epochs",
        "Best epoch", "Minutes",
    )  # fmt: skip
    rows = [_run(report, name) for name in report.runs]
    parts = [
        markup.table([[(title, 1) for title in titles]], [("", rows)]),
        markup.paragraph(
            "Minutes: sum over the epochs in the log, training and validation. Parameters: of the "
            "predicting network.",
            "note",
        ),
    ]
    models = report.evaluation.runs
    other = {
        name_of(name): f"{model.trained_layout}, read from {_read_from(report, name)}"
        for name, model in models.items()
        if model.trained_layout != report.layout.layout
    }
    if other:
        listed = ", ".join(f"{name} ({layout})" for name, layout in other.items())
        parts.append(
            markup.paragraph(
                f"Trained on another taxel layout than {report.layout.layout}: {listed}."
            )
        )
    elsewhere = [
        f"{name_of(name)} ({training_data(model)[0]})"
        for name, model in models.items()
        if not model.same_data
    ]
    if elsewhere:
        parts.append(
            markup.paragraph(
                f"Trained on another dataset than this one: {', '.join(elsewhere)}. The baselines, "
                "such as the nearest neighbor, use the training pairs of this dataset."
            )
        )
    return parts


def _read_from(report: ReportData, name: str) -> str:
    """Output from which the counts of another layout are computed."""
    is_field = isinstance(report.runs[name], FieldPredictor)
    return "the predicted field" if is_field else "the generated tactile images"


def _run(report: ReportData, name: str) -> list[str]:
    """Row of a run."""
    run, history = report.runs[name], report.histories[name]
    preset = run.config.preset
    parameters = sum(p.numel() for p in run.translator.predictor.parameters())
    return [
        name_of(name),
        *training_data(report.evaluation.runs[name]),
        preset.name,
        f"{preset.size} × {preset.size}, {'grey' if preset.grey else 'RGB'}",
        f"{parameters / 1e6:.2f} M",
        f"{len(history)}",
        f"{best_epoch(history).epoch}",
        minutes(sum(record.seconds for record in history)),
    ]


def minutes(seconds: float) -> str:
    """Minutes as text, with one decimal below ten minutes."""
    return f"{seconds / 60:.1f}" if seconds < 600 else f"{seconds / 60:,.0f}"
