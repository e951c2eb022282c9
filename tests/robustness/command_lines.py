"""Bad words and numbers on the command line."""

import shlex
from collections.abc import Iterator

from cases import Case, Content, laid
from frames import FRAMES
from pairs import PAIRS

PREFIXES = {
    "SIM": "simdata --scale smoke --out out",
    "TRAIN": "train resnet18 --data {data} --preset smoke --out out",
    "CALIBRATE": "calibrate --background background.png --presses presses --out out",
    "LIVE": "live --run {resnet18}",
    "PRESS": "press circle-1 --out out",
    "IMPORT": "import-pairs pairs.csv --out out",
    "HUGE": str(2**70),
    "LONG": "x" * 5000,
}
"""What a word in capitals stands for."""

NOT_FINITE = "nan inf -inf "
NUMBERS = {
    "PRESS --x-mm | PRESS --y-mm": NOT_FINITE + "1e308 -1e9 500",
    "PRESS --yaw-deg": NOT_FINITE,
    "PRESS --force-n": NOT_FINITE + "0 -8 1e-9 1e9 101",
    "PRESS --thickness-mm": NOT_FINITE + "0 -1 0.3 1e9 201",
    "PRESS --young-mpa": NOT_FINITE + "0 -1 1e-9 1e9",
    "PRESS --poisson": NOT_FINITE + "-0.1 0.5 1",
    "TRAIN --minutes": NOT_FINITE + "0 -1",
    "TRAIN --iou-weight": NOT_FINITE + "-1 1",
    "CALIBRATE --ball-diameter-mm": NOT_FINITE + "0 -4 1e9",
    "CALIBRATE --ball-diameter-mm 4 --scale-px-per-mm": NOT_FINITE + "0 -1 1e9",
    "CALIBRATE --ball-diameter-mm 4 --ball-tolerance-mm": NOT_FINITE + "-1 4",
    "CALIBRATE --ball-diameter-mm 4 --scale-tolerance-px-per-mm": NOT_FINITE + "-1 15",
    "CALIBRATE --ball-diameter-mm 4 --depth-tolerance-mm": NOT_FINITE + "-1",
    "CALIBRATE --ball-diameter-mm 4 --force-tolerance-n": NOT_FINITE + "-1",
    "CALIBRATE --ball-diameter-mm 4 --young-tolerance-mpa": NOT_FINITE + "-1 0.5",
}
"""Options of numbers, and the numbers that they refuse."""

SEEDS = "-1 HUGE 9223372036854775808"
INTEGERS = {
    "PRESS --seed | SIM --seed | TRAIN --seed | IMPORT --seed": SEEDS,
    "studio --port": "-1 65536 HUGE",
    "LIVE {data} --frames | SIM --workers | TRAIN --epochs": "0 -1",
    "IMPORT --full-scale": "0 -1 65536 HUGE",
    "CALIBRATE --ball-diameter-mm 4 --held-out": "-1 HUGE",
}
NO_NUMBERS = ("", "abc", "8,5", "0x10", "--")
NO_INTEGERS = (*NO_NUMBERS, "1.5", "1e3", "nan")

SHAPES = ("", "square-9", "Square-2", "pliers", "pliers/none", "../square-2", "square-2\n",
          "x" * 5000, "squäre", "random", "square-2/", "~", "/", "/dev/null", "/etc", "-",
          "random-01", "random-00", "random-1 ", "random-+1", "random-1_0", "random-٣")  # fmt: skip

