"""What is kept: read-only arrays, and touches that are plain data and know their layers."""

# MuJoCo defines its names at import, where pyright does not find them.
# pyright: reportAttributeAccessIssue=false

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from contextlib import suppress
from functools import partial

import mujoco
import numpy as np
import pytest
import trimesh

import t2twin
from t2twin.core.errors import T2TwinError
from t2twin.primitives_cad.shape import HeightMap, Shape
from t2twin.translate.inference.estimate import Estimate

SKIPPED = ("equilibrium", "shear_layer", "prepared")  # state of the solver


def members(value, path, seen):
    """Path and value of all that a record of t2twin has in public, and of what that has."""
    if id(value) in seen:
        return
    seen[id(value)] = value
    yield path, value
    more = {}
    if isinstance(value, dict | tuple | list):
        inside = value.items() if isinstance(value, dict) else enumerate(value)
        more = {f"[{key!r}]": each for key, each in inside}
    elif type(value).__module__.startswith("t2twin"):
        for name in dir(value):
            with suppress(T2TwinError):  # such as of another kind of sensor
                if name[0] != "_" and name not in SKIPPED and not callable(getattr(value, name)):
                    more[f".{name}"] = getattr(value, name)
    for place, each in more.items():
        yield from members(each, f"{path}{place}", seen)


@pytest.fixture(scope="module")
def touch():
    twin = t2twin.Twin(markers=True)
    return twin.slide(twin.press("hemisphere-4", force_n=4, tilt_x_deg=5), dx_mm=0.2, steps=1)[0]


def test_arrays_are_read_only_or_new(touch):
    spec = mujoco.MjSpec()
    sensors = [t2twin.attach(spec, body="world", sensor=name, pos=[x_m, 0, 0])
               for name, x_m in (("digit", 0.0), ("cyskin", 0.1))]  # fmt: skip
    data = mujoco.MjData(spec.compile())
    mujoco.mj_forward(data.model, data)
    nothing = [sensor.read(data.model, data) for sensor in sensors]
    own = touch, nothing, t2twin.Twin(markers=True), t2twin.load_shape("random-1")
    arrays = {path: each for path, each in members(own, "", {}) if isinstance(each, np.ndarray)}
    assert len(arrays) > 60 and any("background" in path for path in arrays)
    for path, array in arrays.items():
        if array.flags.writeable:
            assert not np.shares_memory(array, eval(f"own{path}", {"own": own})), path
    for array in (touch.image, touch.counts, t2twin.Twin().background, t2twin.Twin().layout.x_mm):
        with pytest.raises(ValueError, match="read-only"):
            array[:] = 0


def test_a_shape_has_arrays_of_its_own():
    heights, axis, solid = np.zeros((3, 3), np.float32), np.arange(3.0), trimesh.creation.box()
    shape = Shape("mine", solid, HeightMap(heights, axis, axis), (1.0, 1.0))
    corners = solid.vertices.copy()
    heights[:], axis[:], solid.vertices[:], shape.mesh.vertices[:] = -5.0, 7.0, 0.0, 0.0
    assert not shape.surface.heights_mm.any() and shape.surface.pitch_mm == 1.0
    assert np.array_equal(shape.triangles[0], corners)


def test_records_are_copied_pickled_and_compared(touch):
    records = {type(each): each for _, each in members({"": touch}, "", {})
               if type(each).__module__.startswith("t2twin")}  # fmt: skip
    assert len(records) > 20
    for each in (*records.values(), t2twin.Twin(), Estimate(1.0, np.zeros(2))):
        for other in (copy.copy(each), copy.deepcopy(each), pickle.loads(pickle.dumps(each))):
            assert type(other) is type(each) and (other == each) in (True, False)
    again = pickle.loads(pickle.dumps(touch))
    assert again != touch and not again.image.flags.writeable
    (slid,), (other,) = (t2twin.Twin().slide(each, dx_mm=0.1, steps=1) for each in (touch, again))
    assert np.array_equal(slid.image, other.image) and np.array_equal(slid.counts, other.counts)


def test_a_process_pool_returns_touches():
    press = partial(t2twin.Twin().press, "hemisphere-4", force_n=4)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        found, expected = pool.submit(press).result(), press()
    assert np.array_equal(found.image, expected.image)
    assert np.array_equal(found.digit.surface_mm, expected.digit.surface_mm)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"gel": t2twin.Elastomer("soft", 5, 0.02, 0.3, 18, 24, 21.0, 30.0, 3.5)}, "digit"),
        ({"source": "gelsight-mini", "target": "flexitac"}, "digit"),
        ({"target": "digit"}, "cyskin-20"),
    ],
)
def test_a_touch_of_another_twin_does_not_slide(touch, options, name):
    with pytest.raises(T2TwinError, match=f"whose {name} is missing or has another gel"):
        t2twin.Twin(**options).slide(touch, dx_mm=0.1, steps=1)


def test_what_a_touch_of_one_kind_lacks_is_named():
    camera, array = (
        t2twin.Twin(source=name, target=name).press("circle-1", force_n=1.0)
        for name in ("digit", "cyskin-20")
    )
    for of, name in (camera, "tactile_image"), (camera, "dense_counts"), (array, "markers_mm"):
        with pytest.raises(T2TwinError, match="the touch has no"):
            getattr(of, name)
    assert camera.counts is camera.layout is array.image is None
    with pytest.raises(T2TwinError, match="has no effect on digit; allowed: optics, gel, render"):
        t2twin.Twin(target="digit", layout="cyskin-63")
    with pytest.raises(T2TwinError, match="source is None"):
        t2twin.Twin(source=None)  # pyright: ignore[reportArgumentType]
