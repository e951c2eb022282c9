"""Files that a client sends: limited in size and kind, in a temporary folder."""

import re
import shutil
import tempfile
from pathlib import Path

from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.mesh_io import read
from t2twin.studio.transport.transfers import MAX_NAME, check_size

KINDS = {
    "shape": read.SUFFIXES,
    "layout": (".json", ".csv"),
    "calibration": (".npz",),
    "frame": (".png", ".jpg", ".jpeg"),
    "background": (".png", ".jpg", ".jpeg"),
}
"""What may be sent, and how its files' names end."""


def kept_file(kind: str, name: str, content: bytes, folder: Path) -> Path:
    """A file as it was sent, in a new folder of its own below `folder`.

    It keeps its name as far as that is made of letters, digits, dots, dashes and underscores.
    Raises T2TwinError for another kind and for one too large.
    """
    suffix = Path(name.replace("\\", "/")).suffix.lower()
    if suffix not in KINDS[kind]:
        raise T2TwinError(
            f"{name[:MAX_NAME]!r} cannot be used as a {kind}; files of "
            f"{', '.join(KINDS[kind])} are allowed"
        )
    check_size(name, len(content))
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(name.replace("\\", "/")).stem).strip("._-")
    path = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=folder)) / (
        f"{stem[:MAX_NAME] or kind}{suffix}"
    )
    path.write_bytes(content)
    return path


def forget(kind: str, folder: Path, all_but: Path | None = None) -> None:
    """Removes the kept files of a kind, all but one."""
    for place in folder.glob(f"{kind}-*"):
        if all_but is None or place != all_but.parent:
            shutil.rmtree(place, ignore_errors=True)
