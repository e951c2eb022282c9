"""A dataset in memory and its report. Images are read individually.

Shape letters: P pairs of all splits, N taxels, R rows and C columns of an image.
"""

from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from t2twin.core import arguments
from t2twin.core.draw import PALETTE, Panel, draw_discs, figure, panels_image
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.report.page import (
    SPLIT_COLORS,
    SPLIT_NAMES,
    check_out,
    printable,
    shape_name,
    write_page,
)
from t2twin.sim.dataset.columns import CONTACT, COUNTS, IMAGE, POSE, column
from t2twin.sim.dataset.info import SPLITS, ArrayInfo, DatasetInfo
from t2twin.sim.dataset.store import iter_images, lists, read_info, read_split, split_shards
from t2twin.sim.taxels.phi import Phi
from t2twin.sim.taxels.reading import expected_reading

COLUMNS = ("shape", "family", "index", *POSE)  # of the table, besides those of the contacts
SATURATED_SHARE = 0.98  # of full scale; a saturated count is above (assumed: noise lowers it less)
MIN_CONTACT_SHARE = 0.0025  # smallest count of a touched taxel, share of full scale (assumed)

AT_REST_STDS = 10.0
"""Smallest count of a touched taxel over its mean at rest, standard deviations of the noise
(assumed: 0.6 % of the samples without contact have one)."""

ROUNDING_COUNTS = 0.5
MAX_LISTED_FORCES = 6
PAIRS, PAIR_IN = 12, 4.4  # number of pairs, and width of their pictures, inches
MAX_BARS = 100  # assumed: three printed pages
GALLERY_COLUMNS, MAX_IMAGES = 10, 60
BARS_WIDTH_IN, BAR_IN, MARGINS_IN, TILE_TITLE_IN = 4.4, 0.17, 1.0, 0.22
SATURATION_IN, WIDTH_IN, HEIGHT_IN, DEPTHS_IN = 2.8, 9.0, 2.9, 3.2
BINS, COUNTS_TICKS = 40, 5
MIN_BARS = 4  # smallest range of saturated taxels of a pair
MIN_PERCENT = 0.001  # smallest displayed force error
MAX_FAMILIES = 24  # in the chart of depths (assumed: space for their names)
SENSOR_COLORS = {"source": PALETTE[0], "target": PALETTE[3]}


def touched(array: ArrayInfo, counts: np.ndarray) -> np.ndarray:
    """(P,) bool: readings, (P, N), in which a taxel exceeds MIN_CONTACT_SHARE of full scale, and
    its readings at rest if their noise is known."""
    least = np.full(counts.shape[1], MIN_CONTACT_SHARE * array.full_scale_counts)
    flaws = array.imperfections
    if flaws is not None:
        mean, std = expected_reading(flaws, array.reading, np.zeros_like(least))
        std = np.hypot(std, flaws.drift_counts if flaws.drift_share else 0.0)
        least = np.maximum(least, mean + AT_REST_STDS * std + ROUNDING_COUNTS)
    return np.any(counts >= least, axis=1)


