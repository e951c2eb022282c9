"""Datasets, runs, calibrations and worlds of version 0.2 load and work: tests/stored_0_2."""

import io
import json
import lzma
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin import taxels
from t2twin.sim.dataset.store import read_split

STORED = Path(__file__).parent / "stored_0_2"
PREDICTIONS = json.loads((STORED / "predictions.json").read_text())


@pytest.fixture(scope="module")
def stored(products):
    """A copy of the folder whose weights are not compressed."""

    def build(folder):
        shutil.copytree(STORED, folder)
        for packed in folder.rglob("*.xz"):
            packed.with_suffix("").write_bytes(lzma.decompress(packed.read_bytes()))

    return products.make("stored_0_2", build)


def test_a_stored_dataset_is_valid(stored):
    assert t2twin.verify_dataset(stored / "dataset") == []
    pairs = [len(read_split(stored / "dataset", split)) for split in ("train", "val", "test")]
    assert pairs == [8, 2, 1]


def test_a_stored_world_gives_the_same_presses(stored, tmp_path, monkeypatch):
    """With the gain of version 0.2. Contact is more accurate since: depths change by up to 1 %."""
    monkeypatch.setattr(taxels.counts, "__defaults__", (78_000.0,))
    t2twin.make_dataset(tmp_path / "again", world=stored / "world.toml", workers=1)
    tolerances = {
        "digit_depth_mm": 0.02, "cyskin_depth_mm": 0.02, "digit_force_n": 1e-5,
        "cyskin_force_n": 1e-5, "taxels": 400, "field": 400,
    }  # fmt: skip
    for split in ("train", "val", "test"):
        before = read_split(stored / "dataset", split)
        again = read_split(tmp_path / "again", split)
        exact = set(before.column_names) - set(tolerances) - {"image"}
        assert again.select(sorted(exact)).equals(before.select(sorted(exact)))
        for name, tolerance in tolerances.items():
            values = [np.array(table[name].to_pylist(), float) for table in (before, again)]
            assert np.abs(values[1] - values[0]).max() <= tolerance, name
        for images in zip(before["image"].to_pylist(), again["image"].to_pylist(), strict=True):
            grey = [np.asarray(Image.open(io.BytesIO(each["bytes"])), float) for each in images]
            assert np.abs(grey[1] - grey[0]).mean() < 1.0


def test_a_stored_recipe_keeps_every_field(stored):
    recipe = t2twin.load_recipe(stored / "every_field.toml")
    assert [part.shapes for part in recipe.parts] == ["random", "primitives", "tools", "solids"]
    assert recipe.light.frames == 1 and recipe.light.draw.led_size_mm


def test_a_stored_unfinished_dataset_is_refused(stored):
    with pytest.raises(T2TwinError, match="unfinished"):
        read_split(stored / "unfinished", "train")


@pytest.mark.parametrize("expected", PREDICTIONS["pairs"], ids=lambda pair: pair["split"])
def test_a_stored_field_run_predicts_the_same(stored, expected):
    row = row_of(stored, expected)
    run = t2twin.load(stored / "field").in_float32()
    estimate = run.estimate(pixels(row["image"]), pixels(row["untouched"]))
    for name in ("counts", "counts_std", "force_n", "force_std_n"):
        atol = 1e-3 if name.startswith("force") else 0.1
        np.testing.assert_allclose(getattr(estimate, name), expected[name], rtol=1e-4, atol=atol)


@pytest.mark.parametrize("expected", PREDICTIONS["pairs"], ids=lambda pair: pair["split"])
def test_a_stored_cyskin_to_digit_run_predicts_the_same(stored, expected):
    counts = np.array(row_of(stored, expected)["taxels"], np.float32)
    image = t2twin.load(stored / "cyskin-to-digit").predict_image(counts)
    np.testing.assert_allclose(image.mean(axis=1), expected["digit_image"], atol=0.5)


def test_a_press_with_a_stored_calibration_gives_the_same_image(stored):
    twin = t2twin.Twin(calibration=stored / "calibration" / "calibration.npz")
    image = twin.press("circle-1", force_n=4.0).image
    expected = PREDICTIONS["calibration"]["image_mean_of_rows"]
    # The press is 1 % deeper or less deep since.
    np.testing.assert_allclose(image.mean(axis=(1, 2))[::20], expected, atol=0.1)


def row_of(stored, expected):
    """The stored pair that a prediction is of."""
    rows = read_split(stored / "dataset", expected["split"]).to_pylist()
    return next(row for row in rows if row["index"] == expected["index"])


def pixels(image):
    return np.asarray(Image.open(io.BytesIO(image["bytes"])))
