"""From the image and the unit's background frame to the dense counts over the whole cover.

A ResNet18 encodes the image. Its last map, pooled to a vector, predicts a canvas over the whole
cover. Its finer maps are resampled onto the canvas where the view lies. A small decoder predicts
mean and spread from the two. It treats the places of the dense counts, in columns that are shifted
by half a place relative to their neighbors, as a grid.

A head predicts the shear force on the gel camera. A shear force displaces the markers on the
gel. On a layer of thickness h and shear modulus G, the integral of the displacement over the area
is F h / G (Hooke's law). This is exact for an unbounded layer on a rigid base. The head measures
the displacement relative to the background frame in windows of the image (Lucas and Kanade 1981).
The force is the sum of these displacements, with weights that a network predicts.

A small feature pyramid (Lin et al. 2017) predicts the contact in the view. It adds the encoder's
maps and fine maps of its own, from the coarsest to the finest, which has half the side of the
image. Its gradients train the encoder too, if both are trained together.

Shape letters: B batch, S image side, H side after a reduction, W windows along each side, F places,
D columns of E places, G numbers of the vector. F = D * E.
"""

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.translate.models.base import Outputs
from t2twin.translate.models.frame_check import convolution, features_of
from t2twin.translate.models.resnet18 import BasicBlock, ResNet18
from t2twin.translate.uncertainty.calibration import (
    PLACE_SHARES,
    PRESS_SHARES,
    SAME_FRAME,
    SpreadScale,
    identity_knots,
)

# Side of the images that displacements are measured on, pixels (assumed: most markers of sampled
# units are then 2 pixels wide). Larger images are reduced to less than twice that
IMAGE_SIDE = 96
# Reductions of these images. A displacement can be measured up to the radius of a marker, and
# after a reduction by 2 also where markers have merged to larger ones
SCALES = (1, 2)
# Distance of neighboring windows, and what a window extends beyond it on each side, pixels. The
# median errors of the plain sum of the displacements are 2.2 degrees and 11 %, with a margin of 8
# pixels 2.5 degrees and 13 % (measured on 210 touches of tools)
STEP, MARGIN = 8, 4
# Pixels on each side of a pixel whose mean is subtracted from it (assumed: more than a marker and
# less than the variation of the light)
BLUR = 10
# Mean squared gradient of a window that halves its displacement, in colors' variance per squared
# pixel (as measured for MARGIN; ten times as much is worse)
MIN_TEXTURE = 1e-4
MAX_DISPLACEMENT = 3.0  # Pixels of its scale (assumed: larger ones are errors)
WIDTH = 32  # Channels of the network that predicts the weights (assumed)


def averaged(maps: torch.Tensor, means: torch.Tensor) -> torch.Tensor:
    """(..., H, H) to (..., W, W): means over boxes, whose weights on a line are means, (W, H)."""
    lines = (maps @ means.T).transpose(-1, -2)  # one large product is fast
    return (lines @ means.T).transpose(-1, -2)


