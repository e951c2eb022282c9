"""Image files by the thousand: a trained run's counts and tactile images of each.

Files are read, decoded and written in threads while the network works; a few batches are in memory
at a time. Everything is written beside its place and moved there at the end, so a file that cannot
be read, or a stop, leaves nothing behind.

Shape letters: B images, N taxels.
"""

import csv
import json
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.primitives_cad.folder_lock import locked
from t2twin.primitives_cad.progress import Progress
from t2twin.primitives_cad.writing import temporary_folder
from t2twin.translate.data.images import check_image, open_image, to_pixels
from t2twin.translate.picture import tactile_picture
from t2twin.translate.predict import AT_ONCE, TrainedTranslator, load_run

SUFFIXES = (".png", ".jpg", ".jpeg")
"""Names that a folder's images end in, in small or capital letters."""

COUNTS_CSV, COUNTS_JSON = "counts.csv", "counts.json"

AHEAD = 2
"""Batches that are read before they are needed."""


def find_images(paths: Sequence[str | Path]) -> list[Path]:
    """The image files that these files and folders name, in their order.

    A folder gives its own PNG and JPEG files, sorted by name, without its subfolders and without
    hidden files. Raises T2TwinError for no path, one that is not there, and a folder with none.
    """
    images: list[Path] = []
    for path in map(Path, paths):
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


@dataclass(frozen=True)
class Translated:
    """What became of B images, in the order of `find_images`.

    counts: (B, N) float32. looks: (B,) in words how each is unlike the pictures that the run was
    trained on, nothing where it is like them.
    """

    counts: np.ndarray
    looks: list[str]


def translate_files(
    run_dir: str | Path,
    paths: Sequence[str | Path],
    out_dir: str | Path,
    layout: str | Path | None = None,
    pictures: bool = True,
    bf16: bool = False,
) -> Translated:
    """Translates image files; writes counts.csv, counts.json and a picture of each tactile image.

    paths: PNG or JPEG files, or folders of them (see `find_images`), any size, grey, colour or
    16-bit; upright as the DIGIT gives them, rows along the sensor's length. Pictures are named by
    their inputs, `press.png` for `press.jpg`; of two inputs with one name the second gets
    `press-2.png`. layout: a taxel layout's name or file that a touch2touch run is read at, its own
    unless given. pictures: False writes the counts only, which is some times faster.
    bf16: as for `load_run`.
    Pictures that an earlier call left in the folder go, so that all there are of these images.
    Raises T2TwinError and writes nothing for no image, a file that is missing or is no image, a
    folder that is no run, a layout that the run cannot be read at, and a picture that would
    replace one of the inputs.
    """
    images, out_dir = find_images(paths), Path(out_dir)
    names = _output_names(images) if pictures else []
    _check_not_replaced(images, names, out_dir)
    with ThreadPoolExecutor() as pool:
        list(pool.map(check_image, images))
        run = load_run(run_dir, layout, bf16)
        with locked(out_dir), temporary_folder(out_dir, "translate") as folder:
            translated = _translate(run, images, names, folder, pool)
            earlier = _earlier_pictures(out_dir) - {path.resolve() for path in images}
            for name in (*names, COUNTS_CSV, COUNTS_JSON):
                (folder / name).replace(out_dir / name)
            for path in earlier - {out_dir.resolve() / name for name in names}:
                path.unlink(missing_ok=True)
    return translated


def translate_images(
    run_dir: str | Path,
    paths: Sequence[str | Path],
    out_dir: str | Path,
    layout: str | Path | None = None,
    pictures: bool = True,
    bf16: bool = False,
) -> np.ndarray:
    """As `translate_files`; returns the counts, (B, N) float32, in the order of `find_images`."""
    return translate_files(run_dir, paths, out_dir, layout, pictures, bf16).counts


def _earlier_pictures(out_dir: Path) -> set[Path]:
    """The pictures that an earlier call says it left in a folder; none where nothing says so."""
    try:
        images = json.loads((out_dir / COUNTS_JSON).read_text())["images"]
        names = {str(entry.get("tactile_image", "")) for entry in images}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return set()
    own = {name for name in names if name.endswith(".png") and Path(name).name == name}
    return {out_dir.resolve() / name for name in own}


