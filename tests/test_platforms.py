"""What only Linux has is used where it exists: macOS, and installations without a package."""

import os
import resource
from types import SimpleNamespace

import pytest

from t2twin.cli import doctor
from t2twin.core import machine
from t2twin.sim.dataset import shard


@pytest.fixture
def macos(monkeypatch, tmp_path):
    """This process as if on macOS on arm64: no /proc, no affinity of processes."""
    monkeypatch.setattr("sys.platform", "darwin")
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 8)
    monkeypatch.setattr("platform.processor", lambda: "")
    monkeypatch.setattr("platform.machine", lambda: "arm64")
    monkeypatch.setattr(machine, "CPUINFO", tmp_path / "cpuinfo")


def test_macos_has_cores_and_a_processor(macos):
    assert machine.cores() == 8
    assert machine.processor() == "arm64"
    assert machine.processor_flags() == []


def test_memory_is_in_bytes(macos, monkeypatch):
    """macOS gives the peak in bytes, Linux in KiB."""
    used, tally = SimpleNamespace(ru_maxrss=50_000_000), shard.Tally()
    monkeypatch.setattr(resource, "getrusage", lambda who: used)
    for platform, unit in (("darwin", 1), ("linux", 1024)):
        monkeypatch.setattr("sys.platform", platform)
        tally.add_peak_memory()
        assert tally.peaks[shard.process_name()] == 50_000_000 * unit


def test_doctor_wants_no_egl_on_macos(macos, monkeypatch):
    assert "not on macOS" in doctor._rendering()
    assert doctor._memory() != "unknown"
    monkeypatch.setattr(os, "sysconf_names", {})
    assert doctor._memory() == "unknown"
