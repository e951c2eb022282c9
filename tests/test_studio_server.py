"""The studio's worker, and where it listens: refusals in one sentence."""

import socket
import threading

import pytest

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
