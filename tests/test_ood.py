"""Pictures unlike those of the training are told."""

import json

import numpy as np
import pytest
from PIL import Image
from spots import train_smoke, write_spots

from t2twin.cli import main
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.core.images import decode_png
from t2twin.sim.dataset.store import read_split
from t2twin.translate.inference.load import load
from t2twin.translate.runs.config import CONFIG, load_config
from t2twin.translate.uncertainty.ood import CELLS, fit_ood_detector


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("familiar")
    data = write_spots(folder / "data", train=120, val=6, test=6)
    return data, train_smoke("resnet18", data, folder / "run", epochs=1)


def test_distances_are_in_spreads_of_the_cells():
    rng = np.random.default_rng(0)
    pixels = rng.integers(90, 110, (100, 61, 61, 3)).astype(np.uint8)
    pixels[::2] += 20  # all cells move together by 20
    known = fit_ood_detector(pixels)
    assert known is not None and fit_ood_detector(pixels[:99]) is None
    assert known.mean.shape == (CELLS * CELLS * 3,)
    np.testing.assert_allclose(known.mean, 109.5, atol=2.0)
    np.testing.assert_allclose(known.std, 10.0, atol=1.0)
    np.testing.assert_allclose(known.distances(pixels), 1.0, atol=0.1)
    off = np.full((1, 61, 61, 3), 150, np.uint8)
    assert known.distances(off)[0] == pytest.approx(40.5 / 10, rel=0.05)
    assert set(known.classify(pixels)) == {"in distribution"}
    assert known.classify(off) != ["in distribution"]


def test_how_a_picture_is_wrong_is_told():
    rng = np.random.default_rng(0)
    down, across = np.mgrid[0:64, 0:64] / 63.0
    scene = np.stack([200 * across, 200 * down * (1 - across), 60 + 80 * down], axis=-1)
    pixels = np.clip(scene + rng.normal(0, 12, (120, 1, 1, 3)), 0, 255).astype(np.uint8)
    known = fit_ood_detector(pixels)
    assert known is not None
    wrong = {
        "in distribution": pixels[0], "upside down": pixels[0, ::-1, ::-1],
        "mirrored": pixels[0, :, ::-1], "upside down and mirrored": pixels[0, ::-1],
        "on its side": np.rot90(pixels[0], -1), "on its other side": np.rot90(pixels[0]),
        "black": pixels[0] // 32,
        "overexposed": np.clip(pixels[0].astype(int) + 170, 0, 255).astype(np.uint8),
        "without color": _grey(pixels[0]), "of another light or sensor": pixels[0][..., [1, 2, 0]],
    }  # fmt: skip
    assert known.classify(np.array(list(wrong.values()))) == list(wrong)
    of_grey_light = fit_ood_detector(_grey(pixels))
    assert of_grey_light is not None
    assert of_grey_light.classify(_grey(pixels[:1])) == ["in distribution"]


def _grey(pixels: np.ndarray) -> np.ndarray:
    return np.repeat(pixels.mean(axis=-1, keepdims=True), 3, axis=-1).astype(np.uint8)


def test_what_is_strange_is_said_and_what_is_not_is_not(run, tmp_path, capsys):
    data, folder = run
    rows = read_split(data, "test")["source_image"].to_pylist()
    for number, row in enumerate(rows):
        Image.fromarray(decode_png(row["bytes"])).save(tmp_path / f"{number}.png")
    noise = np.random.default_rng(0).integers(0, 256, (320, 240, 3), dtype=np.uint8)
    Image.fromarray(noise).save(tmp_path / "noise.png")
    Image.new("RGB", (240, 320), "white").save(tmp_path / "white.png")
    main(["translate", "--run", str(folder), str(tmp_path), "--out", str(tmp_path / "out")])
    said = capsys.readouterr().err
    assert "2 of 8 images are unlike all training images of" in said and "noise.png (1 " in said
    assert "1 overexposed" in said
    entries = json.loads((tmp_path / "out/counts.json").read_text())["images"]
    assert [entry["in_distribution"] for entry in entries] == [True] * 6 + [False] * 2
    assert [entry.get("ood_class") for entry in entries[5:]] == [None, "noise", "overexposed"]
    main(["translate", "--run", str(folder), str(tmp_path / "1.png"), "--out", str(tmp_path / "2")])
    assert "unlike" not in capsys.readouterr().err


def test_a_run_without_statistics_names_faults_and_compares_nothing(untrained_runs):
    even = np.full((320, 240, 3), 90, np.uint8)
    for trained in map(load, untrained_runs):
        with pytest.warns(T2TwinWarning, match=r"1 of 2 images is unlike .* \(1 black\)"):
            found = trained.estimate([even, 0 * even])
        assert found.ood_class.tolist() == ["not compared with training images", "black"]
        assert [each.entry["in_distribution"] for each in found.ood_class] == [None, False]


def test_damaged_statistics_are_refused(run, tmp_path):
    content = json.loads((run[1] / CONFIG).read_text())
    content["ood_detector"]["mean_grey"].pop()
    (tmp_path / CONFIG).write_text(json.dumps(content))
    with pytest.raises(T2TwinError, match="ood_detector must have 192 values"):
        load_config(tmp_path)
