"""The batches of a training: pairs on its device, with augmentation.

Shape letters: B batch, P pairs, S image side, c channels, F places of the dense counts, H side of
the contact maps.
"""

from collections.abc import Callable

import numpy as np
import torch

from t2twin.translate.data.images import (
    COLORS,
    WHITE_GREY,
    augment,
    on_device,
    to_input,
    to_scaled,
)
from t2twin.translate.data.pairs import Examples, ImageFile, Pairs, Pictures
from t2twin.translate.models.presets import Preset

KEPT_SHARE = 0.4
"""Largest share of a GPU's free memory that the pairs of one split may take (assumed: with two, a
third is left for the networks)."""

COPIED = 4096
"""Pairs that are copied to a GPU at a time; bounds memory."""

Values = ImageFile | Pictures | np.ndarray
"""Values of P pairs, by their indices."""


class Batches:
    """The batches of the pairs of one split.

    On a GPU with enough free memory, all pairs are kept there, pictures as uint8, and a batch is
    made there. Otherwise each batch is read and moved to the device.
    """

    def __init__(self, pairs: Pairs, preset: Preset, device: torch.device) -> None:
        self.preset = preset
        # Augmentation is for images of the source; counts and targets stay as they are.
        self.is_augmented = pairs.pictures is None
        self.has_frames = pairs.backgrounds is not None
        self.predicts_images = isinstance(pairs.target, ImageFile)
        all_values: list[Values | None] = [
            pairs.inputs,
            pairs.target,
            *(pairs.dense_counts, pairs.force_n, pairs.shear_n, pairs.contact),
        ]
        kept = _fits(all_values, len(pairs), device)
        self._inputs, self._target, *self._more = (
            None if each is None else _Column(each, len(pairs), device, kept) for each in all_values
        )

    def examples(
        self,
        batch: np.ndarray,
        rng: np.random.Generator | None,
        to_input: Callable[[torch.Tensor], torch.Tensor] = to_input,
    ) -> Examples:
        """The pairs with these indices, (B,); with rng, augmented as the preset defines.

        to_input: the translator's.
        """
        assert self._inputs is not None and self._target is not None
        batch = np.sort(batch)  # the order on disk
        more = [None if each is None else each[batch].float() for each in self._more]
        pixels, preset = self._inputs[batch].float() / WHITE_GREY, self.preset
        if rng is not None and self.is_augmented:
            if preset.background_share and self.has_frames:
                drawn = rng.random(len(batch)) < preset.background_share
                replaced = on_device(np.flatnonzero(drawn), pixels.device)
                pixels[replaced, ..., :COLORS] = pixels[replaced, ..., COLORS:]
                for target in more:
                    if target is not None:
                        target[replaced] = 0.0
            if preset.brightness or preset.contrast or preset.noise or preset.drift:
                pixels = augment(
                    pixels, rng, preset.brightness, preset.contrast, preset.noise, preset.drift
                )
        target = self._target[batch]
        if self.predicts_images:
            target = to_scaled(target.float() / WHITE_GREY)
        return Examples(to_input(pixels), target, *more)

    def readings(self, batch: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
        """The stored pictures and targets of pairs, on the device.

        batch: their indices, (B,). Returns (B, S, S, c) uint8, and (B, N) counts or (B, S, S, c)
        uint8.
        """
        assert self._inputs is not None and self._target is not None
        return self._inputs[batch], self._target[batch]


class _Column:
    """One value of P pairs. kept: whether all are on the device; otherwise each batch is read."""

    def __init__(self, values: Values, pairs: int, device: torch.device, kept: bool) -> None:
        self.device, self.values, self.kept = device, values, None
        if kept:
            one = _tensor(values[:1])
            self.kept = torch.empty((pairs, *one.shape[1:]), dtype=one.dtype, device=device)
            for start in range(0, pairs, COPIED):
                part = slice(start, start + COPIED)
                self.kept[part] = _tensor(values[part])

    def __getitem__(self, index: np.ndarray) -> torch.Tensor:
        """The values of pairs, on the device. index: (B,)."""
        if self.kept is not None:
            return self.kept[on_device(index, self.device)]
        return _tensor(self.values[index]).to(self.device)


def _tensor(values: np.ndarray) -> torch.Tensor:
    """Pictures as uint8, contact maps as float16, other values as float32."""
    if values.dtype not in (np.uint8, np.float16):
        values = values.astype(np.float32, copy=False)
    return torch.from_numpy(values)


def _fits(all_values: list[Values | None], pairs: int, device: torch.device) -> bool:
    """Whether the device is a GPU whose free memory holds values of P pairs."""
    if device.type != "cuda":
        return False
    bytes_each = sum(_tensor(each[:1]).nbytes for each in all_values if each is not None)
    free, _ = torch.cuda.mem_get_info(device)
    return pairs * bytes_each <= KEPT_SHARE * free
