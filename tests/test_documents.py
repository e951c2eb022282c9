"""README.md and docs/: tables, links, examples in Python, and commands."""

import functools
import importlib.util
import inspect
import json
import mimetypes
import re
import shlex
import shutil
import sys
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import trimesh
from documents import PAGES, ROOT, anchors, blocks, inline_code, links, name_of
from kinds import gel_camera
from PIL import Image

import t2twin
from benchmarks.documents import figures, reference
from benchmarks.evidence import find_benchmarks
from t2twin import cli
from t2twin.core.errors import T2TwinError
from t2twin.core.files import result_folder
from t2twin.sim.calibrate.calibrate import read_measurements
from t2twin.sim.dataset.store import read_split
from t2twin.sim.sampling.recipe import Light, Motion, Part, Recipe, load_recipe
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.slide import PATH_COLUMNS, path_commands, read_path
from t2twin.sim.taxels.layout import load_layout
from t2twin.translate.runs.config import FRAME_CHECK

NOT_RUN = (
    "source ", "make ", "pip ", "dask ", "torchrun ", "python ", "t2twin adapt",
    "t2twin calibrate --background background.png --presses", "t2twin calibrate-uncertainty",
    "t2twin convert", "t2twin evaluate runs/", "t2twin live 0", "t2twin live frames/ --run",
    "t2twin report --data",
    "t2twin simdata --scale", "t2twin simdata --recipe", "t2twin studio", "t2twin train",
    "t2twin translate image.png --background background.png --target contact",
)  # fmt: skip
"""Beginnings of command lines that are parsed and not run, as they take long or need more files;
other tests run these commands."""

EXHAUSTIVE = ("t2twin evaluate", "t2twin primitives")
"""Commands that take longer than the others; `make test` leaves their blocks out."""

REPLACED = {
    r"--dx-mm [\d.]+": "--dx-mm 0.2 --steps 1",
    "--dyaw-deg 10": "--dyaw-deg 1",
    'scale="smoke"': 'scale="smoke", shapes=("circle-1", "square-3")',
}
"""Options that take long, and those in their place."""

NOT_INSTALLED = {"dask_jobqueue": "needs SLURM"}
"""Libraries of examples that are compiled only."""

OTHER_OPTIONS = {"--help", "--version", "--list", "--stale", "--docs", "--write", "--real-digit"}
"""Options that are not of a command of t2twin."""

TARGETS = re.compile(r"(?m)^([\w-]+):")
VARIABLES = re.compile(r"\$\((?:if |or )?\$?\(?([A-Z_]+)")


# Text


def test_tables_equal_the_results_and_the_code():
    different = [path.name for path, text in figures.rewritten() if text != path.read_text("utf-8")]
    assert not different, f"python -m benchmarks --docs would change {different}"


def test_every_table_is_in_a_document():
    text = "".join(path.read_text("utf-8") for path in figures.documents())
    optionless = {"options-shapes", "options-doctor"}
    assert not [
        name
        for name in reference.tables().keys() - optionless
        if f"<!--table {name}-->" not in text
    ]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_relative_links_and_images_exist(page):
    for link in links(page):
        path, _, fragment = link.partition("#")
        if "://" in path:
            continue
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), link
        assert not fragment or fragment in anchors(target), link


def test_documents_that_code_and_changelog_name_exist():
    folders = ("t2twin/core", "t2twin/cli", "primitives_cad", "sim", "translate", "benchmarks")
    sources = [path for folder in folders for path in (ROOT / folder).rglob("*.py")]
    text = "".join(p.read_text("utf-8") for p in (*sources, ROOT / "CHANGELOG.md"))
    named = set(re.findall(r"docs/[\w/-]+\.(?:md|png)", text))
    assert len(named) > 5
    assert not [name for name in named if not (ROOT / name).exists()]


def test_every_picture_is_shown():
    shown = {link.rpartition("/")[2] for page in PAGES for link in links(page)}
    pictures = {path.name for path in (ROOT / "docs" / "pictures").iterdir()}
    assert pictures <= shown


@pytest.mark.parametrize("text", ["<!--table results-->\n", "<!--table no-->\n<!--/table-->\n"])
def test_an_unusable_marker_is_an_error(text, tmp_path):
    (tmp_path / "README.md").write_text(text)
    with pytest.raises(T2TwinError, match=r"README\.md"):
        list(figures.rewritten(tmp_path))


# Commands


