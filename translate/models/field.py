"""field: from the image to the dense counts over the whole cover, force, shear and contact.

Each output has a mean and a spread. The spread has layers of its own and is trained on Student's
likelihood of the detached residual, so that it does not change the mean (Seitzer et al. 2022). The
calibration follows on validation presses (uncertainty.calibration). Shear and contact have layers
and optimizers of their own. The shear's mean is trained on the likelihood at the predicted spread.
Without markers it is unknown, and squared errors of such touches would dominate (median magnitude
0.67 of the true one, measured).

Shape letters: B batch, S image side, N taxels, F places of the dense counts, R rows and C columns
of a tactile image, H side of the contact maps.
"""

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Self

import numpy as np
import torch
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.columns import RANDOM_FAMILY
from t2twin.sim.taxels.layout import Layout
from t2twin.sim.taxels.pads import reading_matrix
from t2twin.sim.taxels.phi import barycentric
from t2twin.translate.data.images import COLORS, WHITE_GREY, to_input
from t2twin.translate.data.pairs import DataInfo, Examples, ImageFile, Pairs
from t2twin.translate.models.base import FEATURES, TACTILE_IMAGES, Outputs, Translator, adamw
from t2twin.translate.models.field_net import CONTACT, KNOTS, SCALE, SHEAR, FieldNet
from t2twin.translate.models.presets import Preset
from t2twin.translate.uncertainty.calibration import (
    MIN_ERRORS,
    Errors,
    calibrated,
    fit_calibration,
    fit_knots,
    fit_scale,
    identity_knots,
    negative_log_likelihood,
    part_of,
    scaled,
    standard_deviation,
)

# Weights of losses, 1 unless given (assumed). Without absolute errors the network predicts up to
# 100 counts where nothing touches
WEIGHTS = {"field_absolute": 0.1, "force": 0.3, "contact_mask": 0.3}
ROUNDING = 0.01  # Absolute errors below it are rounded off, standard deviations (assumed)
FORCE_OFFSET_N = 0.1  # Added before the logarithm (assumed: less than the lightest presses)
MIN_RELATIVE_SHEAR_N = 0.3  # Errors of smaller ones are not relative (assumed, as in evaluations)
# Learning rate of the layers of shear force and contact, divided by the preset's (assumed: they
# are new after a warm start, whose learning rate is lower)
NEW_RATE_SHARE = 5.0
# Share of the training pairs that have the mean background frame in place of their own (assumed)
MEAN_FRAME_SHARE = 0.35
MIN_SHEAR_SCALE_N = 1e-3  # Least scale of the shear force (assumed), for presses that stay still
MEAN_FRAME_IMAGES = 2000  # Averaged if the pairs have no background frames (assumed)
MIN_RANDOM_PRESSES = 500  # Of random shapes, for a calibration mostly on these (assumed)
OTHER_PRESSES = 1 / 3  # Share of other presses in that calibration, relative to these (assumed)
# Presses of a dataset that the limits of contact are set on, at most (assumed: quantiles of half a
# percent need some hundreds)
LIMIT_PRESSES = 400
CONTACT_KPA = 5.0  # Pressure of a cell in contact (assumed: a hundredth of a gel's modulus)
IN_CONTACT_WEIGHT = 4.0  # Of errors in the contact (assumed: it is about a tenth of the view)
SQUARED_WEIGHT = 0.3  # Weight of squared errors relative to absolute errors (assumed)
CONTACT_ROUNDING = 0.03  # As ROUNDING, fraction of the scale (assumed)
MIN_SCALES = (0.01, 1.0)  # Of depth, mm, and pressure, kPa (assumed), for presses without contact
# Share of the images without contact that show one, and limit on the share of those with a contact
# in which it is missed (assumed)
FALSE_SHARE, MISSED_SHARE = 0.01, 0.005
MIN_WITHOUT_CONTACT = 20  # Minimum number of held-out images that a limit is set on (assumed)
SCALE_PRESSES = 2000  # Presses that the scales are measured on
EVEN = 0.5  # Probability from which a cell is in contact
MAPS = ("depth_mm", "depth_std_mm", "pressure_kpa", "pressure_std_kpa", "probability")
CENTER = ("center_mm", "center_std_mm")  # Names of the predictions, see `read_contact`
BATCH_SIZE = 64  # Images in one batch of prediction; bounds memory