@dataclass(frozen=True)
class Dataset:
    """A dataset for a report."""

    data: Path  # its folder
    info: DatasetInfo
    arrays: dict[str, ArrayInfo]  # the taxel arrays by role, as the next two
    phis: dict[str, Phi]
    readings: dict[str, np.ndarray]  # (P, N) counts
    table: pd.DataFrame  # a row for each pair: "split", COLUMNS, contacts of the sensors

    @property
    def cameras(self) -> list[str]:
        """Roles of the gel cameras."""
        return [role for role in self.info.sensors if role not in self.arrays]

    def saturated(self, role: str) -> np.ndarray:
        """(P, N) bool: saturated counts; the mean of noisy, clipped ones is below full scale."""
        return self.readings[role] >= SATURATED_SHARE * self.arrays[role].full_scale_counts

    def label(self, role: str) -> str:
        """Displayed name of a sensor, with its role if both sensors have the same name."""
        names = [printable(sensor.name) for sensor in self.info.sensors.values()]
        name = printable(self.info.sensors[role].name)
        return f"{name} ({role})" if names[0] == names[1] else name

    @property
    def camera_name(self) -> str:
        """Displayed name of the first gel camera. Raises T2TwinError for a dataset without one."""
        return self.label(self.info.role_of(IMAGE))

    def column(self, name: str) -> np.ndarray:
        """(P,) a column, such as "shape"; missing numbers are NaN."""
        return self.table[name].to_numpy()

    def contact(self, role: str, name: str) -> np.ndarray:
        """(P,) a column of the contacts of a sensor."""
        return self.column(column(role, name))

    def pairs_of(self, split: str) -> np.ndarray:
        """Places in the table of the pairs of a split."""
        return np.flatnonzero(self.column("split") == split)

    @property
    def forces_n(self) -> np.ndarray:
        """(k,) unique commanded forces, N, ascending, rounded to 0.01 N; 0 without contact."""
        force_n = self.column("force_n").astype(float)
        return np.unique(force_n[np.isfinite(force_n)].round(2))

    @property
    def forces_text(self) -> str:
        """Forces as text: "8 N", "1, 2 and 8 N" or "0.52 to 11.9 N"."""
        touching = [f"{force:.3g}" for force in self.forces_n if force > 0]
        if len(touching) > MAX_LISTED_FORCES:
            return f"{touching[0]} to {touching[-1]} N"
        if len(touching) > 1:
            return f"{', '.join(touching[:-1])} and {touching[-1]} N"
        return f"{touching[0]} N" if touching else "none"

    @property
    def without_contact(self) -> np.ndarray:
        """(P,) bool: pairs in which no taxel is touched; without taxel arrays, of 0 N."""
        if not self.arrays:
            return self.column("force_n") == 0
        found = [touched(array, self.readings[role]) for role, array in self.arrays.items()]
        return ~np.any(found, axis=0)

    def image(self, place: int, role: str | None = None) -> np.ndarray:
        """The image of a pair, (R, C, 3) uint8. role: of the gel camera; None for the first."""
        name = column(role or self.info.role_of(IMAGE), IMAGE)
        split = self.table["split"].iloc[place]
        row = place - int(self.pairs_of(split)[0])
        for path in split_shards(self.info, split):
            pairs = self.info.shards[path].pairs
            if row < pairs:
                return decode_png(next(islice(iter_images(self.data, path, name), row, None)))
            row -= pairs
        raise AssertionError("the row is in a shard of its split")

    def sample_in_turn(self, name: str, number: int, seed: int = 0) -> list[int]:
        """Places of random pairs: one of each value of a column, then further ones of each."""
        shuffled = self.table.sample(frac=1.0, random_state=seed)
        turn = shuffled.groupby(name, sort=False, dropna=False).cumcount()
        return turn.sort_values(kind="stable").index[:number].tolist()


def read_dataset(data: Path) -> Dataset:
    """Reads a dataset. Raises T2TwinError as Phi, and if it is missing, unfinished or empty."""
    info = read_info(data)
    splits = [split for split in SPLITS if info.pairs[split]]
    if not splits:
        raise T2TwinError(f"the dataset in {data} has no pairs")
    names = [*COLUMNS, *(column(role, name) for role in info.sensors for name in CONTACT)]
    arrays = {role: cast(ArrayInfo, s) for role, s in info.sensors.items() if s.value == COUNTS}
    of_arrays = {role: column(role, COUNTS) for role in arrays}
    tables = [read_split(data, split, [*names, *of_arrays.values()]) for split in splits]
    frames = [
        table.select(names).to_pandas().assign(split=split)
        for split, table in zip(splits, tables, strict=True)
    ]
    readings = {
        role: np.concatenate([lists(table, name) for table in tables])
        for role, name in of_arrays.items()
    }
    phis = {role: array.phi for role, array in arrays.items()}
    return Dataset(data, info, arrays, phis, readings, pd.concat(frames, ignore_index=True))


