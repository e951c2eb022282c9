"""What a translation of image files leaves in its folder: counts.csv, counts.json, pictures.

Shape letters: B images, N taxels.
"""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.uncertainty.estimate import Estimate

COUNTS_CSV, COUNTS_JSON = "counts.csv", "counts.json"
COUNTS_STD_CSV = "counts_std.csv"


@dataclass(frozen=True)
class TranslationResult:
    """What became of B images, in the order of `find_images`.

    counts: (B, N) float32. looks: (B,) in words how each is unlike the pictures that the run was
    trained on, nothing where it is like them. estimate: what a field run says of them besides.
    """

    counts: np.ndarray
    looks: list[str]
    estimate: Estimate | None = None


def write_tables(
    folder: Path,
    run: TrainedTranslator,
    images: list[Path],
    names: list[str],
    translated: TranslationResult,
    untouched: Path | None,
) -> list[str]:
    """Writes counts.csv and counts.json, and counts_std.csv of a field run. Returns their names.

    names: the pictures', or none. untouched: the file of the untouched frame, if one was given.
    """
    rounded = np.rint(translated.counts).astype(int)
    _write_csv(folder / COUNTS_CSV, images, rounded)
    written = [COUNTS_CSV, COUNTS_JSON]
    if translated.estimate is not None:
        stds = np.ceil(translated.estimate.counts_std).astype(int)
        _write_csv(folder / COUNTS_STD_CSV, images, stds)
        written.append(COUNTS_STD_CSV)
    head = _head(run) | ({} if untouched is None else {"untouched": str(untouched)})
    entries = [
        _entry(translated, number, str(image), names[number] if names else None)
        for number, image in enumerate(images)
    ]
    _write_json(folder / COUNTS_JSON, head, entries)
    return written


def earlier_files(out_dir: Path) -> set[Path]:
    """What an earlier call says it left in a folder besides its counts: pictures, and standard
    deviations; nothing where nothing says so."""
    path = out_dir / COUNTS_JSON
    if not path.is_file():  # a pipe would be waited for
        return set()
    try:
        images = json.loads(path.read_text())["images"]
        names = {str(entry.get("tactile_image", "")) for entry in images}
        said = any("counts_std" in entry for entry in images)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return set()
    own = {name for name in names if name.endswith(".png") and Path(name).name == name}
    own |= {COUNTS_STD_CSV} if said else set()
    return {out_dir.resolve() / name for name in own}


def _write_csv(path: Path, images: list[Path], counts: np.ndarray) -> None:
    # Names of files may be no text; then what is not is escaped.
    with path.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
        writer = csv.writer(file)
        writer.writerow(["image", *(f"taxel_{n}" for n in range(counts.shape[1]))])
        for image, row in zip(images, counts, strict=True):
            writer.writerow([str(image), *row.tolist()])


def _head(run: TrainedTranslator) -> dict[str, Any]:
    info = run.config.data
    return {
        "model": run.config.model,
        "preset": run.config.preset.name,
        "layout": info.layout,
        "layout_x_mm": info.x_mm.tolist(),
        "layout_y_mm": info.y_mm.tolist(),
        "full_scale_counts": info.full_scale_counts,
    }


def _entry(
    translated: TranslationResult, number: int, image: str, name: str | None
) -> dict[str, Any]:
    entry: dict[str, Any] = {"image": image}
    if name is not None:
        entry["tactile_image"] = name
    entry["counts"] = np.rint(translated.counts[number]).astype(int).tolist()
    told, looks = translated.estimate, translated.looks[number]
    if told is not None:
        entry["counts_std"] = np.ceil(told.counts_std[number]).astype(int).tolist()
        if told.force_n is not None and told.force_std_n is not None:
            entry["force_n"] = round(float(told.force_n[number]), 3)
            entry["force_std_n"] = round(float(told.force_std_n[number]), 3)
    entry["like_training"] = not looks
    if looks:
        entry["looks"] = looks
    return entry


def _write_json(path: Path, head: dict[str, Any], entries: list[dict[str, Any]]) -> None:
    """One line an image, so that ten thousand can still be read by eye and by line."""
    with path.open("w") as file:
        file.write("{\n")
        for key, value in head.items():
            file.write(f"  {json.dumps(key)}: {json.dumps(value)},\n")
        file.write('  "images": [')
        for number, entry in enumerate(entries):
            file.write(("," if number else "") + "\n    " + json.dumps(entry))
        file.write("\n  ]\n}\n")


def output_names(images: Sequence[Path]) -> list[str]:
    """One PNG name an input, all different, whatever the case of the letters."""
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
