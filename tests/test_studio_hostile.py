"""Hostile clients of the studio are refused or bounded, and others are served meanwhile."""

import socket

import pytest
from browser import PATIENCE_MS, browser

from benchmarks.studio_client import Client, target, try_connect
from benchmarks.studio_hostile import SCRIPTS, SLOW, attack
from t2twin.core.errors import T2TwinError
from t2twin.studio.transport.log import MAX_LINE, Log, one_line
from t2twin.studio.transport.origin_check import Origin, read_origin


@pytest.fixture(scope="module")
def studio():
    with target() as studio:
        yield studio


@pytest.fixture(scope="module")
def other(studio):
    """A client that every script leaves alone."""
    client = Client(studio.address).open_page()
    assert client.wait_for(lambda: client.has_intervals)
    yield client
    client.close()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.exhaustive] if name in SLOW else [])
        for name in SCRIPTS
    ],
)
def test_a_hostile_client_is_refused_or_bounded(name, studio, other):
    assert attack(name, studio, other)["faults"] == []


def test_there_are_enough_scripts():
    assert len(SCRIPTS) >= 20


def test_an_allowed_origin_and_host_may_connect():
    with target("--allow-origin", "https://lab.example", "--allow-origin", "http://x:1") as studio:
        for origin in ("https://lab.example", "http://x:1", studio.address, None):
            assert try_connect(studio.address, origin=origin) == 101
        assert try_connect(studio.address, origin="http://lab.example") == 403
        assert len(studio.lines) == 1 and "http://lab.example" in studio.lines[0]


def test_a_link_cannot_lead_the_page_to_another_server(studio):
    """viser's page connects to the server that its link names."""
    with browser() as chrome, socket.create_server(("127.0.0.1", 0)) as server:
        tab, port = chrome.new_page(), server.getsockname()[1]
        with tab.expect_console_message(
            lambda message: "is not connected" in message.text, timeout=PATIENCE_MS
        ):
            tab.goto(f"{studio.address}/?websocket=ws://127.0.0.1:{port}")
        with tab.expect_console_message(
            lambda message: "Connected!" in message.text, timeout=PATIENCE_MS
        ):
            tab.goto(studio.address)
        server.setblocking(False)
        with pytest.raises(BlockingIOError):  # nobody has connected
            server.accept()


@pytest.mark.parametrize(
    "text", ["null", "", "http://", "evil", "ftp://x", "http://a/b", "http://a:x", "http://u@a"]
)
def test_what_is_no_origin_is_refused(text):
    with pytest.raises(T2TwinError, match="is not an origin"):
        read_origin(text)


def test_an_origin_has_the_port_of_its_scheme():
    assert read_origin("https://Lab.example") == Origin("https", "lab.example", 443)
    assert str(read_origin("http://[::1]:8080")) == "http://[::1]:8080"


def test_lines_are_limited_and_hold_no_control_characters(capsys):
    log = Log(burst=3, per_s=0.0)
    for number in range(10):
        log(f"line {number}\n\x1b[31m")
    said = capsys.readouterr().err
    assert said.count("\n") == 3 and "\x1b" not in said
    assert len(one_line("x" * 10_000)) == MAX_LINE
