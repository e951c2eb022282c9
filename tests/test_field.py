"""The field translator: trained on a small recipe, read at any layout, calibrated."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file, save_file

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.sampling.recipe import load_recipe
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.taxels.layout import load_layout
from t2twin.sim.taxels.pads import reading_matrix
from t2twin.translate.data.images import to_input
from t2twin.translate.data.pairs import Examples, load_info, load_pairs
from t2twin.translate.evaluation.evaluate import evaluate, read_predictions
from t2twin.translate.evaluation.metrics import uncertainty_metrics
from t2twin.translate.evaluation.records import read_evaluation
from t2twin.translate.inference.estimate import Estimate
from t2twin.translate.inference.files import translate_images
from t2twin.translate.inference.load import load_run
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.field_net import SCALE, FieldNet, grid_of, resampling_weights
from t2twin.translate.models.presets import PRESETS
from t2twin.translate.training.train import recalibrate, train
from t2twin.translate.uncertainty.calibration import (
    HALF_WIDTH,
    Errors,
    fit_calibration,
    interpolate_scale,
    standard_deviation,
)
from t2twin.translate.uncertainty.ood import OODClass

pytestmark = pytest.mark.filterwarnings("ignore::t2twin.core.errors.T2TwinWarning")

ARRAY = SensorPair().array
DENSE = ARRAY.dense

RECIPE = """
name = "tiny"
seed = 5
imperfections = "white"

[[parts]]
shapes = "random"
count = 8
presses = 4
place = { normal_mm = 2.5 }
force_n = { low = 1.0, high = 10.0 }
background_share = 0.1
val_share = 0.25

