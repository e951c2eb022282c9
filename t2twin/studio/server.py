"""Server of the studio: one page for each client.

It listens before the twin is imported, which takes seconds, so that the browser can load the page
in the meantime.
"""

import io
import socket
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout, suppress
from importlib import import_module
from pathlib import Path
from threading import Lock, Thread
from typing import TYPE_CHECKING
from uuid import uuid4

import numpy as np
import viser

from t2twin.core.errors import T2TwinError
from t2twin.core.files import temporary_folder
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.live.sources import LatestFrame, open_source
from t2twin.studio.translators import Translators

if TYPE_CHECKING:
    from t2twin.studio.page import Page

HOST, PORT = "127.0.0.1", 8080
"""Default address, reachable from this machine only."""


NamedFrame = tuple[np.ndarray, str]
"""A frame, (h, w, 3) or (h, w) uint8, and its name."""


class Studio(viser.ViserServer):
    """A running studio, and what its pages share. address: of the page. pages: by client number.

    folder: of the clients' files. runs: folders of trained runs; if empty, runs in the folder
    `runs` are found. source: frames to translate, as for `t2twin live`. background: background
    frame of the same sensor. order: of all stored frames. Raises T2TwinError for an invalid run,
    source or image.
    """

    def __init__(
        self, host: str, port: int, folder: Path, runs: Sequence[Path], source: str | None,
        background: Path | None, order: FrameOrder,
    ) -> None:  # fmt: skip
        self.folder, self.source, self._order = folder, source, order
        self.background = None if background is None else self.read_frame(background)
        self._frames = None if source is None else open_source(source, order)
        self._latest: LatestFrame | None = None
        self._translators = Translators(runs) if runs else None
        self._lock = Lock()
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

    def read_frame(self, path: Path) -> NamedFrame:
        """Reads an image file. Raises T2TwinError if it is not an image."""
        from t2twin.translate.data.images import read_image

        return read_image(path, self._order), path.name

    def translators(self) -> Translators:
        """The translators; imports torch."""
        with self._lock:
            if self._translators is None:
                self._translators = Translators()
            return self._translators

    def latest_frames(self) -> LatestFrame:
        """The latest frames of the source from now on; restarts a video that has ended."""
        with self._lock:
            if self._latest is None or self._latest.ended:
                assert self.source is not None
                self._latest = LatestFrame(self._frames or open_source(self.source, self._order))
                self._frames = None
            return self._latest

    def source_files(self) -> list[Path]:
        """The image files of a source that is a folder, sorted by name; else none."""
        from t2twin.translate.inference.files import find_images

        if self.source is not None and not self.source.isdigit() and Path(self.source).is_dir():
            with suppress(T2TwinError):  # a folder without images so far
                return find_images([self.source])
        return []

    def _connected(self, client: viser.ClientHandle) -> None:
        from t2twin.studio.page import Page

        self.pages[client.client_id] = Page(client, self)
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

    Other arguments: see `Studio`. Raises T2TwinError as `Studio`, and for an unusable host or port.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:  # viser would take another port, and try an unusable host forever
        socket.create_server((host, port), family=family).close()
    except (OSError, OverflowError) as error:
        raise T2TwinError(f"cannot listen on {host}, port {port}: {error}") from error
    with temporary_folder(Path(tempfile.gettempdir()), f"t2twin-studio-{uuid4().hex}") as folder:
        served = Studio(host, port, folder, runs, source, background, order)
        Thread(target=import_module, args=("t2twin.studio.page",), daemon=True).start()
        yield served
        with redirect_stdout(io.StringIO()):  # skipped after a signal, because it takes seconds
            served.stop()
