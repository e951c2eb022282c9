"""Summary of a dataset: four paragraphs and an example pair."""

import numpy as np

from t2twin.report.dataset.contents import MIN_CONTACT_COUNTS
from t2twin.report.dataset.duplicates import near_duplicates
from t2twin.report.dataset.example import example
from t2twin.report.dataset.scan import Scan
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, forces_text, shape_name


def section(dataset: Dataset, scan: Scan) -> str:
    """The paragraphs, and the pair with the median maximum count."""
    parts = [markup.paragraph(text) for text in paragraphs(dataset, scan)]
    return markup.section("summary", "Summary", [*parts, _example(dataset)])


def paragraphs(dataset: Dataset, scan: Scan) -> list[str]:
    """Definition of a pair, number of pairs, quality, and origin."""
    return [_pair(dataset), _numbers(dataset), _quality(dataset, scan), _origin(dataset)]


def _pair(dataset: Dataset) -> str:
    taxels, full_scale = dataset.layout.x_mm.size, dataset.layout.full_scale_counts
    return (
        "A pair is one touch measured by two sensors: the image of a DIGIT (a camera behind a soft "
        f"gel), and the {taxels} counts, each from 0 to {full_scale:,.0f}, of a CySkin (an array "
        "of pressure sensors, called taxels, under a soft cover)."
    )


def _numbers(dataset: Dataset) -> str:
    splits = ", ".join(
        f"{len(table):,} for {SPLIT_NAMES[split]}" for split, table in dataset.tables.items()
    )
    shapes = len(set(dataset.shapes.tolist()))
    forces = dataset.forces_n
    pressed = f", pressed with {forces_text(forces)}" if forces.size > 1 else ""
    return f"There are {len(dataset.places):,} pairs of {shapes:,} shapes{pressed}: {splits}."


def _quality(dataset: Dataset, scan: Scan) -> str:
    without_contact = dataset.counts.max(axis=1) < MIN_CONTACT_COUNTS
    return (
        f"Near-duplicates: {_share(near_duplicates(dataset, scan))} of the pairs differ from "
        f"another pair by less than the noise. Without contact: {_share(without_contact)} of the "
        f"pairs (no count reaches {MIN_CONTACT_COUNTS}). Saturated: {_share(dataset.saturated)} of "
        "the counts."
    )


def _share(which: np.ndarray) -> str:
    """The share of True values, such as "1.2 %", or "none"."""
    return f"{100 * which.mean():.2g} %" if which.any() else "none"


def _origin(dataset: Dataset) -> str:
    if dataset.info.is_simulated and not dataset.info.is_protocol:
        return "All pairs are simulated; no real sensor was used."
    if dataset.info.is_simulated:
        return (
            "All pairs are simulated; no real sensor was used. The validation split contains "
            "versions of the shapes that are not in the training split, the test split hand tools."
        )
    return "The pairs were imported; their measurement and shapes are unknown."


def _example(dataset: Dataset) -> str:
    largest = dataset.counts.max(axis=1)
    place = int(np.argsort(largest, kind="stable")[(largest.size - 1) // 2])
    split, row = dataset.places[place]
    shape = shape_name(dataset.shape(split, row))
    note = (
        f"Left: DIGIT image of {shape}. Right: tactile image of the same touch, interpolated "
        "between the taxels (rings), in counts. The maximum count of this pair, "
        f"{largest[place]:,.0f}, is the median over all pairs."
    )
    content = example(dataset, split, row)
    alt = "A DIGIT image and the tactile image of the same touch"
    return markup.embed(content, "png", alt, "Example pair.", width="small", note=note)
