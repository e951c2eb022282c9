"""The paper's qualitative figure: `python -m benchmarks.samples DATA RUN... --report REPORT` writes
docs/pictures/samples.png.

The report's samples at some of its quantiles of the error, from good to bad, so that nobody picks
them. REPORT is the folder of `t2twin report` on the same data and runs, whose evaluation is used.
"""

import argparse
import io
from pathlib import Path

import numpy as np
from PIL import Image

from translate.report.material import gather
from translate.report.qualitative import chosen, row_picture

PICTURE = Path(__file__).parents[1] / "docs" / "pictures" / "samples.png"

SHOWN = {"val": (0.5, 1.0), "test": (0.1, 0.5, 0.9, 1.0)}
"""Quantiles of each split's error; the report has more."""


def main() -> None:
    parser = argparse.ArgumentParser(description="Samples of two translators, from good to bad")
    parser.add_argument("data", type=Path)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--report", type=Path, required=True, help="the report's folder")
    options = parser.parse_args()
    material = gather(options.report, options.data, options.runs)
    rows = []
    for split, quantiles in SHOWN.items():
        for row, quantile in chosen(material, split):
            if quantile in quantiles:
                shape = material.tables[split]["shape"][row].as_py()
                print(f"{split}, quantile {quantile:g}: {shape}")
                with Image.open(io.BytesIO(row_picture(material, split, row))) as picture:
                    rows.append(np.asarray(picture.convert("RGB")))
    Image.fromarray(np.concatenate(rows)).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
