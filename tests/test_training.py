"""Training: it learns, it resumes exactly, it stops, and it refuses what it cannot do."""

import json
import os
import socket
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from msgspec import structs
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from spots import stopped_after_an_epoch

from t2twin.core.errors import T2TwinError
from t2twin.translate.data.pairs import load_info, load_pairs
from t2twin.translate.models import distributed
from t2twin.translate.models.presets import PAPER_MODELS, PRESETS, Model
from t2twin.translate.runs.card import CARD
from t2twin.translate.runs.checkpoint import build, load_state, load_weights
from t2twin.translate.runs.config import RunConfig, load_config
from t2twin.translate.training import train as training
from t2twin.translate.training.train import Trainer, train

pytestmark = pytest.mark.usefixtures("one_thread")


def records(run_dir: Path) -> list[dict]:
    return [json.loads(line) for line in (run_dir / "log.jsonl").read_text().splitlines()]


def without_times(run_dir: Path) -> list[dict]:
    return [{k: v for k, v in record.items() if k != "seconds"} for record in records(run_dir)]


@pytest.mark.parametrize("model", PAPER_MODELS)
def test_stopped_and_resumed_is_as_undisturbed(data_dir, tmp_path, model, monkeypatch):
    """Killed in its second epoch's validation, it goes on from the last state within this epoch."""
    preset = replace(
        PRESETS[model]["smoke"], noise=0.05, brightness=0.05, contrast=0.1, weight_decay=0.05,
        averaged_part=0.25,
    )  # fmt: skip
    train(model, data_dir, preset, tmp_path / "whole", epochs=3)
    with monkeypatch.context() as patch, stopped_after_an_epoch():
        patch.setattr(training, "SAVE_SECONDS", 0.0)
        train(model, data_dir, preset, tmp_path / "killed", epochs=3)
    assert len(records(tmp_path / "killed")) == 1
    state = tmp_path / "killed" / "last.safetensors"
    part = load_state(state, build(load_config(tmp_path / "killed"))).part
    assert part.steps > 0
    outcome = train(model, data_dir, preset, tmp_path / "killed", epochs=3)
    assert outcome.epochs == 3
    assert without_times(tmp_path / "killed") == without_times(tmp_path / "whole")
    for name in ("last.safetensors", "best.safetensors"):
        whole, resumed = load_file(tmp_path / "whole" / name), load_file(tmp_path / "killed" / name)
        assert whole.keys() == resumed.keys()
        for key, tensor in whole.items():
            assert torch.equal(tensor, resumed[key]), key


@pytest.mark.parametrize("model", PAPER_MODELS)
def test_bf16_trains_float32_weights_that_are_validated_in_float32(
    data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, model: Model
) -> None:
    monkeypatch.setattr(training.checkpoint, "has_bf16", lambda: True)
    train(model, data_dir, replace(PRESETS[model]["smoke"], bf16=True), tmp_path, epochs=1)
    config, state = load_config(tmp_path), load_file(tmp_path / "last.safetensors")
    assert config.precision == "bf16" and "trained in bfloat16" in (tmp_path / CARD).read_text()
    assert {tensor.dtype for tensor in state.values()} == {torch.float32, torch.int64}
    pairs = load_pairs(data_dir, "val", config.preset.size, config.preset.grey)
    rmse = {}
    for bf16 in (True, False):
        translator = build(structs.replace(config, bf16=bf16))
        load_weights(tmp_path / "best.safetensors", translator.predictor)
        examples = translator.examples(pairs, np.arange(len(pairs)))
        errors = translator.predict(examples.images) - examples.targets
        rmse[bf16] = float(errors.square().mean().sqrt())
    [record] = records(tmp_path)
    assert record["val_rmse_counts"] == pytest.approx(rmse[False], rel=1e-6)
    assert record["val_rmse_counts"] != pytest.approx(rmse[True], rel=1e-6)