REFUSED = """
| => a command is missing | pres => did you mean press? | Press => did you mean press?
| sim-data => did you mean simdata? | tranlsate x.png => did you mean translate?
| import_pair => did you mean import-pairs? | '' => there is no command ''
| zzz => there is no command 'zzz'; see t2twin --help | -x => there is no option '-x'
| --no-such-flag => there is no option '--no-such-flag'; see t2twin --help
| --version press => there is no option '--version'
| --tyro-print-completion sh => expected bash, zsh, tcsh or fish
| --tyro-print-completion => expected bash, zsh, tcsh or fish
press | => SHAPE is missing; see t2twin press --help | --force-n 8 => SHAPE is missing
press | --shape circle-1 => SHAPE is missing | -- circle-1 b => unexpected argument 'b'
press circle-1 | square-1 => unexpected argument 'square-1' | --force 8 => did you mean --force-n?
press circle-1 | --Force-n 8 => did you mean --force-n? | --ya-deg=8 => did you mean --yaw-deg?
press circle-1 | -f => there is no option '-f' | --sensor gelsight => expected digit, cyskin or both
press circle-1 | --sensor Digit => --sensor is 'Digit' | --sensor '' => --sensor is ''
press circle-1 | --optics PyRender => expected baked or pyrender
press circle-1 | --force-n => --force-n has no value; expected a number
press circle-1 | --x-mm --y-mm 3 => --x-mm has no value | --flat=yes => unexpected argument 'yes'
press circle-1 | --scale=abc => --scale is 'abc'; expected a number
press circle-1 | --depth_mm= => --depth-mm is ''; expected a number
press circle-1 | --x-mm 1 --x-mm 2,0 => --x-mm is '2,0'
press circle-1 | --calibration => --calibration has no value; expected FILE
press circle-1 | --imperfections => --imperfections has no value; expected NAME
press circle-1 | --layout => --layout has no value; expected a name
PRESS | --seed 1 --imperfections some => imperfections | --imperfections all => without --seed
PRESS --sensor cyskin | --markers => --markers has no effect | --optics pyrender => --optics has no
PRESS --sensor cyskin | --flat => --flat has no effect with --sensor cyskin
PRESS --sensor digit | --layout cyskin-63 => --layout has no effect with --sensor digit
PRESS --sensor digit | --seed 1 --imperfections all => --imperfections has no effect
slide circle-1 --dx-mm 1 --sensor cyskin --out out | --marker-pitch-mm 2 => --marker-pitch-mm has
simdata --out out | => --scale is missing | --scale huge => scale | --scale '' => scale
simdata --out out | --optics x => expected baked or pyrender
simdata --verify | => --verify has no value | nowhere => no dataset | /dev/null => no dataset
simdata --verify {data} | --scale smoke => --scale cannot | --workers 2 => --workers cannot be used
simdata | smoke => unexpected argument 'smoke'
SIM | --layout none => layout | --layout '' => layout | --imperfections some => imperfections
SIM | --calibration none.npz => none.npz | --scheduler foo => scheduler
SIM | --scheduler tcp:// => scheduler | --scheduler '' => scheduler
SIM | --scheduler tcp://127.0.0.1:99999 => scheduler
SIM | --scheduler tcp://127.0.0.1:1 --workers 2 => --workers
SIM --workers | 100000 => 1 to 1000 | 1001 => 1 to 1000 | HUGE => 1 to 1000
train | => MODEL and --data are missing; see t2twin train --help | resnet18 => --data is missing
train | --data {data} => MODEL is missing | resnet18 --dta {data} => did you mean --data?
train --data {data} --out out | gpt => touch2touch | '' => touch2touch
train resnet18 --out out --data | nowhere => nowhere | '' => no dataset | {resnet18} => no dataset
train resnet18 --out out --data {data} | --preset huge => preset | --preset '' => preset
train resnet18 --data {data} | {data} => unexpected argument
TRAIN | --direction cyskin-to-digit => touch2touch has both | --direction up => --direction is 'up'
TRAIN | --direction sideways => expected digit-to-cyskin or cyskin-to-digit
TRAIN | --steps 1.5 => --steps is '1.5'; expected a whole number | --preset => has no value
calibrate-uncertainty | => RUN and --data are missing | run => --data is missing
evaluate | {resnet18} => --data is missing | --data {data} --out out => run
evaluate --data {data} --out out | nowhere => nowhere | {data} => config.json
evaluate --data {data} --out out | {resnet18} {resnet18} => twice
evaluate {resnet18} --data | nowhere => nowhere | {data} --split 'train set' => val, test or both
translate | => there is no image | --layuot cyskin-20 x.png => did you mean --layout?
translate x.png | --run => --run has no value; expected RUN | --run nowhere => x.png
translate --out out x.png | {touch2touch} => is a run, not an image | --run ./field => x.png
translate --out out | field x.png => field is a run, not an image; give it as --run field
translate --out out | {resnet18} x.png => is a run, not an image; give it as --run
translate --out out --run {resnet18} | => image | '' => image | nowhere.png => nowhere.png
translate --out out --run {resnet18} | LONG => too long
export | field => give a run with --run RUN; see t2twin export --help | --force yes => 'yes'
export | {resnet18} => give a run with --run RUN | --run => --run has no value
export --out x.onnx --run | nowhere => nowhere | {data} => config.json | '' => run is ''
export --out x.onnx --run | ./field => there is no run ./field | fild => there is no run fild
export --out x.onnx --run {resnet18} | --layout none => layout | --layout cyskin-63 => ResNet18
report | x => unexpected argument 'x' | --runs => no dataset | --data nowhere => nowhere
report --data {data} | --runs nowhere => nowhere | --evaluation {evaluation} => --runs
report --data {data} --runs {resnet18} --out out --evaluation | nowhere => no evaluation
live {data} --frames 1 --zmq | tcp://127.0.0.1:99999 => port | tcp://127.0.0.1:-1 => port
import-pairs | x.csv => --out is missing
import-pairs --out out | nowhere => nowhere | nowhere.csv => nowhere.csv | '' => expected a path
import-pairs --out out | /dev/null => csv
convert | {data} --out x => --to is missing | {data} --to lerobot => --out is missing
convert | --to lerobot --out x => DATASET is missing | {data} --to zarr --out x => lerobot
convert --to lerobot --out x | nowhere => no dataset | {resnet18} => no dataset | '' => expected a
calibrate | => --background is missing | --background => --background has no value; expected PNG
calibrate --out out --background none.png | => none.png | --ball-diameter-mm 4 => --presses
calibrate --out out --background none.png | --held-out 3 => --presses
calibrate --out out --background none.png | --force-tolerance-n 1 => --presses is missing
CALIBRATE | => --ball-diameter-mm is missing | --ball-diameter-mm 4 => background.png
adapt | => --background and --presses and --ball-diameter-mm are missing
adapt --background b.png --presses p --ball-diameter-mm 4.7 --out out | --workers 0 => workers is 0
studio | --run nowhere => nowhere | --run {data} => config.json | --source nowhere => no source
studio | --host nowhere => cannot listen on | --host '' => cannot listen on
studio | --port => --port has no value | --port 1.5 => --port is '1.5'; expected a whole number
live | => SOURCE is missing | field 0 => give a run with --run RUN; see t2twin live --help
live {data} --run | nowhere => nowhere | {data} => config.json
LIVE | {data} --layout none => layout | 0 --turn-deg 45 => expected 0, 90, 180 or 270
shapes | all => unexpected argument 'all'; see t2twin shapes --help
doctor | now => unexpected argument 'now' | --fix => there is no option '--fix'
"""
"""Start of a command line, then ends of it, each with a part of the expected sentence."""

