"""The contact that field runs predict: training, estimates, files, calibration, evaluation."""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file, save_file

import t2twin
from maintenance.publish_pretrained import publish_pretrained
from t2twin.cli import main
from t2twin.core.errors import T2TwinWarning
from t2twin.core.images import decode_png
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.store import lists, read_split
from t2twin.translate.data.pairs import load_pairs
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.evaluation.records import read_evaluation
from t2twin.translate.evaluation.table import results_tables
from t2twin.translate.inference.estimate import (
    DISAGREE_NOTE,
    EDGE_NOTE,
    EMPTY_NOTE,
    PNG_MM,
    PNG_ZERO,
    ContactEstimate,
    contacts_of,
)
from t2twin.translate.inference.load import PARITY_COUNTS, export_onnx, load, open_onnx
from t2twin.translate.models.field import (
    CENTER,
    MAPS,
    center_of_pressure,
    contact_scale,
    fit_contact_knots,
    fit_contact_limits,
    read_contact,
)
from t2twin.translate.models.field_net import CONTACT, SCALE, FieldNet
from t2twin.translate.runs.checkpoint import average_runs
from t2twin.translate.runs.config import BEST, CONFIG, FRAME_CHECK, HOME, load_config
from t2twin.translate.training.train import train
from t2twin.translate.uncertainty.ood import OODClass

pytestmark = pytest.mark.filterwarnings("ignore::t2twin.core.errors.T2TwinWarning")

RECIPE = """
name = "few-maps"
seed = 3
contact_maps = true
[[parts]]
shapes = "random"
count = 4
presses = 4
place = { normal_mm = 1.0 }
force_n = { low = 2.0, high = 6.0 }
val_share = 0.25
[light]
kind = "drawn"
"""

VIEW_MM = (6.25, 8.333)


def write_few(folder: Path) -> None:
    path = folder.parent / f"{folder.name}.toml"
    path.write_text(RECIPE)
    make_dataset(folder, recipe=path, workers=1)


@pytest.fixture(scope="module")
def few(products) -> Path:
    """A dataset of 12 training and 4 validation pairs with contact maps."""
    return products.make("few-maps", write_few)


def write_plain(folder: Path) -> None:
    shutil.copytree(HOME / "field", folder, dirs_exist_ok=True)
    config = json.loads((folder / CONFIG).read_text())
    config["data"].pop("has_contact", None)
    config.pop("contact_info_sha256", None)
    (folder / CONFIG).write_text(json.dumps(config))
    weights = load_file(folder / BEST)
    save_file({n: each for n, each in weights.items() if not n.startswith(CONTACT)}, folder / BEST)


@pytest.fixture(scope="module")
def plain(products) -> Path:
    """The pretrained run without layers of the contact."""
    return products.make("plain", write_plain)


@pytest.fixture(scope="module")
def alone(few, plain, products) -> Path:
    """The same with new layers of the contact, after one step."""
    asked: dict[str, Any] = {"epochs": 1, "init_from": plain, "contact_alone": True}
    return products.make("contact-alone", lambda to: train("field", few, "cpu", to, **asked))


@pytest.fixture(scope="module")
def images(few) -> tuple[list[np.ndarray], np.ndarray]:
    """Two images of one unit, and its background frame."""
    rows = read_split(few, "val", ["source_image", "source_background"]).to_pylist()[:2]
    found = [decode_png(row["source_image"]["bytes"]) for row in rows]
    return found, decode_png(rows[0]["source_background"]["bytes"])


