"""touch2touch from counts to images: its validation, its direction, and that it has no counts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import t2twin
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.translate.data.pairs import Examples, load_pairs
from t2twin.translate.inference.load import export_onnx
from t2twin.translate.models.presets import PRESETS
from t2twin.translate.models.touch2touch import Pix2Pix
from t2twin.translate.runs.config import read_log
from t2twin.translate.training.train import train

SMOKE = PRESETS["touch2touch"]["smoke"]
WAY = "counts-to-image"


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def run_dir(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "other-way"
    train("touch2touch", data_dir, SMOKE, folder, epochs=4, direction=WAY)
    return folder


def test_training_is_validated_by_its_pictures(data_dir: Path, run_dir: Path) -> None:
    """The best epoch's figure is the RMSE of the validation's pixels, in percent of 255."""
    best = min(read_log(run_dir), key=lambda record: record.val_rmse_percent)
    pairs = load_pairs(data_dir, "val", SMOKE.size, SMOKE.grey)
    drawn = t2twin.load(run_dir).predict_image(pairs.counts).astype(float)
    rmse = np.sqrt(np.square(drawn - pairs.images[:][..., 0]).mean())
    assert best.val_rmse_grey == pytest.approx(rmse, abs=0.1)
    assert best.val_rmse_percent == pytest.approx(100 * rmse / 255, abs=0.05)
    assert best.val_rmse_counts is None


def test_pictures_have_the_shape_of_the_counts(run_dir: Path) -> None:
    run = t2twin.load(run_dir)
    counts = np.linspace(0, 40_000, 20)
    one, several = run.predict_image(counts), run.predict_image(np.stack([counts, 0 * counts]))
    assert one.shape == (32, 32) and one.dtype == np.uint8
    assert several.shape == (2, 32, 32) and several.dtype == np.uint8
    assert np.array_equal(several[0], one) and not np.array_equal(several[1], one)
    whole = counts.astype(np.uint16)
    assert np.array_equal(run.predict_image(whole), run.predict_image(counts // 1))
    assert run.predict_image(np.empty((0, 20))).shape == (0, 32, 32)
    with pytest.warns(T2TwinWarning, match="all counts lie between 0 and 1; expected counts"):
        run.predict_image(counts / 40_000)


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        (np.zeros(19), r"\(19,\) .* must be \(20,\) or \(B, 20\)"),
        (np.zeros((2, 2, 20)), "they must be"),
        (np.float32(3), "they must be"),
        (np.full(20, np.nan), "expected numbers from 0 to 40,000"),
        (np.full(20, -1.0), "expected numbers from 0 to 40,000"),
        (np.full(20, 40_001), "expected numbers from 0 to 40,000"),
        (np.array(["many"] * 20), "expected an array of numbers"),
    ],
)
def test_what_cannot_be_counts_is_one_sentence(run_dir: Path, counts: np.ndarray, said: str):
    with pytest.raises(T2TwinError, match=said):
        t2twin.load(run_dir).predict_image(counts)


def test_jitter_is_not_put_on_what_is_drawn(data_dir, tmp_path, monkeypatch):
    seen = []
    step = Pix2Pix.step

    def watched(self: Pix2Pix, examples: Examples) -> dict[str, torch.Tensor]:
        seen.append(examples.targets.numpy().copy())
        return step(self, examples)

    monkeypatch.setattr(Pix2Pix, "step", watched)
    train("touch2touch", data_dir, replace(SMOKE, noise=0.1), tmp_path, epochs=1, direction=WAY)
    grey = np.concatenate(seen)
    np.testing.assert_array_equal(grey, np.rint(grey))


@pytest.mark.parametrize(
    "ask",
    [
        lambda run, frame: run.estimate(frame),
        lambda run, frame: run.sample_dense_counts(frame, 2),
        lambda run, frame: run.tactile_images(frame),
        lambda run, frame: export_onnx(run, "x.onnx"),
        lambda run, frame: t2twin.load(run.run_dir, layout="cyskin-63"),
    ],
    ids=["estimate", "sample_dense_counts", "tactile_images", "export_onnx", "layout"],
)
def test_a_loaded_run_gives_no_counts(ask, run_dir, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(T2TwinError, match=r"is touch2touch counts-to-image; .* needs"):
        ask(t2twin.load(run_dir), np.zeros((320, 240, 3), np.uint8))
    assert not list(tmp_path.iterdir())
