"""Calibration files, frames of presses and forces.csv, for `calibrate` and `adapt`."""

import io
import zipfile
from collections.abc import Iterator
from functools import cache

import numpy as np
from cases import Case, Content, Unpickled, laid
from pictures import JPEG, PNG, bomb, encoded, frame, grey16
from PIL import Image

from t2twin.sim.digit.calibration import DEFAULT_PATH

PRESS = "press circle-1 --sensor digit --out out --calibration c.npz"
ALONE = "calibrate --background background.png --out out"
GIVEN = "--background background.png --presses presses --ball-diameter-mm 4.7 --out out"
CALIBRATE, ADAPT = f"calibrate {GIVEN}", f"adapt {GIVEN}"

UNTOUCHED = encoded(Image.new("RGB", (240, 320), (90, 90, 90)))
FRAMES: dict[str, Content] = {
    "background.png": UNTOUCHED,
    **{f"presses/press_{number}.png": encoded(frame(number)) for number in range(8)},
}
"""Frames of the right size, to which no calibration can be fitted."""


def _packed(**arrays: np.ndarray) -> bytes:
    """The default calibration with some arrays changed."""
    with np.load(DEFAULT_PATH) as kept:
        arrays = {key: kept[key] for key in kept.files} | arrays
    file = io.BytesIO()
    np.savez(file, **{key: array for key, array in arrays.items() if array.size})  # pyright: ignore[reportArgumentType]
    return file.getvalue()


@cache
def _zip_bomb() -> bytes:
    file, array = io.BytesIO(), io.BytesIO()
    np.save(array, np.zeros(25_000_000))
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        archive.writestr("response.npy", array.getvalue())
    return file.getvalue()


def calibrations() -> Iterator[tuple[str, bytes, bool]]:
    """Name, content, and whether it is valid."""
    with np.load(DEFAULT_PATH) as kept:
        good = {key: kept[key] for key in kept.files}
    whole, number = _packed(), np.array
    yield "an empty zip", b"PK\x05\x06" + bytes(18), False
    yield "a bomb", _zip_bomb(), False
    for share in (0.2, 0.9, 0.999):
        yield f"cut at {share:.1%}", whole[: int(share * len(whole))], False
    middle = len(whole) // 2
    flipped = bytes([whole[middle] ^ 255])
    yield "a flipped byte", whole[:middle] + flipped + whole[middle + 1 :], False
    for key, array in good.items():
        others = {"missing": number([]), "text": number("abc"), "complex": array * (1 + 1j),
                  "of objects": number([Unpickled()], dtype=object)}  # fmt: skip
        if key != "background":
            values = (np.nan, np.inf, 1e38, -1e30)
            others |= {str(value): np.full(array.shape, value) for value in values}
            others["times 1e30"] = array * 1e30
        for name, other in others.items():
            yield f"{key} {name}", _packed(**{key: other}), False
    background, young = good["background"], (np.nan, np.inf, 0.0, -0.5, 1e9, [0.4, 0.5], "soft")
    for key, values in {
        "background": (background / 255.0, background[::2], background.swapaxes(0, 1)),
        "sizes_mm": (-good["sizes_mm"],), "shift_x_px": (1e6,), "tilt_y_deg": (80.0,),
        "tilt_x_deg": (np.nan,), "lamps_mm": (good["lamps_mm"][:2],), "young_mpa": young,
    }.items():  # fmt: skip
        for index, value in enumerate(values):
            yield f"{key}, {index}", _packed(**{key: number(value)}), False
    for key, values in {
        "young_mpa": (0.05,), "note": ("mine",), "shift_y_px": (-100.0,), "tilt_x_deg": (5.0,),
        "response": (good["response"].astype(np.float32), good["response"] * 0),
        "background": (background * 0,), "lamps_mm": (good["lamps_mm"] * 22.0, np.zeros((3, 3))),
        "sizes_mm": ([100.0] * 3,), "distance_mm": (100.0, 5.0), "scale_px_per_mm": (5.0, 100.0),
    }.items():  # fmt: skip
        for index, value in enumerate(values):
            yield f"valid {key}, {index}", _packed(**{key: number(value)}), True


def _other(content: Content, name: str = "press_9.png") -> dict[str, Content]:
    return FRAMES | {f"presses/{name}": content}


def _eight(content: bytes, background: bytes = UNTOUCHED) -> dict[str, Content]:
    return {"background.png": background, **{f"presses/{n}.png": content for n in range(8)}}


def _sized(kind: str, *size: int) -> dict[str, Content]:
    content = encoded(frame(size=(size[0], size[1])))
    return FRAMES | {"background.png": content} if kind == "background" else _other(content)


