"""Pairs as the networks take them: decoded once, kept together, jittered without being moved."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from spots import write_spots

from t2twin.translate.data.images import augment
from t2twin.translate.data.pairs import load_pairs
from t2twin.translate.models.presets import PRESETS


def test_cache_is_made_once_and_follows_the_data(data_dir: Path, tmp_path: Path) -> None:
    folder = tmp_path / "copy"
    shutil.copytree(data_dir, folder, ignore=shutil.ignore_patterns("cache"))
    pairs = load_pairs(folder, "val", 16, grey=False)
    assert pairs.images[:2].shape == (2, 16, 16, 3)
    [cache] = (folder / "cache").iterdir()
    made = cache.stat().st_mtime_ns
    load_pairs(folder, "val", 16, grey=False)
    assert cache.stat().st_mtime_ns == made
    write_spots(folder, seed=5)
    other = load_pairs(folder, "val", 16, grey=False)
    assert len(list((folder / "cache").iterdir())) == 2
    assert not np.array_equal(other.images[:], pairs.images[:])


def test_pairs_stay_paired(data_dir: Path) -> None:
    """The brightest pixel of a decoded image lies where its row says that it was pressed."""
    pairs = load_pairs(data_dir, "train", 64, grey=True)
    images = pairs.images[:][..., 0]
    assert len(images) == len(pairs) == 32
    for image, x_mm, y_mm in zip(images, pairs.x_mm, pairs.y_mm, strict=True):
        row, column = np.unravel_index(image.argmax(), image.shape)
        assert abs((column + 0.5) * 240 / 64 / 8 - 15 - x_mm) < 1.0
        assert abs((row + 0.5) * 320 / 64 / 8 - 20 - y_mm) < 1.0


def test_augmentation_is_mild_seeded_and_keeps_the_geometry(data_dir: Path) -> None:
    pixels = load_pairs(data_dir, "train", 32, grey=True).images[:8]
    pixels = torch.from_numpy(pixels).float() / 255.0
    preset = PRESETS["touch2touch"]["cpu"]
    amounts = (preset.brightness, preset.contrast, preset.noise)
    once = augment(pixels, np.random.default_rng(0), *amounts)
    assert torch.equal(once, augment(pixels, np.random.default_rng(0), *amounts))
    assert 0.0 < (once - pixels).abs().mean() < 0.1
    for before, after in zip(pixels, once, strict=True):
        assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.95
    assert torch.allclose(augment(pixels, np.random.default_rng(0), 0.0, 0.0, 0.0), pixels)


def test_drift_changes_the_level_and_gradient_of_the_background_frame_only() -> None:
    pixels = torch.full((500, 9, 9, 6), 0.5)
    drifted = augment(pixels, np.random.default_rng(0), 0.0, 0.0, 0.0, 0.02)
    assert torch.equal(drifted[..., :3], pixels[..., :3])
    change = (drifted[..., 3:] / 0.5 - 1.0).numpy()
    assert change[:, 4, 4].std() == pytest.approx(0.02, rel=0.1)
    for gradient in (change[:, 8, 4] - change[:, 0, 4], change[:, 4, 8] - change[:, 4, 0]):
        assert gradient.std() == pytest.approx(0.02, rel=0.1)
    without_frame = augment(pixels[..., :3], np.random.default_rng(0), 0.0, 0.0, 0.0, 0.02)
    assert torch.equal(without_frame, pixels[..., :3])
