"""A trained run at work: images in, counts and tactile images out.

Shape letters: B images, R rows, C columns, N taxels, S the run's image side.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from PIL import Image
from torch.nn import functional
from tqdm import tqdm

from t2twin.primitives_cad.errors import T2TwinError
from t2twin.sim.cyskin.layout import load_layout
from t2twin.translate import distributed
from t2twin.translate.data.images import to_input, to_pixels
from t2twin.translate.data.pairs import ImageFile
from t2twin.translate.networks.fused import fuse
from t2twin.translate.phi import TACTILE_SHAPE, Phi
from t2twin.translate.resnet18 import ResNet18Translator
from t2twin.translate.runs.checkpoint import load_weights
from t2twin.translate.runs.config import BEST, RunConfig, build, has_bf16, load_config
from t2twin.translate.touch2touch import Touch2Touch

AT_ONCE = 64
"""Images in one batch; bounds memory."""


@dataclass(frozen=True)
class TrainedTranslator:
    """A trained translator with its best weights; `load_run` makes one."""

    run_dir: Path
    config: RunConfig
    translator: Touch2Touch | ResNet18Translator

    @cached_property
    def phi(self) -> Phi:
        """phi of the run's layout at the tactile image's full size."""
        return Phi(self.config.data.x_mm, self.config.data.y_mm)

    def predict(self, images: np.ndarray | Sequence[np.ndarray]) -> np.ndarray:
        """Counts of one DIGIT frame, or of several.

        images: a frame, (h, w, 3) or (h, w) uint8, any h and w, colours in the order red, green,
        blue; or several, (B, h, w, 3) or (B, h, w), or a list of frames. An array of three axes
        whose last has length 3 is one frame in colour.
        Returns (N,) float32 of one frame, (B, N) of several, within nought and full scale.
        """
        counts = self.predict_pixels(self._pixels(images))
        return counts[0] if _is_frame(images) else counts

    def predict_pixels(
        self, pixels: np.ndarray | ImageFile, progress: str | None = None
    ) -> np.ndarray:
        """The same for images already at the run's size and colour, (B, S, S, c) uint8.

        progress: a name to show a bar under, or None.
        """
        counts = [np.empty((0, self.config.data.x_mm.size), np.float32)]
        for part in _parts(len(pixels), progress):
            inputs = to_input(pixels[part].astype(np.float32) / 255.0)
            counts.append(self.translator.predict(inputs).cpu().numpy())
        return np.concatenate(counts)

    def tactile_images(self, images: np.ndarray | Sequence[np.ndarray]) -> np.ndarray:
        """Tactile images of DIGIT frames, given as for `predict`: (R, C) or (B, R, C), counts.

        touch2touch's are what its generator drew, resized; ResNet18's are phi of its counts.
        """
        tactile = self.counts_and_tactile_images(self._pixels(images))[1]
        return tactile[0] if _is_frame(images) else tactile

    def counts_and_tactile_images(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both at once, of images already at the run's size and colour, (B, S, S, c) uint8.

        Returns (B, N) and (B, R, C) float32, counts.
        """
        inputs = to_input(pixels.astype(np.float32) / 255.0)
        if isinstance(self.translator, Touch2Touch):
            drawn = self.translator.draw(inputs)
            counts = self.translator.counts_of(drawn)
            large = functional.interpolate(drawn, TACTILE_SHAPE, mode="bilinear", antialias=True)
            return counts.cpu().numpy(), large[:, 0].clamp(min=0.0).cpu().numpy()
        counts = self.translator.predict(inputs).cpu().numpy()
        return counts, self.phi(counts)

    def _pixels(self, images: np.ndarray | Sequence[np.ndarray]) -> np.ndarray:
        """(B, S, S, c) uint8. Raises T2TwinError for arrays that are no 8-bit images."""
        preset = self.config.preset
        pixels = [np.empty((0, preset.size, preset.size, 1 if preset.grey else 3), np.uint8)]
        frames = [images] if _is_frame(images) else images
        for image in map(np.asarray, frames):
            if image.dtype != np.uint8 or not _is_frame(image) or not image.size:
                raise T2TwinError(
                    f"an image has shape {image.shape} and type {image.dtype}; it must be "
                    "(h, w, 3) or (h, w) of uint8"
                )
            pixels.append(to_pixels(Image.fromarray(image), preset.size, preset.grey)[None])
        return np.concatenate(pixels)


def load_run(run_dir: Path, layout: str | Path | None = None) -> TrainedTranslator:
    """A run's best weights, ready to predict.

    layout: a taxel layout's name or file to read a touch2touch run at, its own unless given.
    Raises T2TwinError where the folder holds no run, and for a layout that it cannot be read at.
    """
    config = load_config(run_dir)
    distributed.use_all_cores()
    translator = build(config)
    translator.bf16 = config.preset.bf16 and has_bf16()
    load_weights(run_dir / BEST, translator.predictor)
    fuse(translator.predictor)
    run = TrainedTranslator(run_dir, config, translator)
    if layout is None:
        return run
    from t2twin.translate.layouts import for_layout  # which knows what a Run is

    places = load_layout(layout)
    return for_layout(run, places.x_mm, places.y_mm, places.name)


def _is_frame(images: np.ndarray | Sequence[np.ndarray]) -> bool:
    """Whether this is one frame, grey or in colour, and not several."""
    if not isinstance(images, np.ndarray):
        return False
    return images.ndim == 2 or (images.ndim == 3 and images.shape[2] == 3)


def _parts(size: int, progress: str | None) -> list[slice] | tqdm:
    parts = [slice(start, start + AT_ONCE) for start in range(0, size, AT_ONCE)]
    return parts if progress is None else tqdm(parts, desc=progress, unit="batch")
