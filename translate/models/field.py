"""field: from the image to the dense counts over the whole cover, force, shear and contact.

Each output has a mean and a spread. The spread has layers of its own and is trained on Student's
likelihood of the detached residual, so that it does not change the mean (Seitzer et al. 2022). The
calibration follows on validation presses (uncertainty.calibration). Shear and contact have layers
and optimizers of their own. The shear's mean is trained on the likelihood at the predicted spread.
Without markers it is unknown, and squared errors of such touches would dominate (median magnitude
0.67 of the true one, measured).

Shape letters: B batch, S image side, N taxels, F places of the dense counts, R rows and C columns
of a tactile image.
"""

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
import torch

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.columns import RANDOM_FAMILY
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.pads import reading_matrix
from t2twin.sim.taxels.phi import barycentric
from t2twin.translate.data.images import COLORS, WHITE_GREY, to_input
from t2twin.translate.data.pairs import DataInfo, Examples, Pairs
from t2twin.translate.models.base import TACTILE_IMAGES, FromPixels, Outputs, Translator, adamw
from t2twin.translate.models.contact import (
    CONTACT_KPA,
    contact_losses,
    contact_scale,
    depth_errors_mm,
    fit_contact_knots,
    fit_contact_limits,
    read_contact,
)
from t2twin.translate.models.presets import Preset
from t2twin.translate.networks.field_net import (
    CONTACT,
    SCALE,
    SHEAR,
    ContactOutputs,
    FieldNet,
    FieldOutputs,
)
from t2twin.translate.uncertainty.calibration import (
    SAME_FRAME,
    Errors,
    calibrated,
    fit_calibration,
    fit_scale,
    negative_log_likelihood,
    part_of,
    scaled,
    standard_deviation,
)

# Weights of losses, 1 unless given (assumed). Without absolute errors the network predicts up to
# 100 counts where nothing touches
WEIGHTS = {"field_absolute": 0.1, "force": 0.3, "contact_mask": 0.3}
# Absolute error below which it is rounded off, standard deviations of the dense counts (assumed)
ROUNDING = 0.01
# Added to a force before its logarithm is taken, N (assumed: less than the lightest presses)
FORCE_OFFSET_N = 0.1
# Shear force below which its error is not relative to it, N (assumed: as in evaluations)
MIN_RELATIVE_SHEAR_N = 0.3
# Learning rate of the layers of shear force and contact, divided by the preset's (assumed: they
# are new after a warm start, whose learning rate is lower)
NEW_RATE_SHARE = 5.0
# Share of the training pairs whose background frame is replaced by the dataset's mean frame
# (assumed), so that the network also works without a background frame
MEAN_FRAME_SHARE = 0.35
MIN_SHEAR_SCALE_N = 1e-3  # Least scale of the shear force (assumed), for presses that stay still
MEAN_FRAME_IMAGES = 2000  # Averaged if the pairs have no background frames (assumed)
# Minimum number of validation presses of random shapes for a calibration mostly on these (assumed)
MIN_RANDOM_PRESSES = 500
OTHER_PRESSES = 1 / 3  # Share of other presses in that calibration, relative to these (assumed)
# Presses of a dataset that the limits of contact are set on, at most (assumed: quantiles of half a
# percent need some hundreds)
LIMIT_PRESSES = 400
BATCH_SIZE = 64  # Images in one batch of prediction; bounds memory
FEATURES = "frame_features"  # Name of the features for the frame check among the predictions


def training_losses(
    network: FieldNet, outputs: FieldOutputs, targets: Examples, full_scale: float
) -> dict[str, torch.Tensor]:
    """The losses of a batch by name: of errors divided by their scales, or in nats."""
    device = outputs.mean.device
    assert targets.dense_counts is not None and targets.force_n is not None
    error = outputs.mean - targets.dense_counts.to(device) / full_scale
    relative = error / network.field_variance.sqrt()
    losses = {
        "field": relative.square().mean(),
        "field_absolute": (relative.square() + ROUNDING**2).sqrt().mean(),
        "spread": negative_log_likelihood(error.detach(), outputs.log_spread).mean(),
    }
    if network.predicts_force:
        error = outputs.force - _force_target(network, targets.force_n.to(device))
        likelihood = negative_log_likelihood(error.detach(), outputs.force_log_spread)
        losses |= {"force": error.square().mean(), "force_spread": likelihood.mean()}
    if outputs.shear is not None and outputs.shear_log_spread is not None:
        assert targets.shear_n is not None
        shear_n = targets.shear_n.to(device)
        error, log_spread = outputs.shear - shear_n / network.shear_scale, outputs.shear_log_spread
        losses["shear"] = negative_log_likelihood(error, log_spread.detach()).mean()
        likelihood = negative_log_likelihood(error.detach(), log_spread).mean(dim=1)
        moving = shear_n.any(dim=1).float()  # without markers, others have no error
        losses["shear_spread"] = likelihood @ moving / moving.sum().clamp(min=1.0)
    if outputs.contact is not None:
        assert targets.contact is not None
        losses |= contact_losses(network, outputs.contact, targets.contact.to(device))
    return losses


