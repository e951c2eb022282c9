"""Server of the studio: one page for each client.

It listens before the twin is imported, which takes seconds, so that the browser can load the page
in the meantime.
"""

import io
import socket
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING
from uuid import uuid4

import viser

from t2twin.core.errors import T2TwinError
from t2twin.core.files import temporary_folder
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.studio.translators import Shared

if TYPE_CHECKING:
    from t2twin.studio.page import Page

HOST, PORT = "127.0.0.1", 8080
"""Default address, reachable from this machine only."""


class Studio(viser.ViserServer):
    """A running studio, created by `studio`. address: of the page. pages: by client number."""

    def __init__(self, host: str, port: int, shared: Shared) -> None:
        self._shared = shared
        self.pages: dict[int, Page] = {}
        with redirect_stdout(io.StringIO()):  # hides viser's message
            super().__init__(host, port, verbose=False)
        self.on_client_connect(self._connected)
        self.on_client_disconnect(self._gone)
        name = f"[{host}]" if ":" in host else host
        self.address = f"http://{name}:{self.get_port()}"

    def request_share_url(self, verbose: bool = True) -> str | None:
        """No public tunnel to this machine, which any page could request."""
        return None

    def _connected(self, client: viser.ClientHandle) -> None:
        from t2twin.studio.page import Page

        self.pages[client.client_id] = Page(client, self._shared)
        if client.client_id not in self.get_clients():
            self._gone(client)

    def _gone(self, client: viser.ClientHandle) -> None:
        page = self.pages.pop(client.client_id, None)
        if page is not None:
            page.close()


@contextmanager
def studio(
    runs: Sequence[Path] = (),
    host: str = HOST,
    port: int = PORT,
    source: str | None = None,
    background: Path | None = None,
    order: FrameOrder = UPRIGHT,
) -> Iterator[Studio]:
    """Serves the studio within the block.

    Other arguments: see `Shared`. Raises T2TwinError as `Shared`, and for an unusable host or port.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:  # viser would take another port, and try an unusable host forever
        socket.create_server((host, port), family=family).close()
    except (OSError, OverflowError) as error:
        raise T2TwinError(f"cannot listen on {host}, port {port}: {error}") from error
    with temporary_folder(Path(tempfile.gettempdir()), f"t2twin-studio-{uuid4().hex}") as folder:
        served = Studio(host, port, Shared(folder, runs, source, background, order))
        Thread(target=import_module, args=("t2twin.studio.page",), daemon=True).start()
        yield served
        with redirect_stdout(io.StringIO()):  # skipped after a signal, because it takes seconds
            served.stop()
