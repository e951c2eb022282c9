"""The paper's qualitative figure: DIGIT image, predicted and true tactile images."""

import numpy as np
from matplotlib.figure import Figure

from t2twin.report.data import ReportData
from t2twin.report.html import markup
from t2twin.report.html.figures import (
    DIFFERENCE_MAP,
    color_bar,
    digit_width,
    draw_digit_image,
    draw_tactile_image,
    draw_taxels,
    figure,
)
from t2twin.report.html.labels import name_of, shape_name

QUANTILES = {"val": (0.1, 0.5, 0.9, 1.0), "test": (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)}
"""Quantiles of the error at which samples are shown."""

SPLIT_NAMES = {"val": "Validation", "test": "Test"}
PANEL_IN, ROW_IN, BARS_IN = 1.25, 2.5, 0.9
"""Width of a panel, height of a row, width of the color bars, inches."""
BAR_WIDTH = 0.12
"""Width of a color bar, relative to a tactile image."""


def section(report: ReportData) -> str:
    """One figure per sample."""
    figures = [
        _sample(report, split, row, quantile)
        for split in report.evaluations
        for row, quantile in samples_at_quantiles(report, split)
    ]
    text = (
        "X is the DIGIT image, Ŷ the predicted counts, φ the barycentric interpolation of counts "
        "to a tactile image, I = φ(Y) the true tactile image. touch2touch generates a tactile "
        "image, from which φ⁻¹ computes Ŷ; φ(Ŷ) is the part of it that the taxels can represent. "
        "The number under a title is the RMSE of the pair. A row has one color scale of counts and "
        "one of differences: red for overestimation, blue for underestimation. Rings mark the "
        "taxels. Pairs are ordered by the mean RMSE of the models and shown at fixed quantiles: "
        "0.1, 0.5, 0.9 of the validation split, 0.1 to 0.9 in steps of 0.2 of the test split, and "
        "1, the worst pair, of both."
    )
    return markup.section(
        "samples", "Samples by quantile of the error", [markup.paragraph(text, "note"), *figures]
    )


def samples_at_quantiles(report: ReportData, split: str) -> list[tuple[int, float]]:
    """Unique rows at QUANTILES of the error, with their quantile."""
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
    content = sample_image(report, split, row)
    listed = "; ".join(f"{name_of(name)} {error:,.0f}" for name, error in errors.items())
    pose = ("x_mm", "y_mm", "yaw_rad", "force_n")
    x_mm, y_mm, yaw_rad, force_n = (table[name][row].as_py() for name in pose)
    several = report.forces_n.size > 1
    where = [
        *([] if x_mm is None else [f"x {_tenths(x_mm)} mm"]),
        *([] if y_mm is None else [f"y {_tenths(y_mm)} mm"]),
        *([] if yaw_rad is None else [f"yaw {np.degrees(yaw_rad):.0f}°"]),
        *([f"{force_n:.3g} N"] if several and force_n is not None else []),
    ]
    note = f"{SPLIT_NAMES[split]}, quantile {quantile:g}"
    note += f"; {', '.join(where)}. " if where else ". "
    note += f"RMSE in counts: {listed}."
    alt = f"DIGIT image, predicted and true tactile images of {shape}"
    return markup.embed(content, "png", alt, shape, note=note)


def sample_image(report: ReportData, split: str, row: int) -> bytes:
    """One sample as PNG: X, generated images, phi of the predicted counts, differences, and I."""
    generated = sum(run.reads_any_layout for run in report.runs.values())
    panels = 2 + 2 * len(report.runs) + generated
    image = report.image(split, row)
    width = PANEL_IN * (panels - 1 + digit_width(image)) + BARS_IN
    return figure("png", width, ROW_IN, lambda page: _draw(page, report, split, row, image))


def _tenths(value: float) -> str:
    """A number with one decimal and a typographic minus sign."""
    return f"{round(value, 1) + 0.0:.1f}".replace("-", "−")


def _draw(page: Figure, report: ReportData, split: str, row: int, digit: np.ndarray) -> None:
    predictions, phi = report.predictions[split], report.phi
    truth = phi(predictions.truth[row])
    images: list[tuple[str, np.ndarray]] = []
    differences: dict[int, np.ndarray] = {}  # by the number of preceding images
    for name, run in report.runs.items():
        predicted = phi(predictions.by_model[name][row])
        if run.reads_any_layout:
            images.append((f"{name_of(name)}\ngenerated", run.tactile_images([digit])[0]))
        error = predictions.rmse_counts(name)[row]
        images.append((f"φ(Ŷ) {name_of(name)}\n{error:,.0f} counts", predicted))
        differences[len(images)] = predicted - truth
    images.append(("I = φ(Y)\ntrue", truth))
    limits = (0.0, max(1.0, *(float(image.max()) for _, image in images)))
    largest = max(1.0, *(float(np.abs(image).max()) for image in differences.values()))
    panels = len(images) + len(differences)
    axes = iter(page.subplots(1, 1 + panels, width_ratios=(digit_width(digit), *[1.0] * panels)))
    first = next(axes)
    first.set_title("X\nDIGIT")
    draw_digit_image(first, digit)
    for number, (title, image) in enumerate(images, start=1):
        place = next(axes)
        place.set_title(title)
        counts = draw_tactile_image(place, image, phi, limits)
        draw_taxels(place, report.layout.x_mm, report.layout.y_mm)
        if number in differences:
            place = next(axes)
            place.set_title("φ(Ŷ) − I\n")
            signed = draw_tactile_image(
                place, differences[number], phi, (-largest, largest), DIFFERENCE_MAP
            )
            draw_taxels(place, report.layout.x_mm, report.layout.y_mm, "#555555")
    color_bar(page, signed, place, BAR_WIDTH, "difference, counts")
    color_bar(page, counts, place, BAR_WIDTH, "counts")
