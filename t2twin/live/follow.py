"""From frames as they arrive to lines of counts."""

import json
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from PIL import Image

from t2twin.live.newest import Newest
from t2twin.live.sources import Frame, Source
from t2twin.translate.data.images import to_pixels
from t2twin.translate.predict import TrainedTranslator

SAY_EVERY_S = 5.0
"""How often rate and latency are said, s."""

MOST_LATENCIES = 100_000
"""Latencies that are kept for the last word, half an hour's; bounds memory."""


@dataclass
class Pace:
    """How well the counts keep up. done, came: frames translated, and those that there were.
    latencies_ms: from a frame's arrival to its line, of the last ones."""

    began_s: float = field(default_factory=time.perf_counter)
    done: int = 0
    came: int = 0
    latencies_ms: deque[float] = field(default_factory=lambda: deque(maxlen=MOST_LATENCIES))

    def __str__(self) -> str:
        seconds = max(time.perf_counter() - self.began_s, 1e-9)
        words = f"{self.done / seconds:.1f} of {self.came / seconds:.1f} frames/s"
        if self.latencies_ms:
            middle, most = np.percentile(self.latencies_ms, [50, 95])
            words += f", latency {middle:.1f} ms (95 % within {most:.1f} ms)"
        return f"{words}, {self.came - self.done} of {self.came} dropped"


def follow(
    run: TrainedTranslator,
    source: Source,
    write: Callable[[str], None],
    say: Callable[[str], None],
    most_frames: int | None = None,
) -> Pace:
    """Translates the newest frame again and again, until the source ends.

    write: takes each frame's line, JSON: `frame` (its number in the source, from 0), `file` (in a
    folder), `time_s` (when it arrived, seconds since 1970), `latency_ms` (from then to the line),
    `counts` (whole numbers, one for each taxel), `like_training` (false where the counts mean
    little). say: takes sentences for whoever watches. most_frames: lines after which it ends.
    Raises T2TwinError where the source fails.
    """
    size, grey = run.config.preset.size, run.config.preset.grey
    run.predict_pixels(np.zeros((1, size, size, 1 if grey else 3), np.uint8))  # the first is slow
    newest, pace = Newest(source), Pace()
    said_s, warned = pace.began_s, False
    last = -1
    while most_frames is None or pace.done < most_frames:
        frame = newest.take(last)
        if frame is None:
            break
        last = frame.number
        pixels = to_pixels(Image.fromarray(frame.image), size, grey)[None]
        counts = np.rint(run.predict_pixels(pixels)[0]).astype(int)
        familiar = bool(run.is_familiar(pixels)[0])
        now_s = time.perf_counter()
        latency_ms = 1e3 * (now_s - frame.arrived_s)
        write(json.dumps(_line(frame, counts, familiar, latency_ms)))
        pace.done, pace.came = pace.done + 1, newest.read
        pace.latencies_ms.append(latency_ms)
        if not familiar and not warned:
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


def _line(frame: Frame, counts: np.ndarray, familiar: bool, latency_ms: float) -> dict[str, Any]:
    file = {} if frame.name is None else {"file": frame.name}
    return {
        "frame": frame.number,
        **file,
        "time_s": round(time.time() - latency_ms / 1e3, 6),
        "latency_ms": round(latency_ms, 3),
        "counts": counts.tolist(),
        "like_training": familiar,
    }
