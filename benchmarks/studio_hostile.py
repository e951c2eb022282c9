"""Hostile clients of the studio: each must be refused or bounded, and others are served meanwhile.

python -m benchmarks.studio_hostile [SCRIPT ...]
"""

import contextlib
import json
import socket
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

from websockets.exceptions import WebSocketException

from benchmarks.studio_client import (
    CAMERA,
    PATIENCE_S,
    PROTOCOL,
    Client,
    Target,
    target,
    try_connect,
)
from t2twin.studio.transport.log import BURST

MAX_GROWTH_MB = 300.0
"""Most that the studio may hold more after a script than before it, MB."""

MAX_LINES = 1.2 * BURST
"""Most lines that one script may have printed."""

PART_BYTES = 512 * 1024

Script = Callable[[Target], None]


def evil_origin(studio: Target) -> None:
    """A page of another site."""
    _refused(studio, origin="http://evil.example")


def null_origin(studio: Target) -> None:
    """A page without an origin, such as one in a sandboxed frame."""
    _refused(studio, origin="null")


def other_port(studio: Target) -> None:
    """A page of another server of the same machine."""
    _refused(studio, origin="http://127.0.0.1:1")


def origin_that_begins_right(studio: Target) -> None:
    """Origins that hold the studio's own as a part."""
    for origin in (f"{studio.address}.evil.example", f"{studio.address}@evil.example", "http://"):
        _refused(studio, origin=origin)


def evil_host(studio: Target) -> None:
    """A name that a hostile name server points at this machine (DNS rebinding)."""
    port = urlsplit(studio.address).port
    for host in (f"evil.example:{port}", "evil.example", "127.0.0.1.evil.example", "", "[", "::"):
        assert _status(studio, f"Host: {host}") == 403
        assert _status(studio, f"Host: {host}", *_upgrade()) == 403


def no_host(studio: Target) -> None:
    """No Host header, and two."""
    host = urlsplit(studio.address).netloc
    assert _status(studio) in (400, 403)
    assert _status(studio, f"Host: {host}", "Host: evil.example") == 403


def evil_origin_of_files(studio: Target) -> None:
    """A page of another site asks for the page's files."""
    host = f"Host: {urlsplit(studio.address).netloc}"
    assert _status(studio, host) == 200
    assert _status(studio, host, "Origin: http://evil.example") == 403


def files_of_the_machine(studio: Target) -> None:
    """Paths that lead out of the page's folder."""
    host = f"Host: {urlsplit(studio.address).netloc}"
    for path in ("/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/..\\..\\x"):
        assert _status(studio, host, path=path) == 404


def no_http(studio: Target) -> None:
    """What is no HTTP."""
    for raw in (
        b"\x16\x03\x01\x00",
        b"POST / HTTP/1.1\r\n\r\n",
        b"\n" * 100,
        b"GET " + b"x" * 10_000,
    ):
        with _connection(studio) as connection, contextlib.suppress(ConnectionError):
            connection.sendall(raw + b"\r\n\r\n")
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(65_536):
                pass


def other_version(studio: Target) -> None:
    """A page of another version of viser, and none of it."""
    host = f"Host: {urlsplit(studio.address).netloc}"
    assert _status(studio, host, *_upgrade("viser-v0.0.1")) == 400
    assert _status(studio, host, *_upgrade(None)) == 400


def half_requests(studio: Target) -> None:
    """Many that send half a request, and wait."""
    with contextlib.ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(_connection(studio)).sendall(b"GET / HTTP/1.1\r\nHost:")
        _serves_others(studio)


def many_sockets(studio: Target) -> None:
    """Many that send nothing."""
    with contextlib.ExitStack() as stack:
        for _ in range(400):
            stack.enter_context(_connection(studio))
    _wait_for_room(studio)
    _serves_others(studio)


def many_pages(studio: Target) -> None:
    """Many pages at once, which read nothing."""
    clients = []
    with contextlib.suppress(WebSocketException):
        for _ in range(40):
            clients.append(Client(studio.address))
            clients[-1].send(CAMERA)
    assert 0 < len(clients) < 20
    for client in clients:
        client.close()


def flood_of_junk(studio: Target) -> None:
    """Thousands of messages that are none."""
    with _page(studio) as client:
        for _ in range(5000):
            client.send_raw(b"\xc1junk")
        assert client.wait_closed()


def flood_of_values(studio: Target) -> None:
    """Thousands of good values."""
    with _page(studio) as client:
        for number in range(3000):
            client.set("x, mm", (number % 100) / 10)
            client.take()
        assert client.serves()


