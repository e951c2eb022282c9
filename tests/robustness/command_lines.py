"""Bad words and numbers on the command line."""

import shlex
from collections.abc import Iterator

from cases import Case, Files, laid
from pictures import PNG
from readers import FRAMES, PAIRS

PREFIXES = {
    "SIM": "simdata --scale smoke --out out",
    "TRAIN": "train resnet18 --data {data} --preset smoke --out out",
    "CALIBRATE": "calibrate --background background.png --presses presses --out out",
    "BALL": "calibrate --ball-diameter-mm 4 --background background.png --presses presses --out o",
    "ADAPT": "adapt --background background.png --presses presses --ball-diameter-mm 4 --out out",
    "LIVE": "live --run {resnet18}",
    "PRESS": "press circle-1 --out out",
    "IMPORT": "import-pairs pairs.csv --out out",
    "HUGE": str(2**70),
    "LONG": "x" * 5000,
}
"""What a word in capitals stands for."""

NUMBERS = {
    "PRESS --x-mm | PRESS --y-mm": "1e308 500", "PRESS --yaw-deg": "",
    "PRESS --force-n": "0 -8 101", "PRESS --tilt-x-deg | PRESS --tilt-y-deg": "-30.1 31",
    "PRESS --thickness-mm": "0 0.3 201", "PRESS --young-mpa": "0 1e-9 1e9",
    "PRESS --poisson": "-0.1 0.5", "TRAIN --minutes": "0 -1", "TRAIN --iou-weight": "-1 1",
    "CALIBRATE --ball-diameter-mm": "0 -4 1e9", "BALL --scale-px-per-mm": "0 1e9",
    "BALL --ball-tolerance-mm": "-1 4", "BALL --scale-tolerance-px-per-mm": "-1 15",
    "BALL --depth-tolerance-mm | BALL --force-tolerance-n": "-1",
    "BALL --young-tolerance-mpa | ADAPT --young-tolerance-mpa": "-1 0.5",
    "ADAPT --minutes": "0 -5", "ADAPT --scale-px-per-mm": "0",
}  # fmt: skip
"""Options of numbers, and the numbers that they refuse."""

INTEGERS = {
    "PRESS --seed | SIM --seed | TRAIN --seed | IMPORT --seed": "-1 HUGE 9223372036854775808",
    "studio --port": "-1 65536 HUGE", "IMPORT --full-scale": "0 65536 HUGE",
    "LIVE {data} --frames | TRAIN --epochs": "0 -1",
    "SIM --workers | ADAPT --workers": "0 1001 HUGE",
    "BALL --held-out": "-1 HUGE 8", "ADAPT --held-out": "0 8",
}  # fmt: skip
NO_NUMBERS = ("", "abc", "8,5", "--")
NO_INTEGERS = (*NO_NUMBERS, "1.5", "nan")

SHAPES = ("", "square-9", "Square-2", "pliers", "../square-2", "square-2\n", "x" * 5000, "squäre",
          "square-2/", "~", "/dev/null", "/etc", "-", "random", "random-", "random-01", "random--1",
          "random-1 ", "random-1_0", "random-٣", f"random-{2**64}")  # fmt: skip

