"""The shear force that field runs predict, and the evaluation of moving touches."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from msgspec import structs
from torch import nn

from t2twin.translate.data.pairs import Pairs, load_info, load_pairs
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.metrics import shear_metrics
from t2twin.translate.evaluation.records import read_evaluation
from t2twin.translate.inference.estimate import Estimate
from t2twin.translate.inference.load import export_onnx, load, load_run
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.field_net import ShearHead, box_means, displacements
from t2twin.translate.models.presets import PRESETS
from t2twin.translate.runs.checkpoint import build, save_weights
from t2twin.translate.runs.config import BEST, RunConfig
from t2twin.translate.training.train import train
from t2twin.translate.uncertainty.calibration import (
    HALF_WIDTH,
    Errors,
    fit_calibration,
    interpolate_scale,
)

SMOKE = PRESETS["field"]["smoke"]


def config_for(data_dir: Path, *, shear: bool) -> RunConfig:
    info = load_info(data_dir)
    if not shear:
        info = structs.replace(info, has_shear=False)
    return RunConfig("field", SMOKE, 0, info, None, None, 1, False, 1)


@pytest.fixture(scope="module")
def still_run(moving_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An untrained run that does not predict the shear force."""
    folder = tmp_path_factory.mktemp("still")
    config = config_for(moving_dataset, shear=False)
    structs.replace(config, data=structs.replace(config.data, recipe="still")).save(folder)
    translator = build(config)
    translator.prepare(load_pairs(moving_dataset, "train", SMOKE.size, False, folder / "c", True))
    save_weights(folder / BEST, translator.predictor.state_dict())
    return folder


