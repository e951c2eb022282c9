"""t2twin demo: its plan within a limit, the commands that it prints, and how it continues."""

import functools
import re
import shlex
from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from t2twin import cli
from t2twin.cli import demo
from t2twin.core.errors import T2TwinError
from t2twin.core.files import write_json
from t2twin.primitives_cad import contact_sheet, export
from t2twin.sim.dataset.store import INFO, sha256_of
from t2twin.translate.evaluation import files
from t2twin.translate.runs.config import BEST, load_config
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


def test_a_stopped_training_continues_with_its_limit(untrained_runs, tmp_path):
    replace(load_config(untrained_runs[0]), minutes=1.1).save(tmp_path)
    assert demo.earlier_limit(tmp_path, allowed=2.0) == 1.1
    with pytest.raises(T2TwinError, match=r"1.1 minutes, for which --minutes leaves 0.50"):
        demo.earlier_limit(tmp_path, allowed=0.5)


def test_an_evaluation_of_the_same_weights_is_not_repeated(untrained_runs, tmp_path, monkeypatch):
    write_json(tmp_path / INFO, {})
    weights = [sha256_of(run / BEST) for run in untrained_runs]
    rows = {digest: SimpleNamespace(weights_sha256=digest) for digest in weights}
    found = SimpleNamespace(info_sha256=sha256_of(tmp_path / INFO), runs=rows)
    assert not demo.is_evaluated(tmp_path, untrained_runs, tmp_path)
    monkeypatch.setattr(files, "read_evaluation", lambda folder: found)
    assert demo.is_evaluated(tmp_path, untrained_runs, tmp_path)
    assert not demo.is_evaluated(tmp_path, untrained_runs[::-1], tmp_path)
