"""A small data set of spots for the translators' tests: made in milliseconds, and learnable.

A bright spot on the image lies where the array is pressed, and its brightness grows with force;
the array's response is a Gaussian about the same place. Written through the data set's own writer.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from kinds import COVER

from t2twin.core.images import encode_png
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.dataset.columns import schema_of
from t2twin.sim.dataset.info import ArrayInfo, CameraInfo, DatasetInfo, Shard, versions
from t2twin.sim.dataset.store import write_info, write_shard
from t2twin.sim.sampling.plan import shard_path
from t2twin.sim.sampling.recipe import PAPER, load_recipe
from t2twin.sim.taxels.layout import load_layout
from t2twin.translate.training.train import Trainer, train

ROWS, COLUMNS = 320, 240
FULL_SCALE = 40_000
LAYOUT = "cyskin-20"
VALUES = {"source": "image", "target": "counts"}
PX_PER_MM = 8.0
SPOT_MM = 3.0
RESPONSE_MM = 5.0
PEAK_COUNTS = 30000.0
FORCE_N = 8.0

SHAPES = (
    ("train", "square-1", "square"),
    ("val", "square-3", "square"),
    ("test", "pliers/jaw-tip", "pliers"),
)


def write_spots(
    folder: Path, train: int = 32, val: int = 12, test: int = 8, seed: int = 0,
    forces_n: Sequence[float] = (8.0,), scale: str | None = "smoke",
) -> Path:  # fmt: skip
    """A whole data set with so many pairs a split, of these forces in turn. Returns its folder.

    Light and counts grow with the force; at 0 N nothing is touched. scale: None of imported pairs.
    """
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    shards = {}
    for (split, shape, family), pairs in zip(SHAPES, (train, val, test), strict=True):
        if not pairs:
            continue
        path = shard_path(split, shape)
        forces = islice(cycle(forces_n), pairs)
        rows = [_spot(shape, family, split, n, rng, force) for n, force in enumerate(forces)]
        shards[path] = Shard(write_shard(folder / path, rows, schema_of(VALUES, None)), pairs)
    write_info(
        folder,
        DatasetInfo(
            complete=True,
            pairs={"train": train, "val": val, "test": test},
            source=camera_info("digit", ROWS, COLUMNS),
            target=array_info("cyskin-20", FULL_SCALE),
            versions=versions(),
            shards=shards,
            scale=scale,
            seed=None if scale is None else seed,
            recipe=None if scale is None else load_recipe(PAPER),
        ),
    )
    return folder


def camera_info(name: str, rows: int, columns: int) -> CameraInfo:
    """A gel camera with the view of a DIGIT."""
    return CameraInfo(name=name, image_shape=(rows, columns, 3), view_mm=(6.25, 25 / 3))


def array_info(name: str, full_scale: int) -> ArrayInfo:
    """A taxel array without known imperfections."""
    layout = load_layout(LAYOUT)
    return ArrayInfo(
        name=name, elastomer=elastomer_json(COVER), layout=layout.name, x_mm=layout.x_mm,
        y_mm=layout.y_mm, pad_diameter_mm=layout.pad_diameter_mm, full_scale_counts=full_scale,
        tactile_image=(396, 240, 8.8),
    )  # fmt: skip


def train_smoke(model: str, data_dir: Path, run_dir: Path, epochs: int) -> Path:
    """Trains at preset smoke on one thread, the same on every machine. Returns the run's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")
        train(model, data_dir, "smoke", run_dir, epochs=epochs)
    return run_dir


@contextmanager
def stopped_after_an_epoch() -> Iterator[None]:
    """A training inside is stopped by Ctrl-C in its second epoch."""
    validate = Trainer._validate

    def killed(self: Trainer) -> float:
        if len(self.history) == 1:
            raise KeyboardInterrupt
        return validate(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trainer, "_validate", killed)
        with pytest.raises(KeyboardInterrupt):
            yield


def _spot(shape, family, split, index, rng, force_n) -> dict:
    """One row of the table; what a translator does not read is false or zero."""
    layout = load_layout(LAYOUT)
    x_mm, y_mm = rng.uniform(-6, 6), rng.uniform(-12, 12)
    strength = rng.uniform(0.5, 1.0) * force_n / FORCE_N
    across = (np.arange(COLUMNS) - COLUMNS / 2) / PX_PER_MM
    down = (np.arange(ROWS) - ROWS / 2) / PX_PER_MM
    squares = np.square(across[None, :] - x_mm) + np.square(down[:, None] - y_mm)
    light = 60.0 + 180.0 * strength * np.exp(-squares / (2 * SPOT_MM**2))
    image = (light[:, :, None] * np.array([1.0, 0.8, 0.6])).astype(np.uint8)
    from_taxels = np.square(layout.x_mm - x_mm) + np.square(layout.y_mm - y_mm)
    counts = PEAK_COUNTS * strength * np.exp(-from_taxels / (2 * RESPONSE_MM**2))
    schema = schema_of(VALUES, None)
    rest = {field.name: False if pa.types.is_boolean(field.type) else 0 for field in schema}
    return rest | {
        "shape": shape, "family": family, "split": split, "index": index, "x_mm": x_mm,
        "y_mm": y_mm, "force_n": force_n,
        "source_image": {"bytes": encode_png(image), "path": f"{index}.png"},
        "target_counts": np.rint(counts).astype(np.uint16),
    }  # fmt: skip
