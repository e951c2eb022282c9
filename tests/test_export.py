"""The ONNX file gives the run's counts, for any batch, and says what it is; the model card too."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from spots import write_spots

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.translate.inference.load import export_onnx, load_run
from t2twin.translate.models.presets import PRESETS
from t2twin.translate.runs.card import write_card
from t2twin.translate.runs.config import load_config
from t2twin.translate.training.train import train

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*unlike all training images:t2twin.core.errors.T2TwinWarning"
)

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")


@pytest.fixture(scope="module")
def session(run_dir: Path, tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("onnx") / "run.onnx"
    assert export_onnx(load_run(run_dir), path) < 1.0
    assert [file.name for file in path.parent.iterdir()] == ["run.onnx"]
    return onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])


@pytest.mark.parametrize("size", [1, 5])
def test_counts_and_tactile_images_are_the_runs(run_dir: Path, session, size: int) -> None:
    """From a user's side: frames resized with PIL, float32 in [0, 1], channels first."""
    run = load_run(run_dir)
    side, grey = run.config.preset.size, run.config.preset.grey
    frames = np.random.default_rng(1).integers(0, 256, (size, 320, 240, 3), dtype=np.uint8)
    images = np.empty((size, 1 if grey else 3, side, side), np.float32)
    for image, frame in zip(images, frames, strict=True):
        picture = Image.fromarray(frame).convert("L" if grey else "RGB")
        pixels = np.asarray(picture.resize((side, side), Image.Resampling.BILINEAR))
        image[:] = (pixels[None] if grey else pixels.transpose(2, 0, 1)) / 255.0
    counts, tactile = session.run(None, {"images": images})
    assert counts.shape == (size, 20) and tactile.shape == (size, 396, 240)
    expected = run.predict(frames)
    assert expected.std() > 100
    np.testing.assert_allclose(counts, expected, atol=1.0)
    np.testing.assert_allclose(tactile, run.tactile_images(frames), atol=1.0)


def test_file_says_what_it_is(run_dir: Path, session) -> None:
    config = load_config(run_dir)
    said = session.get_modelmeta().custom_metadata_map
    expected = {
        "model": run_dir.name, "preset": "smoke", "layout": "cyskin-20",
        "full_scale_counts": "40000", "size": str(config.preset.size),
        "color": "grey" if run_dir.name == "touch2touch" else "rgb",
    }  # fmt: skip
    assert expected.items() <= said.items()
    assert json.loads(said["layout_x_mm"]) == config.data.array.x_mm.tolist()
    assert session.get_inputs()[0].shape[0] == "batch"
    assert "[0, 1]" in session.get_modelmeta().description


def test_command_writes_into_the_runs_folder(run_dir: Path, capsys) -> None:
    main(["export", "--run", str(run_dir)])
    path = run_dir / f"{run_dir.name}.onnx"
    onnx.checker.check_model(path, full_check=True)
    assert f"written to {path}" in capsys.readouterr().out


def test_missing_package_run_and_suffix_get_a_sentence(run_dir, tmp_path, monkeypatch) -> None:
    with pytest.raises(T2TwinError, match=r"q\.json is no name of an ONNX file; expected"):
        export_onnx(load_run(run_dir), tmp_path / "q.json")
    with pytest.raises(T2TwinError, match="has no config"):
        load_run(tmp_path)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(T2TwinError, match="t2twin\\[onnx\\]"):
        export_onnx(load_run(run_dir), tmp_path / "run.onnx")
    assert not list(tmp_path.iterdir())


def test_card_says_what_the_run_is(run_dir: Path, data_dir: Path) -> None:
    write_card(run_dir, data_dir)
    _, head, text = (run_dir / "README.md").read_text().split("---\n", 2)
    best = min(
        map(json.loads, (run_dir / "log.jsonl").read_text().splitlines()),
        key=lambda record: record["val_rmse_counts"],
    )
    about = yaml.safe_load(head)
    assert about["license"] == "mit"
    assert run_dir.name in about["tags"]
    [result] = about["model-index"][0]["results"]
    assert result["metrics"][0]["value"] == pytest.approx(best["val_rmse_counts"], abs=0.1)
    config = load_config(run_dir)
    for words in (
        config.data.sha256, "32 train, 12 val, 8 test", f"epoch {best['epoch']} of 3",
        "| made by | the paper's protocol, scale smoke |",
        f"| learning_rate | {PRESETS[run_dir.name]['smoke'].learning_rate:g} |",  # pyright: ignore[reportArgumentType]
        "arXiv:2411.02187", "## Limits",
    ):  # fmt: skip
        assert words in text, words


def test_card_of_pairs_brought_in_gives_no_license_away(data_dir: Path, tmp_path: Path) -> None:
    folder = write_spots(tmp_path / "data")
    info = json.loads((folder / "info.json").read_text())
    del info["scale"], info["recipe"]
    (folder / "info.json").write_text(json.dumps(info))
    train("resnet18", folder, "smoke", tmp_path / "run", epochs=1)
    write_card(tmp_path / "run", folder)
    text = (tmp_path / "run" / "README.md").read_text()
    assert yaml.safe_load(text.split("---\n")[1])["license"] == "unknown"
    assert "simulat" not in text
    with pytest.raises(T2TwinError, match="is not the dataset"):
        write_card(tmp_path / "run", data_dir)


SETTINGS = ("OMP_WAIT_POLICY", "ORT_DISABLE_TELEMETRY", "TORCHINDUCTOR_CACHE_DIR")

SESSION = f"""
import os, sys, t2twin
print([name in os.environ for name in {SETTINGS}], "torch" in sys.modules)
t2twin.load("field", engine="torch")
print([name in os.environ for name in {SETTINGS}], "torch._dynamo" in sys.modules)
import onnx, onnxruntime
from onnx import TensorProto as T, helper as h
a, b = (h.make_tensor_value_info(n, T.FLOAT, [1]) for n in "ab")
graph = h.make_graph([h.make_node("Identity", ["a"], ["b"])], "g", [a], [b])
model = h.make_model(graph, opset_imports=[h.make_opsetid("", 17)], ir_version=9)
onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
"""


def test_library_settings_are_set_where_the_libraries_are_used(tmp_path: Path) -> None:
    """Left alone ONNX Runtime keeps a device's id in the user's cache, to send with its reports.
    And a run is loaded without torch's compiler, which takes as long to import as torch."""
    environment = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    home = {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / ".cache")}
    done = subprocess.run(
        [sys.executable, "-c", SESSION], check=True, env=environment | home,
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout.splitlines() == ["[False, False, False] False", "[True, True, True] False"]
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