def test_a_finished_run_says_what_it_is_and_does_nothing_again(data_dir, tmp_path, capsys):
    first = train("resnet18", data_dir, "smoke", tmp_path, seed=3, epochs=2)
    config, log = load_config(tmp_path), records(tmp_path)
    assert config.preset == PRESETS["resnet18"]["smoke"]
    assert (config.seed, config.epochs, config.planned_epochs) == (3, 2, 2)
    assert config.data.sha256 == load_info(data_dir).sha256
    best = min(log, key=lambda record: record["val_rmse_counts"])
    assert (first.best_epoch, first.best_rmse_counts) == (best["epoch"], best["val_rmse_counts"])
    assert list((tmp_path / "tensorboard").iterdir()) and not list(tmp_path.glob(".*"))
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    capsys.readouterr()
    assert train("resnet18", data_dir, "smoke", tmp_path, seed=3, epochs=2) == first
    assert "is finished" in capsys.readouterr().out
    after = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert after == before
    card = (tmp_path / CARD).read_text()
    (tmp_path / CARD).unlink()  # as after a kill just before it is written
    train("resnet18", data_dir, "smoke", tmp_path, seed=3, epochs=2)
    assert (tmp_path / CARD).read_text() == card


def test_stops_early_and_keeps_the_best(data_dir, tmp_path, monkeypatch):
    """Validation is best in epoch 2, then never again: patience 2 ends it after epoch 4."""
    errors = iter([900.0, 500.0, 700.0, 600.0, 100.0])
    weights = []

    def validate(self: Trainer) -> float:
        weights.append(self.translator.predictor.state_dict()["fc.weight"].clone())
        return next(errors)

    monkeypatch.setattr(Trainer, "_validate", validate)
    preset = replace(PRESETS["resnet18"]["smoke"], patience=2)
    outcome = train("resnet18", data_dir, preset, tmp_path)
    assert (outcome.epochs, outcome.best_epoch, outcome.best_rmse_counts) == (4, 2, 500.0)
    assert "2 epochs brought no better" in outcome.stop_reason
    assert torch.equal(load_file(tmp_path / "best.safetensors")["fc.weight"], weights[1])


def test_minutes_bound_the_epochs(data_dir, tmp_path, monkeypatch):
    """Of a schedule over the epochs; a fixed rate is not planned, but stopped when time is over."""
    monkeypatch.setattr(Trainer, "_measure", lambda self: 20.0)
    smoke = PRESETS["resnet18"]["smoke"]
    falling = replace(smoke, schedule="cosine")
    train("resnet18", data_dir, falling, tmp_path / "cosine", minutes=1.1)
    assert load_config(tmp_path / "cosine").planned_epochs == 3
    assert len(records(tmp_path / "cosine")) == 3
    outcome = train("resnet18", data_dir, smoke, tmp_path / "fixed", minutes=1e-6)
    assert load_config(tmp_path / "fixed").planned_epochs == smoke.epochs
    assert outcome.epochs == 1 and "minutes are over" in outcome.stop_reason


@pytest.mark.exhaustive
def test_two_processes_share_one_training(data_dir: Path, tmp_path: Path) -> None:
    """Started as torchrun starts them, over gloo: it learns, and one of them keeps the log."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [
        sys.executable, "-m", "t2twin.translate.training.train", "resnet18", str(data_dir), "smoke",
    ]  # fmt: skip
    shared = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "WORLD_SIZE": "2"}
    processes = [
        subprocess.Popen(
            [*command, str(tmp_path)],
            cwd=Path(training.__file__).parents[1],
            env=os.environ
            | shared
            | {"LOCAL_WORLD_SIZE": "2", "RANK": str(rank), "LOCAL_RANK": str(rank)},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        for rank in range(2)
    ]
    said = [process.communicate(timeout=180)[0] for process in processes]
    assert [process.returncode for process in processes] == [0, 0], said
    assert "2 processes of" in said[0]
    assert "step" not in said[1]
    assert load_config(tmp_path).processes == 2
    log = records(tmp_path)
    assert [record["epoch"] for record in log] == list(range(1, len(log) + 1))
    assert log[-1]["train"]["l3"] < log[0]["train"]["l3"] / 2


def test_each_process_takes_its_own_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """By its number on its machine, in turn where GPUs are fewer; without a GPU, the CPU."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    for gpus, devices in ((2, ["cuda:0", "cuda:1", "cuda:0", "cuda:1"]), (0, ["cpu"] * 4)):
        monkeypatch.setattr(torch.cuda, "device_count", lambda gpus=gpus: gpus)
        for rank, expected in enumerate(devices):
            monkeypatch.setenv("LOCAL_RANK", str(rank))
            assert str(distributed.device()) == expected


