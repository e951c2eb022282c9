"""Wrong arguments of the Python API, argument by argument, and odd ones that are fine.

Each case calls one public function or method with one wrong value in one place.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

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
    "draw_fields of 10^9": (
        lambda value, box, base: field_run().draw_fields(SMALL, value), 10**9, "expected a whole",
    ),
    "draw_fields of many images": (
        lambda value, box, base: field_run().draw_fields([SMALL] * 3, value), 50_000, "in all",
    ),
    "estimate of no image": (
        lambda value, box, base: field_run().estimate(value), [], "at least one",
    ),
    "estimate of a run without a field": (
        lambda value, box, base: run_of(base.resnet18).estimate(value), SMALL, "a field run does",
    ),
    "a background frame for a run without a field": (
        lambda value, box, base: run_of(base.resnet18).predict(SMALL, value), SMALL, "field run",
    ),
    "picture_of a run to counts": (
        lambda value, box, base: run_of(base.resnet18).picture_of(value), np.zeros(20), "draws no",
    ),
    "picture_of negative counts": (
        lambda value, box, base: turned_round(base.touch2touch).picture_of(value),
        -np.ones(20), "no number from 0",
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


def _fine(box: Path, base: Base) -> Iterator[tuple[str, Callable[[], bool]]]:
    """Odd but right calls, each with what must be true of its result."""
    field, resnet = field_run(), run_of(base.resnet18)
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
    yield "fields of no image", lambda: field.draw_fields([], 3).shape == (0, 3, 216)
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
            elastomer(dome_width_radius_mm=np.inf, dome_length_radius_mm=float("inf")) is not None
        ),
    )
    yield (
        "counts in a list",
        lambda: (
            turned_round(base.touch2touch)
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
            t2twin.translate_images((PICTURE, Path(PICTURE)), "out", base.resnet18).shape == (2, 20)
        ),
    )


FINE = (
    "a grey image", "a grey batch", "an image of one pixel", "an image of three rows",
    "a flipped view", "a tuple of sizes", "an empty list", "an empty batch",
    "fields of no image", "tactile images of none", "a grey background frame",
    "background by name", "the default run",
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
            yield Case(f"{name}: {what}", (), files, call=partial(call, value), says=says)


def _images() -> Iterator[Case]:
    users: Mapping[str, Call] = {
        "predict": lambda value, box, base: field_run().predict(value),
        "estimate": lambda value, box, base: field_run().estimate(value),
        "draw_fields": lambda value, box, base: field_run().draw_fields(value, 2),
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
    yield from _wrong(api_calls.PATHS, no_path, "expected a path")
    yield from _wrong(api_calls.OPTIONAL_PATHS, no_given_path, "expected a path")
    yield from _wrong(api_calls.LISTS, api_values.NO_LISTS)
    yield from _wrong(api_calls.OBJECTS, api_values.NO_OBJECTS)
    yield from _wrong(api_calls.WORDS, api_values.NO_WORDS, "")
    yield from _wrong(api_calls.ARRAYS, api_values.NO_ARRAYS, "")
    for name, (call, value, says) in MORE.items():
        yield Case(name, (), files, call=partial(call, value), says=says)
    for name in FINE:
        yield Case(f"fine: {name}", (), files, call=partial(_is_fine, name), fine=True)
