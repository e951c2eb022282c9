"""Hostile clients of the studio are refused or bounded, and other clients are served meanwhile."""

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

import pytest
from browser import PATIENCE_MS, browser
from studio_client import CAMERA, PATIENCE_S, PROTOCOL, Client, Target, target, try_connect
from websockets.exceptions import WebSocketException

from t2twin.studio.transport.log import BURST

MAX_GROWTH_MB = 300.0
"""Memory that the studio may hold in addition after an attack, MB (assumed)."""

MAX_LINES = 1.2 * BURST
"""Lines that one attack may print."""

PART_BYTES = 512 * 1024

ORIGINS = ("http://evil.example", "null", "http://127.0.0.1:1", "HERE.evil.example",
           "HERE@evil.example", "http://")  # fmt: skip
"""Origins of pages of other sites, servers and frames. HERE: the studio's own."""

HOSTS = ("evil.example:PORT", "evil.example", "127.0.0.1.evil.example", "", "[", "::")
"""Host headers as of a hostile name server (DNS rebinding)."""


@pytest.fixture(scope="module")
def studio():
    with target() as studio:
        yield studio


@pytest.fixture(scope="module")
def other(studio):
    """A client that no attack concerns."""
    client = Client(studio.address).open_page()
    assert client.wait_for(lambda: client.has_intervals)
    yield client
    client.close()


@contextlib.contextmanager
def page(studio: Target) -> Iterator[Client]:
    wait_for_room(studio)
    client = Client(studio.address).open_page()
    try:
        yield client
    finally:
        client.close()


def wait_for_room(studio: Target) -> None:
    """Waits until the studio has noticed that earlier clients are gone."""
    until_s = time.monotonic() + PATIENCE_S
    while try_connect(studio.address) != 101 and time.monotonic() < until_s:
        time.sleep(0.1)


def connection(studio: Target) -> socket.socket:
    place = urlsplit(studio.address)
    return socket.create_connection((str(place.hostname), int(place.port or 0)), 30)


def upgrade(protocol: str | None = PROTOCOL) -> tuple[str, ...]:
    headers = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
               "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==")  # fmt: skip
    return headers if protocol is None else (*headers, f"Sec-WebSocket-Protocol: {protocol}")


def status(studio: Target, *headers: str, path: str = "/") -> int:
    """HTTP status of a request with these headers only."""
    with connection(studio) as own:
        own.sendall("\r\n".join((f"GET {path} HTTP/1.1", *headers, "", "")).encode())
        return int(own.recv(65_536).decode("latin-1").split()[1])


def begin(client: Client, transfer: str, size: int, parts: int, to: str = "Upload a shape",
          name: str = "a.stl") -> None:  # fmt: skip
    client.send({"type": "FileTransferStartUpload", "transfer_uuid": transfer, "filename": name,
                 "source_component_uuid": client.controls[to]["uuid"], "mime_type": "",
                 "part_count": parts, "size_bytes": size})  # fmt: skip


def part(client: Client, transfer: str, index: int, content: bytes, to: str = "Upload a shape"):
    client.send({"type": "FileTransferPart", "transfer_uuid": transfer, "part_index": index,
                 "source_component_uuid": client.controls[to]["uuid"],
                 "content": content})  # fmt: skip


def test_pages_of_other_sites_are_refused(studio):
    host = f"Host: {urlsplit(studio.address).netloc}"
    for origin in ORIGINS:
        assert try_connect(studio.address, origin=origin.replace("HERE", studio.address)) == 403
    for name in HOSTS:
        other_host = f"Host: {name.replace('PORT', str(urlsplit(studio.address).port))}"
        assert status(studio, other_host) == status(studio, other_host, *upgrade()) == 403
    assert status(studio) in (400, 403)
    assert status(studio, host, "Host: evil.example") == 403
    assert status(studio, host) == 200
    assert status(studio, host, "Origin: http://evil.example") == 403
    for path in ("/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/..\\..\\x"):
        assert status(studio, host, path=path) == 404
    for protocol in ("viser-v0.0.1", None):
        assert status(studio, host, *upgrade(protocol)) == 400


# Attacks through an open page


def junk(studio: Target, client: Client) -> None:
    for _ in range(5000):
        client.send(b"\xc1junk")
    assert client.wait_closed()


def large_messages(studio: Target, client: Client) -> None:
    for raw in (bytes(8_000_000), "x" * 8_000_000, b"\x91" * 2_000_000):
        with page(studio) as other:
            other.send(raw)
            assert other.wait_closed()


def unfinished_uploads(studio: Target, client: Client) -> None:
    for number in range(60):
        begin(client, f"u{number}", 57_000_000, 109)
        for index in range(4 if number else 108):
            part(client, f"u{number}", index, bytes(PART_BYTES))


