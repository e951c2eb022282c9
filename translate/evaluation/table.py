"""What an evaluation found, as lines of text."""

from typing import Any

FIGURES = (
    ("rmse_counts", "sqrt(L3), counts", "{:.0f}"),
    ("rmse_percent", "%", "{:.2f}"),
    ("ssim", "SSIM", "{:.3f}"),
    ("ssim_contact", "in contact", "{:.3f}"),
    ("contact_iou", "IoU", "{:.3f}"),
    ("centroid_error_mm", "centroid, mm", "{:.2f}"),
    ("total_error_percent", "total, %", "{:.1f}"),
    ("rmse_under_counts", "under view", "{:.0f}"),
    ("rmse_near_counts", "near it", "{:.0f}"),
    ("rmse_beyond_counts", "beyond", "{:.0f}"),
)
"""Figures of Figures.summary, their titles, how they are written."""

SHORT = (
    ("rmse_counts", "counts", "{:,.0f}"),
    ("rmse_percent", "%", "{:.2f}"),
    ("ssim", "SSIM", "{:.3f}"),
    ("contact_iou", "IoU", "{:.3f}"),
)
"""Those of a short table."""

HOW = {name: how for name, _, how in FIGURES}


def table(metrics: dict[str, Any]) -> str:
    """The overall figures of `evaluate`, under each its interval, the paper's own below."""
    cells = [["", *(title for _, title, _ in FIGURES)]]
    for name, model in metrics["models"].items():
        cells.append([name, *(_cell(model["overall"].get(key), how) for key, _, how in FIGURES)])
        cells.append(["", *(spanned(model["interval"].get(key), how) for key, _, how in FIGURES)])
    for name, row in metrics["paper"].items():
        cells.append(
            [f"{name} (paper, hardware)", *(_cell(row.get(key), how) for key, _, how in FIGURES)]
        )
    widths = [max(len(row[i]) for row in cells) for i in range(len(cells[0]))]
    lines = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in cells
    ]
    return "\n".join([f"{metrics['split']}, {metrics['pairs']} pairs", *lines, *_notes(metrics)])


def _notes(metrics: dict[str, Any]) -> list[str]:
    how, taxels = metrics["bootstrap"], metrics["view"]["taxels"]
    notes = [
        f"Below each figure its {100 * how['confidence']:.0f} % interval, by bootstrap over the "
        f"{how['shapes']} shapes.",
        f"Of the taxels {taxels['under']} lie under the DIGIT's view, {taxels['near']} within one "
        f"pitch of it ({metrics['view']['pitch_mm']:.1f} mm), {taxels['beyond']} beyond.",
    ]
    if metrics["paper"]:
        notes.append("The paper's rows are from real sensors and not to be compared one to one.")
    return notes


def markdown(metrics: dict[str, dict[str, Any]]) -> str:
    """A table in Markdown: what `evaluate` found of each split, side by side.

    metrics: by split. The interval of sqrt(L3) stands in brackets; the paper's rows are in italics.
    """
    heads = ["", *(f"{split}: {title}" for split in metrics for _, title, _ in SHORT)]
    lines = [heads, ["---"] * len(heads)]
    first = next(iter(metrics.values()))
    for name in first["models"]:
        cells = [name]
        for of_split in metrics.values():
            model = of_split["models"].get(name, {"overall": {}, "interval": {}})
            for key, _, how in SHORT:
                span = model["interval"].get(key) if key == "rmse_counts" else None
                cell = _cell(model["overall"].get(key), how)
                cells.append(cell if span is None else f"{cell} ({spanned(span, how)})")
        lines.append(cells)
    for name in first["paper"]:
        cells = [f"*{name}, Grella et al. 2023, hardware*"]
        for of_split in metrics.values():
            row = of_split["paper"].get(name, {})
            cells += [_cell(row.get(key), how) for key, _, how in SHORT]
        lines.append(cells)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def findings_text(findings: dict[str, Any]) -> str:
    """A line a finding."""
    return "\n".join(f"{one['question']} {answered(one)}" for one in findings.values())


def answered(finding: dict[str, Any]) -> str:
    """As in "Yes: by 52 (12 to 95); val 900, test 1800."."""
    how = HOW[finding["figure"]]
    of = ", ".join(f"{name} {how.format(value)}" for name, value in finding["figures"].items())
    span = finding["interval"]
    between = "no interval" if span is None else f"{how.format(span[0])} to {how.format(span[1])}"
    return (
        f"{finding['answer'].capitalize()}: difference {how.format(finding['difference'])} "
        f"({between}); {of}."
    )


def lookalikes_text(found: dict[str, Any], split: str) -> str:
    """What the pictures' look-alikes say of the error that stays."""
    lines = [
        f"Pictures of one press differ by {found['noise_grey']:.2f} grey levels (noise). Nearest "
        "picture of each press, and sqrt(mean squared difference of the counts / 2):"
    ]
    for key, name in (("split", f"other shapes of {split}"), ("training", "training pairs")):
        one = found[key]
        if one is None:
            lines.append(f"  {name}: there are none")
            continue
        near, close, value = one["nearest"], one["close"], one["extrapolated_rmse_counts"]
        within = f"{close['pairs']} within {found['close_grey']:.2f}"
        if close["pairs"]:
            within += f" ({close['rmse_counts']:.0f} counts)"
        line = (
            f"  {name}: {near['rmse_counts']:.0f} counts at {near['distance_grey']:.1f} grey "
            f"levels in the median; {within}"
        )
        if value is not None:
            between = spanned(one["interval"], "{:.0f}")
            line += f"; extrapolated to the noise {value:.0f} ({between})"
        lines.append(line)
    return "\n".join(lines)


def spanned(span: list[float] | None, how: str) -> str:
    return "" if span is None else f"{how.format(span[0])}-{how.format(span[1])}"


def _cell(value: float | None, how: str) -> str:
    return "-" if value is None else how.format(value)
