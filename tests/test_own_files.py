"""No command replaces a file that it did not write, or an input."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import t2twin
from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.files import OWN, check_own, result_folder


def write(
    folder: Path, *names: str, kind: str = "press", text: str = "own", **options: Any
) -> None:
    with result_folder(folder, kind, **options) as temporary:
        for name in names:
            (temporary / name).parent.mkdir(exist_ok=True)
            (temporary / name).write_text(text)


def test_an_earlier_result_is_replaced_and_nothing_else(tmp_path: Path) -> None:
    write(tmp_path, "a", "b", "changed", "frames/0")
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "changed").write_text("mine")
    write(tmp_path, "a", text="new")
    assert {path.name for path in tmp_path.glob("[!.]*")} == {"a", "changed", "mine"}
    assert (tmp_path / "a").read_text() == "new" and (tmp_path / OWN).is_file()
    (tmp_path / "link").hardlink_to(tmp_path / "a")
    wrong: list[tuple[str, dict[str, Any]]] = [
        ("changed", {}), ("mine", {}), ("a", {"kind": "slide"}),
        ("a", {"inputs": [tmp_path / "link"]}),
    ]  # fmt: skip
    for name, options in wrong:
        with pytest.raises(T2TwinError, match=rf"{name} (exists|is an input)"):
            write(tmp_path, "b", name, **options)
        assert not (tmp_path / "b").exists() and (tmp_path / "mine").read_text() == "mine"
    check_own(tmp_path, ["mine"], force=True)
    (tmp_path / OWN).write_text("damaged")
    with pytest.raises(T2TwinError, match="a exists"):
        write(tmp_path, "a")


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    return t2twin.press("hemisphere-4", force_n=6).image


@pytest.mark.parametrize(
    ("line", "file"),
    [
        ("press hemisphere-4 --out .", "press.json"),
        ("slide hemisphere-4 --dx-mm 0.2 --steps 1 --out .", "slide.png"),
        ("translate x.png --out .", "counts.csv"),
        ("translate x.png --out . --target contact", "x.json"),
        ("translate x.png x_depth.png --out . --target contact", "x_depth.png"),
        ("evaluate field --data DATA --split val --out .", "metrics.json"),
        ("report --data DATA --out .", "index.html"),
        ("primitives --out .", "manifest.json"),
        ("calibrate --background x.png --out .", "optics.npz"),
        ("sensors check digit --out mine.png", "mine.png"),
        ("sensors check mine.toml --out mine.toml", "mine.toml"),
        ("export --out mine.onnx", "mine.onnx"),
        ("export --out mine.onnx --run field", "mine.onnx"),
        ("slide hemisphere-4 --dx-mm 0.2 --steps 1 --rerun mine.rrd", "mine.rrd"),
        ("simdata --scale smoke --out .", "x.png"),
        ("train resnet18 --data DATA --preset smoke --out .", "x.png"),
    ],
)  # fmt: skip
def test_no_command_replaces_a_users_file(
    line: str, file: str, image: np.ndarray, small_dataset: Path, untrained_runs: list[Path],
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr("t2twin.rerun_log.find_spec", lambda name: True)
    (run,) = [each for each in untrained_runs if "resnet18" in each.name]
    line, path = line.replace("DATA", str(small_dataset)), Path(file.replace("RUN", str(run)))
    if not path.exists():
        Image.fromarray(image).save(path, "PNG")
    if file == "mine.toml":
        path.write_text('extends = "digit"\nname = "mine"\n')
    Image.fromarray(image).save("x.png")
    before = path.read_bytes()
    with pytest.raises(SystemExit):
        main(line.replace("RUN", str(run)).split())
    assert re.search(r"exists|is an input|not empty|contains no run", capsys.readouterr().err)
    assert path.read_bytes() == before
