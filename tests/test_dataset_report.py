"""The report of a dataset alone: what it holds."""

from pathlib import Path

import numpy as np
import pytest
from pages import read_page

from t2twin.cli import main
from t2twin.report import dataset_report
from t2twin.report.dataset_report import MIN_CONTACT_SHARE, read_dataset, touched
from t2twin.report.page import PAGE
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.reading import read_after

ALL = ("summary", "shapes", "gallery", "pairs", "forces", "saturation")
"""Sections of a dataset of a gel camera and a taxel array."""


def test_a_dataset_alone_has_a_page_of_its_own(small_dataset: Path, tmp_path: Path) -> None:
    main(["report", "--data", str(small_dataset), "--out", str(tmp_path)])
    read, text = read_page(tmp_path / PAGE)
    sections = [attrs["id"] for tag, attrs in read.tags if tag == "section"]
    assert sections == list(ALL)
    images = [tag for tag, _ in read.tags if tag == "img"]
    assert len(images) == 1 + 1 + dataset_report.PAIRS + 2 + 1
    assert "12 pairs of 4 shapes" in text and "2 pairs of 2 shapes" in text
    assert "none of 20 " in text  # without contact
    assert "each from 0 to 40,000" in text and "All pairs are simulated" in text


@pytest.mark.parametrize(
    "source, target, left_out, said",
    [
        pytest.param(
            "gelsight-mini", "flexitac", (), "gelsight-mini", marks=pytest.mark.exhaustive
        ),
        ("digit", "digit", ("saturation",), "digit (source)"),
        ("flexitac", "cyskin-20", ("gallery",), "384 taxels (layout flexitac), each from 0 to"),
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


def test_contact_is_found_over_the_noise_at_rest(small_dataset: Path) -> None:
    """The recorded noise of some taxels is over the least share of full scale."""
    dataset = read_dataset(small_dataset)
    array = dataset.info.array
    assert touched(array, dataset.readings["target"]).all()
    rng = np.random.default_rng(0)
    flaws, reading = array.imperfections, array.reading
    assert flaws is not None
    at_rest = np.stack(
        [read_after(None, np.zeros(20), array.taxels, flaws, reading, rng)[0] for _ in range(100)]
    )
    assert at_rest.max() > MIN_CONTACT_SHARE * array.full_scale_counts
    assert touched(array, at_rest).mean() <= 0.02  # 0.6 % of many samples
