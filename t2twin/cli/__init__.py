"""The console command `t2twin`, with its subcommands."""

import logging
import os
import re
import sys
import warnings
from collections import Counter
from itertools import pairwise
from pathlib import Path

import tyro

from t2twin.cli import calibrate, dataset, doctor, networks, press
from t2twin.core import files
from t2twin.core.errors import OUT_OF_MEMORY, T2TwinError, T2TwinWarning, is_out_of_memory
from t2twin.core.machine import installed_version

COMMANDS = {
    "shapes": press.shapes,
    "primitives": press.primitives,
    "sensors": press.sensors,
    "calibrate": calibrate.calibrate,
    "adapt": calibrate.adapt,
    "press": press.press,
    "slide": press.slide,
    "simdata": dataset.simdata,
    "import-pairs": dataset.import_pairs,
    "convert": dataset.convert,
    "train": networks.train,
    "calibrate-uncertainty": networks.calibrate_uncertainty,
    "evaluate": networks.evaluate,
    "translate": networks.translate,
    "live": networks.live,
    "export": networks.export,
    "report": networks.report,
    "studio": press.studio,
    "demo": networks.demo,
    "doctor": doctor.doctor,
}

OUTPUTS = ("--out", "--rerun")  # options whose values are not inputs
ON_ALL_CORES = ("calibrate-uncertainty", "evaluate", "export", "live", "report", "translate")

TYRO_OPTIONS = (
    tyro.conf.FlagCreatePairsOff,
    tyro.conf.DisallowNone,
    tyro.conf.PositionalMetavarFromFieldName,
)


def main(arguments: list[str] | None = None) -> None:
    """Run a subcommand; print one sentence and exit with status 2 after an error of the user."""
    handler = logging.StreamHandler(sys.stderr)  # prints notices, such as before compiling
    handler.setFormatter(logging.Formatter("t2twin: %(message)s"))
    log = logging.getLogger("t2twin")
    log.handlers = [handler]
    log.setLevel(logging.INFO)
    try:
        _run(sys.argv[1:] if arguments is None else arguments)
        sys.stdout.flush()  # reports write errors here instead of at the exit of Python
    except T2TwinError as error:
        sys.exit(_print_error(str(error)))
    except BrokenPipeError:
        _drop_output()
    except Exception as error:
        _drop_output()
        if is_out_of_memory(error):
            sys.exit(_print_error(OUT_OF_MEMORY))
        if not isinstance(error, OSError):
            raise
        sys.exit(_print_error(str(error)))


def _run(given: list[str]) -> None:
    if given == ["--version"]:
        print(f"t2twin {installed_version('t2twin')}")
        return
    if any(word == "" or re.fullmatch("--[^=]+=", word) for word in given):
        raise T2TwinError("an argument or the value of an option is empty; give a path or a value")
    options = [word.partition("=")[0].replace("_", "-") for word in given if word[:2] == "--"]
    for option, count in Counter(options).items():
        if count > 1:
            raise T2TwinError(f"{option} is given {count} times; give it once, with all values")
    words = [word for before, word in pairwise(given) if before not in OUTPUTS]
    # False for a word that cannot be a name, where Path.is_file raises OSError
    files_given = [word for word in words if os.path.isfile(word)]  # noqa: PTH113
    for word in files_given:
        if re.match(r"-[^-\d.]", word):  # an option to the parser
            raise T2TwinError(f"{word} begins with a dash; give it as ./{word}")
    if {*given[:1]} & {*ON_ALL_CORES} and "--help" not in given:
        from t2twin.translate.models.distributed import use_all_cores  # slow to import

        use_all_cores()
    files.run_inputs = [Path(word) for word in files_given]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("default", T2TwinWarning)  # each text once
            warnings.showwarning = lambda message, *_: _print_error(str(message))
            tyro.extras.subcommand_cli_from_dict(
                COMMANDS,
                prog="t2twin",
                description="Predict the readings of one tactile sensor from those of another.",
                args=given,
                config=TYRO_OPTIONS,
            )
    finally:
        files.run_inputs = []


def _drop_output() -> None:
    """Discards the buffer of a broken standard output, which Python would write again."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _print_error(message: str) -> int:
    """Prints a message in one line; returns the exit status."""
    one_line = " ".join(message.split())  # messages of libraries may have several lines
    print(f"t2twin: {one_line}", file=sys.stderr)
    return 2
