"""Classifies a frame as a touch of the run's sensor, or as one of several kinds of wrong frames.

A small network on the features of a trained encoder. It is trained on frames of the training data
and on wrong frames made of them (Hendrycks et al. 2019, outlier exposure).

In the light of any unit, features of right frames vary as much as those of mirrored ones. Their
distance from the training images (Lee et al. 2018) detects 8 % of these without a background frame.
A second network therefore sees the frame itself at a low resolution. It names transformed frames,
also those whose background frame is transformed in the same way.

Shape letters: B images, S image side of the run, n features, K classes, T transforms.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.translate.data.images import COLORS
from t2twin.translate.uncertainty.ood import INVERSE_TRANSFORMS, OODClass

KINDS, TRANSFORMS = "frame_odds", "transform_odds"  # Names of the networks' outputs
# The K classes, the right one first
RIGHT = OODClass.IN_DISTRIBUTION
CLASSES = (RIGHT, *INVERSE_TRANSFORMS, OODClass.UNLIKE_BACKGROUND, OODClass.OTHER)
HIDDEN = 64  # Width of the hidden layer (assumed)
DROPOUT = 0.2  # Share of the hidden values that is left out in training (assumed)
MAX_FEATURE = 8.0  # Of standardized ones (assumed: wrong frames have some far from all others)
CELLS = 3  # Cells along each side of the encoder's first map (assumed)
SIDE = 32  # Side of the second network's images, pixels (assumed: light and color are smooth)
# Channels of its convolutions, and width of its hidden layer (assumed)
CHANNELS, WIDTH = (32, 48, 64), 128
TRANSFORM_DROPOUT = 0.3  # Share of its values that is left out in training (assumed)
MIN_LIMIT = 0.0  # Of a score, the logarithm of the odds: more likely wrong than right
# Index of the limit without and with a background frame, and of the second network's
WITHOUT, WITH, TRANSFORMED = 0, 1, 2


def features_of(maps: Sequence[torch.Tensor], side: int) -> torch.Tensor:
    """(B, n): logarithms of mean and standard deviation of each channel of an encoder's maps. And
    of the means of the first map's channels in CELLS x CELLS cells, which depend on the light.

    maps: (B, channels, rows, columns) each, not negative. side: rows of the first.
    """
    parts = []
    for each in maps:
        values = each.float()
        parts += [values.mean(dim=(2, 3)), values.std(dim=(2, 3), correction=0)]
    cells = functional.avg_pool2d(maps[0].float(), max(1, side // CELLS))
    return torch.cat([*parts, cells.flatten(1)], dim=1).clamp(min=0.0).log1p()


class FrameCheck(nn.Module):
    """Both networks, for an encoder with n features."""

    center: torch.Tensor  # (n,), of the features of right frames
    scale: torch.Tensor  # (n,), the same
    # (3,), scores above which a frame is wrong: without and with a background frame, and by the
    # second network
    limits: torch.Tensor

    def __init__(self, features: int) -> None:
        super().__init__()
        self.hidden = nn.Linear(features, HIDDEN)
        self.drop = nn.Dropout(DROPOUT)
        self.logits = nn.Linear(HIDDEN, len(CLASSES))
        self.register_buffer("center", torch.zeros(features))
        self.register_buffer("scale", torch.ones(features))
        self.register_buffer("limits", torch.full((3,), torch.inf))
        self.transforms = TransformNet()

    def set_limit(self, which: int, right: torch.Tensor, share: float, margin: float = 0.0) -> None:
        """Sets a limit from the scores of right frames, a share of which is above it without the
        margin."""
        limit = torch.quantile(right, 1.0 - share) + margin
        self.limits[which] = limit.clamp(min=MIN_LIMIT)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """(B, n) -> (B, K) logits. Raises T2TwinError for another n."""
        if features.shape[1] != self.center.numel():
            raise T2TwinError("frames.safetensors is a frame check of another run; remove it")
        standardized = (features - self.center) / self.scale
        hidden = self.hidden(standardized.clamp(-MAX_FEATURE, MAX_FEATURE)).relu()
        return self.logits(self.drop(hidden))

    @torch.no_grad()
    def odds(self, features: torch.Tensor, images: torch.Tensor) -> dict[str, torch.Tensor]:
        """The logits of both networks by name, with the scores in place of the first, which is of
        the right class. features: (B, n). images: (B, 3, S, S), normalized, without backgrounds."""
        found = {KINDS: self(features), TRANSFORMS: self.transforms(images)}
        return {n: torch.cat([scores(e)[:, None], e[:, 1:]], dim=1) for n, e in found.items()}

    def classify(self, odds: dict[str, np.ndarray], has_background: bool) -> list[OODClass]:
        """(B,) classes of frames; of two transforms, that of the second network.

        odds: as `odds` returns them. has_background: whether they are of frames with backgrounds.
        """
        limits, found = self.limits.tolist(), []
        of_kinds = limits[WITH if has_background else WITHOUT]
        named = CLASSES if has_background else (*CLASSES[:-2], *2 * CLASSES[-1:])
        for each, limit in ((odds[KINDS], of_kinds), (odds[TRANSFORMS], limits[TRANSFORMED])):
            kinds = np.where(each[:, 0] > limit, 1 + each[:, 1:].argmax(axis=1), 0)
            found.append([named[kind] for kind in kinds])
        transforms = CLASSES[1 : 1 + len(INVERSE_TRANSFORMS)]
        both = zip(*found, strict=True)
        return [b if b in transforms and a in (RIGHT, *transforms) else a for a, b in both]


class TransformNet(nn.Module):
    """The second network, of convolutions. Classes: the first T + 1 of CLASSES."""

    def __init__(self) -> None:
        super().__init__()
        first, second, third = CHANNELS
        self.layers = nn.Sequential(
            convolution(COLORS, first, stride=2, size=5),
            convolution(first, second, stride=2),
            convolution(second, third),
            nn.Flatten(),
            nn.Dropout(TRANSFORM_DROPOUT),
            nn.Linear(third * (SIDE // 4) ** 2, WIDTH),
            nn.BatchNorm1d(WIDTH),
            nn.ReLU(),
            nn.Dropout(TRANSFORM_DROPOUT),
            nn.Linear(WIDTH, 1 + len(INVERSE_TRANSFORMS)),
        )

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3, S, S) normalized images -> (B, T + 1) logits."""
        means = _means(int(images.shape[-1])).to(images.device)
        return self.layers(means @ images @ means.T)


@cache
def _means(side: int) -> torch.Tensor:
    """(SIDE, side): weights of adaptive averages of a line, which ONNX has not."""
    at = np.arange(SIDE)[:, None] * side
    inside = (np.arange(side) >= at // SIDE) & (np.arange(side) < -(-(at + side) // SIDE))
    return torch.from_numpy((inside / inside.sum(axis=1, keepdims=True)).astype(np.float32))


def scores(logits: torch.Tensor) -> torch.Tensor:
    """(B,): logarithm of the odds of a wrong frame. logits: (B, K), or (B, T + 1)."""
    return logits[:, 1:].logsumexp(dim=1) - logits[:, 0]


def convolution(channels: int, width: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    """A convolution of an odd size, with normalization and rectification."""
    layer = nn.Conv2d(channels, width, size, stride, size // 2, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(width), nn.ReLU())
