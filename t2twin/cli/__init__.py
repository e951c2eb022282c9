"""The console command `t2twin`: one file a subcommand, imported only when it is called for."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import tyro

from t2twin.cli import (
    calibrate,
    doctor,
    evaluate,
    export,
    import_pairs,
    press,
    primitives,
    report,
    shapes,
    simdata,
    train,
    translate,
)
from t2twin.primitives_cad.errors import T2TwinError

COMMANDS = {
    "shapes": shapes.shapes,
    "primitives": primitives.primitives,
    "calibrate": calibrate.calibrate,
    "press": press.press,
    "simdata": simdata.simdata,
    "import-pairs": import_pairs.import_pairs,
    "train": train.train,
    "evaluate": evaluate.evaluate,
    "translate": translate.translate,
    "export": export.export,
    "report": report.report,
    "doctor": doctor.doctor,
}

RESUMING = ("primitives", "simdata", "train")
"""Commands that continue what an earlier call began; the others begin again and leave nothing."""

INTERRUPTED, TERMINATED = 128 + signal.SIGINT, 128 + signal.SIGTERM
"""Exit statuses after Ctrl-C and after SIGTERM, as shells have them."""


class _Terminated(BaseException):
    """SIGTERM came: what is being written is cleaned up on the way out, as after Ctrl-C."""


def main(arguments: list[str] | None = None) -> None:
    """Run a subcommand; exit with 2 and one sentence where what was given cannot be used."""
    given = sys.argv[1:] if arguments is None else arguments
    if given == ["--version"]:
        print(_version())
        return
    try:
        with _termination_raised():
            tyro.extras.subcommand_cli_from_dict(
                COMMANDS,
                prog="t2twin",
                description="From what a DIGIT camera saw to what a CySkin array would have felt.",
                args=arguments,
                config=(tyro.conf.FlagCreatePairsOff,),
            )
    except T2TwinError as error:
        sys.exit(_said(str(error)))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        what = error.strerror or str(error)
        sys.exit(_said(f"{error.filename or 'a file'} cannot be used: {what.lower()}"))
    except KeyboardInterrupt:
        sys.exit(_stopped(given, INTERRUPTED))
    except _Terminated:
        sys.exit(_stopped(given, TERMINATED))


def _version() -> str:
    from importlib.metadata import version

    return f"t2twin {version('t2twin')}"


@contextmanager
def _termination_raised() -> Iterator[None]:
    """SIGTERM becomes an exception within the block, where signals can be handled at all."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def terminate(number: int, frame: FrameType | None) -> None:
        raise _Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _stopped(given: list[str], status: int) -> int:
    resumes = bool(given) and given[0] in RESUMING
    after = "the same command continues from here" if resumes else "the same command begins again"
    print(f"t2twin: stopped; {after}", file=sys.stderr)
    return status


def _said(message: str) -> int:
    print(f"t2twin: {message}", file=sys.stderr)
    return 2
