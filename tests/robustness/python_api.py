"""Public functions, called with an object of an unknown class in the place of each argument; the
checks of values are in tests/test_arguments.py. Images, which have a check of their own."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import torch
from cases import Base, Case, laid
from msgspec import structs
from pictures import PNG
from PIL import Image
from readers import PAIRS

import t2twin

FRAME = np.full((320, 240, 3), 100, np.uint8)
SMALL, GREY = FRAME[:32, :24], np.ascontiguousarray(FRAME[..., 0])


@cache
def _run(name: str | Path = "field") -> Any:
    return t2twin.load(name, engine="torch")


@cache
def _reverse_run(run_dir: Path) -> Any:
    """A run that predicts DIGIT images, with random weights."""
    from t2twin.translate.inference.predictor import ImagePredictor
    from t2twin.translate.runs.checkpoint import build

    own = _run(run_dir)
    config = structs.replace(own.config, direction="counts-to-image")
    return ImagePredictor(own.run_dir, config, build(config))  # pyright: ignore[reportArgumentType]


PRESSES = {"background": "x.png", "presses": "presses", "ball_diameter_mm": 5.0}
RUNS = {"runs": ["{resnet18}"], "split": "val", "out_dir": "out"}
CALLS: dict[str, dict[str, Any]] = {
    "press": {"shape": "circle-1"}, "load_shape": {"shape": "x.stl"},
    "adapt": PRESSES | {"out": "out"}, "verify_dataset": {"folder": "{data}"},
    "train": {"model": "resnet18", "data_dir": "{data}", "preset": "smoke", "out_dir": "out"},
    "calibrate": PRESSES, "guess_light": {"background": "x.png"},
    "make_dataset": {"folder": "out", "scale": "smoke"}, "load": {}, "load_layout": {}, "Twin": {},
    "import_pairs": {"source": "pairs.csv", "folder": "out", "layout": t2twin.load_layout()},
    "load_recipe": {"source": "open"}, "export_shapes": {"out_dir": "out"}, "Markers": {},
    "evaluate": RUNS | {"data_dir": "{data}"},
    "evaluate_datasets": RUNS | {"data_dirs": ["{data}"]},
    "export_onnx": {"run": None, "path": "x.onnx"},
    "translate_images": {"paths": ["x.png"], "out_dir": "out", "run": "{resnet18}"},
    "write_report": {"out": "out", "data": "{data}", "runs": ["{resnet18}"]},
    "write_data_report": {"out": "out", "data": "{data}"},
    "PressCommand": {"shape": "a", "x_mm": 0.0, "y_mm": 0.0, "yaw_rad": 0.0, "force_n": 1.0},
    "Layout": dict.fromkeys(("x_mm", "y_mm", "pad_diameter_mm"), (0.0, 5.0, 9.0)) | {"name": "a"},
    "Elastomer": {"name": "a", "thickness_mm": 2.0, "young_mpa": 0.5, "poisson": 0.47,
                  "width_mm": 20.0, "length_mm": 20.0},
}  # fmt: skip
"""Functions and classes, with valid arguments."""

ANY = {"name", "spec"}
"""Arguments without a check."""

IMAGES: dict[str, tuple[object, str]] = {
    "RGBA": (np.zeros((32, 24, 4), np.uint8), "RGBA"), "None": (None, "images is None"),
    "channels first": (np.zeros((3, 32, 24), np.uint8), "channels-first"), "a dict": ({}, "dict"),
    "a grey batch": (np.zeros((4, 32, 24), np.uint8), "(B, h, w, 1)"),
    "two channels": (np.zeros((32, 24, 2), np.uint8), "shape (32, 24, 2)"),
    "one axis": (np.zeros(32, np.uint8), "shape (32,)"), "no axis": (np.uint8(3), "type uint8"),
    "five axes": (np.zeros((1, 1, 8, 8, 3), np.uint8), "shape (1, 1, 8, 8, 3)"),
    "no rows": (np.zeros((0, 24, 3), np.uint8), "no pixels"), "a path": (Path("x.png"), "a file"),
    "float": (np.zeros((32, 24, 3)), "float64"), "objects": (np.full((32, 24), None), "object"),
    "a tensor": (torch.zeros((32, 24, 3), dtype=torch.uint8), "tensor.cpu().numpy()"),
    "a PIL image": (Image.new("RGB", (24, 32)), "PIL image"), "text": ("x.png", "reads a file"),
    "a nested list": ([[[1, 2, 3]]], "images[0]"), "a None": ([SMALL, None], "images[1] is None"),
    "a list of batches": ([np.zeros((1, 32, 24, 3), np.uint8)], "images[0] has shape"),
}  # fmt: skip
"""Values that are no images, and a part of the sentence."""

USERS: tuple[Callable[[Any, Base], object], ...] = (
    lambda value, base: _run().predict(value), lambda value, base: _run().estimate(value),
    lambda value, base: _run().sample_dense_counts(value, 2),
    lambda value, base: _run(base.touch2touch).tactile_images(value),
    lambda value, base: _run(base.resnet18).pixels_of(value),
)  # fmt: skip
BAD: dict[str, Callable[[Base], object]] = {
    "expected a whole": lambda base: _run().sample_dense_counts(SMALL, 10**9),
    "in all": lambda base: _run().sample_dense_counts([SMALL] * 3, 50_000),
    "at least one": lambda base: _run().estimate([]),
    "level": lambda base: _run().estimate(SMALL).interval("0.9"),
    "needs a field run": lambda base: _run(base.resnet18).estimate(SMALL),
    "needs a counts-to-image run": lambda base: _run(base.resnet18).predict_image(np.zeros(20)),
    "numbers from 0": lambda base: _reverse_run(base.touch2touch).predict_image(-np.ones(20)),
    "pixels have shape": lambda base: _run().predict_pixels(SMALL[None]),
    "no run feild": lambda base: t2twin.load("feild"),
    "parts": lambda base: t2twin.make_dataset(
        "out", recipe=structs.replace(t2twin.load_recipe("union"), parts=())),
    "from 0.1 to 200": lambda base: replace(t2twin.Twin().sensors.camera.own_gel,
                                            thickness_mm=3000),
    "there is no sensor 'gelsite'": lambda base: t2twin.Twin(source="gelsite"),
    "neither digit nor digit": lambda base: t2twin.Twin(target="digit", layout="cyskin-63"),
    "neither is a gel camera": lambda base: t2twin.Twin(source="cyskin").sensors.camera,
    "at least 3": lambda base: t2twin.Layout("two", *[np.array([1.0, 2.0])] * 3),
}  # fmt: skip
"""Bad calls by a part of the sentence."""

NUMPY: dict[str, Any] = {"force_n": np.float32(8), "x_mm": np.int64(1), "seed": np.uint8(3)}
FINE: tuple[Callable[[Base], object], ...] = (
    *(lambda base, v=value: _run().predict(v).shape[-1] == 20 for value in (
        GREY, GREY[None, :, :, None], FRAME[:1, :1], FRAME[::-1, ::-1])),
    lambda base: _run().predict((FRAME, SMALL, GREY)).shape == (3, 20),
    lambda base: _run().predict([]).shape == (0, 20),
    lambda base: _run(base.resnet18).tactile_images([]).shape == (0, 396, 240),
    lambda base: _run().estimate(FRAME, background=SMALL).counts.shape == (20,),
    lambda base: np.abs(t2twin.load().predict(FRAME) - _run().predict(FRAME)).max() < 1.0,
    lambda base: t2twin.press("circle-1", **NUMPY).counts.any(),
    lambda base: t2twin.Twin(source="cyskin", target="cyskin").press("circle-1").image is None,
    lambda base: _reverse_run(base.touch2touch).predict_image([0] * 20).ndim == 2,
)  # fmt: skip
"""Valid calls whose result is true."""


def _call(function: str, name: str, box: Path, base: Base) -> object:
    def filled(good: Any) -> Any:
        if isinstance(good, list):
            return [filled(each) for each in good]
        return str(getattr(base, good[1:-1])) if str(good)[:1] == "{" else good

    arguments = {key: filled(good) for key, good in CALLS[function].items()}
    return getattr(t2twin, function)(**arguments | {name: object()})


def _check(call: Callable[[Base], object], box: Path, base: Base) -> None:
    assert call(base), "another result than expected"


def cases() -> Iterator[Case]:
    files = laid(PAIRS | {"x.png": PNG, "presses/1.png": PNG})
    for function in CALLS:
        for name in signature(getattr(t2twin, function)).parameters.keys() - ANY:
            yield Case(f"{function} {name}", "", files, call=partial(_call, function, name))
    for number, (what, (value, says)) in enumerate(IMAGES.items()):
        for user in (USERS[0], USERS[1 + number % 4]):
            call = lambda box, base, user=user, value=value: user(value, base)  # noqa: E731
            yield Case(f"image: {what}", "", files, says, call=call)
    for says, bad in BAD.items():
        yield Case(says, "", files, says, call=lambda box, base, bad=bad: bad(base))
    for number, good in enumerate(FINE):
        yield Case(f"valid call {number}", "", files, fine=True, call=partial(_check, good))
