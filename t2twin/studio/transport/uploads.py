"""Uploaded files: limits during the transfer, allowed types, and storage in a temporary folder."""

import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import viser
from viser import _messages

from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.messages import MAX_PARTS, FileTransferPart, FileTransferStartUpload

MAX_BYTES = 64_000_000
"""Maximum size of a file, bytes (assumed: about 1 million triangles). Also the maximum total size
of a client's unfinished uploads."""

MAX_UPLOADS = 4
"""Maximum number of unfinished uploads of one client (assumed)."""

MAX_BYTES_OF_ALL = 2 * MAX_BYTES
"""Maximum total size of the unfinished uploads of all clients, bytes in memory (assumed)."""

MAX_NAME = 40
"""Maximum length of the stem of a stored file name, and of a quoted name, characters."""

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")


class Uploads:
    """Limits the unfinished uploads of all clients. Used in viser's event loop.

    viser stores uploads of any number and size in memory and has no option for limits, so this
    class inspects its internal state.
    """

    def __init__(self) -> None:
        self._clients: dict[int, tuple[viser.ClientHandle, Callable[[Exception], None]]] = {}

    def add_client(self, client: viser.ClientHandle, refuse: Callable[[Exception], None]) -> None:
        """Allows uploads of a client. refuse: receives the reason of a refused file."""
        self._clients[client.client_id] = (client, refuse)

    def remove_client(self, client: viser.ClientHandle) -> None:
        """Forgets a client that has disconnected; viser discards its unfinished uploads."""
        self._clients.pop(client.client_id, None)

    def accepts_start(self, client: viser.ClientHandle, start: FileTransferStartUpload) -> bool:
        """Whether an upload may start. Raises T2TwinError for a message that no page sends."""
        _check_button(client, start.source_component_uuid)
        if start.part_count > MAX_PARTS or (start.part_count == 0) != (start.size_bytes == 0):
            raise T2TwinError(
                f"an upload of {start.size_bytes:,} bytes in {start.part_count:,} parts; expected "
                f"at most {MAX_PARTS} parts, and none of an empty file"
            )
        try:
            check_size(start.filename, start.size_bytes)
            self._check_capacity(client, start.size_bytes)
        except T2TwinError as error:
            # Acknowledged as complete, because the page would wait otherwise.
            done = _messages.FileTransferPartAck(
                start.source_component_uuid, start.transfer_uuid, start.size_bytes, start.size_bytes
            )
            client.gui._websock_interface.queue_message(done)
            self._clients[client.client_id][1](error)
            return False
        return True

    def accepts_part(self, client: viser.ClientHandle, part: FileTransferPart) -> bool:
        """Whether a part belongs to an accepted upload; a page continues to send refused files.

        Raises T2TwinError for a part that no page sends. viser ignores repeated parts.
        """
        file = _unfinished(client).get(part.transfer_uuid)
        if file is None:
            return False
        _check_button(client, part.source_component_uuid)
        missing = file["total_bytes"] - file["transferred_bytes"] - len(part.content)
        is_last = len(file["parts"]) + 1 == file["part_count"]
        if missing < 0 or (is_last and missing):
            del _unfinished(client)[part.transfer_uuid]
            raise T2TwinError(
                f"an upload does not have its announced {file['total_bytes']:,} bytes"
            )
        return True

    def _check_capacity(self, client: viser.ClientHandle, size: int) -> None:
        """Raises T2TwinError if unfinished uploads leave no capacity for a file."""
        own, of_all = (
            [file["total_bytes"] for each in clients for file in list(_unfinished(each).values())]
            for clients in ([client], [each for each, _ in list(self._clients.values())])
        )
        if len(own) >= MAX_UPLOADS or sum(own) + size > MAX_BYTES:
            raise T2TwinError("other files are being uploaded; try again when they are complete")
        if sum(of_all) + size > MAX_BYTES_OF_ALL:
            raise T2TwinError("other users are uploading files; try again in a moment")


def _unfinished(client: viser.ClientHandle) -> dict[str, Any]:
    """Unfinished uploads of a client in viser's state."""
    return client.gui._current_file_upload_states


def _check_button(client: viser.ClientHandle, uuid: str) -> None:
    button = client.gui._gui_input_handle_from_uuid.get(uuid)
    if not isinstance(button, viser.GuiUploadButtonHandle):
        raise T2TwinError("an upload is addressed to a control that accepts no files")


def check_size(name: str, size: int) -> None:
    """Raises T2TwinError for a file that is too large."""
    if size > MAX_BYTES:
        raise T2TwinError(
            f"{name[:MAX_NAME]!r} has {size / 1e6:,.0f} MB; at most {MAX_BYTES / 1e6:,.0f} MB are "
            "allowed"
        )


def save_upload(kind: str, name: str, content: bytes, folder: Path) -> Path:
    """Stores an uploaded file in a new subfolder of `folder` and returns its path.

    The name keeps its letters, digits, dots, dashes and underscores. Raises T2TwinError for a
    suffix that the kind does not allow and for a file that is too large.
    """
    allowed = suffixes_of(kind)
    suffix = Path(name.replace("\\", "/")).suffix.lower()
    if suffix not in allowed:
        raise T2TwinError(
            f"{name[:MAX_NAME]!r} cannot be used as a {kind}; expected a file of "
            f"{', '.join(allowed)}"
        )
    check_size(name, len(content))
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(name.replace("\\", "/")).stem).strip("._-")
    path = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=folder)) / (
        f"{stem[:MAX_NAME] or kind}{suffix}"
    )
    path.write_bytes(content)
    return path


def suffixes_of(kind: str) -> tuple[str, ...]:
    """Allowed suffixes of a kind of file: shape, layout, calibration, frame or background."""
    from t2twin.primitives_cad.mesh_io import read  # slow to import, and not needed to listen

    suffixes = {
        "shape": read.SUFFIXES,
        "layout": (".json", ".csv"),
        "calibration": (".npz",),
        "frame": IMAGE_SUFFIXES,
        "background": IMAGE_SUFFIXES,
    }
    return suffixes[kind]


def remove_uploads(kind: str, folder: Path, all_but: Path | None = None) -> None:
    """Removes the stored files of a kind, except one."""
    for place in folder.glob(f"{kind}-*"):
        if all_but is None or place != all_but.parent:
            shutil.rmtree(place, ignore_errors=True)
