"""Recipes of worlds."""

import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import trimesh

from benchmarks.inputs.case import Base, Case, Make, holding
from benchmarks.inputs.images import PNG
from t2twin.primitives_cad import catalogue
from t2twin.sim.world import held_out

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
    ("a range left out by two",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leave_out = [[1.01, 3.0], [2.0, 4.99]] }\n"),
    ("a range left out nearly",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leave_out = [[1.0000001, 4.9999999]] }\n"),
    ("a range left out to a twentieth",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leave_out = [[1.01, 4.7]] }\n"),
    ("a range left out in many",
     RANDOM + f"force_n = {{ low = 1.0, high = 5.0, leave_out = {[[2.0, 3.0]] * 1000} }}\n"),
    ("left out of nan",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leave_out = [[nan, 3.0]] }\n"),
    ("left out inside out",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leave_out = [[3.0, 2.0]] }\n"),
    ("left out of one number",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leave_out = [[3.0]] }\n"),
    ("left out, misspelt",
     RANDOM + "force_n = { low = 1.0, high = 5.0, leaveout = [[2.0, 3.0]] }\n"),
    ("ten thousand forces", RANDOM + f"force_n = {[1.0] * 10_000}\n"),
    ("a place misspelt", RANDOM.replace("normal_mm", "nomal_mm")),
    ("a place without its unit", RANDOM.replace("normal_mm", "normal")),
    ("a split with a capital", RANDOM + 'split = "Train"\n'),
    ("a seed in a part", RANDOM + "seed = 3\n"),
    ("presses of a million", RANDOM.replace("presses = 1", "presses = 1000000")),
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

PARTS_OF_FILES = ('[[parts]]\nshapes = "solids"\npresses = 1\n'
                  "place = { normal_mm = 1.0 }\n")  # fmt: skip


def _odd_file(name: str, lay: Callable[[Path], object]) -> Make:
    def make(box: Path, base: Base) -> None:
        lay(box / name)

    return make


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as end:
        before = Path.cwd()
        os.chdir(path.parent)  # a socket's path may have some hundred letters
        try:
            end.bind(path.name)
        finally:
            os.chdir(before)


def _large(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(5_000_000_000)


ODD_FILES: tuple[tuple[str, Callable[[Path], object], str], ...] = (
    ("a FIFO", os.mkfifo, "pipe"),
    ("a folder", Path.mkdir, "folder"),
    ("a device", lambda path: path.symlink_to("/dev/zero"), "device"),
    ("a socket", _socket, "pipe"),
    ("a link to nothing", lambda path: path.symlink_to("gone"), "no file"),
    ("a link to itself", lambda path: path.symlink_to(path.name), FILE),
    ("5 GB", _large, "MB"),
)


def _solids(*lay: Callable[[Path], object]) -> Make:
    """A recipe, and a folder of solids with what each of `lay` puts into it."""

    def make(box: Path, base: Base) -> None:
        (box / FILE).write_text(HEAD + PARTS_OF_FILES)
        (box / "solids").mkdir()
        for each in lay:
            each(box / "solids")

    return make


def _prepare_tools() -> None:
    """What takes long where no shape is kept, before the case begins."""
    held_out.test_solids()
    held_out.test_surfaces()


def _tool(name: str, turn_rad: float = 0.0, scale: float = 1.0, more: bool = False):
    """Lays out a tool as a mesh, turned, scaled, or with another body beside it."""

    def lay(folder: Path) -> None:
        _prepare_tools()
        mesh = catalogue.tool_mesh(name)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(turn_rad, (1.0, 0.3, -0.2)))
        mesh.apply_scale(scale)
        if more:
            beside = trimesh.transformations.translation_matrix((0.0, 0.0, 60.0))
            mesh = trimesh.util.concatenate([mesh, trimesh.creation.box((5, 5, 5), beside)])
        mesh.export(folder / "mine.stl")

    return lay


