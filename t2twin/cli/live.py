"""t2twin live"""

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro


def live(
    source: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SOURCE")]],
    run: Annotated[str | None, tyro.conf.arg(metavar="RUN")] = None,
    layout: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    turn_deg: Literal[0, 90, 180, 270] = 0,
    bf16: bool = False,
    frames: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    background: Annotated[Path | None, tyro.conf.arg(metavar="IMAGE")] = None,
    zmq: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None,
    rerun: Annotated[Path | None, tyro.conf.arg(metavar="FILE.rrd")] = None,
) -> None:
    """Translate frames as they arrive; print a line of JSON with the counts for each.

    Frames that arrive during a translation are dropped, except the latest. Rate and latency are
    printed on standard error.

    Args:
        source: Camera number, video file, or folder in which PNG or JPEG files appear.
        run: Folder of a trained run, or name of a pretrained run; the pretrained field run unless
            given. A name refers to the pretrained run; write a folder named field as ./field.
        layout: Taxel layout (name, or JSON or CSV file) of the predictions of a touch2touch or
            field run; the run's own unless given.
        turn_deg: Clockwise rotation that makes frames upright (rows along the length of the DIGIT):
            270 for a DIGIT opened as a camera.
        bf16: Compute in bfloat16 if the processor supports it: faster, but counts may differ from
            float32 by a few hundred.
        frames: Number of frames after which the command ends; unlimited unless given.
        background: Background frame of the same sensor for a field run, of any size, rotated like
            the frames; the mean background frame of the training unless given.
        zmq: Address at which a ZeroMQ PUB socket publishes each line, such as tcp://127.0.0.1:5555.
        rerun: Recording of the frames and predictions for the viewer of Rerun.
    """
    from contextlib import ExitStack, closing

    from t2twin.core.errors import T2TwinError
    from t2twin.live.follow import follow
    from t2twin.live.outputs import open_outputs
    from t2twin.live.sources import open_background, open_source
    from t2twin.translate.inference.load import load
    from t2twin.translate.inference.predictor import CountsPredictor, require
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.runs.config import DEFAULT_RUN

    if frames is not None and frames < 1:
        raise T2TwinError(f"--frames is {frames}; expected 1 or more")
    use_all_cores()
    loaded = load(DEFAULT_RUN if run is None else run, layout, bf16)
    with ExitStack() as stack:
        outputs = [stack.enter_context(closing(each)) for each in open_outputs(zmq, rerun)]
        follow(
            require(loaded, CountsPredictor, "live"),
            open_source(source, turn_deg, _report),
            lambda line: print(line, flush=True),
            _report,
            frames,
            None if background is None else open_background(background, turn_deg),
            outputs,
        )


def _report(message: str) -> None:
    print(f"t2twin: {message}", file=sys.stderr, flush=True)
