"""t2twin studio"""

import os
import sys
import time
from pathlib import Path
from typing import Annotated

import tyro


def studio(
    run: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="RUN")] = (),
    source: Annotated[str | None, tyro.conf.arg(metavar="SOURCE")] = None,
    host: Annotated[str, tyro.conf.arg(metavar="ADDRESS")] = "127.0.0.1",
    port: Annotated[int, tyro.conf.arg(metavar="INT")] = 8080,
    background: Annotated[Path | None, tyro.conf.arg(metavar="IMAGE")] = None,
    allow_origin: Annotated[
        tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="ORIGIN")
    ] = (),
) -> None:
    """Press, look and translate in a browser, until Ctrl-C.

    Args:
        run: Folders of trained runs to translate with, besides the pretrained one; those below
            runs/ unless given.
        source: Frames to look at and to translate: a camera's number, a video file, or a folder.
        host: Address to listen at; this machine alone unless given. 0.0.0.0 lets everyone in who
            can reach this machine.
        port: Port to listen at.
        background: Image of the DIGIT of those frames with nothing touching it, which field runs
            compare them with; the mean of those of the training unless given.
        allow_origin: Origin of pages elsewhere that may use the studio, such as
            https://lab.example for that of a proxy. Can be given several times.
    """
    from importlib.util import find_spec

    from t2twin.core.errors import T2TwinError
    from t2twin.core.signals import Stopped, report_stop

    if find_spec("viser") is None:
        raise T2TwinError(
            "the studio needs viser, which is not installed; `pip install 't2twin[studio]'` brings "
            "it"
        )
    from t2twin.studio.server import OPEN_TO_OTHERS, is_own
    from t2twin.studio.server import studio as serve

    try:
        with serve(run, host, port, source, background, allow_origin) as served:
            if not is_own(host):
                print(OPEN_TO_OTHERS, file=sys.stderr, flush=True)
            print(f"open {served.address} (Ctrl-C ends it)", flush=True)
            while True:
                time.sleep(3600)
    except Stopped as stop:
        # Its files are gone; threads that still press something are not waited for.
        os._exit(report_stop(stop.number))
