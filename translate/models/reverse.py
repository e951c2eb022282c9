"""touch2touch turned round: pix2pix from the tactile image to the grey DIGIT picture.

The same networks and losses, condition and target having changed places: the generator sees phi of
the counts at the preset's size, scaled so that -1 is nothing and 1 full scale, and draws the grey
picture, -1 black and 1 white.

Shape letters: B batch, S image side, N taxels.
"""

from typing import NoReturn

import torch

from t2twin.core.errors import T2TwinError
from t2twin.sim.cyskin.layout import Layout
from t2twin.translate.data.pairs import Examples
from t2twin.translate.models.touch2touch import Touch2Touch

WHITE_GREY = 255.0
"""The picture's full scale, grey levels."""


class CySkinToDigit(Touch2Touch):
    """The networks of a touch2touch that draws pictures; it gives no counts."""

    draws = False

    def step(self, examples: Examples) -> dict[str, float]:
        """As for Touch2Touch. images: (B, 1, S, S) in [-1, 1], here what is to be drawn."""
        tactile = self.to_image(examples.counts.to(self.device))
        return self.learn(tactile, examples.images.to(self.device))

    def pictures(self, counts: torch.Tensor) -> torch.Tensor:
        """(B, N) counts -> the DIGIT pictures as drawn, (B, 1, S, S), grey levels. In evaluation
        mode."""
        drawn = self.drawn(self.to_image(counts.to(self.device)))
        return (drawn + 1.0) * (WHITE_GREY / 2.0)

    def predict(self, images: torch.Tensor) -> NoReturn:
        """Raises T2TwinError."""
        raise _no_counts()

    def counts_and_tactile_images(self, images: torch.Tensor) -> NoReturn:
        """Raises T2TwinError."""
        raise _no_counts()

    def read_at(self, layout: Layout) -> NoReturn:
        """Raises T2TwinError."""
        raise _no_counts()

    def as_module(self) -> NoReturn:
        """Raises T2TwinError."""
        raise _no_counts()


def _no_counts() -> T2TwinError:
    return T2TwinError("a cyskin-to-digit translator draws DIGIT pictures and gives no counts")
