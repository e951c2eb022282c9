"""t2twin demo: its plan within a limit, the commands that it prints, and how it continues."""

import functools
import re
import shlex
from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from t2twin import cli
from t2twin.cli import demo
from t2twin.core.files import write_json
from t2twin.primitives_cad import contact_sheet, export
from t2twin.sim.dataset.store import INFO, sha256_of
from t2twin.translate.evaluation import files
from t2twin.translate.runs import checkpoint
from t2twin.translate.runs.config import BEST, LAST, load_config
from t2twin.translate.runs.log import EpochRecord
from t2twin.translate.training import train

SPEEDS = (0.2, 1.0, 3.0, 10.0)


@pytest.mark.parametrize("slowness", SPEEDS)
@pytest.mark.parametrize("scale", demo.REPORT_S)
@pytest.mark.parametrize("left_s", [-20.0, 30.0, 120.0, 500.0])
@pytest.mark.parametrize("trainings", [1, 2])
def test_trainings_leave_the_time_of_the_report(slowness, scale, left_s, trainings):
    minutes = demo.training_minutes(left_s, slowness, scale, trainings)
    assert demo.MIN_TRAINING_MINUTES <= minutes <= demo.TRAINING_MINUTES
    others_s = slowness * (demo.REPORT_S[scale] + trainings * demo.TRAINING_S)
    fits = trainings * 60 * minutes + others_s <= left_s + 1e-9
    assert fits or minutes == demo.MIN_TRAINING_MINUTES


def test_the_dataset_is_smaller_on_a_slower_machine():
    scales = [demo.scale_that_fits(120.0, slowness, 2) for slowness in SPEEDS]
    assert scales == sorted(scales, key=list(demo.REPORT_S).index)
    assert set(scales) == {"small", "smoke"}


@pytest.fixture
def steps(monkeypatch):
    """Replaces every step by one that only records its call; the machine is of the reference."""
    calls = []

    def record(name):
        return lambda *arguments, **options: calls.append((name, arguments, options))

    monkeypatch.setattr(export, "export_shapes", record("primitives"))
    monkeypatch.setattr(contact_sheet, "draw_sheet", record("sheet"))
    for name in ("simdata", "evaluate", "report"):
        module = cli.dataset if name == "simdata" else cli.evaluate
        monkeypatch.setattr(module, name, record(name))
    monkeypatch.setattr(train, "train", record("train"))
    monkeypatch.setattr(demo, "is_evaluated", lambda *_: False)
    monkeypatch.setattr(demo, "slowness", lambda: 1.0)
    return calls


@pytest.mark.parametrize("options, trainings", [((), [1.1, 1.1]), (("--minutes", "2"), [0.7, 1.1])])
def test_the_printed_commands_are_valid(options, trainings, steps, capsys, monkeypatch):
    real = dict(cli.COMMANDS)
    cli.main(["demo", "--out", "my demo", *options])
    assert [name for name, *_ in steps] == [
        "primitives", "sheet", "simdata", "train", "train", "evaluate", "report"
    ]  # fmt: skip
    minutes = [options["minutes"] for name, _, options in steps if name == "train"]
    assert minutes == pytest.approx(trainings, abs=0.1)
    lines = re.findall(r"(?m)^step \d of 6: t2twin (.*)$", capsys.readouterr().out)
    parsed = []
    stubs = {
        name: functools.wraps(command)(lambda *_, name=name, **__: parsed.append(name))
        for name, command in real.items()
    }
    monkeypatch.setattr(cli, "COMMANDS", stubs)
    for line in lines:
        cli.main(shlex.split(line))
    assert parsed == ["primitives", "simdata", "train", "train", "evaluate", "report"]


@pytest.mark.parametrize("minutes", ["0.5", "-1", "nan", "inf"])
def test_a_limit_out_of_range_is_refused(minutes, steps, capsys):
    with pytest.raises(SystemExit):
        cli.main(["demo", "--minutes", minutes])
    assert "minutes is" in capsys.readouterr().err and not steps


def test_a_demo_over_its_limit_is_reported(steps, capsys, monkeypatch):
    monkeypatch.setattr(demo.Clock, "elapsed_s", 200.0)
    cli.main(["demo", "--minutes", "3"])
    assert "too slow for a demo of 3 minutes" in capsys.readouterr().out
    names = [name for name, *_ in steps]
    assert "sheet" not in names and "report" in names


@pytest.fixture
def stopped(untrained_runs, tmp_path, monkeypatch):
    """A demo in its first training of 1.1 minutes; makes the run with a number of epochs of half a
    minute."""
    monkeypatch.setattr(demo, "is_complete", lambda folder: folder.name == "small")

    def make(epochs):
        run = tmp_path / "runs" / "small" / "touch2touch"
        run.mkdir(parents=True)
        replace(load_config(untrained_runs[0]), minutes=1.1, planned_epochs=9).save(run)
        history = [EpochRecord(n + 1, 1e-3, {}, 900.0, 2.0, 30.0) for n in range(epochs)]
        monkeypatch.setattr(checkpoint, "load_history", lambda _: history)
        if epochs:
            (run / LAST).touch()
        return run

    return make


def minutes_of_trainings(steps):
    return {
        arguments[0]: options["minutes"] for name, arguments, options in steps if name == "train"
    }


def test_a_stopped_training_continues_with_its_limit(stopped, steps):
    run = stopped(epochs=1)
    assert demo.earlier_training(run) == (1.1, pytest.approx(0.6), 1)
    cli.main(["demo", "--minutes", "9"])
    assert minutes_of_trainings(steps) == {"touch2touch": 1.1, "resnet18": 1.1}


def test_a_stopped_training_stays_where_its_time_does_not_fit(stopped, steps, capsys, monkeypatch):
    """As on a machine that has become busy: the further steps use the weights it has."""
    run = stopped(epochs=1)
    monkeypatch.setattr(demo, "slowness", lambda: 8.0)
    cli.main(["demo", "--minutes", "3"])
    assert minutes_of_trainings(steps) == {"resnet18": demo.MIN_TRAINING_MINUTES}
    assert [name for name, *_ in steps][-2:] == ["evaluate", "report"]
    out = capsys.readouterr().out
    assert "stays as it is after 1 epoch(s) for lack of time" in out
    assert "less than 1.1 minutes for lack of time" in out
    assert run.is_dir() and "--minutes 1.1" in out


def test_a_training_without_an_epoch_begins_again_shorter(stopped, steps, monkeypatch):
    run = stopped(epochs=0)
    monkeypatch.setattr(demo, "slowness", lambda: 3.5)
    cli.main(["demo", "--minutes", "3"])
    minutes = minutes_of_trainings(steps)
    assert 0.01 < minutes["touch2touch"] < 1.1
    assert not run.exists()


def test_an_evaluation_of_the_same_weights_is_not_repeated(untrained_runs, tmp_path, monkeypatch):
    write_json(tmp_path / INFO, {})
    weights = [sha256_of(run / BEST) for run in untrained_runs]
    rows = {digest: SimpleNamespace(weights_sha256=digest) for digest in weights}
    found = SimpleNamespace(info_sha256=sha256_of(tmp_path / INFO), runs=rows)
    assert not demo.is_evaluated(tmp_path, untrained_runs, tmp_path)
    monkeypatch.setattr(files, "read_evaluation", lambda folder: found)
    assert demo.is_evaluated(tmp_path, untrained_runs, tmp_path)
    assert not demo.is_evaluated(tmp_path, untrained_runs[::-1], tmp_path)