def box_means(side: int, step: int, margin: int) -> torch.Tensor:
    """(side // step, side): weights of the pixels of a line in the mean over each box.

    A box is a run of `step` pixels and `margin` more on both sides, as far as the line has them.
    """
    first = step * torch.arange(side // step)[:, None]
    pixel = torch.arange(side)
    inside = ((pixel >= first - margin) & (pixel < first + step + margin)).float()
    return inside / inside.sum(dim=1, keepdim=True)


def displacements(
    image: torch.Tensor, frame: torch.Tensor, means: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Displacement of each window of an image relative to a frame, by least squares.

    image, frame: (B, 1, H, H). means: (W, H), see `box_means`. Returns the displacement along x and
    y, (B, 2, W, W), pixels, and the root mean squares of the gradient along x and y and of the
    difference, (B, 3, W, W).
    """
    middle, difference = (image + frame) / 2, frame - image
    along_x = _gradient(middle)
    along_y = _gradient(middle.transpose(-1, -2)).transpose(-1, -2)
    each = torch.cat([along_x, along_y, difference], dim=1)
    mixed = each[:, [0, 0, 1]] * each[:, [1, 2, 2]]
    products = averaged(torch.cat([each * each, mixed], dim=1), means)
    xx, yy, dd, xy, xd, yd = products.split(1, dim=1)
    roots = torch.cat([xx, yy, dd], dim=1).sqrt()
    xx, yy = xx + MIN_TEXTURE, yy + MIN_TEXTURE
    moved = torch.cat([yy * xd - xy * yd, xx * yd - xy * xd], dim=1) / (xx * yy - xy * xy)
    return moved.clamp(-MAX_DISPLACEMENT, MAX_DISPLACEMENT), roots


def _gradient(maps: torch.Tensor) -> torch.Tensor:
    """Central differences along the last axis, zero at the rim. The shape of maps."""
    rim = torch.zeros_like(maps[..., :1])
    return torch.cat([rim, (maps[..., 2:] - maps[..., :-2]) / 2, rim], dim=-1)


class ShearHead(nn.Module):
    """Predicts the shear force and the logarithm of its raw spread. size: S. vector: G."""

    def __init__(self, size: int, vector: int) -> None:
        super().__init__()
        self.part = max(1, size // IMAGE_SIDE)
        for scale in SCALES:
            side = size // (self.part * scale)
            boxes = {"blur": (1, BLUR // scale), "means": (STEP // scale, MARGIN // scale)}
            for name, box in boxes.items():
                self.register_buffer(f"{name}_{scale}", box_means(side, *box), persistent=False)
        self.normalize = nn.BatchNorm2d(5 * len(SCALES))
        self.windows = nn.Conv2d(5 * len(SCALES), WIDTH, 3, 1, 1)
        self.vector = nn.Linear(vector, WIDTH)
        self.mix = nn.Sequential(nn.ReLU(), nn.Conv2d(WIDTH, WIDTH, 3, 1, 1), nn.ReLU())
        self.weights = nn.Conv2d(WIDTH, 2 * len(SCALES), 1)
        self.spread = nn.Sequential(nn.Linear(WIDTH + 2, WIDTH), nn.ReLU(), nn.Linear(WIDTH, 2))

    def forward(
        self, image: torch.Tensor, frame: torch.Tensor, vector: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """image, frame: (B, 3, S, S), normalized. vector: of the encoder.

        In training, batches are mirrored at random, and their forces mirrored back.
        """
        mirrored = (torch.rand(2) < 0.5).tolist() if self.training else [False, False]
        axes = [axis for axis, each in zip((3, 2), mirrored, strict=True) if each]
        if axes:
            image, frame = image.flip(axes), frame.flip(axes)
        measured = []
        with torch.autocast(image.device.type, enabled=False):
            greys = [each.float().mean(dim=1, keepdim=True) for each in (image, frame)]
            for scale in SCALES:
                means, blur = (getattr(self, f"{name}_{scale}") for name in ("means", "blur"))
                small = [functional.avg_pool2d(each, self.part * scale) for each in greys]
                flat = [each - averaged(each, blur) for each in small]
                measured.append(displacements(flat[0], flat[1], means))
        # x and y of one scale after the other
        moved, roots = (torch.cat(each, dim=1) for each in zip(*measured, strict=True))
        features = self.normalize(torch.cat([moved, roots], dim=1))
        mixed = self.mix(self.windows(features) + self.vector(vector)[:, :, None, None])
        weighted = (1.0 + self.weights(mixed).float()) * moved
        shear = weighted.mean(dim=(2, 3)).unflatten(1, (len(SCALES), 2)).sum(dim=1)
        if axes:
            shear = shear * (1.0 - 2.0 * torch.tensor(mirrored).float()).to(shear.device)
        # Detached: the spread's loss does not change the features of the mean.
        known = torch.cat([mixed.float().mean(dim=(2, 3)), shear.abs()], dim=1).detach()
        return shear, self.spread(known).float()


def with_minimum(least: float, log_spread: torch.Tensor) -> torch.Tensor:
    """The logarithm of the sum of a spread and its minimum; a hard bound has no gradient."""
    return torch.log(torch.exp(log_spread) + least)  # ONNX has no logaddexp


# Minimum spreads, fractions of the scales of depth and pressure (assumed: a micrometer)
MIN_DEPTH_SPREAD, MIN_PRESSURE_SPREAD = 2e-3, 1e-3
PLANES = 3  # Outputs of the mean: depth, pressure, and the logit of contact


def side_of_maps(size: int) -> int:
    """H of a network with this image side."""
    return size // 2


class ContactHead(nn.Module):
    """The decoder of a ResNet18 of base width `filters`."""

    def __init__(self, filters: int) -> None:
        super().__init__()
        self.pixels = nn.Conv2d(6, filters, 4, 2, 1, bias=False)
        self.place = nn.Conv2d(5, filters, 1, bias=False)
        self.fine = nn.Sequential(nn.BatchNorm2d(filters), nn.ReLU())
        self.coarser = convolution(filters, 2 * filters, 2)
        # Widths of the maps of sides S / 32 to S / 2: of the encoder's, and of the decoder's.
        theirs, own = (8, 4, 2, 1, 1), (8, 2, 2, 2, 1)
        steps = range(1, len(own))
        self.raised = nn.ModuleList(
            nn.Conv2d(filters * own[n - 1], filters * own[n], 1, bias=False) for n in steps
        )
        self.lateral = nn.ModuleList(
            nn.Conv2d(filters * theirs[n], filters * own[n], 1) for n in steps
        )
        self.merged = nn.ModuleList(convolution(filters * own[n], filters * own[n]) for n in steps)
        self.last = convolution(filters, filters)
        self.mean = nn.Conv2d(filters, PLANES, 1)
        self.spread = nn.Sequential(
            nn.Conv2d(filters, filters // 2, 3, 1, 1), nn.ReLU(), nn.Conv2d(filters // 2, 2, 1)
        )

    def forward(self, inputs: torch.Tensor, maps: tuple[torch.Tensor, ...]) -> Outputs:
        """The outputs of the contact. inputs: of the encoder. maps: S / 2 to S / 32 wide."""
        *skips, found = maps
        pixels = self.pixels(inputs)
        fine = self.fine(pixels + self.place(_places(pixels)))
        more = (None, None, self.coarser(fine), fine)
        for raised, lateral, merged, skip, own in zip(
            self.raised, self.lateral, self.merged, reversed(skips), more, strict=True
        ):
            coarse = functional.interpolate(raised(found), size=skip.shape[-2:], mode="nearest")
            total = coarse + lateral(skip)
            found = merged(total if own is None else total + own)
        found = self.last(found)
        depth, pressure, logit = self.mean(found).float().unbind(dim=1)
        # Detached: the spread's loss does not change the features of the mean.
        spread = self.spread(found.detach()).float()
        return {
            "depth": depth,
            "depth_spread": with_minimum(MIN_DEPTH_SPREAD, spread[:, 0]),
            "pressure": pressure,
            "pressure_spread": with_minimum(MIN_PRESSURE_SPREAD, spread[:, 1]),
            "contact": logit,
        }


def _places(maps: torch.Tensor) -> torch.Tensor:
    """(1, 5, H, H) powers of x and y of the cells, which the direction of the light depends on."""
    line = torch.linspace(-1.0, 1.0, maps.shape[-1], device=maps.device)
    x, y = torch.meshgrid(line, line, indexing="xy")
    return torch.stack([x, y, x * x, x * y, y * y])[None]


MAX_POOLED = 4  # Cells along each side of the map that the vector is made from (assumed)
# Factor of the difference from the background frame (assumed: a press changes an image by some
# tenths of the standard deviation of its colors)
DIFFERENCE_SCALE = 2.0
CANVAS = 32  # Channels of the canvas that the vector predicts (assumed)
# Minimum spread of the dense counts, fraction of full scale (assumed: 10 counts, twice a reading's
# noise), of the force, of force_scale, and of the shear force, of shear_scale (assumed)
MIN_SPREAD, MIN_FORCE_SPREAD, MIN_SHEAR_SPREAD = 2.5e-4, 0.01, 0.01
MIN_FORCE_SCALE = 1e-3  # Of forces that the network predicts (assumed)
# First letters of the names of the weights and buffers of the shear force, of the contact, and of
# the factors of the spreads, which belong to the calibration
SHEAR, CONTACT, SCALE = "shear", "contact", "scale"
# Buffers with the knots of the calibration, and the shares of the errors in their bins
KNOTS = {
    "place_knots": PLACE_SHARES, "press_knots": PRESS_SHARES, "force_knots": PRESS_SHARES,
    "shear_knots": PRESS_SHARES, "contact_depth_knots": PLACE_SHARES,
    "contact_pressure_knots": PLACE_SHARES, "contact_center_knots": PRESS_SHARES,
}  # fmt: skip


class FieldNet(nn.Module):
    """The network of one grid of dense counts and image size.

    x_mm, y_mm: (F,) the places of the dense counts, column by column, mm. view_mm: half the width
    and half the height of the view, mm. size: S. filters: base width of the ResNet18.
    predicts_shear: whether it predicts the shear force on the gel camera. predicts_contact: whether
    it has a decoder of the contact. Raises T2TwinError for places that form no such columns, and
    for too few filters.

    The calibration sets all knots, (2, K), the correlation, the limits, and the weights of `scale`,
    the factors that the spreads have in evaluation mode.
    """

    fine_places: torch.Tensor
    coarse_places: torch.Tensor
    mean_frame: torch.Tensor  # (3, S, S), mean of the dataset's background frames, normalized
    field_mean: torch.Tensor  # (F,), fraction of full scale
    field_variance: torch.Tensor  # (), its mean over the places
    force_scale: torch.Tensor  # (2,), mean and standard deviation of the forces' logarithms
    place_knots: torch.Tensor
    press_knots: torch.Tensor
    force_knots: torch.Tensor
    correlation: torch.Tensor  # (F, F)
    shear_scale: torch.Tensor  # (), root mean square in the training presses, N
    shear_knots: torch.Tensor
    contact_scale: torch.Tensor  # (2,), the same of depth, mm, and pressure, kPa, in the contacts
    contact_depth_knots: torch.Tensor
    contact_pressure_knots: torch.Tensor
    contact_center_knots: torch.Tensor
    # (2,), without and with a background frame: an image with a larger logit has a contact
    contact_limits: torch.Tensor

    def __init__(
        self, x_mm: np.ndarray, y_mm: np.ndarray, view_mm: tuple[float, float], size: int,
        filters: int, predicts_shear: bool = False, predicts_contact: bool = False,
    ) -> None:  # fmt: skip
        super().__init__()
        self.grid = grid_of(x_mm)
        self.encoder = ResNet18(0, filters, channels=6)
        cells, self.first_side = -(-size // 32), -(-size // 2)
        self.pooled = max(n for n in range(1, MAX_POOLED + 1) if cells % n == 0)
        self.pool = nn.AvgPool2d(cells // self.pooled) if cells > self.pooled else nn.Identity()
        width, vector = 2 * filters, 8 * filters
        self.gather = nn.Linear(8 * filters * self.pooled**2, vector)
        self.canvas = nn.Linear(vector, CANVAS * x_mm.size)
        self.coarse = nn.Conv2d(4 * filters, width, 1)
        self.decode = nn.Sequential(
            nn.Conv2d(CANVAS + 2 * width, width, 3, 1, 1, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            BasicBlock(width, width, 1),
        )
        self.mean = nn.Conv2d(width, 1, 1)
        self.mean_of_all = nn.Linear(vector, x_mm.size)
        self.spread = nn.Sequential(
            nn.Conv2d(width, filters, 3, 1, 1), nn.ReLU(), nn.Conv2d(filters, 1, 1)
        )
        self.spread_of_all = nn.Linear(vector, x_mm.size)
        self.force = nn.Linear(vector, 1)
        self.force_spread = nn.Linear(vector, 1)
        for name, part in (("fine", 8), ("coarse", 16)):
            weights = resampling_weights(x_mm, y_mm, view_mm, -(-size // part))
            self.register_buffer(f"{name}_places", torch.from_numpy(weights), persistent=False)
        self.register_buffer("mean_frame", torch.zeros(3, size, size))
        self.register_buffer("field_mean", torch.zeros(x_mm.size))
        self.register_buffer("field_variance", torch.ones(()))
        self.register_buffer("force_scale", torch.tensor([0.0, 0.0]))
        has = {SHEAR: predicts_shear, CONTACT: predicts_contact}
        for name, shares in KNOTS.items():
            if has.get(name.partition("_")[0], True):
                self.register_buffer(name, identity_knots(len(shares)))
        self.register_buffer("correlation", torch.eye(x_mm.size))
        self.predicts_shear = predicts_shear
        if predicts_shear:  # last, so that the other weights start as without it
            self.shear = ShearHead(size, vector)
            self.register_buffer("shear_scale", torch.zeros(()))
        self.predicts_contact = predicts_contact
        if predicts_contact:
            self.contact = ContactHead(filters)
            self.register_buffer("contact_scale", torch.zeros(2))
            self.register_buffer("contact_limits", torch.zeros(2))
        self.scale = SpreadScale(x_mm, y_mm, view_mm, self.grid, size)

    @property
    def predicts_force(self) -> bool:
        """Whether the network was trained on presses of several forces."""
        return float(self.force_scale[1]) > MIN_FORCE_SCALE

    def forward(
        self, images: torch.Tensor, with_contact: bool = False, with_features: bool = False
    ) -> Outputs:
        """The outputs by name, not calibrated, and under NAME_spread the logarithm of their spread.

        images: (B, 6, S, S), normalized, each with its background frame. "field": (B, F), fraction
        of full scale. "force": (B,), standardized logarithm. "shear": (B, 2), along x and y, of
        shear_scale, if it is predicted. with_contact: whether with "depth" and "pressure", of
        contact_scale, and the logit of the probability, "contact", (B, H, H); in evaluation mode
        also with its limit, "contact_limit", (B, 1, 1). with_features: whether with "features" for
        the frame check, (B, n).
        """
        image, frame = images.split(3, dim=1)
        inputs = torch.cat([image, DIFFERENCE_SCALE * (image - frame)], dim=1)
        maps = self.encoder.maps(inputs)
        fine, coarse, last = maps[-3:]
        vector = self.gather(self.pool(last).flatten(1)).relu()
        canvas = self.canvas(vector).unflatten(1, (CANVAS, *self.grid))
        fine = self._resample(fine, self.fine_places)
        coarse = self._resample(self.coarse(coarse), self.coarse_places)
        decoded = self.decode(torch.cat([canvas, fine, coarse], dim=1))
        mean = (self.mean(decoded).flatten(1) + self.mean_of_all(vector)).float()
        # Detached: the spread's loss does not change the features of the mean.
        decoded, detached = decoded.detach(), vector.detach()
        spread = (self.spread(decoded).flatten(1) + self.spread_of_all(detached)).float()
        scale = self.field_variance.sqrt()
        outputs = {
            "field": self.field_mean + scale * mean,
            "field_spread": with_minimum(MIN_SPREAD, scale.log() + spread),
            "force": self.force(vector).float()[:, 0],
            "force_spread": with_minimum(
                MIN_FORCE_SPREAD, self.force_spread(detached).float()[:, 0]
            ),
        }
        if with_contact:
            outputs |= self.contact(inputs, maps)
        if with_features:
            outputs["features"] = features_of(maps, self.first_side)
        if not self.training:
            with torch.autocast(images.device.type, enabled=False):
                place, force = self.scale(*self.scale_features(images, outputs))
            outputs["field_spread"] = outputs["field_spread"] + place
            outputs["force_spread"] = outputs["force_spread"] + force
        if with_contact and not self.training:
            is_given = (frame - self.mean_frame).abs().amax(dim=(1, 2, 3)) > SAME_FRAME
            limits = torch.where(is_given, self.contact_limits[1], self.contact_limits[0])
            outputs["contact_limit"] = limits[:, None, None]
        if self.predicts_shear:
            outputs["shear"], spread = self.shear(image, frame, detached)
            outputs["shear_spread"] = with_minimum(MIN_SHEAR_SPREAD, spread)
        return outputs

    def scale_features(
        self, images: torch.Tensor, outputs: Outputs
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """The features of `scale` of outputs for images."""
        known = (outputs[name] for name in ("field", "field_spread", "force", "force_spread"))
        return self.scale.features(images, self.mean_frame, *known)

    def _resample(self, view_map: torch.Tensor, places: torch.Tensor) -> torch.Tensor:
        """A map of the view at the places of the dense counts, (B, C, D, E), zero outside the
        view."""
        return (view_map.flatten(2) @ places.to(view_map.dtype)).unflatten(2, self.grid)


def grid_of(x_mm: np.ndarray) -> tuple[int, int]:
    """Number of columns of the places of the dense counts, and of places in each.

    Raises T2TwinError for columns of different lengths.
    """
    starts = np.flatnonzero(np.diff(x_mm, prepend=-np.inf) > 0.01)
    rows = np.diff(starts, append=x_mm.size)
    if (rows != rows[0]).any():
        raise T2TwinError(
            "the places of the dense counts form columns of different lengths; expected equal, as "
            "this version of t2twin makes them"
        )
    return starts.size, int(rows[0])


def resampling_weights(
    x_mm: np.ndarray, y_mm: np.ndarray, view_mm: tuple[float, float], side: int
) -> np.ndarray:
    """(side * side, F) float32: weights of the cells of a map of the view at each place.

    Bilinear between the centers of the cells; zero from half a cell outside the view.
    """
    cells = np.arange(side)
    across, down = (
        np.maximum(0.0, 1.0 - np.abs((at / (2 * half) + 0.5) * side - 0.5 - cells[:, None]))
        for at, half in zip((x_mm, y_mm), view_mm, strict=True)
    )
    weights = down[:, None, :] * across[None, :, :]  # rows, columns, places
    return weights.reshape(side * side, -1).astype(np.float32)
