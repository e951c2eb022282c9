"""The trivial predictors, and the whole evaluation."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from spots import write_spots

from t2twin.cli import main
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.core.tables import text
from t2twin.sim.dataset.store import read_info
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.data.pairs import load_pairs
from t2twin.translate.evaluation.baselines import FEATURE_SIZE, neighbors
from t2twin.translate.evaluation.evaluate import (
    OF_OPTICS,
    as_readings,
    evaluate,
    evaluate_splits,
    prepare,
    read_predictions,
)
from t2twin.translate.evaluation.records import METRICS, read_evaluation
from t2twin.translate.evaluation.table import DIFFERENCE, PAPER, figures_tables
from t2twin.translate.inference.load import load_run
from t2twin.translate.runs.config import best_epoch, read_log

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*unlike all training images:t2twin.core.errors.T2TwinWarning"
)

FULL_SCALE = 40000.0


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_spots(tmp_path_factory.mktemp("spots") / "data", train=48)


@pytest.fixture(scope="module")
def evaluated(runs: list[Path], data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with val and test, not to be written to."""
    folder = tmp_path_factory.mktemp("evaluated")
    evaluate_splits(runs, data_dir, "both", folder)
    return folder


def test_neighbors_are_by_euclid_and_may_pass_over_their_own_shape(data_dir: Path) -> None:
    images = load_pairs(data_dir, "train", FEATURE_SIZE, grey=False).images
    stored = images[:].astype(float).reshape(len(images), -1)
    apart = np.sqrt(np.square(stored[:, None] - stored[None]).mean(axis=2))
    shapes = np.where(np.arange(len(images)) % 2 == 0, "a", "b")
    for names in (None, (shapes, shapes)):
        if names is not None:
            apart[shapes[:, None] == shapes[None]] = np.inf
        near, distance_grey = neighbors(images, images, 3, names)
        np.testing.assert_allclose(distance_grey, np.sort(apart)[:, :3], rtol=1e-5)
        assert np.array_equal(np.take_along_axis(apart, near, axis=1), np.sort(apart)[:, :3])
    _, alone_grey = neighbors(images, images, 2, (np.full(48, "a"), np.full(48, "a")))
    assert np.isinf(alone_grey).all()


def test_evaluation_agrees_with_training(runs: list[Path], data_dir: Path, tmp_path: Path) -> None:
    """On val, a run's RMSE is its best epoch's, and the files say what was returned."""
    evaluation = evaluate(runs, data_dir, "val", tmp_path)
    assert read_evaluation(tmp_path) == evaluation
    models = evaluation.models
    assert list(models) == ["mean-array", "nearest-neighbor", "touch2touch", "resnet18"]
    assert list(evaluation.runs) == ["touch2touch", "resnet18"]
    stored = read_predictions(tmp_path)
    pairs = load_pairs(data_dir, "val", FEATURE_SIZE, grey=False)
    assert np.array_equal(stored.truth, pairs.counts)
    assert list(stored.by_model) == list(models)
    assert (stored.presses["shape"] == "square-3").all()
    assert np.array_equal(stored.presses["x_mm"], pairs.x_mm)
    for run in runs:
        best = best_epoch(read_log(run)).val_rmse_counts
        overall = models[run.name].overall
        assert overall["rmse_counts"] == pytest.approx(best, rel=1e-4)
        squares = np.square(stored.by_model[run.name].astype(float) - stored.truth)
        assert overall["rmse_counts"] == pytest.approx(np.sqrt(squares.mean()), rel=1e-6)
        of_pairs = stored.rmse_counts(run.name)
        assert overall["rmse_counts"] == pytest.approx(
            np.sqrt(np.square(of_pairs).mean()), rel=1e-6
        )
        assert models[run.name].same_data
        weights = (run / "best.safetensors").read_bytes()
        assert models[run.name].weights_sha256 == hashlib.sha256(weights).hexdigest()
    mean = models["mean-array"].overall["rmse_counts"]
    assert models["nearest-neighbor"].overall["rmse_counts"] < mean / 2
    assert evaluation.paper["resnet18"]["rmse_counts"] == 3931


def test_metrics_json_has_its_keys(evaluated: Path) -> None:
    """Other programs read them."""
    content, test = (json.loads((evaluated / s / METRICS).read_text()) for s in ("val", "test"))
    row = content["models"]["resnet18"]
    assert {"split", "pairs", "models", "paired", "paper", "shapes", "view"} <= set(content)
    assert {"overall", "by_shape", "by_family", "interval", "by_force", "run"} <= set(row)
    assert row["overall"]["rmse_percent"] > 0 and row["by_shape"]["square-3"]["ssim"] <= 1
    assert row["interval"]["ssim"] is None  # there is one shape alone
    assert content["models"]["mean-array"]["run"] is None
    assert test["paper"]["resnet18"] == {"rmse_counts": 4867, "rmse_percent": 12.17}


