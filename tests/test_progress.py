"""Progress where nobody watches: a plain line once in a while, and nothing of a bar."""

import pytest

from t2twin.core import progress
from t2twin.core.progress import Progress


@pytest.fixture
def now(monkeypatch):
    """The time, s, in a list."""
    seconds = [100.0]
    for clock in ("tqdm.std.time", f"{progress.__name__}.time"):
        monkeypatch.setattr(clock, lambda: seconds[0])
    return seconds


def test_a_pipe_gets_few_plain_lines(capsys, now):
    with Progress(total=1000, desc="work", unit="pair") as bar:
        for _ in range(999):
            now[0] += 0.5
            bar.update()
            bar.set_postfix_str("fine")  # which shows the bar on a terminal
    said = capsys.readouterr().err
    lines = said.splitlines()
    assert 7 <= len(lines) <= 8 and "\r" not in said
    assert all(line.startswith("work: ") and "of 1,000 pairs, about" in line for line in lines)


def test_work_that_goes_on_is_estimated_from_here(capsys, now):
    with Progress(total=1200, initial=600, desc="work", unit="pair") as bar:
        for _ in range(100):
            bar.update()
            now[0] += 1.0
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["work: 661 of 1,200 pairs, about 8.8 minutes left"]
