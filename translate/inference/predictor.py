"""Trained runs as predictors, and those that predict counts from images.

Modules field_predictor and picture_predictor have the others.
`predict` of every run takes what its source measures and returns what its target measures.

`load.load` returns the class that fits the run. Attributes that only another class has raise a
T2TwinError that names the kind of run that has them.

Shape letters: B images, R rows, C columns, N taxels, S image side of the run.
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import numpy as np
import torch
from msgspec import structs

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.core.progress import Progress
from t2twin.translate.data.images import (
    Images,
    check_pixels,
    image_list,
    resized,
    to_input,
)
from t2twin.translate.data.pairs import ImageFile, InputImages, Pictures
from t2twin.translate.data.sides import TactilePictures
from t2twin.translate.models.base import CountsTranslator, Translator
from t2twin.translate.models.field_readout import FEATURES
from t2twin.translate.models.presets import IMAGE_TO_COUNTS
from t2twin.translate.runs.config import RunConfig
from t2twin.translate.uncertainty.ood import (
    OODClass,
    classify_frame,
    combined,
    compare_with_background,
    unlike,
)

BATCH_SIZE = 64
"""Images in one batch; bounds memory."""

COUNTS = "counts"
"""Name of the counts in the outputs of an engine."""


Outputs = dict[str, np.ndarray]
"""Predictions for B images, by the names of the outputs of an ONNX file."""

Compute = Callable[[np.ndarray, bool], Outputs | None]
"""Predicts pixels, as for `CountsPredictor.predict_pixels`, with the contact or without; None if it
cannot."""


class NotPredicted(T2TwinError, AttributeError):
    """The run has no such prediction. Also an AttributeError, so that hasattr returns False."""


@dataclass(frozen=True)
class TrainedTranslator:
    """A trained run with its best weights; `load` returns one of its subclasses."""

    run_dir: Path
    config: RunConfig
    translator: Translator

    PREDICTS: ClassVar[str] = ""
    """The predictions of the class, in words."""

    RUNS: ClassVar[str] = ""
    """The runs of the class, in words."""

    if not TYPE_CHECKING:  # type checkers report attributes that a class does not have

        def __getattr__(self, name: str) -> Any:
            for kind in _kinds(TrainedTranslator):
                if name in vars(kind) and not name.startswith("_"):
                    raise not_predicted(self.run_dir, self.config, type(self), name, kind.RUNS)
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


def _kinds(kind: type[TrainedTranslator]) -> Iterator[type[TrainedTranslator]]:
    """The classes of predictors below one."""
    for each in kind.__subclasses__():
        yield each
        yield from _kinds(each)


@dataclass(frozen=True)
class CountsPredictor(TrainedTranslator):
    """A run that predicts counts from images.

    engine: returns what computes the predictions of a run in place of PyTorch, if set.
    """

    translator: CountsTranslator
    engine: Callable[["CountsPredictor"], Compute] | None = None

    PREDICTS: ClassVar[str] = "counts"
    RUNS: ClassVar[str] = "an image-to-counts run"

    def predict(self, images: Images, background: np.ndarray | None = None) -> np.ndarray:
        """Counts of one image or of several.

        images: one image, (h, w, 3) or (h, w); a batch, (B, h, w, 3) or (B, h, w, 1); or a list or
        tuple of images, whose sizes may differ. All are NumPy arrays of uint8 of any h and w,
        channels red, green, blue. A batch and a list may be empty. background: the background frame
        of the same sensor, one image, for a field run; by default the mean frame of its dataset.
        Returns (N,) float32 for one image, (B, N) for several, between zero and full scale. Warns
        with T2TwinWarning of images that are out of distribution, see `classify_frames`. Raises
        T2TwinError for other images, and for a background frame with another run.
        """
        frames, is_one = image_list(images)
        outputs, classes = self._predicted(frames, background)
        if warning := unlike(classes, self.run_dir.name):
            warnings.warn(warning, T2TwinWarning, stacklevel=2)
        return outputs[COUNTS][0] if is_one else outputs[COUNTS]

    def predict_pixels(
        self, pixels: np.ndarray | Pictures | ImageFile, progress: str | None = None
    ) -> np.ndarray:
        """(B, N) counts of images at the size and color of the run, as `pixels_of` returns them.

        pixels: (B, S, S, c) uint8; c = 6 for a field run with background frames. progress: title of
        a progress bar, or None.
        """
        self._check_pixels(pixels)
        return self._outputs(pixels, progress)[COUNTS]

    def _predicted(
        self,
        frames: Sequence[np.ndarray],
        background: np.ndarray | None,
        with_contact: bool = False,
    ) -> tuple[Outputs, list[OODClass]]:
        """Predictions and (B,) classes of checked images, in one pass."""
        pixels = self._pixels(frames, background)
        outputs = self._outputs(pixels, None, with_contact, with_features=True)
        return outputs, self._own_classes(frames, background, self._classified(pixels, outputs))

    def _outputs(
        self,
        pixels: np.ndarray | Pictures | ImageFile,
        progress: str | None = None,
        with_contact: bool = False,
        with_features: bool = False,
    ) -> Outputs:
        """Predictions for checked pixels. with_contact, with_features: whether they contain these,
        if the run has them."""
        found = []
        for part in parts_of(len(pixels), progress):
            batch = pixels[part]
            outputs = self._compute(batch, with_contact)
            if outputs is None:
                inputs = to_input(batch.astype(np.float32) / 255.0)
                outputs = self._in_torch(inputs, with_contact, with_features)
            elif not with_features:
                outputs.pop(FEATURES, None)
            found.append(outputs)
        if not found:
            return {COUNTS: np.empty((0, self.config.data.array.x_mm.size), np.float32)}
        return {name: np.concatenate([each[name] for each in found]) for name in found[0]}

    def _in_torch(self, inputs: torch.Tensor, with_contact: bool, with_features: bool) -> Outputs:
        """As `_outputs`, for one batch."""
        return {COUNTS: self.translator.predict(inputs).cpu().numpy()}

    @cached_property
    def _compute(self) -> Compute:
        return (lambda *_: None) if self.engine is None else self.engine(self)

    def tactile_images(self, images: Images, background: np.ndarray | None = None) -> np.ndarray:
        """Tactile images of images: (R, C) or (B, R, C) float32, counts.

        For touch2touch the predicted images, resized; for ResNet18 phi of the counts; for field the
        interpolated dense counts. Arguments, warning and errors: as for `predict`.
        """
        frames, is_one = image_list(images)
        if warning := unlike(self.classify_frames(images, background), self.run_dir.name):
            warnings.warn(warning, T2TwinWarning, stacklevel=2)
        tactile = self.counts_and_tactile_images(self._pixels(frames, background))[1]
        return tactile[0] if is_one else tactile

    def counts_and_tactile_images(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Counts, (B, N), and tactile images, (B, R, C), float32, counts.

        pixels: as for `predict_pixels`.
        """
        self._check_pixels(pixels)
        inputs = to_input(pixels.astype(np.float32) / 255.0)
        counts, tactile = self.translator.counts_and_tactile_images(inputs)
        return counts.cpu().numpy(), tactile.cpu().numpy()

    def in_distribution(self, pixels: np.ndarray) -> np.ndarray:
        """(B,) bool: whether images are in distribution. pixels: as for `predict_pixels`."""
        return np.array([each == OODClass.IN_DISTRIBUTION for each in self.classify(pixels)], bool)

    def classify_frames(
        self, images: Images, background: np.ndarray | None = None
    ) -> list[OODClass]:
        """(B,) classes of images at their own sizes, which `classify` does not have.

        Arguments and errors: as for `predict`.
        """
        frames, _ = image_list(images)
        classes = self.classify(self._pixels(frames, background))
        return self._own_classes(frames, background, classes)

    def _own_classes(
        self, frames: Sequence[np.ndarray], background: np.ndarray | None, classes: list[OODClass]
    ) -> list[OODClass]:
        """(B,) classes of checked images at their own sizes. classes: those of their pixels."""
        aspect = self.config.data.camera.aspect
        own = (classify_frame(frame, aspect, background) for frame in frames)
        return list(map(combined, own, classes))

    def classify(self, pixels: np.ndarray) -> list[OODClass]:
        """(B,) classes of images, as for `predict_pixels`, by out-of-distribution detection.

        Images are compared with the training images of the run, if it has their statistics, and
        with their background frames, if they have them.
        """
        self._check_pixels(pixels)
        return self._classified(pixels, {})

    def _classified(self, pixels: np.ndarray, outputs: Outputs) -> list[OODClass]:
        """As `classify`. outputs: predictions for the pixels."""
        images, inside = pixels[..., :3], OODClass.IN_DISTRIBUTION
        classes = like_training(self.config, images)
        if pixels.shape[-1] <= images.shape[-1]:
            return classes
        compared = compare_with_background(images, pixels[..., 3:])
        return [b if a == inside else a for a, b in zip(classes, compared, strict=True)]

    @property
    def reads_any_layout(self) -> bool:
        """Whether the network predicts an image or dense counts, from which any layout can be
        read."""
        return self.translator.reads_any_layout

    def at_layout(
        self,
        x_mm: np.ndarray,
        y_mm: np.ndarray,
        name: str,
        pad_diameter_mm: np.ndarray | None = None,
    ) -> Self:
        """The same run with the counts of another taxel layout.

        x_mm, y_mm: (N,) taxel positions, mm, sensor frame. name: of the layout. pad_diameter_mm:
        (N,), by default 4; it matters for a field run. For its own layout, returns the same object.
        touch2touch reads the predicted image with the new layout's phi^-1, field reads the dense
        counts with the new pads (sim.taxels.pads).
        Raises T2TwinError for a ResNet18 run. For touch2touch it does if phi cannot interpolate the
        layout, and if taxels lie outside the trained layout's hull or are too close for the
        generator's pixels. For field it does if taxels lie outside the cover.
        """
        data = self.config.data
        trained = data.array
        x_mm, y_mm = arguments.vector(x_mm, "x_mm"), arguments.vector(y_mm, "y_mm")
        array = structs.replace(
            trained, layout=name, x_mm=x_mm, y_mm=y_mm, pad_diameter_mm=pad_diameter_mm
        )
        if trained.same_layout(x_mm, y_mm) and (
            not self.translator.learns_dense_counts or trained.same_pads(array.taxels)
        ):
            return self
        if not self.translator.reads_any_layout:
            raise T2TwinError(
                f"{self.run_dir} is a ResNet18, which predicts only the {trained.x_mm.size} taxels "
                f"of {trained.layout} that it was trained on; another layout needs a touch2touch "
                "or a field run"
            )
        translator = self.translator.read_at(array.taxels)
        config = structs.replace(self.config, data=structs.replace(data, target=array))
        return replace(self, config=config, translator=translator)

    def in_float32(self) -> Self:
        """The same run in PyTorch and float32."""
        return replace(self, translator=self.translator.in_float32(), engine=None)

    def pixels_of(self, images: Images, background: np.ndarray | None = None) -> np.ndarray:
        """The input of `predict_pixels`. Arguments and errors: as for `predict`."""
        return self._pixels(image_list(images)[0], background)

    def _pixels(
        self, frames: Sequence[np.ndarray], background: np.ndarray | None = None
    ) -> np.ndarray:
        """(B, S, S, c) uint8. frames: checked images. background: not checked."""
        if background is None:
            return resized(frames, self.config.preset.size, self.config.preset.grey)
        kind = type(self)
        raise not_predicted(self.run_dir, self.config, kind, "a background frame", "field run")

    def _check_pixels(self, pixels: np.ndarray | Pictures | ImageFile) -> None:
        """Raises T2TwinError for pictures that `pixels_of` cannot return."""
        if isinstance(pixels, TactilePictures):
            raise T2TwinError(
                f"pixels are pictures of counts; expected {self.config.data.source.words}"
            )
        if not isinstance(pixels, InputImages | ImageFile):
            colors = (3, 6) if self.translator.learns_dense_counts else (3,)
            preset = self.config.preset
            check_pixels(pixels, preset.size, (1,) if preset.grey else colors)


