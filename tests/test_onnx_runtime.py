"""ONNX Runtime in PyTorch's place: the same counts, its file kept, and made anew where it must."""

from pathlib import Path

import numpy as np
import pytest

from t2twin.core.cache_dir import VARIABLE
from t2twin.sim.taxels.layout import Layout
from t2twin.translate.inference import load as load_runs
from t2twin.translate.inference.load import load

pytestmark = pytest.mark.filterwarnings(
    "ignore:.*unlike all training images:t2twin.core.errors.T2TwinWarning"
)

pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the files are kept, empty."""
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    return tmp_path / load_runs.FOLDER


@pytest.fixture
def frames() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (3, 320, 240, 3), dtype=np.uint8)


def test_counts_are_those_of_pytorch(run_dir: Path, kept: Path, frames: np.ndarray) -> None:
    fast, plain = load(run_dir), load(run_dir, engine="torch")
    assert fast.engine is not None and plain.engine is None
    assert not kept.exists()  # made when it is first used
    counts = fast.predict(frames)
    assert counts.dtype == np.float32 and counts.std() > 100
    np.testing.assert_allclose(counts, plain.predict(frames), atol=1.0)
    np.testing.assert_array_equal(fast.predict(frames[1]).shape, (20,))
    assert len(list(kept.iterdir())) == 1
    assert fast._in_float32().engine is None


def test_a_kept_file_is_taken_again_and_the_oldest_go(
    runs: list[Path], kept: Path, frames: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(load_runs, "MAX_FILES", 1)
    kept.mkdir()
    (kept / "older.onnx").write_bytes(b"")
    first = load(runs[1]).predict(frames)
    (file,) = kept.iterdir()
    assert file.name != "older.onnx"
    monkeypatch.setattr(load_runs, "_export", None)
    np.testing.assert_array_equal(load(runs[1]).predict(frames), first)


def test_another_layout_has_its_own_file(kept: Path, frames: np.ndarray) -> None:
    """Of the field that ships, whose estimates are the same too, with background frames and not."""
    fast, plain = load("field", "cyskin-63"), load("field", "cyskin-63", engine="torch")
    for background in (None, frames[0]):
        one, other = fast.estimate(frames, background), plain.estimate(frames, background)
        assert one.counts.shape == (3, 63) and one.dense_counts.shape == (3, 216)
        assert one.force_n is not None and other.force_n is not None
        for name in ("counts", "counts_std", "dense_counts", "dense_counts_std"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1.0)
        np.testing.assert_allclose(one.force_n, other.force_n, rtol=1e-4, atol=1e-6)
    taxels = fast.config.data.array.taxels
    five = Layout("five", taxels.x_mm[:5], taxels.y_mm[:5], taxels.pad_diameter_mm[:5])
    own = fast._at_layout(five)
    assert own.predict(frames).shape == (3, 5) and len(list(kept.iterdir())) == 2
    pixels = fast.pixels_of(frames, frames[0])
    pixels[1, :, :, 3:] = 0  # another frame than the others'
    np.testing.assert_array_equal(fast._predict_pixels(pixels), plain._predict_pixels(pixels))
