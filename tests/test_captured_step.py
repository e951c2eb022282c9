"""A replayed step on a GPU equals the step that was captured."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from t2twin.sim.taxels.layout import load_layout
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.data.sides import ArraySide, CameraSide
from t2twin.translate.models.base import Translator
from t2twin.translate.models.presets import PRESETS, Model
from t2twin.translate.runs.checkpoint import TRANSLATORS
from t2twin.translate.training.captured_step import EAGER_STEPS, CapturedStep

STEPS = EAGER_STEPS + 5


def on_gpu(model: Model) -> Translator:
    layout = load_layout("cyskin-20")
    info = DataInfo(
        "0" * 64, CameraSide(), ArraySide(layout.name, layout.x_mm, layout.y_mm, 40_000.0)
    )
    preset = replace(PRESETS[model]["smoke"], averaged_part=0.5, learning_rate=1e-4)
    torch.manual_seed(0)
    return TRANSLATORS["counts"][model](preset, info, torch.device("cuda"), False)


def batches(translator: Translator, size: int, channels: int) -> list[Examples]:
    """Dark images of no counts, and others, by turns; losses of the two differ by far."""
    rng, found = np.random.default_rng(0), []
    for step in range(STEPS):
        images = rng.random((8, size, size, channels), np.float32) * (step % 2)
        counts = rng.uniform(0, 4e4, (8, 20)).astype(np.float32) * (step % 2)
        inputs = translator.to_input(torch.from_numpy(images).cuda())
        found.append(Examples(inputs, torch.from_numpy(counts).cuda()))
    return found


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
@pytest.mark.parametrize("model", ["touch2touch", "resnet18"])
def test_replayed_steps_are_those_taken_one_by_one(model: Model) -> None:
    """With another learning rate and other dropout in every step, and the weight average."""
    preset = PRESETS[model]["smoke"]
    losses: list[list[list[float]]] = []
    weights: list[torch.Tensor] = []
    before: list[torch.Tensor] = []
    for is_replayed in (False, True):
        translator = on_gpu(model)
        step = CapturedStep(translator) if is_replayed else translator.step
        losses.append([])
        for number, batch in enumerate(batches(translator, preset.size, 1 if preset.grey else 3)):
            translator.set_rates(0.0 if number == STEPS - 2 else 1.0 / (1 + number))
            torch.manual_seed(number)
            before = [each.clone() for each in translator.predictor.parameters()]
            found = step(batch)
            losses[-1].append([float(each) for each in found.values()])
        assert any(not torch.equal(*each) for each in zip(
            before, translator.predictor.parameters(), strict=True
        ))  # fmt: skip
        weights.append(torch.cat([each.flatten() for each in translator.predictor.parameters()]))
    np.testing.assert_allclose(losses[0], losses[1], rtol=0.02, atol=1e-4)
    moved = float((weights[0] - weights[1]).norm() / weights[0].norm())
    assert moved < 1e-3
