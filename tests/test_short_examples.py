"""The short examples and the notebook run, with reduced sizes where they have arguments for it."""

import json
import runpy
import sys
from functools import partial
from pathlib import Path

import matplotlib as mpl
import pytest
from pages import draw_only

import t2twin

EXAMPLES = Path(__file__).parents[1] / "examples"
ELSEWHERE = {"gripper.py", "gripper_figure.py", "gripper_scene.py", "ros2_node.py"}

RUNS = {
    "press_and_plot.py": (["--shape", "square-2", "--out", "press.png"], "press.png"),
    "slide.py": (["--steps", "2", "--distance-mm", "0.4", "--out", "slide.png"], "slide.png"),
    "own_shape_dataset.py": (["--presses", "2", "--out", "mine"], "mine/info.json"),
    "translate_images.py": (["--out", "translated"], "translated/counts_std.csv"),
}
"""Arguments of each example, and a file that it writes."""

SLOW = "own_shape_dataset.py"
"""The example that takes longest; tests/test_recipe_datasets.py has a recipe like its own."""


def run(example: str, *arguments: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [example, *arguments])
        with mpl.rc_context({"figure.max_open_warning": 0}):
            runpy.run_path(str(EXAMPLES / example), run_name="__main__")


@pytest.mark.parametrize(
    "example",
    [pytest.param(name, marks=pytest.mark.exhaustive if name == SLOW else ()) for name in RUNS],
)
def test_an_example_runs(example: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments, result = RUNS[example]
    monkeypatch.setattr(t2twin, "make_dataset", partial(t2twin.make_dataset, workers=1))
    run(example, *arguments)
    assert Path(result).is_file()


def test_train_and_evaluate(small_dataset: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    draw_only(monkeypatch, "summary", "results")
    arguments = ("--data", small_dataset, "--preset", "smoke", "--minutes", "0.02", "--out", "runs")
    run("train_and_evaluate.py", *map(str, arguments))
    assert Path("runs/report/index.html").is_file()


def test_adapt_to_a_sensor(calibrated, monkeypatch, capsys: pytest.CaptureFixture[str]) -> None:
    """The stand-ins are simulated; the optics, which takes long, is one of another sensor."""

    def calibrate(background: Path, presses: Path, *_: float, **__: object) -> object:
        assert background.is_file() and len(list(presses.iterdir())) == 16
        return calibrated

    monkeypatch.setattr(t2twin, "calibrate", calibrate)
    run("adapt_to_a_sensor.py", "--calibrate-only", "--out", "runs/mine")
    assert "held-out presses" in capsys.readouterr().out


def test_short_examples_are_tested() -> None:
    tested = {*RUNS, "train_and_evaluate.py", "adapt_to_a_sensor.py"}
    assert {path.name for path in EXAMPLES.glob("*.py")} == tested | ELSEWHERE


def test_the_notebook_runs_and_has_no_output() -> None:
    notebook = json.loads((EXAMPLES / "first_afternoon.ipynb").read_text())
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells)
    with mpl.rc_context({"backend": "agg"}):
        names: dict = {}
        for cell in cells:
            exec("".join(cell["source"]), names)
    assert names["inside"].sum() >= 14  # 18 of 20 are expected; 13 have a probability of 0.2 %
