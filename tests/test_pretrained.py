"""Runs that ship: made of a training's run, found by their name, and as good as their card says."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from session import Products

from maintenance.publish_pretrained import publish_pretrained
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad import catalogue
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.store import read_info
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.data.pairs import load_pairs
from t2twin.translate.evaluation.evaluate import as_readings, evaluate
from t2twin.translate.evaluation.metrics import uncertainty_metrics
from t2twin.translate.inference.load import load_run
from t2twin.translate.runs import config as run_config
from t2twin.translate.runs.checkpoint import average_runs
from t2twin.translate.runs.config import BEST, HOME, resolve_run, versioned

MAX_BYTES = 28_000_000
"""Of all weights that ship together."""

CARDS = {"field": "paper", "mini": "small"}
"""Scales of the evaluations in the cards of the pretrained runs."""


def test_half_the_bytes_and_the_same_counts(runs, data_dir, tmp_path, monkeypatch) -> None:
    evaluate([runs[1]], data_dir, "val", tmp_path / "evaluation" / "val")
    folder = publish_pretrained("mine", runs[1], [tmp_path / "evaluation"], tmp_path / "home")
    assert folder == tmp_path / "home" / "mine"
    whole, half = runs[1] / BEST, folder / BEST
    assert half.stat().st_size < 0.52 * whole.stat().st_size
    kept = load_file(half)
    for name, tensor in load_file(whole).items():
        assert kept[name].shape == tensor.shape
        if name.endswith(("running_mean", "running_var", "bias")):
            assert kept[name].dtype == tensor.dtype
    pixels = np.random.default_rng(0).integers(0, 256, (4, 64, 64, 3), np.uint8)
    monkeypatch.setattr(run_config, "HOME", tmp_path / "home")
    monkeypatch.chdir(tmp_path)
    by_name = load_run("mine")._predict_pixels(pixels)
    np.testing.assert_allclose(by_name, load_run(runs[1])._predict_pixels(pixels), atol=100)
    card = (folder / "README.md").read_text()
    assert re.search(r"\| .*, new versions of primitives \| [\d,]+ \| [\d.]+ \|", card)
    assert "# ResNet18, mine@1, preset smoke" in card
    assert 'load("mine").predict' in card and "--run mine`" in card
    assert card.index("## Measured") < card.index("## Limits")


def test_weights_are_averaged_and_the_card_has_the_share(runs, tmp_path) -> None:
    later = tmp_path / "later"
    shutil.copytree(runs[1], later)
    first = load_file(runs[1] / BEST)
    save_file({k: v + 1.0 if v.is_floating_point() else v for k, v in first.items()}, later / BEST)
    average_runs(runs[1], later, 0.75, tmp_path / "mean")
    for name, tensor in load_file(tmp_path / "mean" / BEST).items():
        expected = first[name] + 0.75 if tensor.is_floating_point() else first[name]
        torch.testing.assert_close(tensor, expected)
    folder = publish_pretrained("mine", tmp_path / "mean", home=tmp_path / "home")
    assert "0.75 times those described here, plus 0.25" in (folder / "README.md").read_text()
    with pytest.raises(T2TwinError, match="from 0 to 1"):
        average_runs(runs[1], later, 1.5, tmp_path / "other")
    with pytest.raises(T2TwinError, match="exists"):
        average_runs(runs[1], later, 0.5, tmp_path / "mean")
    with pytest.raises(T2TwinError, match="different networks"):
        average_runs(runs[0], later, 0.5, tmp_path / "other")
    (later / "README.md").unlink()
    with pytest.raises(T2TwinError, match=r"README\.md does not exist; .* finished its training"):
        average_runs(runs[1], later, 0.5, tmp_path / "other")
    assert not (tmp_path / "other").exists()


def test_a_name_is_the_pretrained_run_and_a_path_the_folder(runs, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert resolve_run("field") == HOME / "field"
    shutil.copytree(runs[1], tmp_path / "field")
    assert resolve_run("field") == HOME / "field"
    assert resolve_run("./field") == resolve_run(Path("field")) == Path("field")
    shutil.rmtree(tmp_path / "field")
    with pytest.raises(T2TwinError, match=r"there is no run fild; .* a pretrained run: .*field"):
        resolve_run("fild")
    with pytest.raises(T2TwinError, match=r"there is no run \./field"):
        resolve_run("./field")
    assert resolve_run(versioned("field")) == HOME / "field"
    with pytest.raises(T2TwinError, match=r"no run field@2; this t2twin contains field@3"):
        resolve_run("field@2")


@pytest.mark.parametrize("name", [pytest.param("mini", marks=pytest.mark.exhaustive), "field"])
def test_the_card_says_what_is_measured(name: str, products: Products) -> None:
    """Presses of hand tools, made anew, come to the card's figure for all of the protocol's."""
    card = (HOME / name / "README.md").read_text()
    pattern = rf"\| {CARDS[name]}, hand tools \| [\d,]+ \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|"
    row = re.search(pattern, card)
    assert row is not None
    run = load_run(name)
    source, target = run.config.data.camera.name, run.config.data.array.name
    assert source is not None and target is not None
    sensors = SensorPair.of(source, target).with_imperfections(None)
    tools = products.make(
        f"tools-{name}",
        lambda to: make_dataset(to, "small", workers=1, sensors=sensors, shapes=catalogue.OBJECTS),
    )
    pairs = load_pairs(tools, "test", run.config.preset.size, grey=False)
    said = as_readings(run._estimate_pixels(pairs.inputs), read_info(tools))
    off = said.counts - pairs.counts
    percent = 100.0 * np.sqrt(np.mean(np.square(off))) / run.config.data.array.full_scale_counts
    assert percent == pytest.approx(float(row[1]), rel=0.1)
    held = uncertainty_metrics(said, pairs.counts, pairs.force_n).figures["coverage_percent"]
    assert held == pytest.approx(float(row[3]), abs=3.0)
    print(percent, held, row.groups())
