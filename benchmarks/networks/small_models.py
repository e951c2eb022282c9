"""Small models of a task, and their scores.

A model is a perceptron with two hidden layers. It predicts one of several classes, or numbers. Its
settings are fixed. The errors of several models with different initial weights are averaged.

The score of a model is 1 - error / error of an answer that does not use the input: 1 for a perfect
model, 0 for that answer. For classes, the error is the share of wrong classes, averaged over the
classes, and the answer is a guess. For numbers, the error is the root mean square, and the answer
the training mean. The share kept is the ratio of two scores of one model.

Shape letters: P examples, n inputs, d numbers or classes, K models, B resamples.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.translate.evaluation.metrics import interval, resample_weights

HIDDEN = 128
"""Width of both hidden layers (assumed)."""

STEPS, BATCH = 2000, 128
"""Steps of a training, and examples of each (assumed; with a fifth of the steps the score of slip
on held-out training shapes is a third lower, measured)."""

LEARNING_RATE, WEIGHT_DECAY = 2e-3, 1.0
"""AdamW's, with a cosine schedule to zero (chosen as STEPS: a decay of 0.01 is slightly worse)."""

COMPONENTS = 256
"""Principal components to which inputs of more numbers are reduced (they have 98 % of the variance
of the maps of images, measured)."""

MODELS, SEED = 3, 0
"""Number of models of a task, which differ by their initial weights and batches, and the seed."""

MIN_SCORE = 0.05
"""Least score of which a share is given (assumed)."""

MIN_SPREAD = 1e-6
"""Least standard deviation by which an input is divided (assumed: inputs that do not vary)."""


@dataclass(frozen=True)
class Labels:
    """What a task asks for.

    values: (P,) classes from 0, or (P, d) numbers. classes: number of classes, None for numbers.
    """

    values: np.ndarray
    classes: int | None = None

    def __len__(self) -> int:
        return len(self.values)


class Scaling:
    """Shift and scale of inputs, (P, n), and for large n their principal components."""

    def __init__(self, inputs: np.ndarray) -> None:
        self._shift, scale = _standard(inputs)
        self._matrix = np.diag(1.0 / scale)
        if inputs.shape[1] > COMPONENTS:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(SEED)
                scaled = torch.from_numpy((inputs - self._shift) / scale)
                basis = torch.pca_lowrank(scaled, COMPONENTS, center=False)[2].numpy()
            self._matrix = basis / scale[:, None] / (scaled.numpy() @ basis).std()

    def __call__(self, inputs: np.ndarray) -> torch.Tensor:
        """(P, m) float32, of mean 0. Each number has variance 1, of components all together."""
        return torch.from_numpy((inputs - self._shift) @ self._matrix).float()


class SmallModels:
    """MODELS models of a task, which are trained together. inputs: (P, n). labels: (P,) of them."""

    def __init__(self, inputs: np.ndarray, labels: Labels) -> None:
        self.classes, self._scaling = labels.classes, Scaling(inputs)
        values = labels.values if self.classes is None else np.eye(self.classes)[labels.values]
        self._mean, self._spread = _standard(values)
        target = values if self.classes is not None else (values - self._mean) / self._spread
        known, generator = self._scaling(inputs), torch.Generator().manual_seed(SEED)
        self._layers = [
            tuple(_uniform((MODELS, rows, after), before**-0.5, generator) for rows in (before, 1))
            for before, after in pairwise((known.shape[1], HIDDEN, HIDDEN, values.shape[1]))
        ]
        self._fit(known, torch.from_numpy(target).float(), generator)

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """(K, P) classes or (K, P, d) numbers of inputs, (P, n), by K models."""
        known = self._scaling(inputs)
        with torch.no_grad():
            found = self._outputs(known.expand(MODELS, *known.shape)).double().numpy()
        return found.argmax(axis=-1) if self.classes else self._mean + self._spread * found

    def _outputs(self, values: torch.Tensor) -> torch.Tensor:
        """(K, B, d) of (K, B, n)."""
        for number, (weights, bias) in enumerate(self._layers):
            values = torch.baddbmm(bias, values.relu() if number else values, weights)
        return values

    def _fit(self, inputs: torch.Tensor, target: torch.Tensor, generator: torch.Generator) -> None:
        weights = None
        if self.classes is not None:  # the classes have equal weight
            weights = len(target) / (self.classes * target.sum(dim=0).clamp(min=1.0))
        parameters = [each for layer in self._layers for each in layer]
        optimizer = torch.optim.AdamW(
            parameters, LEARNING_RATE, weight_decay=WEIGHT_DECAY, fused=True
        )
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
        for _ in range(STEPS):
            batch = torch.randint(len(inputs), (MODELS, BATCH), generator=generator)
            found, wanted = self._outputs(inputs[batch]), target[batch]
            if weights is None:
                loss = functional.mse_loss(found, wanted)
            else:
                loss = functional.cross_entropy(found.flatten(0, 1), wanted.flatten(0, 1), weights)
            optimizer.zero_grad()
            (MODELS * loss).backward()  # the sum of the models' losses
            optimizer.step()
            schedule.step()


