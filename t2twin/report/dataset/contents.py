"""What a dataset holds: pairs of every shape, pictures of every shape, how many taxels saturate."""

from collections import Counter
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from t2twin.report.dataset.pairs import sample_in_turn
from t2twin.report.dataset.tables import Dataset
from t2twin.report.html import markup
from t2twin.report.html.figures import draw_digit_image, figure
from t2twin.report.html.labels import SPLIT_COLORS, SPLIT_NAMES, forces_in_words, shape_name
from t2twin.sim.dataset.info import DatasetInfo

TOUCHED_COUNTS = 100
"""A pair whose largest taxel counts less has not been touched: over ten times the noise."""

MAX_BARS = 100
"""Shapes that are drawn as bars one by one (assumed: three pages of paper)."""

GALLERY_COLUMNS, MAX_PICTURES = 10, 60
GALLERY_SEED = 0
WIDTH_IN = 9.0
BARS_WIDTH_IN, BAR_IN, FURNITURE_IN = 4.4, 0.17, 0.8
"""Width of the chart of shapes, which is whole on a phone; height of a shape, and of the rest."""

SATURATION_IN = 2.8
TILE_IN = 1.42


def about_section(dataset: Dataset) -> str:
    """How many pairs, how large, how made."""
    info, counts = dataset.info, dataset.counts
    shapes = {split: len(set(table["shape"].to_pylist())) for split, table in
              dataset.tables.items()}  # fmt: skip
    sizes = [(dataset.data / path).stat().st_size for path in info.shards]
    untouched = int((counts.max(axis=1) < TOUCHED_COUNTS).sum())
    facts = [
        ("Made by", made_by(info)),
        *(
            (SPLIT_NAMES[split].capitalize(), f"{len(table):,} pairs of {shapes[split]} shapes")
            for split, table in dataset.tables.items()
        ),
        ("Size", f"{sum(sizes) / 2**20:,.0f} MiB in {len(sizes)} shards, "
         f"{sum(sizes) / len(counts) / 1e3:.1f} kB a pair"),
        ("Taxels", f"{dataset.layout.x_mm.size} (layout {dataset.layout.layout}), saturated at "
         f"{dataset.layout.full_scale_counts:,.0f} counts"),
        *([("Forces", forces_in_words(dataset.forces_n))] if dataset.forces_n.size else []),
        ("Pairs without contact", f"{untouched or 'none'} of {len(counts):,} (largest taxel below "
         f"{TOUCHED_COUNTS} counts)"),
        ("Versions", ", ".join(f"{k} {v}" for k, v in info.versions.items())),
    ]  # fmt: skip
    return markup.section("about", "What it holds", [markup.facts(facts)])


def made_by(info: DatasetInfo) -> str:
    """As in "t2twin simdata, scale paper, seed 0"."""
    if not info.is_simulated:
        return "pairs of the owner's, brought in with t2twin import-pairs"
    what = "scale" if info.is_protocol else "world"
    return f"t2twin simdata, {what} {info.world_name}, seed {info.seed}"


def shapes_section(dataset: Dataset) -> str:
    """A bar a shape; of more than MAX_BARS a bar a family, the largest ones."""
    shapes = np.unique(dataset.shapes).size
    names = dataset.shapes if shapes <= MAX_BARS else dataset.families
    kind = "shape" if shapes <= MAX_BARS else "family"
    counted = counted_by_split(dataset, names)
    shown = dict(list(counted.items())[:MAX_BARS])
    height = FURNITURE_IN + BAR_IN * len(shown)
    content = figure("svg", BARS_WIDTH_IN, height, lambda page: bars(page, shown))
    parts = [markup.embed(content, "svg", f"Bar chart of the pairs of every {kind}", width="small")]
    if kind == "family":
        left = len(counted) - len(shown)
        others = f" {left:,} families with fewer pairs are not drawn." if left else ""
        parts.insert(
            0,
            markup.paragraph(
                f"There are {shapes:,} shapes, too many for a bar each; they are drawn by "
                f"family.{others}",
                "note",
            ),
        )
    return markup.section("shapes", f"Pairs of every {kind}", parts)


def counted_by_split(dataset: Dataset, names: np.ndarray) -> dict[tuple[str, str], int]:
    """Pairs by split and name; those of shapes in the order of the shards, of families that are
    too many by number. names: (P,)."""
    splits = np.repeat(list(dataset.tables), [len(table) for table in dataset.tables.values()])
    counted = Counter(zip(splits.tolist(), names.tolist(), strict=True))
    return dict(counted.most_common()) if len(counted) > MAX_BARS else dict(counted)


def gallery_section(dataset: Dataset) -> str:
    """Pictures of all shapes in turn."""
    rows = gallery(dataset)
    lines = -(-len(rows) // GALLERY_COLUMNS)
    content = figure("png", WIDTH_IN, TILE_IN * lines, lambda page: tiles(page, dataset, rows))
    return markup.section(
        "gallery",
        "Pictures",
        [
            markup.paragraph("Drawn at random, shape by shape.", "note"),
            markup.embed(content, "png", "A grid of DIGIT pictures of all shapes"),
        ],
    )


def gallery(dataset: Dataset) -> list[tuple[str, int]]:
    """Splits and rows: one of each shape, then one more of each while a line is to be filled."""
    return sample_in_turn(dataset, dataset.shapes, MAX_PICTURES, GALLERY_SEED)


def saturation_section(dataset: Dataset) -> str:
    """Taxels at full scale: by pair, by taxel."""
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
                "Histograms of the largest count, of saturated taxels a pair, and by taxel",
                note="Left: the largest count of each pair. Middle: how many of a pair's taxels "
                "are saturated. Right: how often each taxel is, at its place in the array.",
            ),
        ],
    )


def bars(page: Figure, counted: Mapping[tuple[str, str], int]) -> None:
    """counted: pairs by split and name, in the order of the bars."""
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
