"""Frames that are not touches of a run's sensor are named, without a background frame too."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.translate.inference.field_predictor import FieldPredictor
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import require
from t2twin.translate.networks.frame_check import CLASSES, SIDE, FrameCheck
from t2twin.translate.runs.checkpoint import load_frame_check, save_weights
from t2twin.translate.runs.config import FRAME_CHECK, HOME
from t2twin.translate.training import fit_frame_check as fitting
from t2twin.translate.training.fit_frame_check import Frames
from t2twin.translate.training.wrong_frames import ALTERATIONS, FORWARD
from t2twin.translate.uncertainty.ood import INVERSE_TRANSFORMS, OODClass


def test_a_frame_is_wrong_above_the_limit_of_its_kind():
    check = FrameCheck().eval()
    check.limits.copy_(torch.tensor([0.0, torch.inf]))
    images = torch.randn(4, 6, 96, 96)
    with torch.no_grad():
        check.layers[-1].bias[0] = 100.0
        assert check.classify(images[:, :3]) == [CLASSES[0]] * 4
        check.layers[-1].bias[[0, 3]] = torch.tensor([-100.0, 100.0])
    assert check.classify(images[:, :3]) == [CLASSES[3]] * 4
    assert check.classify(images) == [CLASSES[0]] * 4  # below the other limit


def test_a_check_sees_the_light_and_its_difference_from_the_background():
    check, images = FrameCheck().eval(), torch.randn(2, 6, 64, 64)
    fine = images + torch.tensor([0.5, -0.5]).repeat(32)  # its mean over a pixel of the check is 0
    torch.testing.assert_close(check(fine), check(images), atol=1e-4, rtol=1e-4)
    images[:, 3:] = images[:, :3]
    torch.testing.assert_close(check(images), check(images[:, :3]))


def test_wrong_frames_are_what_their_class_says():
    rng = np.random.default_rng(0)
    frame = rng.integers(40, 90, (32, 24, 3)).astype(np.uint8)
    for kind, transform in FORWARD.items():
        undone = INVERSE_TRANSFORMS[kind](transform(frame[None]))
        np.testing.assert_array_equal(undone[0], frame)
    assert {*FORWARD} == {*INVERSE_TRANSFORMS}
    for alter in ALTERATIONS:
        found = alter(frame, rng)
        assert found.dtype == np.uint8 and found.shape[-1] == 3
        assert found.shape != frame.shape or (found != frame).any()


def test_a_run_gets_a_check_that_its_predictions_use(
    moving_dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    ignored = shutil.ignore_patterns(FRAME_CHECK)
    run_dir = shutil.copytree(HOME / "field", tmp_path / "run", ignore=ignored)
    assert not fitting.fit_frame_check(run_dir, moving_dataset)  # too few frames
    assert load_frame_check(run_dir) is None
    monkeypatch.setattr(fitting, "MIN_FRAMES", 2)
    fitting.complete(run_dir, moving_dataset)
    check = load_frame_check(run_dir)
    assert check is not None and torch.isfinite(check.limits).all()
    written = (run_dir / FRAME_CHECK).read_bytes()
    fitting.fit_frame_check(run_dir, moving_dataset)
    assert (run_dir / FRAME_CHECK).read_bytes() == written

    check.limits.fill_(-torch.inf)  # all frames are wrong
    save_weights(run_dir / FRAME_CHECK, check)
    run = require(load_run(run_dir), FieldPredictor, "the test")
    even = np.full((320, 240, 3), 90, np.uint8)
    assert run.classify_frames(even) != [OODClass.IN_DISTRIBUTION]
    (run_dir / FRAME_CHECK).write_bytes(b"not weights")
    run = require(load_run(run_dir), FieldPredictor, "the test")
    with pytest.raises(T2TwinError, match="is not a frame check"):
        run.classify_frames(even)


def frames_of(rng: np.random.Generator, units: int) -> Frames:
    """Frames that are red above, green at the left, and blue at the right, of some units."""
    down, across = np.meshgrid(*[np.linspace(-1.0, 1.0, SIDE)] * 2, indexing="ij")
    light = np.stack([-down, -across, across], axis=-1)
    right = light + 0.1 * rng.standard_normal((400, SIDE, SIDE, 3))
    others = rng.standard_normal((100, SIDE, SIDE, 3))
    number = np.arange(400) % units
    behind = right + number[:, None, None, None] / units
    origins = np.arange(0, 400, 4)
    return Frames(*(each.astype(np.float32) for each in (right, behind, others)), origins, number)


@pytest.mark.parametrize("units", [1, 40])
def test_a_check_names_frames_of_units_that_it_has_not_seen(units):
    frames = frames_of(np.random.default_rng(0), units)
    check, fresh = fitting.trained(frames, 0), frames_of(np.random.default_rng(1), units)
    assert torch.isfinite(check.limits).all()

    def named(images: np.ndarray) -> list[OODClass]:
        return check.classify(torch.from_numpy(np.ascontiguousarray(images.transpose(0, 3, 1, 2))))

    right = np.concatenate([fresh.right, fresh.backgrounds], axis=-1)
    for each in (fresh.right, right):
        assert named(each).count(OODClass.IN_DISTRIBUTION) >= 380
    for kind, transform in FORWARD.items():
        assert named(transform(fresh.right)).count(kind) >= 390, kind
    assert named(fresh.others).count(OODClass.OTHER) >= 95


def test_a_subset_keeps_what_its_frames_are_made_of():
    frames = frames_of(np.random.default_rng(0), 7)
    part = frames.subset(frames.units % 2 == 0)
    assert len(part.right) == (frames.units % 2 == 0).sum() and not (part.units % 2).any()
    for wrong, origin in zip(part.others, part.origins, strict=True):
        before = int(np.flatnonzero((frames.others == wrong).all(axis=(1, 2, 3)))[0])
        np.testing.assert_array_equal(part.right[origin], frames.right[frames.origins[before]])


def test_the_pretrained_run_names_turned_frames_without_a_background():
    run = require(load_run("field"), FieldPredictor, "the test")
    frame = t2twin.press("hemisphere-2", force_n=8, x_mm=3).image
    assert run.classify_frames(frame) == [OODClass.IN_DISTRIBUTION]
    for kind, transform in FORWARD.items():
        turned = np.ascontiguousarray(transform(frame[None])[0])
        assert run.classify_frames(turned) == [kind], kind
