"""Server of the studio: one page for each client.

It listens before the twin is imported, which takes seconds, so that the browser can load the page
in the meantime.
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
from t2twin.studio.access import OriginCheck, checked_server
from t2twin.studio.shared import FrameSource, SharedState, read_frame, warm_up
from t2twin.studio.tasks import Notices
from t2twin.studio.translators import Translators

if TYPE_CHECKING:
    from t2twin.studio.page import Page
    from t2twin.studio.press_state import PressState

HOST, PORT = "127.0.0.1", 8080
"""Default address, reachable from this machine only."""

MAX_PORT = 65_535
"""Largest port number (RFC 9293)."""

LAST_PRESS_S = 60.0
"""Maximum wait for the last press of a page before its memory is released, s."""

FOLDER = "t2twin-studio"
"""Prefix of the temporary folders with clients' files."""

EXPOSED_WARNING = (
    "t2twin: everyone who can reach this machine can open the page and use its processors; "
    "--host 127.0.0.1 restricts it to this machine"
)
"""Warning for a page that other machines can reach."""


class Studio:
    """A running studio, created by `studio`. pages: by client number."""

    def __init__(
        self, host: str, port: int, shared: SharedState, origin_check: OriginCheck
    ) -> None:
        self._shared = shared
        self.pages: dict[int, Page] = {}
        with redirect_stdout(io.StringIO()), checked_server(origin_check):  # hides viser's message
            self._server = _Server(host, port, verbose=False)
        name = f"[{host}]" if ":" in host else host
        self.address = f"http://{name}:{self._server.get_port()}"
        self._server.on_client_connect(self._connected)
        self._server.on_client_disconnect(self._gone)

    def link(self, state: "PressState") -> str:
        """A link to a press. Raises T2TwinError for a press with a user's file."""
        return _link(self.address, state)

    def update_runs(self) -> None:
        """Adds new runs to all pages."""
        for page in list(self.pages.values()):
            page.update_runs()

    def close(self) -> None:
        """Closes all pages and stops the server."""
        for page in list(self.pages.values()):
            page.close()
        with redirect_stdout(io.StringIO()):  # hides viser's message
            self._server.stop()

    def _connected(self, client: viser.ClientHandle) -> None:
        from t2twin.studio.page import Page
        from t2twin.studio.press_state import PressState, read_query

        connection = self._server._websock_server._live_connections.get(client.client_id)
        if connection is None or connection.request is None:
            return  # already disconnected
        buffer = client._websock_connection.get_message_buffer()
        buffer._warned_push_after_done = True  # a press may end after its page is closed
        address = connection.request.headers.get("Origin", self.address)
        state, error = PressState(), None
        try:
            state = read_query(urlsplit(connection.request.path).query)
        except T2TwinError as refused:
            error = refused
        page = Page(client, self._shared, state, partial(_link, address))
        self.pages[client.client_id] = page
        page.update_runs()  # runs found during the creation of the page
        if error is not None:
            Notices(client).show_error(error)
        if client.client_id not in self._server.get_clients():
            self._gone(client)

    def _gone(self, client: viser.ClientHandle) -> None:
        page = self.pages.pop(client.client_id, None)
        if page is not None:
            page.close()
            page.join(LAST_PRESS_S)
            del page
            gc.collect()  # a page contains reference cycles
            with suppress(OSError, AttributeError):  # C libraries other than glibc
                ctypes.CDLL(None).malloc_trim(0)  # malloc retains freed memory, 50 MB a page


class _Server(viser.ViserServer):
    """viser's server without its public tunnel to this machine."""

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
    """Serves the studio within the block.

    runs: folders of trained runs; if empty, runs in the folder `runs` are found. source: frames to
    translate, as for `t2twin live`. background: background frame of the same sensor, for field
    runs. allow_origins: additional origins whose pages may connect, such as that of a proxy. Raises
    T2TwinError for an invalid run, source, image or origin, and for an unusable host and port.
    """
    _check_address(host, port)
    origin_check = OriginCheck(host, allow_origins)
    translators = Translators()
    if runs:
        translators.search(runs)
    frames = None if source is None else FrameSource(source)
    frame = None if background is None else read_frame(background)
    place = Path(tempfile.gettempdir())
    remove_leftovers(place, f".{FOLDER}-*.part")
    with temporary_folder(place, f"{FOLDER}-{uuid4().hex}") as folder:
        folder.chmod(0o700)
        shared = SharedState(translators, folder, frames, frame)
        served = Studio(host, port, shared, origin_check)
        warm = partial(warm_up, shared, not runs, served.update_runs)
        threading.Thread(target=warm, daemon=True).start()
        yield served
        served.close()  # skipped after a signal, because it takes seconds


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach an address. Raises T2TwinError for an invalid address."""
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        raise T2TwinError(
            f"cannot listen on {host[:40]!r}; expected an address of this machine, such as "
            "127.0.0.1 or 0.0.0.0"
        ) from None


def _check_address(host: str, port: int) -> None:
    """Raises T2TwinError for an unusable host and port, which viser would retry forever."""
    is_loopback(host)
    if not 0 <= port <= MAX_PORT:
        raise T2TwinError(f"cannot listen on port {port}; expected 0 to {MAX_PORT}")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
    except OSError as error:
        raise T2TwinError(
            f"cannot listen on {host}, port {port} ({(error.strerror or 'refused').lower()}); "
            "choose others with --host and --port"
        ) from error


def _link(address: str, state: "PressState") -> str:
    """A link that opens the page with a press.

    viser's page connects to the WebSocket of the query parameter `websocket` and sends the query of
    that URL to the server. It does not send the other parameters of the page.
    """
    parts = urlsplit(address)
    scheme = "wss" if parts.scheme == "https" else "ws"
    socket = f"{scheme}://{parts.netloc}/?{state.query()}"
    return f"{address}/?websocket={quote(socket, safe='')}"
