"""Recipes of worlds, and the folders of solids that they name."""

from collections.abc import Iterator

from cases import PLACES, Case, Content, laid

MADE = "simdata --out out --workers 1 --world "
HEAD = 'format = 1\nname = "mine"\n'
PART = '[[parts]]\nshapes = "random"\ncount = 1\npresses = 1\nplace = { normal_mm = 1.0 }\n'
RECIPE = HEAD + PART

BAD_HEADS = ('{"format": 1}', 'format = 1\nname = "mi', HEAD, HEAD + "parts = []\n",
    HEAD + "parts = 3\n", "format = 1\n" + PART, 'format = 1\nname = ""\n' + PART,
    'format = 2\nname = "mine"\n' + PART, HEAD + "parts = " + "[" * 5000 + "]" * 5000 + "\n",
    *(f"{HEAD}{line}\n{PART}" for line in (
        "sead = 3", "seed = -1", 'seed = "one"', "seed = 99999999999", 'name = "other"',
        'layout = "nowhere"', 'imperfections = "some"', 'field = "yes"')))  # fmt: skip

REPLACED = {
    "count = 1\n": ("", "count = 0\n", "count = 1.5\n", "count = 1000000000\n"),
    "presses = 1\n": ("", "presses = 0\n", "presses = 1000000\n"),
    '"random"': ("7", '"gone"', '"tools"'), 'shapes = "random"\n': ("",),
    "presses = 1\nplace = { normal_mm = 1.0 }\n": ("",),
    "normal_mm = 1.0": ("uniform_mm = 1.0, normal_mm = 1.0", "", "nomal_mm = 1.0", "normal = 1.0",
                        *(f"normal_mm = {v}" for v in ("inf", "nan", "-1.0", "1000.0"))),
}  # fmt: skip
"""Text of the valid part, and what replaces it."""

RANGE = "force_n = { low = 1.0, high = 5.0, "
ADDED = (
    *(f"force_n = {v}" for v in ("0.0", "inf", "nan", "-8.0", '["eight"]', "[]", [1.0] * 10_000,
                                 "{ low = 1.0 }", "{ low = 5.0, high = 1.0 }")),
    *(f"{RANGE}leave_out = {v} }}" for v in (
        "[[0.5, 6.0]]", "[[1.01, 3.0], [2.0, 4.99]]", "[[1.0000001, 4.9999999]]", "[[1.01, 4.7]]",
        [[2.0, 3.0]] * 1000, "[[nan, 3.0]]", "[[3.0, 2.0]]", "[[3.0]]")),
    RANGE + "leaveout = [[2.0, 3.0]] }", "untouched_share = 2.0", "val_share = nan", "seed = 3",
    'split = "trian"', 'split = "by-version"', 'split = "Train"', "untouchd_share = 0.1",
    'scale = "small"', 'split = "val"\nval_share = 0.5', "val_share = 0.02", "[motion]",
    "[motion]\nslide = 0.0\ntwist = 0.6\nslide_mm = [1.0, 2.0]",
)  # fmt: skip
"""Lines that make the valid part invalid."""

LIGHTS = (
    'kind = "bright"', 'calibration = "gone.npz"', "calibration = 3", 'optics = "opengl"',
    'each = "tool"', 'kynd = "drawn"', "draw = 1", 'optics = "pyrender"\ncalibration = "gone.npz"',
    *(f'kind = "drawn"\n[light.draw]\n{line}' for line in (
        "led_sice_mm = [1.0, 2.0]", "led_size_mm = [4.0, 1.0]", "led_size_mm = [nan, 1.0]",
        "led_size_mm = [1.0, 2.0, 3.0]", "around_part = [0.0, 0.1]",
        "specks = [0, 0]\nspeck_px = [1.0, 2.0]")),
    'each = "press"', "[light.draw]\nled_size_mm = [1.0, 2.0]", "[light.artifacts]",
    'kind = "drawn"\n[light.artifacts]\nworn = 0.0\nwear_part = [0.1, 0.2]',
)  # fmt: skip

SOLIDS = HEAD + PART.replace('"random"\ncount = 1', '"solids"')


def _obj(value: str) -> str:
    return f"v {value} 0 0\nv 0 {value} 0\nv 0 0 {value}\nf 1 2 3\n"


BAD_SOLIDS: dict[str, tuple[Content, str]] = {
    "notes.txt": ("", "no solids"), "a.obj": (_obj("1e300"), "a.obj"), "b.obj": (_obj("nan"), "b."),
    "a.step": ("x", "a.step"),
}  # fmt: skip
"""Files of a folder of solids, and a part of the sentence."""

OPTIONS = {
    "nowhere": "there is no world", "''": "expected a path", "gone.toml": "no file gone.toml",
    "/dev/null": "there is no world", "open --scale smoke": "cannot be used with",
    "open --calibration c.npz": "cannot be used with",
    "open --imperfections all": "cannot be used with",
}  # fmt: skip


def cases() -> Iterator[Case]:
    texts = [*BAD_HEADS, *(f"{RECIPE}{line}\n" for line in ADDED)]
    texts += [RECIPE.replace(old, new) for old, news in REPLACED.items() for new in news]
    texts += [HEAD + '[[parts]]\nshapes = "primitives"\nscale = "huge"\n']
    texts += [f"{RECIPE}[light]\n{light}\n" for light in LIGHTS]
    for number, text in enumerate(texts):
        name = f"recipe {number}: {text.removeprefix(RECIPE)[:60]}"
        yield Case(name, MADE + "w.toml", laid({"w.toml": text}))
    for file, (content, says) in BAD_SOLIDS.items():
        files: dict[str, Content] = {"w.toml": SOLIDS, f"solids/{file}": content}
        yield Case(f"solids: {file}", MADE + "w.toml", laid(files), says)
    for name, place in PLACES.items():
        if "device" not in name and "nothing" not in name:
            files = {"w.toml": SOLIDS, "solids/a.stl": place}
            yield Case(f"solids: {name}", MADE + "w.toml", laid(files))
    for words, says in OPTIONS.items():
        yield Case(f"world {words}", f"simdata --out out --world {words}", says=says)
    for name in ("random-", "random-x", "random--1", "random-1.5", f"random-{2**64}", "random-1e3",
                 f"random-{'9' * 5000}"):  # fmt: skip
        yield Case(f"shape {name[:30]}", f"press {name} --out out")
    for name in ("random-3", "wrench/shank", "square-2"):
        yield Case(f"{name} with a scale", f"press {name} --scale 2 --out out", says="files only")
    for workers in ("0", "-1", "1001", "1000000"):
        words = f"simdata --out out --world w.toml --workers {workers}"
        yield Case(f"{workers} workers", words, laid({"w.toml": RECIPE}), "workers")
    drawn = 'untouched_share = 0.9\n[light]\nkind = "drawn"\neach = "press"\n'
    for text in (RECIPE, "\ufeff" + RECIPE, RECIPE + drawn,
                 f"{RECIPE}{RANGE}leave_out = [[1.5, 3.0]] }}\n"):  # fmt: skip
        yield Case(f"valid recipe {text[-30:]}", MADE + "w.toml", laid({"w.toml": text}), fine=True)
