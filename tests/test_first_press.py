"""The first press: nothing slow is imported, the catalogue is bundled, loops are compiled once."""

import subprocess

import numpy as np
import pytest
from matplotlib import colormaps
from session import python

from maintenance.write_bundled import build, tool_mesh
from t2twin.core.cache_dir import VARIABLE
from t2twin.core.draw import in_colors
from t2twin.primitives_cad import catalogue

SLOW = (
    "cadquery", "matplotlib", "networkx", "pyarrow", "pyrender", "torch", "trimesh",
)  # fmt: skip
"""Imports that a press of a shape of the catalogue does without."""

PRESS = f"""
import sys
from t2twin.cli import main
main(["press", "square-2", "--out", "out"])
print("slow:", sorted(set({SLOW!r}) & set(sys.modules)))
"""

NOTICE = "t2twin: compiling"

QUICK = ("square-2", "hemisphere-1", "allen-key/bend")
"""Shapes whose solids are quick to make."""

ROUNDING_MM = 4e-6
"""Largest difference of a bundled length from the CAD's, mm: single precision of up to 64 mm."""


@pytest.mark.exhaustive
def test_a_press_imports_nothing_slow_and_says_when_it_compiles(tmp_path):

    def press(**more: str) -> subprocess.CompletedProcess:
        done = python("-W", "error", "-c", PRESS, **more)
        assert done.returncode == 0, done.stderr
        assert "slow: []" in done.stdout
        return done

    press()
    own = {"NUMBA_CACHE_DIR": "", VARIABLE: str(tmp_path / "cache")}
    first, second = press(**own), press(**own)
    assert first.stderr.startswith(NOTICE) and first.stderr.count("\n") == 1
    assert second.stderr == ""
    counts = [each.stdout.splitlines()[1].rpartition(",")[0] for each in (first, second)]
    assert counts[0] == counts[1]


def test_a_refusal_comes_before_anything_is_compiled(tmp_path):
    own = {"NUMBA_CACHE_DIR": "", VARIABLE: str(tmp_path / "cache")}
    done = python("-m", "t2twin", "press", "square-2", "--force-n", "-1", **own)
    assert done.returncode == 2
    assert done.stderr.startswith("t2twin: ") and done.stderr.count("\n") == 1
    assert NOTICE not in done.stderr
    assert not list(tmp_path.rglob("*.nbi"))


def assert_as_made(name: str, tool=None) -> None:
    made = build(name, tool)
    bundled = catalogue.read_surface(name)
    np.testing.assert_allclose(
        bundled.heights_mm, made.surface.heights_mm, rtol=0, atol=ROUNDING_MM
    )
    np.testing.assert_array_equal(bundled.x_mm, made.surface.x_mm)
    np.testing.assert_array_equal(bundled.y_mm, made.surface.y_mm)
    vertices, faces = catalogue.read_mesh(name)
    np.testing.assert_array_equal(faces, made.mesh.faces)
    np.testing.assert_allclose(vertices, made.mesh.vertices, rtol=0, atol=ROUNDING_MM)
    loaded = catalogue.load(name)
    assert loaded.parameters == made.parameters and loaded.base_mm == made.base_mm


@pytest.mark.parametrize("name", QUICK)
def test_bundled_shapes_are_those_of_the_cad(name):
    """Run `python -m maintenance.write_bundled` after a change of the CAD."""
    is_tool = name in catalogue.OBJECTS
    assert_as_made(name, tool_mesh(name.partition("/")[0]) if is_tool else None)


@pytest.mark.exhaustive
@pytest.mark.parametrize("tool", ["", *catalogue.TOOLS])
def test_all_bundled_shapes_are_those_of_the_cad(tool):
    if not tool:
        for name in catalogue.PRIMITIVES:
            assert_as_made(name)
        return
    mesh = tool_mesh(tool)
    np.testing.assert_array_equal(catalogue.read_mesh(tool)[0], mesh.vertices)
    for keypoint in catalogue.KEYPOINTS[tool]:
        assert_as_made(f"{tool}/{keypoint}", mesh)


def test_the_colors_are_matplotlib_s_viridis():
    values = np.random.default_rng(0).uniform(-0.2, 1.2, (40, 50))
    values[0, :2] = 0.0, 1.0
    expected = colormaps["viridis"](values.clip(0.0, 1.0), bytes=True)[..., :3]
    np.testing.assert_array_equal(in_colors(values), expected)
