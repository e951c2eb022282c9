"""The published networks at their size: two steps, and the same two steps with a stop between."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from spots import write_spots

from t2twin.translate.models.presets import PRESETS, Model
from t2twin.translate.runs.config import load_config
from t2twin.translate.runs.log import EpochRecord, read_log
from t2twin.translate.training import train as training
from t2twin.translate.training.train import train
from t2twin.translate.training.trainer import Trainer


@pytest.mark.parametrize("model", ["touch2touch", "resnet18"])
def test_published_size_resumes_to_the_last_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: Model
) -> None:
    data = write_spots(tmp_path / "data", train=2, val=1, test=0)
    preset = replace(PRESETS[model]["paper"], batch=2)  # all pairs: an epoch is one step
    monkeypatch.setattr(training, "MIN_PAIRS", 2)
    monkeypatch.setattr(Trainer, "_measure", lambda self: 1.0)
    train(model, data, preset, tmp_path / "whole", epochs=2)

    epoch = Trainer._epoch

    def stopped(self: Trainer, number: int, bar: object) -> EpochRecord:
        if number == 1:
            raise KeyboardInterrupt
        return epoch(self, number, bar)  # pyright: ignore[reportArgumentType]

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "_epoch", stopped)
        with pytest.raises(KeyboardInterrupt):
            train(model, data, preset, tmp_path / "stopped", epochs=2)
    assert len(read_log(tmp_path / "stopped")) == 1
    train(model, data, preset, tmp_path / "stopped", epochs=2)

    for name in ("last.safetensors", "best.safetensors"):
        with (
            safe_open(tmp_path / "whole" / name, "pt") as whole,
            safe_open(tmp_path / "stopped" / name, "pt") as resumed,
        ):
            assert set(whole.keys()) == set(resumed.keys())
            for key in whole.keys():  # noqa: SIM118, not a dictionary
                assert torch.equal(whole.get_tensor(key), resumed.get_tensor(key)), key
    precision = load_config(tmp_path / "whole").precision
    assert f"| precision | {precision} |" in (tmp_path / "whole" / "README.md").read_text()
