"""Wrong arguments of the Python API, argument by argument, and odd ones that are fine.

Each case calls one public function or method with one wrong value in one place.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import t2twin
from benchmarks.inputs import api_calls, api_values
from benchmarks.inputs.api_calls import (
    Call,
    elastomer,
    field_run,
    files,
    layout,
    recipe,
    run_of,
    turned_round,
)  # fmt: skip
from benchmarks.inputs.api_values import FRAME, NO_IMAGE, PICTURE, SMALL
from benchmarks.inputs.case import Base, Case

MORE: Mapping[str, tuple[Call, object, str]] = {
    "sample_fields of 10^9": (
        lambda value, box, base: field_run().sample_fields(SMALL, value), 10**9, "expected a whole",
    ),
    "sample_fields of many images": (
        lambda value, box, base: field_run().sample_fields([SMALL] * 3, value), 50_000, "in all",
    ),
    "estimate of no image": (
        lambda value, box, base: field_run().estimate(value), [], "at least one",
    ),
    "estimate of a run without a field": (
        lambda value, box, base: run_of(base.resnet18).estimate(value), SMALL, "needs a field run",
    ),
    "a background frame for a run without a field": (
        lambda value, box, base: run_of(base.resnet18).predict(SMALL, value), SMALL, "field run",
    ),
    "predict_image a run to counts": (
        lambda value, box, base: run_of(base.resnet18).predict_image(value),
        np.zeros(20),
        "predict_image needs a cyskin-to-digit run",
    ),
    "predict_image negative counts": (
        lambda value, box, base: turned_round(base.touch2touch).predict_image(value),
        -np.ones(20), "expected numbers from 0",
    ),
    "predict_pixels of another size": (
        lambda value, box, base: field_run().predict_pixels(value),
        SMALL[None], "pixels have shape",
    ),
    "predict_pixels of floats": (
        lambda value, box, base: field_run().predict_pixels(value),
        np.zeros((1, 96, 96, 3)), "uint8",
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
        lambda value, box, base: t2twin.translate_images([PICTURE], "out", pictures=value),
        "no", "True or False",
    ),
    "a Shape without a surface": (
        lambda value, box, base: t2twin.press(t2twin.Shape("a", value, value, (1.0, 1.0))),
        None, "surface is None",
    ),
    "a scale for a Shape": (
        lambda value, box, base: t2twin.load_shape(t2twin.load_shape("circle-1"), value),
        2.0, "for files only",
    ),
    "a Recipe of a wrong name": (
        lambda value, box, base: t2twin.make_dataset("out", world=recipe(name=value)), 5, "name",
    ),
    "a Recipe of a wrong seed": (
        lambda value, box, base: t2twin.make_dataset("out", world=recipe(seed=value)),
        "x", "whole number",
    ),
    "a Recipe without parts": (
        lambda value, box, base: t2twin.make_dataset("out", world=recipe(parts=value)),
        (), "parts",
    ),
    "a Recipe of no parts": (
        lambda value, box, base: t2twin.make_dataset("out", world=recipe(parts=value)), 5, "parts",
    ),
    "a shape that is a mesh": (
        lambda value, box, base: t2twin.press(value().mesh),
        lambda: t2twin.load_shape("circle-1"), "expected a path",
    ),
    "an Elastomer as thick as a house": (
        lambda value, box, base: elastomer(thickness_mm=value), 3000, "from 0.1 to 200",
    ),
    "a Layout of sizes that differ": (
        lambda value, box, base: layout(x_mm=value), np.arange(5.0), "has shape",
    ),
    "a Layout of two taxels": (
        lambda value, box, base: t2twin.Layout("two", value, value, value),
        [1.0, 2.0], "at least 3",
    ),
}  # fmt: skip


GREY = np.ascontiguousarray(FRAME[..., 0])

NUMBERS_OF_NUMPY: dict[str, Any] = {
    "force_n": np.float32(8),
    "x_mm": np.int64(1),
    "seed": np.uint8(3),
}
TAXELS: dict[str, Any] = {"x_mm": [0.0, 5.0, 9.0], "y_mm": [0, 5, 1], "name": "three"}
COUNT: Any = np.int64(2)
COUNTS: Any = [0] * 20

FINE: Mapping[str, Callable[[Base], object]] = {
    "a grey image": lambda base: field_run().predict(GREY).shape == (20,),
    "a grey batch": lambda base: field_run().predict(GREY[None, :, :, None]).shape == (1, 20),
    "an image of one pixel": lambda base: field_run().predict(FRAME[:1, :1]).shape == (20,),
    "three rows": lambda base: run_of(base.resnet18).predict(FRAME[:3]).shape == (20,),
    "a flipped view": lambda base: field_run().predict(FRAME[::-1, ::-1]).shape == (20,),
    "a tuple of sizes": lambda base: field_run().predict((FRAME, SMALL, GREY)).shape == (3, 20),
    "an empty list": lambda base: field_run().predict([]).shape == (0, 20),
    "an empty batch": lambda base: run_of(base.resnet18).predict(FRAME[None][:0]).shape == (0, 20),
    "fields of no image": lambda base: field_run().sample_fields([], 3).shape == (0, 3, 216),
    "tactile images of none": lambda base: (
        run_of(base.resnet18).tactile_images([]).shape == (0, 396, 240)
    ),
    "a grey background frame": lambda base: field_run().predict(FRAME, GREY).shape == (20,),
    "background by name": lambda base: (
        field_run().estimate(FRAME, background=SMALL).counts.shape == (20,)
    ),
    "the default run": lambda base: (
        np.abs(t2twin.load().predict(FRAME) - field_run().predict(FRAME)).max() < 1.0
    ),
    "numbers of NumPy": lambda base: np.array_equal(
        t2twin.press("circle-1", **NUMBERS_OF_NUMPY).counts,
        t2twin.press("circle-1", force_n=8, x_mm=1, seed=3).counts,
    ),
    "a level of NumPy": lambda base: field_run().estimate(FRAME).interval(np.float64(0.5)),
    "a number of fields of NumPy": lambda base: (
        field_run().sample_fields(FRAME, COUNT).shape == (2, 216)
    ),
    "taxels in lists": lambda base: field_run().at_layout(**TAXELS).predict(FRAME).shape == (3,),
    "a Shape": lambda base: t2twin.load_shape(t2twin.load_shape("circle-1")).name == "circle-1",
    "a flat gel": lambda base: elastomer(
        dome_width_radius_mm=np.inf, dome_length_radius_mm=float("inf")
    ),
    "counts in a list": lambda base: turned_round(base.touch2touch).predict_image(COUNTS).ndim == 2,
    "paths of both kinds": lambda base: (
        t2twin.translate_images((PICTURE, Path(PICTURE)), "out", base.resnet18).shape == (2, 20)
    ),
}
"""Odd but right calls, whose result must be true."""


def _check_fine(call: Callable[[Base], object], box: Path, base: Base) -> None:
    assert call(base), "another result than expected"


def _wrong(
    calls: Mapping[str, Call], values: Mapping[str, object], says: str = "expected"
) -> Iterator[Case]:
    for name, call in calls.items():
        for what, value in values.items():
            yield Case(f"{name}: {what}", (), files, call=partial(call, value), says=says)


def _images() -> Iterator[Case]:
    users: Mapping[str, Call] = {
        "predict": lambda value, box, base: field_run().predict(value),
        "estimate": lambda value, box, base: field_run().estimate(value),
        "sample_fields": lambda value, box, base: field_run().sample_fields(value, 2),
        "tactile_images": lambda value, box, base: run_of(base.touch2touch).tactile_images(value),
        "pixels_of": lambda value, box, base: run_of(base.resnet18).pixels_of(value),
    }
    for number, (what, (value, says)) in enumerate(NO_IMAGE.items()):
        for name in ("predict", list(users)[1 + number % 4]):
            call = partial(users[name], value)
            yield Case(f"{name}: {what}", (), files, call=call, says=says)
    for what in ("RGBA", "channels first", "float", "a path", "a dict", "a tensor", "a batch"):
        value = FRAME[None] if what == "a batch" else NO_IMAGE[what][0]
        call = partial(lambda value, box, base: field_run().predict(SMALL, value), value)
        yield Case(f"background frame: {what}", (), files, call=call, says="background")


def cases() -> Iterator[Case]:
    no_path = api_values.NO_PATHS
    no_given_path = {what: value for what, value in no_path.items() if value is not None}
    yield from _images()
    yield from _wrong(api_calls.NUMBERS, api_values.NO_NUMBERS, "")
    yield from _wrong(api_calls.WHOLE_NUMBERS, api_values.NO_WHOLE_NUMBERS, "")
    yield from _wrong(api_calls.PATHS, no_path, "expected a")
    yield from _wrong(api_calls.OPTIONAL_PATHS, no_given_path, "expected a")
    yield from _wrong(api_calls.LISTS, api_values.NO_LISTS)
    yield from _wrong(api_calls.OBJECTS, api_values.NO_OBJECTS)
    yield from _wrong(api_calls.WORDS, api_values.NO_WORDS, "")
    yield from _wrong(api_calls.ARRAYS, api_values.NO_ARRAYS, "")
    for name, (call, value, says) in MORE.items():
        yield Case(name, (), files, call=partial(call, value), says=says)
    for name, of_base in FINE.items():
        yield Case(f"fine: {name}", (), files, call=partial(_check_fine, of_base), fine=True)
