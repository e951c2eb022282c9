"""The tables of evaluations: figures of all rows, errors by force, findings, several datasets.

Each is a `core.tables.Table`: the command prints it as text, the files have it in Markdown, and the
report shows it in HTML.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from t2twin.core.tables import NONE, Cell, Table, markdown, text
from t2twin.translate.evaluation.array_errors import REPORTED_LEVEL, REPORTED_SHARE
from t2twin.translate.evaluation.baselines import (
    MEAN_ARRAY,
    MEAN_ARRAY_OF_FORCE,
    NEAREST_NEIGHBOR,
    NOISE_FLOOR,
)
from t2twin.translate.evaluation.findings import DIFFERENCES, RESNET18, TOUCH2TOUCH, gap_between
from t2twin.translate.evaluation.image_errors import MEAN_IMAGE
from t2twin.translate.evaluation.records import (
    Evaluation,
    FigureName,
    Figures,
    Finding,
    ForceFigures,
    Interval,
    ModelRow,
    PaperRow,
)

Evaluations = Mapping[str, Evaluation]
"""Evaluations of one dataset by split."""


class Column(NamedTuple):
    """A figure with the title of its column and its number format."""

    figure: FigureName
    title: str
    form: str


MAIN = (
    Column("rmse_counts", "RMSE, counts", "{:,.0f}"),
    Column("rmse_percent", "% of full scale", "{:.2f}"),
    Column("ssim", "SSIM", "{:.3f}"),
)
FURTHER = (
    Column("ssim_contact", "SSIM in contact", "{:.3f}"),
    Column("contact_iou", "Contact IoU", "{:.3f}"),
    Column("centroid_error_mm", "Centroid, mm", "{:.2f}"),
    Column("total_error_percent", "Total, %", "{:.1f}"),
    Column("rmse_under_counts", "Under view", "{:,.0f}"),
    Column("rmse_near_counts", "Near it", "{:,.0f}"),
    Column("rmse_beyond_counts", "Beyond", "{:,.0f}"),
)
OF_IMAGES = (
    Column("psnr_db", "PSNR, dB", "{:.2f}"),
    Column("psnr_contact_db", "PSNR in contact, dB", "{:.2f}"),
    Column("ssim", "SSIM", "{:.3f}"),
    Column("rmse_grey", "RMSE, grey levels", "{:.2f}"),
    Column("rmse_percent", "% of full scale", "{:.2f}"),
)
"""Columns of predicted images."""

COLUMNS = (*MAIN, *FURTHER, *OF_IMAGES)
FORMS: dict[FigureName, str] = {column.figure: column.form for column in COLUMNS}
"""Number formats by figure (records.Figures)."""

SMALL_FULL_SCALE = 1000
"""Full scale below which counts have a decimal."""

PAPER = "Grella et al. 2023, on hardware"
PAPER_FORMS: dict[FigureName, str] = {**FORMS, "ssim": "{:.2f}"}
"""Number formats of the paper's rows, with its decimals."""

TRIVIAL = (MEAN_ARRAY, MEAN_ARRAY_OF_FORCE, MEAN_IMAGE, NEAREST_NEIGHBOR)


def results_text(evaluations: Evaluations) -> str:
    """All tables of a dataset for the terminal."""
    tables = []
    for split, one in evaluations.items():
        columns = (*MAIN, *FURTHER) if one.pictures is None else OF_IMAGES
        tables.append(figures_table({split: one}, columns))
        tables += force_tables({split: one})
    tables += findings_table(evaluations, gap_between(evaluations))
    return "\n\n".join([*map(text, tables), *_without_findings(evaluations)]) + "\n"


def _without_findings(evaluations: Evaluations) -> list[str]:
    """A sentence if there are several runs of the models that the findings compare."""
    models = {name.partition(" ")[0] for one in evaluations.values() for name in one.runs}
    if not {TOUCH2TOUCH, RESNET18} <= models or any(one.paired for one in evaluations.values()):
        return []
    return [
        "The paper's findings compare one run of touch2touch with one of ResNet18; evaluate two "
        "runs alone for them."
    ]


def results_markdown(evaluations: Evaluations) -> str:
    """The main figures of all splits, and the errors by force, in Markdown."""
    splits = dict(zip(evaluations, evaluations, strict=True))
    of_counts = all(one.pictures is None for one in evaluations.values())
    columns = (*MAIN, FURTHER[1]) if of_counts else OF_IMAGES[:3]
    figures = figures_table(evaluations, columns, splits, intervals=(columns[0].figure,))
    return "\n".join(map(markdown, (figures, *force_tables(evaluations))))


