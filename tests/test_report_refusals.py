"""What `t2twin report` says, before it begins, of a folder that it cannot write into."""

from pathlib import Path

import pytest

from t2twin.cli import main
from t2twin.report import data, dataset_report
from t2twin.report.page import PAGE, check_out


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*"))


def test_a_folder_that_will_do_is_left_as_it_was(tmp_path: Path) -> None:
    (tmp_path / PAGE).write_text("an earlier page")
    before = files(tmp_path)
    check_out(tmp_path)
    check_out(tmp_path / "new" / "one")
    assert files(tmp_path) == before


@pytest.mark.parametrize("out", ["file", "file/report", "page", "n" * 300])
@pytest.mark.parametrize("of", ["dataset", "runs"])
def test_a_place_that_is_no_folder_is_found_first(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    of: str,
    out: str,
) -> None:
    """Neither dataset nor run is scanned at: they need not be there."""

    def refuse(*arguments: object) -> None:
        raise AssertionError("the work has begun")

    for module in (dataset_report, data):
        monkeypatch.setattr(module, "read_dataset", refuse)
    (tmp_path / "file").touch()
    (tmp_path / "page" / PAGE).mkdir(parents=True)
    before = files(tmp_path)
    runs = ["--runs", "run"] if of == "runs" else []
    with pytest.raises(SystemExit) as stopped:
        main(["report", "--data", str(tmp_path), "--out", str(tmp_path / out), *runs])
    said = capsys.readouterr().err
    assert stopped.value.code == 2
    assert (
        said.startswith("t2twin: ")
        and said.count("\n") == 1
        and (out in said or "shorter path" in said)
    )
    assert files(tmp_path) == before


def test_evaluation_without_runs_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["report", "--data", str(tmp_path), "--evaluation", str(tmp_path)])
    assert "give them with --runs" in capsys.readouterr().err


@pytest.mark.parametrize("folder", ["nowhere", "."])
def test_a_folder_without_an_evaluation_is_refused(
    folder: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["report", "--data", "d", "--runs", "r", "--out", str(tmp_path / "out")]
    with pytest.raises(SystemExit):
        main([*words, "--evaluation", str(tmp_path / folder)])
    assert f"{tmp_path / folder} contains no evaluation; expected" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
