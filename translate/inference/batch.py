"""Translation of image files: counts.csv, counts.json and tactile images for thousands of files.

Threads read, decode and write files while the network computes; a few batches are in memory at a
time. Outputs are written to a temporary folder and moved at the end, so that errors and
interruptions leave no partial output.

Shape letters: B images, N taxels, S image side of the run, c channels.
"""

import json
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.core import arguments
from t2twin.core.draw import colored_tactile_image
from t2twin.core.errors import T2TwinError
from t2twin.core.files import locked, move_into, temporary_folder, write_csv
from t2twin.core.images import SUFFIXES
from t2twin.core.progress import Progress
from t2twin.translate.data.images import check_image, open_image, to_pixels
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import BATCH_SIZE, CountsPredictor, require
from t2twin.translate.runs.config import DEFAULT_RUN, RunConfig
from t2twin.translate.uncertainty.estimate import Estimate, concatenate
from t2twin.translate.uncertainty.ood import OODClass, classify_frame, combined

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
    # names that are not valid text are escaped
    files = [str(image).encode(errors="backslashreplace").decode() for image in images]
    columns = ["image", *(f"taxel_{n}" for n in range(result.counts.shape[1]))]
    counts = np.rint(result.counts).astype(int).tolist()
    rows = zip(files, counts, map(str, result.ood_classes), strict=True)
    lines = [[file, *row, ood_class] for file, row, ood_class in rows]
    write_csv(folder / COUNTS_CSV, [*columns, "ood_class"], lines)
    written = [COUNTS_CSV, COUNTS_JSON]
    if result.estimate is not None:
        stds = np.ceil(result.estimate.counts_std).astype(int).tolist()
        lines = [[file, *row] for file, row in zip(files, stds, strict=True)]
        write_csv(folder / COUNTS_STD_CSV, columns, lines)
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


def _head(run: CountsPredictor) -> dict[str, Any]:
    info = run.config.data.array
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
        for name in ("force_n", "force_std_n", "shear_n", "shear_std_n"):
            if (value := getattr(estimate, name)) is not None:
                entry[name] = value[number].astype(float).round(3).tolist()
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


READ_AHEAD = 2
"""Batches that are read before they are needed."""


def find_images(paths: Sequence[str | Path]) -> list[Path]:
    """The image files in a list of files and folders, in its order.

    From a folder: its PNG and JPEG files, sorted by name, without subfolders and hidden files.
    Raises T2TwinError for an empty list, and for a folder without images.
    """
    images: list[Path] = []
    for path in arguments.paths(paths, "paths"):
        if not path.is_dir():
            images.append(path)
            continue
        inside = sorted(
            file
            for file in path.iterdir()
            if file.suffix.lower() in SUFFIXES and not file.name.startswith(".")
        )
        if not inside:
            raise T2TwinError(
                f"the folder {path} contains no images; give PNG or JPEG files, or a folder of them"
            )
        images += inside
    if not images:
        raise T2TwinError("there is no image to translate; give at least one PNG or JPEG file")
    return images


def translate_files(
    run_dir: str | Path,
    paths: Sequence[str | Path],
    out_dir: str | Path,
    layout: str | Path | None = None,
    png: bool = True,
    bf16: bool = False,
    background: str | Path | None = None,
) -> TranslationResult:
    """Translates image files; writes counts.csv, counts.json and a PNG file per tactile image.

    A field run also writes counts_std.csv, the standard deviations of the counts; its PNG files
    fade to white with increasing uncertainty.

    paths: PNG or JPEG files, or folders of them (see `find_images`), of any size, grey, color or
    16-bit; upright, rows along the sensor's length. PNG files have the names of their inputs; for
    equal names the second is `press-2.png`. layout: name or file of a taxel layout that a
    touch2touch or field run is read at, by default its own. png: False writes no PNG files,
    which is faster. bf16: as for `load_run`. background: image file of the background frame of the
    same sensor, for a field run; by default the mean frame of its dataset.
    PNG files of an earlier translation in the folder are removed.
    Raises T2TwinError, without output, for no image, a file that is missing or not an image, and a
    folder that is not a run. It also does for a layout that the run cannot be read at, a background
    frame with another run, and a PNG file that would replace an input.
    """
    images, out_dir = find_images(paths), arguments.path(out_dir, "out_dir")
    frame = None if background is None else arguments.path(background, "background")
    names = output_names(images) if arguments.flag(png, "png") else []
    _check_not_replaced(images, names, out_dir)
    with ThreadPoolExecutor() as pool:
        list(pool.map(check_image, images))
        run = load_run(run_dir, layout, bf16)
        with locked(out_dir), temporary_folder(out_dir, "translate") as folder:
            result = _translate(run, images, names, folder, pool, frame)
            tables = write_tables(folder, run, images, names, result, frame)
            earlier = earlier_files(out_dir) - {path.resolve() for path in images}
            move_into(out_dir, [folder / name for name in (*names, *tables)])
            for path in earlier - {out_dir.resolve() / name for name in (*names, *tables)}:
                path.unlink(missing_ok=True)
    return result