def datasets_markdown(datasets: Mapping[str, Evaluations]) -> str:
    """Two tables in Markdown, with one row per run and one column per dataset and split.

    datasets: evaluations of the same runs, by name of the dataset and by split.
    """
    notes = ["Means and nearest neighbors are from the training pairs of each dataset."]
    percent = "RMSE in percent of full scale, with its interval by bootstrap over shapes:"
    relative = "The same relative to the RMSE of the mean (by force, if there are several forces):"
    tables = (
        _datasets_table(datasets, lambda _, row: _cell(row, MAIN[1], FORMS), percent, ()),
        _datasets_table(datasets, _of_mean_array, relative, notes),
    )
    return "\n".join(map(markdown, tables))


def figures_table(
    evaluations: Evaluations,
    columns: Collection[Column],
    splits: Mapping[str, str] | None = None,
    name: Callable[[str], str] = str,
    intervals: Collection[FigureName] = tuple(FORMS),
    own: str = "",
) -> Table:
    """Figures of all rows with their intervals, and below those of the paper.

    splits: titles above the columns of each; without them, the table is of one split. name:
    displayed name of a row. intervals: figures that have theirs. own: title of the rows that are
    not the paper's.
    """
    each = list(evaluations.values())
    if (full_scale := each[0].full_scale_counts) is not None:
        form = counts_form(full_scale)
        columns = [c._replace(form=form) if c.figure.endswith("_counts") else c for c in columns]
    groups: dict[str, list[list[Cell]]] = {own: [], PAPER: []}
    for row in dict.fromkeys(row for one in each for row in one.models):
        cells = (_cell(one.models.get(row), c, intervals) for one in each for c in columns)
        groups[own].append([name(row), *cells])
    for row in dict.fromkeys(row for one in each for row in one.paper):
        cells = [
            _figure(one.paper.get(row), c._replace(form=PAPER_FORMS[c.figure]))
            for one in each
            for c in columns
        ]
        if any(cell != NONE for cell in cells):
            groups[PAPER].append([name(row), *cells])
    return Table(
        ["", *[column.title for column in columns] * len(each)],
        {title: rows for title, rows in groups.items() if rows},
        [(title, len(columns)) for title in (splits or {}).values()],
        "" if splits else f"{each[0].split}, {each[0].pairs} pairs",
        list(_notes(evaluations, columns)),
    )


def _cell(
    row: ModelRow | None, column: Column, intervals: Collection[FigureName]
) -> tuple[str, str]:
    """A figure of a row, and its interval if it is one of `intervals`."""
    if row is None:
        return NONE, ""
    interval = row.interval.get(column.figure) if column.figure in intervals else None
    return _figure(row.overall, column), _interval(interval, column.form)


def _figure(row: Figures | PaperRow | None, column: Column) -> str:
    value = getattr(row, column.figure, None)
    return NONE if value is None else column.form.format(value)


def counts_form(full_scale: float) -> str:
    """Number format of counts of an array."""
    return "{:,.1f}" if full_scale < SMALL_FULL_SCALE else "{:,.0f}"


def _interval(interval: Interval | None, form: str) -> str:
    """As in "12–95"; empty without interval."""
    return "" if interval is None else f"{form.format(interval.low)}–{form.format(interval.high)}"


def _notes(evaluations: Evaluations, columns: Collection[Column]) -> Iterator[str]:
    """Sentences on intervals, groups of taxels, uncertainty, motion, training data, the paper."""
    one = next(iter(evaluations.values()))
    shapes = " and ".join(str(each.bootstrap.shapes) for each in evaluations.values())
    yield (
        f"Below or behind a figure: its {100 * one.bootstrap.confidence:.0f} % interval, by "
        f"bootstrap over the {shapes} shapes."
    )
    view = one.view
    if view is not None and FURTHER[-1].figure in (column.figure for column in columns):
        taxels = view.taxels
        yield (
            f"Of the taxels, {taxels['under']} lie under the image's view, {taxels['near']} within "
            f"one pitch of it ({view.pitch_mm:.1f} mm), {taxels['beyond']} beyond."
        )
    if one.pictures is not None:
        yield f"The images of {one.target} are compared at {one.pictures}."
        if one.background is None:
            yield "The contact has no figures: no background frame is known."
    for split, each in evaluations.items():
        of_split = f"{split}: " if len(evaluations) > 1 else ""
        yield from (of_split + line for line in uncertainty_text(each.models))
        yield from (of_split + line for line in motion_text(each.models))
        yield from (of_split + line for line in contact_text(each.models))
    for name, row in one.runs.items():
        recipe, pairs, steps = training_data(row)
        known = [f"{number} {unit}" for number, unit in ((pairs, "pairs"), (steps, "steps"))
                 if number != NONE]  # fmt: skip
        yield f"{name} was trained on {', '.join((recipe, *known))}."
    if one.background is not None and one.pictures is None:
        yield f"Background frame of the field runs: {one.background}."
    if one.paper:
        yield "The paper's rows are from real sensors and not directly comparable."


