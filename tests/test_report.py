"""The report of a small dataset and two short runs: whole, self-contained, and true to metrics."""

import base64
import json
import re
import shutil
from html import escape
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image
from spots import train_smoke

from t2twin.cli import main
from t2twin.report import data_page, lookalikes, oddities, pairs, qualitative, results, shapes
from t2twin.report.material import gather, gather_dataset
from t2twin.report.names import name_of
from t2twin.report.page import LINKS, PAGE, write_report
from t2twin.report.scan import nearest_others, scan
from t2twin.sim.dataset.generate import generate
from t2twin.sim.dataset.png import decode_png, encode_png
from t2twin.sim.dataset.store import write_shard
from t2twin.translate.evaluation.evaluate import FINDINGS, METRICS

SHAPES = (
    "circle-1", "square-1", "hemisphere-4", "line-sharp-4", "square-3", "circle-3",
    "wrench/shank", "allen-key/long-arm",
)  # fmt: skip
"""Shapes whose solids are quick to make: four to train on, two to validate, two tools."""

VOID = {"meta", "img", "br", "hr", "link"}


class Reader(HTMLParser):
    """A page's elements: checks that every tag is closed in its turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.section = ""
        self.rows: dict[str, list[list[str]]] = {}  # cells of each section's table rows

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "section":
            self.section = dict(attrs)["id"] or ""
        if tag == "tr":
            self.rows.setdefault(self.section, []).append([])
        if tag in ("td", "th"):
            self.rows[self.section][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[self.section][-1][-1] += data


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report") / "data"
    generate(folder, "smoke", workers=1, shapes=SHAPES)
    return folder


@pytest.fixture(scope="module")
def runs(data_dir: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("runs")
    return [
        train_smoke(model, data_dir, folder / model, epochs=3)
        for model in ("touch2touch", "resnet18")
    ]


@pytest.fixture(scope="module")
def page(data_dir: Path, runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The contact sheet, which has its own test and takes long, is a blank here."""

    def blank(path: Path) -> None:
        Image.new("RGB", (8, 8), "white").save(path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shapes, "draw_sheet", blank)
        return write_report(tmp_path_factory.mktemp("out") / "report", data_dir, runs)


@pytest.fixture(scope="module")
def read(page: Path) -> Reader:
    reader = Reader()
    reader.feed(page.read_text(encoding="utf-8"))
    reader.close()
    assert reader.open == []
    return reader


def test_page_holds_every_section_in_order(page: Path, read: Reader) -> None:
    assert page.name == PAGE
    sections = [attrs["id"] for tag, attrs in read.tags if tag == "section"]
    assert sections == ["about", *LINKS]
    anchors = [attrs["href"] for tag, attrs in read.tags if tag == "a"]
    assert anchors == [f"#{name}" for name in LINKS]


def test_page_needs_nothing_but_itself(page: Path, read: Reader) -> None:
    """Every picture is a whole embedded file; nothing is fetched and nothing runs."""
    images = [attrs for tag, attrs in read.tags if tag == "img"]
    assert len(images) >= 3 + 1 + pairs.PAIRS + 1 + 1 + 2 + 1
    starts = {"image/png": b"\x89PNG", "image/jpeg": b"\xff\xd8", "image/svg+xml": b"<?xml"}
    for attrs in images:
        kind, _, content = (attrs["src"] or "").removeprefix("data:").partition(";base64,")
        assert base64.b64decode(content, validate=True).startswith(starts[kind])
        assert attrs["alt"]
    assert not {"script", "link", "iframe"} & {tag for tag, _ in read.tags}
    assert "url(" not in page.read_text(encoding="utf-8")


def test_table_has_the_numbers_of_metrics(page: Path, read: Reader) -> None:
    rows: dict[str, list[list[str]]] = {}
    for name, *cells in read.rows["results"]:
        rows.setdefault(name, []).append(cells)
    found = {split: json.loads((page.parent / f"evaluate-{split}" / METRICS).read_text())
             for split in ("val", "test")}  # fmt: skip
    assert list(found["val"]["models"]) == [
        "mean-array", "nearest-neighbour", "noise-floor", "touch2touch", "resnet18",
    ]  # fmt: skip
    for name in found["val"]["models"]:
        expected = []
        for split in ("val", "test"):
            overall = found[split]["models"][name]["overall"]
            expected += [
                f"{overall['rmse_counts']:,.0f}",
                f"{overall['rmse_percent']:.2f} %",
                f"{overall['ssim']:.3f}",
            ]
        assert rows[name_of(name)][0] == expected
    paper = [rows[name][1] for name in ("touch2touch", "ResNet18")]
    assert paper == [
        ["4,007", "10.01 %", "0.96", "6,072", "15.18 %", "–"],
        ["3,931", "9.83 %", "0.95", "4,867", "12.17 %", "–"],
    ]


