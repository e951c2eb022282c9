import json
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
from PIL import Image
from session import python

import t2twin
from t2twin.cli import main


def run(*arguments, code=0):
    """Run a command as the shell would; its exit status must be the given one."""
    try:
        main([str(argument) for argument in arguments])
        status = 0
    except SystemExit as stop:
        status = int(stop.code or 0)
    assert status == code


def test_press_writes_pictures_and_numbers(tmp_path, capsys):
    run("press", "square-2", "--yaw-deg", "30", "--out", tmp_path / "out")
    summary = json.loads((tmp_path / "out/press.json").read_text())
    for sensor in ("digit", "cyskin-20"):
        assert summary[sensor]["force_n"] == pytest.approx(8.0, rel=0.005)
        assert summary[sensor]["settled"]
        fields = np.load(tmp_path / f"out/contact_{sensor}.npz")
        rows, columns = fields["y_mm"].size, fields["x_mm"].size
        assert fields["pressure_kpa"].shape == fields["surface_mm"].shape == (rows, columns)
        cell = (fields["x_mm"][1] - fields["x_mm"][0]) ** 2
        assert fields["pressure_kpa"].sum() * cell / 1e3 == pytest.approx(8.0, rel=0.005)
    with Image.open(tmp_path / "out/digit.png") as image:
        assert image.size == (240, 320)
    with Image.open(tmp_path / "out/tactile_image.png") as image:
        tactile = np.asarray(image)
    counts = json.loads((tmp_path / "out/cyskin-20.json").read_text())["counts"]
    assert tactile.shape == (396, 240) and len(counts) == 20
    assert tactile.max() == pytest.approx(max(counts), rel=0.02)
    assert "8.00 N" in capsys.readouterr().out


def test_press_takes_a_users_stl_and_another_elastomer(tmp_path):
    trimesh.creation.icosphere(subdivisions=4, radius=6.0).export(tmp_path / "my.stl")
    run("press", tmp_path / "my.stl", "--sensor", "digit", "--flat", "--thickness-mm", "50",
        "--young-mpa", "0.5", "--force-n", "0.5", "--out", tmp_path / "out")  # fmt: skip
    depth = json.loads((tmp_path / "out/press.json").read_text())["digit"]["depth_mm"]
    modulus = 0.5 / (1 - 0.47**2)
    assert depth == pytest.approx((3 * 0.5 / (4 * modulus)) ** (2 / 3) / 6 ** (1 / 3), rel=0.08)


def files(folder):
    return {path for path in folder.rglob("*") if path.is_file()}


def test_every_command_has_help(capsys):
    from t2twin.cli import COMMANDS

    for command in COMMANDS:
        run(command, "--help")
        assert command in capsys.readouterr().out


def test_words_that_cannot_be_meant_are_named(capsys):
    Path("-x.png").touch()
    run("translate", "-x.png", code=2)
    assert "-x.png begins with a dash; give it as ./-x.png" in capsys.readouterr().err
    for words in (["translate", ""], ["press", "--out", ""], ["press", "--out="]):
        run(*words, code=2)
        assert "the value of an option is empty" in capsys.readouterr().err
    run("press", "square-2", "--x-mm", "1", "--x_mm=2", code=2)
    assert "--x-mm is given 2 times" in capsys.readouterr().err


@pytest.mark.parametrize("free_gib", [4, 1])
def test_doctor_says_what_this_machine_lacks(capsys, monkeypatch, free_gib):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=free_gib * 2**30))
    run("doctor", code=int(free_gib < 4))
    assert capsys.readouterr().out.count("FAIL  disk") == (free_gib < 4)


def test_press_leaves_its_scene_and_says_where_there_is_no_display(tmp_path, capsys, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    run("press", "circle-1", "--sensor", "cyskin", "--view", "--out", tmp_path / "out")
    assert (tmp_path / "out/scene_cyskin-20.xml").is_file()
    assert (tmp_path / "out/shape.stl").is_file()
    assert "no display" in capsys.readouterr().out


def test_version_and_shapes_are_told_without_making_any(tmp_path, capsys):
    run("--version")
    assert capsys.readouterr().out == f"t2twin {version('t2twin')}\n"
    run("shapes")
    said = capsys.readouterr().out
    assert all(name in said for name in t2twin.shapes())
    assert files(tmp_path) == set()


def test_commands_import_no_renderer_of_mujoco():
    """MuJoCo's EGL needs another PyOpenGL than pyrender; GLFW starts processes on import, which
    print an error when the command is stopped."""
    words = ["-X", "importtime", "-m", "t2twin", "press", "square-2", "--sensor", "cyskin"]
    done = python(*words, MUJOCO_GL="glfw", PYTHONPATH=str(Path(__file__).parents[1]))
    assert done.returncode == 0, done.stderr
    imported = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}
    assert "mujoco" in imported and not imported & {"glfw", "mujoco.egl"}


def test_press_of_two_arrays_and_of_two_cameras(tmp_path, capsys):
    (tmp_path / "soft.toml").write_text(
        'extends = "digit"\nname = "soft"\n[gel]\nyoung_mpa = 0.1\n'
    )
    run("press", "hemisphere-2", "--source", "cyskin-63", "--out", "arrays")
    printed = capsys.readouterr().out
    assert "cyskin-63: counts: " in printed and "cyskin-20: counts: " in printed
    assert len(json.loads(Path("arrays/cyskin-63.json").read_text())["counts"]) == 63
    assert Path("arrays/tactile_image_cyskin-20.png").is_file()
    assert len(json.loads(Path("arrays/cyskin-20.json").read_text())["counts"]) == 20
    run("press", "hemisphere-2", "--target", "digit", "--seed", "1", "--out", "twins")
    assert Path("twins/digit.png").read_bytes() != Path("twins/digit-2.png").read_bytes()
    run("press", "hemisphere-2", "--target", tmp_path / "soft.toml", "--out", "cameras")
    summary = json.loads(Path("cameras/press.json").read_text())
    assert summary["soft"]["depth_mm"] > 1.5 * summary["digit"]["depth_mm"]
    assert Path("cameras/soft.png").is_file() and Path("cameras/digit.png").is_file()