def uncertainty_text(models: Mapping[str, ModelRow]) -> list[str]:
    """One line per run that predicts uncertainty."""
    lines = []
    for name, row in models.items():
        if row.uncertainty is None:
            continue
        found = row.uncertainty
        line = (
            f"{name}: its {100 * REPORTED_LEVEL:.0f} % intervals cover "
            f"{100 * found.coverage_at(REPORTED_LEVEL):.1f} % of the counts; without the least "
            f"certain fifth of the presses its RMSE is "
            f"{100 * found.sparsification_gain(REPORTED_SHARE):.0f} % lower."
        )
        if found.force_median_error_percent is not None:
            line += (
                f" The median error of its force is {found.force_median_error_percent:.1f} %; the "
                f"intervals cover {found.force_coverage_percent:.1f} % of the forces."
            )
        lines.append(line)
    return lines


def motion_text(models: Mapping[str, ModelRow]) -> list[str]:
    """Lines on still and moving pairs and on the shear force, for the runs that have them."""
    lines = []
    for name, row in models.items():
        if row.run is None or row.by_motion is None:
            continue
        parts = []
        for kind, found in row.by_motion.items():
            part = f"{found.pairs} {kind} pairs: RMSE {found.rmse_counts:.0f}"
            if (covered := found.coverage_percent) is not None:
                part += f", {covered:.1f} % within the {100 * REPORTED_LEVEL:.0f} % interval"
            parts.append(part)
        lines.append(f"{name}: {'; '.join(parts)}.")
        shear = row.shear
        if shear is not None and shear.direction_error_deg is not None:
            lines.append(
                f"{name}: shear force above {shear.min_shear_n:g} N, {shear.pairs} moving pairs: "
                f"median error {shear.direction_error_deg:.1f} degrees and "
                f"{shear.magnitude_error_percent:.1f} %; the intervals cover "
                f"{shear.coverage_percent:.1f} % of the components of all moving pairs."
            )
    return lines


def contact_text(models: Mapping[str, ModelRow]) -> list[str]:
    """Lines on the contact, for the runs that predict it."""
    lines = []
    for name, row in models.items():
        if (found := row.contact) is None:
            continue
        line = (
            f"{name}: contact in the view, {found.pairs} pairs: RMSE of the depth "
            f"{found.depth_rmse_mm:.3f} mm (median; mean {found.depth_mean_rmse_mm:.3f}); largest "
            f"depth {found.deepest_error_percent:.1f} % off (median; at most "
            f"{found.deepest_worst_percent:.0f} %); IoU {found.iou:.2f}; force "
            f"{found.force_in_view_error_percent:.1f} % off; the {100 * REPORTED_LEVEL:.0f} % "
            f"intervals cover {found.depth_coverage_percent:.1f} % of the depths."
        )
        if found.missed_percent or found.false_percent:
            line += f" It misses {found.missed_percent:.1f} % of the contacts"
            false = found.false_percent
            where = "images without contact"
            line += "." if false is None else f", and finds one in {false:.1f} % of {where}."
        lines.append(line)
    return lines


def training_data(row: ModelRow, datasets: Mapping[str, str] | None = None) -> tuple[str, str, str]:
    """Recipe, number of training pairs and of steps of a row's run; NONE if unknown.

    datasets: names by the SHA-256 of the datasets' info.json, for datasets without a name, which
    otherwise have its first digits.
    """
    sha256 = row.trained_data or ""
    recipe = row.trained_recipe or (datasets or {}).get(sha256)
    unnamed = f"dataset {sha256[:8]}" if sha256 else NONE
    pairs, steps = (
        NONE if number is None else f"{number:,}"
        for number in (row.trained_pairs, row.trained_steps)
    )
    return recipe or unnamed, pairs, steps


def force_tables(evaluations: Evaluations) -> list[Table]:
    """The errors by force of the splits that have several, with one row per force.

    The noise floor, which does not depend on the force, is left out.
    """
    return [_force_table(one) for one in evaluations.values() if one.has_forces]


