"""Floors, intervals and differences on cases whose answers are known."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from msgspec import structs

from benchmarks.networks.irreducible_error import (
    estimate_irreducible_error,
    floor_of,
    noise_distance_grey,
)
from t2twin.sim.dataset.info import ArrayInfo, DatasetInfo
from t2twin.sim.dataset.store import read_info
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.reading import expected_reading
from t2twin.sim.taxels.spec import Imperfections
from t2twin.translate.data.pairs import Pairs, load_pairs
from t2twin.translate.evaluation import metrics
from t2twin.translate.evaluation.baselines import (
    FEATURE_SIZE,
    NEAREST_NEIGHBOR,
    NOISE_FLOOR,
    predict_baselines,
    second_reading,
)

FULL_SCALE = 40000.0


@pytest.fixture(scope="module")
def info(small_dataset: Path) -> DatasetInfo:
    return read_info(small_dataset)


def with_flaws(info: DatasetInfo, flaws: Imperfections | None) -> ArrayInfo:
    """The dataset's array, as if it had been made with these imperfections."""
    return structs.replace(info.array, imperfections=flaws)


def test_two_readings_differ_by_the_noise_of_both(info: DatasetInfo) -> None:
    """White noise of 100 counts a reading, five readings a sample: sqrt(2 / 5) of it."""
    stored = np.full((500, 20), 9000.0)
    noisy = with_flaws(info, Imperfections(white_counts=100.0))
    again = second_reading(stored, noisy)
    assert again is not None
    apart = again - stored
    assert np.sqrt(np.square(apart).mean()) == pytest.approx(100.0 * np.sqrt(2 / 5), rel=0.03)
    assert abs(apart.mean()) < 3.0
    once_more = second_reading(stored, noisy)
    assert once_more is not None and np.array_equal(again, once_more)


def test_flaws_for_good_cancel_between_readings(info: DatasetInfo) -> None:
    stored = np.random.default_rng(0).uniform(1000, 20000, (30, 20))
    flaws = Imperfections(gain_spread=0.1, crosstalk=0.02, dead=(3,))
    same = second_reading(stored, with_flaws(info, flaws))
    assert same is not None
    np.testing.assert_allclose(same, stored, rtol=1e-6)
    assert second_reading(stored, with_flaws(info, None)) is None


def test_noise_without_contact_is_counted_once(info: DatasetInfo) -> None:
    """Of readings that the recorded noise raises, as they are clipped to 0."""
    array, rng = SensorPair.of(imperfections="recorded").array, np.random.default_rng(0)
    readings = [array.read(None, rng).counts for _ in range(1000)]
    one, two = np.array(readings, float).reshape(2, 500, 20)
    again = second_reading(one, with_flaws(info, array.flaws))
    assert again is not None
    expected = np.sqrt(np.square(one - two).mean())
    assert np.sqrt(np.square(again - one).mean()) == pytest.approx(expected, rel=0.15)


def test_noise_floor_is_of_the_datasets_own_noise(small_dataset: Path) -> None:
    pairs, train = (
        load_pairs(small_dataset, s, FEATURE_SIZE, grey=False) for s in ("val", "train")
    )
    near = np.zeros(len(pairs), int)
    rows = predict_baselines(pairs, train, near, None, read_info(small_dataset).array, ())
    error = np.sqrt(np.square(rows[NOISE_FLOOR] - pairs.counts).mean())
    array = SensorPair().array.for_dataset()
    flaws, table = array.flaws, array.spec.counts
    at_rest, _ = expected_reading(flaws, table, np.zeros(pairs.counts.shape[1]))
    _, noise = expected_reading(flaws, table, np.maximum(pairs.counts - at_rest, 0.0))
    assert error == pytest.approx(np.sqrt(2 * np.square(noise).mean()), rel=0.1)
    assert error < np.sqrt(np.square(rows[NEAREST_NEIGHBOR] - pairs.counts).mean()) / 5


def values_of(errors: np.ndarray) -> pd.DataFrame:
    """Pairs with these RMSEs, and SSIM and the rest following from them."""
    return pd.DataFrame(
        {
            "squared_error": errors**2,
            "ssim": 1.0 - errors / 1e4,
            "centroid_error_mm": np.where(errors > 0, errors / 1e3, np.nan),
            "total_error": errors,
            "total": 1e4,
            "squared_error_near": np.nan,
        }
    )


def resampled(values: pd.DataFrame, shapes: np.ndarray) -> pd.DataFrame:
    return metrics.figures_of(metrics.resampled_means(values, shapes), FULL_SCALE)