def _uniform(size: tuple[int, ...], high: float, generator: torch.Generator) -> torch.Tensor:
    """Initial weights, uniform from -high to high, as those of a linear layer of PyTorch."""
    return torch.empty(size).uniform_(-high, high, generator=generator).requires_grad_()


def _standard(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of each column."""
    return values.mean(axis=0), np.maximum(values.std(axis=0), MIN_SPREAD)


@dataclass(frozen=True)
class Errors:
    """Errors of models on P examples, and of the answer without input.

    own, trivial: (P,) squared errors, or whether the class is wrong; trivial is the mean over all
    guesses. weights: (P,). is_squared: whether they are squared.
    """

    own: np.ndarray
    trivial: np.ndarray
    weights: np.ndarray
    is_squared: bool

    def scores(self, shapes: np.ndarray) -> np.ndarray:
        """The score, then that in each resample of the shapes: (1 + B,). shapes: (P,) names."""
        _, place = np.unique(shapes, return_inverse=True)
        number = int(place.max()) + 1
        own, trivial = (
            np.bincount(place, self.weights * each, number) for each in (self.own, self.trivial)
        )
        resamples = np.concatenate([np.ones((1, number)), resample_weights(number)])
        ratio = (resamples @ own) / (resamples @ trivial)
        return 1.0 - (np.sqrt(ratio) if self.is_squared else ratio)

    def score(self, shapes: np.ndarray) -> dict[str, Any]:
        """The score with its interval over shapes, and the error: percent of wrong classes, or
        RMSE. shapes: as for `scores`."""
        values, error = self.scores(shapes), float(np.average(self.own, weights=self.weights))
        return {
            "score": float(values[0]),
            "interval": interval(values[1:]),
            "error": float(np.sqrt(error)) if self.is_squared else 100.0 * error,
        }


def errors_of(answers: np.ndarray, labels: Labels, train_labels: Labels) -> Errors:
    """Errors of the answers of several models, averaged over them.

    answers: (K, P) or (K, P, d), as of `SmallModels.predict`. train_labels: of their training.
    Raises T2TwinError if not all classes occur.
    """
    true = labels.values
    if labels.classes is None:
        own = np.mean([np.square(each - true).sum(axis=1) for each in answers], axis=0)
        trivial = np.square(train_labels.values.mean(axis=0) - true).sum(axis=1)
        return Errors(own, trivial, np.ones(len(true)), is_squared=True)
    own = np.mean([each != true for each in answers], axis=0)
    numbers = np.bincount(true, minlength=labels.classes)
    if not numbers.all():
        # A guess among classes that do not occur would be easier or harder than it seems.
        raise T2TwinError(
            f"{int((numbers > 0).sum())} of {labels.classes} classes occur in the examples of a "
            "split; expected all"
        )
    trivial = np.full(len(true), 1.0 - 1.0 / labels.classes)
    return Errors(own, trivial, 1.0 / numbers[true], is_squared=False)


def share_kept(kept: Errors, full: Errors, shapes: np.ndarray) -> dict[str, Any]:
    """The score of some errors over that of others, percent, with its interval over shapes; None
    for a model without use. shapes: (P,) names."""
    of, whole = kept.scores(shapes), full.scores(shapes)
    if whole[0] < MIN_SCORE:
        return {"percent": None, "interval": None}
    ratio = 100.0 * of / whole
    return {"percent": float(ratio[0]), "interval": interval(ratio[1:])}
