"""The DIGIT's background frame that field runs compare the images of a dataset with.

Shape letters: S image side.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import read_info, sha256_of
from t2twin.sim.digit.calibration import DEFAULT_PATH
from t2twin.sim.digit.optics import DigitOptics
from t2twin.translate.data.background_frames import has_backgrounds
from t2twin.translate.data.images import open_image, to_pixels

OF_PAIRS, OF_CALIBRATION = "each pair's own", "that of the default calibration"
"""Sources of frames that are not files."""


@dataclass(frozen=True)
class FixedBackground:
    """One background frame for all pairs: frame, (S, S, 3) uint8."""

    frame: np.ndarray

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(S, S, 3) uint8, for any choice of pairs."""
        return self.frame


@dataclass(frozen=True)
class Background:
    """Background frames of a dataset.

    source: in words. image: one frame for all pairs, or None if each pair has its own.
    """

    source: str
    image: Image.Image | None

    def at_size(self, size: int) -> FixedBackground | None:
        """The frame at size x size, or None if each pair has its own."""
        if self.image is None:
            return None
        return FixedBackground(to_pixels(self.image, size, grey=False))


def background_of(data_dir: Path, file: str | Path | None = None) -> Background | None:
    """The background frames of a dataset, None if none are known.

    They are those of the pairs, if the pairs have them. Otherwise they are `file`, an image of the
    DIGIT without contact, or the frame of the default calibration, if all images were made with it.
    Raises T2TwinError for a file that is not an image, and for one with pairs that have their own.
    """
    info = read_info(data_dir)
    if has_backgrounds(info):
        if file is not None:
            raise T2TwinError(
                f"the pairs in {data_dir} contain their own background frames; --background is for "
                "datasets without them"
            )
        return Background(OF_PAIRS, None)
    if file is not None:
        return Background(str(file), open_image(arguments.path(file, "background")))
    if is_of_default_calibration(info):
        return Background(OF_CALIBRATION, Image.fromarray(DigitOptics.load().background))
    return None


def is_of_default_calibration(info: DatasetInfo) -> bool:
    """Whether all images of a dataset were made with the default calibration."""
    if info.parameters is None or not (info.world is None or info.world.light.kind == "fixed"):
        return False
    return info.parameters.digit.calibration_sha256 == sha256_of(DEFAULT_PATH)
