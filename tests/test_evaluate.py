"""Metrics on cases whose figures are known, the trivial predictors, and the whole evaluation."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity
from spots import train_smoke, write_spots

from t2twin.cli import main
from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.cyskin.layout import load_layout
from t2twin.translate.data.pairs import load_pairs
from t2twin.translate.evaluation.baselines import (
    FEATURE_SIZE,
    mean_array,
    nearest_neighbour,
    neighbours,
)
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.metrics import compare
from t2twin.translate.evaluation.similarity import alike
from t2twin.translate.evaluation.table import table
from t2twin.translate.phi import Phi
from t2twin.translate.predict import load_run
from t2twin.translate.touch2touch import Touch2Touch

FULL_SCALE = 40000.0


@pytest.fixture(scope="module")
def phi() -> Phi:
    layout = load_layout()
    return Phi(layout.x_mm, layout.y_mm)


@pytest.fixture(scope="module")
def true() -> np.ndarray:
    """Six Gaussian responses about places in the middle of the array."""
    layout = load_layout()
    rng = np.random.default_rng(0)
    places = rng.uniform(-4, 4, (6, 2))
    squares = (layout.x_mm - places[:, :1]) ** 2 + (layout.y_mm - places[:, 1:]) ** 2
    return 30000.0 * np.exp(-squares / 50.0)


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_spots(tmp_path_factory.mktemp("spots") / "data", train=48)


@pytest.fixture(scope="module")
def runs(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    return [
        train_smoke(model, data_dir, folder / model, epochs=3)
        for model in ("touch2touch", "resnet18")
    ]


def test_perfect_prediction(phi: Phi, true: np.ndarray) -> None:
    summary = compare(true, true, phi, FULL_SCALE).summary(FULL_SCALE)
    assert summary["pairs"] == 6
    assert summary["rmse_counts"] == summary["rmse_percent"] == 0.0
    assert summary["ssim"] == summary["ssim_contact"] == pytest.approx(1.0)
    assert summary["contact_iou"] == 1.0
    assert summary["centroid_error_mm"] == summary["total_error_percent"] == 0.0


def test_rmse_is_over_samples_and_taxels(phi: Phi, true: np.ndarray) -> None:
    """One taxel of one sample off by 12,000 of 6 x 20: 12,000 / sqrt(120)."""
    off = true.copy()
    off[2, 7] += 12000.0
    summary = compare(off, true, phi, FULL_SCALE).summary(FULL_SCALE)
    assert summary["rmse_counts"] == pytest.approx(12000.0 / np.sqrt(120))
    assert summary["rmse_percent"] == pytest.approx(30.0 / np.sqrt(120))


def test_error_of_a_part_of_the_taxels(phi: Phi, true: np.ndarray) -> None:
    off = true.copy()
    off[2, 7] += 12000.0
    some = np.arange(20) < 8
    parts = {"some": some, "others": ~some, "none": np.zeros(20, bool)}
    summary = compare(off, true, phi, FULL_SCALE, parts=parts).summary(FULL_SCALE)
    assert summary["rmse_some_counts"] == pytest.approx(12000.0 / np.sqrt(6 * 8))
    assert summary["rmse_others_counts"] == 0.0
    assert np.isnan(summary["rmse_none_counts"])


def test_ssim_is_scikit_images(phi: Phi, true: np.ndarray) -> None:
    """Over the image and over the contact, of tactile images and of noise up to the rim."""
    rng = np.random.default_rng(1)
    images = list(zip(phi(0.7 * true + 500.0), phi(true), strict=True))
    images += [tuple(rng.uniform(0, 30000, (2, 9, 23)).astype(np.float32)) for _ in range(3)]
    for a, b in images:
        ssim, local, *_ = structural_similarity(a, b, data_range=FULL_SCALE, full=True)
        contact_a, contact_b = a > 0.1 * a.max(), b > 0.1 * b.max()
        found = alike(a, b, FULL_SCALE, 0.1)
        assert found[0] == pytest.approx(ssim, abs=1e-6)
        assert found[1] == pytest.approx(local[contact_b].mean(), abs=1e-6)
        assert found[2] == (contact_a & contact_b).sum() / (contact_a | contact_b).sum()


def test_weaker_response_keeps_its_shape(phi: Phi, true: np.ndarray) -> None:
    summary = compare(0.8 * true, true, phi, FULL_SCALE).summary(FULL_SCALE)
    assert summary["total_error_percent"] == pytest.approx(20.0)
    assert summary["contact_iou"] == pytest.approx(1.0, abs=1e-3)
    assert summary["centroid_error_mm"] == pytest.approx(0.0, abs=1e-6)
    assert summary["ssim_contact"] < summary["ssim"] < 1.0


def test_centroid_and_contact_of_single_taxels(phi: Phi) -> None:
    """Two inner taxels answer with the same hexagon of triangles, as far apart as they are."""
    layout = load_layout()
    inner = [n for n in range(20) if (phi.matrix.sum(axis=0)[n] > 0.98 * phi.matrix.sum(0).max())]
    assert len(inner) == 6
    a, b = np.zeros((1, 20)), np.zeros((1, 20))
    a[0, inner[0]] = b[0, inner[-1]] = 20000.0
    figures = compare(a, b, phi, FULL_SCALE)
    apart = np.hypot(
        layout.x_mm[inner[0]] - layout.x_mm[inner[-1]],
        layout.y_mm[inner[0]] - layout.y_mm[inner[-1]],
    )
    assert figures.centroid_error_mm[0] == pytest.approx(apart, abs=0.05)
    assert figures.contact_iou[0] == pytest.approx(0.0, abs=0.02)


def test_iou_of_half_a_contact(phi: Phi) -> None:
    """Contact above a tenth of the maximum: known masks from the images themselves."""
    a, b = np.zeros((1, 20)), np.zeros((1, 20))
    a[0, 7] = 10000.0
    b[0, 7] = b[0, 8] = 10000.0
    mask_a, mask_b = (phi(v[0]) > 0.1 * phi(v[0]).max() for v in (a, b))
    expected = (mask_a & mask_b).sum() / (mask_a | mask_b).sum()
    assert 0.3 < expected < 0.9
    assert compare(a, b, phi, FULL_SCALE).contact_iou[0] == pytest.approx(expected)


def test_no_contact_leaves_the_contacts_figures_out(phi: Phi, true: np.ndarray) -> None:
    nothing = np.zeros_like(true[:1])
    figures = compare(np.vstack([nothing, true]), np.vstack([nothing, true]), phi, FULL_SCALE)
    assert np.isnan([figures.contact_iou[0], figures.centroid_error_mm[0]]).all()
    assert figures.summary(FULL_SCALE)["contact_iou"] == 1.0
    alone = compare(nothing, nothing, phi, FULL_SCALE).summary(FULL_SCALE)
    assert alone["ssim"] == 1.0
    assert np.isnan(alone["contact_iou"])
    missed = compare(np.zeros_like(true), true, phi, FULL_SCALE)
    assert (missed.contact_iou == 0.0).all()
    assert np.isfinite(missed.centroid_error_mm).all()


def test_mean_array_is_the_best_constant(data_dir: Path) -> None:
    pairs = load_pairs(data_dir, "train", FEATURE_SIZE, grey=False)
    mean = mean_array(pairs)
    np.testing.assert_allclose(mean, pairs.counts.mean(axis=0), rtol=1e-5)
    error = np.square(pairs.counts - mean).mean()
    for other in (0.98 * mean, 1.02 * mean):
        assert np.square(pairs.counts - other).mean() > error


def test_nearest_neighbour_of_the_training_images_is_themselves(data_dir: Path) -> None:
    pairs = load_pairs(data_dir, "train", FEATURE_SIZE, grey=False)
    assert np.array_equal(nearest_neighbour(pairs, pairs.images), pairs.counts)


def test_nearest_neighbour_is_by_euclid(data_dir: Path) -> None:
    pairs = load_pairs(data_dir, "train", FEATURE_SIZE, grey=False)
    queries = load_pairs(data_dir, "val", FEATURE_SIZE, grey=False).images
    found = nearest_neighbour(pairs, queries)
    stored = pairs.images[:].astype(float).reshape(len(pairs), -1)
    for image, counts in zip(queries[:].astype(float), found, strict=True):
        nearest = np.linalg.norm(stored - image.ravel(), axis=1).argmin()
        assert np.array_equal(counts, pairs.counts[nearest])


def test_neighbours_pass_over_their_own_shape(data_dir: Path) -> None:
    pairs = load_pairs(data_dir, "train", FEATURE_SIZE, grey=False)
    shapes = np.where(np.arange(len(pairs)) % 2 == 0, "a", "b")
    found = neighbours(pairs.images, pairs.images, 3, (shapes, shapes))
    assert (shapes[found.index] != shapes[:, None]).all()
    stored = pairs.images[:].astype(float).reshape(len(pairs), -1)
    apart = np.sqrt(np.square(stored[:, None] - stored[None]).mean(axis=2))
    apart[shapes[:, None] == shapes[None]] = np.inf
    np.testing.assert_allclose(found.distance_grey, np.sort(apart, axis=1)[:, :3], rtol=1e-5)
    alone = neighbours(pairs.images, pairs.images, 2, (np.full(48, "a"), np.full(48, "a")))
    assert np.isinf(alone.distance_grey).all()


def test_evaluation_agrees_with_training(runs: list[Path], data_dir: Path, tmp_path: Path) -> None:
    """On val, a run's sqrt(L3) is its best epoch's, and the files say what was returned."""
    metrics = evaluate(runs, data_dir, "val", tmp_path)
    assert json.loads((tmp_path / "metrics.json").read_text()) == metrics
    assert list(metrics["models"]) == ["mean-array", "nearest-neighbour", "touch2touch", "resnet18"]
    stored = np.load(tmp_path / "predictions.npz")
    pairs = load_pairs(data_dir, "val", FEATURE_SIZE, grey=False)
    assert np.array_equal(stored["truth"], pairs.counts)
    for run in runs:
        log = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
        best = min(record["val_rmse_counts"] for record in log)
        overall = metrics["models"][run.name]["overall"]
        assert overall["rmse_counts"] == pytest.approx(best, rel=1e-4)
        squares = np.square(stored[run.name].astype(float) - stored["truth"])
        assert overall["rmse_counts"] == pytest.approx(np.sqrt(squares.mean()), rel=1e-6)
        assert metrics["models"][run.name]["same_data"]
    mean = metrics["models"]["mean-array"]["overall"]["rmse_counts"]
    assert metrics["models"]["nearest-neighbour"]["overall"]["rmse_counts"] < mean / 2
    assert metrics["paper"]["resnet18"]["rmse_counts"] == 3931


def test_evaluation_of_objects_is_per_tool(
    runs: list[Path], data_dir: Path, tmp_path: Path
) -> None:
    metrics = evaluate(runs[:1], data_dir, "test", tmp_path)
    model = metrics["models"]["touch2touch"]
    assert list(model["by_family"]) == ["pliers"]
    assert list(model["by_shape"]) == ["pliers/jaw-tip"]
    assert model["by_family"]["pliers"] == model["overall"]
    lines = table(metrics).splitlines()
    assert lines[0] == "test, 8 pairs"
    assert len({len(line) for line in lines[1:-3]}) == 1
    assert "real sensors" in lines[-1]
    assert any(line.startswith("resnet18 (paper, hardware)") and "4867" in line for line in lines)


def test_both_splits_at_once(
    runs: list[Path], data_dir: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = [str(run) for run in runs]
    main(["evaluate", *given, "--data", str(data_dir), "--split", "both", "--out", str(tmp_path)])
    metrics = {split: json.loads((tmp_path / split / "metrics.json").read_text())
               for split in ("val", "test")}  # fmt: skip
    found = json.loads((tmp_path / "findings.json").read_text())
    assert found["val"] == metrics["val"]["findings"]
    assert set(found["gap"]) == {"gap-touch2touch", "gap-resnet18"}
    for name in ("touch2touch", "resnet18"):
        errors = {s: m["models"][name]["overall"]["rmse_counts"] for s, m in metrics.items()}
        gap = found["gap"][f"gap-{name}"]
        assert gap["difference"] == pytest.approx(errors["test"] - errors["val"])
        assert gap["answer"] == "undecided"  # one shape a split has no interval
    lines = (tmp_path / "results.md").read_text().splitlines()
    assert len({line.count("|") for line in lines}) == 1
    error = metrics["test"]["models"]["resnet18"]["overall"]["rmse_counts"]
    assert any(line.startswith("| resnet18 |") and f"| {error:,.0f} |" in line for line in lines)
    said = capsys.readouterr().out
    assert "val, 12 pairs" in said and "test, 8 pairs" in said
    assert "Is resnet18 worse on the novel objects than on validation? Undecided" in said


def test_predictions_do_not_depend_on_the_batch(runs: list[Path], data_dir: Path) -> None:
    pairs = load_pairs(data_dir, "val", 64, grey=False)
    for run_dir in runs:
        run = load_run(run_dir)
        together = run.predict(pairs.images[:])
        alone = np.concatenate([run.predict(pairs.images[n : n + 1]) for n in range(len(pairs))])
        np.testing.assert_allclose(together, alone, atol=1.0)
        assert together.min() >= 0.0
        assert together.max() <= FULL_SCALE


def test_drawn_images_become_counts_and_tactile_images(
    runs: list[Path], data_dir: Path, phi: Phi, true: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A generator that drew perfectly would give the counts back, and phi of them at full size."""
    run = load_run(runs[0])
    translator = run.translator
    assert isinstance(translator, Touch2Touch)
    perfect = translator.phi.to_torch(torch.tensor(true, dtype=torch.float32))
    monkeypatch.setattr(translator, "draw", lambda images: perfect)
    images = load_pairs(data_dir, "val", 64, grey=False).images[:6]
    np.testing.assert_allclose(run.predict(images), true, atol=1.0)
    tactile = run.tactile_images(images)
    assert tactile.shape == (6, 396, 240)
    assert np.abs(tactile - phi(true)).mean() < 0.01 * true.max()


