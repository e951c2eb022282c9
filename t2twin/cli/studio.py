"""t2twin studio"""

import sys
import time
from pathlib import Path


def studio(
    run: tuple[Path, ...] = (),
    source: str | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    background: Path | None = None,
) -> None:
    """Press shapes and translate images in a browser, until Ctrl-C.

    Args:
        run: Folders of trained runs, in addition to the pretrained run; runs in the folder runs/
            unless given.
        source: Frames to translate: camera number, video file or folder.
        host: Address to listen on; reachable from this machine only unless given. 0.0.0.0 allows
            everyone who can reach this machine.
        port: Port to listen on.
        background: Background frame of the same sensor for field runs; the mean background frame of
            their training unless given.
    """
    from importlib.util import find_spec

    from t2twin.core.errors import T2TwinError

    if find_spec("viser") is None:
        raise T2TwinError(
            "the studio requires viser, which is not installed; install it with "
            "`pip install 't2twin[studio]'`"
        )
    from t2twin.studio.server import LOOPBACK
    from t2twin.studio.server import studio as serve

    with serve(run, host, port, source, background) as served:
        if host not in LOOPBACK:
            print(
                "t2twin: everyone who can reach this machine can open the page and use its "
                "processors; --host 127.0.0.1 restricts it to this machine",
                file=sys.stderr,
                flush=True,
            )
        print(f"open {served.address} (Ctrl-C ends it)", flush=True)
        while True:
            time.sleep(3600)
