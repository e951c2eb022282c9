"""Files on their way from clients: bounded for each of them and for all."""

from collections.abc import Callable
from typing import Any

import viser
from viser import _messages

from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.messages import MAX_PARTS, FileTransferPart, FileTransferStartUpload

MAX_BYTES = 64_000_000
"""Largest file that is taken, bytes (assumed: some 1 million triangles)."""

MAX_UPLOADS = 4
"""Most unfinished uploads of one client, which together may have MAX_BYTES (assumed)."""

MAX_BYTES_OF_ALL = 2 * MAX_BYTES
"""Most bytes of the unfinished uploads of all clients, which lie in memory (assumed)."""

MAX_NAME = 40
"""Longest stem of a kept file's name, and of a name that is said again, characters."""


class Uploads:
    """Files of all clients that have begun to come and are not whole yet. Used in viser's loop.

    viser keeps any number of any size in memory and has no way to say otherwise, so this looks into
    what it keeps.
    """

    def __init__(self) -> None:
        self._clients: dict[int, tuple[viser.ClientHandle, Callable[[Exception], None]]] = {}

    def enter(self, client: viser.ClientHandle, refuse: Callable[[Exception], None]) -> None:
        """From here on a client may send files; `refuse` is told why one is not taken."""
        self._clients[client.client_id] = (client, refuse)

    def leave(self, client: viser.ClientHandle) -> None:
        """The client is gone, and what it has sent of files with it."""
        self._clients.pop(client.client_id, None)
        _coming(client).clear()

    def begins(self, client: viser.ClientHandle, start: FileTransferStartUpload) -> bool:
        """Whether a file may come. Raises T2TwinError for one that no page sends."""
        _check_button(client, start.source_component_uuid)
        if start.part_count > MAX_PARTS or (start.part_count == 0) != (start.size_bytes == 0):
            raise T2TwinError(
                f"an upload of {start.size_bytes:,} bytes in {start.part_count:,} parts; expected "
                f"at most {MAX_PARTS} parts, and none of an empty file"
            )
        if start.transfer_uuid in _coming(client):
            raise T2TwinError("an upload began twice")
        try:
            check_size(start.filename, start.size_bytes)
            self._check_room(client, start)
        except T2TwinError as error:
            # For the page it has come, or it would wait for ever.
            client.gui._websock_interface.queue_message(
                _messages.FileTransferPartAck(
                    start.source_component_uuid,
                    start.transfer_uuid,
                    start.size_bytes,
                    start.size_bytes,
                )
            )
            self._clients[client.client_id][1](error)
            return False
        return True

    def goes_on(self, client: viser.ClientHandle, part: FileTransferPart) -> bool:
        """Whether viser is to have a part: not of a file that was refused, which a page goes on
        sending. Raises T2TwinError for one that no page sends; the file is dropped then."""
        file = _coming(client).get(part.transfer_uuid)
        if file is None:
            return False
        try:
            _check_button(client, part.source_component_uuid)
            if part.part_index in file["parts"] or part.part_index >= file["part_count"]:
                raise T2TwinError(f"part {part.part_index} of an upload came twice or is none")
            come = file["transferred_bytes"] + len(part.content)
            is_last = len(file["parts"]) + 1 == file["part_count"]
            if come > file["total_bytes"] or (is_last and come < file["total_bytes"]):
                raise T2TwinError(
                    f"an upload has not the {file['total_bytes']:,} bytes that it said"
                )
        except T2TwinError:
            _coming(client).pop(part.transfer_uuid, None)
            raise
        return True

    def _check_room(self, client: viser.ClientHandle, start: FileTransferStartUpload) -> None:
        """Raises T2TwinError where there are too many unfinished uploads to begin another."""
        own = [file["total_bytes"] for file in list(_coming(client).values())]
        clients = [each for each, _ in list(self._clients.values())]
        of_all = sum(
            file["total_bytes"] for each in clients for file in list(_coming(each).values())
        )
        if len(own) >= MAX_UPLOADS or sum(own) + start.size_bytes > MAX_BYTES:
            raise T2TwinError("other files are still being sent; send this one after them")
        if of_all + start.size_bytes > MAX_BYTES_OF_ALL:
            raise T2TwinError("other users are sending files; send this one again in a moment")


def _coming(client: viser.ClientHandle) -> dict[str, Any]:
    """viser's unfinished uploads of a client."""
    return client.gui._current_file_upload_states


def _check_button(client: viser.ClientHandle, uuid: str) -> None:
    button = client.gui._gui_input_handle_from_uuid.get(uuid)
    if not isinstance(button, viser.GuiUploadButtonHandle):
        raise T2TwinError("a file came for a control that takes none")


def check_size(name: str, size: int) -> None:
    """Raises T2TwinError for a file that is too large."""
    if size > MAX_BYTES:
        raise T2TwinError(
            f"{name[:MAX_NAME]!r} has {size / 1e6:,.0f} MB; at most {MAX_BYTES / 1e6:,.0f} MB are "
            "allowed"
        )