def test_interval_is_that_of_the_mean_of_shapes() -> None:
    """400 shapes of two pairs: as wide as 1.96 standard errors of their mean squared errors."""
    rng = np.random.default_rng(0)
    of_shape = rng.uniform(500, 1500, 400)
    shapes = np.repeat(np.array([f"s{n}" for n in range(400)]), 2)
    drawn = resampled(values_of(np.repeat(of_shape, 2)), shapes)
    span = metrics.interval(np.square(drawn["rmse_counts"].to_numpy()))
    assert span is not None
    error = np.square(of_shape).std() / math.sqrt(400)
    assert span[0] == pytest.approx(np.square(of_shape).mean() - 1.96 * error, rel=0.01)
    assert span[1] == pytest.approx(np.square(of_shape).mean() + 1.96 * error, rel=0.01)
    assert drawn["ssim"].mean() == pytest.approx(1 - of_shape.mean() / 1e4, rel=1e-3)


def test_figures_are_of_the_pairs_that_have_them() -> None:
    values = values_of(np.array([0.0, 100.0, 300.0]))
    found = metrics.by_name(values, FULL_SCALE, np.array(["a", "b", "a"]))["a"]
    assert found["pairs"] == 2
    assert found["rmse_counts"] == pytest.approx(math.sqrt((0 + 9e4) / 2))
    assert found["centroid_error_mm"] == pytest.approx(0.3)  # the pair that has one
    assert found["total_error_percent"] == pytest.approx(100 * 300 / 2e4)
    assert "rmse_near_counts" not in found


def test_differences_have_a_paired_interval() -> None:
    """A small difference that every shape shows is decided; one that shapes disagree on is not."""
    rng = np.random.default_rng(0)
    shapes = np.repeat([f"s{n}" for n in range(12)], 5)
    base = np.repeat(rng.uniform(500, 3000, 12), 5)  # shapes differ far more than the models
    sign = np.repeat(np.where(np.arange(12) % 2 == 0, 1.0, -1.0), 5)
    for off, signs in ((20.0, (1, 1)), (-20.0, (-1, -1)), (200.0 * sign, (-1, 1))):
        found = metrics.paired(values_of(base + off), values_of(base), FULL_SCALE, shapes)
        for figure, factor in (("rmse_counts", 1), ("ssim", -1)):
            ends = sorted(factor * found[figure][end] for end in ("low", "high"))
            assert tuple(np.sign(np.array(ends))) == signs


def pairs_with(counts: np.ndarray, shapes: np.ndarray) -> Pairs:
    nothing = np.zeros(len(counts))
    return Pairs(None, counts, shapes, shapes, nothing, nothing, nothing, nothing)  # pyright: ignore


def test_unknowable_part_is_found_by_extrapolation() -> None:
    """Counts are a smooth function of the picture, and a part that it does not show.

    The picture is a place in the plane, 1 grey level a unit; counts rise linearly in it and have
    800 counts of something else. The floor must be that 800, from pairs that are far apart.
    """
    rng = np.random.default_rng(0)
    places = rng.uniform(0, 40, (1500, 2))
    hidden = 800.0
    counts = 900.0 * places.sum(axis=1)[:, None] + hidden * rng.standard_normal((1500, 20))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)
    apart[apart < 1.0] = np.inf  # no pictures are nearly the same
    order = np.argsort(apart, axis=1)[:, :8]
    near = order, np.take_along_axis(apart, order, axis=1)
    pairs = pairs_with(counts.astype(np.float32), np.array([f"s{n % 15}" for n in range(1500)]))
    some = np.arange(20) < 5
    floor = floor_of(pairs, pairs, near, 0.3, {"some": some, "none": np.zeros(20, bool)})
    assert floor is not None
    assert floor["parts"] == {"some": pytest.approx(hidden, rel=0.1)}
    assert floor["extrapolated_rmse_counts"] == pytest.approx(hidden, rel=0.05)


def test_the_irreducible_error_of_a_dataset(small_dataset: Path) -> None:
    alike = estimate_irreducible_error(small_dataset, "val")
    assert alike is not None and alike["split"] is not None
    noise = noise_distance_grey(small_dataset, "val")
    assert noise is not None and alike["noise_grey"] == noise
    # Noise of 0.5 grey levels is a tenth of that in a picture of 32 pixels, whose own rounding is
    # of 0.29: two of them differ by less than two roundings do.
    assert 0.05 < noise < 0.29 * math.sqrt(2)
    assert 0 <= alike["split"]["extrapolated_rmse_counts"] < FULL_SCALE
