"""Numbers and words on the command line."""

from collections.abc import Iterator

from benchmarks.inputs.calibrations import good_frames
from benchmarks.inputs.case import Case, nothing
from benchmarks.inputs.tables import good_pairs

INPUTS = {"calibrate": good_frames, "import-pairs": good_pairs}
"""What else these commands need, so that nothing but the number is bad."""

NO_NUMBERS = ("", "abc", "8,5", "0x10", "--")
"""What a parser of numbers refuses itself."""

OUT = ("--out", "out")
PRESS = ("press", "circle-1", *OUT)
SIMDATA = ("simdata", "--scale", "smoke", *OUT)
TRAIN = ("train", "resnet18", "--data", "{data}", "--preset", "smoke", *OUT)
CALIBRATE = ("calibrate", "--background", "background.png", "--presses", "presses", *OUT)
IMPORT = ("import-pairs", "pairs.csv", *OUT)

NOT_FINITE = ("nan", "inf", "-inf")
FLOATS: tuple[tuple[tuple[str, ...], str, tuple[str, ...]], ...] = (
    (PRESS, "--x-mm", (*NOT_FINITE, "1e308", "-1e9", "500")),
    (PRESS, "--y-mm", (*NOT_FINITE, "1e308", "-1e9", "500")),
    (PRESS, "--yaw-deg", NOT_FINITE),
    (PRESS, "--force-n", (*NOT_FINITE, "0", "-8", "1e-9", "1e9", "101")),
    (PRESS, "--thickness-mm", (*NOT_FINITE, "0", "-1", "0.3", "1e9", "201")),
    (PRESS, "--young-mpa", (*NOT_FINITE, "0", "-1", "1e-9", "1e9")),
    (PRESS, "--poisson", (*NOT_FINITE, "-0.1", "0.5", "1")),
    (TRAIN, "--minutes", (*NOT_FINITE, "0", "-1")),
    (TRAIN, "--iou-weight", (*NOT_FINITE, "-1", "1")),
    ((*CALIBRATE,), "--ball-diameter-mm", (*NOT_FINITE, "0", "-4", "1e9")),
    ((*CALIBRATE, "--ball-diameter-mm", "4"), "--scale-px-per-mm", (*NOT_FINITE, "0", "-1", "1e9")),
    ((*CALIBRATE, "--ball-diameter-mm", "4"), "--ball-tolerance-mm", (*NOT_FINITE, "-1", "4")),
    (
        (*CALIBRATE, "--ball-diameter-mm", "4"),
        "--scale-tolerance-px-per-mm",
        (*NOT_FINITE, "-1", "15"),
    ),
    ((*CALIBRATE, "--ball-diameter-mm", "4"), "--depth-tolerance-mm", (*NOT_FINITE, "-1")),
    ((*CALIBRATE, "--ball-diameter-mm", "4"), "--force-tolerance-n", (*NOT_FINITE, "-1")),
    ((*CALIBRATE, "--ball-diameter-mm", "4"), "--young-tolerance-mpa", (*NOT_FINITE, "-1", "0.5")),
)
"""Command, flag, and numbers that it must refuse."""

BIG = str(2**70)
INTEGERS: tuple[tuple[tuple[str, ...], str, tuple[str, ...]], ...] = (
    (PRESS, "--seed", ("-1", BIG, str(2**63))),
    (("studio",), "--port", ("-1", "65536", BIG)),
    (("live", "--run", "{resnet18}", "{data}"), "--frames", ("0", "-1")),
    (SIMDATA, "--seed", ("-1", BIG, str(2**63))),
    (SIMDATA, "--workers", ("0", "-1")),
    (TRAIN, "--seed", ("-1", BIG, str(2**63))),
    (TRAIN, "--epochs", ("0", "-1")),
    (IMPORT, "--seed", ("-1", BIG, str(2**63))),
    (IMPORT, "--full-scale", ("0", "-1", "65536", BIG)),
    ((*CALIBRATE, "--ball-diameter-mm", "4"), "--held-out", ("-1", BIG)),
)
NO_INTEGERS = (*NO_NUMBERS, "1.5", "1e3", "nan")

