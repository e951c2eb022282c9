"""Files that a client sends: limited in size and kind, in a temporary folder."""

import re
from pathlib import Path

from t2twin.primitives_cad import files
from t2twin.primitives_cad.errors import T2TwinError

MOST_BYTES = 64_000_000
"""Largest file that is taken, bytes (assumed: some 1 million triangles)."""

KINDS = {
    "shape": files.SUFFIXES,
    "layout": (".json", ".csv"),
    "calibration": (".npz",),
    "frame": (".png", ".jpg", ".jpeg"),
}
"""What may be sent, and how its files' names end."""

LONGEST = 40
"""Longest stem of a kept file's name, characters."""


def kept_file(kind: str, name: str, content: bytes, folder: Path) -> Path:
    """A file as it was sent, in a folder of its own below `folder`.

    It keeps its name as far as that is made of letters, digits, dots, dashes and underscores.
    Raises T2TwinError for another kind and for one too large.
    """
    suffix = Path(name.replace("\\", "/")).suffix.lower()
    if suffix not in KINDS[kind]:
        raise T2TwinError(
            f"{name[:LONGEST]!r} cannot be used as a {kind}; files of "
            f"{', '.join(KINDS[kind])} are allowed"
        )
    check_size(name, len(content))
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(name.replace("\\", "/")).stem).strip("._-")
    number = sum(1 for _ in folder.iterdir())
    place = folder / str(number)
    place.mkdir()
    path = place / f"{stem[:LONGEST] or kind}{suffix}"
    path.write_bytes(content)
    return path


def check_size(name: str, size: int) -> None:
    """Raises T2TwinError for a file that is too large."""
    if size > MOST_BYTES:
        raise T2TwinError(
            f"{name[:LONGEST]!r} has {size / 1e6:,.0f} MB; at most {MOST_BYTES / 1e6:,.0f} MB are "
            "allowed"
        )