[light]
kind = "drawn"
"""

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recipe")
    recipe = folder / "tiny.toml"
    recipe.write_text(RECIPE)
    make_dataset(folder / "data", recipe=load_recipe(str(recipe)), workers=1)
    return folder / "data"


@pytest.fixture(scope="module")
def run_dir(data_dir: Path) -> Path:
    folder = data_dir.parent / "run"
    train("field", data_dir, "smoke", folder, epochs=2)
    return folder


@pytest.fixture
def run(run_dir: Path) -> TrainedTranslator:
    return load_run(run_dir)


@pytest.fixture(scope="module")
def frame(data_dir: Path) -> np.ndarray:
    pairs = load_pairs(data_dir, "val", 64, grey=False)
    return pairs.images[:1][0]


def translator_of(run: TrainedTranslator) -> FieldTranslator:
    return cast(FieldTranslator, run.translator)


def test_pairs_hold_their_field_and_their_own_digits_frame(data_dir: Path) -> None:
    pairs = load_pairs(data_dir, "train", 64, grey=False, with_dense_counts=True)
    info = load_info(data_dir)
    assert pairs.dense_counts is not None and pairs.backgrounds is not None
    own = reading_matrix(DENSE, info.array.taxels, ARRAY.elastomer) @ pairs.dense_counts.T
    assert np.abs(own.T - pairs.counts).max() < 40  # the reading's noise alone
    pictures = pairs.inputs[:]
    assert pictures.shape == (len(pairs), 64, 64, 6)
    few = pairs.subset(np.array([3, 1]))
    np.testing.assert_array_equal(few.inputs[:], pictures[[3, 1]])
    np.testing.assert_array_equal(few.dense_counts, pairs.dense_counts[[3, 1]])


def test_a_turned_picture_is_told_by_the_background_frame(data_dir, run):
    pixels = load_pairs(data_dir, "train", 64, grey=False, with_dense_counts=True).inputs[:]
    assert set(run.classify(pixels)) == {OODClass.NOT_COMPARED}  # of too few images
    for turned, how in (
        (pixels[:, ::-1, ::-1], "upside down"),
        (pixels[:, :, ::-1], "mirrored"),
        (np.rot90(pixels, -1, (1, 2)), "on its side"),
    ):
        strange = np.concatenate([turned[..., :3], pixels[..., 3:]], axis=-1)
        found = list(map(str, run.classify(strange)))  # these small images show few patterns
        assert set(found) <= {how, "of another sensor than its background frame"}
        assert found.count(how) > 0.5 * len(found)
    others = np.concatenate([pixels[..., :3], np.roll(pixels[..., 3:], 4, axis=0)], axis=-1)
    assert OODClass.NOT_COMPARED not in run.classify(others)
    assert set(run.classify(others[..., :3])) == {OODClass.NOT_COMPARED}


def test_pairs_without_a_field_are_refused(small_dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(T2TwinError, match="have no dense counts; make a dataset with them"):
        train("field", small_dataset, "smoke", tmp_path / "run")
    assert not (tmp_path / "run" / "config.json").exists()


@pytest.mark.parametrize("pad_mm", [3.0, 6.0])
def test_any_layout_is_read_from_a_true_field(shapes, pad_mm: float) -> None:
    """What pads of any size count is known from the dense counts to a hundredth of the largest."""
    dense = load_layout("cyskin-63")
    layout = replace(dense, pad_diameter_mm=np.full(dense.size, pad_mm))
    for name, yaw in (("square-2", 0.3), ("pliers/teeth", 1.0)):
        shape = shapes(name)
        reading = ARRAY.read(ARRAY.press(shape, PressCommand(shape.name, 1.5, -2.0, yaw, 8.0)))
        true = ARRAY.noiseless(reading.contact, layout)
        matrix = reading_matrix(DENSE, layout, ARRAY.elastomer)
        read = matrix @ reading.dense_counts.astype(float)
        assert np.sqrt(np.square(read - true).mean()) < 0.01 * true.max()


def test_a_map_of_the_view_is_laid_where_the_view_lies() -> None:
    """A map that holds each cell's own x or y gives every place in the view its own."""
    places, view = DENSE, (6.25, 8.0)
    assert grid_of(places.x_mm) == (12, 18)
    reading = resampling_weights(places.x_mm, places.y_mm, view, 12)
    centers = (np.arange(12) + 0.5) / 12 * 2 - 1
    x, y = np.meshgrid(centers * view[0], centers * view[1])
    within = (np.abs(places.x_mm) < x.max()) & (np.abs(places.y_mm) < y.max())
    assert within.sum() > 20
    for cells, at in ((x, places.x_mm), (y, places.y_mm)):
        np.testing.assert_allclose((cells.ravel() @ reading)[within], at[within], atol=1e-5)
    beyond = (np.abs(places.x_mm) > view[0] + 0.6) | (np.abs(places.y_mm) > view[1] + 0.8)
    assert not reading[:, beyond].any()
    with pytest.raises(T2TwinError, match="columns of different lengths"):
        grid_of(np.array([0.0, 0.0, 1.0]))


def test_the_spread_takes_nothing_from_the_mean(data_dir: Path) -> None:
    """Its gradient ends in its own layers; and the mean has one in all the rest."""
    translator = FieldTranslator(PRESETS["field"]["smoke"], load_info(data_dir), CPU, False)
    said = translator.network(torch.randn(4, 6, 64, 64))
    (said["field_spread"].sum() + said["force_spread"].sum()).backward()
    touched = {n for n, p in translator.network.named_parameters() if p.grad is not None}
    assert touched and all("spread" in name for name in touched)
    said = translator.network(torch.randn(4, 6, 64, 64))
    (said["field"].sum() + said["force"].sum()).backward()
    own = {n for n, p in translator.network.named_parameters() if p.grad is not None} - touched
    weights = [n for n, _ in translator.network.named_parameters() if not n.startswith(SCALE)]
    rest = {n for n in weights if "spread" not in n}
    assert own == rest