REFUSED = """
| => a command is missing | Press => did you mean press? | tranlsate x => did you mean translate?
| '' => there is no command '' | -x => there is no option '-x' | --version press => --version
| --no-such-flag => there is no option '--no-such-flag'; see t2twin --help
press | => SHAPE is missing; see t2twin press --help | -- circle-1 b => unexpected argument 'b'
press circle-1 | square-1 => unexpected argument 'square-1' | --force 8 => did you mean --force-n?
press circle-1 | -f => there is no option '-f' | --sensor gelsight => one of both, source
press circle-1 | --force-n => --force-n has no value; expected a number | --sensor '' => --sensor
press circle-1 | --x-mm --y-mm 3 => --x-mm has no value | --flat=yes => unexpected argument 'yes'
press circle-1 | --depth_mm= => --depth-mm is ''; expected a number | --x-mm 1 --x-mm 2,0 => '2,0'
press circle-1 | --optics => --optics has no value; expected FILE
press random-3 --out out | --scale 2 => files only
press square-2 --out out --depth-mm | 1e-5 => needs a force under 0.01 N | nan => above 0
press square-2 --out out --depth-mm | 7 => needs a force over 100 N | 0 => above 0
demo --minutes | 0.5 => minutes is | nan => minutes is | inf => minutes is
PRESS | --source gelsight => no sensor 'gelsight' | --target no.toml => no.toml | --source '' => a
PRESS | --source digit --target digit --layout cyskin-63 => --layout | --source LONG => shorter
SIM | --source gelsight => no sensor 'gelsight' | --target no.toml => no.toml | --target / => sensor
SIM | --source cyskin-63 --optics n.npz => optics | --target digit --layout cyskin-63 => layout
simdata --recipe open --out out | --source no.toml => no.toml | --target cyskn-20 => cyskin-20?
simdata --verify {data} | --source digit => --source cannot | --target x => --target cannot
sensors | look => expected list, show or check | show => SENSOR is missing | list x => no sensor
sensors check | no.toml => no.toml | gelsight => no sensor 'gelsight' | '' => sensor | / => sensor
sensors | --out x.png => no effect with list | show digit --out x.png => no effect with show
PRESS | --seed 1 --imperfections some => imperfections | --imperfections all => without --seed
PRESS --sensor cyskin | --markers => --markers has no effect | --renderer pyrender => --renderer has
PRESS --sensor digit | --layout cyskin-63 => --layout has no effect on digit
slide circle-1 --dx-mm 1 --sensor cyskin --out out | --marker-pitch-mm 2 => --marker-pitch-mm has
simdata --out out | => --scale is missing | --scale huge => scale | --renderer x => expected baked
simdata --verify | => --verify has no value | nowhere => no dataset | /dev/null => no dataset
simdata --verify {data} | --scale smoke => --scale cannot | --workers 2 => --workers cannot be used
simdata --out out --recipe | nowhere => there is no recipe | gone.toml => there is no file gone.toml
simdata --out out --recipe open | --scale smoke => --scale cannot be used with --recipe
simdata --out out --recipe open | --layout cyskin-63 => --layout | --seed 9999999999 => at most
SIM | --layout none => layout | --imperfections some => imperfections | --optics n.npz => n.npz
SIM | --scheduler foo => scheduler | --scheduler tcp://127.0.0.1:1 --workers 2 => --workers
train | => MODEL and --data are missing; see t2twin train --help | resnet18 => --data is missing
train resnet18 --out out --data | nowhere => nowhere | '' => no dataset | {resnet18} => no dataset
train alexnet --data {data} --out out | => touch2touch
TRAIN | --direction counts-to-image => resnet18 has no direction | --preset huge => preset
evaluate --data {data} --out out | nowhere => nowhere | {data} => config.json
evaluate --data {data} --out out | {resnet18} {resnet18} => twice | => run
evaluate {resnet18} --data | nowhere => nowhere | {data} --split 'train set' => val, test or both
translate --out out x.png | {touch2touch} => is a run, not an image | --run ./field => no run
translate --out out --run {resnet18} | => image | '' => image | no.png => no.png | LONG => too long
export | field => give a run with --run RUN; see t2twin export --help | --run => --run has no value
export --out x.onnx --run | nowhere => nowhere | {data} => config.json | fild => no run fild
export --out x.onnx --run {resnet18} | --layout none => layout | --layout cyskin-63 => ResNet18
report | --runs => no dataset | --data nowhere => nowhere
report --data {data} | --runs nowhere => nowhere | --evaluation {evaluation} => --runs
report --data {data} --runs {resnet18} --out out --evaluation | nowhere => no evaluation
import-pairs | x.csv => --out is missing
import-pairs --out out | nowhere.csv => nowhere.csv | '' => expected a path | /dev/null => csv
convert | {data} --out x => --to is missing | {data} --to zarr --out x => lerobot
convert --to lerobot --out x | nowhere => no dataset | {resnet18} => no dataset | '' => expected a
calibrate | => --background is missing | --background => --background has no value; expected PNG
calibrate --out out --background none.png | => none.png | --ball-diameter-mm 4 => --presses
CALIBRATE | => --ball-diameter-mm is missing
ADAPT | --model resnet => model | --init-from gone => gone | --out presses => presses
ADAPT | --model field --init-from {resnet18} => resnet18
studio | --run nowhere => nowhere | --run {data} => config.json | --source nowhere => no source
studio | --host nowhere => cannot listen on | --source x.png => no source
studio | --background nowhere.png => there is no file | --background / => is a folder
LIVE d | --turn-deg 45 => expected 0, 90, 180 or 270 | --layout cyskin-63 => ResNet18
LIVE d | --background d => d | --background d/x.png => needs a field run | extra => with --run
LIVE | nowhere => no source | '' => no source | /dev/zero => no source | 1.5 => no source
LIVE | http://127.0.0.1:9/x.mp4 => no source | concat:a.avi => no source | 99 => camera 99
LIVE | d/x.txt => cannot be read as a video
live | d --run d => config.json | {resnet18} d => --run
shapes | all => unexpected argument 'all'; see t2twin shapes --help
"""
"""Start of a command line, then ends of it, each with a part of the expected sentence."""

