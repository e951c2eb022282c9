"""The running mean of a network's weights, and how translators use it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from kinds import gel_camera, taxel_array
from torch import nn

from t2twin.sim.dataset.generate import sensor_info
from t2twin.translate.data.pairs import DataInfo, Examples
from t2twin.translate.models.base import weight_average
from t2twin.translate.models.presets import PAPER_MODELS, PRESETS, Model
from t2twin.translate.runs.checkpoint import TRANSLATORS


def mean_of(part: float, values: list[float]) -> float:
    """The mean of a one-weight network that has had these weights."""
    network = nn.Linear(1, 1, bias=False)
    mean = weight_average(network, part)
    assert mean is not None
    for value in values:
        nn.init.constant_(network.weight, value)
        mean.update_parameters(network)
    (weight,) = mean.module.parameters()
    return float(weight.detach())


@pytest.mark.parametrize("part", [0.1, 0.5])
def test_steps_weigh_by_a_power_of_their_number(part: float) -> None:
    """After a jump half-way the mean lacks (1/2)^(1/part) of it."""
    found = mean_of(part, [0.0] * 500 + [1.0] * 500)
    assert found == pytest.approx(1 - 0.5 ** (1 / part), abs=2e-3)
    assert weight_average(nn.Linear(1, 1), 0.0) is None


def test_batch_norms_statistics_are_means_too() -> None:
    network = nn.BatchNorm1d(1)
    mean = weight_average(network, 1.0)
    assert mean is not None
    for value in (1.0, 3.0):
        network.running_mean = torch.tensor([value])
        network.num_batches_tracked = torch.tensor(int(value))
        mean.update_parameters(network)
    statistics = dict(mean.module.named_buffers())
    assert statistics["running_mean"].item() == pytest.approx(2.0)
    assert statistics["num_batches_tracked"].item() == 3


@pytest.mark.parametrize("model", PAPER_MODELS)
def test_a_translator_predicts_with_the_mean(model: Model) -> None:
    info = DataInfo("0" * 64, sensor_info(gel_camera()), sensor_info(taxel_array()))
    preset = replace(PRESETS[model]["smoke"], averaged_part=1.0)
    torch.manual_seed(0)
    translator = TRANSLATORS["counts"][model](preset, info, torch.device("cpu"), False)
    channels = 1 if preset.grey else 3
    images = torch.rand(8, channels, preset.size, preset.size)
    counts = torch.from_numpy(np.random.default_rng(0).uniform(0, 4e4, (8, 20)).astype(np.float32))
    weights = []
    for _ in range(3):
        translator.step(Examples(images, counts))
        (trained,) = (
            network for name, network in translator.networks.items() if name != "discriminator"
        )
        weights.append([p.detach().clone() for p in trained.parameters()])
    for number, kept in enumerate(translator.predictor.parameters()):
        assert not kept.requires_grad
        expected = torch.stack([step[number] for step in weights]).mean(dim=0)
        torch.testing.assert_close(kept, expected, rtol=1e-4, atol=1e-6)
    assert trained is not translator.predictor
