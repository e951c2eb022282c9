"""Classifies a frame as a touch of the run's sensor, or as one of several kinds of wrong frames.

A small network on the features of a trained encoder. It is trained on frames of the training data
and on wrong frames made of them (Hendrycks et al. 2019, outlier exposure).

In the light of any unit, features of right frames vary as much as those of mirrored ones. Their
distance from the training images (Lee et al. 2018) detects 8 % of these without a background frame.
This network detects 85 % (measured on units of the recipe `contact`).

Shape letters: B images, n features, K classes.
"""

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional

from t2twin.translate.uncertainty.ood import INVERSE_TRANSFORMS, OODClass

CLASSES = (
    OODClass.IN_DISTRIBUTION,
    *INVERSE_TRANSFORMS,
    OODClass.UNLIKE_BACKGROUND,
    OODClass.OTHER,
)
"""The K classes, the right one first."""

HIDDEN = 64
"""Width of the hidden layer (assumed)."""

DROPOUT = 0.2
"""Share of the hidden values that is left out in training (assumed)."""

MAX_FEATURE = 8.0
"""Limit of a standardized feature (assumed: wrong frames have features far from all others)."""

CELLS = 3
"""Cells along each side of the encoder's first map (assumed)."""

WITHOUT, WITH = 0, 1
"""Index of the limit without and with a background frame."""


def features_of(maps: Sequence[torch.Tensor], side: int) -> torch.Tensor:
    """(B, n): logarithms of mean and standard deviation of each channel of an encoder's maps, and
    of the means of the first map's channels in CELLS x CELLS cells.

    The cells tell from where the light comes. With them, 51 % of frames that are upside down and
    mirrored are detected without a background frame, without them 7 % (measured).

    maps: (B, channels, rows, columns) each, not negative. side: rows of the first.
    """
    parts = []
    for each in maps:
        values = each.float()
        parts += [values.mean(dim=(2, 3)), values.std(dim=(2, 3), correction=0)]
    cells = functional.avg_pool2d(maps[0].float(), max(1, side // CELLS))
    return torch.cat([*parts, cells.flatten(1)], dim=1).clamp(min=0.0).log1p()


class FrameCheck(nn.Module):
    """The network of an encoder with n features.

    Buffers: center and scale, (n,), of the features of right frames; limits, (2,), scores above
    which a frame is wrong, without and with a background frame.
    """

    center: torch.Tensor
    scale: torch.Tensor
    limits: torch.Tensor

    def __init__(self, features: int) -> None:
        super().__init__()
        self.hidden = nn.Linear(features, HIDDEN)
        self.drop = nn.Dropout(DROPOUT)
        self.logits = nn.Linear(HIDDEN, len(CLASSES))
        self.register_buffer("center", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))
        self.register_buffer("limits", torch.full((2,), torch.inf))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """(B, n) -> (B, K) logits. Checks of earlier versions use the first of the features."""
        standardized = (features[:, : self.center.numel()] - self.center) / self.scale
        hidden = self.hidden(standardized.clamp(-MAX_FEATURE, MAX_FEATURE)).relu()
        return self.logits(self.drop(hidden))

    def classify(self, features: torch.Tensor, has_background: bool) -> list[OODClass]:
        """(B,) classes of frames by their features."""
        self.eval()
        with torch.inference_mode():
            logits = self(features)
        limit = self.limits[WITH if has_background else WITHOUT]
        wrong = scores(logits) > limit
        kinds = 1 + logits[:, 1:].argmax(dim=1)
        return [CLASSES[int(k) if bad else 0] for k, bad in zip(kinds, wrong, strict=True)]


def scores(logits: torch.Tensor) -> torch.Tensor:
    """(B,): logarithm of the odds of a wrong frame. logits: (B, K)."""
    return logits[:, 1:].logsumexp(dim=1) - logits[:, 0]