@pytest.fixture(scope="module")
def run_dir(moving_dataset, still_run, tmp_path_factory) -> Path:
    """A run that predicts the shear force, from the weights of one that does not."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    train("field", moving_dataset, "smoke", folder, epochs=1, init_from=still_run)
    return folder


def translator_of(data_dir: Path, pairs: Pairs, *, shear: bool) -> FieldTranslator:
    torch.manual_seed(0)
    translator = build(config_for(data_dir, shear=shear))
    assert isinstance(translator, FieldTranslator)
    translator.prepare(pairs)
    return translator


def test_its_training_leaves_the_other_weights(moving_dataset: Path, tmp_path: Path) -> None:
    pairs = load_pairs(moving_dataset, "train", SMOKE.size, False, tmp_path, True)
    trained = []
    for shear in (False, True):
        translator = translator_of(moving_dataset, pairs, shear=shear)
        torch.manual_seed(0)
        translator.step(translator.examples(pairs, np.arange(6)))
        trained.append(translator.network.state_dict())
    plain, shear = trained
    assert all(torch.equal(shear[name], each) for name, each in plain.items())


def test_displacement_of_a_moved_surface_of_second_order() -> None:
    """Central differences and the mean of both gradients are exact for it."""
    y, x = torch.meshgrid(torch.arange(24.0) - 11.0, torch.arange(24.0) - 9.0, indexing="ij")

    def surface(right: float, down: float) -> torch.Tensor:
        across, along = x - right, y - down
        return (across**2 + 0.5 * along**2 + 0.3 * across * along)[None, None]

    moved, roots = displacements(surface(0.4, -0.7), surface(0.0, 0.0), box_means(24, 8, 0))
    assert moved.shape == (1, 2, 3, 3) and roots.shape == (1, 3, 3, 3)
    np.testing.assert_allclose(moved[0, :, 1, 1], [0.4, -0.7], atol=1e-4)  # away from the rim
    still, _ = displacements(surface(0.0, 0.0), surface(0.0, 0.0), box_means(24, 8, 0))
    assert not still.any()


def test_mirrored_batches_have_the_same_force() -> None:
    torch.manual_seed(0)
    head = ShearHead(32, 8)
    nn.init.zeros_(head.weights.weight)  # equal weights of all windows
    image, frame, vector = torch.randn(2, 3, 32, 32), torch.randn(2, 3, 32, 32), torch.randn(2, 8)
    with torch.no_grad():
        expected = head.eval()(image, frame, vector)[0]
        found = [head.train()(image, frame, vector)[0] for _ in range(20)]
    for each in found:
        np.testing.assert_allclose(each, expected, rtol=1e-3, atol=1e-5)


def test_a_step_trains_the_shear_force(moving_dataset: Path, tmp_path: Path) -> None:
    pairs = load_pairs(moving_dataset, "train", SMOKE.size, False, tmp_path, True)
    assert pairs.shear_n is not None
    translator = translator_of(moving_dataset, pairs, shear=True)
    rms = np.sqrt(np.square(pairs.shear_n).mean())
    assert float(translator.network.shear_scale) == pytest.approx(rms, rel=1e-6)
    before = translator.network.shear.weights.weight.clone()
    losses = translator.step(translator.examples(pairs, np.arange(6)))
    assert {"shear", "shear_spread"} <= losses.keys()
    assert not torch.equal(translator.network.shear.weights.weight, before)
    assert translator.further_errors(pairs)["val_shear_error"] > 0.0
    assert not translator_of(moving_dataset, pairs, shear=False).further_errors(pairs)


def test_overfits_one_batch() -> None:
    torch.manual_seed(0)
    head, vector = ShearHead(64, 8), torch.randn(16, 8)
    frame = 3.0 * nn.functional.avg_pool2d(torch.randn(16, 3, 64, 64), 5, 1, 2)
    pixels = torch.randint(-1, 2, (16, 2))
    moved = [
        each.roll((int(y), int(x)), (1, 2)) for each, (x, y) in zip(frame, pixels, strict=True)
    ]
    image, target = torch.stack(moved), 3.0 * pixels
    optimizer, losses = torch.optim.AdamW(head.parameters(), 1e-2), []
    for _ in range(60):
        optimizer.zero_grad()
        loss = (head(image, frame, vector)[0] - target).square().mean()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.1 * losses[0]


def test_a_trained_run_predicts_it_in_both_engines(run_dir, moving_dataset, tmp_path) -> None:
    pytest.importorskip("onnxruntime")
    run = load_run(run_dir)
    pairs = load_pairs(moving_dataset, "val", SMOKE.size, False, tmp_path, True)
    estimate = run._estimate_pixels(pairs.inputs)
    assert estimate.shear_n is not None and estimate.shear_std_n is not None
    assert estimate.shear_n.shape == estimate.shear_std_n.shape == (5, 2)
    assert (estimate.shear_std_n > 0.0).all()
    first = estimate.first()
    assert first.shear_n is not None and first.shear_n.shape == (2,)
    assert export_onnx(run, tmp_path / "run.onnx") < 1.0
    fast = load(run_dir, engine="onnx")._estimate_pixels(pairs.inputs)
    for name, tolerance in (("shear_n", 1e-3), ("shear_std_n", 1e-3), ("force_n", 1e-2)):
        own, other = getattr(estimate, name), getattr(fast, name)
        np.testing.assert_allclose(other, own, atol=tolerance)


def test_evaluation_separates_moving_touches(run_dir, moving_dataset, tmp_path) -> None:
    result = evaluate([run_dir], moving_dataset, "val", tmp_path)
    row = result.models["field"]
    assert row.by_motion is not None and row.shear is not None
    still, moving = (row.by_motion[name] for name in ("still", "moving"))
    whole = row.overall["rmse_counts"] ** 2 * result.pairs
    pairs, rmse_counts = (
        np.array([each[key] for each in (still, moving)], float) for key in ("pairs", "rmse_counts")
    )
    assert pairs.sum() == result.pairs
    parts = (pairs * rmse_counts**2).sum()
    assert parts == pytest.approx(whole)
    assert read_evaluation(tmp_path) == result


def test_shear_metrics_of_known_errors() -> None:
    rng = np.random.default_rng(0)
    angle = rng.uniform(0.0, 2.0 * np.pi, 400)
    true = np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(1.0, 5.0, 400)[:, None]
    turn = np.deg2rad(10.0)
    turned = true @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    found, nothing = 1.2 * turned, np.zeros((400, 1))
    pairs = Pairs(None, nothing, *[nothing] * 6, shear_n=true, is_moving=angle < 6.0)  # pyright: ignore[reportArgumentType]
    estimate = Estimate(4e4, nothing, nothing, shear_n=found)
    estimate = replace(estimate, shear_std_n=np.abs(found - true) / np.array([1.0, 2.0]))
    metrics = shear_metrics(estimate, pairs)
    assert metrics is not None and metrics["pairs"] == (angle < 6.0).sum()
    assert metrics["direction_error_deg"] == pytest.approx(10.0)
    assert metrics["magnitude_error_percent"] == pytest.approx(20.0)
    assert metrics["coverage_percent"] == pytest.approx(50.0)


def test_calibrated_intervals_of_the_shear_cover_ninety_percent() -> None:
    generator = torch.Generator().manual_seed(0)
    spread = torch.exp(torch.randn(4000, 2, generator=generator))
    errors = 3.0 * spread * torch.randn(4000, 2, generator=generator)
    one = torch.ones(4000)
    field = torch.randn(4000, 3, generator=generator)
    still = Errors(field, torch.ones(4000, 3), one, one)
    found = fit_calibration([still, replace(still, shear=errors, shear_spread=spread)])
    assert "shear_knots" not in fit_calibration([still])
    std = spread * interpolate_scale(spread.log(), found["shear_knots"])
    assert float((errors.abs() <= HALF_WIDTH * std).float().mean()) == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose(std / spread, 3.0, rtol=0.1)