def test_evaluation_of_objects_is_per_tool(runs, data_dir, tmp_path):
    evaluation = evaluate(runs[:1], data_dir, "test", tmp_path)
    model = evaluation.models["touch2touch"]
    assert list(model.by_family) == ["pliers"]
    assert list(model.by_shape) == ["pliers/jaw-tip"]
    assert model.by_family["pliers"] == model.overall
    main = text(figures_tables(evaluation)[0]).splitlines()
    assert any(line.startswith(f"resnet18, {PAPER}") and "4,867" in line for line in main)


def test_both_splits_at_once(runs, data_dir, tmp_path, capsys):
    given = [str(run) for run in runs]
    main(["evaluate", *given, "--data", str(data_dir), "--split", "both", "--out", str(tmp_path)])
    evaluations = {split: read_evaluation(tmp_path / split) for split in ("val", "test")}
    for one in evaluations.values():
        rows = (one.models[name] for name in ("touch2touch", "resnet18"))
        ours, theirs = (row.overall["rmse_counts"] for row in rows)
        assert one.paired["rmse_counts"]["difference"] == pytest.approx(ours - theirs)
        assert "low" not in one.paired["rmse_counts"]  # one shape a split has no interval
    lines = (tmp_path / "results.md").read_text().splitlines()
    error = evaluations["test"].models["resnet18"].overall["rmse_counts"]
    assert any(line.startswith("| resnet18 |") and f"| {error:,.0f} |" in line for line in lines)
    assert capsys.readouterr().out.count(DIFFERENCE) == 2
    evaluate(runs[:1], data_dir, "test", tmp_path)
    assert not any((tmp_path / name).exists() for name in ("results.md", f"val/{METRICS}"))
    evaluate_splits(runs[:1], data_dir, "both", tmp_path)
    assert not (tmp_path / METRICS).exists() and (tmp_path / "val" / METRICS).is_file()


def test_bad_asking_is_refused(runs: list[Path], data_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(T2TwinError, match="no run"):
        evaluate([], data_dir, "val", tmp_path / "out")
    with pytest.raises(T2TwinError, match="config\\.json"):
        evaluate([tmp_path], data_dir, "val", tmp_path / "out")
    with pytest.raises(T2TwinError, match="split"):
        evaluate(runs, data_dir, "validation", tmp_path / "out")
    other = write_spots(tmp_path / "other", train=8, val=2, test=1)
    info = json.loads((other / "info.json").read_text())
    info["target"]["x_mm"] = [0.5 * x for x in info["target"]["x_mm"]]
    (other / "info.json").write_text(json.dumps(info))
    with pytest.raises(T2TwinError, match="with its 20 taxels needs a touch2touch"):
        evaluate(runs[1:], other, "val", tmp_path / "out")
    with pytest.raises(T2TwinError, match="outside the array"):
        evaluate(runs, other, "val", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_other_sensors_of_the_same_names_are_named(runs, data_dir, tmp_path):
    """Other counts are refused; another camera and wrong frames get a warning, and the paper's rows
    are left out. The background frame has the order of the imported frames."""
    other = write_spots(tmp_path / "other", train=8, val=2, test=1, forces_n=(2.0, 8.0))
    info = json.loads((other / "info.json").read_text())
    array = info["target"] | {"full_scale_counts": 4000}
    (other / "info.json").write_text(json.dumps(info | {"target": array}))
    with pytest.raises(T2TwinError, match="cyskin-20 with another full scale; such counts cannot"):
        evaluate(runs, other, "val", tmp_path / "out")
    camera, order = info["source"] | {"view_mm": [8.0, 9.0]}, {"bgr": True, "turn_deg": 90}
    (other / "info.json").write_text(json.dumps(info | {"source": camera, "order": order}))
    frame = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    Image.fromarray(frame).save(tmp_path / "frame.png")
    with pytest.warns(T2TwinWarning) as found:
        result = evaluate(["field"], other, "val", tmp_path / "out", tmp_path / "frame.png")
        inputs = prepare(["field"], other, ("val",), tmp_path / "frame.png")
    words = " ".join(str(each.message) for each in found)
    assert "is of digit with another view; its errors" in words and not result.paper
    assert "first images of val: 2 of 2 images are unlike all training images of field" in words
    assert "mean-array-of-force" not in result.models  # of one pair each
    np.testing.assert_array_equal(inputs.frame, np.rot90(frame, -1)[..., ::-1])


def test_a_field_run_is_given_the_background_of_the_default_optics(small_dataset, tmp_path):
    with pytest.warns(T2TwinWarning, match="on gelsight-mini, and .* is of digit; its err"):
        prepare(["mini"], small_dataset, ("val",))
    found = evaluate(["field"], small_dataset, "val", tmp_path / "default")
    assert found.background == OF_OPTICS
    run = load_run("field")
    pairs = load_pairs(small_dataset, "val", 96, grey=False)
    frame = SensorPair().camera.image_renderer.background
    expected = run._estimate_pixels(run.pixels_of(list(pairs.images[:]), frame))
    expected = as_readings(expected, read_info(small_dataset))
    predictions = read_predictions(tmp_path / "default").by_model["field"]
    np.testing.assert_allclose(predictions, expected.counts, atol=0.5)
    without = as_readings(run._estimate_pixels(pairs.images[:]), read_info(small_dataset))
    assert not np.allclose(predictions, without.counts, atol=0.5)