SHAPES = ("", "square-9", "Square-2", "pliers", "pliers/none", "../square-2", "square-2\n",
          "x" * 5000, "squäre", "random", "square-2/", "~", "/", "/dev/null", "/etc",
          "-")  # fmt: skip
WORDS: tuple[tuple[tuple[str, ...], str], ...] = (
    (("simdata", "--scale", "huge", *OUT), "scale"),
    (("simdata", "--scale", "", *OUT), "scale"),
    (("simdata", *OUT), "--scale is missing"),
    ((*SIMDATA, "--layout", "none"), "layout"),
    ((*SIMDATA, "--layout", ""), "layout"),
    ((*SIMDATA, "--imperfections", "some"), "imperfections"),
    ((*SIMDATA, "--calibration", "none.npz"), "none.npz"),
    ((*SIMDATA, "--scheduler", "foo"), "scheduler"),
    ((*SIMDATA, "--scheduler", "tcp://"), "scheduler"),
    ((*SIMDATA, "--scheduler", ""), "scheduler"),
    ((*SIMDATA, "--scheduler", "tcp://127.0.0.1:99999"), "scheduler"),
    ((*SIMDATA, "--scheduler", "tcp://127.0.0.1:1", "--workers", "2"), "--workers"),
    (("simdata", "--verify", "nowhere"), "holds no dataset"),
    (("simdata", "--verify", "/dev/null"), "holds no dataset"),
    (("train", "gpt", "--data", "{data}", *OUT), "touch2touch"),
    (("train", "", "--data", "{data}", *OUT), "touch2touch"),
    (("train", "resnet18", "--data", "nowhere", *OUT), "nowhere"),
    (("train", "resnet18", "--data", "", *OUT), "holds no dataset"),
    (("train", "resnet18", "--data", "{data}", "--preset", "huge", *OUT), "preset"),
    (("train", "resnet18", "--data", "{data}", "--preset", "", *OUT), "preset"),
    (("train", "resnet18", "--data", "{resnet18}", *OUT), "holds no dataset"),
    ((*TRAIN, "--direction", "cyskin-to-digit"), "touch2touch has both"),
    (("evaluate", "nowhere", "--data", "{data}", *OUT), "nowhere"),
    (("evaluate", "--data", "{data}", *OUT), "run"),
    (("evaluate", "{data}", "--data", "{data}", *OUT), "config.json"),
    (("evaluate", "{resnet18}", "--data", "nowhere", *OUT), "nowhere"),
    (("evaluate", "{resnet18}", "{resnet18}", "--data", "{data}", *OUT), "twice"),
    (("translate", "--run", "nowhere", "x.png", *OUT), "x.png"),
    (("translate", "--run", "{resnet18}", *OUT), "image"),
    (("translate", "--run", "{resnet18}", "nowhere.png", *OUT), "nowhere.png"),
    (("translate", "--run", "{resnet18}", "", *OUT), "image"),
    (("translate", "--run", "{resnet18}", "x" * 5000, *OUT), "too long"),
    (("export", "--run", "nowhere", "--out", "x.onnx"), "nowhere"),
    (("export", "--run", "{data}", "--out", "x.onnx"), "config.json"),
    (("export", "--run", "{resnet18}", "--layout", "none", "--out", "x.onnx"), "layout"),
    (("export", "--run", "{resnet18}", "--layout", "cyskin-63", "--out", "x.onnx"), "ResNet18"),
    (("report", "--data", "nowhere", *OUT), "nowhere"),
    (("report", "--data", "{data}", "--runs", "nowhere", *OUT), "nowhere"),
    (("report", "--data", "{data}", "--evaluation", "{evaluation}", *OUT), "--runs"),
    (("import-pairs", "nowhere", *OUT), "nowhere"),
    (("import-pairs", "nowhere.csv", *OUT), "nowhere.csv"),
    (("import-pairs", "", *OUT), "csv"),
    (("import-pairs", "/dev/null", *OUT), "csv"),
    ((*CALIBRATE, "--ball-diameter-mm", "4"), "background.png"),
    (("calibrate", "--background", "none.png", *OUT), "none.png"),
    (("calibrate", "--background", "none.png", "--ball-diameter-mm", "4", *OUT), "--presses"),
    (("calibrate", "--background", "none.png", "--held-out", "3", *OUT), "--presses"),
    (CALIBRATE, "--ball-diameter-mm is missing"),
    ((*PRESS, "--seed", "1", "--imperfections", "some"), "imperfections"),
    (("studio", "--run", "nowhere"), "nowhere"),
    (("studio", "--run", "{data}"), "config.json"),
    (("studio", "--host", "nowhere"), "cannot listen on"),
    (("studio", "--host", ""), "cannot listen on"),
    (("studio", "--source", "nowhere"), "no source"),
    (("live", "--run", "nowhere", "{data}"), "nowhere"),
    (("live", "--run", "{data}", "{data}"), "config.json"),
    (("live", "--run", "{resnet18}", "nowhere"), "no source"),
    (("live", "--run", "{resnet18}", ""), "no source"),
    (("live", "--run", "{resnet18}", "/dev/null"), "no source"),
    (("live", "--run", "{resnet18}", "http://127.0.0.1:9/x.mp4"), "no source"),
    (("live", "--run", "{resnet18}", "{data}", "--layout", "none"), "layout"),
)
"""Command lines, and what the sentence must hold."""