class FieldTranslator(Translator):
    """One network of images, (B, 3, S, S), or with background frames, (B, 6, S, S)."""

    predictor: FieldNet
    reads_any_layout = True

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

    @cached_property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        network, found = self.network, {}
        if not self.is_contact_alone:
            others = (SHEAR, CONTACT, SCALE)
            own = [each for name, each in network.named_parameters() if not name.startswith(others)]
            found["field"] = adamw(own, self.preset)
            if network.predicts_shear:
                found[SHEAR] = adamw(network.shear.parameters(), self.preset, NEW_RATE_SHARE)
        if network.predicts_contact:
            found[CONTACT] = adamw(network.contact.parameters(), self.preset, NEW_RATE_SHARE)
        return found

    def prepare(self, pairs: Pairs) -> None:
        """Sets the mean frame, and the scales of the outputs if loaded weights lack them."""
        network, frames = self.network, pairs.backgrounds
        if network.predicts_contact and not network.contact_scale.any():
            assert pairs.contact is not None
            network.contact_scale.copy_(contact_scale(pairs.contact))
        if not self.is_contact_alone:
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
                forces = torch.log(torch.tensor(pairs.force_n) + FORCE_OFFSET_N)
                network.force_scale.copy_(torch.stack([forces.mean(), forces.std(correction=0)]))
            if network.predicts_shear and not network.shear_scale:
                assert pairs.shear_n is not None
                rms_n = float(np.sqrt(np.square(pairs.shear_n).mean()))
                network.shear_scale.fill_(max(rms_n, MIN_SHEAR_SCALE_N))
        for name, values in network.named_buffers():  # the same in the weight average
            self.predictor.get_buffer(name).copy_(values)

    def step(self, examples: Examples) -> Outputs:
        """One step on the errors of all outputs and the likelihoods of their spreads."""
        network, images = self.network, examples.images
        if self.is_contact_alone:
            network.eval().requires_grad_(False).contact.train().requires_grad_(True)
        image, frame = images[:, :COLORS], network.mean_frame.expand_as(images[:, :COLORS])
        if images.shape[1] > COLORS:
            replaced = torch.rand(len(images), 1, 1, 1) < MEAN_FRAME_SHARE
            frame = torch.where(replaced.to(images.device), frame, images[:, COLORS:])
        inputs = torch.cat([image, frame], dim=1).contiguous(memory_format=torch.channels_last)
        with self.precision():
            outputs = network(inputs, network.predicts_contact)
        losses = {} if self.is_contact_alone else self._losses(outputs, examples)
        if network.predicts_contact:
            assert examples.contact is not None
            losses |= contact_losses(network, outputs, examples.contact)
        weighted = [WEIGHTS.get(name, 1.0) * each for name, each in losses.items()]
        self.descend(torch.stack(weighted).sum(), network, *self.optimizers)
        return {name: each.detach() for name, each in losses.items()}

    def _errors(self, outputs: Outputs, examples: Examples) -> Outputs:
        """Outputs minus targets, but for those of the contact. The predictor has the same scales as
        the trained network."""
        network = self.predictor
        assert examples.dense_counts is not None and examples.force_n is not None
        mean, std = network.force_scale
        forces = torch.log(examples.force_n + FORCE_OFFSET_N)
        found = {
            "field": outputs["field"] - examples.dense_counts / self.full_scale,
            "force": outputs["force"] - (forces - mean) / std.clamp(min=1e-3),
        }
        if "shear" in outputs and examples.shear_n is not None:
            found["shear"] = outputs["shear"] - examples.shear_n / network.shear_scale
        return found

    def _losses(self, outputs: Outputs, examples: Examples) -> Outputs:
        """The losses of a batch by name: of errors divided by their scales, or in nats."""
        errors = self._errors(outputs, examples)
        likelihoods = {
            name: negative_log_likelihood(each.detach(), outputs[f"{name}_spread"])
            for name, each in errors.items()
        }
        relative = errors["field"] / self.predictor.field_variance.sqrt()
        losses = {
            "field": relative.square().mean(),
            "field_absolute": (relative.square() + ROUNDING**2).sqrt().mean(),
            "spread": likelihoods["field"].mean(),
        }
        if self.predictor.predicts_force:
            losses["force"] = errors["force"].square().mean()
            losses["force_spread"] = likelihoods["force"].mean()
        if "shear" in errors:
            assert examples.shear_n is not None
            spread = outputs["shear_spread"].detach()
            losses["shear"] = negative_log_likelihood(errors["shear"], spread).mean()
            moving = examples.shear_n.any(dim=1).float()  # without markers, others have no error
            likelihood = likelihoods["shear"].mean(dim=1)
            losses["shear_spread"] = likelihood @ moving / moving.sum().clamp(min=1.0)
        return losses

    def outputs(self, inputs: torch.Tensor, *wanted: bool) -> Outputs:
        self.predictor.eval()
        with torch.inference_mode(), self.precision():
            return self.predictor(self._with_frame(inputs), *wanted)

    def traced(self, *inputs: torch.Tensor) -> Outputs:
        network = self.predictor
        return self.read(network(torch.cat(inputs, dim=1), network.predicts_contact, True))

    def read(self, outputs: Outputs) -> Outputs:
        """See Translator: the calibrated values and their standard deviations."""
        network, full_scale = self.predictor, self.full_scale
        dense_counts = (outputs["field"] * full_scale).clamp(0.0, full_scale)
        knots = network.place_knots, network.press_knots
        dense_counts_std = full_scale * standard_deviation(outputs["field_spread"], *knots)
        # A taxel averages several places, whose errors are correlated.
        reading, factor = (each.to(dense_counts.device) for each in (self._reading, self._factor))
        parts = (dense_counts_std[:, None, :] * reading) @ factor
        found = {
            "counts": (dense_counts @ reading.T).clamp(0.0, full_scale),
            "counts_std": parts.square().sum(dim=2).sqrt(),
            "dense_counts": dense_counts,
            "dense_counts_std": dense_counts_std,
        }
        if network.predicts_force:
            mean, scale = network.force_scale[0], network.force_scale[1]  # a trace cannot iterate
            shifted = torch.exp(outputs["force"] * scale + mean)
            found["force_n"] = (shifted - FORCE_OFFSET_N).clamp(min=0.0)
            spread = calibrated(outputs["force_spread"], network.force_knots) * scale
            found["force_std_n"] = shifted * spread
        if network.predicts_shear:
            found["shear_n"] = network.shear_scale * outputs["shear"]
            spread = calibrated(outputs["shear_spread"], network.shear_knots)
            found["shear_std_n"] = network.shear_scale * spread
        if "features" in outputs:
            found[FEATURES] = outputs["features"]
        if "contact" in outputs:
            found |= read_contact(network, outputs, self.info.camera.view_mm)
        return found

    @cached_property
    def _reading(self) -> torch.Tensor:
        """(N, F): maps dense counts to the counts of the layout."""
        array = self.info.array
        assert array.dense is not None
        matrix = reading_matrix(array.dense, self.layout, array.cover)
        return torch.from_numpy(matrix).float()

    @cached_property
    def _factor(self) -> torch.Tensor:
        """(F, F): Cholesky factor of the correlation."""
        return torch.linalg.cholesky(self.predictor.correlation.cpu().double()).float()

    def sample(
        self, dense_counts: torch.Tensor, std: torch.Tensor, number: int, seed: int
    ) -> torch.Tensor:
        """(B, number, F) fields sampled from predicted distributions, (B, F), counts."""
        generator = torch.Generator().manual_seed(seed)
        shape = (dense_counts.shape[0], number, dense_counts.shape[1])
        normal = torch.randn(shape, generator=generator).to(dense_counts.device)
        deviation = std[:, None] * (normal @ self._factor.T.to(std.device))
        return (dense_counts[:, None] + deviation).clamp(0.0, self.full_scale)

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
            with_maps = [pairs for pairs in chosen if pairs.contact is not None]
            batches = (each for pairs in with_maps for each in self._outputs_on(pairs, True))
            parts = ((out, each.contact) for each, out in batches if each.contact is not None)
            fit_contact_knots(network, self.info.camera.view_mm, parts)
            self._fit_contact_limits(sets)
        if self.is_contact_alone:
            return
        network.scale.reset()
        plain = [replace(pairs, backgrounds=None, shear_n=None) for pairs in chosen
                 if pairs.backgrounds is not None]  # fmt: skip
        errors = [self._errors_on(pairs) for pairs in (*chosen, *plain)]
        fit_scale(network.scale, [part_of(each, held_out=False) for each in errors])
        held_out = (part_of(each, held_out=True) for each in errors)
        found = fit_calibration([scaled(network.scale, each) for each in held_out])
        for name, values in found.items():
            getattr(network, name).copy_(values)
        vars(self).pop("_factor", None)

    def further_errors(self, pairs: Pairs) -> dict[str, float]:
        """See Translator: the geometric mean of the relative error of the shear force of touches
        that have moved. Also the mean over the presses of the RMSE of the depth in the contact."""
        network = self.predictor
        has_shear = network.predicts_shear and pairs.shear_n is not None and pairs.shear_n.any()
        has_contact = network.predicts_contact and pairs.contact is not None
        shear_logs, depths_mm, found = [], [], {}
        for examples, outputs in self._outputs_on(pairs, has_contact):
            if has_shear and examples.shear_n is not None:
                error = outputs["shear"] * network.shear_scale - examples.shear_n
                size = examples.shear_n.square().sum(dim=1) + MIN_RELATIVE_SHEAR_N**2
                relative = error.square().sum(dim=1) / size
                shear_logs.append(relative[examples.shear_n.any(dim=1)].log())
            if has_contact and examples.contact is not None:
                true_mm, pressure = examples.contact.unbind(dim=1)
                inside = pressure > CONTACT_KPA
                error = outputs["depth"] * network.contact_scale[0] - true_mm
                squares, cells = (error.square() * inside).sum(dim=(1, 2)), inside.sum(dim=(1, 2))
                depths_mm.append((squares[cells > 0] / cells[cells > 0]).sqrt())
        if has_shear:  # counts touches with and without markers alike
            found["val_shear_error"] = float(torch.cat(shear_logs).mean().div(2.0).exp())
        if has_contact:
            found["val_contact_error_mm"] = float(torch.cat(depths_mm).mean())
        return found

    def _fit_contact_limits(self, sets: Sequence[Pairs]) -> None:
        """Sets the limits of contact from pairs without and with a contact."""

        def largest(pairs: Pairs) -> torch.Tensor:
            logits = (outputs["contact"] for _, outputs in self._outputs_on(pairs, True))
            return torch.cat([torch.empty(0), *(each.amax(dim=(1, 2)).cpu() for each in logits)])

        without_contact, with_contact = ([[torch.empty(0)], [torch.empty(0)]] for _ in range(2))
        for pairs in sets:
            if pairs.contact is None:
                continue
            some = np.flatnonzero(pairs.force_n > 0)
            some = some[:: -(-len(some) // LIMIT_PRESSES) or 1]
            some = some[(pairs.contact[some][:, 1] > CONTACT_KPA).any(axis=(1, 2))]
            none = np.flatnonzero(pairs.force_n == 0)
            for found, rows in ((without_contact, none), (with_contact, some)):
                part = pairs.subset(rows)
                for mode, each in enumerate((replace(part, backgrounds=None), part)):
                    found[mode].append(largest(each))
                if found is with_contact and part.backgrounds is not None:
                    frames = replace(part, source=part.backgrounds, backgrounds=None)
                    without_contact[0].append(largest(frames))
        logits = ([torch.cat(each) for each in found] for found in (without_contact, with_contact))
        fit_contact_limits(self.predictor, *logits)

    def _errors_on(self, pairs: Pairs) -> Errors:
        """The errors of pairs, for the calibration."""
        parts = []
        for examples, outputs in self._outputs_on(pairs):
            outputs["field"] = outputs["field"].clamp(0.0, 1.0)
            errors = self._errors(outputs, examples)
            spreads = {name: outputs[f"{name}_spread"].exp() for name in errors}
            values = [each[name] for name in ("field", "force") for each in (errors, spreads)]
            values += self.predictor.scale_features(examples.images, outputs)
            if "shear" in errors:
                assert examples.shear_n is not None
                moving = examples.shear_n.any(dim=1)  # others have errors near zero without markers
                values += [errors["shear"][moving], spreads["shear"][moving]]
            parts.append(values)
        return Errors(*(torch.cat(part).cpu() for part in zip(*parts, strict=True)))

    def _outputs_on(
        self, pairs: Pairs, with_contact: bool = False
    ) -> Iterator[tuple[Examples, Outputs]]:
        """Pairs and their outputs, batch by batch."""
        for start in range(0, len(pairs), BATCH_SIZE):
            batch = np.arange(start, min(start + BATCH_SIZE, len(pairs)))
            examples = self.examples(pairs, batch)
            images = self._with_frame(examples.images)
            yield replace(examples, images=images), self.outputs(images, with_contact)

    def _with_frame(self, inputs: torch.Tensor) -> torch.Tensor:
        """(B, 6, S, S): images, each with a background frame, by default the mean frame."""
        images = inputs.to(self.device)
        if images.shape[1] > COLORS:
            return images
        return torch.cat([images, self.predictor.mean_frame.expand_as(images)], dim=1)

    def read_at(self, layout: Layout) -> Self:
        """See Translator. Takes any layout on the cover, with its pad sizes."""
        other = copy(self)
        other.layout = layout
        vars(other).pop("_reading", None)
        _ = other._reading  # raises for taxels outside the cover
        return other


def contact_scale(maps: ImageFile) -> torch.Tensor:
    """(2,) root mean squares of depth, mm, and pressure, kPa, in the contacts of training pairs."""
    depth, pressure = torch.from_numpy(maps[:SCALE_PRESSES]).float().unbind(dim=1)
    inside = pressure > CONTACT_KPA
    values = [each[inside].square().mean().sqrt().nan_to_num() for each in (depth, pressure)]
    return torch.stack(values).maximum(torch.tensor(MIN_SCALES))


def contact_errors(network: FieldNet, outputs: Outputs, maps: torch.Tensor) -> Outputs:
    """Outputs minus targets, of the scales. maps: (B, 2, H, H) depth, mm, and pressure, kPa."""
    scaled = zip(("depth", "pressure"), maps.unbind(dim=1), network.contact_scale, strict=True)
    return {name: outputs[name] - values / scale for name, values, scale in scaled}


def contact_losses(network: FieldNet, outputs: Outputs, maps: torch.Tensor) -> Outputs:
    """The losses of a batch by name. maps: as for `contact_errors`."""
    inside = (maps[:, 1] > CONTACT_KPA).float()
    weight = 1.0 + (IN_CONTACT_WEIGHT - 1.0) * inside
    weight = weight / weight.mean()
    losses = {}
    for name, error in contact_errors(network, outputs, maps).items():
        rounded = (error.square() + CONTACT_ROUNDING**2).sqrt() - CONTACT_ROUNDING
        losses[f"contact_{name}"] = (weight * (rounded + SQUARED_WEIGHT * error.square())).mean()
        likelihood = negative_log_likelihood(error.detach(), outputs[f"{name}_spread"])
        losses[f"contact_{name}_spread"] = likelihood.mean()
    losses["contact_mask"] = functional.binary_cross_entropy_with_logits(outputs["contact"], inside)
    return losses


def read_contact(network: FieldNet, outputs: Outputs, view_mm: tuple[float, float]) -> Outputs:
    """The calibrated predictions, by the names in MAPS, (B, H, H), and in CENTER, (B, 2).

    The pressure is 0 where the probability of contact is below one half. The center of pressure is
    from the middle of the view; not a number without contact. view_mm: half the width and height.
    """
    depth_std = calibrated(outputs["depth_spread"], network.contact_depth_knots)
    std = calibrated(outputs["pressure_spread"], network.contact_pressure_knots)
    largest = outputs["contact"].amax(dim=(1, 2), keepdim=True)
    probability = torch.sigmoid(outputs["contact"])
    has_contact = largest > outputs["contact_limit"]
    probability = torch.where(has_contact, probability, probability.clamp(max=EVEN))
    pressure = torch.where(probability > EVEN, outputs["pressure"].clamp(min=0.0), 0.0)
    center, spread = center_of_pressure(pressure, std, view_mm)
    center_std = calibrated(spread.log(), network.contact_center_knots)
    mm, kpa = network.contact_scale[0], network.contact_scale[1]  # a trace cannot iterate
    maps = (mm * outputs["depth"], mm * depth_std, kpa * pressure, kpa * std, probability)
    return dict(zip((*MAPS, *CENTER), (*maps, center, center_std), strict=True))


def fit_contact_limits(
    network: FieldNet, without_contact: Sequence[torch.Tensor], with_contact: Sequence[torch.Tensor]
) -> None:
    """Sets the limits of contact, so that hardly any image without contact shows one.

    Largest logits of held-out images, each without and with background frames.
    """
    for mode, (none, some) in enumerate(zip(without_contact, with_contact, strict=True)):
        limit = torch.zeros(())
        if min(len(none), len(some)) >= MIN_WITHOUT_CONTACT:
            limit = torch.minimum(
                torch.quantile(none, 1.0 - FALSE_SHARE), torch.quantile(some, MISSED_SHARE)
            )
        network.contact_limits[mode] = limit.clamp(min=0.0)


def center_of_pressure(
    pressure: torch.Tensor, std: torch.Tensor, view_mm: tuple[float, float]
) -> tuple[torch.Tensor, torch.Tensor]:
    """(B, 2) center of pressure, mm, and its standard deviation if errors are independent."""
    side = pressure.shape[-1]
    middles = (torch.arange(side, device=pressure.device) + 0.5) * 2.0 / side - 1.0
    total = pressure.sum(dim=(1, 2))
    total = torch.where(total > 0.0, total, torch.nan)
    centers, stds = [], []
    for half, axis in zip(view_mm, (1, 2), strict=True):  # summed over rows, then over columns
        at = half * middles
        center = (pressure.sum(dim=axis) @ at) / total
        squares = std.square().sum(dim=axis) * (at - center[:, None]).square()
        centers.append(center)
        stds.append(squares.sum(dim=1).sqrt() / total)
    return torch.stack(centers, dim=1), torch.stack(stds, dim=1)


def fit_contact_knots(
    network: FieldNet, view_mm: tuple[float, float], parts: Iterable[tuple[Outputs, torch.Tensor]]
) -> None:
    """Sets the knots of the contact from outputs and maps of held-out presses."""
    names = ("depth", "depth_spread", "pressure", "pressure_spread", "contact")
    parts = [({name: outputs[name] for name in names}, maps) for outputs, maps in parts]
    if not parts:
        return
    outputs = {name: torch.cat([each[name] for each, _ in parts]) for name in names}
    maps = torch.cat([each for _, each in parts])

    def fit(name: str, spread: torch.Tensor, error: torch.Tensor) -> None:
        key = f"contact_{name}_knots"
        knots = fit_knots(spread.double().cpu(), error.double().cpu(), KNOTS[key])
        getattr(network, key).copy_(knots)

    for name, error in contact_errors(network, outputs, maps).items():
        fit(name, outputs[f"{name}_spread"].exp(), error)
    network.contact_center_knots.copy_(identity_knots(len(KNOTS["contact_center_knots"])))
    found = read_contact(network, outputs | {"contact_limit": network.contact_limits[1]}, view_mm)
    true, _ = center_of_pressure(maps[:, 1], torch.zeros_like(maps[:, 1]), view_mm)
    error = found["center_mm"] - true
    known = error.isfinite().all(dim=1)
    if int(known.sum()) >= MIN_ERRORS:
        fit("center", found["center_std_mm"][known], error[known])


def _mostly_new_shapes(pairs: Pairs) -> Pairs:
    """The presses of random shapes and a third as many others, or all if few are random."""
    is_random = pairs.families == RANDOM_FAMILY
    others = np.flatnonzero(~is_random)
    if is_random.sum() < MIN_RANDOM_PRESSES:
        return pairs
    number = min(len(others), int(is_random.sum() * OTHER_PRESSES))
    others = np.random.default_rng(0).choice(others, number, replace=False)
    return pairs.subset(np.sort(np.append(np.flatnonzero(is_random), others)))
