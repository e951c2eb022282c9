"""Translation between any two kinds of sensors: from images or counts to images or counts."""

import re
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pytest
from spots import array_info, camera_info, stopped_after_an_epoch

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.images import encode_png
from t2twin.sim.dataset.columns import column, schema_of
from t2twin.sim.dataset.info import DatasetInfo, Shard, versions
from t2twin.sim.dataset.store import write_info, write_shard
from t2twin.sim.taxels.layout import load_layout
from t2twin.translate.data.pairs import TactilePictures, load_info, load_pairs
from t2twin.translate.evaluation.evaluate import evaluate, read_predictions
from t2twin.translate.evaluation.metrics import CONTACT_GREY, compare_images
from t2twin.translate.inference.files import translate_readings
from t2twin.translate.models.presets import PRESETS
from t2twin.translate.runs.config import load_config
from t2twin.translate.training.train import train

pytestmark = pytest.mark.usefixtures("one_thread")

SIZE = PRESETS["touch2touch"]["smoke"].size
KINDS = ("image", "counts")
OTHERS = [pair for pair in product(KINDS, KINDS) if pair != ("image", "counts")]

ROWS, COLUMNS, PX_PER_MM = 64, 48, 1.6
PAIRS: dict[Literal["train", "val", "test"], int] = {"train": 64, "val": 16, "test": 0}
FULL_SCALE = 20_000


def write(folder: Path, *values: str) -> Path:
    """A dataset of spots, which move and grow: source and target are images or counts."""
    rng, layout, shards = np.random.default_rng(0), load_layout("cyskin-20"), {}
    roles: dict[str, str] = dict(zip(("source", "target"), values, strict=True))
    schema = schema_of(roles, None)
    blank = {f.name: False if pa.types.is_boolean(f.type) else 0 for f in schema}
    down, across = np.mgrid[:ROWS, :COLUMNS]
    places = {
        "image": ((across - COLUMNS / 2) / PX_PER_MM, (down - ROWS / 2) / PX_PER_MM),
        "counts": (layout.x_mm, layout.y_mm),
    }
    for split, number in PAIRS.items():
        rows = []
        for index in range(number):
            x_mm, y_mm, strength = rng.uniform((-6, -12, 0.5), (6, 12, 1.0))
            row = {"shape": f"{split}-{index % 4}", "family": "spot", "split": split,
                   "index": index, "x_mm": x_mm, "y_mm": y_mm, "force_n": 8.0}  # fmt: skip
            for role, value in roles.items():
                x, y = places[value]
                wide = 32.0 if role == "source" else 18.0
                spot = strength * np.exp(-(np.square(x - x_mm) + np.square(y - y_mm)) / wide)
                if value == "image":
                    colors = (1.0, 0.8, 0.6) if role == "source" else (0.4, 0.7, 1.0)
                    pixels = ((60.0 + 180.0 * spot)[..., None] * np.array(colors)).astype(np.uint8)
                    row[column(role, value)] = {"bytes": encode_png(pixels), "path": "x.png"}
                else:
                    row[column(role, value)] = np.rint(0.8 * FULL_SCALE * spot).astype(np.uint16)
            rows.append(blank | row)
        if rows:
            path = f"{split}/spot.parquet"
            shards[path] = Shard(write_shard(folder / path, rows, schema), number)
    sensors = [
        camera_info(name, ROWS, COLUMNS) if value == "image" else array_info(name, FULL_SCALE)
        for name, value in zip(("first", "second"), values, strict=True)
    ]
    info = DatasetInfo(True, PAIRS, *sensors, versions=versions(), shards=shards)
    write_info(folder, info)
    return folder


@pytest.fixture(scope="module", params=OTHERS, ids="-to-".join)
def trained(request, tmp_path_factory) -> tuple[Path, Path]:
    """A dataset and a run of 10 epochs from its source to its target."""
    folder = tmp_path_factory.mktemp("-to-".join(request.param))
    data = write(folder / "data", *request.param)
    train("touch2touch", data, "smoke", folder / "run", epochs=10)
    return data, folder / "run"


def test_a_picture_of_counts_is_linear_and_full_at_full_scale(tmp_path: Path) -> None:
    array = load_info(write(tmp_path, "image", "counts")).array
    full, half = np.full(array.x_mm.size, array.full_scale), np.zeros(array.x_mm.size)
    half[:3] = 0.5 * array.full_scale
    pictures = TactilePictures.of(np.stack([full, half, 0 * full]), array, SIZE, grey=False)[:]
    assert pictures.shape == (3, SIZE, SIZE, 3) and pictures.max() == pytest.approx(255.0)
    assert np.array_equal(pictures[..., 0], pictures[..., 2]) and not pictures[2].any()
    phi = array.phi.resized((SIZE, SIZE))
    found = phi.inverse(pictures[1, ..., 0]) * array.full_scale / 255.0
    np.testing.assert_allclose(found, half, atol=1e-3 * array.full_scale)


