"""Files of taxel layouts, and a translator on a layout that it was not trained on."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from spots import train_smoke, write_spots

from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.sim.taxels.layout import Layout, load_layout
from t2twin.translate.evaluation.baselines import LAYOUT_FLOOR, representable
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.models.touch2touch import Touch2Touch

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*unlike all training images:t2twin.core.errors.T2TwinWarning"
)

PITCH_MM = 4.0


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, TrainedTranslator]:
    folder = tmp_path_factory.mktemp("layouts")
    data = write_spots(folder / "data", train=16, val=4, test=2)
    return {
        model: load_run(train_smoke(model, data, folder / model, epochs=1))
        for model in ("touch2touch", "resnet18")
    }


@pytest.fixture(scope="module")
def dense() -> Layout:
    """A triangular grid, 4 mm apart, inside the default layout: its rim is not the layout's."""
    rows, columns = np.mgrid[-6:7, -5:6]
    x, y = (columns + 0.5 * (rows % 2)) * PITCH_MM, rows * PITCH_MM * np.sqrt(3) / 2
    layout = load_layout()
    low = np.interp(x, layout.x_mm[:4], layout.y_mm[:4])  # two sides of the parallelogram
    high = np.interp(x, layout.x_mm[-4:], layout.y_mm[-4:])
    inside = (np.abs(x) <= layout.x_mm.max()) & (y >= low) & (y <= high)
    return layout_of("dense", x[inside], y[inside])


def layout_of(name: str, x_mm: np.ndarray, y_mm: np.ndarray) -> Layout:
    return Layout(name, x_mm, y_mm, np.full(x_mm.size, 4.0))


