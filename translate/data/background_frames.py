"""The DIGITs' frames while nothing touches them, as a split's pairs hold them.

They are decoded once into a cache beside that of the pictures: the frames, and which of them each
pair's is. Where the light is fixed there is one frame.

Shape letters: P pairs, U frames, S image side.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from t2twin.core.cached_files import add_checksum, is_intact
from t2twin.core.files import atomic_write
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.dataset.columns import UNTOUCHED
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import to_pixels


@dataclass(frozen=True)
class Untouched:
    """Frames in an .npy file, (U, S, S, 3) uint8. of_pair: (P,) which of them is each pair's."""

    path: Path
    of_pair: np.ndarray

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, 3) uint8, those of these pairs."""
        return np.array(np.load(self.path, mmap_mode="r")[self.of_pair[index]])

    def some(self, places: np.ndarray) -> "Untouched":
        """Those of the pairs at these places, (b,)."""
        return Untouched(self.path, self.of_pair[places])

    def mean(self) -> np.ndarray:
        """(S, S, 3) float32, grey levels: the mean of all frames."""
        frames = np.load(self.path, mmap_mode="r")
        total = np.zeros(frames.shape[1:])
        for frame in frames:
            total += frame
        return (total / len(frames)).astype(np.float32)


def load_untouched(data_dir: Path, split: str, size: int, cache: Path, name: str) -> Untouched:
    """A split's frames at size x size. cache: the folder they are kept in. name: of the dataset.

    Raises T2TwinError where a shard cannot be read.
    """
    info = read_info(data_dir)
    frames = cache / f"{split}-untouched-{size}-rgb-{name}.npy"
    of_pair = cache / f"{split}-untouched-{name}.npy"
    if not (_is_whole(frames, size) and is_intact(of_pair)):
        _write(data_dir, split, info, size, frames, of_pair)
    return Untouched(frames, np.load(of_pair))


def has_untouched(info: DatasetInfo) -> bool:
    """Whether a dataset's pairs hold their DIGITs' frames."""
    return info.world is not None and info.world.has_more and info.world.untouched_frames


def _is_whole(path: Path, size: int) -> bool:
    if not is_intact(path):
        return False
    try:
        return np.load(path, mmap_mode="r").shape[1:] == (size, size, 3)
    except Exception:  # what a damaged head raises is of many kinds
        return False


def _write(
    data_dir: Path, split: str, info: DatasetInfo, size: int, frames: Path, of_pair: Path
) -> None:
    """Decodes each frame that differs from the one before it."""
    there: list[np.ndarray] = []
    which = np.zeros(info.pairs[split], int)
    last = b""
    for place, png in enumerate(_frames(data_dir, split, info)):
        if png != last:
            there.append(to_pixels(Image.fromarray(decode_png(png)), size, grey=False))
            last = png
        which[place] = len(there) - 1
    for path, content in ((frames, np.stack(there)), (of_pair, which)):
        with atomic_write(path) as temporary, temporary.open("w+b") as file:
            np.save(file, content)
            add_checksum(file, path.name)


def _frames(data_dir: Path, split: str, info: DatasetInfo) -> Iterator[bytes]:
    """PNG bytes, in the order of read_split; of a fixed light the first alone."""
    shards = split_shards(info, split)
    assert info.world is not None
    if info.world.light.kind == "fixed":
        yield next(iter_images(data_dir, shards[0], UNTOUCHED))
        return
    with Progress(
        total=info.pairs[split], desc=f"untouched frames of {split}", unit="pair",
        disable=info.pairs[split] < 1000,
    ) as bar:  # fmt: skip
        for shard in shards:
            for png in iter_images(data_dir, shard, UNTOUCHED):
                yield png
                bar.update()
