"""Trained runs by name, which all pages of a studio share, and their translations.

Runs are loaded on first use. Shape letters: R rows and C columns of a tactile image, N taxels.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from t2twin.core.errors import T2TwinError
from t2twin.core.frame_order import UPRIGHT, FrameOrder
from t2twin.live.sources import LatestFrame, open_source

if TYPE_CHECKING:
    from t2twin.sim.dataset.info import ArrayInfo
    from t2twin.sim.taxels.layout import Layout
    from t2twin.sim.touch import Touch
    from t2twin.translate.inference.estimate import ContactEstimate
    from t2twin.translate.inference.predictor import TrainedTranslator

RUNS = Path("runs")
"""Default folder of trained runs."""

LEVEL = 0.9
"""Nominal coverage of the intervals."""


@dataclass(frozen=True)
class Translation:
    """The prediction of a run for one image."""

    name: str
    model: str  # "field", "resnet18" or "touch2touch"
    counts: np.ndarray  # (N,) float32
    layout: "Layout"  # taxels of the run
    tactile_image: np.ndarray  # (R, C) float32, counts
    in_distribution: bool | None  # whether the image is like the training images, if compared
    px_per_mm: float  # scale of the tactile image
    truth: np.ndarray | None = None  # (N,) float64, true counts at these taxels, if known
    # Bounds of the counts, (N,) float32 each, and force and its bounds, N, of runs with uncertainty
    interval: tuple[np.ndarray, np.ndarray] | None = None
    force: tuple[float, float, float] | None = None
    background_used: bool = False  # whether the run received a background frame
    contact: "ContactEstimate | None" = None  # None for runs that do not predict it

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


class Translators:
    """The pretrained run, given runs, and runs found in a folder and its subfolders, by name.

    names: in this order, the latest first. default_names: runs of a new page, the pretrained run
    with the given runs or, without these, with the latest run of each other model. Several threads
    may use one instance. Raises T2TwinError for a given folder that is not a run or does not
    predict counts; found ones are ignored.
    """

    def __init__(self, given: Sequence[Path] = (), below: Path = RUNS) -> None:
        from t2twin.translate.runs import config

        self._loaded: dict[str, TrainedTranslator] = {}
        self._loading = Lock()
        default = config.DEFAULT_RUN
        pretrained = [default] if default in config.pretrained_runs() else []
        self._folders = {
            _name(folder): folder for folder in map(config.resolve_run, (*pretrained, *given))
        }
        models = {name: _model_of(folder) for name, folder in self._folders.items()}
        fixed = tuple(self._folders) if given else ()
        weights = [path.with_name(config.BEST) for path in below.glob(f"**/{config.CONFIG}")]
        existing = [path for path in weights if path.is_file()]
        for path in sorted(existing, key=lambda path: -path.stat().st_mtime):
            name = _name(path.parent)
            with suppress(T2TwinError):
                if name not in self._folders:
                    models[name], self._folders[name] = _model_of(path.parent), path.parent
        latest: dict[str, str] = {}
        for name, model in models.items():
            latest.setdefault(model, name)
        self.names, self.default_names = tuple(self._folders), fixed or tuple(latest.values())

    def load(self, name: str) -> "TrainedTranslator":
        """A run by its name. Raises T2TwinError for a run that cannot be loaded."""
        from t2twin.translate.inference import load

        with self._loading:
            if name not in self._folders:
                raise T2TwinError(f"there is no run {name!r}; reload the page")
            if name not in self._loaded:
                run = load.load(self._folders[name])
                black = np.zeros((320, 240, 3), np.uint8)
                run._predict_pixels(run.pixels_of(black))  # warm-up: the first is slow
                self._loaded[name] = run
            return self._loaded[name]

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
        from t2twin.translate.inference.estimate import half_width

        run, interval, force = self.load(name), None, None
        data, own = run.config.data.array, background if run.config.has_uncertainty else None
        estimate = run._classified_estimate(image, own, True, contact=run.config.predicts_contact)
        if run.config.has_uncertainty:
            interval = estimate.interval(LEVEL)
        if estimate.force_n is not None and estimate.force_std_n is not None:
            value, half = float(estimate.force_n), half_width(LEVEL) * float(estimate.force_std_n)
            force = value, max(value - half, 0.0), value + half
        return Translation(
            name,
            run.config.model,
            estimate.counts,
            data.taxels,
            estimate.tactile_images,
            estimate.ood_class.inside,
            data.tactile_image[2],
            None if touch is None else _truth(touch, data),
            interval,
            force,
            own is not None,
            estimate.contact,
        )


def _name(folder: Path) -> str:
    """Name of a run: its folder and the parent folder; of a pretrained run, that of commands."""
    from t2twin.translate.runs.config import HOME

    folder = folder.absolute()
    return folder.name if folder.parent == HOME.absolute() else "/".join(folder.parts[-2:])


def _model_of(folder: Path) -> str:
    """Model of a run. Raises T2TwinError for a folder that is not a run or predicts no counts."""
    from t2twin.translate.runs.config import load_config

    config = load_config(folder)
    config.need(config.is_image_to_counts, folder, "the studio", "an image-to-counts run")
    return config.model


def _truth(touch: "Touch", data: "ArrayInfo") -> np.ndarray | None:
    """True counts at the taxels of a run; of the touch's own layout with its noise, of any other
    without. None for a touch without an array whose counts can be compared with the run's."""
    from t2twin.sim.dataset.generate import sensor_info

    if touch.of_array is None or data.incomparable(sensor_info(touch.of_array.sensor)):
        return None
    if data.same_layout(touch.layout.x_mm, touch.layout.y_mm):
        return touch.counts.astype(float)
    return touch.of_array.sensor.noiseless(touch.of_array.contact, data.taxels)


NamedFrame = tuple[np.ndarray, str]
"""A frame, (h, w, 3) or (h, w) uint8, and its name."""


class Shared:
    """What all pages of a studio share.

    folder: of the clients' files. runs: folders of trained runs; if empty, runs in the folder
    `runs` are found. source: frames to translate, as for `t2twin live`. background: background
    frame of the same sensor. order: of all stored frames. Raises T2TwinError for an invalid run,
    source or image.
    """

    def __init__(
        self, folder: Path, runs: Sequence[Path], source: str | None, background: Path | None,
        order: FrameOrder = UPRIGHT,
    ) -> None:  # fmt: skip
        self.folder, self.source, self._order = folder, source, order
        self.background = None if background is None else self.read_frame(background)
        self._frames = None if source is None else open_source(source, order)
        self._latest: LatestFrame | None = None
        self._translators = Translators(runs) if runs else None
        self._lock = Lock()

    def read_frame(self, path: Path) -> NamedFrame:
        """Reads an image file. Raises T2TwinError if it is not an image."""
        from t2twin.translate.data.images import read_image

        return read_image(path, self._order), path.name

    def translators(self) -> Translators:
        """The translators; imports torch."""
        with self._lock:
            if self._translators is None:
                self._translators = Translators()
            return self._translators

    def latest_frames(self) -> LatestFrame:
        """The latest frames of the source from now on; restarts a video that has ended."""
        with self._lock:
            if self._latest is None or self._latest.ended:
                assert self.source is not None
                self._latest = LatestFrame(self._frames or open_source(self.source, self._order))
                self._frames = None
            return self._latest

    def source_files(self) -> list[Path]:
        """The image files of a source that is a folder, sorted by name; else none."""
        from t2twin.translate.inference.files import find_images

        if self.source is not None and not self.source.isdigit() and Path(self.source).is_dir():
            with suppress(T2TwinError):  # a folder without images so far
                return find_images([self.source])
        return []
