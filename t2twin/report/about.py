"""What the page begins with: the dataset, the machine, how long the runs took."""

from t2twin.primitives_cad.machine import cores, processor
from t2twin.report import markup
from t2twin.report.names import name_of
from t2twin.report.report_data import ReportData
from t2twin.sim.dataset.info import SPLITS
from t2twin.translate.runs.log import best_epoch

WHAT = (
    "Two touch sensors that share nothing, a camera behind a gel (DIGIT) and an array of "
    "capacitive taxels under a soft skin (CySkin), touch the same shapes in the same places with "
    "the same force; networks learn to turn what the first one sees into what the second one "
    "would have felt. The protocol and both networks are those of Grella, Albini, Cannata and "
    "Maiolino, Touch-to-Touch Translation (IROS 2023). Everything here is simulated: no figure "
    "below was measured on a sensor, except where it says so."
)


def section(report: ReportData) -> str:
    """The opening: what this is, on which data, with which runs."""
    return markup.section(
        "about", "What this is", [markup.paragraph(WHAT), _dataset(report), *_runs(report)]
    )


def _dataset(report: ReportData) -> str:
    info = report.info
    pairs = {split: report.tables[split].num_rows for split in SPLITS}
    shapes = {split: len(set(report.tables[split]["shape"].to_pylist())) for split in SPLITS}
    versions = ", ".join(f"{name} {version}" for name, version in info.versions.items())
    return markup.facts(
        [
            ("Scale", f"{info.scale}, seed {info.seed}"),
            (
                "Training",
                f"{pairs['train']:,} pairs of {shapes['train']} primitives",
            ),
            (
                "Validation",
                f"{pairs['val']:,} pairs of {shapes['val']} primitives, versions that training "
                "never saw",
            ),
            ("Test", f"{pairs['test']:,} pairs of hand tools, at {shapes['test']} keypoints"),
            (
                "Taxels",
                f"{report.layout.x_mm.size} (layout {report.layout.layout}), saturated at "
                f"{report.layout.full_scale_counts:,.0f} counts",
            ),
            ("Versions", versions),
            ("This page's machine", f"{cores()} cores, {processor()}"),
        ]
    )


def _runs(report: ReportData) -> list[str]:
    """The table of runs, and what must be known of those trained on something else."""
    titles = ("Run", "Preset", "Image, px", "Parameters", "Epochs", "Best epoch", "Minutes")
    rows = [_run(report, name) for name in report.runs]
    parts = [
        markup.table([[(title, 1) for title in titles]], [("", rows)]),
        markup.paragraph(
            "Minutes are the sum of the epochs' times in each run's log, training and validation; "
            "parameters are those of the network that predicts.",
            "note",
        ),
    ]
    models = report.evaluations["val"].runs
    other = {
        name_of(name): model.trained_layout
        for name, model in models.items()
        if model.trained_layout != report.layout.layout
    }
    if other:
        named = ", ".join(f"{name} ({layout})" for name, layout in other.items())
        parts.append(
            markup.paragraph(
                f"Trained on another taxel layout than {report.layout.layout}, which is read "
                f"from the tactile images that the generator draws: {named}."
            )
        )
    elsewhere = [name_of(name) for name, model in models.items() if not model.same_data]
    if elsewhere:
        parts.append(
            markup.paragraph(f"Trained on another dataset than this one: {', '.join(elsewhere)}.")
        )
    return parts


def _run(report: ReportData, name: str) -> list[str]:
    """A run's row."""
    run, history = report.runs[name], report.histories[name]
    preset = run.config.preset
    parameters = sum(p.numel() for p in run.translator.predictor.parameters())
    return [
        name_of(name),
        preset.name,
        f"{preset.size} × {preset.size}, {'grey' if preset.grey else 'RGB'}",
        f"{parameters / 1e6:.2f} M",
        f"{len(history)}",
        f"{best_epoch(history).epoch}",
        minutes(sum(record.seconds for record in history)),
    ]


def minutes(seconds: float) -> str:
    """To a tenth below ten minutes, whole above."""
    return f"{seconds / 60:.1f}" if seconds < 600 else f"{seconds / 60:,.0f}"