def test_overfits_one_batch_and_knows_what_it_does_not_know(data_dir: Path) -> None:
    """Eight pairs seen again and again: dense counts to 2 % of full scale, the force to 20 %."""
    info, preset = load_info(data_dir), replace(PRESETS["field"]["smoke"], learning_rate=4e-3)
    pairs = load_pairs(data_dir, "train", preset.size, False, with_dense_counts=True)
    torch.manual_seed(0)
    translator = FieldTranslator(preset, info, CPU, False)
    translator.prepare(pairs)
    assert pairs.dense_counts is not None
    part = slice(8)
    known = (pairs.counts, pairs.dense_counts, pairs.force_n)
    targets = (torch.from_numpy(each[part].astype(np.float32)) for each in known)
    examples: Any = Examples(to_input(pairs.inputs[part].astype(np.float32) / 255.0), *targets)
    first = translator.step(examples)
    for step in range(80):
        if step == 64:  # so that batch norm's averages settle
            translator.optimizers["field"].param_groups[0]["lr"] = 1e-4
        last = translator.step(examples)
    assert last["field"] < first["field"] / 20 and last["spread"] < first["spread"] - 1
    estimated = SimpleNamespace(**translator.predict_all(examples.images))
    rmse = (estimated.dense_counts - examples.dense_counts).square().mean().sqrt().item()
    assert rmse < 0.02 * info.array.full_scale_counts
    assert (estimated.force_n - examples.force_n).abs().max() < 0.2 * examples.force_n.max()


def errors_of(true: torch.Tensor, spread: torch.Tensor, seed: int) -> Errors:
    """Errors of these true standard deviations, (P, F), of which a network says `spread`."""
    generator = torch.Generator().manual_seed(seed)
    force = torch.randn(len(true), generator=generator)
    dense_counts = true * torch.randn(true.shape, generator=generator)
    return Errors(dense_counts, spread, 0.5 * force, torch.ones(len(true)))


def test_intervals_hold_as_much_among_small_spreads_as_among_large() -> None:
    """Of spreads that are too small where they are small and too large where they are large."""
    spread = 0.01 * torch.exp(torch.randn(4000, 6, generator=torch.Generator().manual_seed(0)))
    errors = errors_of(0.02 * (spread / 0.01) ** 0.75, spread, 1)
    found = fit_calibration([errors])
    fresh = errors_of(0.02 * (spread / 0.01) ** 0.75, spread, 2)
    std = standard_deviation(spread.log(), found["place_knots"], found["press_knots"])
    held = (fresh.dense_counts.abs() <= HALF_WIDTH * std).float()
    by_size = held.flatten()[spread.flatten().argsort()].chunk(10)
    assert [float(part.mean()) for part in by_size] == pytest.approx([0.9] * 10, abs=0.02)
    ratio = float(std.square().mean() / errors.dense_counts.square().mean())
    assert ratio == pytest.approx(1.0, abs=0.1)
    factor = interpolate_scale(torch.zeros(1), found["force_knots"])
    assert float(factor) == pytest.approx(0.5, rel=0.06)


def test_errors_that_go_together_are_drawn_together() -> None:
    generator = torch.Generator().manual_seed(0)
    normal = torch.randn(4000, 3, generator=generator)
    mixed = 0.8 * normal[:, 0] + 0.6 * normal[:, 1]
    off = 0.06 * torch.stack([normal[:, 0], mixed, normal[:, 2]], dim=1)
    one = torch.ones(4000)
    found = fit_calibration([Errors(off, torch.full_like(off, 0.02), one, one)])
    assert found["correlation"].diagonal().tolist() == [1.0, 1.0, 1.0]
    assert float(found["correlation"][0, 1]) == pytest.approx(0.8, abs=0.05)
    assert float(found["correlation"][0, 2]) == pytest.approx(0.0, abs=0.05)
    assert torch.linalg.eigvalsh(found["correlation"]).min() > 0


@pytest.mark.parametrize("presses", [3, 40, 2000])
def test_a_larger_spread_never_makes_a_smaller_standard_deviation(presses: int) -> None:
    generator = torch.Generator().manual_seed(presses)
    spread = torch.exp(2 * torch.randn(presses, 5, generator=generator) - 5)
    found = fit_calibration([errors_of(torch.full_like(spread, 0.01), spread, 0)])
    steps = torch.linspace(-14.0, 2.0, 1000)
    std = steps + interpolate_scale(steps, found["place_knots"]).log()
    assert (std.diff() >= -1e-5).all()