@pytest.fixture
def parse(monkeypatch):
    """Parses the arguments of t2twin as the command does, without running it."""
    parsed = []
    stubs = {
        name: functools.wraps(command)(lambda *_, **__: parsed.append(True))
        for name, command in cli.COMMANDS.items()
    }

    def run(words):
        monkeypatch.setattr(cli, "COMMANDS", stubs)
        cli.main(words)
        assert parsed.pop()

    return run


def check_make(words):
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for word in words:
        if "=" in word:
            assert word.partition("=")[0] in {*VARIABLES.findall(makefile)}, word
        else:
            assert word in TARGETS.findall(makefile), word


def check_module(words):
    assert importlib.util.find_spec(words[0]), words[0]
    if words[0] == "benchmarks" and not "".join(words[1:]).startswith("-"):
        find_benchmarks()[words[1]].parser.parse_args(words[2:])


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_are_valid(page, parse, capsys):
    for block in blocks(page):
        if block.language != "bash":
            continue
        for line, _ in block.commands():
            program, *words = shlex.split(line)
            if program == "t2twin":
                try:
                    parse(words)
                except SystemExit:
                    pytest.fail(f"{block.place}: {line}: {capsys.readouterr().err}")
            elif program == "make":
                check_make(words)
            elif program == "torchrun":
                check_module(words[words.index("-m") + 1 :])
            elif program == "python" and words[0].endswith(".py"):
                assert (ROOT / words[0]).is_file(), line
            elif program == "python":
                assert words[0] == "-m", line
                check_module(words[1:])
            else:
                assert program in ("pip", "dask", "source"), f"{block.place}: {line}"


def option_names():
    found = set(OTHER_OPTIONS)
    for name in cli.COMMANDS:
        found |= {*re.findall(r"--[\w-]+", reference.command_options(name))}
    return found


def test_options_and_commands_in_the_text_exist():
    known = option_names()
    for page in PAGES:
        for code in inline_code(page):
            words = shlex.split(code.replace("'", ""))
            where = f"{name_of(page)}: {code}"
            if (
                words[0] == "t2twin"
                and len(words) > 1
                and words[1].isalpha()
                and words[1].islower()
            ):
                assert words[1] in cli.COMMANDS, where
            if words[0] == "make":
                check_make(words[1:])
            if words[0] == "t2twin" or words[0].startswith("--"):
                assert {
                    word.partition("=")[0] for word in words if word.startswith("--")
                } <= known, where


# Examples


