"""ONNX Runtime in place of PyTorch for prediction: half the time per frame.

The ONNX file is that of the export (module onnx_export) without tactile images. It is written on
first use, which takes seconds, and stored in the cache folder.
"""

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch

from t2twin.core.cache_dir import cache_dir
from t2twin.core.cached_files import read_checked, write_checked
from t2twin.core.errors import T2TwinError
from t2twin.core.files import temporary_folder
from t2twin.sim.dataset.store import sha256_of
from t2twin.translate.inference.onnx_export import (
    BACKGROUND,
    INPUT,
    TACTILE_IMAGES,
    export_onnx,
    open_onnx,
)
from t2twin.translate.inference.predictor import CountsPredictor
from t2twin.translate.runs.config import BEST

FOLDER = "onnx"
"""Folder of the files in the cache folder."""

MAX_FILES = 20
"""Maximum number of files in the cache; the oldest are removed (assumed: 200 MB of preset cpu)."""


@dataclass(frozen=True)
class OnnxEngine:
    """Predictions of a run in ONNX Runtime; see predictor.Engine.

    The session starts on the first call, with as many threads as torch has at that time. Calls from
    several threads are safe.
    """

    run: CountsPredictor

    def for_run(self, run: CountsPredictor) -> "OnnxEngine":
        """See predictor.Engine."""
        return OnnxEngine(run)

    def __call__(self, pixels: np.ndarray) -> dict[str, np.ndarray] | None:
        """See predictor.Engine. None for images with different background frames, as the file has
        one background frame per batch."""
        if self._session is None:
            return None
        session, names = self._session
        channels = 1 if self.run.config.preset.grey else 3
        inputs = {INPUT: _to_input(pixels[..., :channels])}
        frames = pixels[..., channels:]
        if frames.shape[-1]:
            if not (frames == frames[:1]).all():
                return None
            inputs[BACKGROUND] = _to_input(frames[:1])
        return dict(zip(names, session.run(names, inputs), strict=True))

    @cached_property
    def _session(self) -> tuple[Any, list[str]] | None:
        """The session with the names of its outputs; None if the file cannot be written."""
        home = cache_dir()
        assert home is not None
        path = home / FOLDER / f"{_key(self.run)}.onnx"
        try:
            model = read_checked(path)
            if model is None:
                model = _export(self.run, path.parent)
                write_checked(path, model)
                _remove_oldest(path.parent)
        except (T2TwinError, OSError):
            return None
        session = open_onnx(model, torch.get_num_threads())
        return session, [output.name for output in session.get_outputs()]


def _to_input(pixels: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(pixels.transpose(0, 3, 1, 2), np.float32) / np.float32(255.0)


def _export(run: CountsPredictor, parent: Path) -> bytes:
    """The content of a run's file. parent: folder for temporary files."""
    import onnx

    parent.mkdir(parents=True, exist_ok=True)
    with temporary_folder(parent, "onnx") as folder:
        export_onnx(run, folder / "whole.onnx")
        model = onnx.load(folder / "whole.onnx")
    outputs = model.graph.output
    outputs.remove(next(each for each in outputs if each.name == TACTILE_IMAGES))
    return model.SerializeToString()


def _remove_oldest(folder: Path) -> None:
    """Removes all files but the latest MAX_FILES."""
    with suppress(OSError):  # another process may remove them at the same time
        files = sorted(folder.glob("*.onnx"), key=lambda each: each.lstat().st_mtime)
        for older in files[:-MAX_FILES]:
            older.unlink()


def _key(run: CountsPredictor) -> str:
    """Hash of everything that the file depends on: weights, layout, preset and source code."""
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
