"""A client of the studio without a browser: it speaks viser's protocol, and can break it.

Run as a module it tries messages: a line of JSON on standard input for each, a line with what came
of it on standard output.
"""

import contextlib
import json
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

from benchmarks import ROOT
from t2twin.core.errors import T2TwinError

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")

PATIENCE_S = 60.0
"""How long an answer is waited for, s."""

OPEN_S = 300.0
"""How long a page's first picture is waited for, s: it may have to compile."""

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, -50.0, 50.0],
    "fov": 1.3,
    "near": 1.0,
    "far": 1000.0,
    "image_height": 900,
    "image_width": 1400,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
"""The first message of a page."""


class Client:
    """A connection to a studio. controls: what can be set, by label: uuid and properties.
    pictures: how often it was sent new ones. has_intervals: whether the pretrained run's were among
    them."""

    def __init__(self, address: str, **options: Any) -> None:
        self.controls: dict[str, dict[str, Any]] = {}
        self.pictures, self.has_intervals, self._force_n = 0, False, 5.0
        self._socket = websockets.sync.client.connect(
            address.replace("http", "ws", 1),
            subprotocols=[PROTOCOL],
            compression=None,
            max_size=None,
            open_timeout=PATIENCE_S,
            close_timeout=1.0,
            proxy=None,
            **options,
        )

    def send(self, message: dict[str, Any]) -> None:
        self.send_raw(msgspec.msgpack.encode(message))

    def send_raw(self, raw: bytes | str) -> None:
        """Sends what it likes; a connection that is closed meanwhile takes nothing."""
        with contextlib.suppress(ConnectionClosed):
            self._socket.send(raw)

    def set(self, label: str, value: Any) -> None:
        """Gives a control a value."""
        uuid = self.controls[label]["uuid"]
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def open_page(self) -> "Client":
        """Waits for the page's first pictures."""
        self.send(CAMERA)
        if not self.wait_for(lambda: self.pictures > 0, OPEN_S):
            raise T2TwinError(f"the page shows nothing after {OPEN_S:g} s")
        return self

    def serves(self) -> bool:
        """Whether another force gives other pictures."""
        known = self.pictures
        self._force_n = 11.0 - self._force_n
        self.set("force, N", self._force_n)
        return self.wait_for(lambda: self.pictures > known)

    def wait_for(self, holds: Callable[[], bool], patience_s: float = PATIENCE_S) -> bool:
        """Reads until something holds; False where the studio closed the connection, or took too
        long."""
        until_s = time.monotonic() + patience_s
        try:
            while not holds():
                self._read(until_s - time.monotonic())
        except (ConnectionClosed, TimeoutError):
            return False
        return True

    def take(self) -> None:
        """Reads what there is."""
        with contextlib.suppress(ConnectionClosed, TimeoutError):
            while True:
                self._read(0.0)

    def wait_closed(self) -> bool:
        """Whether the studio closes the connection."""
        self.wait_for(lambda: False)
        return self._socket.state.name == "CLOSED"

    @property
    def is_open(self) -> bool:
        return self._socket.state.name == "OPEN"

    def close(self) -> None:
        self._socket.close()

    def _read(self, timeout_s: float) -> None:
        raw = self._socket.recv(timeout=max(timeout_s, 0.0))
        assert isinstance(raw, bytes)
        size = int.from_bytes(raw[8:16], "little")
        content = zstandard.ZstdDecompressor().decompress(raw[16 : 16 + size])
        for message in msgspec.msgpack.decode(content)["messages"]:
            label = message.get("props", {}).get("label") if "uuid" in message else None
            if label:
                self.controls[label] = message
            updates = message.get("updates")
            if isinstance(updates, dict) and "data-name" in str(updates.get("content")):
                self.pictures += 1
                self.has_intervals |= 'data-name="intervals"' in updates["content"]


def try_connect(address: str, **options: Any) -> int:
    """The HTTP status that a connection is answered with: 101 where it is taken."""
    try:
        Client(address, **options).close()
    except WebSocketException as error:
        response = getattr(error, "response", None)
        return 0 if response is None else response.status_code
    return 101


class Target:
    """A studio in a process of its own. address: of its page."""

    def __init__(self, process: subprocess.Popen, said: Path) -> None:
        self._process, self._said = process, said
        assert process.stdout is not None
        self.address = process.stdout.readline().split()[1]

    @property
    def memory_mb(self) -> float:
        """What the process holds, MB."""
        words = Path(f"/proc/{self._process.pid}/statm").read_text().split()
        return int(words[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    @property
    def lines(self) -> list[str]:
        """What it printed on standard error."""
        return self._said.read_text(errors="replace").splitlines()

    @property
    def is_running(self) -> bool:
        return self._process.poll() is None


@contextlib.contextmanager
def target(*arguments: str) -> Iterator[Target]:
    """A studio on a free port, from within an empty folder."""
    with tempfile.TemporaryDirectory(prefix="t2twin-studio-target-") as folder:
        said = Path(folder) / "said"
        (Path(folder) / "box").mkdir()
        with said.open("wb") as errors:
            process = subprocess.Popen(
                [sys.executable, "-m", "t2twin", "studio", "--port", "0", *arguments],
                cwd=Path(folder) / "box", stdout=subprocess.PIPE, stderr=errors, text=True,
                env=os.environ | {"PYTHONPATH": str(ROOT)},
            )  # fmt: skip
        try:
            yield Target(process, said)
        finally:
            process.terminate()
            process.communicate()


def try_message(studio: Target, client: Client, request: dict[str, Any]) -> dict[str, Any]:
    """Sends one message; then the client, or another where it was closed, must still be served.

    request: `message`, `raw` (hexadecimal) or `text`. Returns the `lines` that were printed, and
    whether it `serves`.
    """
    known = len(studio.lines)
    if "message" in request:
        client.send(_filled(request["message"], client.controls))
    else:
        client.send_raw(bytes.fromhex(request["raw"]) if "raw" in request else request["text"])
    serves = client.serves()
    if not serves and not client.is_open:
        another = Client(studio.address).open_page()
        serves = another.serves()
        another.close()
    return {"lines": studio.lines[known:], "serves": serves}


def _filled(value: Any, controls: dict[str, dict[str, Any]]) -> Any:
    """A value of JSON with the places for identifiers, `{"$uuid": label}`, and bytes, `{"$hex":
    digits}`, filled."""
    if isinstance(value, list):
        return [_filled(each, controls) for each in value]
    if not isinstance(value, dict):
        return value
    if list(value) == ["$uuid"]:
        return controls[value["$uuid"]]["uuid"]
    if list(value) == ["$hex"]:
        return bytes.fromhex(value["$hex"])
    return {name: _filled(each, controls) for name, each in value.items()}


def main() -> None:
    with target() as studio:
        client = Client(studio.address).open_page()
        print("ready", flush=True)
        for line in sys.stdin:
            if not client.is_open:
                client = Client(studio.address).open_page()
            print(json.dumps(try_message(studio, client, json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
