"""Content of a dataset: pairs and images of the shapes, saturation, contact sheet."""

import io
import tempfile
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from t2twin.primitives_cad.contact_sheet import draw_sheet
from t2twin.report.dataset.pairs import sample_in_turn
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.figures import draw_digit_image, figure
from t2twin.report.html.labels import SPLIT_COLORS, SPLIT_NAMES, forces_text, shape_name
from t2twin.sim.dataset.info import DatasetInfo

MIN_CONTACT_COUNTS = 100
"""Smallest maximum count of a pair with contact: more than ten times the noise."""

MAX_BARS = 100
"""Maximum number of bars (assumed: three printed pages)."""

GALLERY_COLUMNS, MAX_IMAGES = 10, 60
GALLERY_SEED = 0
WIDTH_IN = 9.0
BARS_WIDTH_IN, BAR_IN, MARGINS_IN = 4.4, 0.17, 0.8
"""Width of the bar chart, which fits on a phone; height of a bar and of the margins, inches."""

SATURATION_IN = 2.8
TILE_IN = 1.42
JPEG_QUALITY = 85


def about_section(dataset: Dataset) -> str:
    """Origin, number of pairs, and size of the dataset."""
    info, counts = dataset.info, dataset.counts
    shapes = {split: len(set(table["shape"].to_pylist())) for split, table in
              dataset.tables.items()}  # fmt: skip
    sizes = [(dataset.data / path).stat().st_size for path in info.shards]
    without_contact = int((counts.max(axis=1) < MIN_CONTACT_COUNTS).sum())
    facts = [
        ("Created by", created_by(info)),
        *(
            (SPLIT_NAMES[split].capitalize(), f"{len(table):,} pairs of {shapes[split]} shapes")
            for split, table in dataset.tables.items()
        ),
        ("Size", f"{sum(sizes) / 2**20:,.0f} MiB in {len(sizes)} shards, "
         f"{sum(sizes) / len(counts) / 1e3:.1f} kB a pair"),
        ("Taxels", f"{dataset.layout.x_mm.size} (layout {dataset.layout.layout}), saturated at "
         f"{dataset.layout.full_scale_counts:,.0f} counts"),
        *([("Forces", forces_text(dataset.forces_n))] if dataset.forces_n.size else []),
        ("Pairs without contact", f"{without_contact or 'none'} of {len(counts):,} (largest taxel "
         f"below {MIN_CONTACT_COUNTS} counts)"),
        ("Versions", ", ".join(f"{k} {v}" for k, v in info.versions.items())),
    ]  # fmt: skip
    return markup.section("about", "Content", [markup.facts(facts)])


def created_by(info: DatasetInfo) -> str:
    """Origin of a dataset, such as "t2twin simdata, scale paper, seed 0"."""
    if not info.is_simulated:
        return "pairs imported with t2twin import-pairs"
    what = "scale" if info.is_protocol else "world"
    return f"t2twin simdata, {what} {info.world_name}, seed {info.seed}"


def shapes_section(dataset: Dataset) -> str:
    """Bar chart of the pairs per shape; of more than MAX_BARS shapes, per family."""
    shapes = np.unique(dataset.shapes).size
    names = dataset.shapes if shapes <= MAX_BARS else dataset.families
    kind = "shape" if shapes <= MAX_BARS else "family"
    counted = counted_by_split(dataset, names)
    shown = dict(list(counted.items())[:MAX_BARS])
    height = MARGINS_IN + BAR_IN * len(shown)
    content = figure("svg", BARS_WIDTH_IN, height, lambda page: bars(page, shown))
    parts = [markup.embed(content, "svg", f"Bar chart of the pairs by {kind}", width="small")]
    if kind == "family":
        hidden = len(counted) - len(shown)
        others = f" {hidden:,} families with fewer pairs are not shown." if hidden else ""
        text = f"The {shapes:,} shapes are grouped by family.{others}"
        parts.insert(0, markup.paragraph(text, "note"))
    return markup.section("shapes", f"Pairs by {kind}", parts)


def counted_by_split(dataset: Dataset, names: np.ndarray) -> dict[tuple[str, str], int]:
    """Number of pairs by split and name, in the order of the shards; of more than MAX_BARS names,
    in descending order. names: (P,)."""
    splits = np.repeat(list(dataset.tables), [len(table) for table in dataset.tables.values()])
    counted = Counter(zip(splits.tolist(), names.tolist(), strict=True))
    return dict(counted.most_common()) if len(counted) > MAX_BARS else dict(counted)


