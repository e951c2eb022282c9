"""A finished dataset in figures and pictures: is it whole, sane, small and quickly made?

    t2twin simdata --scale paper --out data/paper
    t2twin simdata --scale small --workers 1 --out data/one
    t2twin simdata --scale small --workers 2 --out data/two
    python -m benchmarks.dataset data/paper --rates data/one data/two

Writes benchmarks/results/dataset.json and docs/pictures/dataset_*.png from the dataset's shards and
its log. Exits with 1 where a limit is missed.
"""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from t2twin.report import contents, forces, oddities
from t2twin.report.figures import figure
from t2twin.report.material import Dataset, gather_dataset
from t2twin.report.scan import scan
from t2twin.sim.dataset.store import LOG

RESULT = Path(__file__).parent / "results" / "dataset.json"
PICTURES = Path("docs/pictures")

LIMITS = {
    "minutes": 15.0,
    "peak_memory_gib": 4.0,
    "size_gib": 1.5,
    "near_duplicates_percent": 2.0,
}
"""At most, for the paper's dataset on two cores."""

LEAST_SPEED_UP = 1.8
"""Of two workers over one."""

RATES = ("one_worker", "two_workers", "two_workers_over_one")
"""Figures of --rates."""

SENSORS = ("digit", "cyskin")


def measure(dataset: Dataset) -> dict[str, Any]:
    """What a dataset's shards and log say."""
    looked = scan(dataset, oddities.noise_grey(dataset))
    counts, saturated = dataset.counts, dataset.saturated
    largest = counts.max(axis=1)
    split = np.array([split for split, _ in dataset.places])
    size = sum((dataset.data / path).stat().st_size for path in dataset.info["shards"])
    force = dataset.column("force_n")
    alike, duplicates = np.isfinite(looked.alike_counts), oddities.near_duplicates(dataset, looked)
    return {
        "pairs": {name: len(table) for name, table in dataset.tables.items()},
        "versions": dataset.info["versions"],
        "run": _last_run(dataset.data),
        "size_gib": size / 2**30,
        "kb_a_pair": size / len(counts) / 1e3,
        "pairs_without_contact": int((largest < contents.TOUCHED_COUNTS).sum()),
        "unsettled": int(sum((~dataset.column(f"{s}_settled")).sum() for s in SENSORS)),
        "bottomed": int(sum(dataset.column(f"{s}_bottomed").sum() for s in SENSORS)),
        "force_off_percent": {
            s: 100 * float(np.abs(dataset.column(f"{s}_force_n") / force - 1).max())
            for s in SENSORS
        },
        "depth_mm": {
            s: [float(of(dataset.column(f"{s}_depth_mm"))) for of in (np.min, np.median, np.max)]
            for s in SENSORS
        },
        "largest_taxel_percentile_99_5": float(np.percentile(largest[split == "train"], 99.5)),
        "saturated_taxels_percent": 100 * float(saturated.mean()),
        "pairs_with_a_saturated_taxel_percent": 100 * float(saturated.any(axis=1).mean()),
        "near_duplicates_percent": 100 * float(duplicates.mean()),
        "alike_but_felt_otherwise_percent": 100 * float((alike & ~duplicates).mean()),
    }


def _last_run(folder: Path) -> dict[str, Any]:
    """Of a dataset made in one run, how long it took and on what."""
    runs = [json.loads(line) for line in (folder / LOG).read_text().splitlines()]
    run = runs[-1]
    stages = run["stage_seconds"]
    return {
        "runs": len(runs),
        "pairs": run["pairs"],
        "workers": run["workers"],
        "minutes": run["seconds"] / 60,
        "pairs_a_second": run["pairs"] / run["seconds"],
        "processor_ms_a_pair": {k: 1e3 * v / run["pairs"] for k, v in stages.items()},
        "peak_memory_gib": run["peak_memory_bytes"] / 2**30,
    }


def draw(dataset: Dataset) -> None:
    """The pictures of a dataset."""
    rows = contents.gallery(dataset)
    lines = -(-len(rows) // contents.GALLERY_COLUMNS)
    drawings: dict[str, tuple[float, Callable[[Figure], None]]] = {
        "forces_and_counts": (
            forces.HEIGHT_IN,
            lambda page: forces.forces_and_counts(page, dataset),
        ),
        "depths": (forces.DEPTHS_IN, lambda page: forces.depths_in(page, dataset)),
        "saturation": (contents.SATURATION_IN, lambda page: contents.saturation(page, dataset)),
        "gallery": (contents.TILE_IN * lines, lambda page: contents.tiles(page, dataset, rows)),
    }
    for name, (height_in, drawing) in drawings.items():
        content = figure("png", contents.WIDTH_IN, height_in, drawing)
        (PICTURES / f"dataset_{name}.png").write_bytes(content)


def misses(found: dict[str, Any]) -> list[str]:
    """The limits that are missed, a sentence each."""
    flat = found | found["run"]
    missed = [f"{k}: {flat[k]:.3g}, at most {v:g}" for k, v in LIMITS.items() if flat[k] > v]
    if found.get("two_workers_over_one", np.inf) < LEAST_SPEED_UP:
        missed.append(
            f"two workers over one: {found['two_workers_over_one']:.2f}, at least {LEAST_SPEED_UP}"
        )
    return missed


def main() -> None:
    parser = argparse.ArgumentParser(description="A finished dataset in figures and pictures")
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--rates",
        nargs=2,
        type=Path,
        metavar=("ONE", "TWO"),
        help="one dataset made twice in a row, with one worker and with two; what the results "
        "hold of these stays unless given",
    )
    options = parser.parse_args()
    dataset = gather_dataset(options.folder)
    found = {"command": f"python -m benchmarks.dataset {options.folder}"} | measure(dataset)
    earlier = json.loads(RESULT.read_text()) if RESULT.is_file() else {}
    found |= {name: earlier[name] for name in RATES if name in earlier}
    if options.rates is not None:
        one, two = (_last_run(folder) for folder in options.rates)
        found |= zip(RATES, (one, two, two["pairs_a_second"] / one["pairs_a_second"]), strict=True)
    RESULT.write_text(json.dumps(found, indent=1) + "\n")
    draw(dataset)
    print(json.dumps(found, indent=1))
    missed = misses(found)
    if missed:
        sys.exit("; ".join(missed))


if __name__ == "__main__":
    main()