def log_force(force_n: torch.Tensor) -> torch.Tensor:
    """The shifted logarithm of forces, N, the target of training."""
    return torch.log(force_n + FORCE_OFFSET_N)


def _force_target(network: FieldNet, force_n: torch.Tensor) -> torch.Tensor:
    """The standardized logarithm of forces."""
    mean, std = network.force_scale
    return (log_force(force_n) - mean) / std.clamp(min=1e-3)


class FieldTranslator(Translator):
    """One network of images, (B, 3, S, S), or with background frames, (B, 6, S, S)."""

    predictor: FieldNet
    learns_dense_counts = reads_any_layout = True

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

    def make_optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """See Translator."""
        network, found = self.network, {}
        heads = {SHEAR: network.predicts_shear and not self.is_contact_alone}
        heads[CONTACT] = network.predicts_contact
        for name, is_trained in heads.items():
            if is_trained:
                weights = getattr(network, name).parameters()
                found[name] = adamw(weights, self.preset, NEW_RATE_SHARE)
        if self.is_contact_alone:
            return found
        others = (SHEAR, CONTACT, SCALE)
        own = [each for name, each in network.named_parameters() if not name.startswith(others)]
        return {"field": adamw(own, self.preset)} | found

    def prepare(self, pairs: Pairs) -> None:
        """Sets the mean frame, and the scales of the outputs if loaded weights lack them."""
        network = self.network
        if network.predicts_contact and not network.contact_scale.any():
            assert pairs.contact is not None
            network.contact_scale.copy_(contact_scale(pairs.contact))
        if not self.is_contact_alone:
            self._prepare_field(pairs)
        for name, values in network.named_buffers():  # the same in the weight average
            self.predictor.get_buffer(name).copy_(values)

    def _prepare_field(self, pairs: Pairs) -> None:
        network, frames = self.network, pairs.backgrounds
        if frames is None:
            frame = pairs.images[:MEAN_FRAME_IMAGES].mean(axis=0, dtype=np.float32)
        else:
            frame = frames.mean()
        network.mean_frame.copy_(to_input(frame[None] / WHITE_GREY)[0])
        if not network.field_mean.any():
            assert pairs.dense_counts is not None
            field = pairs.dense_counts / np.float32(self.full_scale)
            network.field_mean.copy_(torch.from_numpy(field.mean(axis=0)))
            network.field_variance.fill_(float(field.var(axis=0).mean()))
        if not network.predicts_force:
            forces = log_force(torch.tensor(pairs.force_n))
            network.force_scale.copy_(torch.stack([forces.mean(), forces.std(correction=0)]))
        if network.predicts_shear and not network.shear_scale:
            assert pairs.shear_n is not None
            rms_n = float(np.sqrt(np.square(pairs.shear_n).mean()))
            network.shear_scale.fill_(max(rms_n, MIN_SHEAR_SCALE_N))

    def optimize(self, examples: Examples) -> dict[str, torch.Tensor]:
        """One step on the errors of all outputs and the likelihoods of their spreads."""
        network, images = self.network, self._training_input(examples.images).to(self.device)
        if self.is_contact_alone:
            assert examples.contact is not None
            network.eval()
            network.contact.train()
            with self.precision():
                contact = network.contact_outputs(images)
            losses = contact_losses(network, contact, examples.contact.to(self.device))
        else:
            with self.precision():
                outputs = network(images, network.predicts_contact)
            losses = training_losses(network, outputs, examples, self.full_scale)
        weighted = [WEIGHTS.get(name, 1.0) * each for name, each in losses.items()]
        self.descend(torch.stack(weighted).sum(), network, *self.optimizers)
        return {name: each.detach() for name, each in losses.items()}

    def predict_all(
        self, images: torch.Tensor, with_contact: bool = False, with_features: bool = False
    ) -> Outputs:
        """See Translator."""
        inputs = self._with_frame(images)
        outputs = self.evaluate(self.predictor, inputs, with_contact, with_features)
        has_frame = torch.tensor(images.shape[1] > COLORS, device=self.device)
        with torch.inference_mode():
            return self.read(outputs, has_frame)

    def read(self, outputs: FieldOutputs, has_frame: torch.Tensor | None = None) -> Outputs:
        """The calibrated predictions: values and standard deviations.

        has_frame: () bool, whether images have background frames, for the contact.
        """
        network, full_scale = self.predictor, self.full_scale
        dense_counts = (outputs.mean * full_scale).clamp(0.0, full_scale)
        std = standard_deviation(outputs.log_spread, network.place_knots, network.press_knots)
        dense_counts_std = full_scale * std
        reading, factor = self._reading, self._factor
        # A taxel averages several places, whose errors are correlated.
        parts = (dense_counts_std[:, None, :] * reading) @ factor
        found = {
            "counts": (dense_counts @ reading.T).clamp(0.0, full_scale),
            "counts_std": parts.square().sum(dim=2).sqrt(),
            "dense_counts": dense_counts,
            "dense_counts_std": dense_counts_std,
        }
        if self._has_force:
            mean, scale = network.force_scale[0], network.force_scale[1]  # a trace cannot iterate
            shifted = torch.exp(outputs.force * scale + mean)
            spread = calibrated(outputs.force_log_spread, network.force_knots) * scale
            found["force_n"] = (shifted - FORCE_OFFSET_N).clamp(min=0.0)
            found["force_std_n"] = shifted * spread
        if outputs.shear is not None and outputs.shear_log_spread is not None:
            found["shear_n"] = network.shear_scale * outputs.shear
            spread = calibrated(outputs.shear_log_spread, network.shear_knots)
            found["shear_std_n"] = network.shear_scale * spread
        if outputs.features is not None:
            found[FEATURES] = outputs.features
        if outputs.contact is not None:
            assert has_frame is not None
            view_mm = self.info.camera.view_mm
            found |= read_contact(network, outputs.contact, has_frame, view_mm)
        return found

    @cached_property
    def _has_force(self) -> bool:
        return self.predictor.predicts_force

    @cached_property
    def _reading(self) -> torch.Tensor:
        """(N, F): maps dense counts to the counts of the layout."""
        array = self.info.array
        assert array.dense is not None
        matrix = reading_matrix(array.dense, self.layout, array.elastomer)
        return torch.from_numpy(matrix).float().to(self.device)

    @cached_property
    def _factor(self) -> torch.Tensor:
        """(F, F): Cholesky factor of the correlation."""
        correlation = self.predictor.correlation
        return torch.linalg.cholesky(correlation.cpu().double()).float().to(correlation.device)

    def _forget(self, *names: str) -> None:
        for name in names:
            vars(self).pop(name, None)

    def sample(
        self, dense_counts: torch.Tensor, std: torch.Tensor, number: int, seed: int
    ) -> torch.Tensor:
        """(B, number, F) fields sampled from predicted distributions, (B, F), counts."""
        generator = torch.Generator().manual_seed(seed)
        shape = (dense_counts.shape[0], number, dense_counts.shape[1])
        normal = torch.randn(shape, generator=generator).to(dense_counts.device)
        deviation = std[:, None] * (normal @ self._factor.T)
        return (dense_counts[:, None] + deviation).clamp(0.0, self.full_scale)

    def frame_features(self, images: torch.Tensor) -> torch.Tensor:
        """(B, n) features for the frame check, by the encoder alone."""
        network = self.predictor
        return self.evaluate(
            lambda inputs: network.frame_features(network.encoded(inputs)), self._with_frame(images)
        )

    def contact_outputs(self, images: torch.Tensor) -> ContactOutputs:
        """The outputs of the contact's layers."""
        return self.evaluate(self.predictor.contact_outputs, self._with_frame(images))

    def tactile_images(self, found: Outputs) -> Outputs:
        """See Translator: those of the dense counts, zero outside their places' convex hull."""
        return {TACTILE_IMAGES: self.dense_image(found["dense_counts"])}

    def dense_image(self, field: torch.Tensor) -> torch.Tensor:
        """(B, R, C): interpolation of values at the places of the dense counts, (B, F)."""
        device = field.device
        first, second, third = (
            field.index_select(1, places.to(device)) * weights.to(device)
            for places, weights in self._triangles
        )
        return (first + second + third).unflatten(1, self.info.array.tactile_image[:2])

    @cached_property
    def _triangles(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        """Three places whose interpolation is each pixel of a tactile image, and their weights."""
        rows, columns, px_per_mm = self.info.array.tactile_image
        columns_mm, rows_mm = (
            (np.arange(size) + 0.5) / px_per_mm - size / px_per_mm / 2 for size in (columns, rows)
        )
        centers = np.stack(np.meshgrid(columns_mm, rows_mm), axis=-1).reshape(-1, 2)
        matrix = barycentric(np.column_stack(self.places_mm), centers)
        inside = np.diff(matrix.indptr) == 3
        corners, weights = np.zeros((3, len(centers)), np.int64), np.zeros((3, len(centers)))
        corners[:, inside] = matrix.indices.reshape(-1, 3).T
        weights[:, inside] = matrix.data.reshape(-1, 3).clip(0.0, 1.0).T
        both = zip(corners, weights.astype(np.float32), strict=True)
        return [(torch.from_numpy(place), torch.from_numpy(weight)) for place, weight in both]

    def calibrate(self, *sets: Pairs) -> None:
        """See Translator: sets the knots and the correlation of the predictor."""
        network, chosen = self.predictor, [_mostly_new_shapes(pairs) for pairs in sets]
        if network.predicts_contact:
            parts = [each for pairs in chosen for each in self._contacts_on(pairs)]
            fit_contact_knots(network, self.info.camera.view_mm, parts)
            fit_contact_limits(network, *self._largest_logits(sets))
        if self.is_contact_alone:
            return
        network.scale.reset()
        errors = [self._errors_on(pairs) for pairs in chosen]
        plain = [replace(pairs, backgrounds=None, shear_n=None) for pairs in chosen
                 if pairs.backgrounds is not None]  # fmt: skip
        errors += [self._errors_on(pairs) for pairs in plain]
        fit_scale(network.scale, [part_of(each, held_out=False) for each in errors])
        held_out = (part_of(each, held_out=True) for each in errors)
        found = fit_calibration([scaled(network.scale, each) for each in held_out])
        for name, values in found.items():
            getattr(network, name).copy_(values)
        self._forget("_factor", "_has_force")

    def shear_error(self, pairs: Pairs) -> float | None:
        """See Translator. The geometric mean counts touches with and without markers alike."""
        if pairs.shear_n is None or not pairs.shear_n.any() or not self.predictor.predicts_shear:
            return None
        logs = []
        for part, _, outputs in self._outputs_on(pairs):
            shear_n = self._tensor(pairs.shear_n[part])
            assert outputs.shear is not None
            error = outputs.shear * self.predictor.shear_scale - shear_n
            size = shear_n.square().sum(dim=1) + MIN_RELATIVE_SHEAR_N**2
            relative = error.square().sum(dim=1) / size
            logs.append(relative[shear_n.any(dim=1)].log())
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
        for part in _parts(len(pairs)):
            yield (
                self.contact_outputs(_input(pairs.inputs[part])),
                self._tensor(pairs.contact[part]),
            )

    def _tensor(self, values: np.ndarray) -> torch.Tensor:
        return torch.from_numpy(values.astype(np.float32)).to(self.device)

    def _largest_logits(
        self, sets: Sequence[Pairs]
    ) -> tuple[list[torch.Tensor], list[torch.Tensor]]:
        """Largest logits of pairs without and with a contact, as for `fit_contact_limits`."""
        without_contact, with_contact = [torch.empty(0)] * 2, [torch.empty(0)] * 2
        for pairs in sets:
            if pairs.contact is None:
                continue
            some = np.flatnonzero(pairs.force_n > 0)
            some = some[:: -(-len(some) // LIMIT_PRESSES) or 1]
            some = some[(pairs.contact[some][:, 1] > CONTACT_KPA).any(axis=(1, 2))]
            none = np.flatnonzero(pairs.force_n == 0)
            for found, rows in ((without_contact, none), (with_contact, some)):
                pixels = pairs.inputs[rows]
                for mode, inputs in enumerate((pixels[..., :COLORS], pixels)):
                    found[mode] = torch.cat([found[mode], self._largest_logit(inputs)])
                if found is with_contact and pixels.shape[-1] > COLORS:
                    frames = self._largest_logit(pixels[..., COLORS:])
                    without_contact[0] = torch.cat([without_contact[0], frames])
        return without_contact, with_contact

    def _largest_logit(self, pixels: np.ndarray) -> torch.Tensor:
        """(B,) largest logit of contact of pixels, (B, S, S, c) uint8."""
        inputs = (_input(pixels[part]) for part in _parts(len(pixels)))
        found = [self.contact_outputs(each).logit.amax(dim=(1, 2)).cpu() for each in inputs]
        return torch.cat([torch.empty(0), *found])

    def read_at(self, layout: Layout) -> Self:
        """See Translator. Takes any layout on the cover, with its pad sizes."""
        other = copy(self)
        other.layout = layout
        other._forget("_reading")
        _ = other._reading  # raises for taxels outside the cover
        return other

    def as_module(self) -> FromPixels:
        """See Translator. It also takes a background frame, (1, 3, S, S)."""
        return _FieldFromPixels(self._on_cpu())

    def _on_cpu(self) -> Self:
        other = super()._on_cpu()
        other._forget("_reading", "_factor")
        return other

    def _errors_on(self, pairs: Pairs) -> Errors:
        assert pairs.dense_counts is not None
        parts, network = [], self.predictor
        for part, inputs, outputs in self._outputs_on(pairs):
            dense_counts = self._tensor(pairs.dense_counts[part])
            error = dense_counts / self.full_scale - outputs.mean.clamp(0.0, 1.0)
            force_error = _force_target(network, self._tensor(pairs.force_n[part])) - outputs.force
            spreads = outputs.log_spread.exp(), outputs.force_log_spread.exp()
            features = network.scale.features(inputs, network.mean_frame, *outputs[:4])
            values = [error, spreads[0], force_error, spreads[1], *features]
            if pairs.shear_n is not None and outputs.shear is not None:
                assert outputs.shear_log_spread is not None
                shear = self._tensor(pairs.shear_n[part])
                moving = shear.any(dim=1)  # others have errors near zero without markers
                values.append((shear / network.shear_scale - outputs.shear)[moving])
                values.append(outputs.shear_log_spread[moving].exp())
            parts.append(values)
        return Errors(*(torch.cat(part).cpu() for part in zip(*parts, strict=True)))

    def _outputs_on(self, pairs: Pairs) -> Iterator[tuple[slice, torch.Tensor, FieldOutputs]]:
        """The inputs, each with its background frame, and the outputs for pairs, batch by batch."""
        for part in _parts(len(pairs)):
            inputs = self._with_frame(_input(pairs.inputs[part]))
            yield part, inputs, self.outputs(inputs)

    def outputs(self, inputs: torch.Tensor) -> FieldOutputs:
        """See Translator."""
        return super().outputs(self._with_frame(inputs))

    def _with_frame(self, inputs: torch.Tensor) -> torch.Tensor:
        """(B, 6, S, S): images, each with a background frame, by default the mean frame."""
        images = inputs.to(self.device)
        if images.shape[1] == COLORS:
            images = torch.cat([images, self.predictor.mean_frame.expand_as(images)], dim=1)
        return images

    def _training_input(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 6, S, S): images with background frames, a share of them the mean frame."""
        image, mean_frame = images[:, :COLORS], self.network.mean_frame.to(images.device)
        if images.shape[1] == COLORS:
            frame = mean_frame.expand_as(image)
        else:
            replaced = torch.rand(images.shape[0], 1, 1, 1) < MEAN_FRAME_SHARE
            frame = torch.where(replaced.to(images.device), mean_frame, images[:, COLORS:])
        both = torch.cat([image, frame], dim=1)
        return both.contiguous(memory_format=torch.channels_last)


class _FieldFromPixels(FromPixels):
    """From pixels and a background frame, (1, 3, S, S), both in [0, 1]."""

    translator: FieldTranslator
    network: FieldNet

    @property
    def mean_frame(self) -> torch.Tensor:
        """(1, 3, S, S) in [0, 1]: the dataset's mean background frame."""
        return (self.network.mean_frame * self.std + self.mean)[None]

    def forward(self, pixels: torch.Tensor, background: torch.Tensor) -> tuple[torch.Tensor, ...]:
        both = [(each - self.mean) / self.std for each in (pixels, background.expand_as(pixels))]
        network = self.network
        outputs = network(torch.cat(both, dim=1), network.predicts_contact, True)
        is_own = (both[1] - network.mean_frame).abs().amax() > SAME_FRAME
        return self.in_order(self.translator.read(outputs, is_own))


def _parts(number: int) -> list[slice]:
    return [slice(start, start + BATCH_SIZE) for start in range(0, number, BATCH_SIZE)]


def _input(pixels: np.ndarray) -> torch.Tensor:
    """The network's input of (B, S, S, c) uint8."""
    return to_input(pixels.astype(np.float32) / WHITE_GREY)


def _mostly_new_shapes(pairs: Pairs) -> Pairs:
    """The presses of random shapes and a third as many others, or all if few are random."""
    is_random = pairs.families == RANDOM_FAMILY
    others = np.flatnonzero(~is_random)
    if is_random.sum() < MIN_RANDOM_PRESSES:
        return pairs
    number = min(len(others), int(is_random.sum() * OTHER_PRESSES))
    others = np.random.default_rng(0).choice(others, number, replace=False)
    return pairs.subset(np.sort(np.append(np.flatnonzero(is_random), others)))
