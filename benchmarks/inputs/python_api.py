"""Wrong arguments of the Python API, argument by argument, and odd ones that are fine.

Each case calls one public function or method with one wrong value in one place.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

import t2twin
from benchmarks.inputs.case import Base, Case
from t2twin.translate.predict import TrainedTranslator

Call = Callable[[Any, Path, Base], object]
"""Calls the API with a value, in a box, with the good inputs of a base."""

FRAME = np.full((320, 240, 3), 100, np.uint8)
SMALL = FRAME[:32, :24]

NO_NUMBERS: dict[str, object] = {
    "text": "8", "a list": [8.0], "an array": np.ones(3), "complex": 8j, "a bool": True,
    "infinite": float("inf"), "NaN": np.float32("nan"), "a huge integer": 10**5000,
}  # fmt: skip
NO_WHOLE_NUMBERS: dict[str, object] = {
    "text": "1", "a fraction": 1.5, "NaN": float("nan"), "negative": -1, "a bool": True,
    "an array": np.ones(2, int), "a list": [1, 2],
}  # fmt: skip
NO_PATHS: dict[str, object] = {
    "None": None,
    "a number": 5,
    "bytes": b"x",
    "empty": "",
    "a NUL": "a\0",
}
NO_LISTS: dict[str, object] = {
    "None": None,
    "text": "run",
    "a path": Path("run"),
    "of None": [None],
}
NO_OBJECTS: dict[str, object] = {"None": None, "text": "x", "a dict": {}}
NO_ARRAYS: dict[str, object] = {
    "None": None, "text": "abc", "ragged": [[1.0, 2.0], [3.0]], "of text": ["a"] * 20,
    "complex": np.ones(20, complex), "NaN": np.full(20, np.nan), "of two axes": np.ones((5, 4, 3)),
}  # fmt: skip
NO_WORDS: dict[str, object] = {"None": None, "a number": 5, "unknown": "x", "a list": ["all"]}

NO_IMAGE: dict[str, tuple[object, str]] = {
    "RGBA": (np.zeros((32, 24, 4), np.uint8), "RGBA"),
    "channels first": (np.zeros((3, 32, 24), np.uint8), "channels-first"),
    "a grey batch": (np.zeros((4, 32, 24), np.uint8), "(B, h, w, 1)"),
    "two channels": (np.zeros((32, 24, 2), np.uint8), "shape (32, 24, 2)"),
    "one axis": (np.zeros(32, np.uint8), "shape (32,)"),
    "no axis": (np.uint8(3), "of type uint8"),
    "five axes": (np.zeros((1, 1, 8, 8, 3), np.uint8), "shape (1, 1, 8, 8, 3)"),
    "no rows": (np.zeros((0, 24, 3), np.uint8), "no pixels"),
    "float": (np.zeros((32, 24, 3)), "type float64"),
    "int64": (np.zeros((32, 24, 3), int), "type int64"),
    "bool": (np.zeros((32, 24), bool), "type bool"),
    "objects": (np.full((32, 24), None), "type object"),
    "a tensor": (torch.zeros((32, 24, 3), dtype=torch.uint8), "tensor.cpu().numpy()"),
    "a PIL image": (Image.new("RGB", (24, 32)), "PIL image"),
    "a path": (Path("press.png"), "reads a file"),
    "text": ("press.png", "reads a file"),
    "None": (None, "images is None"),
    "a dict": ({}, "of type dict"),
    "a number": (5, "expected an image"),
    "a nested list": ([[[1, 2, 3]]], "images[0]"),
    "a list with None": ([SMALL, None], "images[1] is None"),
    "a list with RGBA": ([np.zeros((32, 24, 4), np.uint8)], "images[0] has shape (32, 24, 4)"),
    "a list of batches": ([np.zeros((1, 32, 24, 3), np.uint8)], "images[0] has shape"),
    "an RGBA batch": (np.zeros((2, 32, 24, 4), np.uint8), "RGBA"),
    "a batch, channels first": (np.zeros((2, 3, 32, 24), np.uint8), "channels-first"),
}


@cache
def _run(name: str | Path) -> TrainedTranslator:
    return t2twin.load(name, engine="torch")


@cache
def _field() -> TrainedTranslator:
    return _run("field")


@cache
def _turned_round(run_dir: Path) -> TrainedTranslator:
    """A run from counts to pictures, of random weights."""
    from t2twin.translate.build import build

    own = _run(run_dir)
    config = replace(own.config, direction="cyskin-to-digit")
    return replace(own, config=config, translator=build(config))


def _elastomer(**changed: Any) -> object:
    return replace(t2twin.Twin().sensors.digit.gel, **changed)


def _layout(**changed: Any) -> object:
    return replace(t2twin.load_layout(), **changed)


def _twin(name: str, value: Any) -> object:
    return t2twin.Twin(**{name: value})


def _press(name: str, value: Any, box: Path, base: Base) -> object:
    return t2twin.press("circle-1", **{name: value})


NUMBERS: Mapping[str, Call] = {
    **{f"press {name}": partial(_press, name) for name in ("force_n", "depth_mm", "x_mm", "y_mm",
                                                           "yaw_deg")},
    "load_shape scale": lambda value, box, base: t2twin.load_shape("x.stl", scale=value),
    "interval level": lambda value, box, base: _field().estimate(SMALL).interval(value),
    "Elastomer young_mpa": lambda value, box, base: _elastomer(young_mpa=value),
    "Elastomer dome_flat_mm": lambda value, box, base: _elastomer(dome_flat_mm=value),
    "PressCommand x_mm": lambda value, box, base: t2twin.PressCommand("a", value, 0.0, 0.0, 1.0),
    "train minutes": lambda value, box, base: t2twin.train(
        "resnet18", base.data, "smoke", "out", minutes=value
    ),
    "calibrate ball_diameter_mm": lambda value, box, base: _calibrate(box, ball_diameter_mm=value),
    "adapt minutes": lambda value, box, base: t2twin.adapt("a", "b", 5.0, "out", minutes=value),
}  # fmt: skip

WHOLE_NUMBERS: Mapping[str, Call] = {
    "press seed": partial(_press, "seed"),
    "draw_fields number": lambda value, box, base: _field().draw_fields(SMALL, value),
    "draw_fields seed": lambda value, box, base: _field().draw_fields(SMALL, 1, seed=value),
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
        _table(box), "out", t2twin.load_layout(), seed=value
    ),
    "import_pairs full_scale": lambda value, box, base: t2twin.import_pairs(
        _table(box), "out", t2twin.load_layout(), full_scale=value
    ),
    "calibrate held_out": lambda value, box, base: _calibrate(box, held_out=value),
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
        _table(box), value, t2twin.load_layout()
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
    "export_onnx path": lambda value, box, base: t2twin.export_onnx(_run(base.resnet18), value),
    "translate_images run": lambda value, box, base: t2twin.translate_images(
        [_picture(box)], "out", value
    ),
    "translate_images out_dir": lambda value, box, base: t2twin.translate_images(
        [_picture(box)], value, base.resnet18
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
    "train start": lambda value, box, base: t2twin.train(
        "resnet18", base.data, "smoke", "out", start=value
    ),
    "translate_images background": lambda value, box, base: t2twin.translate_images(
        [_picture(box)], "out", background=value
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
    "import_pairs layout": lambda value, box, base: t2twin.import_pairs(_table(box), "out", value),
    "adapt tolerance": lambda value, box, base: t2twin.adapt("a", "b", 5.0, "out", tolerance=value),
    "adapt say": lambda value, box, base: t2twin.adapt("a", "b", 5.0, "out", say=value),
}

WORDS: Mapping[str, Call] = {
    "Twin imperfections": lambda value, box, base: _twin("imperfections", value),
    "Twin optics": lambda value, box, base: _twin("optics", value),
    "Elastomer law": lambda value, box, base: _elastomer(law=value),
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
    "picture_of counts": lambda value, box, base: _turned_round(base.touch2touch).picture_of(value),
    "Layout x_mm": lambda value, box, base: _layout(x_mm=value),
    "Layout pad_diameter_mm": lambda value, box, base: _layout(pad_diameter_mm=value),
    "at_layout x_mm": lambda value, box, base: _field().at_layout(value, np.arange(20.0), "mine"),
}

MORE: Mapping[str, tuple[Call, object, str]] = {
    "draw_fields of 10^9": (
        lambda value, box, base: _field().draw_fields(SMALL, value), 10**9, "expected a whole",
    ),
    "draw_fields of many images": (
        lambda value, box, base: _field().draw_fields([SMALL] * 3, value), 50_000, "in all",
    ),
    "estimate of no image": (lambda value, box, base: _field().estimate(value), [], "at least one"),
    "estimate of a run without a field": (
        lambda value, box, base: _run(base.resnet18).estimate(value), SMALL, "a field run does",
    ),
    "a background frame for a run without a field": (
        lambda value, box, base: _run(base.resnet18).predict(SMALL, value), SMALL, "field run",
    ),
    "picture_of a run to counts": (
        lambda value, box, base: _run(base.resnet18).picture_of(value), np.zeros(20), "draws no",
    ),
    "picture_of negative counts": (
        lambda value, box, base: _turned_round(base.touch2touch).picture_of(value),
        -np.ones(20), "no number from 0",
    ),
    "predict_pixels of another size": (
        lambda value, box, base: _field().predict_pixels(value), SMALL[None], "pixels have shape",
    ),
    "predict_pixels of floats": (
        lambda value, box, base: _field().predict_pixels(value), np.zeros((1, 96, 96, 3)), "uint8",
    ),
    "load an unknown run": (lambda value, box, base: t2twin.load(value), "feild", "no run feild"),
    "load an unknown engine": (
        lambda value, box, base: t2twin.load(engine=value), "jax", "no engine",
    ),
    "load an engine that is a list": (
        lambda value, box, base: t2twin.load(engine=value), ["onnx"], "expected text",
    ),
    "load bf16 that is text": (
        lambda value, box, base: t2twin.load(bf16=value), "no", "True or False",
    ),
    "translate_images pictures that is text": (
        lambda value, box, base: t2twin.translate_images([_picture(box)], "out", pictures=value),
        "no", "True or False",
    ),
    "a scale for a Shape": (
        lambda value, box, base: t2twin.load_shape(t2twin.load_shape("circle-1"), value),
        2.0, "for files only",
    ),
    "a Recipe of a wrong name": (
        lambda value, box, base: t2twin.make_dataset("out", world=_recipe(name=value)), 5, "name",
    ),
    "a Recipe of a wrong seed": (
        lambda value, box, base: t2twin.make_dataset("out", world=_recipe(seed=value)),
        "x", "whole number",
    ),
    "a Recipe without parts": (
        lambda value, box, base: t2twin.make_dataset("out", world=_recipe(parts=value)),
        (), "parts",
    ),
    "a Recipe of no parts": (
        lambda value, box, base: t2twin.make_dataset("out", world=_recipe(parts=value)), 5, "parts",
    ),
    "a shape that is a mesh": (
        lambda value, box, base: t2twin.press(value().mesh),
        lambda: t2twin.load_shape("circle-1"), "expected a path",
    ),
    "an Elastomer as thick as a house": (
        lambda value, box, base: _elastomer(thickness_mm=value), 3000, "from 0.1 to 200",
    ),
    "a Layout of sizes that differ": (
        lambda value, box, base: _layout(x_mm=value), np.arange(5.0), "has shape",
    ),
    "a Layout of two taxels": (
        lambda value, box, base: t2twin.Layout("two", value, value, value),
        [1.0, 2.0], "at least 3",
    ),
}  # fmt: skip


def _recipe(**changed: Any) -> t2twin.Recipe:
    from msgspec import structs

    return structs.replace(t2twin.load_recipe("union"), **changed)


def _picture(box: Path) -> Path:
    path = box / "press.png"
    if not path.exists():
        Image.fromarray(FRAME).save(path)
    return path


def _table(box: Path) -> Path:
    """A table of one pair."""
    _picture(box)
    (box / "pairs.csv").write_text(
        f"image,{','.join(f'taxel_{n}' for n in range(20))}\npress.png,{','.join(['5'] * 20)}\n"
    )
    return box / "pairs.csv"


def _calibrate(box: Path, **changed: Any) -> object:
    (box / "presses").mkdir()
    for number in range(9):
        frame = FRAME.copy()
        frame[100 + 10 * number :][:40, 100:140] = 200
        Image.fromarray(frame).save(box / f"presses/{number}.png")
    arguments = {"ball_diameter_mm": 5.0} | changed
    return t2twin.calibrate(_picture(box), box / "presses", **arguments)


def _fine(box: Path, base: Base) -> Iterator[tuple[str, Callable[[], bool]]]:
    """Odd but right calls, each with what must be true of its result."""
    field, resnet = _field(), _run(base.resnet18)
    one = field.predict(FRAME)
    grey = np.ascontiguousarray(FRAME[..., 0])
    yield "a grey image", lambda: field.predict(grey).shape == (20,)
    yield "a grey batch", lambda: field.predict(grey[None, :, :, None]).shape == (1, 20)
    yield "an image of one pixel", lambda: field.predict(FRAME[:1, :1]).shape == (20,)
    yield "an image of three rows", lambda: resnet.predict(FRAME[:3]).shape == (20,)
    yield "a flipped view", lambda: field.predict(FRAME[::-1, ::-1]).shape == (20,)
    yield "a tuple of sizes", lambda: field.predict((FRAME, SMALL, grey)).shape == (3, 20)
    yield "an empty list", lambda: field.predict([]).shape == (0, 20)
    yield "an empty batch", lambda: resnet.predict(FRAME[None][:0]).shape == (0, 20)
    yield "tactile images of none", lambda: resnet.tactile_images([]).shape == (0, 396, 240)
    yield "a grey background frame", lambda: field.predict(FRAME, grey).shape == (20,)
    yield (
        "background by name",
        lambda: field.estimate(FRAME, background=SMALL).counts.shape == (20,),
    )
    yield "the default run", lambda: np.abs(t2twin.load().predict(FRAME) - one).max() < 1.0
    yield (
        "NumPy's numbers",
        lambda: (
            t2twin.press(
                "circle-1", force_n=np.float32(8), x_mm=np.int64(1), seed=np.uint8(3)
            ).counts
            == t2twin.press("circle-1", force_n=8, x_mm=1, seed=3).counts
        ).all(),
    )
    yield "a level of NumPy", lambda: len(field.estimate(FRAME).interval(np.float64(0.5))) == 2
    yield "a number of NumPy", lambda: field.draw_fields(FRAME, np.int64(2)).shape == (2, 216)  # pyright: ignore
    yield (
        "taxels in lists",
        lambda: (
            field.at_layout(
                [0.0, 5.0, 9.0],
                [0, 5, 1],
                "three",  # pyright: ignore
            )
            .predict(FRAME)
            .shape
            == (3,)
        ),
    )
    yield (
        "a shape that is one already",
        lambda: t2twin.load_shape(t2twin.load_shape("circle-1")).name == "circle-1",
    )
    yield (
        "a flat gel",
        lambda: (
            _elastomer(dome_width_radius_mm=np.inf, dome_length_radius_mm=float("inf")) is not None
        ),
    )
    yield (
        "counts in a list",
        lambda: (
            _turned_round(base.touch2touch)
            .picture_of(
                [0] * 20  # pyright: ignore
            )
            .ndim
            == 2
        ),
    )
    yield (
        "paths as text and as Path",
        lambda: (
            t2twin.translate_images(
                (str(_picture(box)), _picture(box)), str(box / "out"), base.resnet18
            ).shape
            == (2, 20)
        ),
    )


FINE = (
    "a grey image", "a grey batch", "an image of one pixel", "an image of three rows",
    "a flipped view", "a tuple of sizes", "an empty list", "an empty batch",
    "tactile images of none", "a grey background frame", "background by name", "the default run",
    "NumPy's numbers", "a level of NumPy", "a number of NumPy", "taxels in lists",
    "a shape that is one already", "a flat gel", "counts in a list", "paths as text and as Path",
)  # fmt: skip


def _is_fine(name: str, box: Path, base: Base) -> None:
    assert dict(_fine(box, base))[name](), "another result than expected"


def _wrong(
    calls: Mapping[str, Call], values: Mapping[str, object], says: str = "expected"
) -> Iterator[Case]:
    for name, call in calls.items():
        for what, value in values.items():
            yield Case(f"{name}: {what}", (), call=partial(call, value), says=says)


def _images() -> Iterator[Case]:
    users: Mapping[str, Call] = {
        "predict": lambda value, box, base: _field().predict(value),
        "estimate": lambda value, box, base: _field().estimate(value),
        "draw_fields": lambda value, box, base: _field().draw_fields(value, 2),
        "tactile_images": lambda value, box, base: _run(base.touch2touch).tactile_images(value),
        "pixels_of": lambda value, box, base: _run(base.resnet18).pixels_of(value),
    }
    for number, (what, (value, says)) in enumerate(NO_IMAGE.items()):
        for name in ("predict", list(users)[1 + number % 4]):
            call = partial(users[name], value)
            yield Case(f"{name}: {what}", (), call=call, says=says)
    for what in ("RGBA", "channels first", "float", "a path", "a dict", "a tensor", "a batch"):
        value = FRAME[None] if what == "a batch" else NO_IMAGE[what][0]
        call = partial(lambda value, box, base: _field().predict(SMALL, value), value)
        yield Case(f"background frame: {what}", (), call=call, says="background")


def cases() -> Iterator[Case]:
    yield from _images()
    yield from _wrong(NUMBERS, NO_NUMBERS, "")
    yield from _wrong(WHOLE_NUMBERS, NO_WHOLE_NUMBERS, "")
    yield from _wrong(PATHS, NO_PATHS, "expected a path")
    without_none = {what: value for what, value in NO_PATHS.items() if value is not None}
    yield from _wrong(OPTIONAL_PATHS, without_none, "expected a path")
    yield from _wrong(LISTS, NO_LISTS)
    yield from _wrong(OBJECTS, NO_OBJECTS)
    yield from _wrong(WORDS, NO_WORDS, "")
    yield from _wrong(ARRAYS, NO_ARRAYS, "")
    for name, (call, value, says) in MORE.items():
        yield Case(name, (), call=partial(call, value), says=says)
    for name in FINE:
        yield Case(f"fine: {name}", (), call=partial(_is_fine, name), fine=True)
