"""The paper's qualitative figure: what the DIGIT saw, what each model made of it, and the truth."""

import numpy as np
from matplotlib.figure import Figure

from t2twin.report import markup
from t2twin.report.figures import (
    DIFFERENCE_MAP,
    colour_bar,
    digit_picture,
    figure,
    rings,
    tactile_image,
)
from t2twin.report.material import ReportData
from t2twin.report.names import name_of
from t2twin.translate.phi import TACTILE_SHAPE
from t2twin.translate.touch2touch import Touch2Touch

QUANTILES = {"val": (0.1, 0.5, 0.9, 1.0), "test": (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)}
"""Of the error, which samples are shown."""

SPLIT_NAMES = {"val": "Validation", "test": "Test"}
PANEL_IN, ROW_IN, BARS_IN = 1.25, 2.5, 0.9
"""Width of a panel, height of a row, width of the colour bars, inches."""
DIGIT_WIDTH = (240 / 320) / (TACTILE_SHAPE[1] / TACTILE_SHAPE[0])
"""Width of the DIGIT picture, in parts of a tactile image's of the same height."""
BAR_WIDTH = 0.12
"""Room for a colour bar, in parts of a tactile image's width."""


def section(material: ReportData) -> str:
    """One picture a sample."""
    figures = [
        _sample(material, split, row, quantile)
        for split in QUANTILES
        for row, quantile in chosen(material, split)
    ]
    text = (
        "X is the DIGIT picture, Ŷ the counts that a model predicts from it, φ the barycentric "
        "interpolation that turns counts into a tactile image, I = φ(Y) the truth. touch2touch "
        "draws a tactile image first; its Ŷ is read back from that with φ⁻¹, so φ(Ŷ) shows what "
        "of the drawing the taxels could have said. Number under a title: sqrt(L3) of this pair. "
        "Colours of counts are the same along a row; differences have a scale of their own, red "
        "where too much is predicted, blue where too little. Rings mark the taxels. The samples "
        "are not the best ones: pairs are ordered by the mean of the models' sqrt(L3), and those "
        "at fixed quantiles are shown, the same for all models: 0.1, 0.5 and 0.9 of validation, "
        "0.1 to 0.9 in steps of 0.2 of test, and 1, the worst one of each."
    )
    return markup.section(
        "samples", "Samples, from good to bad", [markup.paragraph(text, "note"), *figures]
    )


def chosen(material: ReportData, split: str) -> list[tuple[int, float]]:
    """Rows at QUANTILES of the error, with their quantile; of few pairs, each one once."""
    evaluated = material.evaluated[split]
    error = np.mean([evaluated.errors(name) for name in material.runs], axis=0)
    order = np.argsort(error, kind="stable")
    rows: dict[int, float] = {}
    for quantile in QUANTILES[split]:
        rows.setdefault(int(order[round(quantile * (order.size - 1))]), quantile)
    return list(rows.items())


def _sample(material: ReportData, split: str, row: int, quantile: float) -> str:
    evaluated, table = material.evaluated[split], material.tables[split]
    errors = {name: float(evaluated.errors(name)[row]) for name in material.runs}
    shape = table["shape"][row].as_py()
    content = row_picture(material, split, row)
    said = "; ".join(f"{name_of(name)} {error:,.0f}" for name, error in errors.items())
    where = (
        f"x {_tenths(table['x_mm'][row].as_py())} mm, y {_tenths(table['y_mm'][row].as_py())} mm, "
        f"turned {np.degrees(table['yaw_rad'][row].as_py()):.0f}°"
    )
    note = f"{SPLIT_NAMES[split]}, quantile {quantile:g}; {where}. sqrt(L3) in counts: {said}."
    alt = f"DIGIT picture, predicted tactile images and the true one of {shape}"
    return markup.picture(content, "png", alt, shape, note=note)


def row_picture(material: ReportData, split: str, row: int) -> bytes:
    """One sample as PNG: X, what each model draws, phi of its counts and how that is off, and I."""
    drawings = sum(isinstance(run.translator, Touch2Touch) for run in material.runs.values())
    panels = 2 + 2 * len(material.runs) + drawings
    return figure(
        "png", PANEL_IN * panels + BARS_IN, ROW_IN, lambda page: _draw(page, material, split, row)
    )


def _tenths(value: float) -> str:
    """With a minus sign, and none for a nought."""
    return f"{round(value, 1) + 0.0:.1f}".replace("-", "−")


def _draw(page: Figure, material: ReportData, split: str, row: int) -> None:
    evaluated, phi = material.evaluated[split], material.phi
    picture = material.picture(split, row)
    truth = phi(evaluated.truth[row])
    images: list[tuple[str, np.ndarray]] = []
    differences: dict[int, np.ndarray] = {}  # by the number of images before each
    for name, run in material.runs.items():
        predicted = phi(evaluated.predictions[name][row])
        if isinstance(run.translator, Touch2Touch):
            images.append((f"{name_of(name)}\ndraws", run.tactile_images([picture])[0]))
        error = evaluated.errors(name)[row]
        images.append((f"φ(Ŷ) {name_of(name)}\n{error:,.0f} counts", predicted))
        differences[len(images)] = predicted - truth
    images.append(("I = φ(Y)\ntruth", truth))
    most = max(1.0, *(float(image.max()) for _, image in images))
    furthest = max(1.0, *(float(np.abs(image).max()) for image in differences.values()))
    panels = len(images) + len(differences)
    axes = iter(page.subplots(1, 1 + panels, width_ratios=(DIGIT_WIDTH, *[1.0] * panels)))
    first = next(axes)
    first.set_title("X\nDIGIT")
    digit_picture(first, picture)
    for number, (title, image) in enumerate(images, start=1):
        place = next(axes)
        place.set_title(title)
        counts = tactile_image(place, image, phi, (0.0, most))
        rings(place, material.layout.x_mm, material.layout.y_mm)
        if number in differences:
            place = next(axes)
            place.set_title("φ(Ŷ) − I\n")
            limits = (-furthest, furthest)
            signed = tactile_image(place, differences[number], phi, limits, DIFFERENCE_MAP)
            rings(place, material.layout.x_mm, material.layout.y_mm, "#555555")
    colour_bar(page, signed, place, BAR_WIDTH, "difference, counts")
    colour_bar(page, counts, place, BAR_WIDTH, "counts")
