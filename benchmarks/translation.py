"""Trained translators in figures and in the paper's picture, from the folder of `t2twin report`.

    python -m benchmarks.translation data/paper RUN... --report runs/paper/report
                                     [--layouts EVALUATION...]

Writes benchmarks/results/translation.json: what evaluation found of every row, overall with its
interval and by shape, and overall on the taxel layouts of other folders of `t2twin evaluate`; and
docs/pictures/samples.png: the report's samples at some of its quantiles of the error, from good to
bad, so that nobody picks them.
"""

import argparse
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.primitives_cad.writing import whole_file
from t2twin.report.material import ReportData, gather
from t2twin.report.qualitative import chosen, row_picture
from t2twin.translate.evaluation.evaluate import MEAN_ARRAY, METRICS, NEAREST_NEIGHBOUR

RESULTS = Path(__file__).parent / "results" / "translation.json"
PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "samples.png"

SHOWN = {"val": (0.5, 1.0), "test": (0.1, 0.5, 0.9, 1.0)}
"""Quantiles of each split's error; the report has more."""

MOST_OF_MEAN_ARRAY = 0.25
"""Largest error on validation, in parts of the mean array's."""

MOST_OF_BEST_TRIVIAL = 0.75
"""Largest error on the objects, in parts of the better of mean array and nearest neighbour."""


def measure(material: ReportData) -> dict[str, Any]:
    """Epochs and minutes of each run, and the figures of every row by split."""
    return {
        "runs": {
            name: {
                "preset": run.config.preset.name,
                "epochs": len(material.histories[name]),
                "minutes": sum(each["seconds"] for each in material.histories[name]) / 60.0,
            }
            for name, run in material.runs.items()
        },
        **{
            split: {
                name: {key: row[key] for key in ("overall", "interval", "by_shape")}
                for name, row in evaluated.metrics["models"].items()
            }
            for split, evaluated in material.evaluated.items()
        },
        "lookalikes": {
            split: evaluated.metrics["lookalikes"]
            for split, evaluated in material.evaluated.items()
        },
    }


def on_layout(evaluation: Path) -> dict[str, Any]:
    """Figures of every row, overall, by split, from a folder of `t2twin evaluate`."""
    metrics = {s: json.loads((evaluation / s / METRICS).read_text()) for s in SHOWN}
    return {"layout": metrics["val"]["layout"]} | {
        split: {name: row["overall"] for name, row in each["models"].items()}
        for split, each in metrics.items()
    }


def misses(found: dict[str, Any]) -> list[str]:
    """The limits that are missed, a sentence each."""
    errors = {
        split: {name: row["overall"]["rmse_percent"] for name, row in found[split].items()}
        for split in SHOWN
    }
    val, test = errors["val"], errors["test"]
    limits = {
        "val": min(MOST_OF_MEAN_ARRAY * val[MEAN_ARRAY], val[NEAREST_NEIGHBOUR]),
        "test": MOST_OF_BEST_TRIVIAL * min(test[MEAN_ARRAY], test[NEAREST_NEIGHBOUR]),
    }
    return [
        f"{name} on {split}: {errors[split][name]:.2f} %, at most {limit:.2f}"
        for split, limit in limits.items()
        for name in found["runs"]
        if errors[split][name] > limit
    ]


def draw(material: ReportData) -> None:
    """The samples, one below another."""
    rows = []
    for split, quantiles in SHOWN.items():
        for row, quantile in chosen(material, split):
            if quantile in quantiles:
                with Image.open(io.BytesIO(row_picture(material, split, row))) as picture:
                    rows.append(np.asarray(picture.convert("RGB")))
    Image.fromarray(np.concatenate(rows)).save(PICTURE, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Trained translators in figures and a picture")
    parser.add_argument("data", type=Path)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--report", type=Path, required=True, help="the report's folder")
    parser.add_argument("--layouts", nargs="*", type=Path, default=[], help="evaluations on others")
    options = parser.parse_args()
    material = gather(options.report, options.data, options.runs)
    runs = " ".join(map(str, options.runs))
    command = f"python -m benchmarks.translation {options.data} {runs} --report {options.report}"
    if options.layouts:
        command += " --layouts " + " ".join(map(str, options.layouts))
    found = {"command": command} | measure(material)
    found["layouts"] = [on_layout(evaluation) for evaluation in options.layouts]
    with whole_file(RESULTS) as temporary:
        temporary.write_text(json.dumps(found, indent=1) + "\n")
    draw(material)
    missed = misses(found)
    if missed:
        sys.exit("; ".join(missed))


if __name__ == "__main__":
    main()
