"""Progress where nobody watches: a plain line once in a while, and nothing of a bar."""

from t2twin.core import progress
from t2twin.core.progress import Progress


def test_a_pipe_gets_few_plain_lines(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with Progress(total=1000, desc="work", unit="pair") as bar:
        for _ in range(999):
            now[0] += 0.5
            bar.update()
            bar.set_postfix_str("fine")  # which shows the bar on a terminal
    said = capsys.readouterr().err
    lines = said.splitlines()
    assert 7 <= len(lines) <= 8 and "\r" not in said
    assert all(line.startswith("work: ") and "of 1,000 pairs, about" in line for line in lines)


def test_a_slow_start_is_not_taken_for_the_pace(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    with Progress(total=1200, desc="work", unit="pair") as bar:
        now[0] += 40.0
        for _ in range(300):
            bar.update()
            now[0] += 0.1
    first = capsys.readouterr().err.splitlines()[0]
    assert first == "work: 300 of 1,200 pairs, about 1.5 minutes left"


def test_short_work_says_nothing(capsys):
    assert [*Progress(range(5), desc="work", unit="pair")] == [0, 1, 2, 3, 4]
    assert capsys.readouterr().err == ""


def test_what_is_not_wanted_says_nothing(capsys):
    with Progress(total=2, disable=True) as bar:
        bar.update()
    assert capsys.readouterr().err == ""
