"""The paper's qualitative figure: what the DIGIT saw, what each model made of it, and the truth."""

import numpy as np
from matplotlib.figure import Figure

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.figures import (
    DIFFERENCE_MAP,
    color_bar,
    digit_picture,
    digit_width,
    figure,
    rings,
    tactile_image,
)
from t2twin.report.html.labels import name_of, shape_name

QUANTILES = {"val": (0.1, 0.5, 0.9, 1.0), "test": (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)}
"""Of the error, which samples are shown."""

SPLIT_NAMES = {"val": "Validation", "test": "Test"}
PANEL_IN, ROW_IN, BARS_IN = 1.25, 2.5, 0.9
"""Width of a panel, height of a row, width of the color bars, inches."""
BAR_WIDTH = 0.12
"""Room for a color bar, in parts of a tactile image's width."""


def section(report: ReportData) -> str:
    """One picture a sample."""
    figures = [
        _sample(report, split, row, quantile)
        for split in report.evaluations
        for row, quantile in chosen(report, split)
    ]
    text = (
        "X is the DIGIT picture, Ŷ the counts that a model predicts from it, φ the barycentric "
        "interpolation that turns counts into a tactile image, I = φ(Y) the truth. touch2touch "
        "draws a tactile image first; its Ŷ is read back from that with φ⁻¹, so φ(Ŷ) shows what "
        "of the drawing the taxels could have said. Number under a title: the RMSE of this pair. "
        "Colours of counts are the same along a row; differences have a scale of their own, red "
        "where too much is predicted, blue where too little. Rings mark the taxels. The samples "
        "are not the best ones: pairs are ordered by the mean of the models' RMSE, and those "
        "at fixed quantiles are shown, the same for all models: 0.1, 0.5 and 0.9 of validation, "
        "0.1 to 0.9 in steps of 0.2 of test, and 1, the worst one of each."
    )
    return markup.section(
        "samples", "Samples, from good to bad", [markup.paragraph(text, "note"), *figures]
    )


def chosen(report: ReportData, split: str) -> list[tuple[int, float]]:
    """Rows at QUANTILES of the error, with their quantile; of few pairs, each one once."""
    predictions = report.predictions[split]
    error = np.mean([predictions.rmse_counts(name) for name in report.runs], axis=0)
    order = np.argsort(error, kind="stable")
    rows: dict[int, float] = {}
    for quantile in QUANTILES[split]:
        rows.setdefault(int(order[round(quantile * (order.size - 1))]), quantile)
    return list(rows.items())


def _sample(report: ReportData, split: str, row: int, quantile: float) -> str:
    predictions, table = report.predictions[split], report.tables[split]
    errors = {name: float(predictions.rmse_counts(name)[row]) for name in report.runs}
    shape = shape_name(report.shape(split, row))
    content = row_picture(report, split, row)
    said = "; ".join(f"{name_of(name)} {error:,.0f}" for name, error in errors.items())
    pose = ("x_mm", "y_mm", "yaw_rad", "force_n")
    x_mm, y_mm, yaw_rad, force_n = (table[name][row].as_py() for name in pose)
    several = report.forces_n.size > 1
    where = [
        *([] if x_mm is None else [f"x {_tenths(x_mm)} mm"]),
        *([] if y_mm is None else [f"y {_tenths(y_mm)} mm"]),
        *([] if yaw_rad is None else [f"turned {np.degrees(yaw_rad):.0f}°"]),
        *([f"{force_n:.3g} N"] if several and force_n is not None else []),
    ]
    note = f"{SPLIT_NAMES[split]}, quantile {quantile:g}"
    note += f"; {', '.join(where)}. " if where else ". "
    note += f"RMSE in counts: {said}."
    alt = f"DIGIT picture, predicted tactile images and the true one of {shape}"
    return markup.picture(content, "png", alt, shape, note=note)


def row_picture(report: ReportData, split: str, row: int) -> bytes:
    """One sample as PNG: X, what each model draws, phi of its counts and how that is off, and I."""
    drawings = sum(run.reads_any_layout for run in report.runs.values())
    panels = 2 + 2 * len(report.runs) + drawings
    picture = report.picture(split, row)
    width = PANEL_IN * (panels - 1 + digit_width(picture)) + BARS_IN
    return figure("png", width, ROW_IN, lambda page: _draw(page, report, split, row, picture))


def _tenths(value: float) -> str:
    """With a minus sign, and none for zero."""
    return f"{round(value, 1) + 0.0:.1f}".replace("-", "−")


def _draw(page: Figure, report: ReportData, split: str, row: int, picture: np.ndarray) -> None:
    predictions, phi = report.predictions[split], report.phi
    truth = phi(predictions.truth[row])
    images: list[tuple[str, np.ndarray]] = []
    differences: dict[int, np.ndarray] = {}  # by the number of images before each
    for name, run in report.runs.items():
        predicted = phi(predictions.by_model[name][row])
        if run.reads_any_layout:
            images.append((f"{name_of(name)}\ndraws", run.tactile_images([picture])[0]))
        error = predictions.rmse_counts(name)[row]
        images.append((f"φ(Ŷ) {name_of(name)}\n{error:,.0f} counts", predicted))
        differences[len(images)] = predicted - truth
    images.append(("I = φ(Y)\ntruth", truth))
    most = max(1.0, *(float(image.max()) for _, image in images))
    furthest = max(1.0, *(float(np.abs(image).max()) for image in differences.values()))
    panels = len(images) + len(differences)
    axes = iter(page.subplots(1, 1 + panels, width_ratios=(digit_width(picture), *[1.0] * panels)))
    first = next(axes)
    first.set_title("X\nDIGIT")
    digit_picture(first, picture)
    for number, (title, image) in enumerate(images, start=1):
        place = next(axes)
        place.set_title(title)
        counts = tactile_image(place, image, phi, (0.0, most))
        rings(place, report.layout.x_mm, report.layout.y_mm)
        if number in differences:
            place = next(axes)
            place.set_title("φ(Ŷ) − I\n")
            limits = (-furthest, furthest)
            signed = tactile_image(place, differences[number], phi, limits, DIFFERENCE_MAP)
            rings(place, report.layout.x_mm, report.layout.y_mm, "#555555")
    color_bar(page, signed, place, BAR_WIDTH, "difference, counts")
    color_bar(page, counts, place, BAR_WIDTH, "counts")