FINE = """
PRESS --yaw-deg 360000 | PRESS --force-n 8e-1 | PRESS --x-mm -0.0
press circle-1 --out 'mein Ordner/für später' | press circle-1 --out ./a/../out
TRAIN --seed 9223372036854775807 --epochs 1 | TRAIN --minutes 0.001
PRESS --seed 0 --imperfections all | PRESS --x-mm 14 --depth-mm 0.5
PRESS --source cyskin --target digit | PRESS --source digit --target digit | PRESS --sensor target
PRESS --yaw_deg 3 --sensor=cyskin | PRESS --sensor digit --sensor cyskin
--version | --help | simdata --help | simdata --verify {data}
export --run {touch2touch} --out x.onnx
"""


def cases() -> Iterator[Case]:
    """Numbers, shapes, and valid command lines."""
    for table, unread in ((NUMBERS, (*NO_NUMBERS, "nan", "-inf")), (INTEGERS, NO_INTEGERS)):
        for options, numbers in table.items():
            for number, option in enumerate(options.split(" | ")):
                for value in numbers.split():
                    yield _case(f"{option} {value}")
                for word in unread[number % 2 :: 2]:
                    yield _case(f"{option} {shlex.quote(word)}")
    for shape in SHAPES:
        yield _case(f"press --out out -- {shlex.quote(shape)}")
    yield _case("press circle-1 --yaw-deg '1\n2'", "--yaw-deg is '1\\n2'")
    for command in FINE.strip().replace("\n", " | ").split(" | "):
        yield _case(command, fine=True)


def refused() -> Iterator[Case]:
    """Words that no command line has."""
    for line in REFUSED.strip().splitlines():
        start, *ends = (" " + line).split(" | ")
        for end in ends:
            words, _, says = f" {end}".partition(" => ")
            yield _case(f"{start} {words}".strip(), says)


def _case(command: str, says: str = "", fine: bool = False) -> Case:
    whole = " ".join(PREFIXES.get(word, word) for word in command.split(" "))
    kind = command.split(" ")[0]
    files: Files = PAIRS if kind == "IMPORT" else {}
    if kind in ("LIVE", "live"):
        files = {"d/x.png": PNG, "d/x.txt": "no video"}
    if kind in ("CALIBRATE", "BALL", "ADAPT"):
        files = FRAMES
    return Case(command[:80], whole, laid(files), says, fine)
