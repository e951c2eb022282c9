"""The console command `t2twin`: one file a subcommand, imported only when it is called for."""

import os
import sys

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
    simdata,
    train,
    translate,
)
from t2twin.primitives_cad.errors import T2TwinError

COMMANDS = {
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


def main(arguments: list[str] | None = None) -> None:
    """Run a subcommand; exit with 2 and one sentence where what was given cannot be used."""
    try:
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
        print("t2twin: stopped; the same command goes on from here", file=sys.stderr)
        sys.exit(130)


def _said(message: str) -> int:
    print(f"t2twin: {message}", file=sys.stderr)
    return 2