def _part_of_a_tool(folder: Path) -> None:
    """What lies about a keypoint that faces up, as a solid of its own."""
    import cadquery as cq

    from t2twin.primitives_cad import tools

    _prepare_tools()
    (at,) = (each for each in tools.keypoints("wrench") if each.name == "shank")
    block = cq.Workplane().box(60.0, 60.0, 60.0).translate((at.point_mm[0] + 10.0, 0.0, 0.0))
    part = tools.solid("wrench").intersect(block.val())  # pyright: ignore[reportArgumentType]
    cq.exporters.export(cq.Workplane(part), str(folder / "mine.step"))


BAD_SOLIDS: tuple[tuple[str, Make, str], ...] = (
    ("an empty folder", _solids(), "no solids"),
    ("corners at 1e300", _solids(lambda folder: (folder / "a.obj").write_text(
        "v 1e300 0 0\nv 0 1e300 0\nv 0 0 1e300\nf 1 2 3\n")), "a.obj"),
    ("corners of nan", _solids(lambda folder: (folder / "a.obj").write_text(
        "v nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n")), "a.obj"),
    ("a FIFO among them", _solids(lambda folder: os.mkfifo(folder / "a.stl")), "pipe"),
    ("a folder among them", _solids(lambda folder: (folder / "a.stl").mkdir()), "folder"),
    ("text among them", _solids(lambda folder: (folder / "a.step").write_text("x")), "a.step"),
    ("a whole allen key", _solids(_tool("allen-key")), "the tool allen-key"),
    ("whole pliers", _solids(_tool("pliers")), "the tool pliers"),
    ("a whole clamp", _solids(_tool("clamp")), "the tool clamp"),
    ("an allen key on edge", _solids(_tool("allen-key", 1.2)), "the tool allen-key"),
    ("an allen key, larger", _solids(_tool("allen-key", 0.0, 1.25)), "the tool allen-key"),
    ("an allen key beside a block", _solids(_tool("allen-key", more=True)), "the tool allen-key"),
    ("a part of a wrench", _solids(_part_of_a_tool), "same surface as wrench/shank"),
)  # fmt: skip

ARGUMENTS = (
    (("--world", "nowhere"), "there is no world"),
    (("--world", ""), "expected a path"),
    (("--world", "gone.toml"), "there is no file gone.toml"),
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
    for name, lay, says in ODD_FILES:
        yield Case(f"world: {name}", (*SIMDATA, FILE), _odd_file(FILE, lay), says)
    for name, make, says in BAD_SOLIDS:
        yield Case(f"solids: {name}", (*SIMDATA, FILE), make, says)
    for words, says in ARGUMENTS:
        yield Case(f"asked: {' '.join(words)}", ("simdata", "--out", "out", *words), says=says)
    for name in ("random-", "random-x", "random--1", "random-1.5", f"random-{2**64}", "random-01",
                 f"random-{'9' * 5000}", "random-٣", "random-1e3"):  # fmt: skip
        yield Case(f"shape: {name}", ("press", name, "--out", "out"))
    for name in ("random-3", "wrench/shank", "square-2"):
        words = ("press", name, "--scale", "2", "--out", "out")
        yield Case(f"shape: {name} with a scale", words, says="for files only")
    marked = "\ufeff" + HEAD + PART
    yield Case("world: a byte order mark", (*SIMDATA, FILE), holding(FILE, marked), fine=True)
    half = HEAD + PART + "force_n = { low = 1.0, high = 5.0, leave_out = [[1.5, 3.0]] }\n"
    yield Case("world: a range left out", (*SIMDATA, FILE), holding(FILE, half), fine=True)
    for workers in ("0", "-1", "1001", "1000000"):
        words = ("simdata", "--out", "out", "--world", FILE, "--workers", workers)
        yield Case(f"world: {workers} workers", words, holding(FILE, HEAD + PART), "workers")
    yield Case("world: fine", (*SIMDATA, FILE), holding(FILE, HEAD + PART), fine=True)
    drawn = HEAD + PART + 'untouched_share = 0.9\n[light]\nkind = "drawn"\neach = "press"\n'
    yield Case("world: fine, in drawn light", (*SIMDATA, FILE), holding(FILE, drawn), fine=True)
