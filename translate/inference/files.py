"""Translation of files: thousands of images to counts, or to contacts, and readings of any pair.

Threads read, decode and write files while the network computes; two batches are in memory at a
time. Outputs are written to a temporary folder and moved at the end, so that errors and
interruptions leave no partial output.

Shape letters: B images or readings, N taxels.
"""

import io
import json
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from t2twin.core import arguments
from t2twin.core.draw import colored_tactile_image
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.files import read_file, result_folder, write_csv
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.core.images import SUFFIXES
from t2twin.core.progress import Progress
from t2twin.sim.dataset.info import COUNTS, ArrayInfo, normalized
from t2twin.sim.tables import read_csv
from t2twin.sim.taxels.layout import Layout
from t2twin.translate.data.images import read_image
from t2twin.translate.inference.estimate import (
    DIFFERENCES,
    ENDS,
    ContactEstimate,
    Estimate,
    concatenate,
    warn_of_contacts,
)
from t2twin.translate.inference.load import load, load_run
from t2twin.translate.inference.predictor import BATCH_SIZE, NO_BACKGROUND, TrainedTranslator
from t2twin.translate.runs.config import DEFAULT_RUN
from t2twin.translate.uncertainty.ood import unlike

COUNTS_CSV, COUNTS_JSON, COUNTS_STD_CSV = "counts.csv", "counts.json", "counts_std.csv"
CONTACTS_CSV, KIND = "contacts.csv", "translation"  # and the kind of result

TAXEL = "taxel_"  # Start of the columns of counts
# Numbers and vectors of ContactEstimate.summary in contacts.csv; these have columns of x and y
COLUMNS = (
    "force_n", "force_std_n", "largest_depth_mm", "area_mm2", "force_in_view_n", *DIFFERENCES,
)  # fmt: skip
VECTORS = "center_mm", "center_std_mm", "shear_n", "shear_std_n"


