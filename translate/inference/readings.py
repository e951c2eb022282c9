"""Translation of files between any two sensors, other than from images to counts (module batch).

Counts come from CSV files with the columns taxel_0, taxel_1 and so on, one line per reading, or
from NPY files. Predicted counts are written as such a CSV file, predicted images as PNG files.
Outputs are written to a temporary folder and moved at the end.

Shape letters: B readings, N taxels.
"""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from t2twin.core import arguments
from t2twin.core.draw import colored_tactile_image
from t2twin.core.errors import T2TwinError
from t2twin.core.files import locked, move_into, read_file, temporary_folder, write_csv
from t2twin.sim.tables import ERRORS, read_csv
from t2twin.translate.data.images import open_image
from t2twin.translate.data.sides import ArraySide, CameraSide
from t2twin.translate.inference.batch import COUNTS_CSV, find_images, output_names
from t2twin.translate.inference.load import load_torch
from t2twin.translate.inference.picture_predictor import ArrayPredictor, ImagePredictor
from t2twin.translate.inference.predictor import not_predicted

TAXEL = "taxel_"
"""Start of the columns of counts."""

NPY = ".npy"


def translate_readings(
    run: str | Path, paths: Sequence[str | Path], out_dir: str | Path, png: bool = True
) -> np.ndarray:
    """Translates files; writes counts.csv, or a PNG file per predicted image.

    run: one that predicts images, or counts from counts. paths: CSV or NPY files of counts, (N,) or
    (B, N), in the order of the run's layout; or image files and folders as for `find_images`. png:
    whether tactile images of predicted counts are written too. Returns (B, N) counts, or
    (B, rows, columns, 3) uint8 images. Warns with T2TwinWarning of images that are out of
    distribution. Raises T2TwinError, without output, for a run from images to counts, files that
    cannot be read, and counts that the source cannot measure.
    """
    files, out_dir = arguments.paths(paths, "paths"), arguments.path(out_dir, "out_dir")
    predictor = load_torch(run)
    if not isinstance(predictor, ArrayPredictor | ImagePredictor):
        needed = f"{ImagePredictor.RUNS}, or {ArrayPredictor.RUNS}"
        kind, config = type(predictor), predictor.config
        raise not_predicted(predictor.run_dir, config, kind, "a translation of readings", needed)
    source = predictor.config.data.source
    if isinstance(source, ArraySide):
        counts = [read_counts(path, source) for path in files]
        readings = np.concatenate(counts)
        names = [path for path, each in zip(files, counts, strict=True) for _ in each]
    else:
        names = find_images(files)
        readings = [np.asarray(open_image(path)) for path in names]
    with locked(out_dir), temporary_folder(out_dir, "translate") as folder:
        predicted = predictor.predict(readings)  # pyright: ignore[reportArgumentType]
        written = _write(folder, predictor.config.data.target, predicted, names, png)
        _check_not_replaced(out_dir, written, names)
        move_into(out_dir, written)
    return predicted


def read_counts(path: Path, array: ArraySide) -> np.ndarray:
    """(B, N) counts of a CSV or NPY file. Raises T2TwinError for a file that has no such counts."""
    taxels = array.x_mm.size
    content = read_file(path)
    if path.suffix.lower() == NPY:
        try:
            found = np.load(io.BytesIO(content), allow_pickle=False)
        except (ValueError, EOFError, OSError):
            raise T2TwinError(f"{path} cannot be read as an NPY file of numbers") from None
        if found.ndim not in (1, 2) or found.shape[-1] != taxels or found.dtype.kind not in "iuf":
            raise T2TwinError(
                f"{path} has numbers of shape {found.shape}; expected ({taxels},) or "
                f"(B, {taxels}), the {array.words}"
            )
        return np.atleast_2d(found).astype(np.float32)
    try:
        table, _ = read_csv(content)
    except ERRORS as error:
        reason = "it is not text" if isinstance(error, UnicodeDecodeError) else error
        raise T2TwinError(
            f"{path} cannot be read as a CSV file ({reason}); the run takes CSV or NPY files of "
            f"{array.words}"
        ) from error
    columns = [f"{TAXEL}{n}" for n in range(taxels)]
    missing = [name for name in columns if name not in table.column_names]
    more = f"{TAXEL}{taxels}"
    if missing or more in table.column_names:
        wrong = f"no column {missing[0]}" if missing else f"a column {more}"
        raise T2TwinError(
            f"{path} has {wrong}; expected {columns[0]} to {columns[-1]}, the {array.words}"
        )
    try:
        return np.column_stack([table[n].to_numpy().astype(np.float32) for n in columns])
    except (ValueError, TypeError):
        raise T2TwinError(f"{path} has a count that is not a number") from None


def _write(
    folder: Path,
    target: ArraySide | CameraSide,
    predicted: np.ndarray,
    inputs: Sequence[Path],
    png: bool,
) -> list[Path]:
    """Writes the files of all predictions. Returns them."""
    names, written = output_names(inputs), []
    if isinstance(target, ArraySide):
        columns = ["reading", *(f"{TAXEL}{n}" for n in range(target.x_mm.size))]
        rows = zip(map(str, inputs), np.rint(predicted).astype(int).tolist(), strict=True)
        write_csv(folder / COUNTS_CSV, columns, [[name, *row] for name, row in rows])
        written.append(folder / COUNTS_CSV)
        if not png:
            return written
    phi = target.phi if isinstance(target, ArraySide) else None
    for name, each in zip(names, predicted, strict=True):
        if isinstance(target, ArraySide) and phi is not None:
            image = colored_tactile_image(
                phi(each), target.x_mm, target.y_mm, target.full_scale, None,
                target.tactile_image[2],
            )  # fmt: skip
        else:
            image = Image.fromarray(each)
        image.save(folder / name, compress_level=1)
        written.append(folder / name)
    return written


def _check_not_replaced(out_dir: Path, written: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Raises T2TwinError if an output has the place of an input."""
    places = {path.resolve() for path in inputs}
    for path in written:
        if out_dir.resolve() / path.name in places:
            raise T2TwinError(
                f"{out_dir / path.name} is one of the inputs and would be replaced; write into "
                "another folder"
            )
