"""Field runs as predictors: dense counts, counts of any layout, their uncertainty, force, contact.

Shape letters: B images, R rows, C columns, N taxels, F places of the dense counts, S image side of
the run.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import torch

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.taxels.taxel_array import TaxelArray
from t2twin.translate.data.images import (
    COLORS,
    ONE,
    Images,
    check_pixels,
    image_list,
    one_image,
    to_input,
)
from t2twin.translate.data.pairs import Pictures
from t2twin.translate.inference.contact import ContactEstimate, contacts_of
from t2twin.translate.inference.predictor import (
    CountsPredictor,
    NotPredicted,
    Outputs,
    parts_of,
)
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.field_readout import FEATURES, FieldPrediction
from t2twin.translate.networks.frame_check import FrameCheck
from t2twin.translate.runs.checkpoint import load_frame_check
from t2twin.translate.uncertainty.estimate import Estimate, half_width
from t2twin.translate.uncertainty.ood import MAX_BACKGROUNDS, OODClass

MAX_FIELDS = 100_000
"""Maximum number of arrays that one call samples (assumed: 90 MB with 216 places)."""

FORCE_LEVEL = 0.9
"""Probability of the interval of a force that must not contain 0 (assumed)."""

SURE = 3.0
"""Half widths of its interval from which a low force is not 0 (assumed). Measured: at least 3.5 for
0.1 and 0.2 N; at most 1.9 for frames of sampled units, without contact or with more than 0.4 N."""

NEAR_HIGHEST = 0.97
"""Share of the training's highest force above which a predicted one may be of any higher force:
`field` predicts 15 to 17 N for 20 N (assumed)."""

NO_BACKGROUND = (
    "no background frame is given, which makes predictions less accurate; give an image of the "
    "same sensor without contact with --background"
)
"""The commands' recommendation for a field run."""


