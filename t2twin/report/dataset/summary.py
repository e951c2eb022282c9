"""What the page of a dataset begins with: four sentences at most, and a pair."""

import numpy as np

from t2twin.report.dataset.contents import TOUCHED_COUNTS
from t2twin.report.dataset.duplicates import near_duplicates
from t2twin.report.dataset.example import example
from t2twin.report.dataset.scan import Scan
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.labels import SPLIT_NAMES, forces_in_words, shape_name


def section(dataset: Dataset, scan: Scan) -> str:
    """The sentences, then a pair whose largest count is the middle one."""
    parts = [markup.paragraph(sentence) for sentence in sentences(dataset, scan)]
    return markup.section("summary", "In short", [*parts, _picture(dataset)])


def sentences(dataset: Dataset, scan: Scan) -> list[str]:
    """What a pair is; how many there are; whether they are sane; what they are not."""
    return [_pair(dataset), _numbers(dataset), _state(dataset, scan), _origin(dataset)]


def _pair(dataset: Dataset) -> str:
    taxels, full_scale = dataset.layout.x_mm.size, dataset.layout.full_scale_counts
    return (
        "Each pair is one touch taken by two sensors: the picture of a DIGIT (a camera that films "
        f"a soft gel from behind), and the {taxels} counts, each from 0 to {full_scale:,.0f}, of "
        "a CySkin (an array of pressure pads, called taxels, under a soft cover)."
    )


def _numbers(dataset: Dataset) -> str:
    splits = ", ".join(
        f"{len(table):,} for {SPLIT_NAMES[split]}" for split, table in dataset.tables.items()
    )
    shapes = len(set(dataset.shapes.tolist()))
    forces = dataset.forces_n
    pressed = f", pressed with {forces_in_words(forces)}" if forces.size > 1 else ""
    return f"There are {len(dataset.places):,} pairs of {shapes:,} shapes{pressed}: {splits}."


def _state(dataset: Dataset, scan: Scan) -> str:
    counts = dataset.counts
    untouched = counts.max(axis=1) < TOUCHED_COUNTS
    return (
        f"Of the pairs {_share(near_duplicates(dataset, scan))} repeat another one within the "
        f"noise, and {_share(untouched)} touch no taxel (no count reaches {TOUCHED_COUNTS}); of "
        f"the counts {_share(dataset.saturated)} are at full scale, where a pad tells no more."
    )


def _share(which: np.ndarray) -> str:
    """How many of some are so, as in "1.2 %"."""
    return f"{100 * which.mean():.2g} %" if which.any() else "none"


def _origin(dataset: Dataset) -> str:
    if dataset.info.is_simulated and not dataset.info.is_protocol:
        return "All of it is simulated, and no real sensor had a part in it."
    if dataset.info.is_simulated:
        return (
            "All of it is simulated: validation holds versions of the shapes that training has "
            "not, the test hand tools, and no real sensor had a part in it."
        )
    return (
        "The pairs were brought in by their owner; how they were taken, and what their shapes are, "
        "is not known here."
    )


def _picture(dataset: Dataset) -> str:
    largest = dataset.counts.max(axis=1)
    place = int(np.argsort(largest, kind="stable")[(largest.size - 1) // 2])
    split, row = dataset.places[place]
    shape = shape_name(dataset.shape(split, row))
    note = (
        f"Left: what the DIGIT saw of {shape}. Right: what the taxels (draw_taxels) counted at the same "
        f"touch, interpolated between them; the scale is in counts. Of all pairs the largest count "
        f"of this one, {largest[place]:,.0f}, is in the middle."
    )
    content = example(dataset, split, row)
    alt = "A DIGIT picture and the tactile image of the same touch"
    return markup.embed(content, "png", alt, "One pair.", width="small", note=note)