def find_images(paths: Sequence[str | Path]) -> list[Path]:
    """The image files in a list of files and folders, in its order.

    From a folder: its PNG and JPEG files, sorted, without hidden ones. Raises T2TwinError for none.
    """
    images: list[Path] = []
    for path in arguments.paths(paths, "paths"):
        if not path.is_dir():
            images.append(path)
            continue
        files = (file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
        inside = sorted(file for file in files if not file.name.startswith("."))
        if not inside:
            raise T2TwinError(
                f"the folder {path} contains no images; give PNG or JPEG files, or a folder of them"
            )
        images += inside
    if not images:
        raise T2TwinError("there is no image to translate; give at least one PNG or JPEG file")
    return images


def output_names(inputs: Sequence[Path]) -> list[str]:
    """One PNG file name per input, all different even without case."""
    names: dict[str, str] = {}
    for path in inputs:
        number, name = 1, f"{path.stem}.png"
        while name.lower() in names:
            number += 1
            name = f"{path.stem}-{number}.png"
        names[name.lower()] = name
    return list(names.values())


def _batches(
    images: list[Path], pool: ThreadPoolExecutor, order: FrameOrder
) -> Iterator[tuple[slice, list[np.ndarray]]]:
    """The images in batches, with their places; the next batch is read ahead."""
    parts = [slice(n, n + BATCH_SIZE) for n in range(0, len(images), BATCH_SIZE)]
    reads = (pool.map(read_image, images[part], repeat(order)) for part in parts)
    current = next(reads, iter(()))
    for part in Progress(parts, desc="translating", unit="part", disable=len(parts) < 2):
        following = next(reads, iter(()))
        yield part, list(current)
        current = following


def translate_images(
    paths: Sequence[str | Path], out_dir: str | Path, run: str | Path = DEFAULT_RUN,
    layout: str | Path | Layout | None = None, png: bool = True, bf16: bool = False,
    background: str | Path | None = None, order: FrameOrder = UPRIGHT,
) -> np.ndarray:  # fmt: skip
    """Translates image files; writes counts.csv, counts.json and PNG tactile images into out_dir.

    A field run also writes counts_std.csv, the standard deviations of the counts; its PNG files
    fade to white with increasing uncertainty.

    paths: PNG or JPEG files, or folders of them (see `find_images`), of any size, grey, color or
    16-bit. order: how they and the background frame are stored; by default upright, rows along the
    sensor's length. PNG files have the names of their inputs; for
    equal names the second is `press-2.png`. run: a folder that `train` wrote, or the name of a
    pretrained run. layout, bf16: as for `load`. png: False writes no PNG files, which is faster.
    background: image file of the background frame of the same sensor, for a field run; by default
    the mean frame of its dataset.
    Files of an earlier translation in the folder are removed. Returns the counts, (B, N)
    float32, in the order of `find_images`. Warns with T2TwinWarning of images that are out of
    distribution, and of a field run without a background frame.
    Raises T2TwinError, without output, for no image, a file that is missing or not an image, and a
    folder that is not a run. It also does for a layout that the run cannot be read at, a background
    frame with another run, and a file that would replace an input or another's file.
    """
    images, out_dir = find_images(paths), arguments.path(out_dir, "out_dir")
    background = None if background is None else arguments.path(background, "background")
    frame = background and read_image(background, order)
    names = output_names(images) if arguments.flag(png, "png") else []
    loaded = load_run(run, layout, bf16)
    array, found = loaded.config.data.array, []
    given = [*images, *(Path(e) for e in (background, layout) if isinstance(e, str | Path))]
    with (
        ThreadPoolExecutor() as pool,
        result_folder(out_dir, KIND, [*names, COUNTS_CSV, COUNTS_JSON], given) as folder,
    ):
        for part, frames in _batches(images, pool, order):
            estimate = loaded._classified_estimate(frames, frame, tactile=png)
            if png:
                stds = estimate.tactile_std
                stds = [None] * len(frames) if stds is None else stds
                files = [folder / name for name in names[part]]
                list(pool.map(_save, [array] * len(files), files, estimate.tactile_images, stds))
            found.append(replace(estimate, tactile_images=None, tactile_std=None))
        whole = concatenate(found)
        _write_tables(folder, loaded, images, names, whole, background)
    is_without = loaded.config.has_uncertainty and background is None
    classes = whole.ood_class.tolist()
    stored = loaded._order_warning(classes, frame, images, order)
    warn(NO_BACKGROUND if is_without else None, unlike(classes, str(run), images), stored)
    return whole.counts


def _save(array: ArrayInfo, path: Path, tactile: np.ndarray, std: np.ndarray | None = None) -> None:
    """Draws a tactile image."""
    image = colored_tactile_image(
        tactile, array.x_mm, array.y_mm, array.full_scale, std, array.tactile_image[2]
    )
    image.save(path, compress_level=1)  # half the time, 1.5 times the size


def _write_tables(
    folder: Path, run: TrainedTranslator, images: list[Path], names: list[str], found: Estimate,
    background: str | Path | None,
) -> None:  # fmt: skip
    """Writes counts.csv and counts.json, and counts_std.csv for a field run."""
    array = run.config.data.array
    columns = ["image", *(f"{TAXEL}{n}" for n in range(found.counts.shape[1]))]
    values = {"counts": np.rint(found.counts).astype(int).tolist()}
    rows = zip(images, values["counts"], found.ood_class, strict=True)
    lines = [[file, *row, ood_class] for file, row, ood_class in rows]
    write_csv(folder / COUNTS_CSV, [*columns, "ood_class"], lines)
    if found.counts_std is not None:
        values["counts_std"] = np.ceil(found.counts_std).astype(int).tolist()
        lines = [[file, *row] for file, row in zip(images, values["counts_std"], strict=True)]
        write_csv(folder / COUNTS_STD_CSV, columns, lines)
    for name in ("force_n", "force_std_n", "shear_n", "shear_std_n"):
        if (value := getattr(found, name)) is not None:
            values[name] = value.astype(float).round(3).tolist()
    head = {
        "model": run.config.model,
        "preset": run.config.preset.name,
        "layout": array.layout,
        "layout_x_mm": array.x_mm.tolist(),
        "layout_y_mm": array.y_mm.tolist(),
        "full_scale_counts": array.full_scale,
        **({} if background is None else {"background": str(background)}),
    }
    entries = [
        {"image": str(image)}
        | ({"tactile_image": names[n]} if names else {})
        | {name: each[n] for name, each in values.items()}
        | found.ood_class[n].entry
        for n, image in enumerate(images)
    ]
    # One line per image, so that large files stay readable by line.
    body = ",\n".join(map(json.dumps, entries))
    text = f'{json.dumps(head)[:-1]},\n"images": [\n{body}\n]}}\n'
    (folder / COUNTS_JSON).write_text(text)


def translate_contacts(
    run: str | Path, paths: Sequence[str | Path], out_dir: str | Path,
    background: str | Path | None = None, png: bool = True, order: FrameOrder = UPRIGHT,
) -> list[ContactEstimate]:  # fmt: skip
    """Translates image files to contacts; writes contacts.csv, and the files of each contact.

    Other arguments and errors: as for `translate_images`. The files are those of
    ContactEstimate.save, with the names of the images. png: False writes none of their PNG files.
    Returns the contacts in the order of `find_images`, and warns of their notes.
    """
    images, out_dir = find_images(paths), arguments.path(out_dir, "out_dir")
    background = None if background is None else arguments.path(background, "background")
    frame = background and read_image(background, order)
    loaded = load_run(run)
    found: list[ContactEstimate] = []
    names = [name.removesuffix(".png") for name in output_names(images)]
    written = ENDS if arguments.flag(png, "png") else ENDS[:2]
    ends = [CONTACTS_CSV, *(f"{name}{end}" for name in names for end in written)]
    with (
        ThreadPoolExecutor() as pool,
        result_folder(out_dir, KIND, ends, [*images, *filter(None, (background,))]) as folder,
    ):
        for _, frames in _batches(images, pool, order):
            found += loaded._classified_estimate(frames, frame, contact=True).contact
        list(pool.map(ContactEstimate.write, found, repeat(folder), names, repeat(png), images))
        rows = []
        for image, name, contact in zip(images, names, found, strict=True):
            summary = contact.summary()
            cells = [summary.get(name) for name in COLUMNS]
            for vector in VECTORS:
                cells += summary.get(vector) or [None, None]
            rows.append([image, name, *cells, contact.ood_class, "; ".join(contact.notes)])
        parts = [vector.rpartition("_") for vector in VECTORS]
        vectors = [f"{name}_{axis}_{unit}" for name, _, unit in parts for axis in "xy"]
        columns = ["image", "contact", *COLUMNS, *vectors, "ood_class", "notes"]
        write_csv(folder / CONTACTS_CSV, columns, rows)
    stored = loaded._order_warning([each.ood_class for each in found], frame, images, order)
    warn(NO_BACKGROUND if background is None else None, stored)
    warn_of_contacts(found, images)
    return found


def translate_readings(
    run: str | Path, paths: Sequence[str | Path], out_dir: str | Path, png: bool = True,
    order: FrameOrder = UPRIGHT,
) -> np.ndarray:  # fmt: skip
    """Translates files of any other pair; writes counts.csv, or a PNG file per predicted image.

    run: one that predicts images, or counts from counts. paths: CSV files with columns taxel_0,
    taxel_1 and so on, or NPY files of counts, (N,) or (B, N); or images as for `find_images`, in an
    order. png: whether tactile images of predicted counts are written too; True for images. Returns
    (B, N) counts, or (B, rows, columns, 3) uint8 images, with the warnings of
    `TrainedTranslator.predict`. Raises T2TwinError, without output, for files that cannot be read
    or be of the source, as parts of full scale, and for what the run does not use: an order, or no
    PNG.
    """
    files, out_dir = arguments.paths(paths, "paths"), arguments.path(out_dir, "out_dir")
    loaded = load(run, engine="torch")
    source, target = loaded.config.data.source, loaded.config.data.target
    arguments.instance(order, "order", FrameOrder)
    if source.value == COUNTS and order != UPRIGHT:
        raise T2TwinError(f"{order} is for images; {run} translates counts")
    if target.value != COUNTS and not arguments.flag(png, "png"):
        raise T2TwinError(f"--no-png (png=False) is for predicted counts; {run} predicts images")
    if source.value == COUNTS:
        counts = [read_counts(path, source) for path in files]
        readings: Any = np.concatenate(counts)
        inputs = [path for path, each in zip(files, counts, strict=True) for _ in each]
    else:
        inputs = find_images(files)
        readings = [read_image(path, order) for path in inputs]
    names = output_names(inputs)
    with result_folder(out_dir, KIND, inputs=inputs) as folder:
        predicted = loaded.predict(readings)
        if target.value != COUNTS:
            for name, image in zip(names, predicted, strict=True):
                Image.fromarray(image).save(folder / name, compress_level=1)
        else:
            columns = ["reading", *(f"{TAXEL}{n}" for n in range(target.x_mm.size))]
            rows = zip(inputs, np.rint(predicted).astype(int).tolist(), strict=True)
            write_csv(folder / COUNTS_CSV, columns, [[name, *row] for name, row in rows])
            names = names if png else []
            for name, image in zip(names, target.phi(predicted[: len(names)]), strict=True):
                _save(target, folder / name, image)
    return predicted


def read_counts(path: Path, array: ArrayInfo) -> np.ndarray:
    """(B, N) counts of a CSV or NPY file. Raises T2TwinError for a file that has no such counts."""
    taxels, content = array.x_mm.size, read_file(path)
    columns = [f"{TAXEL}{n}" for n in range(taxels)]
    try:
        if path.suffix.lower() == ".npy":
            found = np.load(io.BytesIO(content), allow_pickle=False)
            if found.shape[-1:] != (taxels,) or found.ndim > 2 or found.dtype.kind not in "iuf":
                raise ValueError(f"it has shape {found.shape} and type {found.dtype}")
            found = np.atleast_2d(found).astype(np.float32)
            places = [f"row {n}" for n in range(len(found))]
        else:
            names, rows = read_csv(path, rf"{TAXEL}\d+")
            own = [name for name in names if name.lower().startswith(TAXEL)]
            for name in [*own, *columns]:
                if own.count(name) != 1 or name not in columns:
                    raise ValueError(f"it has {own.count(name)} columns {name}")
            places = [place for place, _ in rows]
            found = [[float(cells.get(name, "nan")) for name in columns] for _, cells in rows]
            found = np.array(found, np.float32).reshape(-1, taxels)
        if not places:
            raise ValueError("it has no reading")
        for n, taxel in np.argwhere(~((found >= 0) & (found <= array.full_scale))):
            count = found[n, taxel]
            value = "no number" if np.isnan(count) else f"{count:,.10g}"
            limit = f"expected 0 to {array.full_scale:,.0f}"
            raise ValueError(f"{places[n]}: {columns[taxel]} has {value}; {limit}")
        if (fault := normalized(found, array.full_scale)) and found.max() <= 1.0:
            raise ValueError(fault)
        warn(fault and f"{path}: {fault}")
        return found
    except (T2TwinError, ValueError, EOFError, OSError) as error:
        raise T2TwinError(
            f"{path} cannot be read ({error}); expected a CSV file with the columns {columns[0]} "
            f"to {columns[-1]}, or an NPY file of shape ({taxels},) or (B, {taxels}), of "
            f"{array.words}"
        ) from error
