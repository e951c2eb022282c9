"""Translating image files: any size and colour in, counts and tactile images out, one sentence
for what cannot be used."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from spots import write_spots

from primitives_cad.errors import T2TwinError
from translate.data import load_pairs
from translate.images import open_image
from translate.predict import load_run, translate_images
from translate.train import train


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_spots(tmp_path_factory.mktemp("spots") / "data")


@pytest.fixture(scope="module", params=["touch2touch", "resnet18"])
def run_dir(
    request: pytest.FixtureRequest, data_dir: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    folder = tmp_path_factory.mktemp("runs") / request.param
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")
        train(request.param, data_dir, "smoke", folder, epochs=2)
    return folder


@pytest.fixture
def digit(data_dir: Path) -> Image.Image:
    return Image.fromarray(load_pairs(data_dir, "val", 128, grey=False).images[:1][0])


def test_files_say_what_was_predicted(run_dir: Path, digit: Image.Image, tmp_path: Path) -> None:
    digit.save(tmp_path / "press.png")
    counts = translate_images(run_dir, [tmp_path / "press.png"], tmp_path / "out")
    assert counts.shape == (1, 20)
    expected = load_run(run_dir).predict(np.asarray(digit)[None])
    np.testing.assert_allclose(counts, expected, atol=1.0)

    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == ["counts.csv", "counts.json", "press.png"]
    with (tmp_path / "out" / "counts.csv").open(newline="") as file:
        [row] = csv.DictReader(file)
    assert row.pop("image") == str(tmp_path / "press.png")
    assert [int(row[f"taxel_{n}"]) for n in range(20)] == np.rint(counts[0]).tolist()
    content = json.loads((tmp_path / "out" / "counts.json").read_text())
    assert content["images"][0]["counts"] == np.rint(counts[0]).tolist()
    assert len(content["layout_x_mm"]) == 20
    with Image.open(tmp_path / "out" / "press.png") as picture:
        assert picture.mode == "RGB"
        assert picture.size[0] > 2 * 240
        assert picture.size[1] > 2 * 396
        assert len(np.unique(np.asarray(picture).reshape(-1, 3), axis=0)) > 50


def test_every_kind_of_image_is_read_alike(digit: Image.Image, tmp_path: Path) -> None:
    """Grey, 16-bit, palette, transparent and JPEG files of one picture are that picture."""
    grey = np.asarray(digit.convert("L"))
    digit.save(tmp_path / "rgb.png")
    digit.convert("L").save(tmp_path / "grey.png")
    digit.convert("RGBA").save(tmp_path / "rgba.png")
    digit.convert("LA").save(tmp_path / "la.png")
    digit.quantize(256).save(tmp_path / "palette.png")
    Image.fromarray(grey.astype(np.uint16) * 257).save(tmp_path / "deep.png")
    digit.save(tmp_path / "photo.jpg", quality=95)
    for name in (
        "rgb.png",
        "grey.png",
        "rgba.png",
        "la.png",
        "palette.png",
        "deep.png",
        "photo.jpg",
    ):
        image = open_image(tmp_path / name)
        assert image.mode in ("L", "RGB")
        read = np.asarray(image.convert("L")).astype(float)
        assert np.abs(read - grey).mean() < 3.0, name


def test_any_size_and_colour_is_translated(
    run_dir: Path, digit: Image.Image, tmp_path: Path
) -> None:
    digit.resize((640, 480)).save(tmp_path / "large.jpg")
    digit.resize((7, 5)).save(tmp_path / "tiny.png")
    digit.convert("L").save(tmp_path / "grey.png")
    paths = [tmp_path / name for name in ("large.jpg", "tiny.png", "grey.png")]
    counts = translate_images(run_dir, paths, tmp_path / "out")
    assert counts.shape == (3, 20)
    assert np.isfinite(counts).all()
    assert {p.name for p in (tmp_path / "out").glob("*.png")} == {
        "large.png", "tiny.png", "grey.png",
    }  # fmt: skip


def test_grey_is_all_that_touch2touch_sees(
    data_dir: Path, run_dir: Path, digit: Image.Image, tmp_path: Path
) -> None:
    digit.save(tmp_path / "colour.png")
    digit.convert("L").save(tmp_path / "grey.png")
    paths = [tmp_path / "colour.png", tmp_path / "grey.png"]
    colour, grey = translate_images(run_dir, paths, tmp_path / "out")
    same = np.allclose(colour, grey, atol=1.0)
    assert same == (run_dir.name == "touch2touch")


def test_inputs_of_one_name_keep_their_own_output(
    run_dir: Path, digit: Image.Image, tmp_path: Path
) -> None:
    paths = []
    for folder in ("a", "b", "c"):
        (tmp_path / folder).mkdir()
        paths.append(tmp_path / folder / ("press.png" if folder != "c" else "press.jpg"))
        digit.save(paths[-1])
    translate_images(run_dir, paths, tmp_path / "out")
    content = json.loads((tmp_path / "out" / "counts.json").read_text())
    named = [image["tactile_image"] for image in content["images"]]
    assert named == ["press.png", "press-2.png", "press-3.png"]
    assert all((tmp_path / "out" / name).is_file() for name in named)


def test_bad_files_get_a_sentence_and_nothing_is_written(
    run_dir: Path, digit: Image.Image, tmp_path: Path
) -> None:
    good, text, cut, empty = (tmp_path / f"{n}.png" for n in ("good", "text", "cut", "empty"))
    digit.save(good)
    text.write_text("this is no picture")
    cut.write_bytes(good.read_bytes()[:2000])
    empty.write_bytes(b"")
    out = tmp_path / "out"
    with pytest.raises(T2TwinError, match="at least one"):
        translate_images(run_dir, [], out)
    with pytest.raises(T2TwinError, match="is not there"):
        translate_images(run_dir, [good, tmp_path / "missing.png"], out)
    for bad in (text, cut, empty):
        with pytest.raises(T2TwinError, match="cannot be read as an image"):
            translate_images(run_dir, [good, bad], out)
    with pytest.raises(T2TwinError, match="is not there"):
        translate_images(run_dir, [tmp_path], out)
    with pytest.raises(T2TwinError, match="holds no config\\.json"):
        translate_images(tmp_path, [good], out)
    assert not out.exists()


def test_arrays_that_are_no_images_are_refused(run_dir: Path) -> None:
    run = load_run(run_dir)
    with pytest.raises(T2TwinError, match="of uint8"):
        run.predict(np.zeros((1, 32, 32, 3)))
    with pytest.raises(T2TwinError, match="of uint8"):
        run.predict(np.zeros((1, 32, 32, 4), np.uint8))
    assert run.predict(np.zeros((0, 32, 32, 3), np.uint8)).shape == (0, 20)


def test_run_without_its_weights_is_refused(run_dir: Path, tmp_path: Path) -> None:
    (tmp_path / "config.json").write_text((run_dir / "config.json").read_text())
    with pytest.raises(T2TwinError, match="not finished its first epoch"):
        load_run(tmp_path)
    (tmp_path / "best.safetensors").write_bytes(b"rubbish")
    with pytest.raises(T2TwinError, match="does not hold the weights"):
        load_run(tmp_path)
