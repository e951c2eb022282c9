"""Twin.follow, and the files of `t2twin slide`."""

import csv
import re

import numpy as np
import pytest
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.files import OWN

PATH = [(0, 0, 0, 4), (0.2, 0.1, 2, 4), (0, 0, 0, 0), (1, 0, 0, 2), (1, -0.2, 0, 3)]
"""A press and a slide, a lift-off, and again a press and a slide."""


def run(*arguments):
    """Runs t2twin slide; returns the exit status."""
    try:
        main(["slide", *map(str, arguments)])
    except SystemExit as stop:
        return stop.code
    return 0


def write_path(file, rows, header="x_mm,y_mm,yaw_deg,force_n"):
    lines = [header, *(",".join(str(value) for value in row) for row in rows)]
    file.write_text("\n".join(lines) + "\n")


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != OWN
    }


@pytest.fixture(scope="module")
def twin():
    return t2twin.Twin()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a slide along PATH."""
    place = tmp_path_factory.mktemp("slide")
    write_path(place / "path.csv", PATH)
    out = place / "out"
    assert run("hemisphere-4", "--path", place / "path.csv", "--seed", 3, "--out", out) == 0
    return out


# The files


def test_one_row_a_step(folder):
    rows = table(folder / "slide.csv")
    assert [int(row["step"]) for row in rows] == list(range(5))
    for row, pose in zip(rows, PATH, strict=True):
        found = [float(row[name]) for name in ("x_mm", "y_mm", "yaw_deg", "force_n")]
        assert found == pytest.approx(pose)
    for sensor in ("digit", "cyskin-20"):
        lifted = [rows[2][name] for name in rows[2] if name.startswith(sensor)]
        assert lifted == [""] * 7
        forces = [float(rows[step][f"{sensor}_shear_y_n"]) for step in (0, 1, 3, 4)]
        assert forces[0] == forces[2] == 0.0 and forces[1] > 0.05 and forces[3] < -0.05
        assert float(rows[1][f"{sensor}_torque_nmm"]) > 0
        assert all(rows[step][f"{sensor}_settled"] == "true" for step in (0, 1, 3, 4))
    counts = table(folder / "counts.csv")
    assert list(counts[0]) == ["step", *(f"taxel_{n}" for n in range(20))]
    highest = [max(int(row[f"taxel_{n}"]) for n in range(20)) for row in counts]
    assert highest[2] < 200 < min(highest[n] for n in (0, 1, 3, 4))


@pytest.mark.parametrize("sensor", ["digit", "cyskin-20"])
def test_fields_have_the_forces_of_the_table(folder, sensor):
    names = sorted(path.name for path in folder.glob(f"contact_{sensor}_*.npz"))
    assert names == [f"contact_{sensor}_00{step}.npz" for step in (0, 1, 3, 4)]
    rows = table(folder / "slide.csv")
    for step in (0, 1, 3, 4):
        with np.load(folder / f"contact_{sensor}_00{step}.npz") as file:
            fields = dict(file)
        grid = fields["y_mm"].size, fields["x_mm"].size
        assert fields["pressure_kpa"].shape == fields["slip_mm"].shape == grid
        assert fields["shear_kpa"].shape == (2, *grid)
        assert fields["displacement_mm"].shape == (3, *grid)
        cell_mm2 = (fields["x_mm"][1] - fields["x_mm"][0]) ** 2
        force = 1e-3 * cell_mm2 * fields["pressure_kpa"].sum()
        assert force == pytest.approx(PATH[step][3], rel=1e-3)
        shear_n = 1e-3 * cell_mm2 * fields["shear_kpa"].sum(axis=(1, 2))
        for axis, found in zip("xy", shear_n, strict=True):
            expected = float(rows[step][f"{sensor}_shear_{axis}_n"])
            assert found == pytest.approx(expected, abs=1e-4)
        share = fields["pressure_kpa"] / fields["pressure_kpa"].sum()
        depth_mm = float(rows[step][f"{sensor}_depth_mm"])
        assert 0.5 * depth_mm < (fields["displacement_mm"][2] * share).sum() < depth_mm
        assert fields["slip_mm"].any() == (step in (1, 4))


def test_images(folder):
    frames = sorted((folder / "frames").iterdir())
    assert [path.name for path in frames] == [f"00{step}.png" for step in range(5)]
    with Image.open(frames[1]) as image:
        assert image.size == (240, 320)
    with Image.open(folder / "slide.gif") as animation:
        assert getattr(animation, "n_frames", 1) == 5


def test_two_sensors_of_one_kind_have_files_of_their_own(tmp_path):
    out = tmp_path / "out"
    arguments = ("circle-1", "--dyaw-deg", 1, "--steps", 1, "--out", out)
    (tmp_path / "soft.toml").write_text(
        'extends = "digit"\nname = "soft"\n[gel]\nyoung_mpa = 0.1\n'
    )
    assert run(*arguments, "--target", tmp_path / "soft.toml") == 0
    frames = {f"frames/{name}_{step}.png" for name in ("soft", "") for step in ("000", "001")}
    frames = {name.replace("/_", "/") for name in frames}
    assert {*contents(out)} >= frames | {"contact_soft_001.npz"}
    assert "counts.csv" not in contents(out)
    (out / "frames" / "mine_1.png").write_text("mine")
    assert run(*arguments, "--source", "cyskin-63") == 0
    assert {*contents(out)} == {
        "slide.csv", "slide.png", "slide.gif", "counts.csv", "counts_cyskin-20.csv",
        *(f"contact_cyskin-{n}_00{step}.npz" for n in (20, 63) for step in (0, 1)),
        "frames/mine_1.png",
    }  # fmt: skip
    assert len(table(out / "counts.csv")[0]) == 64
    assert len(table(out / "counts_cyskin-20.csv")[0]) == 21


@pytest.mark.parametrize(
    "arguments, words",
    [
        ((), "there is no motion; give --dx-mm"),
        (("--path", "none.csv"), "none.csv"),
        (("--path", "good.csv", "--dx-mm", "1"), "--path contains poses and forces"),
        (("--path", "empty.csv"), "empty.csv has 0 rows; expected 1 to 10,001"),
        (("--path", "unknown.csv"), "has a column 'speed', which is not read"),
        (("--path", "cell.csv"), "y_mm"),
        (("--path", "pulled.csv"), "pulled.csv, row 2: force_n is -1; expected 0 or a force from"),
        (("--path", "turned.csv"), "row 2: yaw_deg is 500 after 0; expected a rotation of at most"),
        (("--path", "beyond.csv"), "at x 0 mm, y 40 mm does not lie over"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, capsys, arguments, words):
    columns = "x_mm,y_mm,yaw_deg,force_n"
    for name, header, rows in (
        ("good", columns, PATH),
        ("empty", columns, []),
        ("unknown", columns + ",speed", [(0, 0, 0, 4, 1)]),
        ("cell", columns, [(0, 0, 0, 4), (0, "left", 0, 4)]),
        ("pulled", columns, [(0, 0, 0, 4), (0, 0, 0, -1)]),
        ("turned", columns, [(0, 0, 0, 4), (0, 0, 500, 4)]),
        ("beyond", columns, [(0, 0, 0, 4), (0, 0.1, 0, 4), (0, 40, 0, 4)]),
    ):
        write_path(tmp_path / f"{name}.csv", rows, header)
    before = contents(tmp_path)
    assert run("circle-1", *arguments) == 2
    message = capsys.readouterr().err
    assert words in message
    assert message.startswith("t2twin: ") and message.count("\n") == 1
    assert contents(tmp_path) == before


# In Python


def test_follow_is_press_and_slide(twin):
    touches = twin.follow("hemisphere-4", np.array(PATH))
    assert [len(touch.contacts) for touch in touches] == [2, 2, 0, 2, 2]
    pressed = twin.press("hemisphere-4", force_n=4)
    slid = twin.slide(pressed, dx_mm=0.2, dy_mm=0.1, dyaw_deg=2, steps=1)[0]
    for expected, touch in ((pressed, touches[0]), (slid, touches[1])):
        assert np.array_equal(touch.image, expected.image)
        assert np.array_equal(touch.counts, expected.counts)
    assert np.array_equal(touches[2].image, twin.background)
    assert not touches[2].counts.any()
    for sensor in ("digit", "cyskin-20"):
        assert np.array_equal(touches[1][sensor].contact.shear_kpa, slid[sensor].contact.shear_kpa)
        assert touches[3][sensor].contact.motion is None


def test_without_friction_a_slide_has_no_tangential_force(twin):
    *_, last = twin.follow("hemisphere-4", [(0, 0, 0, 4), (0.2, 0, 0, 4)], friction=0.0)
    for contact in last.contacts.values():
        assert contact.settled and contact.slip_share == 1.0
        assert not contact.shear_kpa.any()
        middle_mm = float((contact.pressure_kpa.sum(axis=0) * contact.x_mm).sum())
        assert middle_mm / contact.pressure_kpa.sum() == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize(
    "path, message",
    [
        ("path", "path is 'path' of type str; expected an array of numbers"),
        ([(0, 0, 4)], r"path has shape \(1, 3\); expected \(n, 4\)"),
        ([(0, 0, 0, 4), (0, np.nan, 0, 4)], "path, row 2 is .*; expected finite numbers"),
        ([(0, 0, 1e5, 4)], "path, row 1: yaw_deg is 100000; expected a number from -36000"),
        ([(0, 0, 0, 0)], "path has no row with contact"),
    ],
)
def test_invalid_paths(twin, path, message):
    with pytest.raises(T2TwinError, match=f"^{message}") as error:
        twin.follow("circle-1", path)
    assert not re.search(r"\n", str(error.value))
