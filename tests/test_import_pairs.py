"""A user's own pairs: into the dataset's format, then trained on and evaluated."""

import csv

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from PIL import Image
from spots import write_spots

from t2twin.cli import main
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.core.frame_order import FrameOrder
from t2twin.core.images import decode_png
from t2twin.sim.dataset.import_pairs import import_pairs
from t2twin.sim.dataset.store import CARD, lists, read_info, read_split, verify_dataset
from t2twin.sim.taxels.layout import load_layout
from t2twin.translate.data.pairs import load_pairs
from t2twin.translate.evaluation.evaluate import evaluate
from t2twin.translate.training.train import train

TAXELS = 4
LAYOUT_CSV = "x_mm,y_mm\n0,0\n8,0\n0,8\n8,8\n"


@pytest.fixture
def layout(tmp_path):
    (tmp_path / "mine.csv").write_text(LAYOUT_CSV)
    return load_layout(tmp_path / "mine.csv")


def write_csv(folder, pairs=20, **changes):
    """Pictures and a CSV of taxels. changes: a column's value by row, {name: {row: value}}."""
    rng = np.random.default_rng(0)
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for row in range(pairs):
        pixels = rng.integers(0, 256, (32, 24, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(folder / f"{row}.png")
        counts = rng.integers(0, 1000, TAXELS)
        rows.append({"image": f"{row}.png", **{f"taxel_{i}": c for i, c in enumerate(counts)}})
    for name, values in changes.items():
        for row, value in values.items():
            rows[row][name] = value
    names = list(dict.fromkeys(name for row in rows for name in row))
    with (folder / "pairs.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows(rows)
    return folder, rows


def test_a_folder_of_pictures_and_a_csv_comes_in_whole(tmp_path, layout):
    folder, rows = write_csv(tmp_path / "mine")
    order = FrameOrder(180, mirror=True, bgr=True)
    info = import_pairs(folder, tmp_path / "data", layout, full_scale=1000, order=order)
    assert info.order == order and info.pairs == {"train": 16, "val": 2, "test": 2}
    assert info.camera.image_shape == (32, 24, 3) and info == read_info(tmp_path / "data")
    assert verify_dataset(tmp_path / "data") == []
    assert not list(tmp_path.glob(".*"))
    assert "20 pairs" not in (tmp_path / "data" / CARD).read_text()
    kept = {}
    for split in ("train", "val", "test"):
        table = read_split(tmp_path / "data", split)
        images = table["source_image"].to_pylist()
        for image, counts in zip(images, lists(table, "target_counts"), strict=True):
            kept[decode_png(image["bytes"]).tobytes()] = counts.tolist()
        assert table["x_mm"].null_count == len(table)
    for row in rows:
        with Image.open(folder / row["image"]) as image:
            expected = [row[f"taxel_{i}"] for i in range(TAXELS)]
            assert kept[np.asarray(image)[::-1, :, ::-1].tobytes()] == expected


def test_images_and_counts_unlike_the_sensors_are_named(tmp_path, layout):
    own = dict.fromkeys(range(20), 52.9)  # percent
    folder, _ = write_csv(tmp_path / "mine", taxel_0=own, taxel_1=own, taxel_2=own, taxel_3=own)
    for number in range(20):
        pixels = np.random.default_rng(number).integers(99, 199, (4, 3), dtype=np.uint8)
        Image.fromarray(pixels).save(folder / f"{number}.png")
    with pytest.warns(T2TwinWarning) as found:
        import_pairs(folder, tmp_path / "data", layout)
    counts, size, color = (str(each.message) for each in found)
    assert "lie between 0 and 52.9; expected counts from 0 to 40,000" in counts
    assert "the images are 3 x 4 pixels" in size and "20 images of 20 are without color" in color


def test_what_the_rows_say_is_kept(tmp_path, layout):
    splits = {row: ("train", "train", "val", "test")[row % 4] for row in range(20)}
    shapes = {row: ("0", "007")[row % 2] for row in range(20)}  # names, not numbers
    folder, _ = write_csv(
        tmp_path / "mine", split=splits, shape=shapes, x_mm={0: 1.5}, force_n={0: 3.0}
    )
    import_pairs(folder / "pairs.csv", tmp_path / "data", layout)
    table = read_split(tmp_path / "data", "train")
    assert len(table) == 10 and set(table["shape"].to_pylist()) == {"0", "007"}
    pairs = load_pairs(tmp_path / "data", "train", 16, grey=True)
    assert pairs.x_mm[0] == 1.5 and pairs.force_n[0] == 3.0 and np.isnan(pairs.x_mm[1:]).all()


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"taxel_1": {3: 50_000}}, r"line 5, column taxel_1 has '50000': .*<= 40000"),
        ({"taxel_1": {3: -1}}, r"line 5, column taxel_1 has '-1': .*>= 0"),
        ({"taxel_1": {3: ""}}, r"line 5, column taxel_1 has ''"),
        ({"taxel_2": {3: "many"}}, r"line 5, column taxel_2"),
        (
            {f"taxel_{n}": dict.fromkeys(range(20), 0.5) for n in range(TAXELS)},
            "all counts lie between 0 and 0.5",
        ),
        ({"taxel_4": {3: 5}}, "expected image, and either taxels or taxel_0 to taxel_3"),
        ({"image": {3: "gone.png"}}, "line 5: its image cannot be read: there is no file"),
        ({"image": {3: "deep.png"}}, "line 5: its image cannot be read"),
        ({"image": {3: "large.png"}}, "24 x 32; all must be of one size"),
        ({"image": {3: "2.png"}}, "line 4 and .*line 5 have the same image"),
        ({"image": {3: ""}}, "line 5: its image cannot be read: there is none"),
        ({"split": {3: "training"}}, "line 5, column split has 'training'"),
        ({"split": {3: ""}}, "line 5: split is empty"),
        ({"x_mm": {3: "inf"}}, r"line 5, column x_mm"),
        ({"x_mm": {3: 13.9, 4: 248}}, r"line 6, column x_mm has '248': .*<= 14"),
        ({"y_mm": {3: -24}}, r"line 5, column y_mm has '-24': .*>= -23"),
        ({"yaw_rad": {3: 30}}, "line 5, column yaw_rad has '30"),
    ],
)
def test_what_is_wrong_is_named_and_nothing_written(tmp_path, layout, changes, message):
    if "split" in changes:
        changes = {"split": dict.fromkeys(range(20), "train") | changes["split"]}
    folder, _ = write_csv(tmp_path / "mine", **changes)
    Image.fromarray(np.zeros((40, 24, 3), np.uint8)).save(folder / "large.png")
    Image.fromarray(np.zeros((32, 24), np.uint16)).save(folder / "deep.png")
    with pytest.raises(T2TwinError, match=message):
        import_pairs(folder, tmp_path / "data", layout)
    assert not (tmp_path / "data").exists() and not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_a_spreadsheet_s_csv_is_read_as_any_other(tmp_path, layout, delimiter):
    """With a byte order mark, semicolons or tabs, decimal commas, empty lines and CRLF."""
    folder, rows = write_csv(tmp_path / "mine", x_mm={0: 1.5, 2: -0.25}, split={0: "train"})
    lines = []
    for row in rows:
        row |= {"split": "train"}
        cells = [str(row.get(name, "")).replace("1.5", "+1,5") for name in (*rows[0],)]
        lines.append(delimiter.join(cells).replace("-0.25", "-0,25"))
    text = "\r\n".join([delimiter.join(rows[0]), "", *lines]) + "\r\n"
    (folder / "pairs.csv").write_bytes(text.encode("utf-8-sig"))
    import_pairs(folder, tmp_path / "data", layout)
    table = read_split(tmp_path / "data", "train")
    assert table["x_mm"].to_pylist()[:3] == [1.5, None, -0.25]
    expected = [rows[0][f"taxel_{i}"] for i in range(TAXELS)]
    assert lists(table, "target_counts")[0].tolist() == expected
    # The empty line counts, as it does in an editor.
    (folder / "3.png").unlink()
    with pytest.raises(
        T2TwinError, match=r"pairs\.csv, line 6: its image cannot be read: there is no file"
    ):
        import_pairs(folder, tmp_path / "again", layout)