def test_the_contact_alone_leaves_all_other_predictions_as_they_are(alone, plain, images) -> None:
    before, after = load_file(plain / BEST), load_file(alone / BEST)
    assert all(name.startswith((CONTACT, SCALE)) for name in after.keys() - before.keys())
    for name, tensor in before.items():
        assert torch.equal(tensor.float(), after[name].float()), name
    frame_checks = [(folder / FRAME_CHECK).read_bytes() for folder in (plain, alone)]
    assert frame_checks[0] == frame_checks[1]
    theirs, ours = load_config(plain), load_config(alone)
    assert ours.data.has_contact and ours.data.sha256 == theirs.data.sha256
    assert ours.contact_data not in (None, theirs.data.sha256)
    of_field, of_alone = (load(run, engine="torch") for run in (plain, alone))
    frames, background = images
    expected, found = (run.estimate(frames, background) for run in (of_field, of_alone))
    for name in ("counts", "counts_std", "dense_counts", "force_n", "force_std_n", "shear_n"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.ood_class.tolist() == expected.ood_class.tolist()


def test_the_estimate_has_the_size_of_the_image_and_the_force_of_the_run(alone, images) -> None:
    run, (frames, background) = load(alone), images
    contacts = run.contact([frames[0], frames[1][::2, ::2]], background)
    assert [each.depth_mm.shape for each in contacts] == [(320, 240), (160, 120)]
    contact, force = run.contact(frames[0], background), run.estimate(frames[0], background)
    assert contact.force_n == pytest.approx(force.force_n, rel=1e-3)
    assert contact.shear_n == pytest.approx(force.shear_n, abs=1e-3)
    assert contact.view_mm == pytest.approx(run.config.data.camera.view_mm)
    for name in ("depth_std_mm", "pressure_std_kpa"):
        assert (getattr(contact, name) > 0).all()
    assert contact.area_mm2 == pytest.approx(contact.mask.mean() * 4 * np.prod(contact.view_mm))


def test_onnx_files_predict_the_same_contact(alone, images, tmp_path) -> None:
    """With limits, so that there is no contact without background frames."""
    frames, background = images
    limited = shutil.copytree(alone, tmp_path / "limited")
    limits = {"contact_limits": torch.tensor([99.0, -99.0])}
    save_file(load_file(alone / BEST) | limits, limited / BEST)
    by_torch, by_onnx = load(limited, engine="torch"), load(limited, engine="onnx")
    for frame in (background, None):
        contacts = [run.contact(frames, frame) for run in (by_torch, by_onnx)]
        for one, other in zip(*contacts, strict=True):
            for name in ("depth_mm", "depth_std_mm", "probability", "pressure_std_kpa"):
                expected = getattr(one, name)
                np.testing.assert_allclose(getattr(other, name), expected, rtol=1e-3, atol=1e-4)
            surely = abs(one.probability - 0.5) > 1e-3
            np.testing.assert_array_equal(one.mask[surely], other.mask[surely])
            assert one.is_empty == other.is_empty and (frame is not None or one.is_empty)
    assert export_onnx(by_torch, tmp_path / "run.onnx") < PARITY_COUNTS
    session = open_onnx(tmp_path / "run.onnx")
    shapes = {each.name: each.shape[1:] for each in session.get_outputs()}
    assert all(shapes[name] == [48, 48] for name in MAPS)
    assert all(shapes[name] == [2] for name in CENTER)


def test_published_and_averaged_runs_keep_the_contact(alone, plain, images, tmp_path) -> None:
    frames, background = images
    published = publish_pretrained("mine", alone, home=tmp_path / "home")
    average_runs(plain, alone, 0.5, tmp_path / "mean")
    average_runs(tmp_path / "mean", alone, 0.5, tmp_path / "again")
    expected = load(alone, engine="torch").contact(frames[0], background)
    for run in (published, tmp_path / "mean", tmp_path / "again"):
        found = load(run, engine="torch").contact(frames[0], background)
        np.testing.assert_allclose(found.depth_mm, expected.depth_mm, atol=2e-3)
        assert found.force_n == pytest.approx(expected.force_n, rel=2e-3)


def test_the_command_writes_depth_and_contact_of_each_image(alone, images, tmp_path, capsys):
    frames, background = images
    for name, each in (("a", frames[0]), ("b", frames[1]), ("background", background)):
        Image.fromarray(each).save(tmp_path / f"{name}.png")
    line = "translate a.png b.png --target contact --background background.png --out out --run"
    main([*line.split(), str(alone)])
    assert "a.png: depth 0 mm, area" in capsys.readouterr().out
    contact = load(alone).contact(frames[0], background)
    levels = np.asarray(Image.open("out/a_depth.png")).astype(float)
    np.testing.assert_allclose((levels - PNG_ZERO) * PNG_MM, contact.depth_mm, atol=0.51 * PNG_MM)
    content = json.loads(Path("out/a.json").read_text())
    assert (content["depth_png_mm_per_level"], content["depth_png_level_of_zero"]) == (
        PNG_MM, PNG_ZERO,
    )  # fmt: skip
    with np.load("out/b.npz") as arrays:
        assert arrays["mask"].dtype == bool and arrays["pressure_kpa"].shape == (320, 240)
    ends = (".npz", ".json", "_depth.png", "_relief.png")
    written = {path.name for path in Path("out").iterdir() if not path.name.startswith(".")}
    assert written == {f"{name}{end}" for name in "ab" for end in ends} | {"contacts.csv"}
    rows = list(csv.DictReader(Path("out/contacts.csv").read_text().splitlines()))
    assert [row["image"] for row in rows] == ["a.png", "b.png"]
    assert float(rows[0]["force_n"]) == pytest.approx(float(contact.force_n), abs=1e-3)
    line = line.replace("b.png", "a.png --no-png").replace("out out", "out few")
    main([*line.split(), str(alone)])
    written = {path.name for path in Path("few").iterdir() if not path.name.startswith(".")}
    assert written == {"a.npz", "a.json", "a-2.npz", "a-2.json", "contacts.csv"}
    rows = list(csv.DictReader(Path("few/contacts.csv").read_text().splitlines()))
    assert [row["contact"] for row in rows] == ["a", "a-2"] and rows[0]["ood_class"]
    assert json.loads(Path("few/a-2.json").read_text())["image"] == "a.png"


def test_counts_and_contact_that_disagree_are_noted(images, tmp_path, capsys) -> None:
    """Of a run whose range contains no distance, in its estimate and in live lines."""
    frames, background = images
    strict = shutil.copytree(HOME / "field", tmp_path / "strict")
    content = json.loads((strict / CONFIG).read_text()) | {"agreement": {"counts_off_mm": [0, 0]}}
    (strict / CONFIG).write_text(json.dumps(content))
    usual, noted = (load(run).contact(frames[0], background) for run in ("field", strict))
    assert usual.agrees and usual.notes == () and noted.notes == (DISAGREE_NOTE,)
    with pytest.warns(T2TwinWarning, match=DISAGREE_NOTE):
        load(strict).estimate(frames, background, contact=True)
    (tmp_path / "frames").mkdir()
    Image.fromarray(frames[0]).save(tmp_path / "frames/0.png")
    Image.fromarray(background).save(tmp_path / "background.png")
    main(f"live frames --frames 1 --background background.png --run {strict}".split())
    said = capsys.readouterr()
    assert json.loads(said.out)["contact"] == noted.summary() and said.err.count(DISAGREE_NOTE) == 1


def test_true_counts_carry_the_force_at_its_place() -> None:
    """Some force is carried beyond the outermost places."""
    touch = t2twin.press("hemisphere-4", x_mm=1.0, y_mm=-2.0, force_n=4.0)
    outputs = {"dense_counts": np.tile(touch.of_array.dense_counts, (3, 1))}
    outputs["force_n"] = np.array([4.0, 8.0, 4.0])
    outputs["center_mm"] = np.array([(1.0, -2.0), (4.0, -2.0), (np.nan, np.nan)])
    off_mm, ratio = load("field")._differences(outputs).values()
    np.testing.assert_allclose(ratio, [1.0, 0.5, np.nan], rtol=0.03)
    np.testing.assert_allclose(off_mm, [0.0, 3.0, np.nan], atol=0.3)


def estimate_of(
    pressure: torch.Tensor, depth: torch.Tensor | None = None, size: tuple[int, int] = (96, 96)
) -> ContactEstimate:
    """The estimate of a sure prediction of a pressure and a depth, (1, H, H)."""
    probability, zero = (pressure > 0).float(), torch.zeros_like(pressure)
    maps = (zero if depth is None else depth, zero, pressure, zero, probability)
    centers = center_of_pressure(pressure, zero, VIEW_MM)
    found = zip((*MAPS, *CENTER), (*maps, *centers), strict=True)
    outputs = {name: each.numpy() for name, each in found} | {"force_n": np.ones(1)}
    return contacts_of(outputs, [size], VIEW_MM, [OODClass.IN_DISTRIBUTION])[0]


def test_empty_contacts_and_contacts_at_the_edge_are_named() -> None:
    pressure = torch.zeros(1, 48, 48)
    empty = estimate_of(pressure)
    assert empty.notes == (EMPTY_NOTE,) and np.isnan(empty.center_mm).all()
    assert empty.summary()["area_mm2"] == 0.0 and "center_mm" not in empty.summary()
    pressure[0, 20:28, 20:28] = 50.0
    inside = estimate_of(pressure)
    assert inside.notes == () and inside.center_mm == pytest.approx([0.0, 0.0], abs=1e-5)
    force_n = 1e-3 * 50.0 * 64 / 48**2 * 4 * np.prod(VIEW_MM)
    assert inside.force_in_view_n == pytest.approx(force_n, rel=1e-3)
    pressure[0, 0, 20:28] = 50.0
    assert estimate_of(pressure).notes == (EDGE_NOTE,)


def test_the_center_of_pressure_is_the_mean_place() -> None:
    pressure = torch.zeros(1, 4, 4)
    pressure[0, 0, 3], pressure[0, 2, 3] = 30.0, 10.0  # rows are y, columns x
    std = torch.zeros(1, 4, 4)
    std[0, 0, 0] = 4.0  # 3 mm to the left of the center
    center, spread = center_of_pressure(pressure, std, (2.0, 2.0))
    assert center[0].tolist() == pytest.approx([1.5, 0.75 * -1.5 + 0.25 * 0.5])
    assert spread[0].tolist() == pytest.approx([4.0 * 3.0 / 40.0, 4.0 * 0.5 / 40.0])


def test_training_reads_the_stored_maps(few) -> None:
    pairs = load_pairs(few, "train", 96, False, contact_side=48)
    assert pairs.contact is not None
    maps, table = pairs.contact[:].astype(float), read_split(few, "train")
    assert maps.shape == (12, 2, 48, 48)
    depth_mm = 1e-3 * lists(table, "source_depth_map_um").reshape(12, -1)
    pressure_kpa = 0.1 * lists(table, "source_pressure_map_hpa").reshape(12, -1)
    np.testing.assert_allclose(maps[:, 0].max(axis=(1, 2)), depth_mm.max(axis=1), rtol=0.1)
    np.testing.assert_allclose(maps[:, 1].mean(axis=(1, 2)), pressure_kpa.mean(axis=1), rtol=0.01)
    assert contact_scale(pairs.contact)[0] == pytest.approx(
        np.sqrt(np.square(maps[:, 0][maps[:, 1] > 5.0]).mean()), rel=1e-2
    )
    subset = pairs.subset(np.array([3, 5])).contact
    assert subset is not None
    np.testing.assert_array_equal(subset[:], pairs.contact[:][[3, 5]])


def small_network() -> FieldNet:
    torch.manual_seed(0)
    x, y = (each.ravel() for each in np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij"))
    return FieldNet(x, y, VIEW_MM, 64, 16, predicts_contact=True)


def contact_outputs(*values: torch.Tensor) -> dict[str, torch.Tensor]:
    """The outputs of a network without a limit of contact."""
    names = ("depth", "depth_spread", "pressure", "pressure_spread", "contact", "contact_limit")
    return dict(zip(names, (*values, torch.zeros(())), strict=True))


def test_calibrated_intervals_cover_what_they_promise() -> None:
    """Spreads are half the errors' standard deviations."""
    network, rng = small_network(), torch.Generator().manual_seed(1)
    network.contact_scale.copy_(torch.tensor([0.5, 100.0]))
    log_spread = torch.randn(40, 32, 32, generator=rng) * 0.5 - 2.0
    error = [2.0 * log_spread.exp() * torch.randn(40, 32, 32, generator=rng) for _ in range(2)]
    true = torch.rand(40, 2, 32, 32, generator=rng)
    scaled = true / network.contact_scale[:, None, None]
    depth, pressure = (scaled[:, n] + error[n] for n in range(2))
    outputs = contact_outputs(depth, log_spread, pressure, log_spread, torch.full_like(depth, 9.0))
    fit_contact_knots(network, VIEW_MM, [(outputs, true)])
    found = read_contact(network, outputs, VIEW_MM)
    covered = (found["depth_mm"] - true[:, 0]).abs() <= 1.645 * found["depth_std_mm"]
    assert covered.float().mean() == pytest.approx(0.9, abs=0.01)


def test_below_its_limit_an_image_has_no_contact() -> None:
    """1 % of the images without contact are above the limit, and 0.5 % of contacts below it."""
    network, many = small_network(), torch.linspace(-4.0, 2.0, 201)
    fit_contact_limits(network, [many, many[:5]], [many + 9.0, many + 9.0])
    assert network.contact_limits.tolist() == pytest.approx([1.94, 0.0], abs=1e-5)
    fit_contact_limits(network, [many, many - 9.0], [many + 5.0, many + 9.0])
    assert network.contact_limits.tolist() == pytest.approx([1.03, 0.0], abs=1e-5)
    logit = torch.full((2, 32, 32), -5.0)
    logit[0, 3, 3], logit[1, 3, 3] = 1.0, 1.1
    zero = torch.zeros_like(logit)
    outputs = contact_outputs(zero, zero, zero + 1.0, zero, logit)
    limits = ({"contact_limit": limit} for limit in network.contact_limits)
    found = (read_contact(network, outputs | limit, VIEW_MM) for limit in limits)
    largest = [each["probability"].amax(dim=(1, 2)) for each in found]
    assert (torch.stack(largest) > 0.5).tolist() == [[False, True], [True, True]]


def test_the_evaluation_has_the_errors_of_the_contact(alone, few, tmp_path) -> None:
    evaluate([alone], few, "val", tmp_path)
    evaluation = read_evaluation(tmp_path)
    contact: Any = evaluation.models["field"].contact
    assert contact is not None and contact["pairs"] == 4
    assert 0.0 < contact["depth_rmse_mm"] < 3.0 and 0.0 <= contact["iou"] <= 1.0
    *_, outputs = results_tables({"val": evaluation})
    assert "RMSE of the depth, median, mm" in [line[3] for line in outputs.groups[""]]