def _force_table(evaluation: Evaluation) -> Table:
    rows = {name: row for name, row in evaluation.models.items() if name != NOISE_FLOOR}
    bins = next(iter(rows.values())).by_force
    captions = [
        f"{evaluation.split}: RMSE by force, in counts, and in percent of the RMSE of the mean "
        "array at that force."
    ]
    if any(one.phantom_counts is not None for one in bins):
        captions.append("Without contact: RMSE, and in brackets the mean of the summed counts.")
    if own := [_force_title(one) for one in bins if one.mean_of == "split"]:
        captions.append(
            f"Training has too few presses at {', '.join(own)}; the mean array there is that of "
            "the evaluated presses."
        )
    by_force = zip(*(row.by_force for row in rows.values()), strict=True)
    lines = [
        [f"{_force_title(one)}, {one.pairs:,} pairs", *map(_force_cell, figures)]
        for one, figures in zip(bins, by_force, strict=True)
    ]
    return Table(["", *rows], {"": lines}, title=" ".join(captions))


def _force_cell(one: ForceFigures) -> str:
    """As in "812 (31 %)", relative to the mean array, or "5 (60)" without contact."""
    if one.phantom_counts is not None:
        return f"{one.rmse_counts:,.0f} ({one.phantom_counts:,.0f})"
    if one.of_mean_array is None:
        return f"{one.rmse_counts:,.0f}"
    return f"{one.rmse_counts:,.0f} ({100 * one.of_mean_array:.0f} %)"


def _force_title(one: ForceFigures) -> str:
    """As in "8 N", "0.71-1 N" or "no contact"."""
    if one.phantom_counts is not None:
        return "no contact"
    if one.low_n == one.high_n:
        return f"{one.low_n:g} N"
    return f"{one.low_n:.3g}-{one.high_n:.3g} N"


def findings_table(
    evaluations: Evaluations, gap: Mapping[str, Finding], name: Callable[[str], str] = str
) -> list[Table]:
    """The findings by question, with a row per split or model; empty without findings.

    gap: findings about the difference of the splits. name: displayed name of a split or model.
    """
    found = [
        (split, one.findings[finding])
        for finding in DIFFERENCES
        for split, one in evaluations.items()
        if finding in one.findings
    ]
    groups: dict[str, list[list[str]]] = {}
    for title, one in (*found, *((one.model or "", one) for one in gap.values())):
        groups.setdefault(one.question, []).append([name(title), *_finding(one, name)])
    heads = ["", "Answer", "Difference", "Interval", "Figures"]
    return [Table(heads, groups)] if groups else []


def _finding(finding: Finding, name: Callable[[str], str]) -> list[str]:
    """Answer, difference, interval and figures of a finding."""
    form, interval = FORMS[finding.figure], finding.interval
    figures = ", ".join(f"{name(key)} {form.format(v)}" for key, v in finding.figures.items())
    if finding.percent_of_mean_array is not None:
        percents = (f"{finding.percent_of_mean_array[key]:.0f} %" for key in finding.figures)
        figures += f"; {' and '.join(percents)} of the mean array's"
    signed = [form.format(v).replace("-", "−") for v in (finding.difference, *(interval or ()))]
    return [finding.answer, signed[0], " to ".join(signed[1:]) or "none", figures]


def _datasets_table(
    datasets: Mapping[str, Evaluations],
    cell: Callable[[Evaluation, ModelRow], Cell],
    title: str,
    notes: Sequence[str],
) -> Table:
    """cell: content for a row of an evaluation."""
    shown = {name: next(iter(splits.values())).recipe_shown for name, splits in datasets.items()}
    columns: dict[str, Evaluation] = {}
    for name, splits in datasets.items():
        # The name of the recipe, with the folder for several datasets of one recipe.
        unique = list(shown.values()).count(shown[name]) == 1
        recipe = shown[name] if unique else f"{shown[name]} ({name})"
        columns |= {f"{recipe}, {split}": evaluation for split, evaluation in splits.items()}
    each = columns.values()
    known = {one.info_sha256: one.recipe for one in each if one.recipe is not None}
    runs = next(iter(each)).runs
    lines: list[list[Cell]] = []
    for name in (*(name for name in TRIVIAL if any(name in one.models for one in each)), *runs):
        trained = training_data(runs[name], known) if name in runs else ("", "", "")
        cells = (cell(one, one.models[name]) if name in one.models else NONE for one in each)
        lines.append([name, *trained, *cells])
    heads = ["", "trained on", "pairs", "steps", *columns]
    return Table(heads, {"": lines}, title=title, notes=notes)


def _of_mean_array(evaluation: Evaluation, row: ModelRow) -> str:
    models = evaluation.models
    mean = next(name for name in (MEAN_ARRAY_OF_FORCE, MEAN_ARRAY, MEAN_IMAGE) if name in models)
    level = models[mean].overall.rmse_percent
    return f"{row.overall.rmse_percent / level:.2f}" if level else NONE