@dataclass(frozen=True)
class FieldPredictor(CountsPredictor):
    """A run that predicts the dense counts, the counts of any layout, and their uncertainty."""

    translator: FieldTranslator

    PREDICTS: ClassVar[str] = "counts with uncertainty"
    RUNS: ClassVar[str] = "a field run"

    def classify(self, pixels: np.ndarray) -> list[OODClass]:
        """See CountsPredictor. A run with a frame check uses it too, and the predicted force."""
        self._check_pixels(pixels)
        needed = self._frame_check is not None
        return self._classified(pixels, self._outputs(pixels, with_features=True) if needed else {})

    def shows_contact(self, images: Images) -> list[bool]:
        """(B,) whether frames show a contact, as a background frame must not.

        Arguments and errors: as for `predict`. False for a run that predicts no force.
        """
        pixels, known = self.pixels_of(images), self.config.data.force_n
        if not known or not self.translator.readout.predicts_force:
            return [False] * len(pixels)
        return self._touched(pixels, known[0])

    def _classified(self, pixels: np.ndarray, outputs: Outputs) -> list[OODClass]:
        known, inside = super()._classified(pixels, outputs), OODClass.IN_DISTRIBUTION
        found = []
        ways = (
            known,
            self._classes_by_check(pixels, outputs),
            self._classes_by_force(pixels, outputs),
        )
        for *others, by_force in zip(*ways, strict=True):
            named = next((each for each in others if each != inside), inside)
            is_vague = named in (inside, OODClass.OTHER, OODClass.UNLIKE_BACKGROUND)
            found.append(by_force if is_vague and by_force != inside else named)
        return found

    def _classes_by_check(self, pixels: np.ndarray, outputs: Outputs) -> list[OODClass]:
        """(B,) classes by the run's frame check, if it has one."""
        found: list[OODClass] = []
        if self._frame_check is None or not len(pixels):
            return [OODClass.IN_DISTRIBUTION] * len(pixels)
        features = torch.from_numpy(outputs[FEATURES])
        for part in parts_of(len(pixels), None):
            batch = pixels[part]
            images = to_input(batch[..., :COLORS] / np.float32(255.0))
            has_background = batch.shape[-1] > COLORS
            found += self._frame_check.classify(features[part], images, has_background)
        return found

    def _classes_by_force(self, pixels: np.ndarray, outputs: Outputs) -> list[OODClass]:
        """(B,) classes by the predicted forces of images and of their background frames, for a run
        with a frame check: it needs many images, without which forces are not predicted well.

        Predicted forces hardly exceed the training's highest force. Above NEAR_HIGHEST of it they
        may be of any higher force. Below the lowest, only a force that is SURE not to be 0 counts:
        frames without contact are in the training.
        """
        inside, known = OODClass.IN_DISTRIBUTION, self.config.data.force_n
        if not known or self._frame_check is None or outputs.get("force_n") is None:
            return [inside] * len(pixels)
        force_n, half = _force_and_half(outputs)
        outside = (force_n > NEAR_HIGHEST * known[1]) | (
            (force_n > SURE * half) & (force_n < known[0])
        )
        found = [OODClass.FORCE if each else inside for each in outside]
        if pixels.shape[-1] <= COLORS:
            return found
        touched = self._touched(pixels[..., COLORS:], known[0])
        named = OODClass.TOUCHED_BACKGROUND
        return [named if touch else each for each, touch in zip(found, touched, strict=True)]

    def _touched(self, frames: np.ndarray, low_n: float) -> list[bool]:
        """(B,) whether frames, (B, S, S, 3) uint8, show a contact: the force is above low_n, and
        its interval does not contain 0. A frame that returns is predicted once."""
        keys = [frame.tobytes() for frame in frames]
        found = dict(self._seen_backgrounds)
        new = {key: number for number, key in enumerate(keys) if key not in found}
        if new:
            force_n, half = _force_and_half(self._outputs(frames[list(new.values())]))
            touched = (force_n > low_n) & (force_n > half)
            found |= dict(zip(new, touched.tolist(), strict=True))
            self._seen_backgrounds[:] = list(found.items())[-MAX_BACKGROUNDS:]
        return [found[key] for key in keys]

    @cached_property
    def _seen_backgrounds(self) -> list[tuple[bytes, bool]]:
        """Background frames of earlier images, and whether they show a contact."""
        return []

    def _in_torch(self, inputs: torch.Tensor, with_contact: bool, with_features: bool) -> Outputs:
        found = self.translator.predict_all(inputs, with_contact, with_features)
        return {name: each.cpu().numpy() for name, each in found.named().items()}

    @cached_property
    def _array(self) -> TaxelArray | None:
        """The array as in datasets, None if its file is not here."""
        try:
            sensor = load_sensor(self.config.data.array.sensor or self.config.data.array.layout)
        except T2TwinError:
            return None
        return sensor.for_dataset() if isinstance(sensor, TaxelArray) else None

    @cached_property
    def _frame_check(self) -> FrameCheck | None:
        """The run's frame check, if it has one. Raises T2TwinError for a damaged file."""
        return load_frame_check(self.run_dir)

    def estimate(self, images: Images, background: np.ndarray | None = None) -> Estimate:
        """Counts, their standard deviations, the dense counts and the force.

        Arguments and errors: as for `predict`; at least one image. `ood_class` of the result names
        images for which it is not reliable.
        """
        frames, is_one = image_list(images)
        _check_some(len(frames))
        estimate = self._estimate(*self._predicted(frames, background))
        return estimate.first() if is_one else estimate

    def contact(
        self, images: Images, background: np.ndarray | None = None
    ) -> ContactEstimate | list[ContactEstimate]:
        """The contact itself: depth, pressure, force, center of pressure and shear force.

        Arguments and errors: as for `predict`. Returns a ContactEstimate on the camera's view, in
        the size of the image, or a list of them for several images. Its `notes` name what limits
        it. Raises T2TwinError for a run that does not predict the contact.
        """
        return self.estimate_with_contact(images, background)[1]

    def estimate_with_contact(
        self, images: Images, background: np.ndarray | None = None
    ) -> tuple[Estimate, ContactEstimate | list[ContactEstimate]]:
        """What `estimate` and `contact` return, in one pass. Arguments and errors: as for both."""
        if not self.predicts_contact:
            raise NotPredicted(
                f"{self.run_dir} does not predict the contact; train its layers with `t2twin train "
                f"field --init-from {self.run_dir} --contact-alone` on a dataset with contact maps"
            )
        frames, is_one = image_list(images)
        _check_some(len(frames))
        outputs, classes = self._predicted(frames, background, True)
        sizes = [frame.shape[:2] for frame in frames]
        contacts = contacts_of(outputs, sizes, self.config.data.camera.view_mm, classes)
        estimate = self._estimate(outputs, classes)
        return (estimate.first(), contacts[0]) if is_one else (estimate, contacts)

    @property
    def predicts_contact(self) -> bool:
        """Whether the run predicts the contact."""
        return bool(self.config.data.has_contact)

    def estimate_pixels(
        self, pixels: np.ndarray | Pictures, progress: str | None = None, classified: bool = False
    ) -> Estimate:
        """As `estimate`, for one or more images as for `predict_pixels`. classified: whether the
        result has the classes of `classify`."""
        self._check_pixels(pixels)
        _check_some(len(pixels))
        outputs, classes = self._outputs(pixels, progress, False, classified), None
        if classified:
            classes = self._classified(pixels[:], outputs)
        return self._estimate(outputs, classes)

    def _estimate(self, outputs: Outputs, classes: list[OODClass] | None) -> Estimate:
        return Estimate(
            *(outputs.get(name) for name in FieldPrediction._fields),  # pyright: ignore
            full_scale_counts=self.config.data.array.full_scale_counts,
            ood_class=None if classes is None else np.array(classes, dtype=object),
            array=self._array,
        )

    def sample_dense_counts(
        self,
        images: Images,
        number: int,
        seed: int = 0,
        background: np.ndarray | None = None,
    ) -> np.ndarray:
        """Dense counts sampled from the predicted distribution.

        images, background: as for `predict`. number: samples per image; at most MAX_FIELDS in all.
        Returns (number, F) float32, counts, for one image, (B, number, F) for several. The F places
        are `config.data.array.dense_x_mm` and `dense_y_mm`. Raises T2TwinError as `predict`, and
        for a number or a seed that is not a whole number in range.
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

    def dense_images(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Tactile images of an estimate's field and of its standard deviations.

        estimate: of B images. Returns (B, R, C) float32 each, counts.
        """
        to_image = self.translator.dense_image.cpu()
        field, std = (
            to_image(torch.from_numpy(each)).numpy()
            for each in (estimate.dense_counts, estimate.dense_counts_std)
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


def _check_some(images: int) -> None:
    """Raises T2TwinError without an image."""
    if not images:
        raise T2TwinError("there is no image to estimate; expected at least one")


def _force_and_half(outputs: Outputs) -> tuple[np.ndarray, np.ndarray]:
    """(B,) predicted forces and half widths of their intervals at FORCE_LEVEL, N."""
    return outputs["force_n"], half_width(FORCE_LEVEL) * outputs["force_std_n"]
