"""Builds the info.json of a dataset before its first shard is made."""

from pathlib import Path

from t2twin.primitives_cad.shape_cache import code_digest
from t2twin.sim.contact.elastomer import elastomer_json
from t2twin.sim.cyskin import reading, taxels
from t2twin.sim.cyskin.field import field_layout
from t2twin.sim.dataset.info import (
    FORMAT,
    SPLITS,
    CySkinParameters,
    DatasetInfo,
    DigitParameters,
    Parameters,
    versions,
)
from t2twin.sim.dataset.shard import ShardContext
from t2twin.sim.dataset.store import sha256_of
from t2twin.sim.sensors import SensorPair
from t2twin.sim.world.plan import Batch
from t2twin.sim.world.recipe import NAMED, RANDOM


def build_info(context: ShardContext, scale: str | None, batches: list[Batch]) -> DatasetInfo:
    """The info of a dataset without shards."""
    recipe, sensors = context.recipe, context.sensors
    layout = sensors.cyskin.layout
    rows, columns, channels = sensors.digit.optics.background.shape
    places = field_layout(sensors.cyskin.cover) if recipe.field else None
    solids = sorted(
        {
            path
            for batch in batches
            if recipe.parts[batch.part].shapes not in NAMED
            for path in batch.shapes
        }
    )
    on_grid = {batch.shapes[0]: batch.indices for batch in batches if batch.indices is not None}
    has_random = any(part.shapes == RANDOM for part in recipe.parts)
    return DatasetInfo(
        format=FORMAT,
        complete=False,
        pairs={s: sum(b.pairs for b in batches if b.split == s) for s in SPLITS},
        layout=layout.name,
        layout_x_mm=tuple(layout.x_mm.tolist()),
        layout_y_mm=tuple(layout.y_mm.tolist()),
        full_scale_counts=taxels.FULL_SCALE_COUNTS,
        versions=versions(),
        shards={},
        image_shape=(rows, columns, channels),
        scale=scale,
        seed=recipe.seed,
        parameters=_parameters(sensors, on_grid),
        shape_code=code_digest(has_random),
        world=recipe,
        field_x_mm=None if places is None else tuple(places.x_mm.tolist()),
        field_y_mm=None if places is None else tuple(places.y_mm.tolist()),
        files={path: sha256_of(Path(path)) for path in solids} or None,
    )


def _parameters(sensors: SensorPair, shapes: dict[str, tuple[int, ...]]) -> Parameters:
    digit, cyskin = sensors.digit, sensors.cyskin
    return Parameters(
        digit=DigitParameters(
            **elastomer_json(digit.elastomer),
            pitch_mm=digit.pitch_mm,
            noise_grey=float(digit.noise_grey),
            calibration_sha256=digit.calibration_sha256,
        ),
        cyskin=CySkinParameters(
            **elastomer_json(cyskin.cover),
            pitch_mm=cyskin.pitch_mm,
            gain_counts=taxels.GAIN_COUNTS,
            pad_diameter_mm=tuple(cyskin.layout.pad_diameter_mm.tolist()),
            readings=reading.READINGS,
            imperfections=cyskin.flaws,
        ),
        shapes=shapes,
    )