def translate_images(
    paths: Sequence[str | Path],
    out_dir: str | Path,
    run: str | Path = DEFAULT_RUN,
    layout: str | Path | None = None,
    png: bool = True,
    bf16: bool = False,
    background: str | Path | None = None,
) -> np.ndarray:
    """As `translate_files`; returns the counts, (B, N) float32, in the order of `find_images`.

    run: a folder that `train` wrote, or the name of a pretrained run.
    """
    return translate_files(run, paths, out_dir, layout, png, bf16, background).counts


def _translate(
    run: CountsPredictor,
    images: list[Path],
    names: list[str],
    folder: Path,
    pool: ThreadPoolExecutor,
    background: Path | None,
) -> TranslationResult:
    """Predicts all images and writes the PNG files. names: of the PNG files, or empty."""
    native = None if background is None else np.asarray(open_image(background))
    frame = None
    if native is not None:
        frame = require(run, FieldPredictor, "a background frame").pixels_of(native)[0]
    counts = np.empty((len(images), run.config.data.array.x_mm.size), np.float32)
    classes: list[OODClass] = []
    estimates: list[Estimate] = []
    with Progress(
        total=len(images), desc="translating", unit="image", disable=len(images) <= BATCH_SIZE
    ) as bar:
        for part, pixels, own in _batches(run, images, pool, native):
            tactile, stds = None, [None] * len(pixels)
            if isinstance(run, FieldPredictor):
                pixels = pixels if frame is None else run.with_background(pixels, frame)
                estimates.append(run.estimate_pixels(pixels, classified=True))
                counts[part], found = estimates[-1].counts, estimates[-1].ood_class
                if names:
                    tactile, stds = run.dense_images(estimates[-1])
            else:
                found = run.classify(pixels)
                if names:
                    counts[part], tactile = run.counts_and_tactile_images(pixels)
                else:
                    counts[part] = run.predict_pixels(pixels)
            classes += map(combined, own, found)
            if tactile is not None:
                save = partial(_save_png, run, folder)
                saves = [
                    pool.submit(save, *each)
                    for each in zip(tactile, names[part], stds, strict=True)
                ]
                wait(saves)  # none may write after an error, when the folder is removed
                for each in saves:
                    each.result()
            bar.update(len(pixels))
    return TranslationResult(counts, classes, concatenate(estimates) if estimates else None)


def _batches(
    run: CountsPredictor,
    images: list[Path],
    pool: ThreadPoolExecutor,
    background: np.ndarray | None,
) -> Iterator[tuple[slice, np.ndarray, list[OODClass]]]:
    """Batches of images, (b, S, S, c) uint8, with their places among all images, and their classes
    at their own sizes. background: at its own size."""
    read = partial(_read, run=run.config, background=background)
    waiting: deque[tuple[slice, list[Future[tuple[np.ndarray, OODClass]]]]] = deque()
    for start in range(0, len(images), BATCH_SIZE):
        part = slice(start, start + BATCH_SIZE)
        waiting.append((part, [pool.submit(read, path) for path in images[part]]))
        if len(waiting) > READ_AHEAD:
            yield _batch(*waiting.popleft())
    for part, reads in waiting:
        yield _batch(part, reads)


def _batch(
    part: slice, reads: list[Future[tuple[np.ndarray, OODClass]]]
) -> tuple[slice, np.ndarray, list[OODClass]]:
    pixels, classes = zip(*(each.result() for each in reads), strict=True)
    return part, np.stack(pixels), list(classes)


def _read(path: Path, run: RunConfig, background: np.ndarray | None) -> tuple[np.ndarray, OODClass]:
    image, preset = open_image(path), run.preset
    own = classify_frame(np.asarray(image), run.data.camera.aspect, background)
    return to_pixels(image, preset.size, preset.grey), own


def _save_png(
    run: CountsPredictor, folder: Path, tactile: np.ndarray, name: str, std: np.ndarray | None
) -> None:
    info = run.config.data.array
    image = colored_tactile_image(
        tactile, info.x_mm, info.y_mm, info.full_scale_counts, std, info.tactile_image[2]
    )
    image.save(folder / name, compress_level=1)  # half the time, 1.5 times the size


def _check_not_replaced(images: list[Path], names: list[str], out_dir: Path) -> None:
    folders = {folder: folder.resolve() for folder in {path.parent for path in images}}
    inputs = {folders[path.parent] / path.name for path in images}
    target = out_dir.resolve()
    for name in names:
        if target / name in inputs:
            raise T2TwinError(
                f"{out_dir / name} is one of the images and would be replaced by its tactile "
                "image; write into another folder"
            )
