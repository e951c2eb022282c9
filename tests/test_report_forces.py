"""Reports of data with several forces and with more shapes than anybody reads."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pages import draw_only, read_page
from spots import write_spots

from t2twin.report import dataset_report
from t2twin.report.data import read_dataset
from t2twin.report.dataset_report import write_data_report
from t2twin.report.page import forces_text
from t2twin.report.pairs import sample_in_turn
from t2twin.report.run_report import write_report
from t2twin.sim.dataset.store import lists, read_info, sha256_of, write_info
from t2twin.translate.evaluation import baselines
from t2twin.translate.evaluation.records import read_evaluation

FORCES_N = (0.0, 0.5, 2.0, 8.0)


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Spots that are called many shapes: a shard holds several of them, in two families."""
    folder = write_spots(
        tmp_path_factory.mktemp("many") / "data", 72, 24, 16, 0, FORCES_N, scale=None
    )
    info = read_info(folder)
    shards = {}
    for path, shard in info.shards.items():
        table = pq.read_table(folder / path)
        split = path.split("/")[0]
        names = [f"{split}-{row}" for row in range(len(table))]
        for column, values in (
            ("shape", names),
            ("family", ["round" if int(name.split("-")[1]) % 3 else "long" for name in names]),
        ):
            place = table.column_names.index(column)
            table = table.set_column(place, table.schema.field(place), [pa.array(values)])
        pq.write_table(table, folder / path, row_group_size=50)
        shards[path] = replace(shard, sha256=sha256_of(folder / path))
    write_info(folder, replace(info, shards=shards))
    return folder


def test_forces_text() -> None:
    assert forces_text(np.array([8.0])) == "8 N"
    assert forces_text(np.array([0.0, 1.0, 2.0, 8.0])) == "1, 2 and 8 N"
    assert forces_text(np.linspace(0.52, 11.9, 50)) == "0.52 to 11.9 N"
    assert forces_text(np.array([0.0])) == "none"


def test_a_rows_picture_is_its_own_wherever_its_shape_lies(data_dir: Path) -> None:
    """Shards hold many shapes: the spot is as bright as its counts are many."""
    dataset = read_dataset(data_dir)
    counts = lists(dataset.tables["train"], "target_counts").max(axis=1)
    some = [8 * n + 7 for n in range(9)]  # all of 8 N
    bright = [int(dataset.image("train", row).max()) for row in some]
    inside = [row for row, light in zip(some, bright, strict=True) if light < 250]
    assert np.corrcoef(counts[inside], [dataset.image("train", r).max() for r in inside])[0, 1] > 0
    assert dataset.image("train", 0).max() == 60  # untouched: the background


def test_the_page_of_runs_draws_the_error_by_force(
    runs: list[Path], data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_only(monkeypatch, "summary", "about", "results", "by-force", "limits")
    monkeypatch.setattr(baselines, "MIN_PRESSES", 18)
    page = write_report(tmp_path / "report", data_dir, runs)
    reader, text = read_page(page)
    sections = [attrs["id"] for tag, attrs in reader.tags if tag == "section"]
    assert sections[2:5] == ["results", "by-force", "limits"]
    evaluation = read_evaluation(page.parent / "evaluate-val")
    ours = evaluation.models["resnet18"].by_force
    assert f"at 8 N the RMSE is {100 * (ours[3].of_mean_array or 0):.0f} % of the mean" in text
    assert (
        f"Without contact the predicted counts have a sum of {ours[0].phantom_counts:,.0f}" in text
    )
    assert "0.5, 2 and 8 N" in text
    assert "hand tools" not in text and "real ones" not in text  # the paper's protocol, its rows


def test_the_page_of_data_with_many_shapes_stays_short(data_dir: Path, tmp_path: Path) -> None:
    page = write_data_report(tmp_path, data_dir)
    _, text = read_page(page)
    assert "The 112 shapes are grouped by family." in text
    assert "112 pairs of 112 shapes, pressed with 0.5, 2 and 8 N" in text
    dataset = read_dataset(data_dir)
    counted = dataset_report.counted_by_split(dataset, dataset.column("family"))
    assert counted["train", "long"] == 24 and counted["val", "round"] == 16


def test_pictures_of_many_shapes_are_of_shapes_drawn_at_random(data_dir: Path) -> None:
    dataset = read_dataset(data_dir)
    drawn = sample_in_turn(dataset, dataset.column("shape"), 40, 0)
    assert len({dataset.row(split, row)["shape"] for split, row in drawn}) == 40
    assert {split for split, _ in drawn} > {"train"}