PARSED: tuple[tuple[tuple[str, ...], str], ...] = (
    ((), "a command is missing"),
    (("pres",), "did you mean press?"),
    (("Press",), "did you mean press?"),
    (("sim-data",), "did you mean simdata?"),
    (("tranlsate", "x.png"), "did you mean translate?"),
    (("import_pair",), "did you mean import-pairs?"),
    (("zzz",), "there is no command 'zzz'; see t2twin --help"),
    (("",), "there is no command ''"),
    (("-x",), "there is no option '-x'"),
    (("--no-such-flag",), "there is no option '--no-such-flag'; see t2twin --help"),
    (("--version", "press"), "there is no option '--version'"),
    (("--tyro-print-completion", "sh"), "expected bash, zsh, tcsh or fish"),
    (("--tyro-print-completion",), "expected bash, zsh, tcsh or fish"),
    (("press",), "SHAPE is missing; see t2twin press --help"),
    (("press", "--force-n", "8"), "SHAPE is missing"),
    (("press", "--shape", "circle-1"), "SHAPE is missing"),
    (("press", "--", "circle-1", "square-1"), "unexpected argument 'square-1'"),
    (("press", "circle-1", "square-1"), "unexpected argument 'square-1'"),
    (("press", "circle-1", "--force", "8"), "did you mean --force-n?"),
    (("press", "circle-1", "--Force-n", "8"), "did you mean --force-n?"),
    (("press", "circle-1", "--ya-deg=8"), "did you mean --yaw-deg?"),
    (("press", "circle-1", "-f"), "there is no option '-f'"),
    (("press", "circle-1", "--sensor", "gelsight"), "expected digit, cyskin or both"),
    (("press", "circle-1", "--sensor", "Digit"), "--sensor is 'Digit'"),
    (("press", "circle-1", "--sensor", ""), "--sensor is ''"),
    (("press", "circle-1", "--optics", "PyRender"), "expected baked or pyrender"),
    (("press", "circle-1", "--force-n"), "--force-n has no value; expected a number"),
    (("press", "circle-1", "--x-mm", "--y-mm", "3"), "--x-mm has no value"),
    (("press", "circle-1", "--flat=yes"), "unexpected argument 'yes'"),
    (("press", "circle-1", "--scale=abc"), "--scale is 'abc'; expected a number"),
    (("press", "circle-1", "--depth_mm="), "--depth-mm is ''; expected a number"),
    (("press", "circle-1", "--x-mm", "1", "--x-mm", "2,0"), "--x-mm is '2,0'"),
    (("press", "circle-1", "--yaw-deg", "1\n2"), "--yaw-deg is '1\\n2'"),
    (("press", "circle-1", "--calibration"), "--calibration has no value; expected FILE"),
    (("press", "circle-1", "--imperfections"), "--imperfections has no value; expected NAME"),
    (("press", "circle-1", "--layout"), "--layout has no value; expected a name"),
    (("train",), "MODEL and --data are missing; see t2twin train --help"),
    (("train", "resnet18"), "--data is missing"),
    (("train", "--data", "{data}"), "MODEL is missing"),
    (("train", "resnet18", "--dta", "{data}"), "did you mean --data?"),
    (("train", "resnet18", "--data", "{data}", "{data}"), "unexpected argument"),
    ((*TRAIN, "--direction", "sideways"), "expected digit-to-cyskin or cyskin-to-digit"),
    ((*TRAIN, "--direction", "up"), "--direction is 'up'"),
    ((*TRAIN, "--steps", "1.5"), "--steps is '1.5'; expected a whole number"),
    ((*TRAIN, "--preset"), "--preset has no value"),
    (("calibrate-uncertainty", "run"), "--data is missing"),
    (("calibrate-uncertainty",), "RUN and --data are missing"),
    (("evaluate", "{resnet18}"), "--data is missing"),
    (("evaluate", "{resnet18}", "--data", "{data}", "--split", "train set"), "val, test or both"),
    (("translate",), "there is no image"),
    (("translate", "--layuot", "cyskin-20", "x.png"), "did you mean --layout?"),
    (("translate", "--untouched", "x.png", "x.png"), "--untouched is now --background"),
    (("translate", "--untouched=x.png", "x.png"), "--untouched is now --background"),
    (("translate", "x.png", "--run"), "--run has no value; expected RUN"),
    (("translate", "field", "x.png", *OUT), "field is a run, not an image; give it as --run field"),
    (("translate", "{resnet18}", "x.png", *OUT), "is a run, not an image; give it as --run"),
    (("translate", "x.png", "{touch2touch}", *OUT), "is a run, not an image"),
    (("translate", "x.png", "--run", "./field", *OUT), "x.png"),
    (("export", "field"), "give a run with --run RUN; see t2twin export --help"),
    (("export", "{resnet18}"), "give a run with --run RUN"),
    (("export", "--run"), "--run has no value"),
    (("export", "--run", "./field", "--out", "x.onnx"), "there is no run ./field"),
    (("export", "--run", "fild", "--out", "x.onnx"), "there is no run fild"),
    (("export", "--run", "", "--out", "x.onnx"), "run is ''"),
    (("export", "--force", "yes"), "unexpected argument 'yes'"),
    (("calibrate",), "--background is missing"),
    (("calibrate", "--background"), "--background has no value; expected PNG"),
    (("adapt",), "--background and --presses and --ball-diameter-mm are missing"),
    (
        (
            "adapt",
            "--background",
            "b.png",
            "--presses",
            "p",
            "--ball-diameter-mm",
            "4.7",
            "--workers",
            "0",
            *OUT,
        ),
        "workers is 0",
    ),
    (("import-pairs", "x.csv"), "--out is missing"),
    (("simdata", "--verify"), "--verify has no value"),
    (("simdata", "smoke"), "unexpected argument 'smoke'"),
    (("simdata", "--optics", "x", *OUT), "expected baked or pyrender"),
    ((*SIMDATA, "--workers", "100000"), "1 to 1000"),
    ((*SIMDATA, "--workers", "1001"), "1 to 1000"),
    ((*SIMDATA, "--workers", str(2**70)), "1 to 1000"),
    (("live",), "SOURCE is missing"),
    (("live", "field", "0"), "give a run with --run RUN; see t2twin live --help"),
    (("live", "--run", "{resnet18}", "0", "--turn-deg", "45"), "expected 0, 90, 180 or 270"),
    (("studio", "--port"), "--port has no value"),
    (("studio", "--port", "1.5"), "--port is '1.5'; expected a whole number"),
    (("report", "--runs"), "holds no dataset"),
    (("report", "x"), "unexpected argument 'x'"),
    (("shapes", "all"), "unexpected argument 'all'; see t2twin shapes --help"),
    (("doctor", "now"), "unexpected argument 'now'"),
    (("doctor", "--fix"), "there is no option '--fix'"),
)
"""Command lines that the parser refuses itself, or nearly, and what the sentence must hold."""