def summary(dataset: Dataset) -> dict[str, Any]:
    """The facts of the dataset."""
    without_contact = dataset.without_contact
    least = f"no count exceeds the noise at rest and {100 * MIN_CONTACT_SHARE:g} % of full scale"
    files = sum((dataset.data / path).stat().st_size for path in dataset.info.shards)
    return {
        "pairs": dataset.table.groupby("split", sort=False).size().to_dict(),
        "shapes": dataset.table.groupby("split", sort=False)["shape"].nunique().to_dict(),
        "all_shapes": dataset.table["shape"].nunique(),
        "without_contact": int(without_contact.sum()),
        "contact": least if dataset.arrays else "commanded force of 0 N",
        "mib": files / 2**20,
        "pair_kb": files / without_contact.size / 1e3,
    }


def shapes(dataset: Dataset) -> dict[str, Any]:
    """Bar chart of the pairs per shape; of more than MAX_BARS shapes, per family."""
    number = dataset.table["shape"].nunique()
    kind = "shape" if number <= MAX_BARS else "family"
    counted = dataset.table.groupby(["split", kind], sort=False).size().reset_index(name="pairs")
    if len(counted) > MAX_BARS:
        counted = counted.sort_values("pairs", ascending=False, kind="stable", ignore_index=True)
    shown = counted[:MAX_BARS]

    def bars(page: Figure) -> None:
        axes = page.subplots()
        for split, own in shown.groupby("split", sort=False):
            look: Any = {"color": SPLIT_COLORS[str(split)], "label": SPLIT_NAMES[str(split)]}
            axes.barh(own.index, own["pairs"], 0.8, **look)
        axes.set_yticks(range(len(shown)), shown[kind].map(shape_name), fontsize=7.5)
        axes.set(xlabel="pairs", ylim=(len(shown) - 0.4, -0.6))
        axes.locator_params(axis="x", integer=True)
        page.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)

    height_in = MARGINS_IN + BAR_IN * len(shown)
    return {
        "shapes": number,
        "kind": kind,
        "hidden": len(counted) - len(shown),
        "chart": figure("svg", BARS_WIDTH_IN, height_in, bars),
    }