def flood_of_clicks(studio: Target) -> None:
    """Hundreds of clicks on what is slow."""
    with _page(studio) as client:
        for _ in range(300):
            client.set("Download this press (zip)", True)
            client.set("Current image, with noise", True)
            client.take()
        assert client.serves()


def attributes(studio: Target) -> None:
    """Values for what is no control's value: the callbacks, and whether it is there."""
    with _page(studio) as client:
        uuid = client.controls["force, N"]["uuid"]
        for name in ("update_cb", "removed", "props", "value_", "__class__"):
            client.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {name: []}})
        assert client.serves()


def junk_values(studio: Target) -> None:
    """Values that no control can have, for each of them."""
    for value in (float("nan"), 1e308, "x" * 1000, None, {}):
        with _page(studio) as client:
            for label in client.controls:
                client.set(label, value)
            assert client.wait_closed()  # after the first ones


def cameras(studio: Target) -> None:
    """Cameras that are nowhere, and views without a size."""
    client = Client(studio.address)
    for changes in ({"image_height": 0}, {"position": [float("nan")] * 3}, {"fov": float("inf")}):
        client.send(CAMERA | changes)
    assert client.open_page().serves()
    client.close()


def huge_message(studio: Target) -> None:
    """Messages of megabytes."""
    for raw in (bytes(8_000_000), "x" * 8_000_000, b"\x91" * 2_000_000):
        with _page(studio) as client:
            client.send_raw(raw)
            assert client.wait_closed()


def unfinished_uploads(studio: Target) -> None:
    """Sixty files of 57 MB, each without its last part."""
    with _page(studio) as client:
        for number in range(60):
            _begin(client, f"u{number}", 57_000_000, 109)
            for part in range(4 if number else 108):
                _part(client, f"u{number}", part, bytes(PART_BYTES))
        assert client.serves()


def unfinished_uploads_of_many(studio: Target) -> None:
    """Several clients with a file each that never ends."""
    with contextlib.ExitStack() as stack:
        clients = [stack.enter_context(_page(studio)) for _ in range(5)]
        for client in clients:
            _begin(client, "a", 60_000_000, 115)
            for part in range(110):
                _part(client, "a", part, bytes(PART_BYTES))
            assert client.serves()


def upload_larger_than_said(studio: Target) -> None:
    """A file of 10 bytes, with parts of half a megabyte."""
    with _page(studio) as client:
        for number in range(10):
            _begin(client, f"u{number}", 10, 2)
            _part(client, f"u{number}", 0, bytes(PART_BYTES))
        assert client.serves()


def parts_in_disorder(studio: Target) -> None:
    """Parts that come twice, too many, and those of no file."""
    with _page(studio) as client:
        for number, parts in enumerate(((0, 0), (2,), (511,), (1, 1), (0, 5))):
            _begin(client, f"u{number}", 20, 2)
            for part in parts:
                _part(client, f"u{number}", part, bytes(10))
        _part(client, "none", 0, b"x")
        assert client.serves()


def upload_shorter_than_said(studio: Target) -> None:
    """A file whose parts have not the bytes that it said."""
    with _page(studio) as client:
        _begin(client, "a", 1000, 2)
        _part(client, "a", 0, b"x")
        _part(client, "a", 1, b"x")
        assert client.serves()


def upload_to_a_slider(studio: Target) -> None:
    """A file for a control that takes none, also for its last part only."""
    with _page(studio) as client:
        _begin(client, "a", 10, 1, to="force, N")
        _begin(client, "b", 10, 1)
        _part(client, "b", 0, bytes(10), to="force, N")
        assert client.serves()


def names_of_files(studio: Target) -> None:
    """Names that lead elsewhere."""
    with _page(studio) as client:
        for number, name in enumerate(("../../x.stl", "/etc/passwd", "\0.stl", "a\n.stl", "", ".")):
            _begin(client, f"u{number}", 4, 1, name=name)
            _part(client, f"u{number}", 0, b"evil")
        assert client.serves()


def many_small_uploads(studio: Target) -> None:
    """Thousands of files that begin and never go on, and of empty ones."""
    with _page(studio) as client:
        for number in range(2000):
            _begin(client, f"u{number}", 10, 1)
            _begin(client, f"e{number}", 0, 0)
            client.take()
        assert client.serves()


def never_reads(studio: Target) -> None:
    """A client that asks for more and more and takes none of it."""
    clients = [Client(studio.address).open_page() for _ in range(3)]
    for client in clients:
        for number in range(300):
            client.set("force, N", 1.0 + number / 20)
            client.set("Download this press (zip)", True)
    _serves_others(studio)
    for client in clients:
        client.close()


