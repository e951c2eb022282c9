"""Recipes of worlds."""

from collections.abc import Iterator

from benchmarks.inputs.case import Case, holding
from benchmarks.inputs.images import PNG

SIMDATA = ("simdata", "--out", "out", "--workers", "1", "--world")
FILE = "w.toml"

HEAD = 'format = 1\nname = "mine"\n'
RANDOM = 'shapes = "random"\ncount = 1\npresses = 1\nplace = { normal_mm = 1.0 }\n'
PART = f"[[parts]]\n{RANDOM}"

BAD_FILES: tuple[tuple[str, bytes | str], ...] = (
    ("empty", ""),
    ("a picture", PNG),
    ("JSON", '{"format": 1}'),
    ("half a line", 'format = 1\nname = "mi'),
    ("nothing but a name", HEAD),
    ("no part", HEAD + "parts = []\n"),
    ("parts are a number", HEAD + "parts = 3\n"),
    ("no name", "format = 1\n" + PART),
    ("an empty name", 'format = 1\nname = ""\n' + PART),
    ("another format", 'format = 2\nname = "mine"\n' + PART),
    ("a key nobody knows", HEAD + "sead = 3\n" + PART),
    ("a negative seed", HEAD + "seed = -1\n" + PART),
    ("a seed of text", HEAD + 'seed = "one"\n' + PART),
    ("a seed too large for random shapes", HEAD + "seed = 99999999999\n" + PART),
    ("a key twice", HEAD + 'name = "other"\n' + PART),
    ("a layout that is none", HEAD + 'layout = "nowhere"\n' + PART),
    ("imperfections that are none", HEAD + 'imperfections = "some"\n' + PART),
    ("a field of text", HEAD + 'field = "yes"\n' + PART),
    ("bytes that are no text", b"\xff\xfe\x00"),
    ("deeply nested", HEAD + "parts = " + "[" * 5000 + "]" * 5000 + "\n"),
)

BAD_PARTS = (
    ("no shapes", "count = 1\n"),
    ("shapes of a number", "shapes = 7\n"),
    ("a folder that is not there", 'shapes = "gone"\npresses = 1\nplace = { normal_mm = 1.0 }\n'),
    ("no count", 'shapes = "random"\npresses = 1\nplace = { normal_mm = 1.0 }\n'),
    ("count 0", RANDOM.replace("count = 1", "count = 0")),
    ("count of a fraction", RANDOM.replace("count = 1", "count = 1.5")),
    ("count without end", RANDOM.replace("count = 1", "count = 1000000000")),
    ("presses 0", RANDOM.replace("presses = 1", "presses = 0")),
    ("no presses", 'shapes = "random"\ncount = 1\nplace = { normal_mm = 1.0 }\n'),
    ("a place of both kinds", RANDOM.replace("{ n", "{ uniform_mm = 1.0, n")),
    ("a place of neither", RANDOM.replace("normal_mm = 1.0", "")),
    ("a place of infinity", RANDOM.replace("= 1.0", "= inf")),
    ("a place of nan", RANDOM.replace("= 1.0", "= nan")),
    ("a negative place", RANDOM.replace("= 1.0", "= -1.0")),
    ("a place far away", RANDOM.replace("= 1.0", "= 1000.0")),
    ("random shapes on the grid", 'shapes = "random"\ncount = 1\n'),
    ("force 0", RANDOM + "force_n = 0.0\n"),
    ("force of infinity", RANDOM + "force_n = inf\n"),
    ("force of nan", RANDOM + "force_n = nan\n"),
    ("a negative force", RANDOM + "force_n = -8.0\n"),
    ("forces of text", RANDOM + 'force_n = ["eight"]\n'),
    ("no forces", RANDOM + "force_n = []\n"),
    ("a range without its high", RANDOM + "force_n = { low = 1.0 }\n"),
    ("a range inside out", RANDOM + "force_n = { low = 5.0, high = 1.0 }\n"),
    ("a range that is left out whole",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leave_out = [[0.5, 6.0]] }\n"),
    ("an untouched share of 2", RANDOM + "untouched_share = 2.0\n"),
    ("a validation share of nan", RANDOM + "val_share = nan\n"),
    ("a split nobody has", RANDOM + 'split = "trian"\n'),
    ("random by version", RANDOM + 'split = "by-version"\n'),
    ("tools to train on", 'shapes = "tools"\n'),
    ("a scale nobody has", 'shapes = "primitives"\nscale = "huge"\n'),
    ("a misspelt key", RANDOM + "untouchd_share = 0.1\n"),
)  # fmt: skip

BAD_LIGHTS = (
    ("a kind nobody has", 'kind = "bright"\n'),
    ("a calibration that is not there", 'calibration = "gone.npz"\n'),
    ("a calibration of a number", "calibration = 3\n"),
    ("optics nobody has", 'optics = "opengl"\n'),
    ("another for each tool", 'each = "tool"\n'),
    ("a misspelt key", 'kynd = "drawn"\n'),
    ("a draw of a number", "draw = 1\n"),
    ("a misspelt draw", 'kind = "drawn"\n[light.draw]\nled_sice_mm = [1.0, 2.0]\n'),
    ("a draw inside out", 'kind = "drawn"\n[light.draw]\nled_size_mm = [4.0, 1.0]\n'),
    ("a draw of nan", 'kind = "drawn"\n[light.draw]\nled_size_mm = [nan, 1.0]\n'),
    ("a draw of three", 'kind = "drawn"\n[light.draw]\nled_size_mm = [1.0, 2.0, 3.0]\n'),
    ("pyrender with a calibration", 'optics = "pyrender"\ncalibration = "gone.npz"\n'),
)

ARGUMENTS = (
    (("--world", "nowhere"), "there is no world"),
    (("--world", ""), "there is no world"),
    (("--world", "gone.toml"), "cannot be read"),
    (("--world", "/dev/null"), "there is no world"),
    (("--world", "open", "--scale", "smoke"), "does not go with"),
    (("--world", "open", "--calibration", "c.npz"), "does not go with"),
    (("--world", "open", "--imperfections", "all"), "does not go with"),
)


def cases() -> Iterator[Case]:
    for name, content in BAD_FILES:
        yield Case(f"world: {name}", (*SIMDATA, FILE), holding(FILE, content))
    for name, part in BAD_PARTS:
        content = f"{HEAD}[[parts]]\n{part}"
        yield Case(f"part: {name}", (*SIMDATA, FILE), holding(FILE, content))
    for name, light in BAD_LIGHTS:
        content = f"{HEAD}{PART}[light]\n{light}"
        yield Case(f"light: {name}", (*SIMDATA, FILE), holding(FILE, content))
    for words, says in ARGUMENTS:
        yield Case(f"asked: {' '.join(words)}", ("simdata", "--out", "out", *words), says=says)
    for name in ("random-", "random-x", "random--1", "random-1.5", f"random-{2**64}"):
        yield Case(f"shape: {name}", ("press", name, "--out", "out"))
    yield Case("world: fine", (*SIMDATA, FILE), holding(FILE, HEAD + PART), fine=True)
    drawn = HEAD + PART + 'untouched_share = 0.9\n[light]\nkind = "drawn"\neach = "press"\n'
    yield Case("world: fine, in drawn light", (*SIMDATA, FILE), holding(FILE, drawn), fine=True)