def grid_of(dataset: Dataset, role: str) -> bytes:
    """PNG of images of a gel camera: one of each shape, then further ones."""
    places = dataset.sample_in_turn("shape", MAX_IMAGES)
    lines = -(-len(places) // GALLERY_COLUMNS)
    rows_px, columns_px, _ = dataset.image(places[0], role).shape

    def draw(page: Figure) -> None:
        grid = page.subplots(lines, GALLERY_COLUMNS, squeeze=False)
        for axes in grid.flat:
            axes.set_axis_off()
        for axes, place in zip(grid.flat, places, strict=False):
            axes.imshow(dataset.image(place, role))
            axes.set_title(shape_name(dataset.column("shape")[place]), fontsize=6)

    height_in = WIDTH_IN / GALLERY_COLUMNS * rows_px / columns_px + TILE_TITLE_IN
    return figure("png", WIDTH_IN, height_in * lines, draw)


def pairs(dataset: Dataset) -> dict[str, Any]:
    """Rows and pictures of PAIRS pairs, of different families as far as possible."""
    found = []
    for place in dataset.sample_in_turn("family", PAIRS):
        panels, largest = [], {}
        for role in dataset.info.sensors:
            title = dataset.label(role)
            if role in dataset.cameras:
                panels.append(Panel(title, dataset.image(place, role)))
                continue
            phi, counts = dataset.phis[role], dataset.readings[role][place]
            scale = "counts" if len(dataset.arrays) == 1 else f"counts of {title}"
            panels.append(Panel(title, phi(counts), phi, dataset.arrays[role].taxels, scale))
            largest[title] = counts.max()
        row = dataset.table.iloc[place].to_dict()
        found.append((row, largest, panels_image(panels, PAIR_IN)))
    return {"pairs": found}


def saturation(page: Figure, dataset: Dataset, role: str) -> None:
    """Draws the largest counts, the saturated taxels of a pair, and where they are."""
    largest, number, places = page.subplots(1, 3)
    array, saturated = dataset.arrays[role], dataset.saturated(role)
    layout, bins = array.taxels, np.linspace(0, array.full_scale_counts, BINS + 1).tolist()
    largest.hist(dataset.readings[role].max(axis=1), bins, color=PALETTE[0])
    largest.set(xlabel="largest count of a pair", ylabel="pairs")
    largest.xaxis.set_major_formatter("{x:,g}")
    largest.locator_params(axis="x", nbins=4)
    times = np.bincount(saturated.sum(axis=1))
    number.bar(range(times.size), times, color=PALETTE[0])
    number.set(xlabel="saturated taxels of a pair", ylabel="pairs", yscale="log")
    number.set(xlim=(-0.6, max(times.size, MIN_BARS) - 0.4), ylim=(0.5, None))
    number.locator_params(axis="x", integer=True)
    percent = 100 * saturated.mean(axis=0)
    drawn = draw_discs(
        places, layout.x_mm, layout.y_mm, layout.pad_diameter_mm, array=percent,
        clim=(0.0, max(float(percent.max()), 1.0)), edgecolors="#444444", linewidths=0.4,
    )  # fmt: skip
    margin = layout.pad_diameter_mm.max()
    low, high = layout.x_mm.min() - margin, layout.x_mm.max() + margin
    places.set(aspect="equal", xlabel="x, mm", ylabel="y, mm", xlim=(low, high))
    places.set_ylim(layout.y_mm.max() + margin, layout.y_mm.min() - margin)
    page.colorbar(drawn, ax=places, label="saturated, % of the pairs")


def forces(dataset: Dataset) -> dict[str, Any] | None:
    """Ranges by sensor, histograms of forces and counts, depths by family; None for imported pairs,
    which have neither contact forces nor depths."""
    if dataset.info.recipe is None:
        return None
    commanded = dataset.column("force_n")
    contact = commanded > 0
    sensors = []
    for role in dataset.info.sensors:
        error = dataset.contact(role, "force_n")[contact] / commanded[contact] - 1.0
        percent = max(100 * np.abs(error).max(initial=0.0), MIN_PERCENT)
        sensors.append(
            {
                "name": dataset.label(role),
                "error_percent": f"{percent:.2g}",
                "not_converged": int((~dataset.contact(role, "settled").astype(bool)).sum()),
                "bottomed": int(dataset.contact(role, "bottomed").sum()),
                "depth": _range(dataset.contact(role, "depth_mm")[contact], "mm"),
            }
        )
    return {
        "commanded": _range(commanded[contact], "N"),
        "without_contact": int((~contact).sum()),
        "sensors": sensors,
        "charts": [
            figure("svg", WIDTH_IN, height_in, partial(draw, dataset=dataset))
            for draw, height_in in ((forces_and_counts, HEIGHT_IN), (depths_in, DEPTHS_IN))
        ],
    }


def _range(values: np.ndarray, unit: str) -> str:
    low, high = f"{values.min():.2f}", f"{values.max():.2f}"
    return f"{low} {unit}" if low == high else f"{low} to {high} {unit}"


def forces_and_counts(page: Figure, dataset: Dataset) -> None:
    """Draws histograms of the force errors of both sensors, and of the counts of each array."""
    left, *others = page.subplots(1, 1 + len(dataset.arrays), squeeze=False)[0]
    commanded, roles = dataset.column("force_n"), dataset.info.sensors
    errors = {role: 1e3 * (dataset.contact(role, "force_n") - commanded) for role in roles}
    limit = max(float(np.abs(values).max()) for values in errors.values()) or 1.0
    bins = np.linspace(-limit, limit, BINS + 1).tolist()
    for role, values in errors.items():
        label = dataset.label(role)
        left.hist(values, bins, color=SENSOR_COLORS[role], alpha=0.65, label=label)
    left.axvline(0.0, color="#222222", linewidth=0.8)
    left.set(xlabel=f"contact force − commanded ({dataset.forces_text}), mN", ylabel="pairs")
    left.locator_params(axis="x", nbins=6)
    left.legend()
    for axes, (role, array) in zip(others, dataset.arrays.items(), strict=True):
        bins = np.linspace(0.0, array.full_scale_counts, BINS + 1).tolist()
        for split in dataset.table["split"].unique():
            counts = dataset.readings[role][dataset.pairs_of(split)].ravel()
            look: Any = {"color": SPLIT_COLORS[split], "label": SPLIT_NAMES[split]}
            weights = np.full(counts.size, 100.0 / counts.size)
            axes.hist(counts, bins, weights=weights, histtype="step", **look)
        axes.set(xlabel=f"counts of {dataset.label(role)}", ylabel="% of the split's counts")
        axes.set_yscale("log")
        axes.xaxis.set_major_locator(MaxNLocator(COUNTS_TICKS))
        axes.xaxis.set_major_formatter("{x:,g}")
        axes.legend()


def depths_in(page: Figure, dataset: Dataset) -> None:
    """Draws boxes of the depths by family; of many families those with the most pairs."""
    table = dataset.table[dataset.column("force_n") > 0]
    numbers = table.groupby("family", sort=False).size()
    if len(numbers) > MAX_FAMILIES:
        numbers = numbers.sort_values(ascending=False, kind="stable")[:MAX_FAMILIES]
    names, axes = [str(name) for name in numbers.index], page.subplots()
    for place, (role, color) in enumerate(SENSOR_COLORS.items()):
        boxes = axes.boxplot(
            [table[f"{role}_depth_mm"][table["family"] == name].to_numpy() for name in names],
            positions=(np.arange(len(names)) + 0.36 * (place - 0.5)).tolist(),
            widths=0.28, whis=(0, 100), patch_artist=True,
            boxprops={"facecolor": color, "alpha": 0.65, "linewidth": 0.6},
            medianprops={"color": "#111111", "linewidth": 1.0},
            whiskerprops={"linewidth": 0.7}, capprops={"linewidth": 0.7},
        )  # fmt: skip
        boxes["boxes"][0].set_label(dataset.label(role))
    axes.set_xticks(range(len(names)), [name.replace("-", "-\n") for name in names])
    axes.set(ylabel="depth, mm", ylim=(0, None))
    axes.legend()


TEMPLATES = ("report/templates/dataset.html",)


def gallery(dataset: Dataset) -> dict[str, Any] | None:
    """Grid of images of all shapes for each gel camera; None without one."""
    grids = {role: grid_of(dataset, role) for role in dataset.cameras}
    return {"grids": grids} if grids else None


def saturations(dataset: Dataset) -> dict[str, Any] | None:
    """Chart of the saturated counts of each taxel array, by pair and by taxel; None without one."""
    charts = {}
    for role in dataset.arrays:
        draw = partial(saturation, dataset=dataset, role=role)
        charts[role] = figure("svg", WIDTH_IN, SATURATION_IN, draw)
    return {"charts": charts} if charts else None


SECTIONS = {
    "summary": ("", summary),
    "shapes": ("Pairs by shape", shapes),
    "gallery": ("Images", gallery),
    "pairs": ("Pairs", pairs),
    "forces": ("Forces and depths", forces),
    "saturation": ("Saturation", saturations),
}
"""Title of the link to each section, and its values."""


def write_data_report(out: str | Path, data: str | Path) -> Path:
    """Writes out/index.html, a self-contained page, and returns its path.

    data: a finished dataset, simulated or imported. Raises T2TwinError, before anything is written,
    if the dataset or the folder cannot be used.
    """
    out, data = arguments.path(out, "out"), arguments.path(data, "data")
    check_out(out)
    dataset = read_dataset(data)
    sections = {name: (link, partial(values, dataset)) for name, (link, values) in SECTIONS.items()}
    return write_page(out, f"The dataset in {data}", TEMPLATES, sections, dataset=dataset)
