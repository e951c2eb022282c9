"""A studio in a process of its own, and a client without a browser, which uses viser's protocol."""

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import viser
import websockets.sync.client
import zstandard
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from t2twin.core.errors import T2TwinError

ROOT = Path(__file__).parents[1]
PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")

PATIENCE_S = 60.0
"""Longest wait for an answer, s."""

OPEN_S = 300.0
"""Longest wait for a page's first image, s: it may have to compile."""

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.0, -50.0, 50.0],
    "fov": 1.3, "near": 1.0, "far": 1000.0, "image_height": 900, "image_width": 1400,
    "look_at": [0.0, 0.0, 0.0], "up_direction": [0.0, 0.0, 1.0],
}  # fmt: skip
"""The first message of a page."""


class Client:
    """A connection to a studio.

    controls: messages with identifier and properties, by label. cards: the last update. notices:
    texts of the notifications so far.
    """

    def __init__(self, address: str, **options: Any) -> None:
        self.controls: dict[str, dict[str, Any]] = {}
        self.notices: list[str] = []
        self.cards, self._command, self._presses = "", "", 0
        self._socket = websockets.sync.client.connect(
            address.replace("http", "ws", 1), subprotocols=[PROTOCOL], compression=None,
            max_size=None, open_timeout=PATIENCE_S, close_timeout=1.0, proxy=None, **options,
        )  # fmt: skip
        self.close = self._socket.close

    def send(self, message: dict[str, Any] | bytes | str) -> None:
        """Sends a message, or raw data. A closed connection takes nothing."""
        raw = msgspec.msgpack.encode(message) if isinstance(message, dict) else message
        with contextlib.suppress(ConnectionClosed):
            self._socket.send(raw)

    def set(self, label: str, value: Any) -> None:
        """Sets the value of a control."""
        uuid = self.controls[label]["uuid"]
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def open_page(self) -> "Client":
        """Waits for the first images."""
        self.send(CAMERA)
        if not self.wait_for(lambda: bool(self.cards), OPEN_S):
            raise T2TwinError(f"the page has no image after {OPEN_S:g} s")
        return self

    def serves(self) -> bool:
        """Whether a press with a force that was not used before is shown with its command line.

        The studio presses only the latest state, and an equal one gives no update.
        """
        self._presses += 1
        force_n = round(5.0 + 0.01 * self._presses, 2)
        self.set("force, N", force_n)
        return self.wait_for(lambda: f"--force-n {force_n:g}" in self._command)

    def wait_for(self, holds: Callable[[], bool], patience_s: float = PATIENCE_S) -> bool:
        """Reads until a condition holds; False if the studio closes the connection or is late."""
        until_s = time.monotonic() + patience_s
        try:
            while not holds():
                self._read(until_s - time.monotonic())
        except (ConnectionClosed, TimeoutError):
            return False
        return True

    def take(self) -> None:
        """Reads what has arrived."""
        with contextlib.suppress(ConnectionClosed, TimeoutError):
            while True:
                self._read(0.0)

    def _read(self, timeout_s: float) -> None:
        raw = self._socket.recv(timeout=max(timeout_s, 0.0))
        assert isinstance(raw, bytes)
        size = int.from_bytes(raw[8:16], "little")
        packed = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size])
        for message in msgspec.msgpack.decode(packed)["messages"]:
            properties = message.get("props", {}) if "uuid" in message else {}
            if label := properties.get("label"):
                self.controls[label] = message
            if message["type"].startswith("Notification"):
                self.notices.append(properties.get("body", ""))
            updates = message.get("updates")
            content = str(updates.get("content")) if isinstance(updates, dict) else ""
            if "data-name" in content:
                self.cards = content
            if "--force-n" in content:
                self._command = content


def try_connect(address: str, **options: Any) -> int:
    """HTTP status of a connection: 101 if it is accepted."""
    try:
        Client(address, **options).close()
    except WebSocketException as error:
        response = getattr(error, "response", None)
        return 0 if response is None else response.status_code
    return 101


class Target:
    """A studio in a process of its own. address: of its page."""

    def __init__(self, process: subprocess.Popen, errors: Path) -> None:
        self._process, self._errors = process, errors
        assert process.stdout is not None
        self.address = process.stdout.readline().split()[1]

    @property
    def lines(self) -> list[str]:
        """Lines on standard error."""
        return self._errors.read_text(errors="replace").splitlines()


@contextlib.contextmanager
def target(*arguments: str) -> Iterator[Target]:
    """A studio on a free port, in an empty folder."""
    with tempfile.TemporaryDirectory(prefix="t2twin-studio-target-") as folder:
        errors, box = Path(folder) / "errors", Path(folder) / "box"
        box.mkdir()
        with errors.open("wb") as file:
            process = subprocess.Popen(
                [sys.executable, "-m", "t2twin", "studio", "--port", "0", *arguments], cwd=box,
                stdout=subprocess.PIPE, stderr=file, text=True,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
            )  # fmt: skip
        try:
            yield Target(process, errors)
        finally:
            process.terminate()
            process.communicate()
