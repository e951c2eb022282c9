"""t2twin live"""

import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro


def live(
    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]],
    source: tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="SOURCE")]],
    layout: Annotated[str | None, tyro.conf.arg(metavar="FILE")] = None,
    turn_deg: Literal[0, 90, 180, 270] = 0,
    bf16: bool = False,
    frames: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
) -> None:
    """Translate frames as they arrive: a line of JSON with the counts for each, on standard output.

    Frames that come while one is being translated are dropped, all but the newest. Rate and latency
    are said on standard error.

    Args:
        run: Folder of a trained run, or the name of one that ships: field.
        source: A camera's number, a video file, or a folder that PNG or JPEG files arrive in.
        layout: Taxel layout (name, or JSON or CSV file) to read a touch2touch run at; the run's
            own unless given.
        turn_deg: How far frames are turned clockwise to stand upright (rows along the DIGIT's
            length): 270 for a DIGIT read as a camera.
        bf16: Compute in bfloat16 where the processor has it: faster, and up to some hundred counts
            off what float32 gives.
        frames: Lines after which it ends; never, or with the video, unless given.
    """
    from t2twin.live.follow import follow
    from t2twin.live.sources import open_source
    from t2twin.primitives_cad.errors import T2TwinError
    from t2twin.translate.direction import check_gives_counts
    from t2twin.translate.distributed import use_all_cores
    from t2twin.translate.engine import load

    if frames is not None and frames < 1:
        raise T2TwinError(f"--frames is {frames}; it must be 1 or more")
    use_all_cores()
    loaded = load(run, layout, bf16)
    check_gives_counts(loaded.run_dir, loaded.config.direction)
    follow(
        loaded,
        open_source(source, turn_deg),
        lambda line: print(line, flush=True),
        lambda sentence: print(f"t2twin: {sentence}", file=sys.stderr, flush=True),
        frames,
    )