@pytest.mark.parametrize("model", PAPER_MODELS)
def test_weights_follow_the_seed_and_leave_torchs_numbers_alone(data_dir, model):
    preset, info = PRESETS[model]["smoke"], load_info(data_dir)
    before, seed = torch.get_rng_state(), torch.initial_seed()
    first, again, other = (
        build(RunConfig(model, preset, number, info, None, None, 1, False, 1)).predictor
        for number in (7, 7, 8)
    )
    assert torch.equal(torch.get_rng_state(), before) and torch.initial_seed() == seed
    for one, same, another in zip(
        first.parameters(), again.parameters(), other.parameters(), strict=True
    ):
        assert torch.equal(one, same)
        assert one.dim() == 1 or not torch.equal(one, another)


def test_another_run_in_the_folder_is_refused(data_dir: Path, tmp_path: Path) -> None:
    asked: dict = {"model": "resnet18", "preset": "smoke", "epochs": 1}
    train(data_dir=data_dir, out_dir=tmp_path, **asked)
    cases: list[tuple[dict, str]] = [
        ({"seed": 1}, "another seed"),
        ({"epochs": 2}, "another number of epochs"),
        ({"minutes": 5.0}, "another limit in minutes"),
        ({"model": "touch2touch"}, "another model"),
        ({"preset": replace(PRESETS["resnet18"]["smoke"], batch=4)}, "another preset"),
    ]
    for change, says in cases:
        with pytest.raises(T2TwinError, match=says):
            train(data_dir=data_dir, out_dir=tmp_path, **(asked | change))


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"model": "unet"}, "touch2touch, resnet18"),
        ({"preset": "huge"}, "paper, cpu, smoke"),
        ({"epochs": 1_000_001}, "epochs is"),
        ({"steps": 0}, "steps is"),
        ({"epochs": 2, "steps": 9}, "epochs and steps are both given"),
        ({"minutes": 0}, "more than 0"),
        ({"data_dir": Path("nowhere")}, "no dataset"),
    ],
)
def test_bad_asking_is_refused(data_dir: Path, tmp_path: Path, asked: dict, says: str) -> None:
    usual = {"model": "resnet18", "data_dir": data_dir, "preset": "smoke", "out_dir": tmp_path}
    with pytest.raises(T2TwinError, match=says):
        train(**(usual | asked))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("lay", [Path.mkdir, lambda path: None])
def test_a_run_without_its_state_is_refused(lay, data_dir: Path, tmp_path: Path) -> None:
    train("resnet18", data_dir, "smoke", tmp_path, epochs=1)
    (tmp_path / "last.safetensors").unlink()
    lay(tmp_path / "last.safetensors")
    before = (tmp_path / "best.safetensors").read_bytes()
    with pytest.raises(T2TwinError, match="is missing or no file"):
        train("resnet18", data_dir, "smoke", tmp_path, epochs=1)
    assert (tmp_path / "best.safetensors").read_bytes() == before


def test_damaged_state_is_refused(data_dir: Path, tmp_path: Path) -> None:
    train("resnet18", data_dir, "smoke", tmp_path, epochs=1)
    last = tmp_path / "last.safetensors"
    with safe_open(last, "pt") as file:
        save_file(load_file(tmp_path / "best.safetensors"), last, file.metadata())
    with pytest.raises(T2TwinError, match="not a saved state of these networks"):
        load_state(last, build(load_config(tmp_path)))
    last.write_bytes(b"not a checkpoint")
    with pytest.raises(T2TwinError, match="not a saved state of a training"):
        train("resnet18", data_dir, "smoke", tmp_path, epochs=1)