def test_certainty_of_what_is_right_by_half() -> None:
    """Counts drawn from what is said are held as said; stds half as large hold less."""
    rng = np.random.default_rng(0)
    std = rng.uniform(100, 3000, (500, 20))
    truth = np.full((500, 20), 20_000.0)
    said = truth + std * rng.standard_normal(std.shape)
    force, nothing = np.full(500, 8.0), np.zeros((500, 1))

    def estimate(part: float) -> Estimate:
        forces: Any = {"force_n": np.full(500, 8.8), "force_std_n": np.full(500, 1.0)}
        return Estimate(4e4, said, part * std, nothing, nothing, **forces)

    right, bold = (uncertainty_metrics(estimate(part), truth, force) for part in (1.0, 0.5))
    for level, held in zip(right.levels, right.coverage, strict=True):
        assert held == pytest.approx(level, abs=0.015)
    assert bold.figures["coverage_percent"] == pytest.approx(58.9, abs=1.5)
    figures = right.figures
    assert figures["predicted_rmse_counts"] == pytest.approx(
        right.retained_rmse_counts[0], rel=0.03
    )
    assert figures["force_median_error_percent"] == pytest.approx(10.0)
    assert figures["force_coverage_percent"] == 100.0
    rising = np.tile(np.arange(500.0)[:, None] + 1, (1, 20))
    off = replace(
        estimate(1.0), counts=truth + rising * rng.standard_normal(std.shape), counts_std=rising
    )
    by_press = uncertainty_metrics(off, truth, force)
    # Errors as large as 1 to 500: the root mean square of the lower four fifths is 0.8 of all.
    assert by_press.figures["gain_percent"] == pytest.approx(20.0, abs=2.0)


def test_estimates(run: TrainedTranslator, frame: np.ndarray) -> None:
    one, several = run.estimate(frame), run.estimate([frame, frame[:, ::-1]])
    assert one.counts.shape == one.counts_std.shape == (20,) and one.dense_counts.shape == (216,)
    assert several.counts.shape == (2, 20)
    np.testing.assert_array_equal(run.predict(frame), one.counts)
    np.testing.assert_allclose(several.counts[0], one.counts, atol=0.5)
    assert one.force_n is not None and one.force_std_n is not None
    assert one.force_n.shape == () and one.force_std_n > 0 and (one.counts_std > 0).all()
    low, high = one.interval(0.9)
    assert (low >= 0).all() and (high <= 40_000).all() and (low <= one.counts).all()
    inside = (low > 0) & (high < 40_000)
    np.testing.assert_allclose((high - low)[inside], 2 * 1.6449 * one.counts_std[inside], rtol=1e-3)
    with pytest.raises(T2TwinError, match="level is 1; it must lie between 0 and 1"):
        one.interval(1.0)


def test_drawn_fields_spread_as_is_said(run: TrainedTranslator, frame: np.ndarray) -> None:
    estimated, drawn = run.estimate(frame), run.sample_dense_counts(frame, 3000, seed=1)
    assert drawn.shape == (3000, 216)
    clear = (estimated.dense_counts > 4 * estimated.dense_counts_std) & (
        estimated.dense_counts < 40_000 - 4 * estimated.dense_counts_std
    )
    if clear.any():
        ratio = drawn[:, clear].std(axis=0) / estimated.dense_counts_std[clear]
        assert np.abs(ratio - 1).max() < 0.1
    other = run.sample_dense_counts(frame, 3000, seed=2)
    assert (drawn >= 0).all() and not np.array_equal(drawn, other)
    np.testing.assert_array_equal(drawn, run.sample_dense_counts(frame, 3000, seed=1))
    for images, count in ((frame, 10**9), ([frame] * 3, 50_000)):
        with pytest.raises(T2TwinError, match="a whole number"):
            run.sample_dense_counts(images, count)


