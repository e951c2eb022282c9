"""Trained runs as predictors of images, and of counts from counts.

Shape letters: B readings, N and M taxels of source and target, S side and c channels of a picture.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.translate.data.images import COLORS, Images, image_list, resized
from t2twin.translate.data.pairs import Pictures
from t2twin.translate.data.sides import ArraySide
from t2twin.translate.inference.predictor import TrainedTranslator, like_training, parts_of
from t2twin.translate.models.base import CountsTranslator
from t2twin.translate.models.touch2touch import ImageTranslator
from t2twin.translate.uncertainty.ood import classify_frame, combined, unlike

BILINEAR = Image.Resampling.BILINEAR


@dataclass(frozen=True)
class PicturePredictor(TrainedTranslator):
    """A run of a source or a target that only touch2touch and ResNet18 have."""

    def pictures_of(self, readings: object) -> tuple[np.ndarray, bool]:
        """The pictures of readings of the source, and whether there is one reading.

        readings: as for `predict`, with its errors. Returns (B, S, S, c), from 0 to 255.
        """
        source, preset = self.config.data.source, self.config.preset
        if isinstance(source, ArraySide):
            counts = _checked_counts(readings, source)
            return self._pictures(np.atleast_2d(counts)), counts.ndim == 1
        frames, is_one = image_list(readings)
        pixels = resized(frames, preset.size, preset.grey)
        own = [classify_frame(frame, source.aspect, None) for frame in frames]
        classes = list(map(combined, own, like_training(self.config, pixels)))
        if warning := unlike(classes, self.run_dir.name):
            warnings.warn(warning, T2TwinWarning, stacklevel=3)
        return pixels, is_one

    @cached_property
    def _pictures(self) -> Callable[[np.ndarray], np.ndarray]:
        """Makes the pictures of counts, (B, N), of a taxel array."""
        array, preset = self.config.data.source, self.config.preset
        assert isinstance(array, ArraySide)
        empty = array.pictures(np.empty((0, array.x_mm.size)), preset.size, preset.grey)
        return lambda counts: replace(empty, counts=counts)[:]

    def inputs_of(self, pixels: np.ndarray) -> torch.Tensor:
        """The network's input of pictures, (B, S, S, c), from 0 to 255."""
        return self.translator.to_input(pixels.astype(np.float32) / 255.0)


@dataclass(frozen=True)
class ImagePredictor(PicturePredictor):
    """A run that predicts images, from counts or from images of another gel camera."""

    translator: ImageTranslator

    PREDICTS: ClassVar[str] = "images"
    RUNS: ClassVar[str] = "a counts-to-image or image-to-image run"

    def predict(self, readings: Images) -> np.ndarray:
        """Images of the target's size, as it would take them.

        readings: counts, (N,) or (B, N), from zero to full scale, in the order of the run's layout;
        or of a gel camera, images as for `CountsPredictor.predict`. Returns (rows, columns, 3) or
        (B, rows, columns, 3) uint8; a run in grey has three equal channels. Detail finer than the
        network's picture is missing. Raises T2TwinError for invalid readings.
        """
        rows, columns, _ = self.config.data.camera.image_shape
        pixels, is_one = self.pictures_of(readings)
        found = np.empty((len(pixels), rows, columns, COLORS), np.uint8)
        for place, image in enumerate(self.predict_pixels(pixels)):
            shown = Image.fromarray(image if image.shape[-1] == COLORS else image[..., 0])
            found[place] = np.asarray(shown.convert("RGB").resize((columns, rows), BILINEAR))
        return found[0] if is_one else found

    def predict_image(self, readings: Images) -> np.ndarray:
        """Images at the network's size.

        readings: as for `predict`, with the same errors. Returns uint8 of one reading or of B, grey
        (S, S), or (S, S, 3) of a run in color.
        """
        pixels, is_one = self.pictures_of(readings)
        found = self.predict_pixels(pixels)
        found = found if found.shape[-1] == COLORS else found[..., 0]
        return found[0] if is_one else found

    def predict_pixels(
        self, pixels: np.ndarray | Pictures, progress: str | None = None
    ) -> np.ndarray:
        """Images, (B, S, S, c) uint8, of the pictures of `pictures_of`."""
        preset = self.config.preset
        channels = 1 if preset.grey else COLORS
        images = [np.empty((0, preset.size, preset.size, channels), np.uint8)]
        for part in parts_of(len(pixels), progress):
            predicted = self.translator.predict_images(self.inputs_of(pixels[part]))
            images.append(predicted.round().clamp(0.0, 255.0).to(torch.uint8).cpu().numpy())
        return np.concatenate(images)


@dataclass(frozen=True)
class ArrayPredictor(PicturePredictor):
    """A run that predicts counts of one taxel array from counts of another."""

    translator: CountsTranslator

    PREDICTS: ClassVar[str] = "counts from counts"
    RUNS: ClassVar[str] = "a counts-to-counts run"

    def predict(self, counts: np.ndarray) -> np.ndarray:
        """Counts of the target, (M,) or (B, M) float32, between zero and full scale.

        counts: of the source, (N,) or (B, N), from zero to full scale, in the order of its layout.
        Raises T2TwinError for invalid counts.
        """
        pixels, is_one = self.pictures_of(counts)
        found = self.predict_pixels(pixels)
        return found[0] if is_one else found

    def predict_pixels(
        self, pixels: np.ndarray | Pictures, progress: str | None = None
    ) -> np.ndarray:
        """(B, M) counts of the pictures of `pictures_of`."""
        counts = [np.empty((0, self.config.data.array.x_mm.size), np.float32)]
        for part in parts_of(len(pixels), progress):
            counts.append(self.translator.predict(self.inputs_of(pixels[part])).cpu().numpy())
        return np.concatenate(counts)


def _checked_counts(counts: object, data: ArraySide) -> np.ndarray:
    """Counts of the layout as an array, (N,) or (B, N) float32; T2TwinError if they are invalid."""
    found = arguments.array(counts, "counts").astype(np.float32)
    if found.ndim not in (1, 2) or found.shape[-1] != data.x_mm.size:
        raise T2TwinError(
            f"counts have shape {found.shape}; they must be ({data.x_mm.size},) or "
            f"(B, {data.x_mm.size}), one for each taxel of {data.layout}"
        )
    if not ((found >= 0) & (found <= data.full_scale_counts)).all():
        raise T2TwinError(
            f"a count is out of range; expected numbers from 0 to {data.full_scale_counts:,.0f}, "
            f"the range of the taxels of {data.layout}"
        )
    return found
