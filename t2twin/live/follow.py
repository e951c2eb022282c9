"""Translates frames as they arrive; writes, publishes and records a line of JSON for each."""

import json
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from t2twin.core.errors import T2TwinError, how_to_install
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.live.sources import Frame, LatestFrame, Report, Source
from t2twin.rerun_log import RerunLog
from t2twin.translate.inference.estimate import DISAGREE_NOTE, ContactEstimate
from t2twin.translate.inference.predictor import NO_BACKGROUND, TrainedTranslator
from t2twin.translate.uncertainty.ood import OODClass, unlike

REPORT_EVERY_S = 5.0  # period of the reports of rate and latency
MAX_LATENCIES = 100_000  # kept for the final report, half an hour at 60 Hz; limits memory
# Of repeated rows: frames from which those that never change are known, their largest share, and
# the least share of the others that is no chance (assumed)
FIRST_FRAMES, MAX_STILL, MIN_REPEATED = 10, 0.5, 0.1

# Receives a frame, the values of its line and the contact, if the run predicts it
Output = Callable[[Frame, dict[str, Any], ContactEstimate | None], object]


def _throughput(began_s: float, translated: int, received: int, latencies_ms: deque[float]) -> str:
    """Rates of the frames, latencies from arrival to line, and dropped frames, in words."""
    seconds = max(time.perf_counter() - began_s, 1e-9)
    text = f"{translated / seconds:.1f} of {received / seconds:.1f} frames/s"
    if latencies_ms:
        median, high = np.percentile(latencies_ms, [50, 95])
        text += f", median latency {median:.1f} ms (95th percentile {high:.1f} ms)"
    return f"{text}, {received - translated} of {received} dropped"


class RepeatedRows:
    """Finds rows that repeat the frame before bit by bit: a sensor's noise changes every row."""

    def __init__(self, report: Report) -> None:
        self._report, self._compared, self._reported = report, 0, False
        self._before: np.ndarray | None = None
        self._still = np.array(False)  # rows that repeated the frame before in the first frames

    def __call__(self, frame: Frame) -> int:
        """The number of repeated rows, 0 for few; the first time it reports them."""
        image, before = frame.image, self._before
        self._before = image
        if before is None or before.shape != image.shape:
            return 0
        same = (image == before).reshape(len(image), -1).all(axis=1)
        self._compared += 1
        if self._compared <= FIRST_FRAMES:
            self._still = self._still | same
            return 0
        count = int((same & ~self._still).sum())
        if self._still.mean() > MAX_STILL or count < MIN_REPEATED * len(image):
            return 0
        if not self._reported:
            self._reported = True
            self._report(
                f"frame {frame.number} repeats {count} of {len(image)} rows of the frame before, "
                "so part of the stream is frozen, or compressed; what it shows there is older"
            )
        return count


def follow(
    run: TrainedTranslator, source: Source, write: Callable[[str], None], report: Report,
    max_frames: int | None = None, background: np.ndarray | None = None,
    outputs: Sequence[Output] = (), order: FrameOrder = UPRIGHT,
) -> tuple[int, int]:  # fmt: skip
    """Translates the latest frame repeatedly; returns numbers of translated and received frames.

    It ends with the source, or after max_frames lines. write: receives one line of JSON per frame;
    docs/how-to/live.md lists its keys. report: receives messages for the user. background:
    background frame of the sensor for a field run, (h, w, 3) or (h, w) uint8, of any size.
    order: of the source and the background frame, which are upright here; for messages.
    outputs: receive each frame, the values of its line, and the contact too.
    Raises T2TwinError if the source fails, and for a background frame with another model.
    """
    if background is not None:
        run._need_uncertainty("a background frame")
    elif run.config.has_uncertainty:
        report(NO_BACKGROUND)
    _predicted(run, np.zeros((run.config.preset.size,) * 2, np.uint8), background)  # slow at first
    began_s, latest, last, translated = time.perf_counter(), LatestFrame(source), -1, 0
    latencies_ms, repeated_rows = deque[float](maxlen=MAX_LATENCIES), RepeatedRows(report)
    report_due_s, reported, warned, agreed = began_s + REPORT_EVERY_S, None, False, True
    try:
        while max_frames is None or translated < max_frames:
            ended = latest.ended  # read before the frame: a last frame may arrive with the end
            frame = latest.take(last, REPORT_EVERY_S)
            if frame is None and ended:
                break
            if frame is not None:
                last = frame.number
                values, contact = _predicted(run, frame.image, background)
                latency_s = time.perf_counter() - frame.arrived_s
                some = {"file": frame.name, "repeated_rows": repeated_rows(frame) or None}
                line = {
                    "frame": frame.number,
                    **{name: value for name, value in some.items() if value is not None},
                    "time_s": round(time.time() - latency_s, 6),
                    "latency_ms": round(1e3 * latency_s, 3),
                    **values,
                }
                write(json.dumps(line))
                for output in outputs:
                    output(frame, line, contact)
                translated += 1
                latencies_ms.append(line["latency_ms"])
                if values["in_distribution"] is False and not warned:
                    warned = True
                    _report_class(run, frame, values["ood_class"], background, order, report)
                if agreed and contact is not None and not contact.agrees:
                    agreed = False
                    report(f"frame {frame.number}: {DISAGREE_NOTE}")
            state = translated, frame is None
            if not latest.ended and state != reported and time.perf_counter() >= report_due_s:
                report_due_s, reported = time.perf_counter() + REPORT_EVERY_S, state
                rates = _throughput(began_s, translated, latest.read, latencies_ms)
                report(rates + "; waiting for a frame" * (frame is None))
    finally:
        latest.close()
    report(_throughput(began_s, translated, latest.read, latencies_ms))
    return translated, latest.read