def _translate(
    run: TrainedTranslator,
    images: list[Path],
    names: list[str],
    folder: Path,
    pool: ThreadPoolExecutor,
) -> Translated:
    """Writes everything into a folder; names: the pictures', or none."""
    counts = np.empty((len(images), run.config.data.x_mm.size), np.float32)
    looks: list[str] = []
    with Progress(
        total=len(images), desc="translating", unit="image", disable=len(images) <= AT_ONCE
    ) as bar:
        for part, pixels in _batches(run, images, pool):
            if names:
                counts[part], tactile = run.counts_and_tactile_images(pixels)
                save = partial(_save_picture, run, folder)
                list(pool.map(save, tactile, names[part]))
            else:
                counts[part] = run.predict_pixels(pixels)
            looks += run.looks(pixels)
            bar.update(len(pixels))
    rounded = np.rint(counts).astype(int)
    _write_csv(folder / COUNTS_CSV, images, rounded)
    _write_json(folder / COUNTS_JSON, run, images, names, rounded, looks)
    return Translated(counts, looks)


def _batches(
    run: TrainedTranslator, images: list[Path], pool: ThreadPoolExecutor
) -> Iterator[tuple[slice, np.ndarray]]:
    """The images batch by batch, (b, S, S, c) uint8, and which they are."""
    preset = run.config.preset
    read = partial(_read, size=preset.size, grey=preset.grey)
    waiting: deque[tuple[slice, list[Future[np.ndarray]]]] = deque()
    for start in range(0, len(images), AT_ONCE):
        part = slice(start, start + AT_ONCE)
        waiting.append((part, [pool.submit(read, path) for path in images[part]]))
        if len(waiting) > AHEAD:
            first, reads = waiting.popleft()
            yield first, np.stack([each.result() for each in reads])
    for part, reads in waiting:
        yield part, np.stack([each.result() for each in reads])


def _read(path: Path, size: int, grey: bool) -> np.ndarray:
    return to_pixels(open_image(path), size, grey)


def _save_picture(run: TrainedTranslator, folder: Path, tactile: np.ndarray, name: str) -> None:
    info = run.config.data
    picture = tactile_picture(tactile, info.x_mm, info.y_mm, info.full_scale_counts)
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


def _write_csv(path: Path, images: list[Path], counts: np.ndarray) -> None:
    # Names of files may be no text; then what is not is escaped.
    with path.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file:
        writer = csv.writer(file)
        writer.writerow(["image", *(f"taxel_{n}" for n in range(counts.shape[1]))])
        for image, row in zip(images, counts, strict=True):
            writer.writerow([str(image), *row.tolist()])


def _write_json(
    path: Path,
    run: TrainedTranslator,
    images: list[Path],
    names: list[str],
    counts: np.ndarray,
    looks: list[str],
) -> None:
    """One line an image, so that ten thousand can still be read by eye and by line."""
    info = run.config.data
    head = {
        "model": run.config.model,
        "preset": run.config.preset.name,
        "layout": info.layout,
        "layout_x_mm": info.x_mm.tolist(),
        "layout_y_mm": info.y_mm.tolist(),
        "full_scale_counts": info.full_scale_counts,
    }
    with path.open("w") as file:
        file.write("{\n")
        for key, value in head.items():
            file.write(f"  {json.dumps(key)}: {json.dumps(value)},\n")
        file.write('  "images": [')
        for number, (image, row) in enumerate(zip(images, counts, strict=True)):
            entry: dict[str, Any] = {"image": str(image)}
            if names:
                entry["tactile_image"] = names[number]
            entry["counts"] = row.tolist()
            entry["like_training"] = not looks[number]
            if looks[number]:
                entry["looks"] = looks[number]
            file.write(("," if number else "") + "\n    " + json.dumps(entry))
        file.write("\n  ]\n}\n")


def _output_names(images: Sequence[Path]) -> list[str]:
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
