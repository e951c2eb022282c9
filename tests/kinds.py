"""Sensors of a known kind, for tests."""

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


GEL, COVER = gel_camera().own_gel, taxel_array().elastomer
GEL_PITCH_MM, COVER_PITCH_MM = gel_camera().pitch_mm, taxel_array().pitch_mm
"""The layers of the default pair, and the pitches of their contact grids."""
