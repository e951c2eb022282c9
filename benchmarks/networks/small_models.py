"""Small models of a task, and their scores.

A model is a perceptron with two hidden layers. It predicts one of several classes, or numbers. Its
settings are fixed. Several models with different seeds are trained, and their errors averaged.

The score of a model is 1 - error / error of an answer that does not use the input: 1 for a perfect
model, 0 for that answer. For classes, the error is the share of wrong classes, averaged over the
classes, and the answer is a guess. For numbers, the error is the root mean square, and the answer
the training mean. The share kept is the ratio of two scores of one model.

Shape letters: P examples, n inputs, d numbers or classes, K seeds, B resamples.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from t2twin.core.errors import T2TwinError
from t2twin.translate.evaluation.array_errors import interval, resample_weights

HIDDEN = 128
"""Width of both hidden layers (assumed)."""

EPOCHS, BATCH = 30, 256
"""Epochs of a training, and examples of a step (assumed)."""

LEARNING_RATE, WEIGHT_DECAY = 2e-3, 1.0
"""AdamW's, with a cosine schedule to zero. The decay was chosen on training shapes (measured: the
family of held-out versions of primitives, of decays 0.01 and 1)."""

SEEDS = (0, 1, 2)
"""Seeds of the models of a task."""

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


class SmallModel:
    """A model of a task. inputs: (P, n). labels: of as many examples."""

    def __init__(self, inputs: np.ndarray, labels: Labels, seed: int) -> None:
        self.classes = labels.classes
        self._shift, self._scale = _standard(inputs)
        values = labels.values if self.classes is None else np.eye(self.classes)[labels.values]
        self._mean, self._spread = _standard(values)
        outputs = values.shape[1]
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self._network = nn.Sequential(
                nn.Linear(inputs.shape[1], HIDDEN), nn.ReLU(),
                nn.Linear(HIDDEN, HIDDEN), nn.ReLU(),
                nn.Linear(HIDDEN, outputs),
            )  # fmt: skip
        target = values if self.classes is not None else (values - self._mean) / self._spread
        self._fit(self._standardized(inputs), torch.from_numpy(target).float(), seed)

    def predict(self, inputs: np.ndarray) -> np.ndarray:
        """(P,) classes or (P, d) numbers of inputs, (P, n)."""
        with torch.no_grad():
            found = self._network(self._standardized(inputs)).double().numpy()
        return found.argmax(axis=1) if self.classes else self._mean + self._spread * found

    def _standardized(self, inputs: np.ndarray) -> torch.Tensor:
        return torch.from_numpy((inputs - self._shift) / self._scale).float()

    def _fit(self, inputs: torch.Tensor, target: torch.Tensor, seed: int) -> None:
        weights = None
        if self.classes is not None:  # the classes have equal weight
            weights = len(target) / (self.classes * target.sum(dim=0).clamp(min=1.0))
        optimizer = torch.optim.AdamW(
            self._network.parameters(), LEARNING_RATE, weight_decay=WEIGHT_DECAY
        )
        steps = EPOCHS * -(-len(inputs) // BATCH)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
        generator = torch.Generator().manual_seed(seed)
        for _ in range(EPOCHS):
            for batch in torch.randperm(len(inputs), generator=generator).split(BATCH):
                found = self._network(inputs[batch])
                if weights is None:
                    loss = functional.mse_loss(found, target[batch])
                else:
                    loss = functional.cross_entropy(found, target[batch], weights)
                optimizer.zero_grad()
                loss.backward()
                optimizer.step()
                schedule.step()


def _standard(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation of each column."""
    return values.mean(axis=0), np.maximum(values.std(axis=0), MIN_SPREAD)


def train(inputs: np.ndarray, labels: Labels) -> list[SmallModel]:
    """The models of a task, one for each seed. inputs: (P, n)."""
    return [SmallModel(inputs, labels, seed) for seed in SEEDS]


@dataclass(frozen=True)
class Score:
    """A score with its interval over shapes, and the error: percent of wrong classes, or RMSE."""

    score: float
    interval: tuple[float, float] | None
    error: float


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

    def score(self, shapes: np.ndarray) -> Score:
        """The score. shapes: as for `scores`."""
        values, error = self.scores(shapes), float(np.average(self.own, weights=self.weights))
        return Score(
            float(values[0]),
            interval(values[1:]),
            float(np.sqrt(error)) if self.is_squared else 100.0 * error,
        )


def errors_of(answers: Sequence[np.ndarray], labels: Labels, train_labels: Labels) -> Errors:
    """Errors of the answers of several models, averaged over them.

    answers: (P,) or (P, d) of each model, as `SmallModel.predict` returns them. train_labels: of
    their training. Raises T2TwinError if not all classes occur.
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


@dataclass(frozen=True)
class Share:
    """A share kept, percent, with its interval over shapes. None for a model without use."""

    percent: float | None
    interval: tuple[float, float] | None


def share_kept(kept: Errors, full: Errors, shapes: np.ndarray) -> Share:
    """The score of some errors over that of others. shapes: (P,) names."""
    of, whole = kept.scores(shapes), full.scores(shapes)
    if whole[0] < MIN_SCORE:
        return Share(None, None)
    ratio = 100.0 * of / whole
    return Share(float(ratio[0]), interval(ratio[1:]))
