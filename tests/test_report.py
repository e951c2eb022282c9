"""The report of a small dataset and two short runs: whole, self-contained, and true to metrics."""

import base64
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec import structs
from pages import Reader, read_page

from t2twin.cli import main
from t2twin.core.errors import T2TwinWarning
from t2twin.core.files import write_json
from t2twin.report import dataset_report, run_report
from t2twin.report.page import PAGE, name_of, render_section
from t2twin.report.run_report import SECTIONS, ReportData, read_report_data, write_report
from t2twin.translate.evaluation.evaluate import PREDICTIONS, TRUTH
from t2twin.translate.evaluation.records import METRICS, Evaluation, read_evaluation
from t2twin.translate.evaluation.table import PAPER, figures_tables


@pytest.fixture(scope="module")
def data_dir(small_dataset: Path) -> Path:
    return small_dataset


@pytest.fixture(scope="module")
def page(data_dir: Path, runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(tmp_path_factory.mktemp("out") / "report", data_dir, runs)


@pytest.fixture(scope="module")
def read(page: Path) -> Reader:
    return read_page(page)[0]


def test_page_holds_every_section_and_needs_nothing_but_itself(page: Path, read: Reader) -> None:
    """Every picture is a whole embedded file; nothing is fetched and nothing runs."""
    drawn = [name for name in SECTIONS if name != "uncertainty"]  # no run has it
    assert [attrs["id"] for tag, attrs in read.tags if tag == "section"] == drawn
    anchors = [attrs["href"] for tag, attrs in read.tags if tag == "a"]
    assert anchors == [f"#{name}" for name in drawn[2:]]
    images = [attrs for tag, attrs in read.tags if tag == "img"]
    assert len(images) >= 3 + dataset_report.PAIRS + 1 + 2 + 2
    starts = {"image/png": b"\x89PNG", "image/jpeg": b"\xff\xd8", "image/svg+xml": b"<?xml"}
    for attrs in images:
        kind, _, content = (attrs["src"] or "").removeprefix("data:").partition(";base64,")
        assert base64.b64decode(content, validate=True).startswith(starts[kind])
        assert attrs["alt"]
    assert not {"script", "link", "iframe"} & {tag for tag, _ in read.tags}
    assert "url(" not in page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def evaluations(page: Path) -> dict[str, Evaluation]:
    """What the page was drawn from, by split."""
    return {s: read_evaluation(page.parent / f"evaluate-{s}") for s in ("val", "test")}


def test_table_has_the_numbers_of_metrics(evaluations: dict[str, Evaluation], read: Reader) -> None:
    rows: dict[str, list[list[str]]] = {}
    for name, *cells in read.rows["results"]:
        rows.setdefault(name, []).append(cells)
    assert list(evaluations["val"].models) == [
        "mean-array", "nearest-neighbor", "noise-floor", "touch2touch", "resnet18",
    ]  # fmt: skip
    for name in evaluations["val"].models:
        for split, cells in zip(("val", "test"), rows[name_of(name)][::2], strict=True):
            overall = evaluations[split].models[name].overall
            assert [cell.split(" (")[0] for cell in cells] == [
                f"{overall['rmse_counts']:,.0f}",
                f"{overall['rmse_percent']:.2f}",
                f"{overall['ssim']:.3f}",
            ]
    assert rows[f"touch2touch, {PAPER}"] == [["4,007", "10.01", "0.96"], ["6,072", "15.18", "–"]]
    assert rows[f"ResNet18, {PAPER}"] == [["3,931", "9.83", "0.95"], ["4,867", "12.17", "–"]]
    for evaluation, cells in zip(evaluations.values(), rows["ResNet18"][1::2], strict=True):
        one = evaluation.models["resnet18"].overall
        counts = [one[f"rmse_{part}_counts"] for part in ("under", "near", "beyond")]
        assert cells[4:7] == [f"{count:,.0f}" for count in counts]


def test_counts_of_a_small_full_scale_have_a_decimal(evaluations: dict[str, Evaluation]) -> None:
    small = replace(evaluations["val"], full_scale_counts=255.0)
    for one, form in ((evaluations["val"], "{:,.0f}"), (small, "{:,.1f}")):
        rows = {row[0]: row[1] for row in figures_tables(one)[0].groups[""]}
        expected = form.format(one.models["resnet18"].overall["rmse_counts"])
        assert rows["resnet18"].split(" (")[0] == expected


@pytest.fixture(scope="module")
def report_data(page: Path, data_dir: Path, runs: list[Path]) -> ReportData:
    return read_report_data(page.parent, data_dir, runs)


def test_limits_name_the_optics(report_data: ReportData, read: Reader) -> None:
    own = "the light in the sensor's file, which was not calibrated on your sensor"
    assert own in read.text("limits")
    other = structs.replace(report_data.info.source, optics_sha256="0123456789ab" + 52 * "0")
    report = replace(report_data, info=replace(report_data.info, source=other))
    text = render_section(
        run_report.TEMPLATES, "limits", report=report, **run_report.limits(report)
    )
    assert own not in " ".join(text.split()) and "(SHA-256 0123456789ab)" in text


def test_samples_stand_at_their_quantiles(report_data: ReportData) -> None:
    predictions = report_data.predictions["val"]
    error = (predictions.rmse_counts("touch2touch") + predictions.rmse_counts("resnet18")) / 2
    rows = run_report.samples_at_quantiles(report_data, "val")
    assert [quantile for _, quantile in rows] == [0.1, 0.5, 0.9, 1.0]
    assert rows[-1][0] == error.argmax()
    for row, quantile in rows:
        assert abs(np.mean(error <= error[row]) - quantile) <= 1.5 / error.size
    # Two test pairs cannot fill five places, and none is shown twice.
    assert [row for row, _ in run_report.samples_at_quantiles(report_data, "test")] in (
        [0, 1],
        [1, 0],
    )


def test_pairs_are_sampled_in_turn(report_data: ReportData) -> None:
    """One of each shape, then one more of each; some shapes have fewer than others."""
    picked = report_data.sample_in_turn("shape", 100)
    assert sorted(picked) == list(range(len(report_data.table)))
    assert report_data.table["shape"].iloc[picked[:8]].nunique() == 8
    assert report_data.sample_in_turn("shape", 5) == picked[:5]
    families = report_data.table["family"].iloc[report_data.sample_in_turn("family", 12)]
    assert set(families) == {
        "circle", "square", "hemisphere", "line-sharp", "wrench", "allen-key",
    }  # fmt: skip


def test_images_are_those_of_their_rows(report_data: ReportData) -> None:
    """A sample's image translated again gives the counts of the evaluation."""
    for row, place in enumerate(report_data.pairs_of("val").tolist()):
        again = report_data.runs["resnet18"].predict([report_data.image(place)])
        expected = report_data.predictions["val"].by_model["resnet18"][row]
        np.testing.assert_allclose(again[0], expected, rtol=1e-3, atol=1.0)


def refuse(*arguments: object) -> None:
    raise AssertionError("evaluated again")


def test_evaluations_are_taken_up_again(
    page: Path, data_dir: Path, runs: list[Path], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """The report's own, also of copied runs, not in another order; one beside it; one named."""
    monkeypatch.setattr(run_report, "evaluate", refuse)
    here, out, named = page.parent, tmp_path / "report", tmp_path / "named"
    own = {split: here / f"evaluate-{split}" for split in ("val", "test")}
    assert read_report_data(here, data_dir, runs).folders == own
    copies = [shutil.copytree(run, tmp_path / run.name) for run in runs]
    assert read_report_data(here, data_dir, copies).folders == own
    with pytest.raises(AssertionError, match="evaluated again"):
        read_report_data(here, data_dir, runs[::-1])
    for split, folder in own.items():
        for copy in ("evaluate", "named"):
            shutil.copytree(folder, tmp_path / copy / split)
    beside = read_report_data(out, data_dir, runs).folders
    assert beside == {split: tmp_path / "evaluate" / split for split in own} and not out.exists()
    monkeypatch.setattr(run_report, "draw_report", lambda out, report_data: out / PAGE)
    arguments = ["report", "--data", str(data_dir), "--out", str(out), "--runs", *map(str, runs)]
    main([*arguments, "--evaluation", str(named)])
    said = f"using the evaluation in {named / 'val'} and {named / 'test'}\n"
    assert said in capsys.readouterr().out
    (named / "val" / METRICS).write_text("{")  # each split is scanned for by itself
    with pytest.warns(T2TwinWarning, match="is not used for val"):
        mixed = read_report_data(out, data_dir, runs, named).folders
    assert mixed == {"val": tmp_path / "evaluate" / "val", "test": named / "test"}


def test_an_evaluation_of_something_else_is_not_drawn(page, data_dir, runs, tmp_path, monkeypatch):
    monkeypatch.setattr(run_report, "evaluate", refuse)
    own = tmp_path / "evaluate-val"
    for split in ("val", "test"):
        shutil.copytree(page.parent / f"evaluate-{split}", tmp_path / f"evaluate-{split}")
    evaluation, arrays = read_evaluation(own), dict(np.load(own / PREDICTIONS))
    model = replace(evaluation.models["resnet18"], weights_sha256="0" * 64)
    others = [
        replace(evaluation, models=evaluation.models | {"resnet18": model}),
        replace(evaluation, info_sha256="0" * 64), replace(evaluation, split="test"),
        replace(evaluation, format=2), evaluation,
    ]  # fmt: skip
    for other in others:
        write_json(own / METRICS, msgspec.to_builtins(other))
        if other is evaluation:
            np.savez(own / PREDICTIONS, **arrays | {TRUTH: arrays[TRUTH][1:]})
        with pytest.raises(AssertionError, match="evaluated again"):
            read_report_data(tmp_path, data_dir, runs)
