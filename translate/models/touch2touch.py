"""touch2touch: pix2pix from the grey DIGIT image to the tactile image (Grella et al. 2023).

The generator predicts the tactile image, scaled so that -1 is zero and 1 is full scale, at the
preset's square size. phi at that size is phi at 396 x 240 followed by an area resize; its inverse
reads the counts from the predicted image. The loss does not contain the counts. A preset may add a
soft IoU loss (t2twin.translate.models.soft_iou_loss).

Shape letters: B batch, S image side, N taxels, R rows and C columns of a full tactile image.
"""

from copy import copy, deepcopy
from typing import Self

import torch
from torch import nn
from torch.nn import functional

from t2twin.sim.cyskin.layout import Layout
from t2twin.sim.cyskin.phi import TACTILE_SHAPE, Phi
from t2twin.translate.data.pairs import Examples
from t2twin.translate.models.base import CountsTranslator
from t2twin.translate.models.layouts import check_inside, reading_at
from t2twin.translate.models.pix2pix import Pix2Pix


class Touch2Touch(Pix2Pix, CountsTranslator):
    """pix2pix with DIGIT images as inputs and tactile images as targets."""

    def step(self, examples: Examples) -> dict[str, float]:
        """See Translator. images: (B, 1, S, S) in [-1, 1]."""
        targets = self.scaled_tactile_images(examples.counts.to(self.device))
        return self.pix2pix_step(examples.images.to(self.device), targets)

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """See CountsTranslator. images: (B, 1, S, S)."""
        return self.counts_of(self.predict_tactile_images(images))

    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """See CountsTranslator. The tactile images are the generator's, resized."""
        small = self.predict_tactile_images(images)
        large = functional.interpolate(small, TACTILE_SHAPE, mode="bilinear", antialias=True)
        return self.counts_of(small), large[:, 0].clamp(min=0.0)

    def predict_tactile_images(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 1, S, S) -> tactile images at the generator's size, counts, (B, 1, S, S)."""
        return (self.generate(images) + 1.0) * (self.full_scale / 2.0)

    def read_at(self, layout: Layout) -> Self:
        """See LayoutReader. The images keep their size; the new layout's phi^-1 reads them."""
        phi = Phi(layout.x_mm, layout.y_mm)
        check_inside(self.info, layout.x_mm, layout.y_mm, layout.name)
        other = copy(self)
        other.phi = reading_at(phi.resized(self.phi.shape), self.phi)
        return other

    def as_module(self) -> nn.Module:
        """See CountsTranslator."""
        return _FromPixels(self.predictor, self.phi, self.full_scale)

    def counts_of(self, tactile_images: torch.Tensor) -> torch.Tensor:
        """phi^-1, clipped to full scale. (B, 1, S, S) -> (B, N)."""
        return self.phi.from_torch(tactile_images).clamp(0.0, self.full_scale)


class _FromPixels(nn.Module):
    """From grey pixels in [0, 1] to counts and tactile images, in float32 on the CPU."""

    rows: torch.Tensor
    columns: torch.Tensor

    def __init__(self, generator: nn.Module, phi: Phi, full_scale: float) -> None:
        super().__init__()
        self.network = deepcopy(generator).cpu()
        self.phi = phi
        self.full_scale = full_scale
        self.register_buffer("rows", _resize_matrix(phi.shape[0], TACTILE_SHAPE[0]))
        columns = _resize_matrix(phi.shape[1], TACTILE_SHAPE[1]).T.contiguous()
        self.register_buffer("columns", columns)

    def forward(self, pixels: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        small = (self.network(2.0 * pixels - 1.0) + 1.0) * (self.full_scale / 2.0)
        counts = self.phi.from_torch(small).clamp(0.0, self.full_scale)
        return counts, (self.rows @ small[:, 0] @ self.columns).clamp(min=0.0)


def _resize_matrix(size: int, new: int) -> torch.Tensor:
    """(new, size): bilinear resize along one side, as `counts_and_tactile_images` computes it.

    The Resize operator of the exported ONNX version has no antialiasing.
    """
    unit = torch.eye(size)[None, None]
    return functional.interpolate(unit, (new, size), mode="bilinear", antialias=True)[0, 0]
