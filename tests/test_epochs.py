"""Epochs of trainings on many pairs: shorter than the data, and as good to go on from."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from t2twin.core.errors import T2TwinError
from t2twin.translate.data.pairs import load_info, load_pairs
from t2twin.translate.models.presets import PAPER_MODELS, PRESETS
from t2twin.translate.runs.config import EpochRecord, RunConfig, load_config, read_log
from t2twin.translate.training.train import Trainer, for_steps, steps_of_epoch, train

pytestmark = pytest.mark.usefixtures("one_thread")


def without_times(run_dir: Path) -> list[tuple]:
    return [(r.epoch, r.learning_rate, r.train, r.val_rmse_counts) for r in read_log(run_dir)]


@pytest.mark.parametrize(
    ("batches", "budget", "steps"),
    [
        (441, 5300, 441),  # the paper's dataset
        (3125, 5300, 441),  # 100,000 pairs
        (3125, 10_500, 875),
        (3125, 0, 3125),  # no bound: all of the data
        (3125, 9, 100),
        (38, 9, 38),
    ],
)
def test_an_epoch_is_all_of_the_data_or_a_twelfth_of_the_steps(batches, budget, steps) -> None:
    assert steps_of_epoch(batches, budget) == steps


def test_short_epochs_go_through_all_pairs_before_any_comes_again(data_dir: Path) -> None:
    """Three steps of four an epoch: four epochs are three passes in the order of their numbers."""
    preset, info = PRESETS["resnet18"]["smoke"], load_info(data_dir)
    pairs = load_pairs(data_dir, "train", preset.size, preset.grey)
    config = RunConfig("resnet18", preset, 5, info, None, None, 1, False, 1)
    loop = Trainer(config, data_dir, pairs, pairs, 0)
    whole = [np.concatenate(list(loop._batches(epoch))) for epoch in range(3)]
    for epoch, order in enumerate(whole):
        assert np.array_equal(order, np.random.default_rng([5, epoch]).permutation(32))
    loop.steps = 3
    short = [np.concatenate(list(loop._batches(epoch))) for epoch in range(4)]
    assert [order.size for order in short] == [24] * 4
    assert np.array_equal(np.concatenate(short), np.concatenate(whole))


def test_in_more_steps_the_discriminator_learns_as_much_in_all() -> None:
    cpu, resnet18 = (PRESETS[model]["cpu"] for model in PAPER_MODELS)
    longer = for_steps(cpu, 3 * cpu.steps)
    assert longer.discriminator_share == pytest.approx(cpu.discriminator_share / 3)
    assert replace(longer, discriminator_share=cpu.discriminator_share) == cpu
    assert for_steps(cpu, None) == for_steps(cpu, 100) == for_steps(cpu, cpu.steps) == cpu
    assert for_steps(resnet18, 3 * resnet18.steps) == resnet18


def test_steps_asked_for_go_into_the_config_and_bound_the_epochs(data_dir, tmp_path, monkeypatch):
    """Short epochs resume as whole ones do, at the length that the run began with."""
    monkeypatch.setattr("t2twin.translate.training.train.MIN_STEPS", 2)
    monkeypatch.setattr("t2twin.translate.training.train.MIN_EPOCHS", 4)
    train("resnet18", data_dir, "smoke", tmp_path / "whole", steps=8)
    config = load_config(tmp_path / "whole")
    assert (config.steps, config.epoch_steps, config.planned_epochs) == (8, 2, 4)
    assert config.data.recipe == "smoke" and config.data.train_pairs == 32

    epoch = Trainer._epoch

    def killed(self: Trainer, number: int, bar: object) -> EpochRecord:
        if number == 2:
            raise KeyboardInterrupt
        return epoch(self, number, bar)  # pyright: ignore[reportArgumentType]

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "_epoch", killed)
        with pytest.raises(KeyboardInterrupt):
            train("resnet18", data_dir, "smoke", tmp_path / "killed", steps=8)
    monkeypatch.setattr("t2twin.translate.training.train.MIN_STEPS", 100)
    train("resnet18", data_dir, "smoke", tmp_path / "killed", steps=8)
    assert without_times(tmp_path / "killed") == without_times(tmp_path / "whole")
    whole, resumed = (load_file(tmp_path / run / "last.safetensors") for run in ("whole", "killed"))
    assert all(torch.equal(tensor, resumed[key]) for key, tensor in whole.items())
    with pytest.raises(T2TwinError, match="another number of steps"):
        train("resnet18", data_dir, "smoke", tmp_path / "whole", steps=9)
