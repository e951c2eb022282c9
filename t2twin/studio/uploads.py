"""Files that a client sends: limited in size and kind, in a temporary folder."""

import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import viser
from viser import _messages

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
"""Longest stem of a kept file's name, and of a name that is said again, characters."""


def limit_uploads(client: viser.ClientHandle, refuse: Callable[[Exception], None]) -> None:
    """From here on a file that is too large is dropped when it begins to come, not when all of it
    lies in memory; `refuse` is told why.

    viser takes files of any size and has no way to say otherwise, so this reaches into it.
    """
    coming = client.gui._current_file_upload_states

    def begun(_: int, start: _messages.FileTransferStartUpload) -> None:
        try:
            check_size(start.filename, start.size_bytes)
        except T2TwinError as error:
            coming.pop(start.transfer_uuid, None)
            # For the page it has come, or it would wait for ever.
            done = _messages.FileTransferPartAck(
                start.source_component_uuid, start.transfer_uuid, start.size_bytes, start.size_bytes
            )
            client.gui._websock_interface.queue_message(done)
            refuse(error)

    def went_on(_: int, part: _messages.FileTransferPart) -> None:
        file = coming.get(part.transfer_uuid)
        if file is not None and file["transferred_bytes"] > MOST_BYTES:
            coming.pop(part.transfer_uuid, None)

    client.gui._websock_interface.register_handler(_messages.FileTransferStartUpload, begun)
    client.gui._websock_interface.register_handler(_messages.FileTransferPart, went_on)


def kept_file(kind: str, name: str, content: bytes, folder: Path) -> Path:
    """A file as it was sent, in a new folder of its own below `folder`.

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
    path = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=folder)) / (
        f"{stem[:LONGEST] or kind}{suffix}"
    )
    path.write_bytes(content)
    return path


def forget(kind: str, folder: Path, all_but: Path | None = None) -> None:
    """Removes the kept files of a kind, all but one."""
    for place in folder.glob(f"{kind}-*"):
        if all_but is None or place != all_but.parent:
            shutil.rmtree(place, ignore_errors=True)


def check_size(name: str, size: int) -> None:
    """Raises T2TwinError for a file that is too large."""
    if size > MOST_BYTES:
        raise T2TwinError(
            f"{name[:LONGEST]!r} has {size / 1e6:,.0f} MB; at most {MOST_BYTES / 1e6:,.0f} MB are "
            "allowed"
        )
