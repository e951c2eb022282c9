"""The console command `t2twin`: one file a subcommand, imported only when it is called for."""

import os
import signal
import sys
from contextlib import suppress

import tyro

from t2twin.cli import (
    adapt,
    calibrate,
    dataset,
    doctor,
    evaluate,
    export,
    live,
    press,
    report,
    shapes,
    studio,
    train,
    translate,
)
from t2twin.cli.parser_errors import one_sentence
from t2twin.core.compile_ahead import before_compiling
from t2twin.core.errors import T2TwinError
from t2twin.core.files import FULL
from t2twin.core.signals import Stopped, say_stopped

COMMANDS = {
    "shapes": shapes.shapes,
    "primitives": shapes.primitives,
    "calibrate": calibrate.calibrate,
    "adapt": adapt.adapt,
    "press": press.press,
    "simdata": dataset.simdata,
    "import-pairs": dataset.import_pairs,
    "train": train.train,
    "calibrate-uncertainty": train.calibrate_uncertainty,
    "evaluate": evaluate.evaluate,
    "translate": translate.translate,
    "live": live.live,
    "export": export.export,
    "report": report.report,
    "studio": studio.studio,
    "doctor": doctor.doctor,
}


def main(arguments: list[str] | None = None) -> None:
    """Run a subcommand; exit with 2 and one sentence where what was given cannot be used."""
    given = sys.argv[1:] if arguments is None else arguments
    before_compiling(_say_compiling)
    try:
        _run(given)
        if sys.stdout is not None:
            sys.stdout.flush()  # what cannot be written is found here, not at Python's end
    except T2TwinError as error:
        sys.exit(_said(str(error)))
    except BrokenPipeError:
        _drop_output()
    except OSError as error:
        _drop_output()
        sys.exit(_said(_of_file(error)))
    except KeyboardInterrupt:
        sys.exit(say_stopped(signal.SIGINT))
    except Stopped as stop:
        sys.exit(say_stopped(stop.number))


def _say_compiling() -> None:
    print(
        "t2twin: compiling numerical loops for their first use on this machine (up to 20 s)",
        file=sys.stderr,
        flush=True,
    )


def _run(given: list[str]) -> None:
    if given == ["--version"]:
        print(_version())
        return
    with one_sentence(COMMANDS, given):
        tyro.extras.subcommand_cli_from_dict(
            COMMANDS,
            prog="t2twin",
            description="From what a DIGIT camera saw to what a CySkin array would have felt.",
            args=given,
            config=(tyro.conf.FlagCreatePairsOff,),
        )


def _drop_output() -> None:
    """Where standard output takes no more, drop what is buffered: Python would try again."""
    try:
        sys.stdout.flush()
    except (OSError, ValueError, AttributeError):
        with suppress(OSError, ValueError, AttributeError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _version() -> str:
    from importlib.metadata import version

    return f"t2twin {version('t2twin')}"


def _of_file(error: OSError) -> str:
    what = (error.strerror or str(error)).lower()
    if error.errno in FULL:
        return f"there is no room left to write ({what}); make room and start again"
    return f"{error.filename or 'a file'} cannot be used: {what}"


def _said(message: str) -> int:
    one_line = " ".join(message.split())  # a library's reason may have more
    print(f"t2twin: {one_line}", file=sys.stderr)
    return 2