def wrong_uploads(studio: Target, client: Client) -> None:
    """Larger, shorter and in other parts than announced, and to a control without uploads."""
    for number in range(10):
        begin(client, f"large{number}", 10, 2)
        part(client, f"large{number}", 0, bytes(PART_BYTES))
    for number, parts in enumerate(((0, 0), (2,), (511,), (1, 1), (0, 5))):
        begin(client, f"parts{number}", 20, 2)
        for index in parts:
            part(client, f"parts{number}", index, bytes(10))
    part(client, "none", 0, b"x")
    begin(client, "short", 1000, 2)
    part(client, "short", 0, b"x")
    part(client, "short", 1, b"x")
    begin(client, "slider", 10, 1, to="force, N")
    for number, name in enumerate(("../../x.stl", "/etc/passwd", "\0.stl", "a\n.stl", "", ".")):
        begin(client, f"name{number}", 4, 1, name=name)
        part(client, f"name{number}", 0, b"evil")
    begin(client, "last", 10, 1)
    part(client, "last", 0, bytes(10), to="force, N")


def small_uploads(studio: Target, client: Client) -> None:
    for number in range(2000):
        begin(client, f"u{number}", 10, 1)
        begin(client, f"e{number}", 0, 0)
        client.take()


def unread_answers(studio: Target, client: Client) -> None:
    clients = [Client(studio.address).open_page() for _ in range(3)]
    for each in clients:
        for number in range(300):
            each.set("force, N", 1.0 + number / 20)
            each.set("Download this press (zip)", True)
    for each in clients:
        each.close()


# Attacks without a page


def no_http(studio: Target, client: Client) -> None:
    for raw in (b"\x16\x03\x01\0", b"POST / HTTP/1.1\r\n\r\n", b"\n" * 100, b"GET " + b"x" * 9999):
        with connection(studio) as own, contextlib.suppress(ConnectionError):
            own.sendall(raw + b"\r\n\r\n")
            own.shutdown(socket.SHUT_WR)
            while own.recv(65_536):
                pass


def half_requests(studio: Target, client: Client) -> None:
    with contextlib.ExitStack() as stack:
        for _ in range(100):
            stack.enter_context(connection(studio)).sendall(b"GET / HTTP/1.1\r\nHost:")
        assert client.serves()


def many_pages(studio: Target, client: Client) -> None:
    clients = []
    with contextlib.suppress(WebSocketException):
        for _ in range(40):
            clients.append(Client(studio.address))
            clients[-1].send(CAMERA)
    assert 0 < len(clients) < 20
    for each in clients:
        each.close()


SLOW: tuple[Callable[[Target, Client], None], ...] = (
    junk, large_messages, unfinished_uploads, small_uploads, unread_answers, half_requests,
    many_pages,
)  # fmt: skip
QUICK = (wrong_uploads, no_http)


@pytest.mark.parametrize(
    "attack", [*QUICK, *(pytest.param(each, marks=pytest.mark.exhaustive) for each in SLOW)]
)
def test_a_hostile_client_is_bounded(attack, studio, other):
    before_mb, known = studio.memory_mb, len(studio.lines)
    with page(studio) as client:
        attack(studio, client)
        assert not client.is_open or client.serves()
    assert other.serves()
    until_s = time.monotonic() + PATIENCE_S  # closed pages release their memory
    while studio.memory_mb - before_mb > MAX_GROWTH_MB and time.monotonic() < until_s:
        time.sleep(0.1)
    lines = studio.lines[known:]
    assert [line for line in lines if not line.startswith("t2twin: ") or "error" in line] == []
    assert len(lines) <= MAX_LINES
    assert studio.memory_mb - before_mb <= MAX_GROWTH_MB


def test_an_allowed_origin_and_host_may_connect():
    with target("--allow-origin", "https://lab.example", "--allow-origin", "http://x:1") as studio:
        for origin in ("https://lab.example", "http://x:1", studio.address, None):
            assert try_connect(studio.address, origin=origin) == 101
        assert try_connect(studio.address, origin="http://lab.example") == 403
        assert len(studio.lines) == 1 and "http://lab.example" in studio.lines[0]


def test_a_link_cannot_connect_the_page_to_another_server(studio):
    """viser's page connects to the server that its link names."""
    with browser() as chrome, socket.create_server(("127.0.0.1", 0)) as server:
        tab, port = chrome.new_page(), server.getsockname()[1]
        for address, text in (
            (f"{studio.address}/?websocket=ws://127.0.0.1:{port}", "is not connected"),
            (studio.address, "Connected!"),
        ):
            with tab.expect_console_message(
                lambda message, text=text: text in message.text, timeout=PATIENCE_MS
            ):
                tab.goto(address)
        server.setblocking(False)
        with pytest.raises(BlockingIOError):  # nothing has connected
            server.accept()
