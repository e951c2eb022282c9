"""Translates frames as they arrive and writes one line of JSON for each."""

import json
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2twin.live.frame import Frame, Report
from t2twin.live.latest_frame import LatestFrame
from t2twin.live.outputs import Output
from t2twin.live.sources import Source
from t2twin.translate.inference.batch import ood_entry
from t2twin.translate.inference.predictor import (
    NO_BACKGROUND,
    CountsPredictor,
    FieldPredictor,
    require,
)
from t2twin.translate.uncertainty.ood import classify_frame, combined

REPORT_EVERY_S = 5.0
"""Period of the reports of rate and latency, s."""

MAX_LATENCIES = 100_000
"""Number of latencies kept for the final report, half an hour at 60 Hz; limits memory."""


@dataclass
class Throughput:
    """Numbers of translated and received frames, and latencies from a frame's arrival to its
    line."""

    began_s: float = field(default_factory=time.perf_counter)
    translated: int = 0
    received: int = 0
    latencies_ms: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_LATENCIES))

    def __str__(self) -> str:
        seconds = max(time.perf_counter() - self.began_s, 1e-9)
        text = f"{self.translated / seconds:.1f} of {self.received / seconds:.1f} frames/s"
        if self.latencies_ms:
            median, high = np.percentile(self.latencies_ms, [50, 95])
            text += f", median latency {median:.1f} ms (95th percentile {high:.1f} ms)"
        return f"{text}, {self.received - self.translated} of {self.received} dropped"


def follow(
    run: CountsPredictor,
    source: Source,
    write: Callable[[str], None],
    report: Report,
    max_frames: int | None = None,
    background: np.ndarray | None = None,
    outputs: Sequence[Output] = (),
) -> Throughput:
    """Translates the latest frame repeatedly, until the source ends.

    write: receives one line of JSON per frame, with the fields

    - frame, number in the source, from 0; file, in a folder;
    - time_s, arrival, seconds since 1970; latency_ms, from arrival to the line;
    - counts, integers, one per taxel; in_distribution; if that is false, ood_class;
    - of a field run counts_std, standard deviations, counts;
    - of a field run that was trained on several forces, force_n and force_std_n, N.

    report: receives messages for the user. max_frames: number of lines after which it ends.
    background: background frame of the sensor for a field run, (h, w, 3) or (h, w) uint8, of any
    size. outputs: receive each frame and the values of its line too.
    Raises T2TwinError if the source fails, and for a background frame with another model.
    """
    frame_of_unit = None if background is None else _background(run, background)
    if background is None and isinstance(run, FieldPredictor):
        report(NO_BACKGROUND)
    blank = np.zeros((run.config.preset.size,) * 2, np.uint8)
    _predict(run, run.pixels_of(blank, frame_of_unit))  # warm-up: the first prediction is slow
    latest = LatestFrame(source)
    try:
        return _follow(run, latest, write, report, max_frames, (background, frame_of_unit), outputs)
    finally:
        latest.close()


def _follow(
    run: CountsPredictor,
    latest: LatestFrame,
    write: Callable[[str], None],
    report: Report,
    max_frames: int | None,
    backgrounds: tuple[np.ndarray | None, np.ndarray | None],
    outputs: Sequence[Output],
) -> Throughput:
    """backgrounds: the background frame, and at the run's size, from `_background`. Other
    arguments: as for `follow`."""
    background, resized = backgrounds
    throughput = Throughput()
    reported_s, warned, waiting = throughput.began_s, False, False
    last = -1
    while max_frames is None or throughput.translated < max_frames:
        ended = latest.ended  # read before the frame: a last frame may arrive with the end
        frame = latest.take(last, REPORT_EVERY_S)
        if frame is None:
            if ended:
                break
            if not waiting and not latest.ended:
                waiting = True
                report(f"no new frame for {REPORT_EVERY_S:g} s; waiting for the next one")
            continue
        last, waiting = frame.number, False
        pixels = run.pixels_of(frame.image, resized)
        predicted = _predict(run, pixels)
        ood_class = combined(classify_frame(frame.image, background), *run.classify(pixels))
        entry = predicted | ood_entry(ood_class)
        now_s = time.perf_counter()
        latency_ms = 1e3 * (now_s - frame.arrived_s)
        line = _line(frame, entry, latency_ms)
        write(json.dumps(line))
        for output in outputs:
            output(frame, line)
        throughput.translated, throughput.received = throughput.translated + 1, latest.read
        throughput.latencies_ms.append(latency_ms)
        if not entry["in_distribution"] and not warned:
            warned = True
            report(
                f"a frame is unlike the training images of {run.run_dir} ({ood_class}); "
                "predictions are only valid for upright frames of the same sensor in the same "
                "light, with its own background frame"
            )
        if now_s - reported_s >= REPORT_EVERY_S:
            reported_s = now_s
            report(str(throughput))
    throughput.received = latest.read
    report(str(throughput))
    return throughput


def _background(run: CountsPredictor, frame: np.ndarray) -> np.ndarray:
    """The background frame at the run's size, (S, S, 3) uint8, so that it is resized only once."""
    return require(run, FieldPredictor, "a background frame").pixels_of(frame)[0]


def _predict(run: CountsPredictor, pixels: np.ndarray) -> dict[str, Any]:
    """Predicted values of a line. pixels: (1, S, S, c) uint8."""
    if not isinstance(run, FieldPredictor):
        return {"counts": _whole(run.predict_pixels(pixels)[0])}
    estimate = run.estimate_pixels(pixels).first()
    predicted = {"counts": _whole(estimate.counts), "counts_std": _whole(estimate.counts_std)}
    forces = {"force_n": estimate.force_n, "force_std_n": estimate.force_std_n}
    known = {name: round(float(value), 3) for name, value in forces.items() if value is not None}
    return {**predicted, **known}


def _whole(values: np.ndarray) -> list[int]:
    return np.rint(values).astype(int).tolist()


def _line(frame: Frame, predicted: dict[str, Any], latency_ms: float) -> dict[str, Any]:
    file = {} if frame.name is None else {"file": frame.name}
    return {
        "frame": frame.number,
        **file,
        "time_s": round(time.time() - latency_ms / 1e3, 6),
        "latency_ms": round(latency_ms, 3),
        **predicted,
    }
