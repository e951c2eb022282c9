"""The reversed touch2touch: pix2pix from the tactile image of the counts to the grey DIGIT image.

Networks and losses are those of touch2touch with input and target exchanged. The input is phi of
the counts at the preset's size, -1 at zero and 1 at full scale; the output is the grey image, -1 at
black and 1 at white.

Shape letters: B batch, S image side, N taxels.
"""

import numpy as np
import torch

from t2twin.translate.data.images import WHITE_GREY
from t2twin.translate.data.pairs import Examples
from t2twin.translate.models.pix2pix import Pix2Pix


class CySkinToDigit(Pix2Pix):
    """pix2pix with tactile images as inputs and DIGIT images as targets."""

    def step(self, examples: Examples) -> dict[str, float]:
        """See Translator. images: (B, 1, S, S) in [-1, 1], the targets."""
        inputs = self.scaled_tactile_images(examples.counts.to(self.device))
        return self.pix2pix_step(inputs, examples.images.to(self.device))

    def predict_images(self, counts: torch.Tensor) -> torch.Tensor:
        """(B, N) counts -> DIGIT images, (B, S, S), grey levels, not rounded."""
        generated = self.generate(self.scaled_tactile_images(counts.to(self.device)))
        return (generated[:, 0] + 1.0) * (WHITE_GREY / 2.0)

    def errors(self, pixels: np.ndarray, counts: np.ndarray) -> np.ndarray:
        """See Translator. (B, S * S), grey levels."""
        images = self.predict_images(torch.from_numpy(counts)).cpu().numpy()
        return (images - pixels[..., 0]).reshape(len(pixels), -1)
