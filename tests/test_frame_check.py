"""Frames that are not touches of a run's sensor are named, without a background frame too."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from msgspec import structs
from PIL import Image
from scipy.ndimage import gaussian_filter

import t2twin
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.core.frame_order import FrameOrder
from t2twin.sim.dataset.store import read_info, split_shards
from t2twin.translate.data.images import to_input
from t2twin.translate.inference.load import load_run
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.frame_check import CLASSES, SIDE, TRANSFORMED, FrameCheck, scores
from t2twin.translate.runs.checkpoint import build, load_frame_check, save_weights
from t2twin.translate.runs.config import FRAME_CHECK, HOME, load_config
from t2twin.translate.training import fit_frame_check as fitting
from t2twin.translate.training.fit_frame_check import ALTERATIONS, FORWARD, wrong_frame
from t2twin.translate.uncertainty.ood import INVERSE_TRANSFORMS, OODClass

pytestmark = pytest.mark.filterwarnings("ignore::t2twin.core.errors.T2TwinWarning")


@pytest.fixture(scope="module")
def run():
    return load_run("field")


def test_wrong_frames_are_what_their_class_says():
    rng = np.random.default_rng(0)
    frame = rng.integers(40, 90, (32, 24, 3)).astype(np.uint8)
    for kind, transform in FORWARD.items():
        undone = INVERSE_TRANSFORMS[kind](transform(frame[None]))
        np.testing.assert_array_equal(undone[0], frame)
    kinds = {wrong_frame(frame, seed)[1] for seed in range(60)}
    assert kinds == {*INVERSE_TRANSFORMS, OODClass.OTHER}
    for alter in ALTERATIONS.values():
        found = alter(frame, rng)
        assert found.dtype == np.uint8 and found.shape[-1] == 3
        assert found.shape != frame.shape or (found != frame).any()


@pytest.mark.parametrize("order", [
    FrameOrder(bgr=True), FrameOrder(270, mirror=True), FrameOrder(mirror=True, bgr=True),
], ids=str)  # fmt: skip
def test_stored_frames_are_named_and_put_right(order: FrameOrder, tmp_path: Path) -> None:
    touch = t2twin.press("hemisphere-4", force_n=4)
    own = {"background": t2twin.Twin().background, "image": touch.image}
    files = {name: tmp_path / f"{name}.png" for name in own}
    for name, frame in own.items():
        stored = frame[..., ::-1] if order.bgr else frame
        stored = np.rot90(stored[:, ::-1] if order.mirror else stored, order.turn_deg // 90)
        np.testing.assert_array_equal(order.upright(stored), frame)
        Image.fromarray(np.ascontiguousarray(stored)).save(files[name])
    given = {"background": files["background"], "png": False}
    with pytest.warns(T2TwinWarning, match=f"stored in the order {order} "):
        t2twin.translate_images([files["image"]], tmp_path / "wrong", **given)
    counts = t2twin.translate_images([files["image"]], tmp_path / "right", **given, order=order)
    expected = t2twin.load().predict(own["image"], own["background"])
    np.testing.assert_allclose(counts[0], expected, rtol=1e-4, atol=0.01)
    with pytest.warns(T2TwinWarning, match="background frame is rotated"):
        t2twin.load().predict(own["image"], np.ascontiguousarray(np.rot90(own["background"])))
    with pytest.warns(T2TwinWarning) as cropped:
        t2twin.load().predict(own["image"][:200], own["background"])
    assert not any("rotated" in str(each.message) for each in cropped)


def test_a_run_gets_a_check_that_its_predictions_use(moving_dataset, tmp_path, monkeypatch):
    ignored = shutil.ignore_patterns(FRAME_CHECK)
    run_dir = shutil.copytree(HOME / "field", tmp_path / "run", ignore=ignored)
    fitting.fit_frame_check(run_dir, moving_dataset)
    assert load_frame_check(run_dir) is None  # too few frames
    monkeypatch.setattr(fitting, "MIN_FRAMES", 2)
    fitting.fit_frame_check(run_dir, moving_dataset)
    check = load_frame_check(run_dir)
    assert check is not None and torch.isfinite(check.limits).all()
    check.limits.fill_(-torch.inf)  # all frames are wrong
    save_weights(run_dir / FRAME_CHECK, check.state_dict())
    run = load_run(run_dir)
    even = np.full((320, 240, 3), 90, np.uint8)
    assert run.classify_frames(even) != [OODClass.IN_DISTRIBUTION]
    unknown, other = FrameCheck(check.center.numel()), FrameCheck(8)
    unknown.center.fill_(torch.nan)
    for each, words in ((unknown, "is not a frame check"), (other, "of another run")):
        save_weights(run_dir / FRAME_CHECK, each.state_dict())
        run = load_run(run_dir)
        with pytest.raises(T2TwinError, match=words):
            run.classify_frames(even)


def test_near_units_are_not_other_units_and_drift(moving_dataset: Path) -> None:
    config, info = load_config(HOME / "field"), read_info(moving_dataset)
    assert info.recipe is not None
    light = structs.replace(info.recipe.light, optics="unit.npz")
    near = replace(info, recipe=structs.replace(info.recipe, light=light))
    drifting = structs.replace(config, preset=replace(config.preset, drift=0.2))
    translator, [shard, *_] = build(config), split_shards(info, "train")
    assert isinstance(translator, FieldTranslator)
    plain, of_one, moved = (
        fitting._part(translator, *each, 100, np.random.default_rng(0))
        for each in (
            (config, moving_dataset, shard, info),
            (config, moving_dataset, shard, near),
            (drifting, moving_dataset, shard, near),
        )
    )
    other = CLASSES.index(OODClass.UNLIKE_BACKGROUND)
    assert other in plain[1] and other not in of_one[1]
    (without, _), (behind, _) = plain[0]
    (same, _), (drifted, _) = moved[0]
    torch.testing.assert_close(same, without)
    assert (drifted - behind).abs().max() > 0.01


def test_turned_frames_are_named_without_a_background_and_with_one_turned_alike(run) -> None:
    twin = t2twin.Twin()
    frame, background = twin.press("hemisphere-2", force_n=8.0, x_mm=3.0).image, twin.background
    assert run.classify_frames(frame) == [OODClass.IN_DISTRIBUTION]
    assert run.classify_frames(frame, background) == [OODClass.IN_DISTRIBUTION]
    for none in ([], np.zeros((0, 320, 240, 3), np.uint8)):
        assert run.predict(none).shape == run.predict(none, background).shape == (0, 20)
    for kind, transform in FORWARD.items():
        turned, behind = (transform(each[None])[0].copy() for each in (frame, background))
        assert run.classify_frames(turned) == [kind], kind
        if kind in (OODClass.MIRRORED, OODClass.UPSIDE_DOWN_MIRRORED, OODClass.BLUE_FIRST):
            assert run.classify_frames(turned, behind) != [OODClass.IN_DISTRIBUTION], kind


@pytest.mark.parametrize("shape", ["hemisphere-4", "pliers/teeth"])
def test_shifted_torn_and_blurred_frames_are_named(run, shape: str) -> None:
    twin = t2twin.Twin()
    frame = twin.press(shape, force_n=6.0, y_mm=2.0, seed=1).image
    torn = np.concatenate([frame[:160], np.roll(frame[160:], 40, axis=1)])
    shifted = [np.roll(frame, 10, axis=axis) for axis in (0, 1)]
    found = run.classify_frames([frame, *shifted, torn], twin.background)
    assert found == [OODClass.IN_DISTRIBUTION, *[OODClass.SHIFTED] * 3]
    noise = 4.0 * np.random.default_rng(0).standard_normal((2, *frame.shape))
    noisy, behind = (np.stack([frame, twin.background]) + noise).clip(0, 255).astype(np.uint8)
    found = run.classify_frames([noisy, gaussian_filter(noisy, 8.0, axes=(0, 1))], behind)
    assert found == [OODClass.IN_DISTRIBUTION, OODClass.BLURRED]


def test_a_force_outside_the_training_is_named(run) -> None:
    twin = t2twin.Twin()
    assert run.config.data.force_n == (0.4, 15.0)
    forces_n = {"square-2": (0.1, 25.0), "hemisphere-4": (0.1, 18.0), "random-12": (0.1, 30.0)}
    for shape, outside in forces_n.items():
        frames = [twin.press(shape, force_n=n, seed=3).image for n in (*outside, 0.5, 5.0)]
        found = run.estimate([*frames, twin.background], twin.background).ood_class
        assert found.tolist() == [OODClass.FORCE] * 2 + [OODClass.IN_DISTRIBUTION] * 3, shape


def test_a_background_frame_that_shows_a_contact_is_named(run) -> None:
    twin = t2twin.Twin()
    frame, touched = (
        twin.press(shape, force_n=4.0, seed=0).image for shape in ("hemisphere-2", "square-2")
    )
    assert run.classify_frames(frame, touched) == [OODClass.TOUCHED_BACKGROUND]
    assert run.classify_frames(frame, twin.background) == [OODClass.IN_DISTRIBUTION]
    assert run.classify_frames(twin.background, frame) == [OODClass.TOUCHED_BACKGROUND]
    y, x = np.indices(frame.shape[:2])  # a ray of light in the gel, which changes the force
    ray = 1.0 + 0.5 * np.exp(-np.square((x - 0.5 * y - 30.0) / 10.0))[..., None]
    lit, behind = ((each * ray).clip(0, 255).astype(np.uint8) for each in (frame, twin.background))
    assert run.classify_frames(lit, behind) == [OODClass.IN_DISTRIBUTION]
    found = run.shows_contact([frame, twin.background, lit, behind])
    assert found == [True, False, True, False]


def colored(rng: np.random.Generator, number: int) -> np.ndarray:
    """Frames that are red above, green at the left and blue at the right, with noise."""
    down, across = np.meshgrid(*[np.linspace(-1.0, 1.0, SIDE)] * 2, indexing="ij")
    light = 0.5 + 0.2 * np.stack([-down, -across, across], axis=-1)
    noise = 0.1 * rng.standard_normal((number, SIDE, SIDE, 3))
    return (light + noise).clip(0.0, 1.0).astype(np.float32)


def test_transforms_of_fresh_frames_are_named(moving_dataset, monkeypatch) -> None:
    rng, check = np.random.default_rng(0), FrameCheck(2)
    parts = {split: colored(rng, 300) for split in ("train", "val")}
    monkeypatch.setattr(fitting, "_small_frames", lambda _, split, *__: parts[split])
    config = load_config(HOME / "field")
    fitting._fit_transform_net(check, config, moving_dataset, moving_dataset)
    network, limit = check.transforms, check.limits[TRANSFORMED]
    fresh = colored(rng, 200)
    with torch.inference_mode():
        assert (scores(network(to_input(fresh))) > limit).sum() <= 6
        for kind in FORWARD:
            logits = network(to_input(np.ascontiguousarray(FORWARD[kind](fresh))))
            assert (scores(logits) > limit).all(), kind
            assert (logits.argmax(dim=1) == CLASSES.index(kind)).all(), kind
    assert list(FORWARD) == list(CLASSES[1 : 1 + len(FORWARD)])