Predictor = TypeVar("Predictor", bound=TrainedTranslator)


def require(run: TrainedTranslator, kind: type[Predictor], purpose: str) -> Predictor:
    """The run as a predictor of a kind. Raises T2TwinError for another kind, naming the purpose."""
    if not isinstance(run, kind):
        raise not_predicted(run.run_dir, run.config, type(run), purpose, kind.RUNS)
    return run


def not_predicted(
    run_dir: Path, config: RunConfig, kind: type[TrainedTranslator], purpose: str, needed: str
) -> NotPredicted:
    """The error for a run of a kind, used for a purpose that needs runs of another kind."""
    name = config.model if config.direction == IMAGE_TO_COUNTS else config.direction
    return NotPredicted(
        f"the run {run_dir} is {name}, which predicts {kind.PREDICTS}; {purpose} needs {needed}"
    )


def like_training(config: RunConfig, images: np.ndarray) -> list[OODClass]:
    """(B,) classes of images, (B, S, S, c) uint8, by the statistics of the training images."""
    if config.ood_detector is None:
        return [OODClass.IN_DISTRIBUTION] * len(images)
    return config.ood_detector.classify(images)


def parts_of(size: int, progress: str | None) -> list[slice] | Progress:
    parts = [slice(start, start + BATCH_SIZE) for start in range(0, size, BATCH_SIZE)]
    return parts if progress is None else Progress(parts, desc=progress, unit="batch")