def test_a_taxel_between_places_is_as_unsure_as_they_are_together(run: TrainedTranslator) -> None:
    """Correlated errors give the sum of the weights, independent ones the root of squares."""
    translator = translator_of(run)
    dense = load_layout("cyskin-63")
    network = cast(FieldNet, translator.predictor)
    network.correlation.copy_(torch.full((216, 216), 0.9999) + 1e-4 * torch.eye(216))
    together = translator.read_at(dense)
    _ = together._factor
    network.correlation.copy_(torch.eye(216))
    apart = translator.read_at(dense)
    said = network(torch.zeros(1, 6, 64, 64)) | {"field_spread": torch.full((1, 216), -4.0)}
    sizes = [
        each.read(said)["counts_std"][0] / each.read(said)["dense_counts_std"][0, 0]
        for each in (together, apart)
    ]
    weights = torch.from_numpy(reading_matrix(DENSE, dense, ARRAY.elastomer)).float()
    torch.testing.assert_close(sizes[0], weights.sum(dim=1).abs(), atol=0.05, rtol=0)
    torch.testing.assert_close(sizes[1], weights.square().sum(dim=1).sqrt(), atol=1e-3, rtol=0)


def test_another_layout_and_other_pads(run: TrainedTranslator, frame: np.ndarray) -> None:
    dense = load_layout("cyskin-63")
    at_63 = run._at_layout(dense)
    estimated = at_63.estimate(frame)
    assert estimated.counts.shape == (63,) and at_63.config.data.array.layout == "cyskin-63"
    np.testing.assert_array_equal(estimated.dense_counts, run.estimate(frame).dense_counts)
    own = run.config.data.array.taxels
    assert run._at_layout(own) is run
    wide = run._at_layout(replace(own, pad_diameter_mm=np.full(20, 8.0)))
    assert wide is not run and not np.array_equal(wide.predict(frame), run.predict(frame))


def test_a_background_frame_counts(run: TrainedTranslator, data_dir: Path, frame) -> None:
    translator = translator_of(run)
    pairs = load_pairs(data_dir, "val", 64, False, with_dense_counts=True)
    assert pairs.backgrounds is not None
    own = run._estimate_pixels(pairs.inputs).counts[0]
    np.testing.assert_allclose(run.predict(frame, pairs.backgrounds[:1][0]), own, atol=1.0)
    assert np.abs(run.predict(frame) - own).max() > 1.0
    train_frames = load_pairs(data_dir, "train", 64, False, with_dense_counts=True).backgrounds
    assert train_frames is not None
    np.testing.assert_allclose(
        translator.predictor.mean_frame.numpy(),
        to_input(train_frames.mean()[None] / 255.0)[0].numpy(),
        atol=1e-5,
    )


def test_background_pairs_replace_a_share_of_the_training_pairs(data_dir: Path) -> None:
    preset = replace(PRESETS["field"]["smoke"], background_share=0.5)
    pairs = load_pairs(data_dir, "train", preset.size, False, with_dense_counts=True)
    batch = np.arange(len(pairs))
    translator = FieldTranslator(preset, load_info(data_dir), CPU, False)
    examples: Any = translator.examples(pairs, batch, np.random.default_rng(0))
    plain: Any = translator.examples(pairs, batch)
    replaced = (examples.images[:, :3] == examples.images[:, 3:]).flatten(1).all(dim=1)
    assert 0.3 < replaced.float().mean() < 0.7
    assert not examples.dense_counts[replaced].any() and not examples.force_n[replaced].any()
    kept = ~replaced
    for name in ("images", "dense_counts", "force_n"):
        assert torch.equal(getattr(examples, name)[kept], getattr(plain, name)[kept])


def test_tempered_on_several_recipes(run_dir, data_dir, small_dataset, tmp_path):
    """Of one recipe it finds what the training found; the mean stays as it was."""
    own = tmp_path / "run"
    shutil.copytree(run_dir, own)
    before = load_file(own / "best.safetensors")
    changed = {"place_knots", "press_knots", "force_knots", "correlation"}
    spoilt = before | {"place_knots": 7.0 + before["place_knots"]}
    save_file(spoilt, own / "best.safetensors")
    validation = len(load_pairs(data_dir, "val", 32, False))
    assert recalibrate(own, [data_dir]) == validation
    after = load_file(own / "best.safetensors")
    assert all(torch.equal(after[key], before[key]) for key in before.keys() - changed)
    assert (after["place_knots"][1].abs() < 4.0).all()
    for key in changed - {"correlation"}:
        torch.testing.assert_close(after[key], before[key], rtol=0.02, atol=0.02)
    with pytest.raises(T2TwinError, match="was trained on is missing"):
        recalibrate(own, [small_dataset])
    with pytest.raises(T2TwinError, match="have no dense counts"):
        recalibrate(own, [data_dir, small_dataset])


