"""A trained run as a predictor, of any pair of sensors.

Predictions that only some runs have raise a T2TwinError that names these runs.

Shape letters: B readings, R rows, C columns, N taxels, F places of the dense counts, S image side
of the run, c channels.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Self, cast

import numpy as np
import torch
from msgspec import structs
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError, warn
from t2twin.core.frame_order import TURNS_DEG, UPRIGHT, FrameOrder
from t2twin.core.images import fault_of, is_colored, is_noise
from t2twin.core.progress import Progress
from t2twin.sim.dataset.info import COUNTS, IMAGE, ArrayInfo, normalized
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.taxel_array import TaxelArray
from t2twin.translate.data.images import (
    COLORS,
    ONE,
    WHITE_GREY,
    Images,
    check_pixels,
    image_list,
    one_image,
    read_image,
    resized,
    to_input,
)
from t2twin.translate.data.pairs import Pictures, TactilePictures
from t2twin.translate.inference.estimate import (
    DIFFERENCES,
    VALUES,
    Estimate,
    contacts_of,
    half_width,
    warn_of_contacts,
)
from t2twin.translate.models.base import FEATURES, TACTILE_IMAGES, Translator
from t2twin.translate.models.field import FieldTranslator
from t2twin.translate.models.frame_check import FrameCheck, scores
from t2twin.translate.models.touch2touch import GENERATED
from t2twin.translate.runs.checkpoint import load_frame_check
from t2twin.translate.runs.config import HOME, RunConfig
from t2twin.translate.uncertainty.ood import (
    ASPECT_TOLERANCE,
    INVERSE_TRANSFORMS,
    MAX_BACKGROUNDS,
    OODClass,
    classify_frame,
    compare_with_background,
    unlike,
)

BATCH_SIZE = 64  # Images in one batch; bounds memory
TACTILE_STD = "tactile_std"
MAX_FIELDS = 100_000  # Maximum number of arrays that one call samples (assumed: 90 MB)
FORCE_STDS = half_width(0.9)  # Half of the interval of a force that must not contain 0 (assumed)
# Half widths of its interval from which a low force is not 0 (assumed). Measured: at least 3.5 for
# 0.1 and 0.2 N; at most 1.9 for frames of sampled units, without contact or with more than 0.4 N
SURE = 3.0
# Mean standard deviation of a depth map over its mean size above which a background frame without
# contact may explain it (assumed). Measured: at most 0.64 for 96 % of frames of 1 N and more; at
# least 0.71 for 13 real backgrounds, three of them streaky
MAX_DEPTH_STD = 0.66
# Differences of the logarithms of the odds from which another order of a frame is more likely, of
# a frame that is wrong in some way, and of any (assumed). Measured: at most 0 for the right order
# of 20 public units; above 8 for 0.5 % of sampled ones
LIKELY, CLEAR = 2.0, 8.0
# Share of the training's highest force above which a predicted one may be of any higher force:
# `field` predicts 15 to 17 N for 20 N (assumed)
NEAR_HIGHEST = 0.97
# The recommendation for a field run, of files and of live frames
NO_BACKGROUND = (
    "no background frame is given, which makes predictions less accurate; give an image of the "
    "same sensor without contact (--background)"
)
# Pressures that counts are of, by interpolation (assumed: of any array)
PRESSURES_MPA = np.append(0.0, np.geomspace(1e-6, 1e3, 2000))
Outputs = dict[str, np.ndarray]  # Predictions for B readings by name, see Translator
# Predicts pixels, as for `_predict_pixels`, with the contact or without; None if it cannot
Compute = Callable[[np.ndarray, bool], Outputs | None]
INSIDE = OODClass.IN_DISTRIBUTION
VAGUE = (INSIDE, OODClass.OTHER, OODClass.UNLIKE_BACKGROUND)  # Classes that do not name the fault


@dataclass(frozen=True)
class TrainedTranslator:
    """A trained run with its best weights, which `load` returns.

    engine: returns what computes the counts of a run in place of PyTorch, if set.
    """

    run_dir: Path
    config: RunConfig
    translator: Translator
    engine: "Callable[[TrainedTranslator], Compute] | None" = None

    def predict(self, readings: Images, background: np.ndarray | None = None) -> np.ndarray:
        """What the target measures for one reading of the source or for several.

        readings: of a gel camera one image, (h, w, 3) or (h, w), a batch, (B, h, w, 3) or
        (B, h, w, 1), or a list of images. The sizes in a list may differ. All are NumPy arrays of
        uint8 of any h and w, channels red, green, blue. Of a taxel array counts, (N,) or (B, N),
        from zero to full scale, in the order of its layout. A batch and a list may be empty.
        background: the background frame of the same sensor, one image, for a field run; by default
        the mean frame of its dataset.

        Returns counts, (N,) or (B, N) float32, between zero and full scale; or images of the
        target's size, (rows, columns, 3) or (B, rows, columns, 3) uint8. A run in grey has three
        equal channels; detail finer than the network's picture is missing. Warns with T2TwinWarning
        of images that are out of distribution, see `classify_frames`. Raises T2TwinError for other
        readings, and for a background frame with another run.
        """
        found, is_one = self._predict(readings, background)
        if self.config.predicts_images:
            rows, columns, _ = self.config.data.camera.image_shape
            large = np.empty((len(found), rows, columns, COLORS), np.uint8)
            for place, image in enumerate(found):
                shown = Image.fromarray(image if image.shape[-1] == COLORS else image[..., 0])
                shown = shown.convert("RGB").resize((columns, rows), Image.Resampling.BILINEAR)
                large[place] = np.asarray(shown)
            found = large
        return found[0] if is_one else found

    def predict_image(self, readings: Images) -> np.ndarray:
        """Images at the network's size, of a run that predicts images.

        readings: as for `predict`, with the same errors. Returns uint8 of one reading or of B, grey
        (S, S), or (S, S, 3) of a run in color.
        """
        self._need(self.config.predicts_images, "predict_image", "a run that predicts images")
        found, is_one = self._predict(readings, None)
        found = found if found.shape[-1] == COLORS else found[..., 0]
        return found[0] if is_one else found

    def _predict(self, readings: Images, background: np.ndarray | None) -> tuple[np.ndarray, bool]:
        """The predictions of B readings at the network's size, and whether there is one reading."""
        source = self.config.data.source
        if source.value == COUNTS:
            self._need(background is None, "a background frame", "a field run")
            counts = arguments.array(readings, "counts").astype(np.float32)
            taxels, full_scale = source.x_mm.size, source.full_scale
            is_one_per_taxel = counts.ndim in (1, 2) and counts.shape[-1] == taxels
            if not is_one_per_taxel or not ((counts >= 0) & (counts <= full_scale)).all():
                raise T2TwinError(
                    f"counts of shape {counts.shape} are not readings of {source.layout}; they "
                    f"must be ({taxels},) or (B, {taxels}), expected numbers from 0 to "
                    f"{full_scale:,.0f}"
                )
            warn(normalized(counts, full_scale))
            pixels = replace(self._pictures, counts=np.atleast_2d(counts))[:]
            return self._outputs(pixels)[self.config.data.target.value], counts.ndim == 1
        frames, is_one = image_list(readings)
        outputs, classes = self._predicted(frames, background)
        warn(unlike(classes, self.run_dir.name), self._order_warning(classes, background, frames))
        return outputs[self.config.data.target.value], is_one

    @cached_property
    def _pictures(self) -> TactilePictures:
        """The pictures of no counts of a taxel array."""
        array, preset = cast(ArrayInfo, self.config.data.source), self.config.preset
        none = np.empty((0, array.x_mm.size))
        return TactilePictures.of(none, array, preset.size, preset.grey)

    def _predict_pixels(
        self, pixels: np.ndarray | Pictures, progress: str | None = None
    ) -> np.ndarray:
        """(B, N) counts, or (B, S, S, c) uint8 images, of what `pixels_of` returns, or counts."""
        return self._outputs(pixels, progress)[self.config.data.target.value]

    def _predicted(
        self, frames: Sequence[np.ndarray], background: np.ndarray | None, contact: bool = False,
        tactile: bool = False,
    ) -> tuple[Outputs, list[OODClass]]:  # fmt: skip
        """Predictions and (B,) classes of checked images, in one pass."""
        rows, columns, _ = self.config.data.camera.image_shape
        pixels, aspect = self.pixels_of(frames, background), columns / rows
        outputs = self._outputs(pixels, None, contact, True, tactile)
        both = zip(frames, self._classified(pixels, outputs), strict=True)
        return outputs, [classify_frame(frame, aspect, background, kind) for frame, kind in both]

    def _outputs(
        self, pixels: np.ndarray | Pictures, progress: str | None = None,
        contact: bool = False, features: bool = False, tactile: bool = False,
    ) -> Outputs:  # fmt: skip
        """Predictions for checked pixels; of none, those of `_predict_pixels` alone."""
        found, in_torch = [], tactile and not self.config.has_uncertainty
        for part in parts_of(len(pixels), progress):
            batch = pixels[part]
            outputs = None if in_torch else self._compute(batch, contact)
            if outputs is None:
                inputs = self.translator.to_input(batch.astype(np.float32) / WHITE_GREY)
                tensors = self.translator.predict_all(inputs, contact, features)
                if features and self._frame_check is not None:
                    given = tensors[FEATURES].cpu(), inputs[:, :COLORS]
                    tensors |= self._frame_check.odds(*given)
                if in_torch:
                    tensors |= self.translator.tactile_images(tensors)
                outputs = {name: each.cpu().numpy() for name, each in tensors.items()}
                outputs.pop(GENERATED, None)
            if tactile and isinstance(self.translator, FieldTranslator):
                for name, values in ((TACTILE_IMAGES, "counts"), (TACTILE_STD, "counts_std")):
                    dense = torch.from_numpy(outputs[f"dense_{values}"])
                    outputs[name] = self.translator.dense_image(dense).numpy()
            if IMAGE in outputs:
                outputs[IMAGE] = outputs[IMAGE].round().clip(0.0, WHITE_GREY).astype(np.uint8)
            found.append(outputs)
        if found:
            return {name: np.concatenate([each[name] for each in found]) for name in found[0]}
        if not self.config.predicts_images:
            return {COUNTS: np.empty((0, self.config.data.array.x_mm.size), np.float32)}
        size, channels = self.config.preset.size, 1 if self.config.preset.grey else COLORS
        return {IMAGE: np.empty((0, size, size, channels), np.uint8)}

    @cached_property
    def _compute(self) -> Compute:
        return (lambda *_: None) if self.engine is None else self.engine(self)

    def tactile_images(self, images: Images, background: np.ndarray | None = None) -> np.ndarray:
        """Tactile images of images: (R, C) or (B, R, C) float32, counts.

        For touch2touch the predicted images, resized; for ResNet18 phi of the counts; for field the
        interpolated dense counts. Arguments, warning and errors: as for `estimate`.
        """
        return self.estimate(images, background, tactile=True).tactile_images

    def estimate(
        self, images: Images, background: np.ndarray | None = None, tactile: bool = False,
        contact: bool = False,
    ) -> Estimate:  # fmt: skip
        """All that a run from images to counts predicts, and the class of the frame.

        Of a field run also standard deviations, the dense counts and the force. tactile, contact:
        whether it has tactile images, and the contact. Arguments, warning and errors: as for
        `predict` and `contact`; at least one image. `ood_class` names images for which it is not
        reliable.
        """
        found = self._classified_estimate(images, background, tactile, contact)
        each, contacts = found.ood_class, found.contact
        classes = [each] if isinstance(each, OODClass) else each.tolist()
        stored = self._order_warning(classes, background, image_list(images)[0])
        warn(None if contact else unlike(classes, self.run_dir.name), stored)
        if contact:
            warn_of_contacts(contacts if isinstance(contacts, list) else [contacts])
        return found

    def _classified_estimate(
        self, images: Images, background: np.ndarray | None = None, tactile: bool = False,
        contact: bool = False,
    ) -> Estimate:  # fmt: skip
        """As `estimate`, without a warning: the caller reports `ood_class`."""
        self._need_counts("estimate")
        contact, tactile = arguments.flag(contact, "contact"), arguments.flag(tactile, "tactile")
        if contact and not self._need_uncertainty("the contact").config.predicts_contact:
            raise T2TwinError(
                f"{self.run_dir} does not predict the contact; train its layers with `t2twin train "
                f"field --init-from {self.run_dir} --contact-alone` on a dataset with contact maps"
            )
        frames, is_one = image_list(images)
        if not frames:
            raise T2TwinError("there is no image to estimate; expected at least one")
        outputs, classes = self._predicted(frames, background, contact, tactile)
        found = self._estimate(outputs, np.array(classes, dtype=object))
        if contact:
            sizes = [frame.shape[:2] for frame in frames]
            outputs |= self._differences(outputs)
            ranges = self.config.agreement.items()
            beyond = sum((outputs[n] < low) | (outputs[n] > high) for n, (low, high) in ranges)
            outputs["agrees"] = np.equal(beyond, np.zeros(len(frames)))
            of_image = contacts_of(outputs, sizes, self.config.data.camera.view_mm, classes)
            found = replace(found, contact=of_image)
        return found.first() if is_one else found

    def contact(self, images: Images, background: np.ndarray | None = None) -> Any:
        """The contact itself: depth, pressure, force, center of pressure and shear force.

        Arguments and errors: as for `estimate`. Returns a ContactEstimate on the camera's view, in
        the size of the image, or a list of them for several images. Its `notes` name what limits
        it, each of which is also a T2TwinWarning. Raises T2TwinError for a run that does not
        predict the contact.
        """
        return self.estimate(images, background, contact=True).contact

    def _differences(self, outputs: Outputs) -> Outputs:
        """(B,) of counts and contact by the names in DIFFERENCES; NaN without contact."""
        array, center = self._array, outputs["center_mm"]
        places = np.column_stack(cast(FieldTranslator, self.translator).places_mm)
        seen = (np.abs(places) <= self.config.data.camera.view_mm).all(axis=1)
        dense, carried_n = outputs["dense_counts"].astype(float), np.full(len(center), np.nan)
        if array is not None:
            counts = array.counts_of(PRESSURES_MPA)
            below = counts < array.full_scale
            carried_mpa = np.interp(dense, counts[below], PRESSURES_MPA[below])
            carried_n = carried_mpa.sum(axis=1) * array.dense_table.cell_mm2
        with np.errstate(divide="ignore", invalid="ignore"):
            of_counts = dense[:, seen] @ places[seen] / dense[:, seen].sum(axis=1, keepdims=True)
            ratio = carried_n / outputs.get("force_n", np.nan) + 0.0 * center[:, 0]
        return dict(zip(DIFFERENCES, (np.hypot(*(of_counts - center).T), ratio), strict=True))

    def _estimate_pixels(
        self, pixels: np.ndarray | Pictures, progress: str | None = None
    ) -> Estimate:
        """As `estimate`, without classes, for images as for `_predict_pixels`."""
        return self._estimate(self._outputs(pixels, progress), None)

    def _estimate(self, outputs: Outputs, classes: np.ndarray | None) -> Estimate:
        return Estimate(
            **{name: outputs[name] for name in VALUES if name in outputs},
            full_scale_counts=self.config.data.array.full_scale,
            ood_class=classes,
            array=self._array,
        )

    @cached_property
    def _array(self) -> TaxelArray | None:
        """The array as in datasets, None if its file is not here."""
        try:
            sensor = load_sensor(self.config.data.array.name)
        except T2TwinError:
            return None
        return sensor.for_dataset() if isinstance(sensor, TaxelArray) else None

    def sample_dense_counts(
        self, images: Images, number: int, seed: int = 0, background: np.ndarray | None = None
    ) -> np.ndarray:
        """Dense counts sampled from the predicted distribution of a field run.

        images, background: as for `predict`. number: samples per image; at most MAX_FIELDS in all.
        Returns (number, F) float32, counts, for one image, (B, number, F) for several. The F places
        are `config.data.array.dense_x_mm` and `dense_y_mm`. Raises T2TwinError as `predict`, and
        for a number or a seed that is not a whole number in range.
        """
        self._need_uncertainty("sample_dense_counts")
        frames, is_one = image_list(images)
        arguments.whole_number(number, "number", low=1, high=MAX_FIELDS // max(1, len(frames)))
        arguments.check_seed(seed)
        pixels = self.pixels_of(frames, background)
        found = self.translator.predict_all(
            self.translator.to_input(pixels.astype(np.float32) / WHITE_GREY)
        )
        dense_counts, std = found["dense_counts"], found["dense_counts_std"]
        field = cast(FieldTranslator, self.translator)
        samples = field.sample(dense_counts, std, int(number), int(seed)).cpu().numpy()
        return samples[0] if is_one else samples

    def classify_frames(
        self, images: Images, background: np.ndarray | None = None
    ) -> list[OODClass]:
        """(B,) classes of images at their own sizes. Arguments and errors: as for `predict`."""
        return self._predicted(image_list(images)[0], background)[1]

    def classify(self, pixels: np.ndarray) -> list[OODClass]:
        """(B,) classes of images, as `pixels_of` returns them, by out-of-distribution detection.

        Images are compared with the training images of the run, and with their background frames,
        if they have them. A run with a frame check uses it too, and the predicted force.
        """
        colors = (COLORS, 2 * COLORS) if self.config.has_uncertainty else (COLORS,)
        check_pixels(pixels, self.config.preset.size, (1,) if self.config.preset.grey else colors)
        outputs = {} if self._frame_check is None else self._outputs(pixels, features=True)
        return self._classified(pixels, outputs)

    def _classified(self, pixels: np.ndarray, outputs: Outputs) -> list[OODClass]:
        """As `classify`. outputs: predictions for the pixels."""
        images, frames = pixels[..., :COLORS], pixels[..., COLORS:]
        detector, has_frames = self.config.ood_detector, frames.shape[-1] > 0
        if detector is None:  # by faults alone; background frames have the colors of the sensor
            faults = map(fault_of, images, [has_frames and is_colored(each) for each in frames])
            ways = [[OODClass(fault or OODClass.NOT_COMPARED) for fault in faults]]
        else:
            ways = [detector.classify(images)]
        if has_frames:
            ways.append(compare_with_background(images, frames))
        if self._frame_check is not None and len(images):
            ways.append(self._frame_check.classify(outputs, has_frames))
        base = OODClass.NOT_COMPARED if detector is self._frame_check is None else INSIDE
        both = zip(*ways, strict=True)
        found = [next((e for e in each if e.inside is False), base) for each in both]
        known = self.config.data.force_n
        if self._frame_check is None or not known or "force_n" not in outputs:
            return found
        force_n, half = outputs["force_n"], FORCE_STDS * outputs["force_std_n"]
        too_low = (force_n > SURE * half) & (force_n < known[0])
        outside = (force_n > NEAR_HIGHEST * known[1]) | too_low
        touched = [has_frames and self._touched(frame.tobytes()) for frame in frames]
        for n, named in enumerate(found):
            if named in VAGUE and has_frames and self._order(frames[n].tobytes())[1] > CLEAR:
                found[n] = OODClass.OTHER_ORDER
            elif named in VAGUE and touched[n]:
                found[n] = OODClass.TOUCHED_BACKGROUND
            elif named in VAGUE and outside[n]:
                found[n] = OODClass.FORCE
        return found

    def _order_warning(
        self, classes: Sequence[OODClass], background: np.ndarray | None,
        images: Sequence[np.ndarray | Path], order: FrameOrder | None = None,
    ) -> str | None:  # fmt: skip
        """The warning for images that are probably stored in another order; None if they are not.

        classes, images: all of one unit, as arrays, or as files that are read in the order.
        """
        wrong = [n for n, each in enumerate(classes) if each.inside is False]
        image = images[wrong[0]] if wrong else None
        image = read_image(image, order or UPRIGHT) if isinstance(image, Path) else image
        frame = image if background is None else background
        if image is not None and frame is not None:
            (high, wide), (rows, columns) = image.shape[:2], frame.shape[:2]
            is_turned = abs(wide * columns / (high * rows) - 1.0) <= ASPECT_TOLERANCE
            if is_turned and (wide > high) != (columns > rows):
                return "the background frame is rotated against the images; store both in one order"
        kinds = {*classes} & {*INVERSE_TRANSFORMS, *VAGUE[1:], OODClass.OTHER_ORDER}
        if frame is None:
            return None
        pixels, is_of_noise = self._small(frame)
        found, more = (UPRIGHT, 0.0) if is_of_noise else self._order(pixels.tobytes())
        if more <= (LIKELY if kinds else CLEAR):
            return None
        if order is None:
            return f"the frames are probably not upright; pass {found!r}.upright(frame) of each"
        if order != UPRIGHT:
            return f"the frames are probably not stored in the order {order}"
        return (
            f"the frames are probably stored in the order {found} (options of commands; "
            "FrameOrder of functions)"
        )

    @cached_property
    def _small(self) -> Callable[[np.ndarray], tuple[np.ndarray, bool]]:
        """A background frame at the network's size and whether it is noise; keeps the last one."""
        size, last = self.config.preset.size, (np.empty(0), np.empty(0), False)

        def small(frame: np.ndarray) -> tuple[np.ndarray, bool]:
            nonlocal last
            known = last  # of any thread
            if not np.array_equal(known[0], frame):
                known = last = frame.copy(), resized([frame], size, False)[0], is_noise(frame)
            return known[1:]

        return small

    @cached_property
    def _order(self) -> Callable[[bytes], tuple[FrameOrder, float]]:
        """The likeliest order of a frame, (S, S, 3) uint8, and its logarithm of the odds less that
        of UPRIGHT. A frame that returns is compared once."""
        check, size = self._frame_check, self.config.preset.size
        orders = [FrameOrder(*each) for each in product(TURNS_DEG, (False, True), (False, True))]

        @lru_cache(MAX_BACKGROUNDS)
        def order(content: bytes) -> tuple[FrameOrder, float]:
            frame = np.frombuffer(content, np.uint8).reshape(size, size, COLORS)
            if check is None:
                return UPRIGHT, 0.0
            inputs = np.stack([each.upright(frame) for each in orders]) / np.float32(WHITE_GREY)
            with torch.inference_mode():
                odds = scores(check.transforms(to_input(inputs))).numpy()
            return orders[int(odds.argmin())], float(odds[0] - odds.min())  # the first is UPRIGHT

        return order

    def shows_contact(self, images: Images) -> list[bool]:
        """(B,) whether frames show a contact, as a background frame must not.

        Arguments and errors: as for `predict`. False for a run that predicts no force.
        """
        self._need_uncertainty("shows_contact")
        return [self._touched(frame.tobytes()) for frame in self.pixels_of(images)]

    @cached_property
    def _touched(self) -> Callable[[bytes], bool]:
        """Whether a frame, (S, S, 3) uint8, shows a contact: the force is above the training's
        least, and the depth above its uncertainty. A frame that returns is predicted once."""
        known, size = self.config.data.force_n, self.config.preset.size

        @lru_cache(MAX_BACKGROUNDS)
        def touched(content: bytes) -> bool:
            frame = np.frombuffer(content, np.uint8).reshape(1, size, size, COLORS)
            outputs = self._outputs(frame)
            if not known or "force_n" not in outputs or outputs["force_n"][0] <= known[0]:
                return False
            if not self.config.predicts_contact:
                return bool(outputs["force_n"] > FORCE_STDS * outputs["force_std_n"])
            outputs = self._outputs(frame, contact=True)
            depth_mm = MAX_DEPTH_STD * np.abs(outputs["depth_mm"]).sum()
            return bool(outputs["depth_std_mm"].sum() < depth_mm)

        return touched

    @property
    def name(self) -> str:
        """The run as a user names it: the name of a pretrained run, or its folder."""
        return self.run_dir.name if self.run_dir.parent == HOME else str(self.run_dir)

    @cached_property
    def _frame_check(self) -> FrameCheck | None:
        """The run's frame check, if it has one. Raises T2TwinError for a damaged file."""
        return load_frame_check(self.run_dir)

    def _need(self, has: bool, purpose: str, needed: str) -> Self:
        """The run. Raises T2TwinError unless it has what a purpose needs."""
        self.config.need(has, self.run_dir, purpose, needed)
        return self

    def _need_counts(self, purpose: str) -> Self:
        """The run. Raises T2TwinError unless it predicts counts from images."""
        return self._need(self.config.is_image_to_counts, purpose, "an image-to-counts run")

    def _need_uncertainty(self, purpose: str) -> Self:
        """The run. Raises T2TwinError unless it is a field run."""
        return self._need(self.config.has_uncertainty, purpose, "a field run")

    def _at_layout(self, layout: Layout) -> Self:
        """The same run with the counts of another taxel layout; of its own, the same object.

        touch2touch reads the predicted image with the new layout's phi^-1, field reads the dense
        counts with the new pads; others warn of other pads. Raises T2TwinError for a ResNet18 run,
        for taxels outside the trained layout's hull (touch2touch) or the cover (field), and as Phi.
        """
        trained, has_pads = self.config.data.array, self.config.has_uncertainty
        same_pads = trained.same_pads(layout)
        if not (same_pads or has_pads):
            warn(
                f"{self.name} was trained with other pads than those of {layout.name}, which "
                "it does not model: its counts are those of its own pads; a field run models pads"
            )
        if trained.same_layout(layout.x_mm, layout.y_mm) and (same_pads or not has_pads):
            return self
        purpose = f"another layout than {trained.layout} with its {trained.x_mm.size} taxels"
        reads_any = self.config.is_image_to_counts and self.translator.reads_any_layout
        self._need(reads_any, purpose, "a touch2touch or a field run from images")
        array = structs.replace(
            trained, layout=layout.name, x_mm=layout.x_mm, y_mm=layout.y_mm,
            pad_diameter_mm=layout.pad_diameter_mm,
        )  # fmt: skip
        translator = self.translator.read_at(layout)
        config = structs.replace(self.config, data=structs.replace(self.config.data, target=array))
        return replace(self, config=config, translator=translator)

    def _in_float32(self) -> Self:
        """The same run in PyTorch and float32."""
        return replace(self, translator=self.translator.in_float32(), engine=None)

    def pixels_of(self, images: Images, background: np.ndarray | None = None) -> np.ndarray:
        """The input of `classify`, (B, S, S, c) uint8. Arguments and errors: as for `predict`."""
        frames = image_list(images)[0]
        pixels = resized(frames, self.config.preset.size, self.config.preset.grey)
        if background is None:
            return pixels
        self._need_uncertainty("a background frame")
        behind = self._small(one_image(background, "background", ONE))[0]
        return np.concatenate([pixels, np.broadcast_to(behind, pixels.shape)], axis=-1)


def parts_of(size: int, progress: str | None) -> list[slice] | Progress:
    """The slices of batches, with a progress bar of this title."""
    parts = [slice(start, start + BATCH_SIZE) for start in range(0, size, BATCH_SIZE)]
    return parts if progress is None else Progress(parts, desc=progress, unit="part")
