"""t2twin sensors: list, show and check."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.sim.sensors.files import load_sensor


def test_list_names_all_bundled_sensors(capsys):
    main(["sensors"])
    lines = capsys.readouterr().out.splitlines()
    assert tuple(line.split()[0] for line in lines[:-1]) == t2twin.sensors()
    assert any(
        line.split() == ["digit", "gel", "camera", "240", "x", "320", "pixels"] for line in lines
    )
    assert any(line.split() == ["cyskin-63", "taxel", "array", "63", "taxels"] for line in lines)


@pytest.mark.parametrize("name", t2twin.sensors())
def test_the_shown_file_is_a_file_to_start_from(name, capsys):
    main(["sensors", "show", name])
    Path("mine.toml").write_text(capsys.readouterr().out)
    assert load_sensor("mine.toml").spec.name == name
    assert load_sensor("mine.toml").elastomer == load_sensor(name).elastomer


def test_check_of_a_gel_camera_writes_background_image_and_difference(capsys):
    Path("mine.toml").write_text('extends = "digit"\nname = "mine"\n[gel]\nyoung_mpa = 0.3\n')
    main(["sensors", "check", "mine.toml", "--out", "pictures/mine.png"])
    line, written = capsys.readouterr().out.splitlines()
    assert line.startswith("mine: 2.00 N at ") and written == "written to pictures/mine.png"
    with Image.open("pictures/mine.png") as image:
        background, pressed, difference = np.split(np.asarray(image).astype(int), 3, axis=1)
    assert background.shape == (320, 240, 3)
    assert np.array_equal(np.clip(128 + pressed - background, 0, 255), difference)
    assert np.abs(difference - 128).max() > 40


def test_check_of_a_thin_array_presses_half_way_and_writes_the_tactile_image(capsys):
    text = 'extends = "cyskin-63"\nname = "thin"\n[cover]\nthickness_mm = 0.6\n'
    Path("thin.toml").write_text(text)
    main(["sensors", "check", "thin.toml"])
    line = capsys.readouterr().out
    assert " at 0.300 mm" in line
    assert 0.01 < float(line.split()[1]) < 2.0
    with Image.open("runs/sensors/thin.png") as image:
        assert image.width > 2 * 240 and image.height > 2 * 396
