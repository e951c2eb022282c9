"""Image files by the thousand: a trained run's counts and tactile images of each.

Files are read, decoded and written in threads while the network works; a few batches are in memory
at a time. Everything is written beside its place and moved there at the end, so a file that cannot
be read, or a stop, leaves nothing behind.

Shape letters: B images, N taxels.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import repeat
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.core.files import locked, move_into, temporary_folder
from t2twin.core.progress import Progress
from t2twin.sim.cyskin.tactile_image import colored_tactile_image
from t2twin.translate.data.images import check_image, open_image, to_pixels
from t2twin.translate.inference.outputs import (
    TranslationResult,
    earlier_files,
    output_names,
    write_tables,
)
from t2twin.translate.inference.predictor import BATCH_SIZE, TrainedTranslator, load_run
from t2twin.translate.runs.pretrained import DEFAULT_RUN
from t2twin.translate.uncertainty.estimate import Estimate, joined

SUFFIXES = (".png", ".jpg", ".jpeg")
"""Names that a folder's images end in, in small or capital letters."""

AHEAD = 2
"""Batches that are read before they are needed."""


def find_images(paths: Sequence[str | Path]) -> list[Path]:
    """The image files that these files and folders name, in their order.

    A folder gives its own PNG and JPEG files, sorted by name, without its subfolders and without
    hidden files. Raises T2TwinError for no path, one that is not there, and a folder with none.
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
                f"the folder {path} holds no images; give PNG or JPEG files, or a folder of them"
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
    pictures: bool = True,
    bf16: bool = False,
    background: str | Path | None = None,
) -> TranslationResult:
    """Translates image files; writes counts.csv, counts.json and a picture of each tactile image.

    A field run also writes counts_std.csv, the standard deviation of each count, and its pictures
    fade where it is not sure.

    paths: PNG or JPEG files, or folders of them (see `find_images`), any size, grey, color or
    16-bit; upright as the DIGIT gives them, rows along the sensor's length. Pictures are named by
    their inputs, `press.png` for `press.jpg`; of two inputs with one name the second gets
    `press-2.png`. layout: a taxel layout's name or file that a touch2touch run is read at, its own
    unless given. pictures: False writes the counts only, which is some times faster.
    bf16: as for `load_run`. background: an image file with the background frame of the same DIGIT,
    for a field run, which uses its world's mean frame without it.
    Pictures that an earlier call left in the folder go, so that all there are of these images.
    Raises T2TwinError and writes nothing for no image, a file that is missing or is no image, a
    folder that is no run, a layout that the run cannot be read at, a background frame for a run
    that uses none, and a picture that would replace one of the inputs.
    """
    images, out_dir = find_images(paths), arguments.path(out_dir, "out_dir")
    frame = None if background is None else arguments.path(background, "background")
    pictures = arguments.flag(pictures, "pictures")
    names = output_names(images) if pictures else []
    _check_not_replaced(images, names, out_dir)
    with ThreadPoolExecutor() as pool:
        list(pool.map(check_image, images))
        run = load_run(run_dir, layout, bf16)
        with locked(out_dir), temporary_folder(out_dir, "translate") as folder:
            translated = _translate(run, images, names, folder, pool, frame)
            tables = write_tables(folder, run, images, names, translated, frame)
            earlier = earlier_files(out_dir) - {path.resolve() for path in images}
            move_into(out_dir, [folder / name for name in (*names, *tables)])
            for path in earlier - {out_dir.resolve() / name for name in (*names, *tables)}:
                path.unlink(missing_ok=True)
    return translated


def translate_images(
    paths: Sequence[str | Path],
    out_dir: str | Path,
    run: str | Path = DEFAULT_RUN,
    layout: str | Path | None = None,
    pictures: bool = True,
    bf16: bool = False,
    background: str | Path | None = None,
) -> np.ndarray:
    """As `translate_files`; returns the counts, (B, N) float32, in the order of `find_images`.

    run: a folder that `train` wrote, or the name of a pretrained run.
    """
    return translate_files(run, paths, out_dir, layout, pictures, bf16, background).counts


def _translate(
    run: TrainedTranslator,
    images: list[Path],
    names: list[str],
    folder: Path,
    pool: ThreadPoolExecutor,
    untouched: Path | None,
) -> TranslationResult:
    """Writes the pictures into a folder; names: theirs, or none."""
    frame = None if untouched is None else _frame(run, untouched)
    counts = np.empty((len(images), run.config.data.x_mm.size), np.float32)
    looks: list[str] = []
    told: list[Estimate] = []
    with Progress(
        total=len(images), desc="translating", unit="image", disable=len(images) <= BATCH_SIZE
    ) as bar:
        for part, pixels in _batches(run, images, pool):
            seen = pixels if frame is None else run.with_background(pixels, frame)
            looks += run.looks(seen)
            tactile, stds = None, repeat(None)
            if run.translator.learns_field:
                told.append(run.estimate_pixels(seen))
                counts[part] = told[-1].counts
                if names:
                    tactile, stds = run.drawn(told[-1])
            elif names:
                counts[part], tactile = run.counts_and_tactile_images(pixels)
            else:
                counts[part] = run.predict_pixels(pixels)
            if tactile is not None:
                save = partial(_save_picture, run, folder)
                list(pool.map(save, tactile, names[part], stds))
            bar.update(len(pixels))
    return TranslationResult(counts, looks, joined(told) if told else None)


def _batches(
    run: TrainedTranslator, images: list[Path], pool: ThreadPoolExecutor
) -> Iterator[tuple[slice, np.ndarray]]:
    """The images batch by batch, (b, S, S, c) uint8, and which they are."""
    preset = run.config.preset
    read = partial(_read, size=preset.size, grey=preset.grey)
    waiting: deque[tuple[slice, list[Future[np.ndarray]]]] = deque()
    for start in range(0, len(images), BATCH_SIZE):
        part = slice(start, start + BATCH_SIZE)
        waiting.append((part, [pool.submit(read, path) for path in images[part]]))
        if len(waiting) > AHEAD:
            first, reads = waiting.popleft()
            yield first, np.stack([each.result() for each in reads])
    for part, reads in waiting:
        yield part, np.stack([each.result() for each in reads])


def _read(path: Path, size: int, grey: bool) -> np.ndarray:
    return to_pixels(open_image(path), size, grey)


def _frame(run: TrainedTranslator, untouched: Path) -> np.ndarray:
    """(S, S, 3) uint8. Raises T2TwinError for a run that looks at no untouched frame."""
    if not run.translator.learns_field:
        raise T2TwinError(
            f"{run.run_dir} is a {run.config.model} run, which looks at no untouched frame; a "
            "field run does"
        )
    return _read(untouched, run.config.preset.size, run.config.preset.grey)


def _save_picture(
    run: TrainedTranslator, folder: Path, tactile: np.ndarray, name: str, std: np.ndarray | None
) -> None:
    info = run.config.data
    picture = colored_tactile_image(tactile, info.x_mm, info.y_mm, info.full_scale_counts, std)
    picture.save(folder / name, compress_level=1)  # in half the time, if half as large again


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
