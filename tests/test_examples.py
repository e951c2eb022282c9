"""The examples, with few readings and few objects."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence
from session import python

from t2twin.sim.sensors.pair import SensorPair

EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(autouse=True)
def examples(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLES))


GRIPPER = """
import gripper
gripper.SLIPPED_M = 0.003  # seen before the tool has left the fingers
gripper.HELD_S, gripper.END_S = 2.2, 5.0  # it holds for 0.4 s
gripper.main()
print(gripper.END_S)
"""

RERUN = """
class RecordingStream:
    def __init__(self, name):
        self.lines = []

    def save(self, file):
        self.file = file

    def set_time(self, name, duration):
        self.time = duration

    def log(self, place, value):
        self.lines.append(f"{self.time:.6f} {place}")

    def flush(self):
        self.file.write_text("\\n".join(self.lines))

    def disconnect(self):
        pass


class Image:
    def __init__(self, pixels):
        assert pixels.shape == (320, 240, 3)

    def compress(self):
        return self


def BarChart(counts):
    assert counts.shape == (20,)


def Scalars(value):
    assert isinstance(value, float)
"""
"""A stand-in for Rerun, which is not installed for the tests: a recording is lines of text."""


@pytest.mark.skipif(sys.platform == "darwin", reason="macOS has no EGL")
def test_gripper_lifts_holds_and_loses_a_tool(tmp_path):
    """In a process of its own: MuJoCo's renderer changes OpenGL for pyrender."""
    file, rate_hz = tmp_path / "gripper.gif", 2.5
    (tmp_path / "rerun.py").write_text(RERUN)
    recording = tmp_path / "gripper.rrd"
    options = ["--tools", "allen-key", "--rate-hz", str(rate_hz), "--every", "4"]
    folders = [EXAMPLES, EXAMPLES.parent, tmp_path]
    path = os.pathsep.join(map(str, folders))
    command = ["-c", GRIPPER, *options, "--out", file, "--rerun", recording]
    ended = python(*command, PYTHONPATH=path)
    assert ended.returncode == 0, ended.stderr
    lines = ended.stdout.splitlines()
    end_s = float(lines[-1])
    name, held, slipped_n, *figures = lines[1].split()
    assert (name, held) == ("allen-key", "yes")
    weight_n = 0.0316 * 9.81
    sensors = SensorPair()
    limit_n = weight_n / (sensors.source.friction.coefficient + sensors.target.friction.coefficient)
    # The grip force falls by a factor of e^(1 / (rate x time)) between two readings.
    assert 0.5 * limit_n < float(slipped_n) < 1.5 * limit_n
    rmse, covered = float(figures[0].replace(",", "")), float(figures[1])
    assert 0 < rmse < 2_000
    assert covered > 70
    with Image.open(file) as animation:
        assert animation.size == (800, 360)
        pages = len(list(ImageSequence.Iterator(animation)))
        assert pages == np.ceil(end_s * rate_hz / 4)
    lines = [line.split() for line in recording.read_text().splitlines()]
    readings = sorted({float(time_s) for time_s, _ in lines})
    np.testing.assert_allclose(readings, np.arange(1, len(readings) + 1) / rate_hz, atol=1e-3)
    assert len(readings) > 3 * rate_hz
    for place in ("digit/image", "cyskin-20/counts", "prediction/counts", "prediction/counts_std"):
        assert [each for _, each in lines].count(place) == len(readings), place
    assert {"digit/shear_n", "cyskin-20/shear_n"} <= {place for _, place in lines}
