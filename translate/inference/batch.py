"""Translation of image files: counts and tactile images for thousands of files.

Threads read, decode and write files while the network computes; a few batches are in memory at a
time. Outputs are written to a temporary folder and moved at the end, so that errors and
interruptions leave no partial output.

Shape letters: B images, N taxels, S image side of the run, c channels.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import partial
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import locked, move_into, temporary_folder
from t2twin.core.progress import Progress
from t2twin.sim.cyskin.tactile_image import colored_tactile_image
from t2twin.translate.data.images import check_image, open_image, to_pixels
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.outputs import (
    TranslationResult,
    earlier_files,
    output_names,
    write_tables,
)
from t2twin.translate.inference.predictor import BATCH_SIZE, CountsPredictor, require
from t2twin.translate.runs.pretrained import DEFAULT_RUN
from t2twin.translate.uncertainty.estimate import Estimate, concatenate
from t2twin.translate.uncertainty.ood import OODClass, classify_frame, combined

SUFFIXES = (".png", ".jpg", ".jpeg")
"""File name extensions of images in a folder, lower or upper case."""

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
    same DIGIT, for a field run; by default the mean frame of its world.
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
    frame = None if native is None else _frame(run, native)
    counts = np.empty((len(images), run.config.data.x_mm.size), np.float32)
    classes: list[OODClass] = []
    estimates: list[Estimate] = []
    with Progress(
        total=len(images), desc="translating", unit="image", disable=len(images) <= BATCH_SIZE
    ) as bar:
        for part, pixels, own in _batches(run, images, pool, native):
            tactile, stds = None, [None] * len(pixels)
            if isinstance(run, FieldPredictor):
                pixels = pixels if frame is None else run.with_background(pixels, frame)
                estimates.append(run.estimate_pixels(pixels))
                counts[part] = estimates[-1].counts
                if names:
                    tactile, stds = run.field_images(estimates[-1])
            elif names:
                counts[part], tactile = run.counts_and_tactile_images(pixels)
            else:
                counts[part] = run.predict_pixels(pixels)
            classes += map(combined, own, run.classify(pixels))
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
    preset = run.config.preset
    read = partial(_read, size=preset.size, grey=preset.grey, background=background)
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


def _read(
    path: Path, size: int, grey: bool, background: np.ndarray | None
) -> tuple[np.ndarray, OODClass]:
    image = open_image(path)
    return to_pixels(image, size, grey), classify_frame(np.asarray(image), background)


def _frame(run: CountsPredictor, background: np.ndarray) -> np.ndarray:
    """(S, S, 3) uint8. Raises T2TwinError for a run without background frames."""
    return require(run, FieldPredictor, "a background frame").pixels_of(background)[0]


def _save_png(
    run: CountsPredictor, folder: Path, tactile: np.ndarray, name: str, std: np.ndarray | None
) -> None:
    info = run.config.data
    image = colored_tactile_image(tactile, info.x_mm, info.y_mm, info.full_scale_counts, std)
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
