"""The report of a dataset alone: what it holds, near-duplicates."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from pages import read_page

from t2twin.cli import main
from t2twin.core.images import decode_png, encode_png
from t2twin.report import dataset_report, pairs
from t2twin.report.data import MIN_CONTACT_SHARE, Dataset, read_dataset
from t2twin.report.near_duplicates import (
    Scan,
    near_duplicates,
    nearest_others,
    noise_grey,
    scan,
)
from t2twin.report.page import PAGE, render_section
from t2twin.sim.dataset.columns import schema_of
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.info import Shard
from t2twin.sim.dataset.store import read_info, write_info, write_shard
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.reading import read_after
from t2twin.translate.evaluation.baselines import second_reading

ALL = ("summary", "about", "shapes", "gallery", "pairs", "forces", "saturation", "duplicates")
"""Sections of a dataset of a gel camera and a taxel array."""


@pytest.fixture(scope="module")
def data_dir(small_dataset: Path) -> Path:
    return small_dataset


def test_a_dataset_alone_has_a_page_of_its_own(data_dir: Path, tmp_path: Path) -> None:
    main(["report", "--data", str(data_dir), "--out", str(tmp_path)])
    read, text = read_page(tmp_path / PAGE)
    sections = [attrs["id"] for tag, attrs in read.tags if tag == "section"]
    assert sections == list(ALL)
    images = [tag for tag, _ in read.tags if tag == "img"]
    assert len(images) == 1 + 1 + 1 + pairs.PAIRS + 2 + 1 + 1
    assert "12 pairs of 4 shapes" in text and "2 pairs of 2 shapes" in text
    assert "none of 20 " in text  # without contact
    assert sum(len(table) for table in read_dataset(data_dir).tables.values()) == 20


def test_the_page_begins_with_what_the_dataset_is(data_dir: Path) -> None:
    dataset = read_dataset(data_dir)
    scanned = scan(dataset)
    said = summary_text(dataset, scanned)
    assert "gives 20 counts, each from 0 to 40,000" in said
    assert "There are 20 pairs of 8 shapes: 12 for training, 6 for validation, 2 for test." in said
    assert "Near-duplicates: none of the pairs differ" in said
    assert "All pairs are simulated" in said
    twins = replace(scanned, alike_counts=np.where(np.arange(20) < 5, 0.0, np.inf))
    assert "Near-duplicates: 25 % of the pairs" in summary_text(dataset, twins)


@pytest.mark.parametrize(
    "source, target, left_out, said",
    [
        pytest.param(
            "gelsight-mini",
            "flexitac",
            (),
            "The rectangle is the field of view of gelsight-mini",
            marks=pytest.mark.exhaustive,
        ),
        ("flexitac", "digit", (), "flexitac, is a taxel array"),
        ("digit", "digit", ("saturation", "duplicates"), "Left: digit (source). Right: digit (t"),
        ("flexitac", "cyskin-20", ("gallery", "duplicates"), "384 counts, each from 0 to 255"),
    ],
)
def test_any_two_sensors_have_a_page(
    source: str, target: str, left_out: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    sensors = SensorPair.of(source, target)
    shapes = ("circle-1", "square-3")
    folder = tmp_path / "data"
    make_dataset(folder, "smoke", workers=1, shapes=shapes, sensors=sensors)
    read, text = read_page(dataset_report.write_data_report(tmp_path / "page", folder))
    sections = [attrs["id"] for tag, attrs in read.tags if tag == "section"]
    assert sections == [name for name in ALL if name not in left_out]
    assert said in text
    assert source in text and target in text
    assert ("counts" in text) is ("saturation" in sections)


def test_contact_is_found_over_the_noise_at_rest(data_dir: Path) -> None:
    """The recorded noise of some taxels is over the least share of full scale."""
    array = read_dataset(data_dir).array
    assert array.touched.all()
    rng = np.random.default_rng(0)
    flaws, reading = array.info.imperfections, array.info.reading
    assert flaws is not None
    at_rest = [
        read_after(None, np.zeros(20), array.layout, flaws, reading, rng)[0] for _ in range(100)
    ]
    rest = replace(array, counts=np.stack(at_rest))
    assert rest.largest.max() > MIN_CONTACT_SHARE * array.full_scale
    assert rest.touched.mean() <= 0.02  # 0.6 % of many samples


def summary_text(dataset: Dataset, scanned: Scan) -> str:
    values = dataset_report.summary(dataset, scanned)
    text = render_section(dataset_report.TEMPLATES, "summary", dataset=dataset, **values)
    return " ".join(text.split())


def test_near_duplicates_are_found_and_no_others(data_dir: Path, tmp_path: Path) -> None:
    """One press taken twice, with another noise of image and counts, among presses that differ."""
    folder = tmp_path / "data"
    shutil.copytree(data_dir, folder)
    before = read_dataset(folder)
    noise = noise_grey(before)
    assert not near_duplicates(before, scan(before)).any()
    path = folder / "train/square-1.parquet"
    rows = pq.ParquetFile(path).read().to_pylist()
    rng = np.random.default_rng(0)
    shaken = rng.normal(0.0, noise, (320, 240, 3))
    again = np.clip(np.rint(decode_png(rows[1]["source_image"]["bytes"]) + shaken), 0, 255)
    schema = schema_of(before.info.values, before.info.recipe)
    picture = {"bytes": encode_png(again.astype(np.uint8)), "path": ""}
    counts = np.array([row["target_counts"] for row in rows[:2]], dtype=float)
    second = second_reading(counts, before.info)
    assert second is not None
    more = [
        *rows,
        rows[1] | {"source_image": picture, "index": 587, "target_counts": second[1].tolist()},
        # the same image, but other counts
        rows[0] | {"index": 588, "target_counts": (counts[0] + 1000).tolist()},
    ]
    info, digest = read_info(folder), write_shard(path, more, schema)
    shards = info.shards | {"train/square-1.parquet": Shard(digest, len(more))}
    pairs = info.pairs | {"train": info.pairs["train"] + 2}
    write_info(folder, replace(info, shards=shards, pairs=pairs))
    dataset = read_dataset(folder)
    scanned = scan(dataset)
    twins = np.flatnonzero(near_duplicates(dataset, scanned))
    assert [dataset.column("index")[place] for place in twins] == [rows[1]["index"], 587]
    difference = np.sqrt(np.square(second[1] - counts[1]).mean())
    np.testing.assert_allclose(scanned.alike_counts[twins], difference, rtol=1e-4)
    alike = np.flatnonzero(np.isfinite(scanned.alike_counts))
    assert {rows[0]["index"], 588} <= {int(dataset.column("index")[place]) for place in alike}


def test_nearest_others_are_those_of_plain_arithmetic() -> None:
    rng = np.random.default_rng(0)
    coarse = rng.normal(0, 5, (300, 60)).astype(np.float32)
    counts = rng.uniform(0, 40_000, (300, 20))
    apart, felt = (
        np.sqrt(np.square(of[:, None] - of[None]).mean(axis=2)) for of in (coarse, counts)
    )
    apart[np.diag_indices(300)] = np.inf
    noise = float(np.quantile(apart, 0.01))
    nearest, alike = nearest_others(coarse, counts, noise)
    np.testing.assert_allclose(nearest, apart.min(axis=1), rtol=1e-3)
    expected = np.where(apart < noise, felt, np.inf).min(axis=1)
    assert 0 < np.isfinite(expected).sum() < 300
    np.testing.assert_allclose(alike, expected, rtol=1e-3)
    assert np.isinf(nearest_others(coarse[:1], counts[:1], noise)).all()
