"""The imperfections "recorded" of the default array: noise, offsets and memory."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import taxel_array
from msgspec import structs

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.slide import path_commands, touches_along
from t2twin.sim.taxels import reading
from t2twin.sim.taxels.reading import read_after
from t2twin.sim.taxels.spec import Imperfections
from t2twin.translate.evaluation.evaluate import as_readings
from t2twin.translate.inference.estimate import Estimate

ARRAY = taxel_array()
LAYOUT, COUNTS, RECORDED = ARRAY.layout, ARRAY.spec.counts, ARRAY.spec.imperfections["recorded"]
FRAME_S = 1.0 / (COUNTS.rate_hz or 0.0)  # it states its rate
SAMPLE_S = COUNTS.readings * FRAME_S
LEVEL = 10_000.0
QUIET = structs.replace(
    RECORDED, noise_counts=(), offset_ratios=(), load_noise_counts=0.0, memory_spread=0.0
)
"""The memory alone, the same for all taxels."""


REAL = {
    "untouched_noise_counts": {"10": 6, "25": 26, "50": 74, "75": 160, "90": 262, "99": 448},
    "untouched_offset_counts": {"10": 4, "50": 51, "90": 319, "99": 781},
    "kept_percent": {"100": 4.0, "200": 3.5, "500": 2.7, "1000": 2.1},
}
"""373 public recordings of fingers on a CySkin (ladylou899/ros2_ws_cyskin_project): percentiles
over the taxels of deviation and mean, and share of a level after milliseconds, percent."""
ZEROS = {1: 0.466, 5: 0.151}
"""Share of zeros in 41 of them without a finger, by the number of readings averaged."""


def frames(levels, flaws, seed=0, array=0):
    """Single readings at these levels, one each FRAME_S, (frames, n)."""
    rng, memory, found = np.random.default_rng(seed), None, []
    for level in levels:
        counts, memory = read_after(
            memory, np.full(LAYOUT.size, level), LAYOUT, flaws, COUNTS, rng, array, FRAME_S, 1
        )
        found.append(counts.astype(float))
    return np.array(found)


def remaining(time_s):
    """The share of a level that remains a time after release."""
    terms = zip(RECORDED.memory_shares, RECORDED.memory_s, strict=True)
    return sum(share * np.exp(-time_s / constant) for share, constant in terms)


@pytest.fixture(scope="module")
def twin():
    return t2twin.Twin(imperfections="recorded")


@pytest.fixture(scope="module")
def shape():
    return t2twin.load_shape("hemisphere-4")


def test_noise_and_offset_without_contact_have_the_recorded_percentiles():
    at_rest = np.hstack([frames(np.zeros(30), RECORDED, seed, seed) for seed in range(60)])
    for name, values in (
        ("untouched_noise_counts", at_rest.std(axis=0)),
        ("untouched_offset_counts", at_rest.mean(axis=0)),
    ):
        found = np.percentile(values, [float(key) for key in REAL[name]])
        np.testing.assert_allclose(found, list(REAL[name].values()), rtol=0.2)
    for count, share in ZEROS.items():
        means = at_rest.reshape(-1, count, at_rest.shape[1]).mean(axis=1)
        assert (np.rint(means) == 0).mean() == pytest.approx(share, abs=0.03)


def test_readings_at_rest_have_the_mean_and_deviation_of_the_array():
    found = frames(np.zeros(4000), RECORDED)
    mean, std = reading.expected_reading(RECORDED, COUNTS, np.zeros(LAYOUT.size))
    np.testing.assert_allclose(found.mean(axis=0), mean, atol=0.5, rtol=0.1)
    deviation = std * np.sqrt(COUNTS.readings)
    np.testing.assert_allclose(found.std(axis=0), deviation, atol=1.0, rtol=0.5)


def test_an_estimate_of_noiseless_counts_becomes_one_of_readings(tmp_path):
    """An exact estimate covers 90 % of the readings of its presses, and has no bias."""
    info = make_dataset(tmp_path / "data", "smoke", shapes=("hemisphere-4",), workers=1)
    rng = np.random.default_rng(3)
    truth = rng.uniform(0.0, 12_000.0, (400, LAYOUT.size)).astype(np.float32)
    truth[rng.random(truth.shape) < 0.5] = 0.0
    none = np.zeros_like(truth)
    exact = Estimate(40_000.0, truth, none)
    estimate = as_readings(exact, info)
    readings = np.stack(
        [read_after(None, row, LAYOUT, RECORDED, COUNTS, rng)[0].astype(float) for row in truth]
    )
    low, high = estimate.interval(0.9)
    inside = (low <= readings) & (readings <= high)
    assert inside.mean() == pytest.approx(0.9, abs=0.03)
    known = replace(exact, array=SensorPair().array.for_dataset())
    np.testing.assert_array_equal(known.interval(0.9, reading=True), (low, high))
    np.testing.assert_array_equal(known.interval(0.9), (truth, truth))
    with pytest.raises(T2TwinError, match="noise of this run's array is unknown"):
        exact.interval(0.9, reading=True)
    bias = (readings - estimate.counts).mean(axis=0)
    np.testing.assert_allclose(bias, 0.0, atol=40)
    assert (
        as_readings(exact, replace(info, target=structs.replace(info.target, imperfections=None)))
        is exact
    )


@pytest.mark.parametrize("level", [300.0, 3_000.0, 14_000.0])
def test_noise_grows_under_load(level):
    flaws = Imperfections(load_noise_counts=50.0, load_noise_level_counts=1500.0)
    expected = 50.0 * (1 - np.exp(-level / 1500.0))
    assert frames(np.full(400, level), flaws).std() == pytest.approx(expected, rel=0.03)


def test_the_memory_decays_by_its_law():
    after = frames([LEVEL] * 3 + [0.0] * 20, QUIET)[3:]
    times_s = FRAME_S * np.arange(1, 21)
    expected = LEVEL * np.array([remaining(time_s) for time_s in times_s])
    np.testing.assert_allclose(after, np.tile(expected[:, None], LAYOUT.size), atol=0.51)
    assert after[0, 0] == pytest.approx(LEVEL * REAL["kept_percent"]["100"] / 100, rel=0.2)


def test_a_sample_is_the_mean_of_its_readings_and_has_their_memory():
    pressed = np.full((2, LAYOUT.size), LEVEL)
    at, released = np.random.default_rng(0), np.zeros(LAYOUT.size)
    counts, memory = read_after(pressed, released, LAYOUT, QUIET, COUNTS, at)
    expected = LEVEL * np.mean([remaining(FRAME_S * n) for n in range(1, COUNTS.readings + 1)])
    assert counts == pytest.approx(np.full(LAYOUT.size, expected), abs=0.51)
    half = pressed
    for _ in range(2):
        half = read_after(half, released, LAYOUT, QUIET, COUNTS, at, seconds=SAMPLE_S / 2)[1]
    assert half == pytest.approx(memory)


def test_arrays_differ_and_each_has_the_whole_distribution():
    flaws = Imperfections(noise_counts=((0, 0), (100, 1000)), offset_counts=((0, 4000),))
    spreads = [
        np.sort(frames(np.full(500, 20_000), flaws, 1, array).std(axis=0)) for array in (0, 1)
    ]
    for spread in spreads:
        np.testing.assert_allclose(spread, 50 * (np.arange(20) + 0.5), atol=120)
    one, same, other = (frames([0.0], RECORDED, 3, array) for array in (0, 0, 1))
    assert np.array_equal(one, same) and not np.array_equal(one, other)


def test_the_memory_goes_along_a_path(twin, shape):
    commands = path_commands(shape.name, [[0, 0, 0, 8], *2 * [[0, 0, 0, 0]]])
    rng = np.random.default_rng(1)
    touches = list(touches_along(twin._pair, shape, commands, None, rng, ARRAY.name))
    level = np.rint(ARRAY.noiseless(touches[0].cyskin, LAYOUT))
    for touch, time_s in zip(touches, (0.0, SAMPLE_S, 2 * SAMPLE_S), strict=True):
        decay = np.exp(-time_s / np.array(RECORDED.memory_s))
        assert touch.of_array.memory == pytest.approx(decay[:, None] * level, abs=0.51)
    alone = twin._pair.press(shape, commands[1], np.random.default_rng(1), only=ARRAY.name)
    most = level.argmax()
    assert touches[1].counts[most] > alone.counts[most]


def test_a_slide_continues_the_memory_of_its_touch(twin, shape):
    command = PressCommand(shape.name, 0.0, 0.0, 0.0, 8.0)
    touch = twin._pair.press(shape, command, np.random.default_rng(0), only=ARRAY.name)
    slid, again = (twin.slide(touch, dx_mm=0.2, force_n=1, steps=1, seed=1)[0] for _ in range(2))
    assert np.array_equal(slid.counts, again.counts)
    readings = {ARRAY.name: replace(touch[ARRAY.name], memory=None)}
    fresh = twin.slide(replace(touch, readings=readings), dx_mm=0.2, force_n=1, steps=1, seed=1)[0]
    most = touch.counts.argmax()
    assert (slid.of_array.memory > fresh.of_array.memory + 500)[:, most].all()
    assert slid.counts[most] > fresh.counts[most]
