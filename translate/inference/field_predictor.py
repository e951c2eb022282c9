"""Predictions of a field run: the field, the counts of any layout, and their uncertainty.

Shape letters: B images, R rows, C columns, N taxels, F places of the field, S image side of the
run.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import torch

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.translate.data.images import ONE, Images, check_pixels, image_list, one_image, to_input
from t2twin.translate.data.pairs import InputImages
from t2twin.translate.inference.predictor import CountsPredictor, parts_of
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.field_readout import FieldPrediction
from t2twin.translate.uncertainty.estimate import Estimate, concatenate

MAX_FIELDS = 100_000
"""Maximum number of fields that one call samples (assumed: 90 MB with 216 places)."""

NO_BACKGROUND = (
    "no background frame is given, which makes predictions less accurate; give an image of the "
    "same sensor without contact with --background"
)
"""The commands' recommendation for a field run."""


@dataclass(frozen=True)
class FieldPredictor(CountsPredictor):
    """A run that predicts the field, the counts of any layout, and their uncertainty."""

    translator: FieldTranslator

    PREDICTS: ClassVar[str] = "counts with uncertainty"
    RUNS: ClassVar[str] = "field run"

    def estimate(self, images: Images, background: np.ndarray | None = None) -> Estimate:
        """Counts, their standard deviations, the field and the force.

        Arguments and errors: as for `predict`; at least one image. `ood_class` of the result names
        images for which it is not reliable.
        """
        frames, is_one = image_list(images)
        estimate = self.estimate_pixels(self._pixels(frames, background))
        classes = np.array(self.classify_frames(frames, background), dtype=object)
        estimate = replace(estimate, ood_class=classes)
        return estimate.first() if is_one else estimate

    def estimate_pixels(
        self, pixels: np.ndarray | InputImages, progress: str | None = None
    ) -> Estimate:
        """As `estimate`, for one or more images as for `predict_pixels`."""
        parts = []
        self._check_pixels(pixels)
        if not len(pixels):
            raise T2TwinError("there is no image to estimate; expected at least one")
        for part in parts_of(len(pixels), progress):
            batch = pixels[part]
            outputs = None if self.engine is None else self.engine(batch)
            if outputs is not None:
                values = [outputs.get(name) for name in FieldPrediction._fields]
            else:
                inputs = to_input(batch.astype(np.float32) / 255.0)
                prediction = self.translator.predict_field(inputs)
                values = [None if each is None else each.cpu().numpy() for each in prediction]
            full_scale = self.config.data.full_scale_counts
            parts.append(Estimate(*values, full_scale_counts=full_scale))  # pyright: ignore
        return concatenate(parts)

    def sample_fields(
        self,
        images: Images,
        number: int,
        seed: int = 0,
        background: np.ndarray | None = None,
    ) -> np.ndarray:
        """Fields sampled from the predicted distribution.

        images, background: as for `predict`. number: samples per image; at most MAX_FIELDS in all.
        Returns (number, F) float32, counts, for one image, (B, number, F) for several. The F places
        are `config.data.field_x_mm` and `field_y_mm`. Raises T2TwinError as `predict`, and for a
        number or a seed that is not a whole number in range.
        """
        arguments.whole_number(number, "number", low=1, high=MAX_FIELDS)
        check_seed(seed)
        frames, is_one = image_list(images)
        if number * len(frames) > MAX_FIELDS:
            raise T2TwinError(
                f"{number} fields of {len(frames)} images are {number * len(frames)}; expected at "
                f"most {MAX_FIELDS} in all"
            )
        inputs = to_input(self._pixels(frames, background).astype(np.float32) / 255.0)
        prediction = self.translator.predict_field(inputs)
        samples = self.translator.readout.sample(prediction, int(number), int(seed)).cpu().numpy()
        return samples[0] if is_one else samples

    def field_images(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Tactile images of an estimate's field and of its standard deviations.

        estimate: of B images. Returns (B, R, C) float32 each, counts.
        """
        to_image = self.translator.field_image.cpu()
        field, std = (
            to_image(torch.from_numpy(each)).numpy()
            for each in (estimate.field, estimate.field_std)
        )
        return field, std

    def with_background(self, pixels: np.ndarray, frame: np.ndarray) -> np.ndarray:
        """(B, S, S, 6) uint8: pixels, (B, S, S, 3), each followed by a frame, (S, S, 3)."""
        check_pixels(pixels, self.config.preset.size, (3,))
        check_pixels(np.asarray(frame)[None], self.config.preset.size, (3,))
        return np.concatenate([pixels, np.broadcast_to(frame, pixels.shape)], axis=-1)

    def _pixels(
        self, frames: Sequence[np.ndarray], background: np.ndarray | None = None
    ) -> np.ndarray:
        pixels = super()._pixels(frames)
        if background is None:
            return pixels
        frame = one_image(background, "background", ONE)
        return self.with_background(pixels, super()._pixels([frame])[0])
