"""A trained run at work: images in, counts and tactile images out.

Shape letters: B images, R rows, C columns, N taxels, S the run's image side.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, Self

import numpy as np
import torch

from t2twin.core import arguments
from t2twin.core.arguments import check_seed
from t2twin.core.errors import T2TwinError
from t2twin.core.progress import Progress
from t2twin.sim.cyskin.layout import load_layout
from t2twin.translate.data.image_arrays import (
    ONE,
    Images,
    check_pixels,
    image_list,
    one_image,
    resized,
)
from t2twin.translate.data.images import to_input
from t2twin.translate.data.pairs import ImageFile, Pictures
from t2twin.translate.models.base import Translator
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.field_readout import FieldPrediction
from t2twin.translate.models.layouts import checked_counts, same_layout, same_pads
from t2twin.translate.models.presets import CYSKIN_TO_DIGIT, check_gives_counts
from t2twin.translate.models.reverse import CySkinToDigit
from t2twin.translate.networks.fold_batchnorm import fuse
from t2twin.translate.runs.build import build, has_bf16
from t2twin.translate.runs.checkpoint import load_weights
from t2twin.translate.runs.config import BEST, RunConfig, load_config
from t2twin.translate.runs.pretrained import DEFAULT_RUN, resolve_run
from t2twin.translate.uncertainty.estimate import Estimate, joined
from t2twin.translate.uncertainty.ood import LIKE, compare_with_background

BATCH_SIZE = 64
"""Images in one batch; bounds memory."""

MAX_FIELDS = 100_000
"""Most fields that one call samples (assumed: 216 places of each take 90 MB)."""

COUNTS = "counts"
"""What the export calls them."""


class Engine(Protocol):
    """What computes counts in the translator's place."""

    def of(self, run: "TrainedTranslator") -> Self:
        """The same for another run, such as one at another layout."""
        ...

    def __call__(self, pixels: np.ndarray) -> dict[str, np.ndarray] | None:
        """By the names of the export's outputs, of images as for predict_pixels; None where it
        cannot take them."""
        ...


