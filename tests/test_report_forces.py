"""Reports of data with several forces and with more shapes than anybody reads."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pages import draw_only, read_page
from spots import write_spots

from t2twin.core.files import sha256_of
from t2twin.report.dataset_report import read_dataset, write_data_report
from t2twin.report.run_report import write_report
from t2twin.sim.dataset.store import read_info, write_info
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


def test_a_pairs_image_is_its_own_wherever_its_shape_lies(data_dir: Path) -> None:
    """Shards hold many shapes: the spot is as bright as its counts are many."""
    dataset = read_dataset(data_dir)
    assert dataset.forces_text == "0.5, 2 and 8 N"
    largest = dataset.readings["target"].max(axis=1)
    some = [8 * n + 7 for n in range(9)]  # all of 8 N
    bright = [int(dataset.image(place).max()) for place in some]
    inside = [place for place, light in zip(some, bright, strict=True) if light < 250]
    lights = [dataset.image(place).max() for place in inside]
    assert np.corrcoef(largest[inside], lights)[0, 1] > 0
    assert dataset.image(0).max() == 60  # untouched: the background


def test_the_page_of_runs_draws_the_error_by_force(
    runs: list[Path], data_dir: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_only(monkeypatch, "summary", "about", "results", "limits")
    monkeypatch.setattr(baselines, "MIN_PRESSES", 18)
    page = write_report(tmp_path / "report", data_dir, runs)
    reader, text = read_page(page)
    sections = [attrs["id"] for tag, attrs in reader.tags if tag == "section"]
    assert sections[2:] == ["results", "limits"]
    evaluation = read_evaluation(page.parent / "evaluate-val")
    ours = evaluation.models["resnet18"].by_force
    assert f"{ours[3].rmse_counts:,.0f} ({100 * (ours[3].of_mean_array or 0):.0f} %)" in text
    assert f"({ours[0].phantom_counts:,.0f})" in text
    assert "0.5, 2 and 8 N" in text
    assert "hand tools" not in text and "real ones" not in text  # the paper's protocol, its rows


def test_the_page_of_data_with_many_shapes_stays_short(data_dir: Path, tmp_path: Path) -> None:
    page = write_data_report(tmp_path, data_dir)
    _, text = read_page(page)
    assert "The 112 shapes are grouped by family." in text
    assert "112 pairs of 112 shapes" in text
    places = read_dataset(data_dir).sample_in_turn("shape", 40)
    table = read_dataset(data_dir).table.iloc[places]
    assert table["shape"].nunique() == 40 and set(table["split"]) > {"train"}
