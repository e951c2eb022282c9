"""The report of runs on a user's own pairs: whichever splits, sizes and names they have."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pages import Reader, draw_only, read_page
from PIL import Image

from t2twin.cli import main
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.report.page import PAGE
from t2twin.report.run_report import SECTIONS, write_report
from t2twin.sim.dataset.import_pairs import import_pairs
from t2twin.sim.taxels.layout import load_layout

ROWS, COLUMNS = 24, 48
FULL_SCALE = 1000
LAYOUT_CSV = "x_mm,y_mm\n0,0\n8,0\n0,8\n8,8\n4,4\n"
NAMES = ("$\\foo_{$", "<script>alert(1)</script>", "x" * 200, "two\nlines\x07")
NOT_DRAWN = {"forces", "uncertainty"}
"""Imported pairs have no forces here, and these runs predict no uncertainty."""


def own_pairs(folder: Path, splits: str, shapes: tuple[str, ...] = (), poses: bool = False) -> Path:
    """A dataset of a light on a wide grey picture and five counts; splits: a letter a pair."""
    rng = np.random.default_rng(len(splits))
    source = folder / "source"
    source.mkdir(parents=True)
    (folder / "mine.csv").write_text(LAYOUT_CSV)
    layout = load_layout(folder / "mine.csv")
    names = {"t": "train", "v": "val", "s": "test"}
    rows = []
    down, across = np.mgrid[:ROWS, :COLUMNS]
    for row, letter in enumerate(splits):
        x, y = rng.uniform(0, COLUMNS), rng.uniform(0, ROWS)
        light = 40 + 180 * np.exp(-((across - x) ** 2 + (down - y) ** 2) / 40)
        Image.fromarray(light.astype(np.uint8)).save(source / f"{row}.png")
        away = (layout.x_mm - x / 6) ** 2 + (layout.y_mm - y / 3) ** 2
        counts = np.rint(0.9 * FULL_SCALE * np.exp(-away / 20)).astype(int)
        rows.append(
            {"image": f"{row}.png", "split": names[letter]}
            | {f"taxel_{number}": count for number, count in enumerate(counts)}
            | ({"shape": shapes[row % len(shapes)]} if shapes else {})
            | ({"x_mm": 1.5 if row % 2 else ""} if poses else {})
        )
    pd.DataFrame(rows).to_csv(source / "pairs.csv", index=False)
    with pytest.warns(T2TwinWarning, match=f"are {COLUMNS} x {ROWS} pixels|are without color"):
        import_pairs(source, folder / "data", layout, full_scale=FULL_SCALE)
    return folder / "data"


@pytest.fixture(scope="module")
def data_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Training and validation alone, of shapes with the oddest names."""
    return own_pairs(tmp_path_factory.mktemp("own"), 16 * "t" + 8 * "v", NAMES, poses=True)


@pytest.fixture(scope="module")
def page(data_dir: Path, runs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_report(tmp_path_factory.mktemp("out"), data_dir, runs)


@pytest.fixture(scope="module")
def read(page: Path) -> Reader:
    return read_page(page)[0]


def test_what_is_known_is_drawn_and_nothing_else(page: Path, read: Reader) -> None:
    sections = [attrs["id"] for tag, attrs in read.tags if tag == "section"]
    assert sections == [name for name in SECTIONS if name not in NOT_DRAWN]
    text = read_page(page)[1]
    for word in ("Grella et al. 2023, on hardware", "hand tool", "primitive", "simulated", "None"):
        assert word not in text
    assert {path.name for path in page.parent.glob("[!.]*")} == {"evaluate-val", PAGE}


def test_names_from_outside_do_no_harm(page: Path, read: Reader) -> None:
    assert not {"script", "link", "iframe"} & {tag for tag, _ in read.tags}
    text = page.read_text(encoding="utf-8")
    assert "$\\foo_{$" in text and 30 * "x" not in text and "\x07" not in text


def test_test_pairs_alone_are_evaluated_and_drawn(
    runs: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Pairs that the runs were not trained on, without shapes or poses."""
    draw_only(monkeypatch, "summary", "about", "samples")
    data = own_pairs(tmp_path, 8 * "t" + 3 * "s")
    given = [str(run) for run in runs]
    arguments = ["--data", str(data), "--out"]
    main(["evaluate", *given, "--split", "both", *arguments, str(tmp_path / "evaluate")])
    assert "test, 3 pairs" in capsys.readouterr().out
    there = sorted(path.name for path in (tmp_path / "evaluate").glob("[!.]*"))
    assert there == ["results.md", "test"]
    main(["report", "--runs", *given, *arguments, str(tmp_path / "report")])
    folder = tmp_path / "evaluate" / "test"
    assert f"using the evaluation in {folder}\n" in capsys.readouterr().out
    text = read_page(tmp_path / "report" / PAGE)[1]
    assert "Test, 3 pairs" in text and "Trained on another dataset than this one" in text
    assert re.search(r"Test, quantile 0\.1\. RMSE in counts", text)  # no place is known


@pytest.mark.parametrize(
    "splits, said", [("tttt", "neither validation nor test pairs"), ("sss", "no train pairs")]
)
def test_splits_that_cannot_be_evaluated_are_named(runs, tmp_path, splits, said):
    data = own_pairs(tmp_path, splits)
    with pytest.raises(T2TwinError, match=f"data has {said}; "):
        write_report(tmp_path / "report", data, runs)
    assert not (tmp_path / "report").exists()
