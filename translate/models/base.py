"""What training, prediction, export and the saved state need of a translator.

Shape letters: B batch, c channels and S side of its input images, N taxels, R rows and C columns of
a tactile image.
"""

from typing import Protocol, Self

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

from t2twin.sim.cyskin.layout import Layout
from t2twin.translate.data.pairs import Examples, Pairs


class Translator(Protocol):
    """The networks of one model, with a step of training and with what they predict.

    All images that go in are as `data.images.to_input` makes them, (B, c, S, S) float32; all counts
    are (B, N) float32.
    """

    @property
    def networks(self) -> dict[str, nn.Module]:
        """All that is trained, by name; the one that predicts, or whose mean does, first."""
        ...

    @property
    def optimizers(self) -> dict[str, torch.optim.Optimizer]:
        """By the names of their networks."""
        ...

    @property
    def predictor(self) -> nn.Module:
        """The network that is kept to predict with: one of `networks`, or the mean's `module`."""
        ...

    @property
    def running(self) -> AveragedModel | None:
        """The running mean of one of `networks`, if the preset has one."""
        ...

    @property
    def device(self) -> torch.device:
        """Where the networks are; what goes in is moved there."""
        ...

    @property
    def draws(self) -> bool:
        """Whether it draws tactile images, which can be read at another taxel layout."""
        ...

    @property
    def learns_field(self) -> bool:
        """Whether it is trained on the field, which not every data set holds."""
        ...

    def prepare(self, pairs: Pairs) -> None:
        """Takes from the training's pairs what it must know before the first step, and does not
        know already from the weights that it begins with."""
        ...

    def step(self, examples: Examples) -> dict[str, float]:
        """One step of training on a batch of pairs. Returns the losses by name."""
        ...

    def calibrate(self, *sets: Pairs) -> None:
        """Takes from pairs that are not trained on what the predictor's spreads are to be
        multiplied by, and keeps it with its weights."""
        ...

    def predict(self, images: torch.Tensor) -> torch.Tensor:
        """Counts, within zero and full scale. The predictor is in evaluation mode after it."""
        ...

    def counts_and_tactile_images(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """What `predict` gives, and tactile images, (B, R, C) float32, counts."""
        ...

    def read_at(self, layout: Layout) -> Self:
        """The same networks, what they draw being read at the taxels of another layout.

        Raises T2TwinError where it draws no images, for a layout that phi cannot interpolate, and
        for one that what it draws does not reach or does not tell apart.
        """
        ...

    def in_float32(self) -> Self:
        """The same networks, computing in float32 whatever they compute in now."""
        ...

    def as_module(self) -> nn.Module:
        """All of prediction as one module in float32 on the CPU, ready to be traced.

        From (B, c, S, S) pixels in [0, 1], grey or RGB, to counts and tactile images, (B, R, C),
        counts. Its networks are copies.
        """
        ...
