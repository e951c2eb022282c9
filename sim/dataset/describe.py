"""What is written into info.json before the first shard is made."""

from t2twin.primitives_cad.cache import code_digest
from t2twin.sim.cyskin import reading, taxels
from t2twin.sim.dataset.info import (
    FORMAT,
    SPLITS,
    CySkinParameters,
    DatasetInfo,
    DigitParameters,
    Parameters,
    versions,
)
from t2twin.sim.dataset.shard import Task
from t2twin.sim.press.elastomer_json import elastomer_json
from t2twin.sim.sensors import SensorPair


def describe(sensors: SensorPair, scale: str, seed: int, tasks: list[Task]) -> DatasetInfo:
    """The info of a dataset of which no shard is made yet."""
    layout = sensors.cyskin.layout
    rows, columns, channels = sensors.digit.optics.background.shape
    return DatasetInfo(
        format=FORMAT,
        complete=False,
        pairs={s: sum(len(t.indices) for t in tasks if t.split == s) for s in SPLITS},
        layout=layout.name,
        layout_x_mm=tuple(layout.x_mm.tolist()),
        layout_y_mm=tuple(layout.y_mm.tolist()),
        full_scale_counts=taxels.FULL_SCALE_COUNTS,
        versions=versions(),
        shards={},
        image_shape=(rows, columns, channels),
        scale=scale,
        seed=seed,
        parameters=_parameters(sensors, {task.shape: task.indices for task in tasks}),
        shape_code=code_digest(),
    )


def _parameters(sensors: SensorPair, shapes: dict[str, tuple[int, ...]]) -> Parameters:
    digit, cyskin = sensors.digit, sensors.cyskin
    return Parameters(
        digit=DigitParameters(
            **elastomer_json(digit.gel),
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