def test_parquet_with_pictures_in_it_trains_and_evaluates(tmp_path, capsys):
    """Columns image and taxels with the pairs of another dataset, as a user may have them."""
    spots = write_spots(tmp_path / "spots")
    stored = ["source_image", "target_counts", "split", "shape"]
    tables = [read_split(spots, split, stored) for split in ("train", "val", "test")]
    table = pa.concat_tables(tables).rename_columns(["image", "taxels", "split", "shape"])
    pq.write_table(table, tmp_path / "mine.parquet")
    data = tmp_path / "data"
    main(["import-pairs", "mine.parquet", "--out", "data", "--source", "gelsight-mini"])
    assert "32 training, 12 validation and 8 test pairs" in capsys.readouterr().out
    assert verify_dataset(data) == [] and read_info(data).recipe is None
    assert read_info(data).camera.name == "gelsight-mini"
    for split in ("train", "val", "test"):
        both = [read_split(folder, split) for folder in (data, spots)]
        assert (lists(both[0], "target_counts") == lists(both[1], "target_counts")).all()
        images = [[decode_png(c["bytes"]) for c in t["source_image"].to_pylist()] for t in both]
        assert np.array_equal(images[0], images[1])
    train("resnet18", data, "smoke", tmp_path / "run", epochs=1)
    result = evaluate([tmp_path / "run"], data, "val", tmp_path / "out")
    assert result.pairs == 12 and result.models["resnet18"].overall["rmse_counts"] > 0