BAD_FRAMES: tuple[tuple[str, dict[str, Content], str], ...] = (
    ("no background", {"presses/1.png": PNG}, "background.png"),
    ("a wide background", _sized("background", 320, 240), "wide"),
    ("a background of 1 x 1", _sized("background", 1, 1), "wide"),
    ("a bomb as background", FRAMES | {"background.png": bomb()}, "pixels"),
    ("notes only", {"background.png": UNTOUCHED, "presses/notes.txt": b"x"}, "presses"),
    ("one press", {"background.png": UNTOUCHED, "presses/1.png": PNG}, "press"),
    ("a bomb as press", _other(bomb()), "press_9.png"),
    ("a press of another size", _sized("press", 240, 240), "press_9.png"),
    ("presses of nothing", _eight(UNTOUCHED), ""),
    ("one press eight times", _eight(PNG), ""),
    ("a GIF as PNG", _other(encoded(frame(), "GIF")), "press_9.png"),
    ("a TIFF as PNG", _other(encoded(frame(), "TIFF")), "press_9.png"),
    ("a press without its end", _other(PNG[:-12]), "press_9.png"),
    ("a press without its last byte", _other(PNG[:-1]), "press_9.png"),
    ("a background without its end", FRAMES | {"background.png": UNTOUCHED[:-12]}, "background"),
    ("half a JPEG", _other(JPEG[: len(JPEG) // 2], "press_9.jpg"), "press_9.jpg"),
    ("16 bits", _other(grey16()), "8 bits"),
    ("all of another size", _eight(*[encoded(frame(size=(120, 160)))] * 2), "wide"),
    ("presses are a file", {"background.png": UNTOUCHED, "presses": JPEG}, "presses"),
)  # fmt: skip

BAD_TABLES = """
force_n\\n1.0|file,force_n\\nnone.png,1.0|file,force_n\\n0,1\\n0,1|file,force_n\\n../background.png,1
file,force_n\\n,1|file,force_n\\n0,soft|file,force_n\\n0,0|file,force_n\\n0,-1|file,force_n\\n0,inf
file,force_n\\n0,1e9|file,depth_mm\\n0,900|file,depth_mm\\n0,0|file,ball_diameter_mm\\n0,40
file,froce_n\\n0,1|file,depht_mm\\n0,1|file,force\\n0,1|file,depth_um\\n0,900|file,Force_N\\n0,1
file,force_n,note\\n0,1,good|file,force_n,\\n0,1,|file,force_n,force_n\\n0,1,2
file,file\\n0,press_1.png|file,force_n\\n0,nan|file,depth_mm\\n0,NaN|file,ball_diameter_mm\\n0,nan
file,force_n\\n0,1e400|file,force_n\\n0,NA|file,force_n\\n0,null|file,force_n\\n0,1 N
file,force_n\\n0,-inf|file,depth_mm\\n0,true|file;force_n\\n0;1,000,5|file;force_n\\n0;nan
file,force_n\\n"0,1
"""
"""Contents of forces.csv; a 0 at the start of a row stands for press_0.png."""

BAD_OPTIONS = """
--minutes 0 => minutes|--minutes -5 => minutes|--minutes nan => minutes|--minutes inf => minutes
--workers 0 => workers|--workers -1 => workers|--workers 1000000 => workers
--model resnet => model|--init-from gone => gone|--held-out 8 => held out|--held-out 0 => held_out
--model field --init-from {resnet18} => resnet18|--ball-diameter-mm nan => ball
--ball-diameter-mm 0 => ball|--ball-diameter-mm 0.19 => ball|--scale-px-per-mm 0 => scale
--scale-px-per-mm nan => scale|--ball-tolerance-mm -0.1 => tolerance
--depth-tolerance-mm nan => tolerance|--force-tolerance-n inf => tolerance
--young-tolerance-mpa 0.5 => modulus|--out background.png/out => background.png
--out background.png => background.png|--out presses => presses
"""
"""Options of `adapt`, and a part of the sentence."""


def cases() -> Iterator[Case]:
    for name, content, fine in calibrations():
        says = "" if fine else "c.npz"
        yield Case(f"calibration: {name}", PRESS, laid({"c.npz": content}), says, fine)
    for command in (CALIBRATE, ADAPT):
        for name, files, says in BAD_FRAMES:
            yield Case(f"{command[:9]}: {name}", command, laid(files), says)
        for text in BAD_TABLES.strip().replace("\n", "|").split("|"):
            table = text.replace("\\n0", "\npress_0.png").replace('\\n"0', '\n"press_0.png')
            files = FRAMES | {"presses/forces.csv": table.replace("\\n", "\n") + "\n"}
            yield Case(f"{command[:9]}, forces.csv: {text}", command, laid(files), "forces.csv")
    for option in BAD_OPTIONS.strip().replace("\n", "|").split("|"):
        words, _, says = option.partition(" => ")
        yield Case(f"adapt {words}", f"{ADAPT} {words}", laid(FRAMES), says)
    begun = FRAMES | {"out/presses.json": "{}", "out/calibration.npz": b""}
    yield Case("adapt: a damaged earlier start", ADAPT, laid(begun), "presses.json")
    yield Case("the background alone", ALONE, laid({"background.png": UNTOUCHED}), fine=True)
    for content in (b"grey", UNTOUCHED[:200], bomb()):
        files: dict[str, Content] = {"background.png": content}
        yield Case(f"the background alone, {content[:4]}", ALONE, laid(files), "background.png")
    for held in (0, 3, 8, 9):
        yield Case(f"{held} of 8 held out", f"{CALIBRATE} --held-out {held}", laid(FRAMES))
