"""Frames and background frames of sampled units: own ones agree, others are named."""

import numpy as np
import pytest
from PIL import Image

from t2twin.sim.optical.artifacts import Artifacts, with_artifacts
from t2twin.sim.optical.units import UnitRanges, sample_unit
from t2twin.sim.sensors.pair import SensorPair
from t2twin.translate.data.images import to_pixels
from t2twin.translate.training.fit_frame_check import FORWARD
from t2twin.translate.uncertainty.ood import OODClass, classify_frame, compare_with_background

DIGIT = SensorPair.of(frames=1).camera
LEDS = DIGIT.spec.light.leds
SIZE, UNITS = 96, 40
ASPECT = DIGIT.camera.columns / DIGIT.camera.rows


def pixels(frame: np.ndarray) -> np.ndarray:
    return to_pixels(Image.fromarray(frame), SIZE, grey=False)


@pytest.fixture(scope="module")
def units() -> tuple[np.ndarray, np.ndarray]:
    """Frames without contact, and background frames; every second unit has artifacts."""
    frames, backgrounds = [], []
    for number in range(UNITS):
        rng = np.random.default_rng([8, number])
        unit = sample_unit(rng, DIGIT.spec, UnitRanges())
        if number % 2:
            unit = with_artifacts(rng, unit, Artifacts(), LEDS)
        digit = DIGIT.with_unit(unit)
        backgrounds.append(pixels(digit.background_frame(rng)))
        frames.append(pixels(digit.image(None, rng)))
    return np.array(frames), np.array(backgrounds)


def test_frames_agree_with_their_own_background_only(units):
    frames, backgrounds = units
    assert set(compare_with_background(frames, backgrounds)) == {OODClass.IN_DISTRIBUTION}
    others = np.roll(backgrounds, 1, axis=0)
    assert OODClass.IN_DISTRIBUTION not in compare_with_background(frames, others)


@pytest.mark.parametrize("kind", FORWARD)
def test_transforms_are_named(units, kind: OODClass):
    frames, backgrounds = units
    found = compare_with_background(np.ascontiguousarray(FORWARD[kind](frames)), backgrounds)
    assert found.count(kind) >= 0.95 * UNITS  # in a grey light, red equals blue


def test_frames_at_their_own_size():
    even = np.full((320, 240, 3), 90, np.uint8)
    noise = np.random.default_rng(0).integers(0, 256, even.shape, dtype=np.uint8)
    for frame in (even, even[:, :, 0], np.full((640, 480), 90, np.uint8)):
        assert classify_frame(frame, ASPECT) == OODClass.IN_DISTRIBUTION
    assert classify_frame(noise, ASPECT) == classify_frame(noise[..., 0], ASPECT) == OODClass.NOISE
    for frame, background in ((even[:240], None), (even, even[:240]), (even[:1, :1], None)):
        assert classify_frame(frame, ASPECT, background) == OODClass.OTHER_ASPECT
    turned = OODClass.ROTATED_LEFT
    assert classify_frame(even[:240], ASPECT, None, turned) == turned
    assert classify_frame(even[:240], ASPECT, None, OODClass.OTHER) == OODClass.OTHER_ASPECT
    assert classify_frame(even, ASPECT, None, OODClass.OTHER) == OODClass.OTHER


def test_real_frames_agree_with_their_background(real_digit):
    folder = real_digit
    background = np.asarray(Image.open(folder / "background.png").convert("RGB"))
    for path in sorted(folder.glob("press_*.png")):
        frame = np.asarray(Image.open(path).convert("RGB"))
        assert classify_frame(frame, ASPECT, background) == OODClass.IN_DISTRIBUTION
        classes = compare_with_background(pixels(frame)[None], pixels(background)[None])
        assert classes == [OODClass.IN_DISTRIBUTION], path.name