FINE = """
PRESS --yaw-deg 360000 | PRESS --force-n 8e-1 | PRESS --force-n 0.01 | PRESS --x-mm -0.0
PRESS --sensor cyskin | PRESS --flat --thickness-mm 0.5 --sensor digit
press circle-1 --out 'mein Ordner/für später' | press circle-1 --out ./a/../out
TRAIN --seed 9223372036854775807 --epochs 1 | TRAIN --minutes 0.001
PRESS --seed 0 --imperfections all | PRESS --x-mm 14 --depth-mm 0.5
PRESS --yaw_deg 3 --sensor=cyskin | PRESS --sensor digit --sensor cyskin
shapes | --version | --help | simdata --help | --tyro-print-completion bash
simdata --verify {data} | export --run {touch2touch} --out x.onnx
"""


def cases() -> Iterator[Case]:
    for table, unread in ((NUMBERS, NO_NUMBERS), (INTEGERS, NO_INTEGERS)):
        for options, numbers in table.items():
            for option in options.split(" | "):
                for number in numbers.split():
                    yield _case(f"{option} {number}")
                for word in unread:
                    yield _case(f"{option} {shlex.quote(word)}", option.split()[-1])
    for shape in SHAPES:
        yield _case(f"press --out out -- {shlex.quote(shape)}")
    yield _case("press circle-1 --yaw-deg '1\n2'", "--yaw-deg is '1\\n2'")
    for line in REFUSED.strip().splitlines():
        start, *ends = (" " + line).split(" | ")
        for end in ends:
            words, _, says = f" {end}".partition(" => ")
            yield _case(f"{start} {words}".strip(), says)
    for command in FINE.strip().replace("\n", " | ").split(" | "):
        yield _case(command, fine=True)


def _case(command: str, says: str = "", fine: bool = False) -> Case:
    whole = " ".join(PREFIXES.get(word, word) for word in command.split(" "))
    files: dict[str, Content] = PAIRS if command.startswith("IMPORT") else {}
    if command.startswith("CALIBRATE --") and says != "background.png":
        files = FRAMES
    return Case(command[:80], whole, laid(files), says, fine)