def test_translated_files_say_how_sure(run_dir: Path, data_dir: Path, frame, tmp_path) -> None:
    Image.fromarray(frame).save(tmp_path / "press.png")
    out = tmp_path / "out"
    counts = translate_images([tmp_path / "press.png"], out, run_dir)
    (entry,) = json.loads((out / "counts.json").read_text())["images"]
    std = load_run(run_dir).estimate(frame).counts_std
    stds = np.ceil(std).astype(int).tolist()
    assert entry["counts_std"] == stds and entry["force_n"] >= 0 and entry["force_std_n"] > 0
    rows = (out / "counts_std.csv").read_text().splitlines()
    assert rows[0].startswith("image,taxel_0") and rows[1].split(",")[1:] == list(map(str, stds))
    assert (out / "press.png").is_file()
    frame_file = tmp_path / "press.png"
    other = translate_images([frame_file], out, run_dir, background=frame_file, png=False)
    assert not np.array_equal(other, counts)
    assert json.loads((out / "counts.json").read_text())["background"] == str(frame_file)


def test_the_onnx_file_says_the_same(run: TrainedTranslator, frame, tmp_path) -> None:
    onnxruntime = pytest.importorskip("onnxruntime")
    from t2twin.translate.inference.load import export_onnx

    dense = load_layout("cyskin-63")
    run = run._at_layout(dense)._in_float32()
    assert export_onnx(run, tmp_path / "field.onnx") < 1.0
    session = onnxruntime.InferenceSession(tmp_path / "field.onnx")
    pixels = run.pixels_of([frame, frame[::-1]])
    images = pixels.astype(np.float32).transpose(0, 3, 1, 2) / 255.0
    names = [output.name for output in session.get_outputs()]
    assert names == [
        "counts", "tactile_images", "counts_std", "dense_counts", "dense_counts_std",
        "force_n", "force_std_n", "frame_features"
    ]  # fmt: skip
    for given, estimated in (
        ({}, run.estimate([frame, frame[::-1]], tactile=True)),
        ({"background": images[1:]}, run.estimate([frame, frame[::-1]], frame[::-1], tactile=True)),
    ):
        said = dict(zip(names, session.run(None, {"images": images, **given}), strict=True))
        for name in ("counts", "counts_std", "dense_counts", "dense_counts_std"):
            np.testing.assert_allclose(said[name], getattr(estimated, name), rtol=1e-3, atol=1.0)
        assert estimated.force_n is not None
        np.testing.assert_allclose(said["force_n"], estimated.force_n, rtol=1e-3)
        np.testing.assert_allclose(said["tactile_images"], estimated.tactile_images, atol=1.0)


def test_an_evaluation_says_how_right_it_is_in_that(run_dir, data_dir, tmp_path):
    evaluation = evaluate([run_dir], data_dir, "val", tmp_path / "val")
    assert read_evaluation(tmp_path / "val") == evaluation
    sure = evaluation.models["field"].uncertainty
    assert sure is not None and "force_median_error_percent" in sure.figures
    assert evaluation.models["mean-array"].uncertainty is None
    kept = read_predictions(tmp_path / "val")
    off = np.abs(kept.truth - kept.by_model["field"])
    held = (off <= 1.6448536 * kept.std_by_model["field"]).mean()
    assert sure.figures["coverage_percent"] == pytest.approx(100.0 * held)
    assert sure.retained_rmse_counts[0] == pytest.approx(
        evaluation.models["field"].overall["rmse_counts"]
    )
    assert "std of field" not in kept.by_model