def test_figures_of_images_follow_from_a_constant_difference() -> None:
    true = np.full((2, 16, 16, 3), 100, np.uint8)
    true[1, 4:8, 4:8] = 100 + int(CONTACT_GREY) + 1
    frame = np.full((16, 16, 3), 100, np.uint8)
    predicted = true + np.uint8(10)
    figures = compare_images(predicted, true, frame)
    np.testing.assert_allclose(figures.psnr_db, 20 * np.log10(255 / 10))
    assert np.isnan(figures.psnr_contact_db[0])
    assert figures.psnr_contact_db[1] == pytest.approx(20 * np.log10(255 / 10))
    np.testing.assert_allclose(compare_images(true, true, None).ssim, 1.0)
    assert np.isnan(compare_images(true, true, None).psnr_contact_db).all()


def test_a_run_takes_what_its_source_measures_and_returns_what_its_target_does(trained) -> None:
    data, run_dir = trained
    run, info = t2twin.load(run_dir), load_info(data)
    assert load_config(run_dir).direction == info.direction
    is_image = info.target.value == "image"
    rows, columns, _ = info.camera.image_shape if "image" in info.direction else (0, 0, 0)
    frame = np.full((rows, columns, 3), 60, np.uint8)
    one = np.zeros(info.source.x_mm.size) if info.source.value == "counts" else frame
    found, several = run.predict(one), run.predict(np.stack([one, one]))
    expected = (rows, columns, 3) if is_image else (info.array.x_mm.size,)
    assert found.shape == expected and several.shape == (2, *expected)
    assert found.dtype == (np.uint8 if is_image else np.float32)
    np.testing.assert_allclose(several[1], found, atol=1)
    with pytest.raises(T2TwinError, match=r"counts of shape \(3,\)|expected an image"):
        run.predict(np.zeros(3, np.uint8))


def test_runs_are_better_than_the_mean_and_compared_with_the_nearest(trained, tmp_path) -> None:
    data, run_dir = trained
    evaluation = evaluate([run_dir], data, "val", tmp_path)
    info, predictions = load_info(data), read_predictions(tmp_path)
    mean, *_, nearest, own = [n for n in evaluation.models if n != "noise-floor"]
    assert (nearest, own) == ("nearest-neighbor", "touch2touch")
    assert mean == ("mean-image" if info.target.value == "image" else "mean-array")
    percent = {name: row.overall["rmse_percent"] for name, row in evaluation.models.items()}
    assert percent[own] < percent[mean] and percent[nearest] < percent[mean]
    for name, predicted in predictions.by_model.items():
        error = np.square(predicted.astype(float) - predictions.truth).mean()
        rmse = 100 * np.sqrt(error) / info.target.full_scale
        assert rmse == pytest.approx(percent[name], rel=1e-4)
    pairs, train_pairs = (load_pairs(data, split, 32, grey=False) for split in ("val", "train"))
    sources = [np.asarray(each.source[:], float).reshape(len(each), -1)
               for each in (pairs, train_pairs)]  # fmt: skip
    distance = np.square(sources[0][:, None] - sources[1][None]).sum(axis=2)
    if info.target.value == "counts":
        chosen = np.asarray(train_pairs.target[distance.argmin(axis=1)])
        np.testing.assert_array_equal(predictions.by_model[nearest], chosen)


def test_one_dataset_serves_both_directions(tmp_path: Path) -> None:
    data = write(tmp_path / "data", "counts", "counts")
    run = train("resnet18", data, "smoke", tmp_path / "run", epochs=1, direction="target-to-source")
    sides = load_config(run.run_dir).data
    assert (sides.source.name, sides.target.name) == ("second", "first")
    evaluation = evaluate([run.run_dir], data, "val", tmp_path / "evaluation")
    assert (evaluation.source, evaluation.target) == ("second", "first")
    truth = load_pairs(data, "val", SIZE, True).source
    assert np.array_equal(read_predictions(tmp_path / "evaluation").truth, np.asarray(truth))
    with pytest.raises(T2TwinError, match="holds a run with another source"):
        train("resnet18", data, "smoke", tmp_path / "run", epochs=1)