SCRIPTS: dict[str, Script] = {
    script.__name__: script
    for script in (
        evil_origin, null_origin, other_port, origin_that_begins_right, evil_host, no_host,
        evil_origin_of_files, files_of_the_machine, no_http, other_version, half_requests,
        many_sockets, many_pages, flood_of_junk, flood_of_values, flood_of_clicks, attributes,
        junk_values, cameras, huge_message, unfinished_uploads, unfinished_uploads_of_many,
        upload_larger_than_said, parts_in_disorder, upload_shorter_than_said, upload_to_a_slider,
        names_of_files, many_small_uploads, never_reads,
    )
}  # fmt: skip

SLOW = ("half_requests", "many_sockets", "many_pages", "flood_of_junk", "flood_of_values",
        "flood_of_clicks", "unfinished_uploads", "unfinished_uploads_of_many", "many_small_uploads",
        "never_reads", "huge_message", "junk_values", "names_of_files")  # fmt: skip
"""Those that take seconds."""


def attack(name: str, studio: Target, other: Client) -> dict[str, Any]:
    """Runs a script. other: a client that is served before it, and must be after it.

    Returns by how many MB the studio `grew`, how many `lines` it printed, and its `faults`.
    """
    before_mb, known = studio.memory_mb, len(studio.lines)
    SCRIPTS[name](studio)
    faults = [] if other.serves() else ["the other client is not served"]
    until_s = time.monotonic() + PATIENCE_S  # pages that are closed give back what they held
    while studio.memory_mb - before_mb > MAX_GROWTH_MB and time.monotonic() < until_s:
        time.sleep(0.1)
    lines, grown_mb = studio.lines[known:], studio.memory_mb - before_mb
    faults += [line for line in lines if not line.startswith("t2twin: ") or "error" in line]
    if len(lines) > MAX_LINES:
        faults.append(f"{len(lines)} lines")
    if grown_mb > MAX_GROWTH_MB:
        faults.append(f"{grown_mb:.0f} MB more")
    return {"grown_mb": round(grown_mb, 1), "lines": len(lines), "faults": faults}


def _refused(studio: Target, **options: Any) -> None:
    assert try_connect(studio.address, **options) == 403


def _serves_others(studio: Target) -> None:
    with _page(studio) as client:
        assert client.serves()


@contextlib.contextmanager
def _page(studio: Target) -> Iterator[Client]:
    _wait_for_room(studio)
    client = Client(studio.address).open_page()
    try:
        yield client
    finally:
        client.close()


def _wait_for_room(studio: Target) -> None:
    """Wait until the studio has noticed that earlier clients are gone."""
    until_s = time.monotonic() + PATIENCE_S
    while try_connect(studio.address) != 101 and time.monotonic() < until_s:
        time.sleep(0.1)


def _begin(client: Client, transfer: str, size: int, parts: int, **other: str) -> None:
    client.send({
        "type": "FileTransferStartUpload", "transfer_uuid": transfer,
        "source_component_uuid": client.controls[other.get("to", "Upload a shape")]["uuid"],
        "filename": other.get("name", "a.stl"), "mime_type": "", "part_count": parts,
        "size_bytes": size,
    })  # fmt: skip


def _part(
    client: Client, transfer: str, index: int, content: bytes, to: str = "Upload a shape"
) -> None:
    client.send({
        "type": "FileTransferPart", "transfer_uuid": transfer, "part_index": index,
        "source_component_uuid": client.controls[to]["uuid"], "content": content,
    })  # fmt: skip


def _connection(studio: Target) -> socket.socket:
    place = urlsplit(studio.address)
    assert place.hostname is not None and place.port is not None
    return socket.create_connection((place.hostname, place.port), 30)


def _upgrade(protocol: str | None = PROTOCOL) -> tuple[str, ...]:
    headers = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
               "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==")  # fmt: skip
    return headers if protocol is None else (*headers, f"Sec-WebSocket-Protocol: {protocol}")


def _status(studio: Target, *headers: str, path: str = "/") -> int:
    """The status of the answer to a request with these headers alone."""
    with _connection(studio) as connection:
        request = "\r\n".join((f"GET {path} HTTP/1.1", *headers, "", ""))
        connection.sendall(request.encode())
        answer = connection.recv(65_536).decode("latin-1")
    return int(answer.split()[1])


if __name__ == "__main__":
    with target() as studio:
        other = Client(studio.address).open_page()
        other.wait_for(lambda: other.has_intervals)
        for name in sys.argv[1:] or SCRIPTS:
            print(name, json.dumps(attack(name, studio, other)), flush=True)
