"""What the pages of a studio share: trained runs by name, the sensors and a source of frames.

Runs are loaded on first use and shared by all clients. torch is imported on first use, so that a
page does not wait for it. Shape letters: R rows and C columns of a tactile image, N taxels.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from threading import Event, Lock
from typing import TYPE_CHECKING

import numpy as np

from t2twin.core.errors import T2TwinError

if TYPE_CHECKING:
    from t2twin.live.sources import LatestFrame, Source
    from t2twin.sim.dataset.info import ArrayInfo
    from t2twin.sim.sensors.pair import SensorPair
    from t2twin.sim.taxels.layout import Layout
    from t2twin.sim.touch import Touch
    from t2twin.translate.inference.contact import ContactEstimate
    from t2twin.translate.inference.predictor import TrainedTranslator
    from t2twin.translate.uncertainty.estimate import Estimate

RUNS = Path("runs")
"""Default folder of trained runs."""

LEVEL = 0.9
"""Nominal coverage of the intervals."""


@dataclass(frozen=True)
class Translation:
    """The prediction of a run for one image.

    model: "field", "resnet18" or "touch2touch". counts: (N,) float32. layout: taxels of the run.
    tactile_image: (R, C) float32, counts. px_per_mm: its scale. in_distribution: whether the image
    resembles the training images. truth: (N,) float64, true counts at these taxels, None if
    unknown. interval: lower and upper bounds of the counts, (N,) float32 each, and force: value and
    bounds, N, None for runs without uncertainty. background_used: whether the run received a
    background frame. contact: None for runs that do not predict it.
    """

    name: str
    model: str
    counts: np.ndarray
    layout: "Layout"
    tactile_image: np.ndarray
    in_distribution: bool
    px_per_mm: float
    truth: np.ndarray | None = None
    interval: tuple[np.ndarray, np.ndarray] | None = None
    force: tuple[float, float, float] | None = None
    background_used: bool = False
    contact: "ContactEstimate | None" = None

    @property
    def covered(self) -> int | None:
        """Number of taxels whose interval covers the true count."""
        if self.truth is None or self.interval is None:
            return None
        low, high = (np.rint(end) for end in self.interval)
        return int(((np.rint(self.truth) >= low) & (np.rint(self.truth) <= high)).sum())

    @property
    def rmse_counts(self) -> float | None:
        """RMSE over the taxels, counts."""
        if self.truth is None:
            return None
        return float(np.sqrt(np.mean(np.square(self.counts - self.truth))))


NamedFrame = tuple[np.ndarray, str]
"""A frame, (h, w, 3) or (h, w) uint8, and its name."""


class Translators:
    """Runs by name. Several threads may use one instance.

    names: the pretrained run, given runs, then found runs, the latest first. default_names: runs of
    a new page. is_searched: whether `search` is complete; there are no runs before.
    """

    def __init__(self) -> None:
        self.is_searched = False
        self.names: tuple[str, ...] = ()
        self.default_names: tuple[str, ...] = ()
        self._folders: dict[str, Path] = {}
        self._loaded: dict[str, TrainedTranslator] = {}
        self._loading = Lock()

    def search(self, given: Sequence[Path] = (), below: Path = RUNS) -> None:
        """Finds the pretrained run, the given runs, and runs in a folder and its subfolders.

        The default names are the pretrained run with the given runs or, without these, with the
        latest run of each other model. Raises T2TwinError for a given folder that is not a run or
        does not predict counts. Such folders are ignored in the search.
        """
        from t2twin.translate.runs.config import (
            BEST,
            CONFIG,
            DEFAULT_RUN,
            pretrained_runs,
            resolve_run,
        )

        pretrained = [DEFAULT_RUN] if DEFAULT_RUN in pretrained_runs() else []
        folders = {_name(folder): folder for folder in map(resolve_run, (*pretrained, *given))}
        models = {name: _model_of(folder) for name, folder in folders.items()}
        fixed = tuple(folders) if given else ()
        weights = [path.with_name(BEST) for path in below.glob("**/" + CONFIG)]
        existing = [path for path in weights if path.is_file()]
        for path in sorted(existing, key=lambda path: -path.stat().st_mtime):
            name = _name(path.parent)
            with suppress(T2TwinError):
                if name not in folders:
                    models[name], folders[name] = _model_of(path.parent), path.parent
        latest: dict[str, str] = {}
        for name, model in models.items():
            latest.setdefault(model, name)
        self._folders, self.names = folders, tuple(folders)
        self.default_names = fixed or tuple(latest.values())
        self.is_searched = True

    def are_loaded(self, runs: Sequence[str]) -> bool:
        """Whether all of these runs are loaded."""
        return all(name in self._loaded for name in runs)

    def load(self, runs: Sequence[str]) -> None:
        """Loads runs. Raises T2TwinError for a run that cannot be loaded."""
        for name in runs:
            self._load(name)

    def translate(
        self,
        image: np.ndarray,
        runs: Sequence[str],
        background: np.ndarray | None = None,
        touch: "Touch | None" = None,
    ) -> tuple[Translation, ...]:
        """Predictions of these runs for a frame, (h, w, 3) or (h, w) uint8.

        background: background frame of the same sensor, for field runs. touch: of the frame, for
        the true counts. Raises T2TwinError for a run that cannot be loaded.
        """
        return tuple(self._translate(name, image, background, touch) for name in runs)

    def _translate(
        self, name: str, image: np.ndarray, background: np.ndarray | None, touch: "Touch | None"
    ) -> Translation:
        """The prediction of one run."""
        from t2twin.translate.uncertainty.ood import OODClass

        run, interval, force = self._load(name), None, None
        data, own = run.config.data.array, background if run.has_uncertainty else None
        estimate = run.estimate(image, own, tactile=True, contact=run.predicts_contact)
        if run.has_uncertainty:
            interval, force = estimate.interval(LEVEL), _force(estimate)
        return Translation(
            name=name,
            model=run.config.model,
            counts=estimate.counts,
            layout=data.taxels,
            tactile_image=estimate.tactile_images,
            in_distribution=estimate.ood_class == OODClass.IN_DISTRIBUTION,
            px_per_mm=data.tactile_image[2],
            truth=None if touch is None else _truth(touch, data),
            interval=interval,
            force=force,
            background_used=own is not None,
            contact=estimate.contact,
        )

    def _load(self, name: str) -> "TrainedTranslator":
        """A run by its name."""
        from t2twin.translate.inference import load

        with self._loading:
            if name not in self._folders:
                raise T2TwinError(f"there is no run {name!r}; reload the page")
            if name not in self._loaded:
                run = load.load(self._folders[name])
                black = np.zeros((320, 240, 3), np.uint8)
                run.predict_pixels(run.pixels_of(black))  # warm-up: the first is slow
                self._loaded[name] = run
            return self._loaded[name]


def _name(folder: Path) -> str:
    """Name of a run: its folder and the parent folder; of a pretrained run, that of commands."""
    from t2twin.translate.runs.config import HOME

    folder = folder.absolute()
    return folder.name if folder.parent == HOME.absolute() else "/".join(folder.parts[-2:])


def _force(estimate: "Estimate") -> tuple[float, float, float] | None:
    """Predicted force of one image; None for a run that was trained on one force."""
    from t2twin.translate.uncertainty.estimate import half_width

    if estimate.force_n is None or estimate.force_std_n is None:
        return None
    value, half = float(estimate.force_n), half_width(LEVEL) * float(estimate.force_std_n)
    return value, max(value - half, 0.0), value + half


def _model_of(folder: Path) -> str:
    """Model of a run. Raises T2TwinError for a folder that is not a run or predicts no counts."""
    from t2twin.translate.runs.config import load_config

    config = load_config(folder)
    config.need(config.is_image_to_counts, folder, "the studio", "an image-to-counts run")
    return config.model


def _truth(touch: "Touch", data: "ArrayInfo") -> np.ndarray | None:
    """True counts at the taxels of a run; of the touch's own layout with its noise, of any other
    without. None for a touch without an array of the cover and the full scale of the run."""
    if touch.of_array is None:
        return None
    array = touch.of_array.sensor
    cover = replace(array.elastomer, name=data.cover.name)
    if cover != data.cover or array.full_scale != data.full_scale_counts:
        return None
    if data.same_layout(touch.layout.x_mm, touch.layout.y_mm):
        return touch.counts.astype(float)
    return array.noiseless(touch.of_array.contact, data.taxels)


def read_frame(path: Path) -> NamedFrame:
    """Reads an image file. Raises T2TwinError if it is not an image."""
    from t2twin.translate.data.images import open_image

    return np.asarray(open_image(path)), path.name


class Shared:
    """What all pages of a studio share.

    folder: of the clients' files. source: frames to translate, as for `t2twin live`. background:
    background frame of the same sensor. is_ready: set after the first press. is_shown: set after a
    page shows a press. Raises T2TwinError for a source that cannot be opened.
    """

    def __init__(self, folder: Path, source: str | None, background: NamedFrame | None) -> None:
        self.folder, self.source, self.background = folder, source, background
        self.translators, self.is_ready, self.is_shown = Translators(), Event(), Event()
        self._latest: LatestFrame | None = None
        self._frames_lock = Lock()
        self._frames: Source | None = None
        if source is not None:
            from t2twin.live.sources import open_source

            self._frames = open_source(source)

    @cached_property
    def sensors(self) -> "SensorPair":
        """The default sensors, which the pages share."""
        from t2twin.sim.sensors.pair import SensorPair

        return SensorPair()

    def latest_frames(self) -> "LatestFrame":
        """The latest frames of the source from now on; restarts a video that has ended."""
        from t2twin.live.sources import LatestFrame, open_source

        with self._frames_lock:
            if self._latest is None or self._latest.ended:
                assert self.source is not None
                self._latest = LatestFrame(self._frames or open_source(self.source))
                self._frames = None
            return self._latest

    def source_files(self) -> list[Path]:
        """The image files of a source that is a folder, sorted by name; else none."""
        from t2twin.translate.inference.files import find_images

        if self.source is not None and not self.source.isdigit() and Path(self.source).is_dir():
            with suppress(T2TwinError):  # a folder without images so far
                return find_images([self.source])
        return []