def test_a_stopped_training_of_colors_resumes_as_undisturbed(tmp_path: Path) -> None:
    data = write(tmp_path / "data", "image", "image")
    once = partial(train, "touch2touch", data, "smoke", epochs=2)
    whole = once(tmp_path / "whole")
    with stopped_after_an_epoch():
        once(tmp_path / "killed")
    assert once(tmp_path / "killed").best_rmse_grey == whole.best_rmse_grey
    assert not load_config(tmp_path / "whole").preset.grey


@pytest.mark.parametrize(
    ("model", "source", "target", "said"),
    [
        ("resnet18", "image", "image", "resnet18 has no direction image-to-image"),
        ("resnet18", "counts", "image", "resnet18 has no direction counts-to-image"),
        ("field", "counts", "counts", "field has no direction counts-to-counts; it has image-to-"),
    ],
)
def test_a_pair_that_a_model_does_not_take_is_one_sentence(tmp_path, model, source, target, said):
    data = write(tmp_path / "data", source, target)
    with pytest.raises(T2TwinError, match=said):
        train(model, data, "smoke", tmp_path / "run")
    if source == target:
        with pytest.raises(T2TwinError, match="and no direction counts-to-image"):
            train("touch2touch", data, "smoke", tmp_path / "run", direction="counts-to-image")
    assert not (tmp_path / "run").exists()


def test_other_sensors_than_those_of_a_run_are_one_sentence(trained, tmp_path: Path) -> None:
    _, run_dir = trained
    kinds = (
        ("image", "image") if "counts" in load_config(run_dir).direction else ("image", "counts")
    )
    other = write(tmp_path / "data", *kinds)
    with pytest.raises(T2TwinError, match=r"predicts .* from .*; .* has images of first and"):
        evaluate([run_dir], other, "val", tmp_path / "evaluation")


def test_counts_are_read_from_files(trained, tmp_path: Path, capsys) -> None:
    data, run_dir = trained
    info, run = load_info(data), t2twin.load(run_dir)
    if info.source.value == "image":
        return
    counts = np.asarray(load_pairs(data, "val", SIZE, True).source[:3]).astype(int)
    names = [f"taxel_{n}" for n in range(counts.shape[1])]
    lines = [";".join(map(str, row)) for row in ([*names, "note"], *([*r, 1] for r in counts[:2]))]
    (tmp_path / "some.csv").write_text("\n".join(lines))
    np.save(tmp_path / "one.npy", counts[2])
    main(["translate", str(tmp_path / "some.csv"), str(tmp_path / "one.npy"),
          "--run", str(run_dir), "--out", str(tmp_path / "out")])  # fmt: skip
    assert "3 readings translated" in capsys.readouterr().out
    files = {path.name for path in (tmp_path / "out").glob("[!.]*")} - {"counts.csv"}
    assert files == {"some.png", "some-2.png", "one.png"}
    given, to_counts = [tmp_path / "some.csv", tmp_path / "one.npy"], info.target.value == "counts"
    found = translate_readings(run_dir, given, tmp_path / "again", png=not to_counts)
    np.testing.assert_array_equal(found, run.predict(counts))
    assert (tmp_path / "out" / "counts.csv").is_file() == to_counts
    head, line, turned = ";".join(names), ";".join(["7"] * len(names)), ["--turn-deg", "90"]
    np.save(tmp_path / "none.npy", counts[:0])
    contents = {
        "\n".join(lines[1:]): "it has 0 columns taxel_0", head: "it has no reading",
        f"{head}\n{line}\n{line[1:]}": "line 3: taxel_0 has no number",
        f"{head}\n-{line}": "line 2: taxel_0 has -7; expected 0 to",
        f"{head}\n{line}99999": f"line 2: {names[-1]} has 799,999; expected 0 to",
        f"{head.title()}\n{line}": "it has 1 columns Taxel_0",
        f"{head};taxel_0\n{line};7": "it has 2 columns taxel_0",
        f"{head}\n{line.replace('7', '0.7')}": "all counts lie between 0 and 0.7",
    }  # fmt: skip
    for number, content in enumerate(contents):
        (tmp_path / f"{number}.csv").write_text(content)
    refused = [(f"{number}.csv", [], said) for number, said in enumerate(contents.values())]
    refused += [("none.npy", [], "no reading"), ("some.txt", [], "there is no file"),
                ("one.npy", turned, "90 is for images; .* translates counts")]  # fmt: skip
    refused += [("one.npy", ["--no-png"], "is for predicted counts")] * (not to_counts)
    command = ["translate", "--run", str(run_dir), "--out", "no"]
    for name, options, said in refused:
        with pytest.raises(SystemExit):
            main([*command, str(tmp_path / name), *options])
        assert re.search(said, capsys.readouterr().err), said
    assert not Path("no").exists()
