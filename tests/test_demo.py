"""t2twin demo: the commands that it prints and runs."""

import functools
import math
from pathlib import Path

import pytest

from t2twin import cli
from t2twin.cli import networks


@pytest.mark.parametrize("minutes", [1.0, 3.0, 4.0, 6.0, 60.0, math.inf])
def test_the_trainings_leave_time_for_the_other_steps(minutes):
    steps = networks.demo_commands(Path("out"), minutes)
    lengths = [float(words[-1]) for words in steps if words[0] == "train"]
    assert len(lengths) == 2 and 0.0 < max(lengths) <= networks.TRAINING_MINUTES
    assert sum(lengths) < minutes / 2
    assert ("small" in steps[1]) == (minutes >= networks.SMALL_MINUTES)


def test_the_commands_are_valid(capsys, monkeypatch):
    parsed = []
    for name, command in cli.COMMANDS.items():
        if name != "demo":
            stub = functools.wraps(command)(lambda *_, name=name, **__: parsed.append(name))
            monkeypatch.setitem(cli.COMMANDS, name, stub)
    cli.main(["demo", "--out", "my demo", "--minutes", "2"])
    assert parsed == ["primitives", "simdata", "train", "train", "evaluate", "report"]
    assert "step 6 of 6: t2twin report --data 'my demo/data/smoke'" in capsys.readouterr().out