def _report_class(
    run: TrainedTranslator, frame: Frame, ood_class: str, background: np.ndarray | None,
    order: FrameOrder, report: Report,
) -> None:  # fmt: skip
    """Reports that a frame is out of distribution, and whether it is stored in another order."""
    classes = [OODClass(ood_class)]
    stored = run._order_warning(classes, background, [frame.image], order)
    for said in filter(None, (unlike(classes, run.run_dir.name), stored)):
        report(said)


def _predicted(
    run: TrainedTranslator, image: np.ndarray, background: np.ndarray | None
) -> tuple[dict[str, Any], ContactEstimate | None]:
    """The predicted values of a line, and the contact if the run predicts it."""
    estimate = run._classified_estimate(image, background, contact=run.config.predicts_contact)
    values: dict[str, Any] = {
        name: np.rint(value).astype(int).tolist()
        for name in ("counts", "counts_std")
        if (value := getattr(estimate, name)) is not None
    }
    for name in ("force_n", "force_std_n"):
        if (value := getattr(estimate, name)) is not None:
            values[name] = round(float(value), 3)
    if estimate.contact is not None:
        values["contact"] = estimate.contact.summary()
    return values | estimate.ood_class.entry, estimate.contact


@contextmanager
def published(address: str, report: Report) -> Iterator[Output]:
    """Publishes each line of JSON as one message of a ZeroMQ PUB socket, within the block.

    address: to bind, such as tcp://127.0.0.1:5555; tcp://127.0.0.1:* takes a free port. report:
    receives the bound address. Subscribers that are too slow lose messages.
    Raises T2TwinError without the extra t2twin[zmq], and for an address that cannot be bound.
    """
    if find_spec("zmq") is None:
        raise T2TwinError(f"--zmq needs PyZMQ; {how_to_install('zmq')}")
    import zmq

    context = zmq.Context()
    socket = context.socket(zmq.PUB)
    with ExitStack() as stack:
        stack.callback(context.destroy, linger=0)  # messages that are not sent are dropped
        try:
            _ = urlsplit(address.removesuffix(":*")).port  # ZeroMQ takes it modulo 65,536
            socket.bind(address)
        except (zmq.ZMQError, ValueError) as error:
            raise T2TwinError(f"--zmq {address} cannot be bound: {error}") from error
        report(f"published at {socket.getsockopt_string(zmq.LAST_ENDPOINT)}")
        yield lambda frame, line, contact: socket.send_string(json.dumps(line))


@contextmanager
def recorded(file: Path) -> Iterator[Output]:
    """Records images and predictions for the viewer of Rerun, within the block; see RerunLog."""
    began_s: float | None = None

    def record(frame: Frame, line: dict[str, Any], contact: ContactEstimate | None) -> None:
        nonlocal began_s
        began_s = frame.arrived_s if began_s is None else began_s
        depth_mm = None if contact is None else contact.depth_mm
        log.prediction(frame.arrived_s - began_s, frame.image, line, depth_mm)

    with closing(RerunLog(file)) as log:
        yield record
