"""Runs evaluated on datasets of several recipes, the table of them, what a run says of its own."""

import json
from pathlib import Path

import pytest
from spots import write_spots

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import read_info
from t2twin.translate.data.pairs import load_info
from t2twin.translate.evaluation.baselines import MEAN_ARRAY_OF_FORCE
from t2twin.translate.evaluation.evaluate import DATASETS_TABLE, evaluate_datasets
from t2twin.translate.evaluation.records import read_evaluation
from t2twin.translate.evaluation.table import datasets_markdown
from t2twin.translate.runs.config import CONFIG, load_config

FORCES_N = (0.0, 0.5, 2.0, 8.0)


def cells(line: str) -> list[str]:
    """Of a row of a table in Markdown."""
    return [cell.strip() for cell in line.split("|")[1:-1]]


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset that the runs are trained on, of the paper's protocol."""
    return write_spots(tmp_path_factory.mktemp("spots") / "protocol")


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of no protocol, several forces and no test pairs."""
    folder = tmp_path_factory.mktemp("elsewhere") / "random"
    return write_spots(folder, 40, 16, 0, 5, FORCES_N, scale=None)


def test_a_run_names_the_recipe_of_its_data(runs: list[Path], data_dir: Path) -> None:
    info = read_info(data_dir)
    assert info.is_protocol and info.recipe_name == "smoke"
    data = load_config(runs[0]).data
    assert (data.recipe, data.recipe_shown, data.train_pairs) == ("smoke", "smoke", 32)


def test_a_datasets_own_recipe_name_comes_first(
    data_dir: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(DatasetInfo, "recipe_name", "shelf", raising=False)
    assert load_info(data_dir).recipe == "shelf"


def test_data_without_a_name_is_called_by_its_digits(elsewhere: Path) -> None:
    info = load_info(elsewhere)
    assert info.recipe is None and not read_info(elsewhere).is_protocol
    assert info.recipe_shown == f"dataset {info.sha256[:8]}"


def test_several_datasets_at_once_make_one_table(
    runs: list[Path],
    data_dir: Path,
    elsewhere: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Each dataset has its own folder and the splits that it has; a cell is a row's error."""
    given = ["evaluate", *map(str, runs), "--data", str(data_dir), str(elsewhere)]
    main([*given, "--split", "both", "--out", str(tmp_path)])
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        DATASETS_TABLE,
        "protocol",
        "random",
    ]
    assert not (tmp_path / "random" / "test").exists()
    text = (tmp_path / DATASETS_TABLE).read_text()
    assert text in capsys.readouterr().out
    other = read_evaluation(tmp_path / "random" / "val")
    heads, _, *rows = [cells(line) for line in text.split("\n\n")[1].splitlines()]
    assert heads[1:] == [
        "trained on", "pairs", "steps", "smoke, val", "smoke, test",
        f"{other.recipe_shown}, val",
    ]  # fmt: skip
    by_name = {row[0]: row for row in rows}
    assert list(by_name) == [
        "mean-array", MEAN_ARRAY_OF_FORCE, "nearest-neighbour", "touch2touch", "resnet18",
    ]  # fmt: skip
    assert by_name["resnet18"][1:4] == ["smoke", "32", "12"]
    error = other.models["resnet18"].overall.rmse_percent
    assert by_name["resnet18"][-1] == f"{error:.2f}"
    assert by_name[MEAN_ARRAY_OF_FORCE][-2] == "–"  # the protocol's data have one force
    assert other.paper == {} and not other.runs["resnet18"].same_data
    assert read_evaluation(tmp_path / "protocol" / "val").paper


def test_results_of_several_forces_say_so(
    runs: list[Path], elsewhere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["evaluate", str(runs[1]), "--data", str(elsewhere), "--split", "both"]
    main([*given, "--out", str(tmp_path)])
    said = capsys.readouterr().out
    assert "no contact, 4 pairs" in said and "8 N, 4 pairs" in said
    text = (tmp_path / "results.md").read_text()
    assert "resnet18 was trained on smoke, 32 pairs, 12 steps." in text
    table = text.split("val: RMSE by force")[1].split("\n\n")[1]
    rows = [cells(line)[0] for line in table.splitlines()]
    assert rows[2:] == [f"{force}, 4 pairs" for force in ("no contact", "0.5 N", "2 N", "8 N")]
    assert json.loads((tmp_path / "findings.json").read_text())["gap"] == {}


def test_an_older_runs_recipe_is_known_where_its_data_are_there(
    runs: list[Path], data_dir: Path, elsewhere: Path, tmp_path: Path
) -> None:
    """It is asked beside its own dataset: the other one's row of it cannot know, the table does."""
    older = tmp_path / "resnet18"
    older.mkdir()
    for path in runs[1].glob("*.*"):
        if path.is_file():
            (older / path.name).write_bytes(path.read_bytes())
    content = json.loads((older / CONFIG).read_text())
    del content["data"]["recipe"], content["data"]["train_pairs"], content["epoch_steps"]
    del content["steps"]
    (older / CONFIG).write_text(json.dumps(content))
    recipes = evaluate_datasets([older], [elsewhere, data_dir], "val", tmp_path / "out")
    alone = recipes["random"]["val"].runs["resnet18"]
    assert (alone.trained_recipe, alone.trained_pairs, alone.trained_steps) == (None, None, None)
    here = recipes["protocol"]["val"].runs["resnet18"]
    assert (here.trained_recipe, here.trained_pairs, here.trained_steps) == ("smoke", 32, 12)
    assert "| resnet18 | smoke |" in datasets_markdown(recipes)


def test_what_cannot_be_evaluated_is_refused_before_anything_is_written(
    runs: list[Path], data_dir: Path, elsewhere: Path, tmp_path: Path
) -> None:
    twin = write_spots(tmp_path / "other" / "protocol", train=8, val=2, test=1)
    out = tmp_path / "out"
    with pytest.raises(T2TwinError, match="which must differ"):
        evaluate_datasets(runs, [data_dir, twin], "val", out)
    with pytest.raises(T2TwinError, match="has no test pairs"):
        evaluate_datasets(runs, [data_dir, elsewhere], "test", out)
    alone = write_spots(tmp_path / "alone", 40, 0, 0)
    with pytest.raises(T2TwinError, match="neither validation nor test pairs"):
        evaluate_datasets(runs, [data_dir, alone], "both", out)
    assert not out.exists()