def gallery_section(dataset: Dataset) -> str:
    """Grid of images of all shapes."""
    rows = gallery(dataset)
    lines = -(-len(rows) // GALLERY_COLUMNS)
    content = figure("png", WIDTH_IN, TILE_IN * lines, lambda page: tiles(page, dataset, rows))
    return markup.section(
        "gallery",
        "Images",
        [
            markup.paragraph("Random samples, one shape after another.", "note"),
            markup.embed(content, "png", "Grid of DIGIT images of all shapes"),
        ],
    )


def gallery(dataset: Dataset) -> list[tuple[str, int]]:
    """Splits and rows of the sampled images: one of each shape, then further ones of each."""
    return sample_in_turn(dataset, dataset.shapes, MAX_IMAGES, GALLERY_SEED)


def saturation_section(dataset: Dataset) -> str:
    """Saturated counts by pair and by taxel."""
    saturated = dataset.saturated
    some = saturated.any(axis=1)
    text = (
        f"{saturated.sum():,} of {saturated.size:,} counts are saturated, "
        f"{100 * saturated.mean():.3g} %; at least one in {100 * some.mean():.3g} % of the pairs."
    )
    chart = figure("svg", WIDTH_IN, SATURATION_IN, lambda page: saturation(page, dataset))
    return markup.section(
        "saturation",
        "Saturation",
        [
            markup.paragraph(text),
            markup.embed(
                chart,
                "svg",
                "Histograms of the largest count and of saturated taxels, by pair and by taxel",
                note="Left: largest count of each pair. Middle: number of saturated taxels of a "
                "pair. Right: share of the pairs in which a taxel is saturated, at its position in "
                "the array.",
            ),
        ],
    )


def contact_sheet_section() -> str:
    """Contact sheet of all primitives and tools."""
    note = (
        "Columns of primitives are families, rows are versions; version 3 is for validation. Tools "
        "are pressed at the four points marked on each."
    )
    return markup.section(
        "shapes",
        "Shapes",
        [
            markup.embed(
                _contact_sheet(), "jpeg", "Every primitive and tool with its name", note=note
            )
        ],
    )


def _contact_sheet() -> bytes:
    """Content of a JPEG file, which is several times smaller than a PNG."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "contact-sheet.png"
        draw_sheet(path)
        buffer = io.BytesIO()
        with Image.open(path) as image:
            image.convert("RGB").save(
                buffer, format="JPEG", quality=JPEG_QUALITY, optimize=True, progressive=True
            )
    return buffer.getvalue()


def bars(page: Figure, counted: Mapping[tuple[str, str], int]) -> None:
    """counted: number of pairs by split and name, in the order of the bars."""
    axes = page.subplots()
    for split in dict.fromkeys(split for split, _ in counted):
        own = [n for n, (where, _) in enumerate(counted) if where == split]
        pairs = [number for (where, _), number in counted.items() if where == split]
        axes.barh(own, pairs, 0.8, color=SPLIT_COLORS[split], label=SPLIT_NAMES[split])
    axes.set_yticks(range(len(counted)), [shape_name(name) for _, name in counted], fontsize=7.5)
    axes.set(xlabel="pairs", ylim=(len(counted) - 0.4, -0.6))
    axes.locator_params(axis="x", integer=True)
    axes.legend()


def tiles(page: Figure, dataset: Dataset, rows: list[tuple[str, int]]) -> None:
    lines = -(-len(rows) // GALLERY_COLUMNS)
    axes: list[Axes] = list(np.ravel(page.subplots(lines, GALLERY_COLUMNS, squeeze=False)))
    for place in axes:
        place.set_axis_off()
    for place, (split, row) in zip(axes, rows, strict=False):
        draw_digit_image(place, dataset.image(split, row))
        place.set_title(shape_name(dataset.shape(split, row)), fontsize=6)


def saturation(page: Figure, dataset: Dataset) -> None:
    largest, number, array = page.subplots(1, 3)
    counts, full_scale = dataset.counts, dataset.layout.full_scale_counts
    largest.hist(counts.max(axis=1), np.linspace(0, full_scale, 41).tolist(), color="#0072b2")
    largest.set(xlabel="largest count of a pair", ylabel="pairs")
    largest.xaxis.set_major_formatter("{x:,.0f}")
    largest.locator_params(axis="x", nbins=4)
    saturated = dataset.saturated
    times = np.bincount(saturated.sum(axis=1))
    number.bar(range(times.size), times, color="#0072b2")
    number.set(xlabel="saturated taxels of a pair", ylabel="pairs", yscale="log")
    number.locator_params(axis="x", integer=True)
    drawn = array.scatter(
        dataset.layout.x_mm,
        dataset.layout.y_mm,
        c=100 * saturated.mean(axis=0),
        s=70,
        edgecolors="#444444",
        linewidths=0.4,
    )
    array.set(aspect="equal", xlabel="x, mm", ylabel="y, mm")
    array.margins(0.15)
    array.invert_yaxis()
    page.colorbar(drawn, ax=array, label="saturated, % of the pairs")