def test_resnet18s_tactile_images_are_phi_of_its_counts(
    runs: list[Path], data_dir: Path, phi: Phi
) -> None:
    run = load_run(runs[1])
    images = load_pairs(data_dir, "val", 64, grey=False).images[:4]
    np.testing.assert_allclose(run.tactile_images(images), phi(run.predict(images)), atol=1.0)


def test_bad_asking_is_refused(runs: list[Path], data_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(T2TwinError, match="no run"):
        evaluate([], data_dir, "val", tmp_path / "out")
    with pytest.raises(T2TwinError, match="config\\.json"):
        evaluate([tmp_path], data_dir, "val", tmp_path / "out")
    with pytest.raises(T2TwinError, match="split"):
        evaluate(runs, data_dir, "validation", tmp_path / "out")
    other = write_spots(tmp_path / "other", train=8, val=2, test=1)
    info = json.loads((other / "info.json").read_text())
    info["layout_x_mm"] = [0.5 * x for x in info["layout_x_mm"]]
    (other / "info.json").write_text(json.dumps(info))
    with pytest.raises(T2TwinError, match=r"resnet18 is a ResNet18, which gives the 20 taxels"):
        evaluate(runs[1:], other, "val", tmp_path / "out")
    with pytest.raises(T2TwinError, match="outside the array"):
        evaluate(runs, other, "val", tmp_path / "out")
    assert not (tmp_path / "out").exists()
