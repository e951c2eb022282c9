"""Translating image files: any size and color in, counts and tactile images out, one sentence
for what cannot be used."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from safetensors.torch import load_file, save_file

from t2twin.core.errors import T2TwinError
from t2twin.translate.data.images import open_image, to_input
from t2twin.translate.data.pairs import load_pairs
from t2twin.translate.inference import files
from t2twin.translate.inference.files import find_images, translate_images
from t2twin.translate.inference.load import load_run
from t2twin.translate.runs.checkpoint import build, load_weights

pytestmark = pytest.mark.filterwarnings("ignore::t2twin.core.errors.T2TwinWarning")


@pytest.fixture
def digit(data_dir: Path) -> Image.Image:
    return Image.fromarray(load_pairs(data_dir, "val", 128, grey=False).images[:1][0])


def test_files_say_what_was_predicted(run_dir: Path, digit: Image.Image, tmp_path: Path) -> None:
    """Of images of any size and color."""
    digit.save(tmp_path / "press.png")
    digit.resize((640, 480)).save(tmp_path / "large.jpg")
    digit.resize((7, 5)).save(tmp_path / "tiny.png")
    digit.convert("L").save(tmp_path / "grey.png")
    paths = [tmp_path / name for name in ("press.png", "large.jpg", "tiny.png", "grey.png")]
    counts = translate_images(paths, tmp_path / "out", run_dir)
    assert counts.shape == (4, 20) and np.isfinite(counts).all()
    expected = load_run(run_dir).predict(np.asarray(digit)[None])
    np.testing.assert_allclose(counts[:1], expected, atol=1.0)
    names = {path.name for path in (tmp_path / "out").glob("[!.]*")}
    assert names == {"counts.csv", "counts.json", *(f"{path.stem}.png" for path in paths)}
    with (tmp_path / "out" / "counts.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert row.pop("image") == str(tmp_path / "press.png")
    assert [int(row[f"taxel_{n}"]) for n in range(20)] == np.rint(counts[0]).tolist()
    assert row["ood_class"] == "of another aspect ratio"
    content = json.loads((tmp_path / "out" / "counts.json").read_text())
    assert content["images"][0]["counts"] == np.rint(counts[0]).tolist()
    assert len(content["layout_x_mm"]) == 20
    with Image.open(tmp_path / "out" / "press.png") as picture:
        assert picture.mode == "RGB" and picture.size[0] > 2 * 240 and picture.size[1] > 2 * 396
        assert len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0)) > 50


NO_IMAGES: dict[str, tuple[object, str]] = {
    "float": (np.zeros((1, 32, 32, 3)), "of uint8"), "objects": (np.full((32, 24), None), "object"),
    "two channels": (np.zeros((32, 24, 2), np.uint8), r"shape \(32, 24, 2\)"),
    "RGBA": (np.zeros((32, 24, 4), np.uint8), "without transparency"),
    "channels first": (np.zeros((3, 32, 24), np.uint8), "channels last"),
    "grey batch": (np.zeros((5, 32, 24), np.uint8), r"\(B, h, w, 1\)"),
    "no rows": (np.zeros((0, 24, 3), np.uint8), "with pixels"),
    "tensor": (torch.zeros((32, 24, 3), dtype=torch.uint8), "of type Tensor"),
    "None in a list": ([np.zeros((32, 24), np.uint8), None], r"images\[1\] is None"),
}  # fmt: skip


@pytest.mark.parametrize("name", NO_IMAGES)
def test_what_is_no_image_is_refused(untrained_runs: list[Path], name: str) -> None:
    images, words = NO_IMAGES[name]
    with pytest.raises(T2TwinError, match=words):
        load_run(untrained_runs[0]).predict(images)  # pyright: ignore[reportArgumentType]


def test_one_frame_is_a_batch_of_one(run_dir: Path, digit: Image.Image) -> None:
    run, frame = load_run(run_dir), np.asarray(digit)
    several = run.predict(np.stack([frame, frame[::-1]]))
    assert several.shape == (2, 20)
    one = run.predict(frame)
    assert one.shape == (20,)
    np.testing.assert_allclose(one, several[0], atol=0.5)
    assert run.predict(frame[:, :, 0]).shape == (20,)
    assert run.predict(frame[None, :, :, :1]).shape == (1, 20)
    assert run.predict([frame, frame[::2, :, 0]]).shape == (2, 20) and run.predict([]).size == 0
    assert run.predict(np.zeros((0, 32, 32, 3), np.uint8)).shape == (0, 20)
    assert run.tactile_images(frame).shape == (396, 240)
    assert run.tactile_images([frame]).shape == (1, 396, 240)


def test_folded_batch_norms_change_nothing(run_dir: Path, digit: Image.Image) -> None:
    """The run as it predicts against its network as it was trained."""
    run = load_run(run_dir)
    trained = build(run.config)
    load_weights(run_dir / "best.safetensors", trained.predictor)
    pixels = np.stack([np.asarray(digit), np.asarray(digit)[::-1]])
    pixels = run.pixels_of(pixels).astype(np.float32) / 255.0
    expected = trained.predict(to_input(pixels)).numpy()
    np.testing.assert_allclose(run.translator.predict(to_input(pixels)), expected, atol=0.5)
    assert expected.std() > 10


def test_folder_gives_its_images_sorted(digit: Image.Image, tmp_path: Path) -> None:
    names = ["b.png", "a.JPG", "c.jpeg", ".hidden.png", "notes.txt", "scan.tiff"]
    for name in names:
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "below").mkdir()
    digit.save(tmp_path / "below" / "deep.png")
    found = find_images([tmp_path / "below" / "deep.png", tmp_path])
    assert [path.name for path in found] == ["deep.png", "a.JPG", "b.png", "c.jpeg"]
    with pytest.raises(T2TwinError, match=r"image \(cannot identify image file\); give PNG or"):
        open_image(tmp_path / "b.png")


def test_folder_of_many_is_as_one_by_one(run_dir, data_dir, tmp_path, monkeypatch):
    """More than fits in one batch, and a last batch that is smaller: every row is its image's."""
    monkeypatch.setattr(files, "BATCH_SIZE", 5)
    frames = load_pairs(data_dir, "train", 64, grey=False).images[:23]
    (tmp_path / "frames").mkdir()
    for number, frame in enumerate(frames):
        Image.fromarray(frame).save(tmp_path / "frames" / f"{number:02}.png")
    counts = translate_images([tmp_path / "frames"], tmp_path / "out", run_dir, png=False)
    run = load_run(run_dir)
    expected = np.stack([run.predict(frame) for frame in frames])
    np.testing.assert_allclose(counts, expected, atol=0.5)
    assert len(np.unique(expected.round(), axis=0)) == 23
    assert {path.name for path in (tmp_path / "out").glob("[!.]*")} == {"counts.csv", "counts.json"}
    images = json.loads((tmp_path / "out" / "counts.json").read_text())["images"]
    assert [Path(image["image"]).name for image in images] == [f"{n:02}.png" for n in range(23)]
    assert [image["counts"] for image in images] == np.rint(counts).tolist()
    assert "tactile_image" not in images[0]


