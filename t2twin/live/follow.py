"""Translates frames as they arrive into lines of JSON."""

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from t2twin.live.latest_frame import LatestFrame
from t2twin.live.sources import Frame, Source
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.outputs import ood_entry
from t2twin.translate.inference.predictor import CountsPredictor, require

SAY_EVERY_S = 5.0
"""How often rate and latency are said, s."""

MAX_LATENCIES = 100_000
"""Latencies that are kept for the last word, half an hour's; bounds memory."""


@dataclass
class Pace:
    """How well the counts keep up. done, came: frames translated, and those that there were.
    latencies_ms: from a frame's arrival to its line, of the last ones."""

    began_s: float = field(default_factory=time.perf_counter)
    done: int = 0
    came: int = 0
    latencies_ms: deque[float] = field(default_factory=lambda: deque(maxlen=MAX_LATENCIES))

    def __str__(self) -> str:
        seconds = max(time.perf_counter() - self.began_s, 1e-9)
        words = f"{self.done / seconds:.1f} of {self.came / seconds:.1f} frames/s"
        if self.latencies_ms:
            middle, most = np.percentile(self.latencies_ms, [50, 95])
            words += f", latency {middle:.1f} ms (95 % within {most:.1f} ms)"
        return f"{words}, {self.came - self.done} of {self.came} dropped"


def follow(
    run: CountsPredictor,
    source: Source,
    write: Callable[[str], None],
    say: Callable[[str], None],
    most_frames: int | None = None,
    background: np.ndarray | None = None,
) -> Pace:
    """Translates the newest frame again and again, until the source ends.

    write: takes each frame's line, JSON: `frame` (its number in the source, from 0), `file` (in a
    folder), `time_s` (when it arrived, seconds since 1970), `latency_ms` (from then to the line),
    `counts` (whole numbers, one for each taxel), `in_distribution` (if false, also
    `ood_class`); of a field run also `counts_std` (standard deviations, counts) and, where it was
    trained on several forces, `force_n` and `force_std_n` (N). say: takes messages for the user.
    most_frames: lines after which it ends. background: a frame of the same sensor with nothing
    touching it, (h, w, 3) or (h, w) uint8, of any size, for a field run.
    Raises T2TwinError where the source fails, and for a background frame of another run.
    """
    frame_of_unit = None if background is None else _background(run, background)
    blank = np.zeros((run.config.preset.size,) * 2, np.uint8)
    _predict(run, run.pixels_of(blank, frame_of_unit))  # the first prediction is slow
    newest = LatestFrame(source)
    try:
        return _follow(run, newest, write, say, most_frames, frame_of_unit)
    finally:
        newest.close()


def _follow(
    run: CountsPredictor,
    newest: LatestFrame,
    write: Callable[[str], None],
    say: Callable[[str], None],
    most_frames: int | None,
    background: np.ndarray | None,
) -> Pace:
    """background: at the run's size, as _background returns it. The rest as for `follow`."""
    pace = Pace()
    said_s, warned, waiting = pace.began_s, False, False
    last = -1
    while most_frames is None or pace.done < most_frames:
        ended = newest.ended  # asked first: a last frame may come with the end
        frame = newest.take(last, SAY_EVERY_S)
        if frame is None:
            if ended:
                break
            if not waiting and not newest.ended:
                waiting = True
                say(f"no new frame for {SAY_EVERY_S:g} s; waiting for the next one")
            continue
        last, waiting = frame.number, False
        pixels = run.pixels_of(frame.image, background)
        predicted = _predict(run, pixels)
        (ood_class,) = run.classify(pixels)
        entry = predicted | ood_entry(ood_class)
        now_s = time.perf_counter()
        latency_ms = 1e3 * (now_s - frame.arrived_s)
        write(json.dumps(_line(frame, entry, latency_ms)))
        pace.done, pace.came = pace.done + 1, newest.read
        pace.latencies_ms.append(latency_ms)
        if not entry["in_distribution"] and not warned:
            warned = True
            say(
                f"a frame is unlike all that {run.run_dir} was trained on; counts are right of "
                "upright frames of the same sensor in the same light only"
            )
        if now_s - said_s >= SAY_EVERY_S:
            said_s = now_s
            say(str(pace))
    pace.came = newest.read
    say(str(pace))
    return pace


def _background(run: CountsPredictor, frame: np.ndarray) -> np.ndarray:
    """A background frame at the run's size, (S, S, 3) uint8, so that it is resized only once."""
    return require(run, FieldPredictor, "a background frame").pixels_of(frame)[0]


def _predict(run: CountsPredictor, pixels: np.ndarray) -> dict[str, Any]:
    """What a line says of one frame, as JSON has it. pixels: (1, S, S, c) uint8."""
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
