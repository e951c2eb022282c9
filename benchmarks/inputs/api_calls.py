"""The public functions of the Python API, called with one value in the place of one argument."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

from msgspec import structs
from PIL import Image

import t2twin
from benchmarks.inputs.api_values import FRAME, PICTURE, PRESSES, SMALL, TABLE
from benchmarks.inputs.case import Base

Call = Callable[[Any, Path, Base], object]
"""Calls the API with a value, in a box, with the good inputs of a base."""


def recipe(**changed: Any) -> t2twin.Recipe:
    return structs.replace(t2twin.load_recipe("union"), **changed)


def files(box: Path, base: Base) -> None:
    """A picture, a table of one pair, and frames of presses."""
    Image.fromarray(FRAME).save(box / PICTURE)
    heads, counts = (",".join(f"{word}{n}" for n in range(20)) for word in ("taxel_", "1"))
    (box / TABLE).write_text(f"image,{heads}\n{PICTURE},{counts}\n")
    (box / PRESSES).mkdir()
    for number in range(9):
        frame = FRAME.copy()
        frame[100 + 10 * number :][:40, 100:140] = 200
        Image.fromarray(frame).save(box / PRESSES / f"{number}.png", compress_level=1)


def calibrate(**changed: Any) -> object:
    arguments: dict[str, Any] = {"ball_diameter_mm": 5.0} | changed
    return t2twin.calibrate(PICTURE, PRESSES, **arguments)


@cache
def run_of(name: str | Path) -> Any:
    return t2twin.load(name, engine="torch")


@cache
def field_run() -> Any:
    return run_of("field")


@cache
def turned_round(run_dir: Path) -> Any:
    """A run from counts to pictures, of random weights."""
    from t2twin.translate.inference.predictor import ImagePredictor
    from t2twin.translate.runs.build import build

    own = run_of(run_dir)
    config = structs.replace(own.config, direction="cyskin-to-digit")
    return ImagePredictor(own.run_dir, config, build(config))  # pyright: ignore[reportArgumentType]


def elastomer(**changed: Any) -> object:
    return replace(t2twin.Twin().sensors.digit.gel, **changed)


def layout(**changed: Any) -> object:
    return replace(t2twin.load_layout(), **changed)


def _twin(name: str, value: Any) -> object:
    return t2twin.Twin(**{name: value})


def _press(name: str, value: Any, box: Path, base: Base) -> object:
    return t2twin.press("circle-1", **{name: value})


NUMBERS: Mapping[str, Call] = {
    **{f"press {name}": partial(_press, name) for name in ("force_n", "depth_mm", "x_mm", "y_mm",
                                                           "yaw_deg")},
    "load_shape scale": lambda value, box, base: t2twin.load_shape("x.stl", scale=value),
    "interval level": lambda value, box, base: field_run().estimate(SMALL).interval(value),
    "Elastomer young_mpa": lambda value, box, base: elastomer(young_mpa=value),
    "Elastomer dome_flat_mm": lambda value, box, base: elastomer(dome_flat_mm=value),
    "PressCommand x_mm": lambda value, box, base: t2twin.PressCommand("a", value, 0.0, 0.0, 1.0),
    "train minutes": lambda value, box, base: t2twin.train(
        "resnet18", base.data, "smoke", "out", minutes=value
    ),
    "calibrate ball_diameter_mm": lambda value, box, base: calibrate(ball_diameter_mm=value),
    "adapt minutes": lambda value, box, base: t2twin.adapt("a", "b", 5.0, "out", minutes=value),
}  # fmt: skip

WHOLE_NUMBERS: Mapping[str, Call] = {
    "press seed": partial(_press, "seed"),
    "sample_fields number": lambda value, box, base: field_run().sample_fields(SMALL, value),
    "sample_fields seed": lambda value, box, base: field_run().sample_fields(SMALL, 1, seed=value),
    "make_dataset seed": lambda value, box, base: t2twin.make_dataset("out", "smoke", seed=value),
    "make_dataset workers": lambda value, box, base: t2twin.make_dataset(
        "out", "smoke", workers=value
    ),
    "train seed": lambda value, box, base: t2twin.train(
        "resnet18", base.data, "smoke", "out", seed=value
    ),
    "train epochs": lambda value, box, base: t2twin.train(
        "resnet18", base.data, "smoke", "out", epochs=value
    ),
    "import_pairs seed": lambda value, box, base: t2twin.import_pairs(
        TABLE, "out", t2twin.load_layout(), seed=value
    ),
    "import_pairs full_scale": lambda value, box, base: t2twin.import_pairs(
        TABLE, "out", t2twin.load_layout(), full_scale=value
    ),
    "calibrate held_out": lambda value, box, base: calibrate(held_out=value),
}

PATHS: Mapping[str, Call] = {
    "press shape": lambda value, box, base: t2twin.press(value),
    "load_shape": lambda value, box, base: t2twin.load_shape(value),
    "load": lambda value, box, base: t2twin.load(value),
    "load_layout": lambda value, box, base: t2twin.load_layout(value),
    "load_recipe": lambda value, box, base: t2twin.load_recipe(value),
    "Twin layout": lambda value, box, base: _twin("layout", value),
    "save": lambda value, box, base: t2twin.press("circle-1").save(value),
    "export_shapes": lambda value, box, base: t2twin.export_shapes(value),
    "guess_light": lambda value, box, base: t2twin.guess_light(value),
    "calibrate background": lambda value, box, base: t2twin.calibrate(value, "presses", 5.0),
    "calibrate presses": lambda value, box, base: t2twin.calibrate("frame.png", value, 5.0),
    "make_dataset folder": lambda value, box, base: t2twin.make_dataset(value, "smoke"),
    "verify_dataset": lambda value, box, base: t2twin.verify_dataset(value),
    "import_pairs source": lambda value, box, base: t2twin.import_pairs(
        value, "out", t2twin.load_layout()
    ),
    "import_pairs folder": lambda value, box, base: t2twin.import_pairs(
        TABLE, value, t2twin.load_layout()
    ),
    "train data_dir": lambda value, box, base: t2twin.train("resnet18", value, "smoke", "out"),
    "train out_dir": lambda value, box, base: t2twin.train("resnet18", base.data, "smoke", value),
    "evaluate data_dir": lambda value, box, base: t2twin.evaluate(
        [base.resnet18], value, "val", "out"
    ),
    "evaluate out_dir": lambda value, box, base: t2twin.evaluate(
        [base.resnet18], base.data, "val", value
    ),
    "evaluate_worlds out_dir": lambda value, box, base: t2twin.evaluate_worlds(
        [base.resnet18], [base.data], "val", value
    ),
    "export_onnx path": lambda value, box, base: t2twin.export_onnx(run_of(base.resnet18), value),
    "translate_images run": lambda value, box, base: t2twin.translate_images(
        [PICTURE], "out", value
    ),
    "translate_images out_dir": lambda value, box, base: t2twin.translate_images(
        [PICTURE], value, base.resnet18
    ),
    "write_report out": lambda value, box, base: t2twin.write_report(
        value, base.data, [base.resnet18]
    ),
    "write_report data": lambda value, box, base: t2twin.write_report(
        "out", value, [base.resnet18]
    ),
    "write_data_report out": lambda value, box, base: t2twin.write_data_report(value, base.data),
    "write_data_report data": lambda value, box, base: t2twin.write_data_report("out", value),
    "adapt background": lambda value, box, base: t2twin.adapt(value, "presses", 5.0, "out"),
    "adapt presses": lambda value, box, base: t2twin.adapt("frame.png", value, 5.0, "out"),
    "adapt out": lambda value, box, base: t2twin.adapt("frame.png", "presses", 5.0, value),
}

OPTIONAL_PATHS: Mapping[str, Call] = {
    "load layout": lambda value, box, base: t2twin.load("field", value),
    "Twin calibration": lambda value, box, base: _twin("calibration", value),
    "make_dataset world": lambda value, box, base: t2twin.make_dataset("out", world=value),
    "make_dataset cache": lambda value, box, base: t2twin.make_dataset(
        "out", "smoke", cache=value
    ),
    "train init_from": lambda value, box, base: t2twin.train(
        "resnet18", base.data, "smoke", "out", init_from=value
    ),
    "translate_images background": lambda value, box, base: t2twin.translate_images(
        [PICTURE], "out", background=value
    ),
    "write_report evaluation": lambda value, box, base: t2twin.write_report(
        "out", base.data, [base.resnet18], value
    ),
}  # fmt: skip

LISTS: Mapping[str, Call] = {
    "evaluate runs": lambda value, box, base: t2twin.evaluate(value, base.data, "val", "out"),
    "evaluate_worlds runs": lambda value, box, base: t2twin.evaluate_worlds(
        value, [base.data], "val", "out"
    ),
    "evaluate_worlds data_dirs": lambda value, box, base: t2twin.evaluate_worlds(
        [base.resnet18], value, "val", "out"
    ),
    "write_report runs": lambda value, box, base: t2twin.write_report("out", base.data, value),
    "translate_images paths": lambda value, box, base: t2twin.translate_images(value, "out"),
    "make_dataset shapes": lambda value, box, base: t2twin.make_dataset(
        "out", "smoke", shapes=value
    ),
}

OBJECTS: Mapping[str, Call] = {
    "Twin gel": lambda value, box, base: _twin("gel", value),
    "Twin cover": lambda value, box, base: _twin("cover", value),
    "export_onnx run": lambda value, box, base: t2twin.export_onnx(value, "x.onnx"),
    "import_pairs layout": lambda value, box, base: t2twin.import_pairs(TABLE, "out", value),
    "adapt tolerance": lambda value, box, base: t2twin.adapt("a", "b", 5.0, "out", tolerance=value),
    "adapt report": lambda value, box, base: t2twin.adapt("a", "b", 5.0, "out", report=value),
}

WORDS: Mapping[str, Call] = {
    "Twin imperfections": lambda value, box, base: _twin("imperfections", value),
    "Twin optics": lambda value, box, base: _twin("optics", value),
    "Elastomer law": lambda value, box, base: elastomer(law=value),
    "evaluate split": lambda value, box, base: t2twin.evaluate(
        [base.resnet18], base.data, value, "out"
    ),
    "evaluate_worlds split": lambda value, box, base: t2twin.evaluate_worlds(
        [base.resnet18], [base.data], value, "out"
    ),
    "train model": lambda value, box, base: t2twin.train(value, base.data, "smoke", "out"),
    "train preset": lambda value, box, base: t2twin.train("resnet18", base.data, value, "out"),
    "train direction": lambda value, box, base: t2twin.train(
        "touch2touch", base.data, "smoke", "out", direction=value
    ),
    "adapt model": lambda value, box, base: t2twin.adapt("a", "b", 5.0, "out", model=value),
    "make_dataset scale": lambda value, box, base: t2twin.make_dataset("out", value),
}

ARRAYS: Mapping[str, Call] = {
    "predict_image counts": lambda value, box, base: turned_round(base.touch2touch).predict_image(
        value
    ),
    "Layout x_mm": lambda value, box, base: layout(x_mm=value),
    "Layout pad_diameter_mm": lambda value, box, base: layout(pad_diameter_mm=value),
    "at_layout x_mm": lambda value, box, base: field_run().at_layout(value, value, "mine"),
}
