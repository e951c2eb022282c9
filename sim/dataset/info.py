"""What a dataset's info.json says of its making: parameters, layout, versions."""

import zlib
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import numpy as np

from t2twin.sim.cyskin import reading, taxels
from t2twin.sim.dataset.shard import Task
from t2twin.sim.dataset.store import FORMAT, SPLITS
from t2twin.sim.sensors import SensorPair

PACKAGES = ("t2twin", "mujoco", "numpy", "scipy", "numba", "cadquery", "pillow", "pyarrow")
"""Those whose versions may change a shard's bytes."""


def describe(bench: SensorPair, scale: str, seed: int, tasks: list[Task]) -> dict[str, Any]:
    """info.json of a dataset of which no shard is made yet."""
    layout = bench.cyskin.layout
    pairs = {s: sum(len(t.indices) for t in tasks if t.split == s) for s in SPLITS}
    return {
        "format": FORMAT,
        "scale": scale,
        "seed": seed,
        "pairs": pairs,
        "layout": layout.name,
        "layout_x_mm": layout.x_mm.tolist(),
        "layout_y_mm": layout.y_mm.tolist(),
        "full_scale_counts": taxels.FULL_SCALE_COUNTS,
        "image_shape": list(bench.digit.optics.background.shape),
        "parameters": {
            "digit": _plain(asdict(bench.digit.gel))
            | {
                "pitch_mm": bench.digit.pitch_mm,
                "noise_grey": bench.digit.noise_grey,
                "calibration_sha256": bench.digit.calibration_sha256,
            },
            "cyskin": _plain(asdict(bench.cyskin.cover))
            | {
                "pitch_mm": bench.cyskin.pitch_mm,
                "gain_counts": taxels.GAIN_COUNTS,
                "pad_diameter_mm": layout.pad_diameter_mm.tolist(),
                "readings": reading.READINGS,
                "imperfections": _plain(asdict(bench.cyskin.flaws)),
            },
            "shapes": {t.shape: list(t.indices) for t in tasks},
        },
        "versions": versions(),
        "shards": {},
        "complete": False,
    }


def versions() -> dict[str, str]:
    """Of everything that may change a shard's bytes, on this machine."""
    return {name: version(name) for name in PACKAGES} | {"zlib": zlib.ZLIB_RUNTIME_VERSION}


def _plain(values: dict[str, Any]) -> dict[str, Any]:
    """JSON has no infinity: a flat side's radius becomes null."""
    return {
        key: None
        if isinstance(value, float) and not np.isfinite(value)
        else list(value)
        if isinstance(value, tuple)
        else value
        for key, value in values.items()
    }
