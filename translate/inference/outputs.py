"""The output files of a translation of image files: counts.csv, counts.json, PNG files.

Shape letters: B images, N taxels.
"""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.translate.inference.predictor import CountsPredictor
from t2twin.translate.uncertainty.estimate import Estimate
from t2twin.translate.uncertainty.ood import OODClass

COUNTS_CSV, COUNTS_JSON = "counts.csv", "counts.json"
COUNTS_STD_CSV = "counts_std.csv"


@dataclass(frozen=True)
class TranslationResult:
    """Predictions for B images, in the order of `find_images`.

    counts: (B, N) float32. ood_classes: (B,) results of out-of-distribution detection. estimate:
    the predictions of a field run with uncertainty, None for other runs.
    """

    counts: np.ndarray
    ood_classes: list[OODClass]
    estimate: Estimate | None = None


def write_tables(
    folder: Path,
    run: CountsPredictor,
    images: list[Path],
    names: list[str],
    result: TranslationResult,
    background: Path | None,
) -> list[str]:
    """Writes counts.csv and counts.json, and counts_std.csv for a field run. Returns their names.

    names: of the PNG files, or empty. background: file of the background frame, or None.
    """
    rounded = np.rint(result.counts).astype(int)
    _write_csv(folder / COUNTS_CSV, images, rounded, result.ood_classes)
    written = [COUNTS_CSV, COUNTS_JSON]
    if result.estimate is not None:
        stds = np.ceil(result.estimate.counts_std).astype(int)
        _write_csv(folder / COUNTS_STD_CSV, images, stds)
        written.append(COUNTS_STD_CSV)
    head = _head(run) | ({} if background is None else {"background": str(background)})
    entries = [
        _entry(result, number, str(image), names[number] if names else None)
        for number, image in enumerate(images)
    ]
    _write_json(folder / COUNTS_JSON, head, entries)
    return written


def earlier_files(out_dir: Path) -> set[Path]:
    """PNG files and counts_std.csv of an earlier translation, as listed in its counts.json."""
    path = out_dir / COUNTS_JSON
    if not path.is_file():  # reading a pipe would block
        return set()
    try:
        images = json.loads(path.read_text())["images"]
        names = {str(entry.get("tactile_image", "")) for entry in images}
        has_std = any("counts_std" in entry for entry in images)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return set()
    own = {name for name in names if name.endswith(".png") and Path(name).name == name}
    own |= {COUNTS_STD_CSV} if has_std else set()
    return {out_dir.resolve() / name for name in own}


def _write_csv(
    path: Path, images: list[Path], counts: np.ndarray, classes: list[OODClass] | None = None
) -> None:
    """Without classes, the file has no column of them."""
    taxels = [f"taxel_{n}" for n in range(counts.shape[1])]
    last = [[]] * len(images) if classes is None else [[str(each)] for each in classes]
    # File names that are not valid text are escaped.
    with path.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
        writer = csv.writer(file)
        writer.writerow(["image", *taxels, *([] if classes is None else ["ood_class"])])
        for image, row, of_image in zip(images, counts, last, strict=True):
            writer.writerow([str(image), *row.tolist(), *of_image])


def _head(run: CountsPredictor) -> dict[str, Any]:
    info = run.config.data
    return {
        "model": run.config.model,
        "preset": run.config.preset.name,
        "layout": info.layout,
        "layout_x_mm": info.x_mm.tolist(),
        "layout_y_mm": info.y_mm.tolist(),
        "full_scale_counts": info.full_scale_counts,
    }


def _entry(result: TranslationResult, number: int, image: str, name: str | None) -> dict[str, Any]:
    entry: dict[str, Any] = {"image": image}
    if name is not None:
        entry["tactile_image"] = name
    entry["counts"] = np.rint(result.counts[number]).astype(int).tolist()
    estimate, ood_class = result.estimate, result.ood_classes[number]
    if estimate is not None:
        entry["counts_std"] = np.ceil(estimate.counts_std[number]).astype(int).tolist()
        if estimate.force_n is not None and estimate.force_std_n is not None:
            entry["force_n"] = round(float(estimate.force_n[number]), 3)
            entry["force_std_n"] = round(float(estimate.force_std_n[number]), 3)
        if estimate.shear_n is not None and estimate.shear_std_n is not None:
            entry["shear_n"] = [round(n, 3) for n in estimate.shear_n[number].tolist()]
            entry["shear_std_n"] = [round(n, 3) for n in estimate.shear_std_n[number].tolist()]
    return entry | ood_entry(ood_class)


def ood_entry(ood_class: OODClass) -> dict[str, Any]:
    """The JSON keys of an image's class: in_distribution, and ood_class if it is false."""
    if ood_class == OODClass.IN_DISTRIBUTION:
        return {"in_distribution": True}
    return {"in_distribution": False, "ood_class": str(ood_class)}


def _write_json(path: Path, head: dict[str, Any], entries: list[dict[str, Any]]) -> None:
    """Writes one line per image, so that large files stay readable by line."""
    with path.open("w") as file:
        file.write("{\n")
        for key, value in head.items():
            file.write(f"  {json.dumps(key)}: {json.dumps(value)},\n")
        file.write('  "images": [')
        for number, entry in enumerate(entries):
            file.write(("," if number else "") + "\n    " + json.dumps(entry))
        file.write("\n  ]\n}\n")


def output_names(images: Sequence[Path]) -> list[str]:
    """One PNG file name per input, all different even without case."""
    names: list[str] = []
    taken: set[str] = set()
    last: dict[str, int] = {}
    for path in images:
        stem, number = path.stem, last.get(path.stem.lower(), 1)
        name = f"{stem}.png" if number == 1 else f"{stem}-{number}.png"
        while name.lower() in taken:
            number += 1
            name = f"{stem}-{number}.png"
        last[stem.lower()] = number
        taken.add(name.lower())
        names.append(name)
    return names