@pytest.fixture(scope="session")
def examples(products, small_dataset, trained):
    """A folder with the files that the examples of the documents name."""

    def build(folder):
        twin = t2twin.Twin()
        (folder / "frames").mkdir(parents=True)
        (folder / "my_pairs").mkdir()
        rows = []
        for number, shape in enumerate(("square-1", "circle-1", "hemisphere-4") * 4):
            touch = twin.press(shape, force_n=2 + number / 2, seed=number)
            Image.fromarray(touch.image).save(folder / "my_pairs" / f"{number}.png")
            rows.append(f"{number}.png," + ",".join(f"{count:.0f}" for count in touch.counts[:3]))
        shutil.copy(folder / "my_pairs" / "0.png", folder / "image.png")
        shutil.copy(folder / "my_pairs" / "1.png", folder / "frames")
        Image.fromarray(twin.background).save(folder / "background.png")
        header = "image,taxel_0,taxel_1,taxel_2\n"
        (folder / "my_pairs" / "pairs.csv").write_text(header + "\n".join(rows) + "\n")
        (folder / "my-taxels.csv").write_text(example("how-to/taxel-layouts.md", "csv"))
        (folder / "path.csv").write_text(example("how-to/sliding.md", "csv"))
        recipe = example("how-to/recipes.md", "toml").replace("count = 1000", "count = 4")
        (folder / "my-recipe.toml").write_text(
            recipe.replace("val_share = 0.02", "val_share = 0.5")
        )
        with result_folder(folder / "runs" / "optics", "calibration") as optics:
            gel_camera().optics.save(optics / "optics.npz")
        video = cv2.VideoWriter(
            str(folder / "video.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 60, (240, 320)
        )
        for _ in range(3):
            video.write(twin.background[:, :, ::-1])
        video.release()
        (folder / "gripper.xml").write_text(
            '<mujoco><worldbody><site name="left_pad"/></worldbody></mujoco>'
        )
        box = trimesh.creation.box((10, 6, 4))
        box.export(folder / "my.stl")
        box.apply_scale(1 / 25.4)
        box.export(folder / "my.obj")
        shutil.copytree(
            small_dataset, folder / "data" / "small", ignore=shutil.ignore_patterns("cache")
        )
        for model in ("touch2touch", "resnet18"):
            run = trained(model, small_dataset, 1)
            shutil.copytree(run, folder / "runs" / "small" / model)

    return products.make("documents", build)


def example(page, language):
    """The first block of a language on a page of docs/."""
    found = blocks(ROOT / "docs" / page)
    return next(block.text for block in found if block.language == language)


def check_csv(block):
    """Reads a table with the reader of its header."""
    header, path = block.text.partition("\n")[0], Path("example.csv")
    path.write_text(block.text)
    if header.startswith("x_mm,y_mm,pad"):
        assert load_layout(path).size == 3
    elif header == ",".join(PATH_COLUMNS):
        assert len(path_commands("square-2", read_path(path))) == 4
    elif header.startswith("file,"):
        path.rename("forces.csv")
        names = [line.partition(",")[0] for line in block.text.splitlines()[1:]]
        diameters_mm, *measured = read_measurements(Path(), names, 4.7, gel_camera())
        assert all(np.isfinite(each).any() for each in measured) and diameters_mm[2] == 6.0
    else:
        assert header.startswith("image,taxel_0"), block.place
        shutil.move(path, "my_pairs/example.csv")
        layout = load_layout("my-taxels.csv")
        info = t2twin.import_pairs("my_pairs/example.csv", "example", layout)
        assert sum(info.pairs.values()) == len(block.text.splitlines()) - 1


def check_json(block, printed):
    """Compares an example with what the program reads, or wrote before: printed."""
    content = json.loads(block.text)
    if "taxels" in content:
        Path("my-taxels.json").write_text(block.text)
        layouts = [load_layout(f"my-taxels.{suffix}") for suffix in ("json", "csv")]
        assert len({tuple(each.x_mm) + tuple(each.y_mm) for each in layouts}) == 1
        return
    written = json.loads(next(line for line in printed.splitlines() if line.startswith("{")))
    assert list(content) == list(written), block.place
    assert [*map(type, content.values())] == [*map(type, written.values())], block.place


def run_block(block, namespace, expensive, capsys):
    """Runs a block, or nothing if it takes long and expensive is false."""
    if any(name in block.text for name in EXHAUSTIVE) and not expensive:
        return
    text = block.text
    for option, other in REPLACED.items():
        text = re.sub(option, other, text)
    if block.language == "python":
        code = compile(text, block.place, "exec")
        if not any(f"from {name}" in block.text for name in NOT_INSTALLED):
            exec(code, namespace)
    elif block.language == "bash":
        for line, output in block._replace(text=text).commands():
            if not line.startswith(NOT_RUN):
                before = capsys.readouterr().out if output else ""
                cli.main(shlex.split(line)[1:])
                if output:
                    Path(output).write_text(capsys.readouterr().out)
                    print(before)
    elif block.language == "toml":
        name = re.search(r'(?m)^name = "(.*)"$', block.text)
        path = Path(f"{name[1] if name else block.page.stem}.toml")
        path.write_text(block.text)
        is_sensor = block.text.startswith(("kind", "extends"))
        assert load_sensor(path) if is_sensor else load_recipe(path)
    elif block.language == "json":
        check_json(block, capsys.readouterr().out)
    elif block.language == "csv":
        check_csv(block)
    else:
        assert block.language == "text", block.place


def cases():
    for page in PAGES:
        found = blocks(page)
        yield pytest.param(page, False, id=name_of(page))
        if any(name in block.text for name in EXHAUSTIVE for block in found):
            marks = pytest.mark.exhaustive
            yield pytest.param(page, True, id=f"{name_of(page)}-all", marks=marks)


def listed(section):
    """Names in the first column of the tables of a section of file-formats.md, in their order."""
    text = (ROOT / "docs/reference/file-formats.md").read_text("utf-8")
    rows = re.findall(
        r"(?m)^\| ([^|]*`[^|]*) \|", text.split(f"\n## {section}\n")[1].split("\n## ")[0]
    )
    return [name for row in rows for name in re.findall(r"`([^`]+)`", row)]


def files(folder):
    """Names in a folder; folders end with /, and the numbers of contacts are 000."""
    names = {path.name + "/" * path.is_dir() for path in Path(folder).glob("[!.]*")}
    return {re.sub(r"_\d{3}\.npz", "_000.npz", name) for name in names}


def test_the_files_of_file_formats_are_those_that_are_written(examples, tmp_path):
    shutil.copytree(examples, tmp_path, dirs_exist_ok=True)
    ball = ["hemisphere-4", "--force-n", "2", "--markers"]
    cli.main(["press", *ball, "--out", "pressed"])
    assert files("pressed") == {*listed("Press")}
    cli.main(["slide", *ball, "--dx-mm", "0.2", "--steps", "1", "--out", "slid"])
    names = [name for name in listed("Slide") if "." in name or name.endswith("/")]
    assert files("slid") | {"slide.mp4"} == {*names}
    others = [name for name in listed("Slide") if name not in names]
    with np.load("slid/contact_digit_001.npz") as contact:
        assert {*contact} <= {*others}
    header = Path("slid/slide.csv").read_text().partition("\n")[0].split(",")
    for name in header[header.index("force_n") + 1 : -4]:
        assert name.partition("_")[2] in others, name
    cli.main(["translate", "image.png", "--out", "translated"])
    assert files("translated") == {n.replace("NAME", "image") for n in listed("Predictions")}
    assert files("runs/small/resnet18") | {FRAME_CHECK} == {*listed("Runs")}  # of a field run


@pytest.mark.parametrize("kind", [Recipe, Part, Light, Motion])
def test_the_keys_of_a_recipe_are_listed(kind):
    assert {*kind.__struct_fields__} - {"parts", "light", "motion"} <= {*listed("Recipes")}


CODE = re.compile(r"(\w+)((?:\.\w+)*)(\(.*\))?")
MEMBERS = re.compile(r"(?m)^\| `([A-Z]\w+)` \| ((?:`\w+`(?:, )?)+) \|$")
TABLE = re.compile(r"(?m)^\| (?:attribute|method) of `(\w+)` \|.*\n((?:\|.*\n)+)")


def names_in(page):
    """Code in the text of a page; names in tables of attributes or methods with their class."""
    yield from inline_code(page)
    for owner, rows in TABLE.findall(page.read_text("utf-8")):
        for row in rows.splitlines()[1:]:
            yield from (f"{owner}.{name}" for name in re.findall("`([^`]+)`", row.split("|")[1]))
    for owner, names in MEMBERS.findall(page.read_text("utf-8")):
        yield from (f"{owner}.{name}" for name in re.findall(r"\w+", names))


def check_name(code, known):
    """An attribute or a signature of something that is known exists, or the code names a file."""
    found = CODE.fullmatch(code)
    if found is None or found[1] not in known or Path(code).suffix in mimetypes.types_map:
        return
    thing = known[found[1]]
    for name in found[2].split(".")[1:]:
        known_names = {*dir(thing), *getattr(thing, "__annotations__", ())}
        assert name in known_names or hasattr(thing, name) or f"{name}:" in str(thing.__doc__), code
        with suppress(T2TwinError):  # what another object has
            thing = getattr(thing, name, None)
    if found[3] and thing is not None:
        names = re.findall(r"(?:^\(|, )([a-z_]\w*)(?=[=,)])", found[3])
        known_names = inspect.signature(thing if callable(thing) else type(thing)).parameters
        assert {*names} <= {*known_names}, code


def test_every_public_class_has_its_members_in_the_reference():
    public = {name for name in t2twin.__all__ if name[0].isupper() and name[:6] != "T2Twin"}
    assert public == {*dict(MEMBERS.findall((ROOT / "docs/reference/python-api.md").read_text()))}


@pytest.mark.parametrize("page, expensive", list(cases()))
def test_examples_run_and_names_exist(page, expensive, examples, tmp_path, capsys, monkeypatch):
    shutil.copytree(examples, tmp_path, dirs_exist_ok=True)
    rows = lambda folder, split: read_split(Path(folder), split).to_pylist()  # noqa: E731
    monkeypatch.setitem(sys.modules, "datasets", SimpleNamespace(load_dataset=rows))
    namespace = {"__name__": "example"}
    for block in blocks(page):
        run_block(block, namespace, expensive, capsys)
    known = {type(value).__name__: value for value in namespace.values()}
    known |= {name: getattr(t2twin, name) for name in {*t2twin.__all__} - known.keys()} | namespace
    for code in names_in(page):
        check_name(code, known)