def test_findings_on_the_page_are_those_of_the_file(page: Path, read: Reader) -> None:
    found = json.loads((page.parent / FINDINGS).read_text())
    names = ("lower-error", "better-shape-ssim", "better-shape-iou")
    expected = [found[split][name]["answer"] for name in names for split in ("val", "test")]
    expected += [found["gap"][f"gap-{model}"]["answer"] for model in ("touch2touch", "resnet18")]
    rows = [row for row in read.rows["finding"] if len(row) > 1 and row[0]]
    assert [row[1] for row in rows] == expected
    assert rows[-1][0] == "ResNet18"
    gap = found["gap"]["gap-resnet18"]["figures"]
    assert f"validation {gap['val']:,.0f}, test {gap['test']:,.0f}" in rows[-1][4]


def test_errors_by_view_are_those_of_metrics(page: Path, read: Reader) -> None:
    rows = {row[0]: row[1:] for row in read.rows["by-view"]}
    for split, by in (("val", "by_shape"), ("test", "by_family")):
        models = json.loads((page.parent / f"evaluate-{split}" / METRICS).read_text())["models"]
        del models["noise-floor"]
        for name in models["resnet18"][by]:
            assert rows[name] == [
                f"{model[by][name][f'rmse_{group}_counts']:,.0f}"
                for model in models.values()
                for group in ("under", "near", "beyond")
            ]


def test_lookalikes_are_said_as_they_are(page: Path) -> None:
    found = {split: json.loads((page.parent / f"evaluate-{split}" / METRICS).read_text())
             ["lookalikes"] for split in ("val", "test")}  # fmt: skip
    said = lookalikes.sentences(found)
    assert len(said) == 4 and said[0].startswith("Validation, other shapes")
    nearest = found["test"]["training"]["nearest"]
    assert f"says {nearest['rmse_counts']:,.0f} counts; 0 of 2 presses have" in said[3]
    text = page.read_text(encoding="utf-8")
    assert all(escape(sentence) in text for sentence in said)


def test_sentences_follow_the_numbers() -> None:
    def models(mean: float, nearest: float, run: float) -> dict:
        figures = {"mean-array": mean, "nearest-neighbour": nearest, "resnet18": run}
        found = {name: {"overall": {"rmse_counts": value}} for name, value in figures.items()}
        found["resnet18"]["run"] = "somewhere"  # pyright: ignore[reportArgumentType]
        return {"models": found}

    said = results.sentences({"val": models(4000, 2000, 3000), "test": models(5000, 5000, 5000)})
    assert said == [
        "On validation, ResNet18 is 25.0 % below the mean array and 50.0 % above the nearest "
        "neighbour.",
        "On the objects, ResNet18 is level with the mean array and level with the nearest "
        "neighbour.",
    ]


def test_samples_stand_at_their_quantiles(page: Path, data_dir: Path, runs: list[Path]) -> None:
    material = gather(page.parent, data_dir, runs)
    evaluated = material.evaluated["val"]
    error = (evaluated.errors("touch2touch") + evaluated.errors("resnet18")) / 2
    rows = qualitative.chosen(material, "val")
    assert [quantile for _, quantile in rows] == [0.1, 0.5, 0.9, 1.0]
    assert rows[-1][0] == error.argmax()
    for row, quantile in rows:
        assert abs(np.mean(error <= error[row]) - quantile) <= 1.5 / error.size
    # Two test pairs cannot fill five places, and none is shown twice.
    assert [row for row, _ in qualitative.chosen(material, "test")] in ([0, 1], [1, 0])


def test_pairs_are_of_every_family_and_all_different(
    page: Path, data_dir: Path, runs: list[Path]
) -> None:
    material = gather(page.parent, data_dir, runs)
    chosen = pairs.chosen(material)
    assert len(set(chosen)) == len(chosen) == pairs.PAIRS
    families = {material.tables[split]["family"][row].as_py() for split, row in chosen}
    assert families == {"circle", "square", "hemisphere", "line-sharp", "wrench", "allen-key"}


def test_pictures_are_those_of_their_rows(page: Path, data_dir: Path, runs: list[Path]) -> None:
    """Translated again, a sample's picture gives the very counts that the evaluation gave."""
    material = gather(page.parent, data_dir, runs)
    for row in range(material.tables["val"].num_rows):
        again = material.runs["resnet18"].predict([material.picture("val", row)])
        expected = material.evaluated["val"].predictions["resnet18"][row]
        np.testing.assert_allclose(again[0], expected, rtol=1e-3, atol=1.0)


