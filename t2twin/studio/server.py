"""Server of the studio: one page for each client.

It listens before the twin is imported, which takes seconds, so that the browser can load the page
in the meantime.
"""

import io
import socket
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING
from uuid import uuid4

import viser

from t2twin.core.errors import T2TwinError
from t2twin.core.files import temporary_folder
from t2twin.studio.translators import Shared, read_frame

if TYPE_CHECKING:
    from t2twin.studio.page import Page

HOST, PORT = "127.0.0.1", 8080
"""Default address, reachable from this machine only."""

PAGE_TIMEOUT_S = 10.0
"""Maximum time for which loading of translators waits for a first page (assumed: the start of a
browser). PyTorch takes seconds to import, which would delay the first image."""


class Studio(viser.ViserServer):
    """A running studio, created by `studio`. address: of the page. pages: by client number."""

    def __init__(self, host: str, port: int, shared: Shared) -> None:
        self.shared = shared
        self.pages: dict[int, Page] = {}
        with redirect_stdout(io.StringIO()):  # hides viser's message
            super().__init__(host, port, verbose=False)
        name = f"[{host}]" if ":" in host else host
        self.address = f"http://{name}:{self.get_port()}"

    def request_share_url(self, verbose: bool = True) -> str | None:
        """No public tunnel to this machine, which any page could request."""
        return None

    def warm_up(self, search: bool) -> None:
        """Presses once, then loads the default translators, and accepts clients meanwhile.

        search: whether to search for runs in the folder `runs`.
        """
        self.on_client_connect(self._connected)
        self.on_client_disconnect(self._gone)
        from t2twin.studio.session import PressState, Session

        try:
            Session(self.shared.translators, self.shared.sensors).press(PressState())
        finally:
            self.shared.is_ready.set()
        self.shared.is_shown.wait(PAGE_TIMEOUT_S)
        if search:
            self.shared.translators.search()
        for page in list(self.pages.values()):
            page.update_runs()
        self.shared.translators.load(self.shared.translators.default_names)

    def _connected(self, client: viser.ClientHandle) -> None:
        from t2twin.studio.page import Page

        page = self.pages[client.client_id] = Page(client, self.shared)
        page.update_runs()  # runs found during the creation of the page
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
) -> Iterator[Studio]:
    """Serves the studio within the block.

    runs: folders of trained runs; if empty, runs in the folder `runs` are found. source: frames to
    translate, as for `t2twin live`. background: background frame of the same sensor, for field
    runs. Raises T2TwinError for an invalid run, source or image, and for an unusable host and port.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:  # viser would take another port, and try an unusable host forever
        socket.create_server((host, port), family=family).close()
    except (OSError, OverflowError) as error:
        raise T2TwinError(f"cannot listen on {host}, port {port}: {error}") from error
    with temporary_folder(Path(tempfile.gettempdir()), f"t2twin-studio-{uuid4().hex}") as folder:
        shared = Shared(folder, source, None if background is None else read_frame(background))
        if runs:
            shared.translators.search(runs)
        served = Studio(host, port, shared)
        Thread(target=served.warm_up, args=(not runs,), daemon=True).start()
        yield served
        with redirect_stdout(io.StringIO()):  # skipped after a signal, because it takes seconds
            served.stop()
