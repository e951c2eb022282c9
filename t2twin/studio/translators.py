"""Trained runs by name: the pretrained one, and those found in folders. They are loaded when they
are first asked for, and shared by all clients.

What needs torch, or the twin, is imported when it is first used: a page need not wait for it. Shape
letters: R rows and C columns of a tactile image, N taxels of a run.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.sim.cyskin.layout import Layout
    from t2twin.translate.inference.predictor import CountsPredictor
    from t2twin.translate.uncertainty.estimate import Estimate
    from t2twin.twin import Touch

RUNS = Path("runs")
"""Where trainings are by default."""

MAKE_ONE = "make demo"
"""What makes runs where there are none."""


LEVEL = 0.9
"""Probability of the intervals that are shown."""


@dataclass(frozen=True)
class CountInterval:
    """A predicted value, N, with the ends of its interval of LEVEL."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Translation:
    """The prediction of a run for one picture.

    model: "field", "resnet18" or "touch2touch". counts: (N,) float32. layout: the run's own taxels.
    tactile_image: (R, C) float32, counts. familiar: whether the picture is like those that the run
    was trained on. truth: (N,) float64, what the CySkin counted at those taxels, None where it is
    not known. interval: (N,) float32 each, the ends of the counts' intervals of LEVEL, and force:
    the predicted one; None of a run that has none. compared: whether the run compared the picture
    with a background frame.
    """

    name: str
    model: str
    counts: np.ndarray
    layout: "Layout"
    tactile_image: np.ndarray
    familiar: bool
    milliseconds: float
    truth: np.ndarray | None = None
    interval: tuple[np.ndarray, np.ndarray] | None = None
    force: CountInterval | None = None
    compared: bool = False

    @property
    def covered(self) -> int | None:
        """How many taxels' true counts lie within their intervals."""
        if self.truth is None or self.interval is None:
            return None
        low, high = (np.rint(end) for end in self.interval)
        return int(((np.rint(self.truth) >= low) & (np.rint(self.truth) <= high)).sum())

    @property
    def rmse_counts(self) -> float | None:
        """Root of the mean squared error over the taxels, counts."""
        if self.truth is None:
            return None
        return float(np.sqrt(np.mean(np.square(self.counts - self.truth))))

    @property
    def rmse_percent(self) -> float | None:
        """The same, percent of full scale."""
        from t2twin.sim.cyskin.taxels import FULL_SCALE_COUNTS

        rmse = self.rmse_counts
        return None if rmse is None else 100.0 * rmse / FULL_SCALE_COUNTS


