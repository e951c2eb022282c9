"""The folder that a report is written into, tried before the work begins."""

import tempfile
from pathlib import Path

from t2twin.primitives_cad.errors import T2TwinError

PAGE = "index.html"


def check_out(out: Path) -> None:
    """Whether out/index.html can be written; leaves nothing behind.

    A file is made for a moment in `out`, or in the nearest folder above it that is there.
    Raises T2TwinError where there is a file in the folder's place, a folder in the page's, or no
    right to write.
    """
    try:
        if out.exists() and not out.is_dir():
            raise T2TwinError(f"{out} is a file; give a folder to write the report into")
        if (out / PAGE).is_dir():
            raise T2TwinError(f"{out / PAGE} is a folder; give another folder for the report")
        there = next(folder for folder in (out, *out.parents) if folder.exists())
        with tempfile.TemporaryFile(dir=there):
            pass
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise T2TwinError(
            f"{out} cannot be written to ({reason}); give a writable folder for the report"
        ) from error
