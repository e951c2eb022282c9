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
) -> None:
    """Translate frames as they arrive: a line of JSON with the counts for each, on standard output.

    Frames that come while one is being translated are dropped, all but the newest. Rate and latency
    are printed on standard error.

    Args:
        source: A camera's number, a video file, or a folder that PNG or JPEG files arrive in.
        run: Folder of a trained run, or the name of a pretrained run; the pretrained field unless
            given. A name stands for the pretrained run; a folder called field is ./field.
        layout: Taxel layout (name, or JSON or CSV file) to read a touch2touch or field run at; the
            run's own unless given.
        turn_deg: How far frames are turned clockwise to stand upright (rows along the DIGIT's
            length): 270 for a DIGIT read as a camera.
        bf16: Compute in bfloat16 where the processor has it: faster, and up to some hundred counts
            off what float32 gives.
        frames: Lines after which it ends; never, or with the video, unless given.
        background: Image of the same sensor with nothing touching it, which a field run compares
            with the frames; turned as they are, and of any size. The mean background frame of its
            training unless given.
    """
    from t2twin.core.errors import T2TwinError
    from t2twin.live.follow import follow
    from t2twin.live.sources import open_background, open_source
    from t2twin.translate.inference.load import load
    from t2twin.translate.inference.predictor import CountsPredictor, require
    from t2twin.translate.models.distributed import use_all_cores
    from t2twin.translate.runs.pretrained import DEFAULT_RUN

    if frames is not None and frames < 1:
        raise T2TwinError(f"--frames is {frames}; it must be 1 or more")
    use_all_cores()
    loaded = load(DEFAULT_RUN if run is None else run, layout, bf16)
    follow(
        require(loaded, CountsPredictor, "live"),
        open_source(source, turn_deg, _report),
        lambda line: print(line, flush=True),
        _report,
        frames,
        None if background is None else open_background(background, turn_deg),
    )


def _report(sentence: str) -> None:
    print(f"t2twin: {sentence}", file=sys.stderr, flush=True)
