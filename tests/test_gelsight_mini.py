"""A sensor that is a file alone goes the whole way: dataset, training, translation, MuJoCo."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from spots import train_smoke
from test_attach import FORCE_N, scene, simulate
from test_contact_prediction import RECIPE

import t2twin
from t2twin.cli import main
from t2twin.sim.dataset.store import read_info

SENSORS = 'source = "gelsight-mini"\ntarget = "flexitac"'


@pytest.fixture(scope="module")
def data(tmp_path_factory, shape_cache) -> Path:
    """A small dataset, to 384 taxels."""
    folder = tmp_path_factory.mktemp("few")
    (folder / "few.toml").write_text(RECIPE.replace("contact_maps = true", SENSORS))
    t2twin.make_dataset(folder / "data", recipe=folder / "few.toml", workers=1, cache=shape_cache)
    return folder / "data"


@pytest.mark.parametrize(
    "model", ["touch2touch", pytest.param("resnet18", marks=pytest.mark.exhaustive), "field"]
)
def test_a_network_is_trained_evaluated_and_translates(data, model, tmp_path):
    run = train_smoke(model, data, tmp_path / "run", epochs=1)
    t2twin.evaluate([run], data, "val", tmp_path / "evaluated")
    touch = t2twin.Twin(source="gelsight-mini", target="flexitac").press("hemisphere-1", force_n=4)
    assert touch.image.shape == (240, 320, 3)
    Image.fromarray(touch.image).save(tmp_path / "press.png")
    words = ["translate", str(tmp_path / "press.png"), "--run", str(run)]
    main([*words, "--out", str(tmp_path / "t")])
    counts = json.loads((tmp_path / "t" / "counts.json").read_text())["images"][0]["counts"]
    assert len(counts) == touch.counts.size == 384
    target = read_info(data).target
    assert np.isfinite(counts).all() and 0 <= min(counts) <= max(counts) <= target.full_scale_counts
    assert target.imperfections and target.imperfections.white_counts > 0  # by default


@pytest.mark.parametrize("sensor", ["gelsight-mini", "flexitac"])
def test_it_is_attached_to_a_model(sensor):
    spec = scene()
    attached = t2twin.attach(spec, site="pad", sensor=sensor)
    touch = attached.read(*simulate(spec))
    assert touch.contacts[sensor].force_n == pytest.approx(FORCE_N, rel=0.01)
    value = touch.image if touch.image is not None else touch.counts
    assert np.ptp(value.astype(int)) > 0 and not touch.notices