def test_file_cut_in_its_middle_leaves_earlier_outputs(run_dir, digit, tmp_path, monkeypatch):
    """Found only when it is decoded, after others were translated."""
    monkeypatch.setattr(files, "BATCH_SIZE", 1)
    out = tmp_path / "out"
    digit.save(tmp_path / "a.png")
    translate_images([tmp_path / "a.png"], out, run_dir)
    before = {path.name: path.read_bytes() for path in out.glob("[!.]*")}
    for name in "bcdefg":
        digit.save(tmp_path / f"{name}.png")
    (tmp_path / "g.png").write_bytes((tmp_path / "g.png").read_bytes()[:2000])
    with pytest.raises(T2TwinError, match=r"g\.png cannot be read as an image"):
        translate_images([tmp_path], out, run_dir)
    assert {path.name: path.read_bytes() for path in out.glob("[!.]*")} == before


def test_weights_that_are_no_numbers_are_refused(run_dir: Path, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text((run_dir / "config.json").read_text())
    weights = load_file(run_dir / "best.safetensors")
    name = next(name for name in weights if weights[name].is_floating_point())
    weights[name].view(-1)[0] = torch.nan
    save_file(weights, tmp_path / "best.safetensors")
    with pytest.raises(T2TwinError, match=f"non-finite numbers in {name}"):
        load_run(tmp_path)