@dataclass(frozen=True)
class TrainedTranslator:
    """A trained translator with its best weights; `load` makes one. engine: what computes counts,
    standard deviations and force in PyTorch's place, if anything does."""

    run_dir: Path
    config: RunConfig
    translator: Translator
    engine: Engine | None = None

    @property
    def draws(self) -> bool:
        """Whether it draws tactile images, as touch2touch does, and gives what it reads in them."""
        return self.translator.draws

    def predict(self, images: Images, background: np.ndarray | None = None) -> np.ndarray:
        """Counts of one DIGIT image or of several.

        images: one image, (h, w, 3) or (h, w); a batch, (B, h, w, 3) or (B, h, w, 1); or a list or
        tuple of images, whose sizes may differ. All are NumPy arrays of uint8 of any h and w,
        channels red, green, blue. A batch and a list may be empty. background: the background frame
        of the same DIGIT, one image, for a field run, which uses its world's mean frame without it.
        Returns (N,) float32 of one image, (B, N) of several, between zero and full scale. Raises
        T2TwinError for other images, for a background frame that the run does not use, and for a
        run that predicts no counts.
        """
        frames, is_one = image_list(images)
        counts = self.predict_pixels(self._pixels(frames, background))
        return counts[0] if is_one else counts

    def estimate(self, images: Images, background: np.ndarray | None = None) -> Estimate:
        """Counts, their standard deviations, and the force; of a field run.

        images, background: as for `predict`, at least one image. Raises T2TwinError as `predict`
        does, and for the other translators, which predict no standard deviations.
        """
        frames, is_one = image_list(images)
        told = self.estimate_pixels(self._pixels(frames, background))
        return told.first() if is_one else told

    def sample_fields(
        self,
        images: Images,
        number: int,
        seed: int = 0,
        background: np.ndarray | None = None,
    ) -> np.ndarray:
        """Fields sampled from the distribution that a field run predicts.

        images, background: as for `predict`. number: how many, 1 to MAX_FIELDS of all images.
        Returns (number, F) float32, counts, of one image, (B, number, F) of several. The F places
        are `config.data.field_x_mm` and `field_y_mm`. Raises T2TwinError as `estimate` does, and
        for a number or a seed that is not a whole number in range.
        """
        field = self._field()
        arguments.whole_number(number, "number", low=1, high=MAX_FIELDS)
        check_seed(seed)
        frames, is_one = image_list(images)
        if number * len(frames) > MAX_FIELDS:
            raise T2TwinError(
                f"{number} fields of {len(frames)} images are {number * len(frames)}; expected at "
                f"most {MAX_FIELDS} in all"
            )
        inputs = to_input(self._pixels(frames, background).astype(np.float32) / 255.0)
        drawn = field.teller.drawn(field.tell(inputs), int(number), int(seed)).cpu().numpy()
        return drawn[0] if is_one else drawn

    def estimate_pixels(
        self, pixels: np.ndarray | Pictures, progress: str | None = None
    ) -> Estimate:
        """As `estimate`, of one or more images as for `predict_pixels`."""
        field, parts = self._field(), []
        self._check_pixels(pixels)
        if not len(pixels):
            raise T2TwinError("there is no image to estimate; expected at least one")
        for part in _parts(len(pixels), progress):
            some = pixels[part]
            said = None if self.engine is None else self.engine(some)
            if said is not None:
                known = [said.get(name) for name in FieldPrediction._fields]
            else:
                told = field.tell(to_input(some.astype(np.float32) / 255.0))
                known = [None if each is None else each.cpu().numpy() for each in told]
            parts.append(Estimate(*known, full_scale_counts=field.full_scale))  # pyright: ignore
        return joined(parts)

    def drawn(self, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        """Tactile images of an estimate's field and of its standard deviations, of several images:
        (B, R, C) float32 each, counts."""
        draw = self._field().drawing.cpu()
        field, std = (
            draw(torch.from_numpy(of_all)).numpy()
            for of_all in (estimate.field, estimate.field_std)
        )
        return field, std

    def predict_pixels(
        self, pixels: np.ndarray | Pictures | ImageFile, progress: str | None = None
    ) -> np.ndarray:
        """The same for images already at the run's size and color, (B, S, S, c) uint8; of a field
        run also with their DIGITs' untouched frames after them, c = 6.

        progress: a name to show a bar under, or None.
        """
        check_gives_counts(self.run_dir, self.config.direction)
        self._check_pixels(pixels)
        counts = [np.empty((0, self.config.data.x_mm.size), np.float32)]
        for part in _parts(len(pixels), progress):
            some = pixels[part]
            said = None if self.engine is None else self.engine(some)
            if said is not None:
                counts.append(said[COUNTS])
            else:
                inputs = to_input(some.astype(np.float32) / 255.0)
                counts.append(self.translator.predict(inputs).cpu().numpy())
        return np.concatenate(counts)

    def tactile_images(self, images: Images) -> np.ndarray:
        """Tactile images of DIGIT images, given as for `predict`: (R, C) or (B, R, C), counts.

        Those of touch2touch are the generator's output, resized; those of ResNet18 are phi of its
        counts. Raises T2TwinError as `predict` does.
        """
        frames, is_one = image_list(images)
        tactile = self.counts_and_tactile_images(self._pixels(frames))[1]
        return tactile[0] if is_one else tactile

    def counts_and_tactile_images(self, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both at once, of images already at the run's size and color, (B, S, S, c) uint8.

        Returns (B, N) and (B, R, C) float32, counts.
        """
        check_gives_counts(self.run_dir, self.config.direction)
        self._check_pixels(pixels)
        inputs = to_input(pixels.astype(np.float32) / 255.0)
        counts, tactile = self.translator.counts_and_tactile_images(inputs)
        return counts.cpu().numpy(), tactile.cpu().numpy()

    def in_distribution(self, pixels: np.ndarray) -> np.ndarray:
        """(B,) bool: whether images, as for `predict_pixels`, look like nothing strange."""
        return np.array([not said for said in self.looks(pixels)], bool)

    def looks(self, pixels: np.ndarray) -> list[str]:
        """(B,) what images, as for `predict_pixels`, look like: nothing where they are like those
        of the training, and like their untouched frames where they have them, or in words why not,
        as in "upside down".

        A run that does not know what it was trained on says nothing by that.
        """
        self._check_pixels(pixels)
        known, pictures = self.config.pictures, pixels[..., :3]
        found = [LIKE] * len(pixels) if known is None else known.looks(pictures)
        if pixels.shape[-1] <= pictures.shape[-1]:
            return found
        beside = compare_with_background(pictures, pixels[..., 3:])
        return [said or other for said, other in zip(found, beside, strict=True)]

    def at_layout(
        self,
        x_mm: np.ndarray,
        y_mm: np.ndarray,
        name: str,
        pad_diameter_mm: np.ndarray | None = None,
    ) -> "TrainedTranslator":
        """The same run, giving the counts of another taxel layout.

        x_mm, y_mm: (N,) taxel positions, mm, sensor frame. name: the layout's. pad_diameter_mm:
        (N,) of its pads, 4 unless given; a field run reads them by their size.
        touch2touch's tactile image stays what it is; the new layout's phi^-1 reads it, at the
        generator's size. A field is read as the pads would (sim.cyskin.field_reading). For its own
        layout the run is given back as it is.
        Raises T2TwinError for a ResNet18 run; of touch2touch for a layout that phi cannot
        interpolate, taxels outside the trained layout's convex hull (the image says nothing there),
        and taxels too close together for the generator's pixels; of field for taxels off the cover.
        """
        check_gives_counts(self.run_dir, self.config.direction)
        trained = self.config.data
        x_mm, y_mm = arguments.vector(x_mm, "x_mm"), arguments.vector(y_mm, "y_mm")
        asked = replace(trained, layout=name, x_mm=x_mm, y_mm=y_mm, pad_diameter_mm=pad_diameter_mm)
        taxels = asked.taxels
        if same_layout(trained, x_mm, y_mm) and (
            not self.translator.learns_field or same_pads(trained.taxels, taxels)
        ):
            return self
        if not self.draws:
            raise T2TwinError(
                f"{self.run_dir} is a ResNet18, which gives the {trained.x_mm.size} taxels of "
                f"{trained.layout} that it was trained on and no others; another layout needs a "
                "touch2touch or a field run"
            )
        translator = self.translator.read_at(taxels)
        other = replace(
            self, config=replace(self.config, data=asked), translator=translator, engine=None
        )
        return other if self.engine is None else replace(other, engine=self.engine.of(other))

    def in_float32(self) -> "TrainedTranslator":
        """The same run in PyTorch, in float32 also where the processor has bfloat16."""
        return replace(self, translator=self.translator.in_float32(), engine=None)

    def picture_of(self, counts: np.ndarray) -> np.ndarray:
        """The DIGIT pictures that belong to counts; of a run that goes from the CySkin to the
        DIGIT.

        counts: (N,), or several, (B, N), from zero to full scale, in the order of the run's layout.
        Returns (S, S) or (B, S, S) uint8, grey, S the run's image side; the DIGIT's own pictures
        are 320 by 240. Raises T2TwinError for the other runs, and for what cannot be counts.
        """
        if not isinstance(self.translator, CySkinToDigit):
            raise T2TwinError(
                f"{self.run_dir} is a {self.config.direction} run, which draws no DIGIT pictures; "
                f"a run of `t2twin train touch2touch --direction {CYSKIN_TO_DIGIT}` does"
            )
        counts = checked_counts(counts, self.config.data)
        size = self.config.preset.size
        pictures = [np.empty((0, size, size), np.uint8)]
        several = torch.from_numpy(np.atleast_2d(counts))
        for part in _parts(len(several), None):
            drawn = self.translator.pictures(several[part])[:, 0]
            pictures.append(drawn.round().clamp(0.0, 255.0).to(torch.uint8).cpu().numpy())
        drawn = np.concatenate(pictures)
        return drawn[0] if counts.ndim == 1 else drawn

    def _field(self) -> FieldTranslator:
        """Its translator, of a field run. Raises T2TwinError for the others."""
        check_gives_counts(self.run_dir, self.config.direction)
        if not isinstance(self.translator, FieldTranslator):
            raise T2TwinError(
                f"{self.run_dir} is a {self.config.model} run, which gives counts and does not say "
                "how sure it is of them; a field run does"
            )
        return self.translator

    def pixels_of(self, images: Images, background: np.ndarray | None = None) -> np.ndarray:
        """What `predict_pixels` takes, of images as for `predict`.

        Raises T2TwinError for other images, and for a background frame that the run does not use.
        """
        return self._pixels(image_list(images)[0], background)

    def _pixels(
        self, frames: Sequence[np.ndarray], background: np.ndarray | None = None
    ) -> np.ndarray:
        """(B, S, S, c) uint8, of images that were checked and a background frame that was not."""
        preset = self.config.preset
        pixels = resized(frames, preset.size, preset.grey)
        if background is None:
            return pixels
        frame = one_image(background, "background", ONE)
        return self.with_background(pixels, resized([frame], preset.size, preset.grey)[0])

    def _check_pixels(self, pixels: np.ndarray | Pictures | ImageFile) -> None:
        """Raises T2TwinError for an array that is not as `pixels_of` returns it."""
        if not isinstance(pixels, Pictures | ImageFile):
            colors = (3, 6) if self.translator.learns_field else (3,)
            preset = self.config.preset
            check_pixels(pixels, preset.size, (1,) if preset.grey else colors)

    def with_background(self, pixels: np.ndarray, frame: np.ndarray) -> np.ndarray:
        """(B, S, S, 6) uint8: pixels, (B, S, S, 3), with a frame, (S, S, 3), after each.

        Raises T2TwinError for a run that does not look at one.
        """
        self._field()
        check_pixels(pixels, self.config.preset.size, (3,))
        check_pixels(np.asarray(frame)[None], self.config.preset.size, (3,))
        return np.concatenate([pixels, np.broadcast_to(frame, pixels.shape)], axis=-1)


def load_run(
    run_dir: str | Path, layout: str | Path | None = None, bf16: bool = False
) -> TrainedTranslator:
    """As `load`, of a run that gives counts. Raises T2TwinError for one that draws pictures too."""
    run = load(run_dir, layout, bf16)
    check_gives_counts(run.run_dir, run.config.direction)
    return run


def load(
    run: str | Path = DEFAULT_RUN, layout: str | Path | None = None, bf16: bool = False
) -> TrainedTranslator:
    """A run's best weights, ready to predict in PyTorch, or to draw pictures where it goes the
    other way.

    run: its folder, or the name of a pretrained run (t2twin.translate.runs.pretrained).
    layout: a taxel layout's name or file to read a touch2touch run at, its own unless given.
    bf16: compute in bfloat16 where the run's preset and the processor have it, which is faster and
    up to some hundred counts off what float32 gives.
    torch's threads and random numbers stay as they are.
    Raises T2TwinError where the folder holds no run, and for a layout that it cannot be read at.
    """
    run_dir, bf16 = resolve_run(run), arguments.flag(bf16, "bf16")
    config = load_config(run_dir)
    here = replace(config, bf16=bf16 and config.preset.bf16 and has_bf16())
    translator = build(here)
    load_weights(run_dir / BEST, translator.predictor)
    fuse(translator.predictor)
    trained = TrainedTranslator(run_dir, config, translator)
    if layout is None:
        return trained
    check_gives_counts(run_dir, config.direction)
    places = load_layout(layout)
    return trained.at_layout(places.x_mm, places.y_mm, places.name, places.pad_diameter_mm)


def _parts(size: int, progress: str | None) -> list[slice] | Progress:
    parts = [slice(start, start + BATCH_SIZE) for start in range(0, size, BATCH_SIZE)]
    return parts if progress is None else Progress(parts, desc=progress, unit="batch")
