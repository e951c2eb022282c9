"""Background frames of a split's pairs: DIGIT frames without contact.

The frames are decoded once into a cache, with the index of each pair's frame. A world with a fixed
light has one frame.

Shape letters: P pairs, U frames, S image side.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from PIL import Image

from t2twin.core.cached_files import cached_file
from t2twin.core.images import decode_png
from t2twin.core.progress import Progress
from t2twin.sim.dataset.columns import BACKGROUND
from t2twin.sim.dataset.info import DatasetInfo
from t2twin.sim.dataset.store import iter_images, read_info, split_shards
from t2twin.translate.data.images import to_pixels


@dataclass(frozen=True)
class PairBackgrounds:
    """Background frames of P pairs.

    path: an .npy file of frames, (U, S, S, 3) uint8. index: (P,) the frame of each pair.
    """

    path: Path
    index: np.ndarray

    def __getitem__(self, index: np.ndarray | slice) -> np.ndarray:
        """(b, S, S, 3) uint8, the frames of the pairs with these indices."""
        return np.array(np.load(self.path, mmap_mode="r")[self.index[index]])

    def subset(self, places: np.ndarray) -> "PairBackgrounds":
        """The frames of the pairs with these indices, (b,)."""
        return PairBackgrounds(self.path, self.index[places])

    def mean(self) -> np.ndarray:
        """(S, S, 3) float32, grey levels: the mean of all frames."""
        frames = np.load(self.path, mmap_mode="r")
        total = np.zeros(frames.shape[1:])
        for frame in frames:
            total += frame
        return (total / len(frames)).astype(np.float32)


def load_backgrounds(
    data_dir: Path, split: str, size: int, cache: Path, name: str
) -> PairBackgrounds:
    """The background frames of a split at size x size.

    cache: folder of the decoded frames. name: of the dataset, for their file names. Raises
    T2TwinError if a shard cannot be read.
    """
    info = read_info(data_dir)
    frames = cache / f"{split}-background-{size}-rgb-{name}.npy"
    index = cache / f"{split}-background-{name}.npy"
    cached_file(
        index, (info.pairs[split],), lambda file: np.save(file, _index(data_dir, split, info))
    )
    frame_of_pair = np.load(index)
    cached_file(
        frames,
        (frame_of_pair.max() + 1, size, size, 3),
        lambda file: np.save(file, _decoded(data_dir, split, info, size)),
    )
    return PairBackgrounds(frames, frame_of_pair)


def has_backgrounds(info: DatasetInfo) -> bool:
    """Whether the pairs of a dataset contain background frames."""
    return info.world is not None and info.world.has_more and info.world.untouched_frames


def _index(data_dir: Path, split: str, info: DatasetInfo) -> np.ndarray:
    """(P,) the place of each pair's frame among the frames that differ from the previous one."""
    index, last, frames = np.zeros(info.pairs[split], int), b"", 0
    for place, png in enumerate(_frames(data_dir, split, info)):
        frames += png != last
        index[place], last = frames - 1, png
    return index


def _decoded(data_dir: Path, split: str, info: DatasetInfo, size: int) -> np.ndarray:
    """(U, S, S, 3) the frames that differ from the previous one."""
    distinct = (png for png, _ in groupby(_frames(data_dir, split, info)))
    return np.stack(
        [to_pixels(Image.fromarray(decode_png(png)), size, grey=False) for png in distinct]
    )


def _frames(data_dir: Path, split: str, info: DatasetInfo) -> Iterator[bytes]:
    """PNG bytes in the order of read_split; only the first with a fixed light."""
    shards = split_shards(info, split)
    assert info.world is not None
    if info.world.light.kind == "fixed":
        yield next(iter_images(data_dir, shards[0], BACKGROUND))
        return
    with Progress(
        total=info.pairs[split], desc=f"background frames of {split}", unit="pair",
        disable=info.pairs[split] < 1000,
    ) as bar:  # fmt: skip
        for shard in shards:
            for png in iter_images(data_dir, shard, BACKGROUND):
                yield png
                bar.update()
