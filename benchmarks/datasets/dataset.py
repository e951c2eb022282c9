"""Content, size and generation rate of a dataset.

    t2twin simdata --scale paper --out data/paper
    python -m benchmarks dataset data/paper

The figures come from the dataset's shards and log, and docs/pictures/dataset_*.png are drawn from
them.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.distance import cdist
from skimage.measure import block_reduce

from benchmarks import ROOT
from benchmarks.evidence import Argument, Benchmark, Figure
from t2twin.core.files import atomic_write
from t2twin.core.records import decode_json
from t2twin.sim.dataset.store import LOG
from t2twin.sim.sensors.defaults import ROLES

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Page

    from t2twin.report.dataset_report import Dataset

BENCHMARK = Benchmark(
    module="benchmarks.datasets.dataset",
    minutes=2,
    sources=("primitives_cad", "sim", "t2twin/report"),
    figures=(
        Figure("run.minutes", "minutes", most=15.0),
        Figure("run.pairs_a_second", "pairs/s"),
        Figure("run.peak_memory_gib", "GiB", most=4.0),
        Figure("size_gib", "GiB", most=1.5),
        Figure("near_duplicates_percent", "%", most=2.0),
        Figure("alike_but_felt_otherwise_percent", "%"),
        Figure("pairs_without_contact"),
        Figure("unsettled"),
    ),
    arguments=(Argument("folder", "the dataset", Path),),
)

PICTURES = ROOT / "docs" / "pictures"
BLOCK: Any = (8, 8, 1)
"""Shape of the blocks over which images are averaged: reduces the noise to an eighth."""

SAME_READINGS, SAME_SHARE = 1.5, 0.0005
"""Largest difference of two readings of one press, relative to its RMS, and the least, of full
scale (assumed)."""

SENSORS = {"digit": "source", "cyskin": "target"}
"""Roles of the sensors by their names in the results."""


def measure(options: Namespace) -> dict[str, Any]:
    from t2twin.report.dataset_report import read_dataset

    dataset = read_dataset(options.folder)
    if not options.keep_nothing:
        draw(dataset)
    return figures(dataset) | {"run": _last_run(dataset.data)}


def figures(dataset: Dataset) -> dict[str, Any]:
    """What a dataset's shards say."""
    (counts,), saturated = dataset.readings.values(), dataset.saturated(ROLES[1])
    size = sum((dataset.data / path).stat().st_size for path in dataset.info.shards)
    alike, same = _near_duplicates(dataset)
    return {
        "pairs": dataset.table.groupby("split", sort=False).size().to_dict(),
        "size_gib": size / 2**30,
        "kb_a_pair": size / len(counts) / 1e3,
        "pairs_without_contact": int(dataset.without_contact.sum()),
        "unsettled": int(sum((~dataset.contact(r, "settled")).sum() for r in ROLES)),
        "depth_mm": {
            name: [
                float(of(dataset.contact(role, "depth_mm"))) for of in (np.min, np.median, np.max)
            ]
            for name, role in SENSORS.items()
        },
        "pairs_with_a_saturated_taxel_percent": 100 * float(saturated.any(axis=1).mean()),
        "near_duplicates_percent": 100 * float(same.mean()),
        "alike_but_felt_otherwise_percent": 100 * float((alike & ~same).mean()),
    }


def _near_duplicates(dataset: Dataset) -> tuple[np.ndarray, np.ndarray]:
    """(P,) whether the image differs from another of its shape by less than the noise, averaged
    over blocks, and whether the counts of such a pair do so too."""
    from t2twin.sim.taxels.reading import expected_reading

    array, noise_grey = dataset.info.array, dataset.info.camera.noise_grey
    (counts,), shapes = dataset.readings.values(), dataset.column("shape")
    assert noise_grey is not None and array.imperfections is not None
    _, noise = expected_reading(array.imperfections, array.reading, counts)
    same_counts = SAME_READINGS * np.sqrt(2.0 * np.square(noise).mean(axis=1))
    same_counts = np.maximum(same_counts, SAME_SHARE * array.full_scale_counts)
    alike, same = np.zeros((2, len(shapes)), bool)
    for shape in np.unique(shapes):
        at = np.flatnonzero(shapes == shape)
        images = (dataset.image(place) for place in at.tolist())
        coarse = np.array([block_reduce(each, BLOCK, np.mean) for each in images])
        near = _distances(coarse) < noise_grey
        alike[at] = near.any(axis=1)
        same[at] = (near & (_distances(counts[at]) < same_counts[at, None])).any(axis=1)
    return alike, same


def _distances(values: np.ndarray) -> np.ndarray:
    """RMS differences of all rows, (n, n), infinite to themselves."""
    rows = values.reshape(len(values), -1).astype(float)
    distances = cdist(rows, rows) / np.sqrt(rows.shape[1])
    np.fill_diagonal(distances, np.inf)
    return distances


def _last_run(folder: Path) -> dict[str, Any]:
    """Of a dataset made in one run, how long it took and on what."""
    lines = (folder / LOG).read_text().splitlines()
    run = decode_json(lines[-1], dict, folder / LOG)
    return {
        "workers": run["workers"],
        "minutes": run["seconds"] / 60,
        "pairs_a_second": run["pairs"] / run["seconds"],
        "all_processor_ms_a_pair": 1e3 * run["processor_seconds"] / run["pairs"],
        "peak_memory_gib": run["peak_memory_bytes"] / 2**30,
    }


def draw(dataset: Dataset) -> None:
    """The pictures of a dataset."""
    from t2twin.core.draw import figure
    from t2twin.report import dataset_report as report

    drawings: dict[str, tuple[float, Callable[[Page], None]]] = {
        "forces_and_counts": (
            report.HEIGHT_IN,
            lambda page: report.forces_and_counts(page, dataset),
        ),
        "depths": (report.DEPTHS_IN, lambda page: report.depths_in(page, dataset)),
        "saturation": (
            report.SATURATION_IN,
            lambda page: report.saturation(page, dataset, ROLES[1]),
        ),
    }
    for name, (height_in, drawing) in drawings.items():
        _write(name, figure("png", report.WIDTH_IN, height_in, drawing))
    _write("gallery", report.grid_of(dataset, SENSORS["digit"]))


def _write(name: str, content: bytes) -> None:
    with atomic_write(PICTURES / f"dataset_{name}.png") as temporary:
        temporary.write_bytes(content)