class Translators:
    """Runs by name, none before `search`. Several threads may use one.

    are_known: whether there will be no others without another search.
    """

    def __init__(self) -> None:
        self.are_known = False
        self._folders: dict[str, Path] = {}
        self._models: dict[str, str] = {}
        self._first: tuple[str, ...] = ()
        self._given: tuple[str, ...] = ()
        self._loaded: dict[str, CountsPredictor] = {}
        self._loading = Lock()

    def search(self, given: Sequence[Path] = (), below: Path = RUNS) -> None:
        """Takes the pretrained run, the runs that are given, and those found in a folder and below.

        Raises T2TwinError for a given folder that is no run or one that gives no counts; one found
        that cannot be read or gives none is left out.
        """
        from t2twin.translate.runs.config import BEST, CONFIG
        from t2twin.translate.runs.pretrained import DEFAULT_RUN, pretrained_runs, resolve_run

        first = [DEFAULT_RUN] if DEFAULT_RUN in pretrained_runs() else []
        folders = {_name(folder): folder for folder in map(resolve_run, (*first, *given))}
        models = {name: _model_of(folder) for name, folder in folders.items()}
        self._first, self._given = tuple(folders)[: len(first)], tuple(folders)[len(first) :]
        weights = [path.with_name(BEST) for path in below.glob("**/" + CONFIG)]
        there = [path for path in weights if path.is_file()]
        for path in sorted(there, key=lambda path: -path.stat().st_mtime):
            try:
                model = _model_of(path.parent)
            except T2TwinError:
                continue
            if folders.setdefault(_name(path.parent), path.parent) == path.parent:
                models[_name(path.parent)] = model
        self._folders, self._models = folders, models
        self.are_known = True

    @property
    def names(self) -> tuple[str, ...]:
        """The pretrained one, those given, then those found, the newest first."""
        return tuple(self._folders)

    @property
    def chosen(self) -> tuple[str, ...]:
        """Those that a new page uses: the pretrained one, and the given ones, else the newest of
        each other model."""
        if self._given:
            return (*self._first, *self._given)
        newest: dict[str, str] = {}
        for name, model in self._models.items():
            newest.setdefault(model, name)
        return tuple(newest.values())

    def are_loaded(self, runs: Sequence[str]) -> bool:
        """Whether these translate at once."""
        return all(name in self._loaded for name in runs)

    def load(self, runs: Sequence[str]) -> None:
        """Loads these. Raises T2TwinError for a run that cannot be loaded."""
        for name in runs:
            self._run(name)

    def of_touch(
        self, touch: "Touch", runs: Sequence[str], background: np.ndarray | None = None
    ) -> tuple[Translation, ...]:
        """The predictions of these runs for a touch's picture, with the truth at each one's taxels.

        background: as for `of_image`. Raises T2TwinError for a run that cannot be loaded.
        """
        return tuple(self._translated(name, touch.image, touch, background) for name in runs)

    def of_image(
        self, image: np.ndarray, runs: Sequence[str], background: np.ndarray | None = None
    ) -> tuple[Translation, ...]:
        """The predictions of these runs for a frame, (h, w, 3) or (h, w) uint8, whose truth is not
        known.

        background: a frame of the same DIGIT with nothing touching it, for field runs.
        Raises T2TwinError for a run that cannot be loaded.
        """
        return tuple(self._translated(name, image, None, background) for name in runs)

    def _translated(
        self, name: str, image: np.ndarray, touch: "Touch | None", background: np.ndarray | None
    ) -> Translation:
        from t2twin.sim.cyskin.layout import PAD_DIAMETER_MM, Layout
        from t2twin.translate.inference.field_predictor import FieldPredictor

        run = self._run(name)
        started = time.perf_counter()
        data, interval, force = run.config.data, None, None
        compared = isinstance(run, FieldPredictor) and background is not None
        pixels = run.pixels_of(image, background if compared else None)
        if isinstance(run, FieldPredictor):
            estimate = run.estimate_pixels(pixels)
            counts, tactile = estimate.counts, run.field_images(estimate)[0]
            low, high = estimate.interval(LEVEL)
            interval, force = (low[0], high[0]), _force(estimate)
        else:
            counts, tactile = run.counts_and_tactile_images(pixels)
        milliseconds = 1e3 * (time.perf_counter() - started)
        pads = np.full(data.x_mm.size, PAD_DIAMETER_MM)
        layout = Layout(data.layout, data.x_mm, data.y_mm, pads)
        return Translation(
            name,
            run.config.model,
            counts[0],
            layout,
            tactile[0],
            bool(run.in_distribution(pixels)[0]),
            milliseconds,
            None if touch is None else _truth(touch, layout),
            interval,
            force,
            compared,
        )

    def _run(self, name: str) -> "CountsPredictor":
        from t2twin.translate.inference.load import load_run

        with self._loading:
            if name not in self._folders:
                raise T2TwinError(f"there is no run {name!r} any more; load the page again")
            if name not in self._loaded:
                run = load_run(self._folders[name])
                run.predict(np.zeros((320, 240, 3), np.uint8))  # the first is slow
                self._loaded[name] = run
            return self._loaded[name]


def _name(folder: Path) -> str:
    """A run's name: its folder and the one above it, as trainings are laid out; a pretrained one
    has that by which commands call it."""
    from t2twin.translate.runs.pretrained import HOME

    folder = folder.absolute()
    return folder.name if folder.parent == HOME.absolute() else "/".join(folder.parts[-2:])


def _force(estimate: "Estimate") -> CountInterval | None:
    """The predicted force of one image; None of a run whose presses had one force."""
    from t2twin.translate.uncertainty.estimate import half_width

    if estimate.force_n is None or estimate.force_std_n is None:
        return None
    value, half = float(estimate.force_n[0]), half_width(LEVEL) * float(estimate.force_std_n[0])
    return CountInterval(value, max(value - half, 0.0), value + half)


def _model_of(folder: Path) -> str:
    """Raises T2TwinError for a folder that is no run, and for a run that gives no counts."""
    from t2twin.translate.inference.load import check_predicts_counts
    from t2twin.translate.runs.config import load_config

    config = load_config(folder)
    check_predicts_counts(folder, config, "the studio")
    return config.model


def _truth(touch: "Touch", layout: "Layout") -> np.ndarray:
    """What the CySkin counts at a layout's taxels: as read where it is the touch's own, else
    without noise."""
    from t2twin.sim.cyskin import taxels

    own = np.stack([touch.layout.x_mm, touch.layout.y_mm])
    asked = np.stack([layout.x_mm, layout.y_mm])
    if own.shape == asked.shape and np.allclose(own, asked):
        return touch.counts.astype(float)
    return taxels.counts(taxels.pad_pressure_mpa(touch.cyskin, layout))
