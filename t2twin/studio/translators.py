"""Trained runs by name: found in folders, loaded when first asked for, shared by all clients.

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
from PIL import Image

from t2twin.primitives_cad.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.sim.cyskin.layout import Layout
    from t2twin.translate.predict import TrainedTranslator
    from t2twin.twin import Touch

RUNS = Path("runs")
"""Where trainings are by default."""

MAKE_ONE = "make demo"
"""What makes runs where there are none."""


@dataclass(frozen=True)
class Translation:
    """What a run makes of one picture.

    model: "resnet18" or "touch2touch". counts: (N,) float32. layout: the run's own taxels.
    tactile_image: (R, C) float32, counts. familiar: whether the picture is like those that the run
    was trained on. truth: (N,) float64, what the CySkin counted at those taxels, None where it is
    not known.
    """

    name: str
    model: str
    counts: np.ndarray
    layout: "Layout"
    tactile_image: np.ndarray
    familiar: bool
    milliseconds: float
    truth: np.ndarray | None = None

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
        self._given: tuple[str, ...] = ()
        self._loaded: dict[str, TrainedTranslator] = {}
        self._loading = Lock()

    def search(self, given: Sequence[Path] = (), below: Path = RUNS) -> None:
        """Takes the runs that are given, and those found in a folder and below it.

        Raises T2TwinError for a given folder that is no run or one that gives no counts; one found
        that cannot be read or gives none is left out.
        """
        from t2twin.translate.runs.config import BEST, CONFIG
        from t2twin.translate.runs.shipped import find_run

        given = [find_run(run) for run in given]
        models = {_name(folder): _model_of(folder) for folder in given}
        folders = {_name(folder): folder for folder in given}
        self._given = tuple(folders)
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
        """Those given, then those found, the newest first."""
        return tuple(self._folders)

    @property
    def chosen(self) -> tuple[str, ...]:
        """Those that a new page uses: the given ones, else the newest of each model."""
        if self._given:
            return self._given
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

    def of_touch(self, touch: "Touch", runs: Sequence[str]) -> tuple[Translation, ...]:
        """What these runs make of a touch's picture, with the truth at each run's taxels.

        Raises T2TwinError for a run that cannot be loaded.
        """
        return tuple(self._translated(name, touch.image, touch) for name in runs)

    def of_image(self, image: np.ndarray, runs: Sequence[str]) -> tuple[Translation, ...]:
        """What these runs make of a frame, (h, w, 3) or (h, w) uint8, whose truth is not known.

        Raises T2TwinError for a run that cannot be loaded.
        """
        return tuple(self._translated(name, image, None) for name in runs)

    def _translated(self, name: str, image: np.ndarray, touch: "Touch | None") -> Translation:
        from t2twin.sim.cyskin.layout import PAD_DIAMETER_MM, Layout
        from t2twin.translate.data.images import to_pixels

        run = self._run(name)
        started = time.perf_counter()
        preset, data = run.config.preset, run.config.data
        pixels = to_pixels(Image.fromarray(image), preset.size, preset.grey)[None]
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
            bool(run.is_familiar(pixels)[0]),
            milliseconds,
            None if touch is None else _truth(touch, layout),
        )

    def _run(self, name: str) -> "TrainedTranslator":
        from t2twin.translate.predict import load_run

        with self._loading:
            if name not in self._folders:
                raise T2TwinError(f"there is no run {name!r} any more; load the page again")
            if name not in self._loaded:
                run = load_run(self._folders[name])
                size, grey = run.config.preset.size, run.config.preset.grey
                # The first is slow.
                run.predict_pixels(np.zeros((1, size, size, 1 if grey else 3), np.uint8))
                self._loaded[name] = run
            return self._loaded[name]


def _name(folder: Path) -> str:
    """What a run goes by: its folder and the one above it, as trainings are laid out."""
    return "/".join(folder.absolute().parts[-2:])


def _model_of(folder: Path) -> str:
    """Raises T2TwinError for a folder that is no run, and for a run that gives no counts."""
    from t2twin.translate.direction import check_gives_counts
    from t2twin.translate.runs.config import load_config

    config = load_config(folder)
    check_gives_counts(folder, config.direction)
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
