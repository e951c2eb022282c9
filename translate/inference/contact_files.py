"""Translation of image files to contacts: contacts.csv, and the files of each contact."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from t2twin.core import arguments
from t2twin.core.files import locked, move_into, temporary_folder, write_csv
from t2twin.core.progress import Progress
from t2twin.translate.data.images import check_image, open_image
from t2twin.translate.inference.batch import find_images, output_names
from t2twin.translate.inference.contact import ContactEstimate
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import BATCH_SIZE, require

CONTACTS_CSV = "contacts.csv"

COLUMNS = ("force_n", "force_std_n", "largest_depth_mm", "area_mm2", "force_in_view_n")
VECTORS = ("center_mm", "center_std_mm", "shear_n", "shear_std_n")
VECTOR_COLUMNS = (
    "center_x_mm", "center_y_mm", "center_std_x_mm", "center_std_y_mm",
    "shear_x_n", "shear_y_n", "shear_std_x_n", "shear_std_y_n",
)  # fmt: skip
"""Numbers and vectors of ContactEstimate.summary in contacts.csv, and the vectors' columns."""


def translate_contacts(
    run: str | Path,
    paths: Sequence[str | Path],
    out_dir: str | Path,
    background: str | Path | None = None,
    files: bool = True,
) -> list[ContactEstimate]:
    """Translates image files to contacts; writes contacts.csv, and the files of each contact.

    run, paths, background: as for `translate_files`. files: whether the files of
    ContactEstimate.save are written, with the names of the images. Returns the contacts in the
    order of `find_images`. Raises T2TwinError, without output, as `translate_files`, and for a run
    that does not predict the contact.
    """
    images, out_dir = find_images(paths), arguments.path(out_dir, "out_dir")
    names = [Path(name).stem for name in output_names(images)]
    for path in images:
        check_image(path)
    predictor = require(load_run(run), FieldPredictor, "the contact")
    frame = None
    if background is not None:
        frame = np.asarray(open_image(arguments.path(background, "background")))
    found: list[ContactEstimate] = []
    with locked(out_dir), temporary_folder(out_dir, "translate") as folder:
        written: list[Path] = []
        starts = range(0, len(images), BATCH_SIZE)
        for start in Progress(starts, desc="translating", unit="batch", disable=len(starts) < 2):
            part = slice(start, start + BATCH_SIZE)
            contacts = predictor.contact([np.asarray(open_image(p)) for p in images[part]], frame)
            assert isinstance(contacts, list)
            for name, each in zip(names[part], contacts, strict=True):
                written += each.write(folder, name) if files else []
            found += contacts
        rows = [_row(path, each) for path, each in zip(images, found, strict=True)]
        write_csv(folder / CONTACTS_CSV, ["image", *COLUMNS, *VECTOR_COLUMNS, "notes"], rows)
        move_into(out_dir, [*written, folder / CONTACTS_CSV])
    return found


def _row(path: Path, contact: ContactEstimate) -> list[object]:
    summary = contact.summary()
    values = [summary.get(name) for name in COLUMNS]
    for name in VECTORS:
        values += summary.get(name) or [None, None]
    cells = ["" if value is None else value for value in values]
    return [str(path).encode(errors="backslashreplace").decode(), *cells, "; ".join(contact.notes)]
