"""A translator's step on a GPU, captured once and replayed.

A step of the published ResNet18 launches about a thousand kernels, and launching one takes longer
than most of them compute. A captured step, a CUDA graph, launches all of them at once. It reads its
batch and its learning rates from the same tensors every time.
"""

import torch

from t2twin.translate.data.pairs import Examples
from t2twin.translate.models.base import Translator

EAGER_STEPS = 3
"""Steps before the capture, in which the optimizers make their state and convolutions choose
their algorithms (as CUDA graphs need them)."""


class CapturedStep:
    """The steps of a translator on batches of one size, on a GPU; the first are not replayed."""

    def __init__(self, translator: Translator) -> None:
        torch.backends.cudnn.benchmark = True  # chooses algorithms by their time
        self.translator = translator
        self.eager = EAGER_STEPS
        self.graph: torch.cuda.CUDAGraph | None = None
        self.batch: list[torch.Tensor] = []
        self.losses: dict[str, torch.Tensor] = {}

    def __call__(self, examples: Examples) -> dict[str, torch.Tensor]:
        """One step. The returned losses are overwritten by the next one."""
        if self.eager > 0:
            self.eager -= 1
            losses = self._optimize_on_side_stream(examples)
        else:
            if self.graph is None:
                self._capture(examples)
            losses = self._replay(examples)
        self.translator.update_average()
        return losses

    def _optimize_on_side_stream(self, examples: Examples) -> dict[str, torch.Tensor]:
        """A step on another stream, which PyTorch recommends before a capture."""
        stream, own = torch.cuda.Stream(), torch.cuda.current_stream()
        stream.wait_stream(own)
        with torch.cuda.stream(stream):
            losses = self.translator.optimize(examples)
        own.wait_stream(stream)
        return losses

    def _capture(self, examples: Examples) -> None:
        """Captures a step on copies of a batch, without executing it."""
        kept = {name: each.clone() for name, each in vars(examples).items() if each is not None}
        self.batch = list(kept.values())
        self.graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(self.graph):
            self.losses = self.translator.optimize(Examples(**kept))

    def _replay(self, examples: Examples) -> dict[str, torch.Tensor]:
        assert self.graph is not None
        given = [each for each in vars(examples).values() if each is not None]
        for own, new in zip(self.batch, given, strict=True):
            own.copy_(new)
        self.graph.replay()
        return self.losses
