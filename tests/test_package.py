"""The layout of the package: one name when it is installed, layers, no import cycles."""

import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from session import python

ROOT = Path(__file__).parents[1]
PACKAGES = ("translate", "sim", "primitives_cad")


@pytest.fixture(scope="module")
def wheel(checkout, tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    build = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    command = [sys.executable, "-c", build, folder]
    subprocess.run(command, cwd=checkout, check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("t2twin-*.whl"))


def test_a_wheel_has_one_top_level_name_and_everything_in_it(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"t2twin"}
    for package in (*PACKAGES, "t2twin"):
        for path in (ROOT / package).rglob("*.*"):
            if path.suffix != ".pyc":
                assert "t2twin/" + str(path.relative_to(ROOT)).removeprefix("t2twin/") in names


def test_citation_and_changelog_are_of_this_version(wheel):
    found = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert wheel.name.startswith(f"t2twin-{found}-")
    dates = dict(re.findall(r"(?m)^## \[(.+?)\] - (.+)", (ROOT / "CHANGELOG.md").read_text()))
    cited = f"version: {found}\ndate-released: {dates[found]}\n"
    assert cited in (ROOT / "CITATION.cff").read_text()


@pytest.mark.exhaustive
def test_another_translate_and_a_users_sim_do_not_disturb_it(wheel, tmp_path, monkeypatch):
    """An index has a package `translate`; a user's script may stand beside a folder `sim`."""
    site, work = tmp_path / "site", tmp_path / "work"
    pip = [sys.executable, "-m", "pip", "install", "--no-deps", "--quiet", "--target", site]
    subprocess.run([*pip, "--disable-pip-version-check", wheel], check=True)
    for folder in (site / "translate", work / "sim", work / "primitives_cad"):
        folder.mkdir(parents=True)
        (folder / "__init__.py").write_text("raise ImportError('not ours')\n")
    script = work / "script.py"
    script.write_text(
        "import t2twin, t2twin.sim.sensors, t2twin.sim.taxels.phi\n"
        "print(t2twin.__file__, len(t2twin.shapes()))\n"
    )
    monkeypatch.chdir(work)
    for command in ([script], ["-m", "t2twin", "press", "--help"]):
        done = python(*command, PYTHONPATH=str(site))
        assert done.returncode == 0, done.stderr
        if command == [script]:
            assert done.stdout.startswith(str(site)) and done.stdout.endswith(" 52\n")


def test_every_path_in_contributing_exists():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    assert text.rindex("## ") == text.index("## Where to change what")
    paths = re.findall(r"`([\w.]+(?:/[\w.]*)+)`", text)
    assert len(paths) > 30
    assert not [path for path in paths if not (ROOT / path).exists()]
