"""field: from the image to the dense counts over the whole cover, its uncertainty, and the
force.

The mean is trained on the squared error and, with a smaller weight, on the absolute error. The
spread has layers of its own and is trained on the likelihood of the detached residual, so that it
does not change the mean (Seitzer et al. 2022). The likelihood is Student's t: most presses have
small errors and a few have large ones, which dominate a Gaussian likelihood. Factors fitted on
validation presses calibrate the spread (module uncertainty.calibration), and a correlation matrix
of the errors allows sampling of whole arrays of dense counts.

The force is predicted as a logarithm, if the training presses have several forces. The shear force
on the gel camera is predicted if the training presses have motion. It has layers and an optimizer
of its own, so that it does not change the other predictions. Its mean is trained on the likelihood
at the predicted spread: without markers it cannot be predicted, and squared errors of such touches
would dominate (median magnitude 0.67 of the true one, measured). The contact in the view is
predicted in the same way (module contact), if the training presses have contact maps.

Shape letters: B batch, S image side, N taxels, F places of the dense counts.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
import torch
from torch import nn

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.columns import RANDOM_FAMILY
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.pads import reading_matrix
from t2twin.translate.data.images import COLORS, to_input
from t2twin.translate.data.pairs import DataInfo, Examples, Pairs
from t2twin.translate.models.base import CountsTranslator, adamw
from t2twin.translate.models.contact import (
    CONTACT_KPA,
    ContactReadout,
    contact_loss,
    contact_scale,
    depth_errors_mm,
    fit_contact_knots,
    fit_contact_limits,
)
from t2twin.translate.models.field_readout import (
    AllPredictions,
    DenseImage,
    FieldPrediction,
    FieldReadout,
    FromPixels,
    force_target,
    log_force,
    predicts_force,
)
from t2twin.translate.models.presets import Preset
from t2twin.translate.networks.contact_head import ContactOutputs
from t2twin.translate.networks.field_net import CONTACT, SCALE, SHEAR, FieldNet, FieldOutputs
from t2twin.translate.uncertainty.calibration import Errors, fit_calibration
from t2twin.translate.uncertainty.likelihood import negative_log_likelihood
from t2twin.translate.uncertainty.spread_scale import fit_scale, part_of, scaled

ABSOLUTE_WEIGHT = 0.1
"""Weight of the absolute error of the dense counts relative to the squared one, both divided by
their standard deviation (assumed). Squared errors of places without contact are negligible next to
those of a contact; without this term the network predicts up to 100 counts there."""

ROUNDING = 0.01
"""Error, in standard deviations of the dense counts, below which the absolute error is rounded off
(assumed)."""

FORCE_WEIGHT = 0.3
"""Weight of the force's squared error relative to that of the dense counts, both divided by their
variance (assumed)."""

MIN_RELATIVE_SHEAR_N = 0.3
"""Shear force below which its error is no longer relative to it, N (assumed: as for the figures of
an evaluation)."""


def training_loss(
    network: FieldNet, outputs: FieldOutputs, targets: Examples, full_scale: float
) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
    """The loss of a batch, and its parts by name.

    Errors are divided by the standard deviation of their target, likelihoods are in nats.
    """
    device = outputs.mean.device
    assert targets.dense_counts is not None and targets.force_n is not None
    error = outputs.mean - targets.dense_counts.to(device) / full_scale
    relative = error / network.field_variance.sqrt()
    losses = {
        "field": relative.square().mean(),
        "field_absolute": (relative.square() + ROUNDING**2).sqrt().mean(),
        "spread": negative_log_likelihood(error.detach(), outputs.log_spread).mean(),
    }
    loss = losses["field"] + ABSOLUTE_WEIGHT * losses["field_absolute"] + losses["spread"]
    if predicts_force(network):
        error = outputs.force - force_target(network, targets.force_n.to(device))
        likelihood = negative_log_likelihood(error.detach(), outputs.force_log_spread)
        losses |= {"force": error.square().mean(), "force_spread": likelihood.mean()}
        loss = loss + FORCE_WEIGHT * losses["force"] + losses["force_spread"]
    if outputs.shear is not None and outputs.shear_log_spread is not None:
        assert targets.shear_n is not None
        shear_n = targets.shear_n.to(device)
        error = outputs.shear - shear_n / network.shear_scale
        log_spread = outputs.shear_log_spread
        losses["shear"] = negative_log_likelihood(error, log_spread.detach()).mean()
        likelihood = negative_log_likelihood(error.detach(), log_spread).mean(dim=1)
        # Without markers, presses that stay still have no error.
        moving = shear_n.any(dim=1).float()
        losses["shear_spread"] = likelihood @ moving / moving.sum().clamp(min=1.0)
        loss = loss + losses["shear"] + losses["shear_spread"]
    if outputs.contact is not None:
        assert targets.contact is not None
        of_contact, parts = contact_loss(network, outputs.contact, targets.contact.to(device))
        loss, losses = loss + of_contact, losses | parts
    return loss, losses


def relative_squares(error_n: torch.Tensor, shear_n: torch.Tensor) -> torch.Tensor:
    """(B,): squared errors of shear forces relative to them. Both (B, 2), N."""
    size = shear_n.square().sum(dim=1) + MIN_RELATIVE_SHEAR_N**2
    return error_n.square().sum(dim=1) / size


NEW_RATE_SHARE = 5.0
"""Learning rate of the layers of shear force and contact, divided by the preset's (assumed: they
are new after a warm start, whose learning rate is lower)."""

MEAN_FRAME_SHARE = 0.35
"""Share of the training pairs whose background frame is replaced by the dataset's mean frame
(assumed), so that the network also works without a background frame."""

MIN_SHEAR_SCALE_N = 1e-3
"""Least scale of the shear force, N (assumed), for presses that all stay still."""

MEAN_FRAME_IMAGES = 2000
"""Images averaged to the mean frame if the pairs have no background frames (assumed)."""

MIN_RANDOM_PRESSES = 500
"""Minimum number of validation presses of random shapes for a calibration mostly on these
(assumed)."""

OTHER_PRESSES = 1 / 3
"""Presses of other shapes in a calibration, relative to those of random shapes (assumed)."""

LIMIT_PRESSES = 400
"""Presses of a dataset that the limits of contact are set on, at most (assumed: quantiles of half a
percent need some hundreds)."""

BATCH_SIZE = 64
"""Images in one batch of prediction; bounds memory."""


class FieldTranslator(CountsTranslator):
    """One network, which predicts the dense counts; any layout can be read from it."""

    predictor: FieldNet
    learns_dense_counts = reads_any_layout = True
    is_replayable = False  # mirrors features at random

    def __init__(self, preset: Preset, info: DataInfo, device: torch.device, bf16: bool) -> None:
        array = info.array
        if array.dense_x_mm is None or array.dense_y_mm is None:
            raise T2TwinError(
                "the dataset has no dense counts, which the field model is trained on"
            )
        self.layout, self.places_mm = array.taxels, (array.dense_x_mm, array.dense_y_mm)
        self.network = FieldNet(
            *self.places_mm, info.camera.view_mm, preset.size, preset.filters,
            bool(info.has_shear), bool(info.has_contact),
        )  # fmt: skip
        super().__init__(preset, info, device, bf16, {"field": self.network})
        self.is_contact_alone = False

    def make_optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """See Translator."""
        network, preset, found = self.network, self.preset, {}
        if network.predicts_contact:
            found[CONTACT] = adamw(network.contact.parameters(), preset, NEW_RATE_SHARE)
        if self.is_contact_alone:
            return found
        if network.predicts_shear:
            found = {SHEAR: adamw(network.shear.parameters(), preset, NEW_RATE_SHARE)} | found
        others = (SHEAR, CONTACT, SCALE)
        own = [each for name, each in network.named_parameters() if not name.startswith(others)]
        return {"field": adamw(own, preset)} | found

    def train_contact_alone(self) -> None:
        """Leaves the weights and the calibration of everything but the contact as they are."""
        self.is_contact_alone = True

    def prepare(self, pairs: Pairs) -> None:
        """Sets the mean frame, and the scales of the outputs if loaded weights lack them."""
        if self.network.predicts_contact and not self.network.contact_scale.any():
            assert pairs.contact is not None
            for network in (self.network, self.predictor):
                network.contact_scale.copy_(contact_scale(pairs.contact))
        if self.is_contact_alone:
            return
        assert pairs.dense_counts is not None
        field = pairs.dense_counts / np.float32(self.full_scale)
        forces = log_force(torch.tensor(pairs.force_n))
        frame = (
            pairs.images[:MEAN_FRAME_IMAGES].mean(axis=0, dtype=np.float32)
            if pairs.backgrounds is None
            else pairs.backgrounds.mean()
        )
        for network in (self.network, self.predictor):
            network.mean_frame.copy_(to_input(frame[None] / 255.0)[0])
            if not network.field_mean.any():
                network.field_mean.copy_(torch.from_numpy(field.mean(axis=0)))
                network.field_variance.fill_(float(field.var(axis=0).mean()))
            if not predicts_force(network):
                network.force_scale.copy_(torch.stack([forces.mean(), forces.std(correction=0)]))
            if network.predicts_shear and not network.shear_scale:
                assert pairs.shear_n is not None
                rms_n = float(np.sqrt(np.square(pairs.shear_n).mean()))
                network.shear_scale.fill_(max(rms_n, MIN_SHEAR_SCALE_N))

    def optimize(self, examples: Examples) -> dict[str, torch.Tensor]:
        """One step on the errors of dense counts and force and the likelihoods of their spreads.

        Returns the losses by name: errors divided by the standard deviation, likelihoods in nats.
        """
        network, images = self.network, self._training_input(examples.images).to(self.device)
        if self.is_contact_alone:
            assert examples.contact is not None
            network.eval()
            network.contact.train()
            with self.precision():
                contact = network.contact_outputs(images)
            loss, losses = contact_loss(network, contact, examples.contact.to(self.device))
        else:
            with self.precision():
                outputs = network(images, network.predicts_contact)
            loss, losses = training_loss(network, outputs, examples, self.full_scale)
        self.descend(loss, self.network, *self.optimizers)
        return {name: each.detach() for name, each in losses.items()}

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """See CountsTranslator. images: (B, 3, S, S), or (B, 6, S, S) with background frames."""
        return self.predict_field(images).counts

    def predict_field(self, images: torch.Tensor) -> FieldPrediction:
        """All predictions. images: as for `predict`."""
        return self.predict_all(images).field

    def predict_all(
        self, images: torch.Tensor, with_contact: bool = False, with_features: bool = False
    ) -> AllPredictions:
        """The predictions of one pass. images: as for `predict`. with_contact, with_features:
        whether they contain these."""
        self.predictor.eval()
        with torch.inference_mode():
            with self.precision():
                outputs = self.predictor(self._with_frame(images), with_contact, with_features)
            contact = None
            if outputs.contact is not None:
                has_frame = torch.tensor(images.shape[1] > COLORS, device=self.device)
                contact = self.contact_readout(outputs.contact, has_frame)
            return AllPredictions(self.readout(outputs), outputs.features, contact)

    def frame_features(self, images: torch.Tensor) -> torch.Tensor:
        """(B, n) features for the frame check, by the encoder alone. images: as for `predict`."""
        self.predictor.eval()
        with torch.inference_mode(), self.precision():
            maps = self.predictor.encoded(self._with_frame(images))
            return self.predictor.frame_features(maps)

    def contact_outputs(self, images: torch.Tensor) -> ContactOutputs:
        """The outputs of the contact's layers. images: as for `predict`."""
        self.predictor.eval()
        with torch.inference_mode(), self.precision():
            return self.predictor.contact_outputs(self._with_frame(images))

    @cached_property
    def contact_readout(self) -> ContactReadout:
        """Reads the contact from the network's outputs."""
        return ContactReadout(self.predictor, self.info.camera.view_mm)

    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """See CountsTranslator. The tactile images are those of the dense counts."""
        prediction = self.predict_field(images)
        return prediction.counts, self.dense_image(prediction.dense_counts)

    def calibrate(self, *sets: Pairs) -> None:
        """See Translator: sets the knots and the correlation of the predictor."""
        network, chosen = self.predictor, [_mostly_new_shapes(pairs) for pairs in sets]
        if network.predicts_contact:
            vars(self).pop("contact_readout", None)
            parts = [each for pairs in chosen for each in self._contacts_on(pairs)]
            fit_contact_knots(network, self.info.camera.view_mm, parts)
            fit_contact_limits(network, *self._largest_logits(sets))
        if self.is_contact_alone:
            return
        network.scale.reset()
        errors = [self._errors_on(pairs) for pairs in chosen]
        errors += [
            replace(
                self._errors_on(replace(pairs, backgrounds=None)), shear=None, shear_spread=None
            )
            for pairs in chosen
            if pairs.backgrounds is not None
        ]
        fit_scale(network.scale, [part_of(each, held_out=False) for each in errors])
        held_out = (part_of(each, held_out=True) for each in errors)
        found = fit_calibration([scaled(network.scale, each) for each in held_out])
        network.place_knots.copy_(found.place)
        network.press_knots.copy_(found.press)
        if predicts_force(network):
            network.force_knots.copy_(found.force)
        if found.shear is not None:
            network.shear_knots.copy_(found.shear)
        network.correlation.copy_(found.correlation)
        vars(self).pop("readout", None)

    def shear_error(self, pairs: Pairs) -> float | None:
        """See Translator. The geometric mean counts touches with and without markers alike."""
        if pairs.shear_n is None or not pairs.shear_n.any() or not self.predictor.predicts_shear:
            return None
        logs = []
        for part, _, outputs in self._outputs_on(pairs):
            shear_n = torch.from_numpy(pairs.shear_n[part].astype(np.float32)).to(self.device)
            assert outputs.shear is not None
            error = outputs.shear * self.predictor.shear_scale - shear_n
            logs.append(relative_squares(error, shear_n)[shear_n.any(dim=1)].log())
        return float(torch.cat(logs).mean().div(2.0).exp())

    def contact_error(self, pairs: Pairs) -> float | None:
        """See Translator."""
        if not self.predictor.predicts_contact or pairs.contact is None:
            return None
        scale = self.predictor.contact_scale
        errors = [depth_errors_mm(scale, *each) for each in self._contacts_on(pairs)]
        return float(torch.cat(errors).mean())

    def _contacts_on(self, pairs: Pairs) -> Iterator[tuple[ContactOutputs, torch.Tensor]]:
        """The outputs for pairs, and their contact maps, batch by batch; none without maps."""
        if pairs.contact is None:
            return
        for start in range(0, len(pairs), BATCH_SIZE):
            part = slice(start, start + BATCH_SIZE)
            inputs = to_input(pairs.inputs[part].astype(np.float32) / 255.0)
            maps = torch.from_numpy(pairs.contact[part].astype(np.float32))
            yield self.contact_outputs(inputs), maps.to(self.device)

    def _largest_logits(
        self, sets: Sequence[Pairs]
    ) -> tuple[list[torch.Tensor], list[torch.Tensor]]:
        """Largest logits of contact in pairs without and with one, as for `fit_contact_limits`.

        Background frames are images without contact too, for the mode without them.
        """
        without_contact, with_contact = [torch.empty(0)] * 2, [torch.empty(0)] * 2
        for pairs in sets:
            if pairs.contact is None:
                continue
            none, some = np.flatnonzero(pairs.force_n == 0), np.flatnonzero(pairs.force_n > 0)
            some = some[:: -(-len(some) // LIMIT_PRESSES) or 1]
            in_view = (pairs.contact[some][:, 1] > CONTACT_KPA).any(axis=(1, 2))
            without, given = pairs.inputs[none], pairs.inputs[some]
            for found, pixels in ((without_contact, without), (with_contact, given[in_view])):
                for mode, inputs in enumerate((pixels[..., :COLORS], pixels)):
                    found[mode] = torch.cat([found[mode], self._largest_logit(inputs)])
            if given.shape[-1] > COLORS:
                frames = self._largest_logit(given[..., COLORS:])
                without_contact[0] = torch.cat([without_contact[0], frames])
        return without_contact, with_contact

    def _largest_logit(self, pixels: np.ndarray) -> torch.Tensor:
        """(B,) largest logit of contact of pixels, (B, S, S, c) uint8."""
        found = [torch.empty(0)]
        for start in range(0, len(pixels), BATCH_SIZE):
            part = pixels[start : start + BATCH_SIZE].astype(np.float32) / 255.0
            found.append(self.contact_outputs(to_input(part)).logit.amax(dim=(1, 2)).cpu())
        return torch.cat(found)

    @cached_property
    def readout(self) -> FieldReadout:
        """Reads the counts of `layout` from the network's outputs."""
        return FieldReadout(self.predictor, self._reading(self.layout), self.full_scale)

    def _reading(self, layout: Layout) -> np.ndarray:
        """(N, F): maps dense counts to the counts of a layout."""
        array = self.info.array
        assert array.dense is not None
        return reading_matrix(array.dense, layout, array.elastomer)

    @cached_property
    def dense_image(self) -> DenseImage:
        """Maps dense counts to tactile images."""
        rows, columns, px_per_mm = self.info.array.tactile_image
        return DenseImage(*self.places_mm, (rows, columns), px_per_mm).to(self.device)

    def read_at(self, layout: Layout) -> Self:
        """See CountsTranslator. Takes any layout on the cover, with its pad sizes."""
        other = copy(self)
        other.layout = layout
        other.readout = FieldReadout(self.predictor, self._reading(layout), self.full_scale)
        return other

    def as_module(self) -> nn.Module:
        """See CountsTranslator. The module also takes a background frame, (1, 3, S, S), and also
        returns uncertainty, dense counts, force and contact, as FromPixels describes."""
        contact = self.contact_readout if self.predictor.predicts_contact else None
        return FromPixels(self.predictor, self.readout, self.dense_image, contact)

    def _errors_on(self, pairs: Pairs) -> Errors:
        assert pairs.dense_counts is not None
        parts = []
        for part, inputs, outputs in self._outputs_on(pairs):
            field = torch.from_numpy(pairs.dense_counts[part].astype(np.float32)).to(self.device)
            force = torch.from_numpy(pairs.force_n[part].astype(np.float32)).to(self.device)
            error = field / self.full_scale - outputs.mean.clamp(0.0, 1.0)
            force_error = force_target(self.predictor, force) - outputs.force
            spreads = outputs.log_spread.exp(), outputs.force_log_spread.exp()
            features = self.predictor.scale.features(
                inputs, self.predictor.mean_frame, *outputs[:4]
            )
            values = [error, spreads[0], force_error, spreads[1], *features]
            if pairs.shear_n is not None and outputs.shear is not None:
                assert outputs.shear_log_spread is not None
                shear = torch.from_numpy(pairs.shear_n[part].astype(np.float32)).to(self.device)
                moving = shear.any(dim=1)  # others have errors near zero without markers
                values.append((shear / self.predictor.shear_scale - outputs.shear)[moving])
                values.append(outputs.shear_log_spread[moving].exp())
            parts.append(values)
        return Errors(*(torch.cat(part).cpu() for part in zip(*parts, strict=True)))

    def _outputs_on(self, pairs: Pairs) -> Iterator[tuple[slice, torch.Tensor, FieldOutputs]]:
        """The inputs, each with its background frame, and the outputs for pairs, batch by batch."""
        for start in range(0, len(pairs), BATCH_SIZE):
            part = slice(start, start + BATCH_SIZE)
            inputs = self._with_frame(to_input(pairs.inputs[part].astype(np.float32) / 255.0))
            yield part, inputs, self.outputs(inputs)

    def outputs(self, inputs: torch.Tensor) -> FieldOutputs:
        """See Translator. inputs: as for `predict`."""
        return super().outputs(self._with_frame(inputs))

    def _with_frame(self, inputs: torch.Tensor) -> torch.Tensor:
        """(B, 6, S, S): images, each with a background frame, by default the mean frame."""
        images = inputs.to(self.device)
        if images.shape[1] == 3:
            images = torch.cat([images, self.predictor.mean_frame.expand_as(images)], dim=1)
        return images

    def _training_input(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 6, S, S): images with background frames, a share of them the mean frame."""
        image, mean_frame = images[:, :3], self.network.mean_frame.to(images.device)
        if images.shape[1] == 3:
            frame = mean_frame.expand_as(image)
        else:
            replaced = torch.rand(images.shape[0], 1, 1, 1) < MEAN_FRAME_SHARE
            frame = torch.where(replaced.to(images.device), mean_frame, images[:, 3:])
        both = torch.cat([image, frame], dim=1)
        return both.contiguous(memory_format=torch.channels_last)


def _mostly_new_shapes(pairs: Pairs) -> Pairs:
    """The presses of random shapes and a third as many others, or all presses if there are few of
    random shapes.

    Versions of trained primitives have smaller errors than new shapes, and users press both.
    """
    is_random = pairs.families == RANDOM_FAMILY
    others = np.flatnonzero(~is_random)
    if is_random.sum() < MIN_RANDOM_PRESSES:
        return pairs
    number = min(len(others), int(is_random.sum() * OTHER_PRESSES))
    others = np.random.default_rng(0).choice(others, number, replace=False)
    return pairs.subset(np.sort(np.append(np.flatnonzero(is_random), others)))
