"""t2twin studio"""

import os
import time
from pathlib import Path
from typing import Annotated

import tyro


def studio(
    run: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="RUN")] = (),
    host: str = "127.0.0.1",
    port: Annotated[int, tyro.conf.arg(metavar="INT")] = 8080,
) -> None:
    """Press, look and translate in a browser, until Ctrl-C.

    Args:
        run: Folders of trained runs to translate by; those below runs/ are found.
        host: Address to listen at; this machine alone unless given. 0.0.0.0 lets everyone in who
            can reach this machine.
        port: Port to listen at; the next free one where it is taken.
    """
    from t2twin.stopping import Stopped, say_stopped
    from t2twin.studio.server import studio as serve

    try:
        with serve(run, host, port) as served:
            print(f"open {served.address} (Ctrl-C ends it)", flush=True)
            while True:
                time.sleep(3600)
    except Stopped as stop:
        # Its files are gone; threads that still press something are not waited for.
        os._exit(say_stopped(stop.number))