def drawing(run: TrainedTranslator, counts: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    """Makes the run's generator draw exactly the tactile images of these trained counts."""
    assert isinstance(run.translator, Touch2Touch)
    perfect = run.translator.phi.to_torch(torch.tensor(counts, dtype=torch.float32))
    outputs = perfect * (2.0 / run.translator.full_scale) - 1.0
    monkeypatch.setattr(Touch2Touch, "outputs", lambda self, images, *wanted: outputs)


def test_drawn_images_are_read_exactly_by_any_layout(runs, dense, phi, true, monkeypatch):
    """Interpolation leaves what is linear in x and y as it is, up to the new layout's rim; of the
    trained layout any counts come back, and phi of them at full size."""

    def response(x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
        return 20000.0 + 500.0 * x_mm - 300.0 * y_mm

    run, layout = runs["touch2touch"], load_layout()
    drawing(run, response(layout.x_mm, layout.y_mm)[None], monkeypatch)
    applied = run._at_layout(dense)
    counts = applied.predict(np.zeros((1, 320, 240, 3), np.uint8))
    assert counts.shape == (1, dense.size) and dense.size > 30
    np.testing.assert_allclose(counts[0], response(dense.x_mm, dense.y_mm), atol=1.0)
    assert applied.config.data.array.layout == "dense"
    drawing(run, true, monkeypatch)
    images = np.zeros((len(true), 320, 240, 3), np.uint8)
    np.testing.assert_allclose(run.predict(images), true, atol=1.0)
    assert np.abs(run.tactile_images(images) - phi(true)).mean() < 0.01 * true.max()


def test_layouts_that_cannot_be_read_are_refused(runs, dense):
    pads = replace(dense, pad_diameter_mm=np.full(dense.size, 8.0))
    with pytest.warns(T2TwinWarning, match="other pads than those of dense, .* does not model"):
        runs["touch2touch"]._at_layout(pads)
    with pytest.raises(T2TwinError, match="needs a touch2touch or a field run"):
        runs["resnet18"]._at_layout(dense)
    wide = layout_of("wide", dense.x_mm + 12.0 * (np.arange(dense.size) == 3), dense.y_mm)
    with pytest.raises(T2TwinError, match=r"taxel 3 of the layout wide, .* outside the array"):
        runs["touch2touch"]._at_layout(wide)
    close = np.linspace(-1.0, 1.0, 5)
    x_mm, y_mm = (v.ravel() for v in np.meshgrid(close, close))
    with pytest.raises(T2TwinError, match="too close together"):
        runs["touch2touch"]._at_layout(layout_of("tiny", x_mm, y_mm))


def test_evaluation_on_a_denser_layout(
    runs: dict[str, TrainedTranslator], dense: Layout, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Errors are of the new layout's taxels; a generator that drew the truth meets the floor."""
    with monkeypatch.context() as patch:
        patch.setattr("spots.load_layout", lambda name: dense)
        data = write_spots(tmp_path / "dense", train=8, val=4, test=2)
    run = runs["touch2touch"]
    evaluation = evaluate([run.run_dir], data, "val", tmp_path / "out")
    assert evaluation.models["touch2touch"].trained_layout == "cyskin-20"
    assert evaluation.layout == "dense"
    assert evaluation.view is not None
    groups = [evaluation.view[name] or 0 for name in ("under", "near", "beyond")]
    assert sum(groups) == dense.size
    assert evaluation.view["pitch_mm"] == pytest.approx(PITCH_MM)
    stored = np.load(tmp_path / "out" / "predictions.npz")
    assert stored["touch2touch"].shape == stored["truth"].shape == (4, dense.size)
    kept = representable(run.config.data.array, dense.x_mm, dense.y_mm)
    np.testing.assert_allclose(stored[LAYOUT_FLOOR], stored["truth"] @ kept.T, rtol=1e-5, atol=0.1)
    floor = evaluation.models[LAYOUT_FLOOR].overall["rmse_counts"]
    assert 0 < floor < evaluation.models["touch2touch"].overall["rmse_counts"]


TAXELS = [{"x_mm": -6.0, "y_mm": -6.0}, {"x_mm": 6.0, "y_mm": -6.0}, {"x_mm": 0.0, "y_mm": 6.0}]


@pytest.mark.parametrize(
    "text",
    [
        "x_mm,y_mm\n-6,-6\n6,-6\n0,6\n",
        "x_mm; y_mm; pad_diameter_mm\n-6,0; -6; 4,0\n6; -6; 4\n0; 6; \n",
        json.dumps(
            {"about": "three", "format": "1.0", "taxels": [t | {"note": "a"} for t in TAXELS]}
        ),
    ],
)
def test_spellings_of_one_layout(text: str, tmp_path: Path) -> None:
    path = tmp_path / ("three.json" if "{" in text else "three.csv")
    path.write_text(text, encoding="utf-8", newline="")
    layout = load_layout(path)
    assert [*zip(layout.x_mm, layout.y_mm, strict=True)] == [(-6, -6), (6, -6), (0, 6)]
    assert layout.pad_diameter_mm.tolist() == [4.0] * 3


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (json.dumps({"taxels": [t | {"gain": 2} for t in TAXELS]}), "'gain'"),
        (json.dumps({"taxels": TAXELS}).replace('"x_mm": 6.0', '"x_mm": 9, "x_mm": 6'), "two keys"),
        ("x_mm,y_mm\n-6,-6\n0,0.05\n6,6\n", "on one line"),
    ],
)
def test_files_that_contradict_themselves_are_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / ("wrong.json" if "{" in text else "wrong.csv")
    path.write_text(text)
    with pytest.raises(T2TwinError, match=said):
        load_layout(path)


def test_pads_that_overlap_are_named(tmp_path: Path) -> None:
    """Pads of 4 mm by default, which at 3.6 mm may be squares side by side."""
    (tmp_path / "wide.csv").write_text("x_mm,y_mm\n0,0\n3.6,0\n0,9\n")
    load_layout(tmp_path / "wide.csv")
    (tmp_path / "near.csv").write_text("x_mm,y_mm\n0,0\n2,0\n0,9\n")
    with pytest.warns(T2TwinWarning, match="taxels 0 and 1 of layout near overlap"):
        load_layout(tmp_path / "near.csv")
