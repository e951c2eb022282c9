"""Classifies a frame as a touch of the run's sensor, or as one of several kinds of wrong frames.

A small convolutional network on the frame at SIDE x SIDE pixels, and on its difference from the
background frame. It is trained on frames of the training data and on wrong frames made of them
(Hendrycks et al. 2019, outlier exposure).

In the light of any unit, right frames vary as much as mirrored ones. Their distance from the
training images (Lee et al. 2018) detects 8 % of these without a background frame (measured).

Shape letters: B images, S image side of the run, K classes.
"""

import torch
from torch import nn
from torch.nn import functional

from t2twin.translate.data.images import COLORS
from t2twin.translate.uncertainty.ood import INVERSE_TRANSFORMS, OODClass

CLASSES = (
    OODClass.IN_DISTRIBUTION,
    *INVERSE_TRANSFORMS,
    OODClass.UNLIKE_BACKGROUND,
    OODClass.OTHER,
)
"""The K classes, the right one first."""

SIDE = 32
"""Side of the images of the network, pixels (assumed: light and color are smooth)."""

CHANNELS, HIDDEN = (32, 48, 64, 64), 128
"""Widths of the convolutions and of the hidden layer (assumed)."""

DROPOUT = 0.3
"""Share of the values that is left out in training (assumed)."""

DIFFERENCE_SCALE = 2.0
"""Factor on the difference from the background frame, which varies less (assumed)."""

WITHOUT, WITH = 0, 1
"""Index of the limit without and with a background frame."""


class FrameCheck(nn.Module):
    """The network. Buffer: limits, (2,), scores above which a frame is wrong, without and with a
    background frame."""

    limits: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        first, second, third, last = CHANNELS
        self.layers = nn.Sequential(
            _block(2 * COLORS, first, size=5, stride=2),
            _block(first, second, size=3, stride=2),
            _block(second, third, size=3, stride=1),
            _block(third, last, size=3, stride=2),
            nn.Flatten(),
            nn.Dropout(DROPOUT),
            nn.Linear(last * (SIDE // 8) ** 2, HIDDEN),
            nn.BatchNorm1d(HIDDEN),
            nn.ReLU(),
            nn.Dropout(DROPOUT),
            nn.Linear(HIDDEN, len(CLASSES)),
        )
        self.register_buffer("limits", torch.full((2,), torch.inf))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(B, 3, S, S), or (B, 6, S, S) with background frames, normalized -> (B, K) logits."""
        small = functional.adaptive_avg_pool2d(images, SIDE)
        frames, backgrounds = small[:, :COLORS], small[:, COLORS:]
        differences = torch.zeros_like(frames)
        if backgrounds.shape[1]:
            differences = DIFFERENCE_SCALE * (frames - backgrounds)
        return self.layers(torch.cat([frames, differences], dim=1))

    def classify(self, images: torch.Tensor) -> list[OODClass]:
        """(B,) classes of images. images: as for `forward`."""
        self.eval()
        with torch.inference_mode():
            logits = self(images)
        wrong = scores(logits) > self.limits[WITH if images.shape[1] > COLORS else WITHOUT]
        kinds = 1 + logits[:, 1:].argmax(dim=1)
        return [CLASSES[int(k) if bad else 0] for k, bad in zip(kinds, wrong, strict=True)]


def _block(inputs: int, outputs: int, size: int, stride: int) -> nn.Sequential:
    convolution = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU())


def scores(logits: torch.Tensor) -> torch.Tensor:
    """(B,): logarithm of the odds of a wrong frame. logits: (B, K)."""
    return logits[:, 1:].logsumexp(dim=1) - logits[:, 0]
