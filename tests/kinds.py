"""Sensors of a known kind, for tests."""

import numpy as np

from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.sensors.files import load_sensor
from t2twin.sim.taxels.taxel_array import TaxelArray


def gel_camera(name: str = "digit") -> GelCamera:
    """A gel camera by its name."""
    sensor = load_sensor(name)
    assert isinstance(sensor, GelCamera)
    return sensor


def taxel_array(name: str = "cyskin-20") -> TaxelArray:
    """A taxel array by its name."""
    sensor = load_sensor(name)
    assert isinstance(sensor, TaxelArray)
    return sensor


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    """Peak signal-to-noise ratio of two images, dB."""
    return float(10 * np.log10(255**2 / np.mean((one.astype(float) - other) ** 2)))


GEL, COVER = gel_camera().own_gel, taxel_array().elastomer
GEL_PITCH_MM, COVER_PITCH_MM = gel_camera().pitch_mm, taxel_array().pitch_mm
"""The layers of the default pair, and the pitches of their contact grids."""
