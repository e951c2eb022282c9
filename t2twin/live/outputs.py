"""Further outputs of live predictions: ZeroMQ and Rerun."""

import json
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from t2twin.core.errors import T2TwinError
from t2twin.live.sources import Frame
from t2twin.rerun_log import RerunLog

Output = Callable[[Frame, dict[str, Any]], None]
"""Receives a frame and the values of its line."""


class ZmqPublisher:
    """Publishes each line of JSON as one message of a ZeroMQ PUB socket.

    address: to bind, such as tcp://127.0.0.1:5555. Subscribers that are too slow lose messages.
    Raises T2TwinError without the extra t2twin[zmq], and for an address that cannot be bound.
    """

    def __init__(self, address: str) -> None:
        if find_spec("zmq") is None:
            raise T2TwinError("--zmq needs PyZMQ: `pip install 't2twin[zmq]'`")
        import zmq

        _check_port(address)
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.PUB)
        try:
            self._socket.bind(address)
        except zmq.ZMQError as error:
            self.close()
            raise T2TwinError(
                f"--zmq {address} cannot be bound: {error.strerror}; expected an address such as "
                "tcp://127.0.0.1:5555"
            ) from error

    def __call__(self, frame: Frame, line: dict[str, Any]) -> None:
        self._socket.send_string(json.dumps(line))

    def close(self) -> None:
        """Close the socket; messages that are not sent are dropped."""
        self._context.destroy(linger=0)


def _check_port(address: str) -> None:
    """Raises T2TwinError for a port of TCP out of range, which ZeroMQ replaces by another one."""
    try:
        if address.startswith("tcp:") and not address.endswith(":*"):
            _ = urlsplit(address).port  # raises ValueError
    except ValueError:
        raise T2TwinError(
            f"--zmq {address} has no valid port; expected 0 to 65535, as in tcp://127.0.0.1:5555"
        ) from None


class RerunOutput:
    """Records images and predictions. log: the recording."""

    def __init__(self, log: RerunLog) -> None:
        self._log = log
        self._began_s: float | None = None

    def __call__(self, frame: Frame, line: dict[str, Any]) -> None:
        if self._began_s is None:
            self._began_s = frame.arrived_s
        self._log.prediction(frame.arrived_s - self._began_s, frame.image, line)

    def close(self) -> None:
        """Close the recording."""
        self._log.close()


def open_outputs(zmq: str | None, rerun: Path | None) -> Iterator[ZmqPublisher | RerunOutput]:
    """The outputs that an address and a file name; see ZmqPublisher and RerunLog."""
    if zmq is not None:
        yield ZmqPublisher(zmq)
    if rerun is not None:
        yield RerunOutput(RerunLog(rerun))
