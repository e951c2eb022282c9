"""ONNX Runtime in PyTorch's place where a run is only used: a frame in about half the time.

The file that it reads is the export's (module export), less the tactile images. It is made when a
run is first used, which takes seconds, and kept in the cache home for the next time.
"""

import hashlib
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch

from t2twin.core import arguments
from t2twin.core.cache_dir import cache_dir
from t2twin.core.cached_files import read_checked, write_checked
from t2twin.core.errors import T2TwinError
from t2twin.core.files import temporary_folder
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.inference import predictor
from t2twin.translate.inference.onnx_export import (
    INPUT,
    TACTILE_IMAGES,
    UNTOUCHED,
    export_onnx,
    open_onnx,
)
from t2twin.translate.inference.predictor import TrainedTranslator
from t2twin.translate.models.presets import DIGIT_TO_CYSKIN
from t2twin.translate.runs.config import BEST
from t2twin.translate.runs.pretrained import DEFAULT_RUN

ENGINES = ("onnx", "torch")

FOLDER = "onnx"
"""Where the files are kept, below the cache home."""

MAX_KEPT = 20
"""Files that are kept, the last made (assumed: some 200 MB of preset cpu)."""


def load(
    run: str | Path = DEFAULT_RUN,
    layout: str | Path | None = None,
    bf16: bool = False,
    engine: Literal["onnx", "torch"] | None = None,
) -> TrainedTranslator:
    """A run's best weights, ready to predict, or to draw pictures where it goes the other way.

    run, layout, bf16: as for predict.load. engine: what computes counts: "onnx", ONNX Runtime,
    or "torch". Unless given it is ONNX Runtime where the extra t2twin[onnx] is installed, the run
    computes in float32 on the CPU, and its file can be kept; counts differ by less than one.
    Raises T2TwinError as predict.load does, for another engine, and for "onnx" where it cannot be.
    """
    if engine is not None and arguments.text(engine, "engine") not in ENGINES:
        raise T2TwinError(f"there is no engine {engine!r}; {' and '.join(ENGINES)} are allowed")
    trained = predictor.load(run, layout, bf16)
    if engine == "torch":
        return trained
    why = _why_not(trained, bf16)
    if why is None:
        return replace(trained, engine=OnnxEngine(trained))
    if engine == "onnx":
        raise T2TwinError(f"{run} cannot be used with ONNX Runtime: {why}")
    return trained


def _why_not(run: TrainedTranslator, bf16: bool) -> str | None:
    """Why a run is not used with ONNX Runtime, or None."""
    if not all(map(find_spec, ("onnx", "onnxruntime"))):
        return "it needs onnx and onnxruntime; install them with: pip install 't2twin[onnx]'"
    if run.config.direction != DIGIT_TO_CYSKIN:
        return "it goes the other way, and gives no counts"
    if run.translator.device.type != "cpu" or bf16:
        return "that computes in float32 on the CPU"
    return None if cache_dir() is not None else "there is no folder in which its file can be kept"


@dataclass(frozen=True)
class OnnxEngine:
    """What computes a run's counts in ONNX Runtime; ready when it is first called.

    As many threads as torch has then; several may call it at once.
    """

    run: TrainedTranslator

    def of(self, run: TrainedTranslator) -> "OnnxEngine":
        """The same for another run, such as this one at another layout."""
        return OnnxEngine(run)

    def __call__(self, pixels: np.ndarray) -> dict[str, np.ndarray] | None:
        """The file's outputs by name (module export), of images as for predict_pixels; None of
        images with different untouched frames, as the file takes one for all."""
        if self._session is None:
            return None
        session, names = self._session
        channels = 1 if self.run.config.preset.grey else 3
        inputs = {INPUT: _to_input(pixels[..., :channels])}
        frames = pixels[..., channels:]
        if frames.shape[-1]:
            if not (frames == frames[:1]).all():
                return None
            inputs[UNTOUCHED] = _to_input(frames[:1])
        return dict(zip(names, session.run(names, inputs), strict=True))

    @cached_property
    def _session(self) -> tuple[Any, list[str]] | None:
        """With the names of its outputs; None where its file cannot be kept."""
        home = cache_dir()
        assert home is not None
        path = home / FOLDER / f"{_key(self.run)}.onnx"
        try:
            model = read_checked(path)
            if model is None:
                model = _made(self.run, path.parent)
                write_checked(path, model)
                _remove_older(path.parent)
        except (T2TwinError, OSError):
            return None
        session = open_onnx(model, torch.get_num_threads())
        return session, [output.name for output in session.get_outputs()]


def _to_input(pixels: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(pixels.transpose(0, 3, 1, 2), np.float32) / np.float32(255.0)


def _made(run: TrainedTranslator, place: Path) -> bytes:
    """The content of a run's file. place: the folder that it is made in."""
    import onnx

    place.mkdir(parents=True, exist_ok=True)
    with temporary_folder(place, "onnx") as folder:
        export_onnx(run, folder / "whole.onnx")
        model = onnx.load(folder / "whole.onnx")
    outputs = model.graph.output
    outputs.remove(next(each for each in outputs if each.name == TACTILE_IMAGES))
    return model.SerializeToString()


def _remove_older(folder: Path) -> None:
    """Removes all files but the last MAX_KEPT."""
    with suppress(OSError):  # another process may remove them at the same time
        kept = sorted(folder.glob("*.onnx"), key=lambda each: each.lstat().st_mtime)
        for older in kept[:-MAX_KEPT]:
            older.unlink()


def _key(run: TrainedTranslator) -> str:
    """Of all that a file depends on: the weights, the layout, and the code that makes it."""
    taxels, preset = run.config.data.taxels, run.config.preset
    known = hashlib.sha256(sha256_of(run.run_dir / BEST).encode())
    for values in (taxels.x_mm, taxels.y_mm, taxels.pad_diameter_mm):
        known.update(np.asarray(values, float).tobytes())
    known.update(repr((run.config.model, preset, run.config.data.full_scale_counts)).encode())
    translate = Path(__file__).parents[1]
    folders = (translate / name for name in ("inference", "models", "networks", "uncertainty"))
    for source in sorted(path for folder in folders for path in folder.glob("*.py")):
        known.update(source.read_bytes())
    return known.hexdigest()[:32]
