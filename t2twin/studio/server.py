"""The studio's server: a page for each client, until it is stopped.

It listens before the twin is imported, which takes seconds, so that a browser can load the page
meanwhile.
"""

import ctypes
import gc
import io
import socket
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from functools import partial
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote, urlsplit
from uuid import uuid4

import viser

from t2twin.core.errors import T2TwinError
from t2twin.core.files import remove_leftovers, temporary_folder
from t2twin.studio.controls.notices import Notices
from t2twin.studio.frame_source import Frames, read_frame
from t2twin.studio.translators import Translators
from t2twin.studio.transport.connection import Connection, guarded_server
from t2twin.studio.transport.gate import Gate
from t2twin.studio.transport.messages import (
    FileTransferPart,
    FileTransferStartUpload,
    GuiUpdateMessage,
    check_update,
)
from t2twin.studio.warmup import Shared, get_ready

if TYPE_CHECKING:
    from t2twin.studio.page import Page
    from t2twin.studio.press_state import PressState

HOST, PORT = "127.0.0.1", 8080
"""Where the page is unless asked otherwise: on this machine alone."""

MAX_PORT = 65_535
"""The largest number of a port (RFC 9293)."""

LAST_PRESS_S = 60.0
"""How long the last press of a page is waited for before its memory is given back, s."""

FOLDER = "t2twin-studio"
"""What the names of the folders for clients' files begin with, among the temporary ones."""

OPEN_TO_OTHERS = (
    "t2twin: everyone who can reach this machine can open the page, press what they like and have "
    "it compute; --host 127.0.0.1 keeps it to yourself"
)
"""What is said where the page is not for this machine alone."""


class Studio:
    """A running studio; `studio` makes one. pages: the clients', by their numbers."""

    def __init__(self, host: str, port: int, shared: Shared, gate: Gate) -> None:
        self._shared = shared
        self.pages: dict[int, Page] = {}
        with redirect_stdout(io.StringIO()), guarded_server(gate):  # viser's own greeting
            self._server = _Server(host, port, verbose=False)
        name = f"[{host}]" if ":" in host else host
        self.address = f"http://{name}:{self._server.get_port()}"
        self._server.on_client_connect(self._connected)
        self._server.on_client_disconnect(self._gone)

    def link(self, state: "PressState") -> str:
        """A link that opens the page on a press. Raises T2TwinError for a press with a file."""
        return _link(self.address, state)

    def runs_found(self) -> None:
        """Tells all pages."""
        for page in list(self.pages.values()):
            page.runs_changed()

    def close(self) -> None:
        """No more pages; those that are open say that they have lost it."""
        for page in list(self.pages.values()):
            page.close()
        with redirect_stdout(io.StringIO()):  # viser's farewell
            self._server.stop()

    def _connected(self, client: viser.ClientHandle) -> None:
        from t2twin.studio.page import Page
        from t2twin.studio.press_state import PressState, read_query

        connection = self._connection(client)
        if connection is None:
            return  # it is gone already
        buffer = client._websock_connection.get_message_buffer()
        buffer._warned_push_after_done = True  # a press ends after its page
        connection.unsent = lambda: len(buffer.message_from_id)
        connection.check = partial(self._check, client)
        request = connection.request
        assert request is not None
        address = request.headers.get("Origin", self.address)
        query = urlsplit(request.path).query
        state, error = PressState(), None
        try:
            state = read_query(query)
        except T2TwinError as refused:
            error = refused
        page = Page(client, self._shared, state, lambda state: _link(address, state))
        self.pages[client.client_id] = page
        page.runs_changed()  # where they were found while the page was made
        if error is not None:
            Notices(client).wrong(error)
        if client.client_id not in self._server.get_clients():
            self._gone(client)

    def _gone(self, client: viser.ClientHandle) -> None:
        page = self.pages.pop(client.client_id, None)
        if page is not None:
            page.close()
            page.join(LAST_PRESS_S)
            del page
            _release_memory()

    def _connection(self, client: viser.ClientHandle) -> Connection | None:
        """A client's connection, which viser does not hand on; None where it is closed."""
        connection = self._server._websock_server._live_connections.get(client.client_id)
        return connection if isinstance(connection, Connection) else None

    def _check(self, client: viser.ClientHandle, message: object) -> bool:
        """Whether viser is to have a message. Raises T2TwinError for one that no page sends."""
        if isinstance(message, GuiUpdateMessage):
            check_update(client.gui, message)
        elif isinstance(message, FileTransferStartUpload):
            return self._shared.uploads.begins(client, message)
        elif isinstance(message, FileTransferPart):
            return self._shared.uploads.goes_on(client, message)
        return True


