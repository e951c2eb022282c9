"""Bad words and numbers on the command line."""

import shlex
from collections.abc import Iterator

from cases import PNG, Case, Files, laid
from readers import FRAMES, PAIRS

PREFIXES = {
    "SIM": "simdata --scale smoke --out out",
    "TRAIN": "train resnet18 --data {data} --preset smoke --out out",
    "BALL": "calibrate --ball-diameter-mm 4 --background background.png --presses presses --out o",
    "ADAPT": "adapt --background background.png --presses presses --ball-diameter-mm 4 --out out",
    "LIVE": "live --run {resnet18}",
    "PRESS": "press circle-1 --out out",
    "IMPORT": "import-pairs pairs.csv --out out",
}
"""What a word in capitals stands for."""

NUMBERS = {
    "PRESS --x-mm": "1e308 500 nan", "PRESS --y-mm": "nan", "PRESS --yaw-deg": "inf 1e300",
    "PRESS --force-n": "0 -8 101 nan 8,5", "PRESS --tilt-x-deg": "-30.1 nan",
    "PRESS --thickness-mm": "0 0.3 201 nan", "PRESS --young-mpa": "0 1e-9 1e9 nan",
    "PRESS --poisson": "-0.1 0.5 nan", "PRESS --depth-mm": "0 1e-5 7 nan", "PRESS --seed": "-1 1.5",
    "SIM --seed": f"-1 {2**63}", "SIM --workers": "0 1001", "IMPORT --seed": "-1",
    "IMPORT --full-scale": f"0 65536 {2**70}", "TRAIN --seed": f"-1 {2**63}",
    "TRAIN --epochs": "0 -1", "TRAIN --minutes": "0 -1 nan", "TRAIN --iou-weight": "-1 1 nan",
    "BALL --held-out": "-1 8",
    "calibrate --background background.png --presses presses --out o --ball-diameter-mm":
        "0 -4 1e9 nan",
    "BALL --scale-px-per-mm": "0 1e9 nan", "BALL --ball-tolerance-mm": "-1 4 nan",
    "BALL --depth-tolerance-mm": "-1 nan", "BALL --young-tolerance-mpa": "-1 0.5 nan",
    "ADAPT --minutes": "0 -5 nan", "ADAPT --held-out": "0 8", "ADAPT --workers": "0",
    "demo --minutes": "0.5 nan inf", "LIVE {data} --frames": "0 -1", "studio --port": "-1 65536",
}  # fmt: skip
"""Options of numbers, and numbers that they refuse."""

SHAPES = ("''", "square-9", "Square-2", "pliers", "../square-2", "square-2/", "/dev/null", "/etc",
          "random-", "random-01", "random-1_0", f"random-{2**64}", "x" * 5000)  # fmt: skip

REFUSED = """
| Press | --no-such-flag | press | press circle-1 square-1 | press circle-1 --force-n
press circle-1 | --sensor gelsight => gelsight | --flat=yes | --x-mm 1 --x-mm 2,0
press random-3 --out out | --scale 2 => files only
PRESS | --source gelsight => is 'gelsight' | --target no.toml => no.toml
PRESS | --seed 1 --imperfections some => imperfections | --imperfections all => without --seed
PRESS --sensor cyskin | --markers => markers has no effect | --renderer pyrender => renderer has
PRESS --sensor digit | --layout cyskin-63 => layout has no effect on digit
slide circle-1 --out out | => no motion | --dx-mm 1 --path p.csv => --path contains
SIM | --source gelsight => is 'gelsight' | --layout none => layout | --optics n.npz => n.npz
SIM | --scheduler foo => scheduler
simdata --out out | => scale | --scale huge => scale | --renderer x | --recipe gone.toml => gone
simdata --out out --recipe open | --scale smoke => recipe | --layout cyskin-63 => --layout
simdata --verify | nowhere => no dataset
sensors | look | show => SENSOR | check no.toml => no.toml | --out x.png => --out
train | resnet18 | alexnet --data {data} --out out => touch2touch
train resnet18 --out out --data | nowhere => nowhere | {resnet18} => no dataset
TRAIN | --direction counts-to-image => resnet18 has no direction | --preset huge => preset
evaluate --data {data} --out out | nowhere => nowhere | {resnet18} {resnet18} => twice | => run
translate --out out x.png | --run ./field => no run
translate --out out --run {resnet18} | => image | no.png => no.png
export --out x.onnx --run | nowhere => nowhere | {data} => config.json | fild => no run fild
report --data {data} | --runs nowhere => nowhere | --evaluation {evaluation} => --runs
import-pairs --out out | nowhere.csv => nowhere.csv | /dev/null => csv
convert | {data} --to zarr --out x | --to lerobot --out x nowhere => no dataset
calibrate --out out --background none.png | => none.png | --held-out 2 => --presses
ADAPT | --model resnet => model | --init-from gone => gone
adapt --background background.png --presses presses --ball-diameter-mm 4 | --out presses => presses
studio | --run nowhere => nowhere | --source nowhere => no source | --host nowhere => cannot listen
LIVE | nowhere => no source | /dev/zero => no source | d --background d/x.png => field run
LIVE | http://127.0.0.1:9/x.mp4 => no source | d --layout cyskin-63 => ResNet18
"""
"""Start of a command line, then ends of it, each with a part of the expected message."""

FINE = """
PRESS --yaw-deg 36000 | PRESS --force-n 8e-1 | PRESS --x-mm -0.0 | PRESS --sensor target
press circle-1 --out 'mein Ordner/für später' | TRAIN --minutes 0.001
PRESS --source cyskin --target digit | PRESS --source digit --target digit
PRESS --yaw_deg 3 --sensor=cyskin | --version | simdata --help | simdata --verify {data}
"""


def cases() -> Iterator[Case]:
    for option, numbers in NUMBERS.items():
        for number in numbers.split():
            yield _case(f"{option} {number}")
    for shape in SHAPES:
        yield _case(f"press --out out {shape}")
    for line in REFUSED.strip().splitlines():
        start, *ends = (" " + line).split(" | ")
        for end in ends:
            words, _, says = f" {end}".partition(" => ")
            yield _case(f"{start} {words}".strip(), says)
    for command in FINE.strip().replace("\n", " | ").split(" | "):
        yield _case(command, fine=True)


def _case(command: str, says: str = "", fine: bool = False) -> Case:
    words = [PREFIXES.get(word, word) for word in command.split(" ")]
    kind = shlex.split(" ".join(words))[:1]
    files: dict[str, Files] = {
        "import-pairs": PAIRS, "live": {"d/x.png": PNG}, "calibrate": FRAMES, "adapt": FRAMES
    }  # fmt: skip
    return Case(command[:80], " ".join(words), laid(files.get("".join(kind), {})), says, fine)
