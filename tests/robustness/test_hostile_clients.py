"""Hostile clients of the studio: pages of other sites are refused, and values and files checked."""

import socket
from itertools import count
from urllib.parse import urlsplit

import pytest
from browser import PATIENCE_MS, browser
from studio_client import PROTOCOL, Client, Target, target, try_connect
from waiting import wait_until

from t2twin.core.errors import T2TwinError
from t2twin.studio.files import MAX_BYTES
from t2twin.studio.server import studio as serve
from t2twin.studio.session import Session

PART_BYTES = 512 * 1024

ORIGINS = ("http://evil.example", "null", "http://127.0.0.1:1", "HERE.evil.example",
           "HERE@evil.example", "http://")  # fmt: skip
"""Origins of pages of other sites, servers and frames. HERE: the studio's own."""

HOSTS = ("evil.example:PORT", "evil.example", "127.0.0.1.evil.example", "", "[", "::")
"""Host headers as of a hostile name server (DNS rebinding)."""

VALUES = (
    ("Taxels", "/etc/passwd"), ("Taxels", "../cyskin-20"), ("Kind", "/etc/passwd"),
    ("Kind", "no such kind"), ("Shape", "/etc/passwd"), ("Motion", "fly"), ("Array", "nothing"),
    ("Scale", "no such scale"), ("Shape as", "wire"), ("force, N", float("nan")),
    ("force, N", float("inf")), ("x, mm", 1e308), ("depth, mm", -1.0), ("Seed", -1),
    ("mm per unit", 0.0),
)  # fmt: skip
"""Values that a page cannot send, by the label of the control."""


@pytest.fixture(scope="module")
def studio():
    with target() as studio:
        yield studio


@pytest.fixture(scope="module")
def opened(shape_cache):
    """A page, and its client without a browser."""
    with serve((), port=0) as served:
        client = Client(served.address).open_page()
        (page,) = served.pages.values()
        yield page, client
        client.close()


def status(studio: Target, *headers: str, path: str = "/") -> int:
    """HTTP status of a request with these headers only."""
    place = urlsplit(studio.address)
    with socket.create_connection((str(place.hostname), int(place.port or 0)), 30) as own:
        own.sendall("\r\n".join((f"GET {path} HTTP/1.1", *headers, "", "")).encode())
        return int(own.recv(65_536).decode("latin-1").split()[1])


def test_pages_of_other_sites_are_refused(studio):
    upgrade = ("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
               "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
               f"Sec-WebSocket-Protocol: {PROTOCOL}")  # fmt: skip
    host = f"Host: {urlsplit(studio.address).netloc}"
    for origin in ORIGINS:
        assert try_connect(studio.address, origin=origin.replace("HERE", studio.address)) == 403
    for name in HOSTS:
        other_host = f"Host: {name.replace('PORT', str(urlsplit(studio.address).port))}"
        assert status(studio, other_host) == status(studio, other_host, *upgrade) == 403
    assert status(studio) in (400, 403)
    assert status(studio, host, "Host: evil.example") == 403
    assert status(studio, host) == 200
    assert status(studio, host, "Origin: http://evil.example") == 403
    for path in ("/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/..\\..\\x"):
        assert status(studio, host, path=path) == 404


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


@pytest.mark.parametrize("label, value", VALUES)
def test_a_value_that_a_control_cannot_have_is_refused(label, value, opened):
    page, client = opened
    state = page.state
    client.notices.clear()
    client.set(label, value)
    assert client.wait_for(lambda: any(f"'{label}' is" in text for text in client.notices))
    assert page.state == state


def test_a_press_ends_earlier_errors_only(opened, monkeypatch):
    page, client = opened
    press, numbers = Session.press, count()

    def press_beside_a_bad_file(*arguments):
        page._notices.show_error(T2TwinError(f"file {next(numbers)} is bad"))
        return press(*arguments)

    with monkeypatch.context() as patched:
        patched.setattr(Session, "press", press_beside_a_bad_file)
        for _ in (1, 2):
            assert client.serves() and page.wait(60)
            assert page._notices.shown is not None
    assert client.serves() and page.wait(60)
    assert page._notices.shown is None


def test_an_unannounced_upload_is_dropped(opened):
    page, client = opened
    uploads, shape = page._client.gui._current_file_upload_states, page.state.shape
    begin(client, "large", MAX_BYTES + 1, 123)
    assert client.wait_for(lambda: any("at most 64 MB" in text for text in client.notices))
    begin(client, "longer", 10, 2)
    part(client, "longer", 0, bytes(PART_BYTES))
    assert client.wait_for(lambda: any("larger than" in text for text in client.notices))
    for number in range(3):
        begin(client, f"many{number}", MAX_BYTES // 2, 62)
    assert client.wait_for(lambda: any("other files" in text for text in client.notices))
    assert set(uploads) == {"many0", "many1"}
    uploads.clear()
    part(client, "none", 0, b"x")
    for number, name in enumerate(("../../x.stl", "/etc/passwd", "\0.stl", "a\n.stl", "", ".")):
        client.notices.clear()
        begin(client, f"name{number}", 4, 1, name)
        part(client, f"name{number}", 0, b"evil")
        assert client.wait_for(lambda: len(client.notices) > 0)
        assert page.files.wait(60)
    wait_until(lambda: not uploads)
    assert page.state.shape == shape and client.serves()


def begin(client: Client, transfer: str, size: int, parts: int, name: str = "a.stl") -> None:
    client.send({"type": "FileTransferStartUpload", "transfer_uuid": transfer, "filename": name,
                 "source_component_uuid": client.controls["Upload a shape"]["uuid"],
                 "mime_type": "", "part_count": parts, "size_bytes": size})  # fmt: skip


def part(client: Client, transfer: str, index: int, content: bytes) -> None:
    client.send({"type": "FileTransferPart", "transfer_uuid": transfer, "part_index": index,
                 "source_component_uuid": client.controls["Upload a shape"]["uuid"],
                 "content": content})  # fmt: skip
