"""Batches of training pairs: those kept on a device are those that are read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from t2twin.translate.data.pairs import load_info, load_pairs
from t2twin.translate.models.presets import PRESETS, Model
from t2twin.translate.runs.checkpoint import TRANSLATORS

CPU = torch.device("cpu")


def test_a_batch_is_the_stored_pairs_as_the_networks_take_them(moving_dataset, tmp_path) -> None:
    preset = PRESETS["field"]["smoke"]
    pairs = load_pairs(moving_dataset, "train", preset.size, False, tmp_path, True)
    translator = TRANSLATORS["counts"]["field"](preset, load_info(moving_dataset), CPU, False)
    found = translator.examples(pairs, np.array([5, 1]))
    mean, std = np.array([0.485, 0.456, 0.406] * 2), np.array([0.229, 0.224, 0.225] * 2)
    expected = (pairs.inputs[np.array([1, 5])] / 255.0 - mean) / std
    np.testing.assert_allclose(found.images.permute(0, 2, 3, 1), expected, atol=1e-5)
    np.testing.assert_array_equal(found.targets, pairs.counts[[1, 5]])
    assert found.dense_counts is not None and pairs.dense_counts is not None
    np.testing.assert_array_equal(found.dense_counts, pairs.dense_counts[[1, 5]])


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
@pytest.mark.parametrize("model", ["touch2touch", "resnet18"])
def test_a_step_on_a_gpu_is_that_on_a_cpu(data_dir: Path, tmp_path: Path, model: Model) -> None:
    """Within the rounding of the convolutions; dropout of touch2touch differs."""
    preset = replace(PRESETS[model]["smoke"], noise=0.0, brightness=0.02, contrast=0.05)
    info = load_info(data_dir)
    pairs = load_pairs(data_dir, "train", preset.size, preset.grey, tmp_path)
    losses = []
    for name in ("cpu", "cuda"):
        device = torch.device(name)
        torch.manual_seed(0)
        translator = TRANSLATORS["counts"][model](preset, info, device, bf16=False)
        examples = translator.examples(pairs, np.arange(8), np.random.default_rng(0))
        assert examples.images.device.type == name
        losses.append({key: float(loss) for key, loss in translator.step(examples).items()})
    assert losses[0] == pytest.approx(losses[1], rel=0.2 if model == "touch2touch" else 2e-3)