class _Server(viser.ViserServer):
    """viser's, which never opens a way into this machine from elsewhere."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        return None


@contextmanager
def studio(
    runs: Sequence[Path] = (),
    host: str = HOST,
    port: int = PORT,
    source: str | None = None,
    background: Path | None = None,
    allow_origins: Sequence[str] = (),
) -> Iterator[Studio]:
    """A studio that serves its page within the block.

    runs: folders of trained runs; without any, those below `runs` are found. source: frames to look
    at, as for `t2twin live`. background: an image of the same DIGIT with nothing touching it, which
    field runs compare frames with. allow_origins: pages elsewhere that may connect, such as that of
    a proxy. Raises T2TwinError for a folder that is no run, a source that gives no frames, a file
    that is no image, a host and port that cannot be listened at, and for what is no origin.
    """
    _check_free(host, port)
    gate = Gate(host, allow_origins)
    translators = Translators()
    if runs:
        translators.search(runs)
    frames = None if source is None else Frames(source)
    frame = None if background is None else read_frame(background)
    place = Path(tempfile.gettempdir())
    remove_leftovers(place, f".{FOLDER}-*.part")
    with temporary_folder(place, f"{FOLDER}-{uuid4().hex}") as folder:
        folder.chmod(0o700)
        shared = Shared(translators, folder, frames, frame)
        served = Studio(host, port, shared, gate)
        threading.Thread(target=_get_ready, args=(shared, served, not runs), daemon=True).start()
        yield served
        served.close()  # not where it is ended by a signal: that would take seconds


def _release_memory() -> None:
    """Gives back what a page held: it is full of cycles, and malloc keeps what is freed (measured:
    50 MB a page)."""
    gc.collect()
    with suppress(OSError, AttributeError):  # another C library than glibc
        ctypes.CDLL(None).malloc_trim(0)


def is_own(host: str) -> bool:
    """Whether only this machine can reach an address. Raises T2TwinError where it is none."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        raise T2TwinError(
            f"{host[:40]!r} cannot be listened at; give an address of this machine, as 127.0.0.1 "
            "or 0.0.0.0"
        ) from None


def _check_free(host: str, port: int) -> None:
    """Raises T2TwinError where host and port cannot be listened at; viser would try for ever."""
    is_own(host)
    if not 0 <= port <= MAX_PORT:
        raise T2TwinError(f"port {port} cannot be listened at; allowed are 0 to {MAX_PORT}")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as tried:
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind((host, port))
    except OSError as error:
        raise T2TwinError(
            f"{host}, port {port} cannot be listened at ({(error.strerror or 'refused').lower()}); "
            "name another with --host and --port"
        ) from error


def _get_ready(shared: Shared, served: Studio, search: bool) -> None:
    get_ready(shared, search)
    served.runs_found()


def _link(address: str, state: "PressState") -> str:
    """A link that opens the page on a press.

    viser's page connects to the socket that its address names under `websocket`, and hands the
    query of that on; a query of the page itself it leaves out.
    """
    parts = urlsplit(address)
    scheme = "wss" if parts.scheme == "https" else "ws"
    socket = f"{scheme}://{parts.netloc}/?{state.query()}"
    return f"{address}/?websocket={quote(socket, safe='')}"