def test_evaluation_is_taken_up_again(page: Path, data_dir: Path, runs: list[Path]) -> None:
    path = page.parent / "evaluate-val" / METRICS
    before = path.stat().st_mtime_ns
    gather(page.parent, data_dir, runs)
    assert path.stat().st_mtime_ns == before
    gather(page.parent, data_dir, runs[::-1])
    assert path.stat().st_mtime_ns > before


def read_page(page: Path) -> tuple[Reader, str]:
    reader, text = Reader(), page.read_text(encoding="utf-8")
    reader.feed(text)
    reader.close()
    assert reader.open == []
    return reader, re.sub(r"<[^>]+>", " ", text)


def test_a_dataset_alone_has_a_page_of_its_own(data_dir: Path, tmp_path: Path) -> None:
    main(["report", "--data", str(data_dir), "--out", str(tmp_path)])
    read, text = read_page(tmp_path / PAGE)
    sections = [attrs["id"] for tag, attrs in read.tags if tag == "section"]
    assert sections == ["about", *data_page.LINKS]
    assert len([tag for tag, _ in read.tags if tag == "img"]) == 1 + 1 + pairs.PAIRS + 2 + 1 + 1 + 1
    assert "12 pairs of 4 shapes" in text and "2 pairs of 2 shapes" in text
    assert "none of 20 " in text  # without contact
    assert sum(len(table) for table in gather_dataset(data_dir).tables.values()) == 20


def test_near_duplicates_are_found_and_no_others(data_dir: Path, tmp_path: Path) -> None:
    """One press taken twice, with another noise, among presses that differ."""
    folder = tmp_path / "data"
    shutil.copytree(data_dir, folder)
    before = gather_dataset(folder)
    noise = oddities.noise_grey(before)
    assert not oddities.near_duplicates(before, scan(before, noise)).any()
    path = folder / "train/square-1.parquet"
    rows = pq.ParquetFile(path).read().to_pylist()
    rng = np.random.default_rng(0)
    shaken = rng.normal(0.0, noise, (320, 240, 3))
    again = np.clip(np.rint(decode_png(rows[1]["image"]["bytes"]) + shaken), 0, 255)
    picture = {"bytes": encode_png(again.astype(np.uint8)), "path": ""}
    felt = np.array(rows[0]["taxels"])
    write_shard(
        path,
        [
            *rows,
            rows[1] | {"image": picture, "index": 587},
            # looks like another press, but feels otherwise
            rows[0] | {"index": 588, "taxels": (felt + 200).tolist()},
        ],
    )
    dataset = gather_dataset(folder)
    looked = scan(dataset, noise)
    found = np.flatnonzero(oddities.near_duplicates(dataset, looked))
    assert [dataset.column("index")[place] for place in found] == [rows[1]["index"], 587]
    assert looked.alike_counts[found].max() == 0
    alike = np.flatnonzero(np.isfinite(looked.alike_counts))
    assert {rows[0]["index"], 588} <= {int(dataset.column("index")[place]) for place in alike}


def test_what_is_far_from_its_shape_is_an_outlier() -> None:
    values = np.array([1.0, 1.1, 0.9, 1.05, 9.0, 5.0, 5.0, 5.0, 5.2])
    groups = np.array(["a"] * 5 + ["b"] * 4)
    far = oddities.deviations(values, groups)
    assert far.argmax() == 4 and far[4] > 50
    assert far[5:8].max() == 0 and far[8] == pytest.approx(0.2 / (0.02 * 5.0))


def test_nearest_others_are_those_of_plain_arithmetic() -> None:
    rng = np.random.default_rng(0)
    coarse = rng.normal(0, 5, (300, 60)).astype(np.float32)
    counts = rng.uniform(0, 40_000, (300, 20))
    apart, felt = (
        np.sqrt(np.square(of[:, None] - of[None]).mean(axis=2)) for of in (coarse, counts)
    )
    apart[np.diag_indices(300)] = np.inf
    noise = float(np.quantile(apart, 0.01))
    nearest, alike = nearest_others(coarse, counts, noise)
    np.testing.assert_allclose(nearest, apart.min(axis=1), rtol=1e-3)
    expected = np.where(apart < noise, felt, np.inf).min(axis=1)
    assert 0 < np.isfinite(expected).sum() < 300
    np.testing.assert_allclose(alike, expected, rtol=1e-3)
    assert np.isinf(nearest_others(coarse[:1], counts[:1], noise)).all()