FINE: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("yaw of a thousand turns", (*PRESS, "--yaw-deg", "360000")),
    ("a force in scientific writing", (*PRESS, "--force-n", "8e-1")),
    ("the least force", (*PRESS, "--force-n", "0.01")),
    ("minus nothing", (*PRESS, "--x-mm", "-0.0")),
    ("one sensor alone", (*PRESS, "--sensor", "cyskin")),
    ("a thin flat layer", (*PRESS, "--flat", "--thickness-mm", "0.5", "--sensor", "digit")),
    ("out with spaces and umlauts", ("press", "circle-1", "--out", "mein Ordner/für später")),
    ("out below the folder itself", ("press", "circle-1", "--out", "./a/../out")),
    ("the largest seed", (*TRAIN, "--seed", str(2**63 - 1), "--epochs", "1")),
    ("a thousandth of a minute", (*TRAIN, "--minutes", "0.001")),
    ("a press with noise", (*PRESS, "--seed", "0", "--imperfections", "all")),
    ("shapes", ("shapes",)),
    ("version", ("--version",)),
    ("help", ("--help",)),
    ("help of a command", ("simdata", "--help")),
    ("verify", ("simdata", "--verify", "{data}")),
    ("export", ("export", "--run", "{touch2touch}", "--out", "x.onnx")),
    ("doctor", ("doctor",)),
    ("press far off the middle", (*PRESS, "--x-mm", "14", "--depth-mm", "0.5")),
    ("an option with an underscore", (*PRESS, "--yaw_deg", "3", "--sensor=cyskin")),
    ("an option's last value", (*PRESS, "--sensor", "digit", "--sensor", "cyskin")),
    ("a completion", ("--tyro-print-completion", "bash")),
    ("report of a dataset", ("report", "--data", "{data}", *OUT)),
)


