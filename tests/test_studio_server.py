"""The studio's worker, and where it listens: refusals in one sentence."""

import socket
import threading

import pytest
from PIL import Image

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.studio.access import read_origin
from t2twin.studio.server import is_loopback
from t2twin.studio.tasks import LatestOnlyWorker

# The newest first


def test_only_the_newest_is_done():
    done, asked, settled = [], [0], []
    go, begun = threading.Event(), threading.Event()

    def work():
        done.append(asked[0])
        begun.set()
        go.wait(5)

    worker = LatestOnlyWorker(work, lambda: settled.append(1), idle_s=0.01)
    worker.request()
    assert begun.wait(5)
    for asked[0] in range(1, 101):
        worker.request()
    go.set()
    assert worker.wait(5)
    assert done == [0, 100] and settled
    worker.stop()


@pytest.mark.parametrize(
    "arguments, words",
    [
        (("--run", "{folder}"), "config.json"),
        (("--host", "nowhere.invalid"), "cannot listen on"),
        (("--host", "203.0.113.7"), "cannot listen on"),
        (("--port", "70000"), "0 to 65535"),
        (("--port", "-1"), "0 to 65535"),
        (("--source", "nowhere"), "no source"),
        (("--source", "{picture}"), "as a video"),
        (("--background", "{folder}"), "is a folder"),
        (("--background", "nowhere.png"), "there is no file"),
        (("--allow-origin", "evil.example"), "is not an origin"),
        (("--allow-origin", "http://evil.example/path"), "is not an origin"),
        (("--allow-origin", "null"), "is not an origin"),
    ],
)
def test_the_studio_refuses_in_one_sentence(arguments, words, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        Image.new("RGB", (240, 320)).save(tmp_path / "frame.png")
        places = {"folder": tmp_path, "picture": tmp_path / "frame.png"}
        main(["studio", *[word.format(**places) for word in arguments]])
    said = capsys.readouterr()
    assert stop.value.code == 2 and said.out == ""
    assert words in said.err and said.err.count("\n") == 1


def test_a_taken_port_is_refused(capsys):
    with socket.create_server(("127.0.0.1", 0)) as taken, pytest.raises(SystemExit):
        main(["studio", "--port", str(taken.getsockname()[1])])
    assert "in use" in capsys.readouterr().err


@pytest.mark.parametrize(
    "host, own", [("127.0.0.1", True), ("localhost", True), ("::1", True), ("0.0.0.0", False)]
)
def test_which_addresses_are_this_machine_s_alone(host, own):
    assert is_loopback(host) is own


@pytest.mark.parametrize(
    "text", ["null", "", "http://", "evil", "ftp://x", "http://a/b", "http://a:x", "http://u@a"]
)
def test_a_text_that_is_no_origin_is_refused(text):
    with pytest.raises(T2TwinError, match="is not an origin"):
        read_origin(text)


def test_an_origin_has_the_port_of_its_scheme():
    assert read_origin("https://Lab.example:443") == "https://lab.example"
    assert read_origin("http://[::1]:8080") == "http://[::1]:8080"
