"""t2twin demo: its plan, and the commands that it prints and runs."""

import functools
import re
import shlex

import pytest

from t2twin import cli
from t2twin.cli import demo


@pytest.mark.parametrize("minutes", [1.0, 3.0, 4.0, 6.0, 60.0])
def test_the_trainings_leave_time_for_the_other_steps(minutes):
    scale, training = demo.plan(minutes)
    assert scale == ("small" if minutes >= demo.SMALL_MINUTES else "smoke")
    assert 0.0 < training <= demo.TRAINING_MINUTES and 2 * training < minutes / 2
    assert demo.plan(None) == ("small", demo.TRAINING_MINUTES)


@pytest.fixture
def steps(monkeypatch):
    """Replaces the function of every step by one that only records its call."""
    calls = []

    def record(name):
        return lambda *arguments, **options: calls.append((name, arguments, options))

    for name, module in (
        ("primitives", cli.press), ("simdata", cli.dataset), ("train", cli.train),
        ("evaluate", cli.evaluate), ("report", cli.evaluate),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, record(name))
    return calls


NAMES = ["primitives", "simdata", "train", "train", "evaluate", "report"]


@pytest.mark.parametrize("options, minutes", [((), 1.1), (("--minutes", "2"), 0.4)])
def test_the_printed_commands_are_valid(options, minutes, steps, capsys, monkeypatch):
    real = dict(cli.COMMANDS)
    cli.main(["demo", "--out", "my demo", *options])
    assert [name for name, *_ in steps] == NAMES
    trainings = [options["minutes"] for name, _, options in steps if name == "train"]
    assert trainings == [minutes, minutes]
    lines = re.findall(r"(?m)^step \d of 6: t2twin (.*)$", capsys.readouterr().out)
    parsed = []
    stubs = {
        name: functools.wraps(command)(lambda *_, name=name, **__: parsed.append(name))
        for name, command in real.items()
    }
    monkeypatch.setattr(cli, "COMMANDS", stubs)
    for line in lines:
        cli.main(shlex.split(line))
    assert parsed == NAMES
