"""Depth from gradients by color, for comparison: what owners of gel cameras use today.

A small network predicts the gradients of the depth at each pixel from its color, its change from
the background frame, and its place. Poisson's equation integrates them, with depth 0 at the rim of
the image. The network is trained on presses of one unit with known surfaces.

Shape letters: P presses, R rows and C columns of the reduced images.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import torch
from scipy import fft
from torch import nn

REDUCTION = 2
"""Pixels along each side of a block that is averaged."""

WIDTH, LAYERS = 64, 3
"""Of the network (assumed: as published for this purpose)."""

STEPS, BATCH, RATE = 2000, 4096, 2e-3
"""Of its training (assumed: the error no longer decreases)."""

CHANGE_GREY = 30.0
"""Unit of the change from the background frame, grey levels (assumed: its typical size)."""

CHANGED_GREY, CHANGED_SHARE = 15.0, 0.7
"""Change of a pixel that is in the contact or near it, summed over the colors, and the share of
such pixels in a batch (assumed)."""


class DepthFromGradients:
    """A network trained on presses.

    images: (P, rows, columns, 3) uint8. background: (rows, columns, 3) uint8. depths_mm: (P, R, C)
    of the reduced images. view_mm: half the width and half the height of the view. seed: of weights
    and batches.
    """

    def __init__(
        self,
        images: np.ndarray,
        background: np.ndarray,
        depths_mm: np.ndarray,
        view_mm: tuple[float, float],
        seed: int = 0,
    ) -> None:
        self.background, rows, columns = reduced(background), *depths_mm.shape[1:]
        self.pitch_mm = 2 * view_mm[1] / rows, 2 * view_mm[0] / columns
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            sizes = [8, *[WIDTH] * LAYERS]
            layers = [
                part
                for first, last in pairwise(sizes)
                for part in (nn.Linear(first, last), nn.ReLU())
            ]
            self.network = nn.Sequential(*layers, nn.Linear(WIDTH, 2))
        inputs = np.stack([self._inputs(reduced(image)) for image in images])
        gradients = np.array(np.gradient(depths_mm, *self.pitch_mm, axis=(1, 2)))
        changed = CHANGE_GREY * np.abs(inputs[..., 3:6]).sum(axis=-1).ravel() > CHANGED_GREY
        self._train(
            torch.from_numpy(inputs.reshape(-1, 8)).float(),
            torch.from_numpy(gradients.reshape(2, -1).T.copy()).float(),
            [np.flatnonzero(changed), np.flatnonzero(~changed)],
            np.random.default_rng(seed),
        )

    def _train(
        self,
        inputs: torch.Tensor,
        gradients: torch.Tensor,
        groups: list[np.ndarray],
        rng: np.random.Generator,
    ) -> None:
        optimizer = torch.optim.Adam(self.network.parameters(), RATE)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
        most = round(CHANGED_SHARE * BATCH)
        for _ in range(STEPS):
            sizes = (most, BATCH - most)
            chosen = [rng.choice(each, n) for each, n in zip(groups, sizes, strict=True)]
            index = torch.from_numpy(np.concatenate(chosen))
            loss = (self.network(inputs[index]) - gradients[index]).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()

    def _inputs(self, image: np.ndarray) -> np.ndarray:
        """(R, C, 8): color, change from the background frame, and place of each pixel."""
        rows, columns, _ = image.shape
        places = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
        color, change = image / 128.0 - 1.0, (image - self.background) / CHANGE_GREY
        return np.concatenate([color, change, np.stack(places, axis=-1)], axis=-1)

    def depth_mm(self, image: np.ndarray) -> np.ndarray:
        """(R, C) depth. image: (rows, columns, 3) uint8."""
        inputs = torch.from_numpy(self._inputs(reduced(image))).float()
        with torch.inference_mode():
            down, across = self.network(inputs).double().numpy().transpose(2, 0, 1)
        return integrated(down, across, self.pitch_mm)


def reduced(image: np.ndarray) -> np.ndarray:
    """(R, C, 3): means over blocks of pixels."""
    rows, columns, _ = image.shape
    shape = (rows // REDUCTION, REDUCTION, columns // REDUCTION, REDUCTION, 3)
    return image.reshape(shape).mean(axis=(1, 3))


def integrated(down: np.ndarray, across: np.ndarray, pitch_mm: tuple[float, float]) -> np.ndarray:
    """(R, C) mm: the depth whose gradients are nearest to these, with depth 0 beyond the rim.

    down, across: (R, C) gradients along y and x. pitch_mm: distances of rows and columns.
    """
    divergence = np.gradient(down, pitch_mm[0], axis=0) + np.gradient(across, pitch_mm[1], axis=1)
    waves = [
        (2.0 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1)) - 2.0) / pitch**2
        for size, pitch in zip(down.shape, pitch_mm, strict=True)
    ]
    found = fft.dstn(divergence, type=1) / (waves[0][:, None] + waves[1][None, :])
    return np.asarray(fft.idstn(found, type=1))
