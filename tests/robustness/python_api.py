"""Functions of the Python API, called with one bad value in the place of one argument."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from cases import Base, Case, Content, laid
from msgspec import structs
from pictures import encoded
from PIL import Image

import t2twin

FRAME = np.full((320, 240, 3), 100, np.uint8)
SMALL, GREY = FRAME[:32, :24], np.ascontiguousarray(FRAME[..., 0])


def _press(number: int) -> bytes:
    image = FRAME.copy()
    image[100 + 10 * number :][:40, 100:140] = 200
    return encoded(Image.fromarray(image), compress_level=1)


HEAD = "image," + ",".join(f"taxel_{n}" for n in range(20))
FILES: dict[str, Content] = {
    "x.png": encoded(Image.fromarray(FRAME)), "pairs.csv": f"{HEAD}\nx.png{',1' * 20}\n",
    **{f"presses/{number}.png": _press(number) for number in range(9)},
}  # fmt: skip

VALUES: dict[str, dict[str, object]] = {
    "number": {"text": "8", "a list": [8.0], "an array": np.ones(3), "complex": 8j, "True": True,
               "infinite": float("inf"), "NaN": np.float32("nan"), "large": 10**5000},
    "whole": {"text": "1", "a fraction": 1.5, "NaN": float("nan"), "negative": -1, "True": True,
              "an array": np.ones(2, int), "a list": [1, 2]},
    "path": {"None": None, "a number": 5, "bytes": b"x", "empty": "", "a NUL": "a\0",
             "too long": "x" * 5000, "no text": "\ud800"},
    "list": {"None": None, "text": "run", "a path": Path("run"), "of None": [None]},
    "object": {"None": None, "text": "x", "a dict": {}},
    "word": {"None": None, "a number": 5, "unknown": "x", "a list": ["all"]},
    "array": {"None": None, "text": "abc", "ragged": [[1.0, 2.0], [3.0]], "of text": ["a"] * 20,
              "complex": np.ones(20, complex), "NaN": np.full(20, np.nan),
              "three axes": np.ones((5, 4, 3))},
}  # fmt: skip
VALUES["optional path"] = {k: v for k, v in VALUES["path"].items() if v is not None}
"""Bad values by the kind of an argument."""

SAYS = {"path": "expected a", "optional path": "expected a", "list": "expected",
        "object": "expected"}  # fmt: skip


@cache
def _run(name: str | Path = "field") -> Any:
    return t2twin.load(name, engine="torch")


@cache
def _reverse_run(run_dir: Path) -> Any:
    """A run that predicts DIGIT images, with random weights."""
    from t2twin.translate.inference.predictor import ImagePredictor
    from t2twin.translate.runs.checkpoint import build

    own = _run(run_dir)
    config = structs.replace(own.config, direction="cyskin-to-digit")
    return ImagePredictor(own.run_dir, config, build(config))  # pyright: ignore[reportArgumentType]


def _elastomer(**changed: Any) -> object:
    return replace(t2twin.Twin().sensors.digit.gel, **changed)


def _layout(**changed: Any) -> object:
    return replace(t2twin.load_layout(), **changed)


def _recipe(**changed: Any) -> object:
    return t2twin.make_dataset("out", world=structs.replace(t2twin.load_recipe("union"), **changed))


TRAIN = {"model": "resnet18", "data_dir": "{data}", "preset": "smoke", "out_dir": "out"}
PRESSES = {"background": "x.png", "presses": "presses", "ball_diameter_mm": 5.0}
RUNS = {"runs": ["{resnet18}"], "split": "val", "out_dir": "out"}
FUNCTIONS: dict[str, tuple[Callable[..., object], dict[str, Any], str]] = {
    "press": (t2twin.press, {"shape": "circle-1"},
              "number force_n depth_mm x_mm y_mm yaw_deg, whole seed, path shape"),
    "load_shape": (t2twin.load_shape, {"shape": "x.stl"}, "number scale, path shape"),
    "interval": (lambda level: _run().estimate(SMALL).interval(level), {}, "number level"),
    "Elastomer": (_elastomer, {}, "number young_mpa dome_flat_mm, word law"),
    "PressCommand": (lambda x_mm: t2twin.PressCommand("a", x_mm, 0.0, 0.0, 1.0), {}, "number x_mm"),
    "train": (t2twin.train, TRAIN, "number minutes, whole seed epochs, path data_dir out_dir, "
              "optional-path init_from, word model preset"),
    "train reverse": (t2twin.train, TRAIN | {"model": "touch2touch"}, "word direction"),
    "calibrate": (t2twin.calibrate, PRESSES,
                  "number ball_diameter_mm, whole held_out, path background presses"),
    "adapt": (t2twin.adapt, PRESSES | {"out": "out"}, "number minutes, path background presses "
              "out, object tolerance report, word model"),
    "sample_fields": (lambda number=1, seed=0: _run().sample_fields(SMALL, number, seed=seed), {},
                      "whole number seed"),
    "make_dataset": (t2twin.make_dataset, {"folder": "out", "scale": "smoke"}, "whole seed "
                     "workers, path folder, optional-path cache, list shapes, word scale"),
    "make_dataset of a world": (t2twin.make_dataset, {"folder": "out"}, "optional-path world"),
    "import_pairs": (t2twin.import_pairs, {"source": "pairs.csv", "folder": "out",
                     "layout": t2twin.load_layout()},
                     "whole seed full_scale, path source folder, object layout"),
    "load": (t2twin.load, {"run": "field"}, "path run, optional-path layout"),
    "load_layout": (t2twin.load_layout, {}, "path source"),
    "load_recipe": (t2twin.load_recipe, {}, "path source"),
    "Twin": (t2twin.Twin, {}, "path layout, optional-path calibration, object gel cover, "
             "word imperfections optics"),
    "save": (lambda folder: t2twin.press("circle-1").save(folder), {}, "path folder"),
    "export_shapes": (t2twin.export_shapes, {}, "path out_dir"),
    "guess_light": (t2twin.guess_light, {}, "path background"),
    "verify_dataset": (t2twin.verify_dataset, {}, "path folder"),
    "evaluate": (t2twin.evaluate, RUNS | {"data_dir": "{data}"},
                 "path data_dir out_dir, list runs, word split"),
    "evaluate_worlds": (t2twin.evaluate_worlds, RUNS | {"data_dirs": ["{data}"]},
                        "path out_dir, list runs data_dirs, word split"),
    "export_onnx": (lambda run, path: t2twin.export_onnx(_run(run), path), {"run": "{resnet18}"},
                    "path path"),
    "export_onnx of": (t2twin.export_onnx, {"path": "x.onnx"}, "object run"),
    "translate_images": (t2twin.translate_images, {"paths": ["x.png"], "out_dir": "out",
                         "run": "{resnet18}"}, "path run out_dir, list paths"),
    "translate_images by field": (t2twin.translate_images, {"paths": ["x.png"], "out_dir": "out"},
                                  "optional-path background"),
    "write_report": (t2twin.write_report, {"out": "out", "data": "{data}", "runs": ["{resnet18}"]},
                     "path out data, optional-path evaluation, list runs"),
    "write_data_report": (t2twin.write_data_report, {"out": "out", "data": "{data}"},
                          "path out data"),
    "predict_image": (lambda counts, run: _reverse_run(Path(run)).predict_image(counts),
                      {"run": "{touch2touch}"}, "array counts"),
    "Layout": (_layout, {}, "array x_mm pad_diameter_mm"),
    "at_layout": (lambda x_mm: _run().at_layout(x_mm, x_mm, "mine"), {}, "array x_mm"),
}  # fmt: skip
"""Functions, valid arguments, and the arguments that get bad values, after the kind of each."""


IMAGES: dict[str, tuple[object, str]] = {
    "RGBA": (np.zeros((32, 24, 4), np.uint8), "RGBA"), "None": (None, "images is None"),
    "channels first": (np.zeros((3, 32, 24), np.uint8), "channels-first"), "a dict": ({}, "dict"),
    "a grey batch": (np.zeros((4, 32, 24), np.uint8), "(B, h, w, 1)"),
    "two channels": (np.zeros((32, 24, 2), np.uint8), "shape (32, 24, 2)"),
    "one axis": (np.zeros(32, np.uint8), "shape (32,)"), "no axis": (np.uint8(3), "type uint8"),
    "five axes": (np.zeros((1, 1, 8, 8, 3), np.uint8), "shape (1, 1, 8, 8, 3)"),
    "no rows": (np.zeros((0, 24, 3), np.uint8), "no pixels"), "a path": (Path("x.png"), "a file"),
    "float": (np.zeros((32, 24, 3)), "float64"), "int64": (np.zeros((32, 24, 3), int), "int64"),
    "bool": (np.zeros((32, 24), bool), "bool"), "objects": (np.full((32, 24), None), "object"),
    "a tensor": (torch.zeros((32, 24, 3), dtype=torch.uint8), "tensor.cpu().numpy()"),
    "a PIL image": (Image.new("RGB", (24, 32)), "PIL image"), "text": ("x.png", "reads a file"),
    "a number": (5, "expected an image"), "a nested list": ([[[1, 2, 3]]], "images[0]"),
    "a list with None": ([SMALL, None], "images[1] is None"),
    "a list of batches": ([np.zeros((1, 32, 24, 3), np.uint8)], "images[0] has shape"),
    "a batch of RGBA": (np.zeros((2, 32, 24, 4), np.uint8), "RGBA"),
    "a batch, channels first": (np.zeros((2, 3, 32, 24), np.uint8), "channels-first"),
}  # fmt: skip
"""Values that are no images, and a part of the sentence."""

USERS: Mapping[str, Callable[[Any, Base], object]] = {
    "predict": lambda value, base: _run().predict(value),
    "estimate": lambda value, base: _run().estimate(value),
    "sample_fields": lambda value, base: _run().sample_fields(value, 2),
    "tactile_images": lambda value, base: _run(base.touch2touch).tactile_images(value),
    "pixels_of": lambda value, base: _run(base.resnet18).pixels_of(value),
}
BAD: Mapping[str, Callable[[Base], object]] = {
    "expected a whole": lambda base: _run().sample_fields(SMALL, 10**9),
    "in all": lambda base: _run().sample_fields([SMALL] * 3, 50_000),
    "at least one": lambda base: _run().estimate([]),
    "needs a field run": lambda base: _run(base.resnet18).estimate(SMALL),
    "needs a cyskin-to-digit run": lambda base: _run(base.resnet18).predict_image(np.zeros(20)),
    "numbers from 0": lambda base: _reverse_run(base.touch2touch).predict_image(-np.ones(20)),
    "pixels have shape": lambda base: _run().predict_pixels(SMALL[None]),
    "no run feild": lambda base: t2twin.load("feild"),
    "for files only": lambda base: t2twin.load_shape(t2twin.load_shape("circle-1"), 2.0),
    "name": lambda base: _recipe(name=5), "parts": lambda base: _recipe(parts=()),
    "from 0.1 to 200": lambda base: _elastomer(thickness_mm=3000),
    "at least 3": lambda base: t2twin.Layout("two", *[np.array([1.0, 2.0])] * 3),
}  # fmt: skip
"""Bad calls by a part of the sentence."""

NUMPY: dict[str, Any] = {"force_n": np.float32(8), "x_mm": np.int64(1), "seed": np.uint8(3)}
TAXELS: dict[str, Any] = {"x_mm": [0.0, 5.0, 9.0], "y_mm": [0, 5, 1], "name": "three"}
FINE: tuple[Callable[[Base], object], ...] = (
    *(lambda base, v=value: _run().predict(v).shape[-1] == 20 for value in (
        GREY, GREY[None, :, :, None], FRAME[:1, :1], FRAME[:3], FRAME[::-1, ::-1])),
    lambda base: _run().predict((FRAME, SMALL, GREY)).shape == (3, 20),
    lambda base: _run().predict([]).shape == (0, 20),
    lambda base: _run(base.resnet18).predict(FRAME[None][:0]).shape == (0, 20),
    lambda base: _run().sample_fields([], 3).shape == (0, 3, 216),
    lambda base: _run(base.resnet18).tactile_images([]).shape == (0, 396, 240),
    lambda base: _run().predict(FRAME, GREY).shape == (20,),
    lambda base: _run().estimate(FRAME, background=SMALL).counts.shape == (20,),
    lambda base: np.abs(t2twin.load().predict(FRAME) - _run().predict(FRAME)).max() < 1.0,
    lambda base: t2twin.press("circle-1", **NUMPY).counts.any(),
    lambda base: _run().estimate(FRAME).interval(np.float64(0.5)),
    lambda base: _run().at_layout(**TAXELS).predict(FRAME).shape == (3,),
    lambda base: t2twin.load_shape(t2twin.load_shape("circle-1")).name == "circle-1",
    lambda base: _elastomer(dome_width_radius_mm=np.inf),
    lambda base: _reverse_run(base.touch2touch).predict_image([0] * 20).ndim == 2,
    lambda base: t2twin.translate_images(
        ("x.png", Path("x.png")), "out", base.resnet18).shape == (2, 20),
)  # fmt: skip
"""Valid calls whose result is true."""


def _call(function: str, name: str, value: object, box: Path, base: Base) -> object:
    def filled(good: Any) -> Any:
        if isinstance(good, list):
            return [filled(each) for each in good]
        return str(getattr(base, good[1:-1])) if str(good)[:1] == "{" else good

    call, arguments, _ = FUNCTIONS[function]
    return call(**{key: filled(good) for key, good in arguments.items()} | {name: value})


def _check(call: Callable[[Base], object], box: Path, base: Base) -> None:
    assert call(base), "another result than expected"


def cases() -> Iterator[Case]:
    files = laid(FILES)
    for function, (_, _, kinds) in FUNCTIONS.items():
        for group in kinds.split(", "):
            kind, *names = group.replace("optional-path", "optional_path").split()
            kind = kind.replace("_", " ")
            for name in names:
                for what, value in VALUES[kind].items():
                    call = partial(_call, function, name, value)
                    says = SAYS.get(kind, "")
                    yield Case(f"{function} {name}: {what}", "", files, says, call=call)
    for number, (what, (value, says)) in enumerate(IMAGES.items()):
        for name in ("predict", list(USERS)[1 + number % 4]):
            user = USERS[name]
            call = lambda box, base, user=user, value=value: user(value, base)  # noqa: E731
            yield Case(f"{name}: {what}", "", files, says, call=call)
        if number % 3 == 0:
            call = lambda box, base, value=value: _run().predict(SMALL, value)  # noqa: E731
            yield Case(f"background: {what}", "", files, call=call)
    for says, bad in BAD.items():
        yield Case(says, "", files, says, call=lambda box, base, bad=bad: bad(base))
    for number, good in enumerate(FINE):
        yield Case(f"valid call {number}", "", files, fine=True, call=partial(_check, good))
