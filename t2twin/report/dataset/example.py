"""Figure of one press: DIGIT image, tactile image, and the prediction of a run."""

import numpy as np
from matplotlib.figure import Figure

from t2twin.report.dataset.tables import Dataset
from t2twin.report.html.figures import (
    color_bar,
    digit_width,
    draw_digit_image,
    draw_tactile_image,
    draw_taxels,
    figure,
)
from t2twin.sim.cyskin.phi import TACTILE_SHAPE

WIDTH_IN, BAR_IN, TITLES_IN = 4.2, 0.7, 0.45
"""Width of the figure and of the color bar, height of the titles, inches."""

BAR_WIDTH = 0.12
"""Width of the color bar, relative to a tactile image."""


def example(dataset: Dataset, split: str, row: int, translated: np.ndarray | None = None) -> bytes:
    """Content of a PNG file with a pair. translated: (N,) predicted counts."""
    true = np.array(dataset.tables[split]["taxels"][row].as_py(), dtype=np.float32)
    if translated is None:
        titles = {"CySkin\n(counts)": true}
    else:
        titles = {"CySkin\n(true counts)": true, "network\n(predicted)": translated}
    image = dataset.image(split, row)
    ratio = digit_width(image)

    def draw(page: Figure) -> None:
        axes = page.subplots(1, 1 + len(titles), width_ratios=(ratio, *[1.0] * len(titles)))
        axes[0].set_title("DIGIT\n(image)")
        draw_digit_image(axes[0], image)
        high = max(1.0, *(float(counts.max()) for counts in titles.values()))
        for place, (title, counts) in zip(axes[1:], titles.items(), strict=True):
            place.set_title(title)
            drawn = draw_tactile_image(place, dataset.phi(counts), dataset.phi, (0.0, high))
            draw_taxels(place, dataset.layout.x_mm, dataset.layout.y_mm)
        color_bar(page, drawn, axes[-1], BAR_WIDTH, "counts")

    panel_in = (WIDTH_IN - BAR_IN) / (ratio + len(titles))
    height_in = TITLES_IN + panel_in * TACTILE_SHAPE[0] / TACTILE_SHAPE[1]
    return figure("png", WIDTH_IN, height_in, draw)