def cases() -> Iterator[Case]:
    for command, flag, bad in FLOATS:
        yield from _numbers(command, flag, bad, NO_NUMBERS)
    for command, flag, bad in INTEGERS:
        yield from _numbers(command, flag, bad, NO_INTEGERS)
    for shape in SHAPES:
        yield Case(f"press {shape[:20]!r}", ("press", shape, *OUT))
    for words, says in WORDS:
        yield Case(_name(words), words, says=says)
    for words, says in PARSED:
        yield Case(_name(words), words, says=says)
    for name in ("random-01", "random-00", "random-1 ", "random-+1", "random-1_0", "random-٣"):
        yield Case(f"press {name!r}", ("press", name, *OUT), says="shape")
    for name, words in FINE:
        yield Case(name, words, fine=True)


def _numbers(
    command: tuple[str, ...], flag: str, bad: tuple[str, ...], unread: tuple[str, ...]
) -> Iterator[Case]:
    make = INPUTS.get(command[0], nothing)
    for value in bad:
        yield Case(f"{command[0]} {flag} {value[:20]}", (*command, flag, value), make)
    for value in unread:
        yield Case(f"{command[0]} {flag} {value!r}", (*command, flag, value), make, flag)


def _name(words: tuple[str, ...]) -> str:
    return " ".join(word[:20] for word in words)
