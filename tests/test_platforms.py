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
    monkeypatch.setattr(shard, "STATUS", tmp_path / "status")


def test_macos_has_cores_and_a_processor(macos):
    assert machine.cores() == 8
    assert machine.processor() == "arm64"
    assert machine.processor_flags() == []


def test_memory_is_in_bytes(macos, monkeypatch):
    """macOS gives the peak in bytes, Linux in KiB."""
    used = SimpleNamespace(ru_maxrss=50_000_000)
    monkeypatch.setattr(resource, "getrusage", lambda who: used)
    assert shard.peak_memory() == 50_000_000
    monkeypatch.setattr("sys.platform", "linux")
    assert shard.peak_memory() == 50_000_000 * 1024
    shard.STATUS.write_text("Name:\tpython\nVmHWM:\t    2048 kB\n")
    assert shard.peak_memory() == 2 * 2**20


def test_doctor_wants_no_egl_on_macos(macos, monkeypatch):
    assert "not on macOS" in doctor._rendering()
    assert doctor._memory() != "unknown"
    monkeypatch.setattr(os, "sysconf_names", {})
    assert doctor._memory() == "unknown"
