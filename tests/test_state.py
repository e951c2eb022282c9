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


def without_contact():
    spec = mujoco.MjSpec()
    sensors = [t2twin.attach(spec, body="world", sensor=name, pos=[x_m, 0, 0])
               for name, x_m in (("digit", 0.0), ("cyskin", 0.1))]  # fmt: skip
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return [sensor.read(model, data) for sensor in sensors]


@pytest.mark.filterwarnings("ignore:cyskin-20. counts are clipped")
def test_arrays_are_read_only_or_new(touch):
    """Each writable array is another one at the next access."""
    own = {"touch": touch, "twin": t2twin.Twin(markers=True), "none": without_contact(),
           "shape": t2twin.load_shape("random-1")}  # fmt: skip
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
    heights[:], axis[:], solid.vertices[:] = -5.0, 7.0, 0.0
    shape.mesh.vertices[:] = 0.0
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


def test_a_process_pool_returns_touches(touch):
    press = partial(t2twin.Twin().press, "hemisphere-4", force_n=4)
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        found = pool.submit(press).result()
    assert np.array_equal(found.image, press().image)
    assert found.digit.surface_mm.shape == touch.digit.surface_mm.shape


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gel": t2twin.Elastomer("soft", 5.0, 0.02, 0.3, 18, 24)}, "digit with another gel"),
        ({"source": "gelsight-mini", "target": "flexitac"}, "the twin has gelsight-mini and flex"),
        ({"target": "digit"}, "the twin has digit and digit-2; press with this twin first"),
    ],
)
def test_a_touch_of_another_twin_does_not_slide(touch, options, message):
    with pytest.raises(T2TwinError, match=message):
        t2twin.Twin(**options).slide(touch, dx_mm=0.1, steps=1)


def test_what_a_touch_of_one_kind_has_not_is_said():
    pair = {"camera": t2twin.Twin(target="digit"), "array": t2twin.Twin(source="cyskin-63")}
    of = {kind: twin.press("circle-1", force_n=1.0) for kind, twin in pair.items()}
    for name, kind in (("tactile_image", "camera"), ("dense_counts", "camera"),
                       ("markers_mm", "array")):  # fmt: skip
        with pytest.raises(T2TwinError, match="the touch has no"):
            getattr(of[kind], name)
    assert of["camera"].counts is of["camera"].layout is of["array"].image is None
    with pytest.raises(T2TwinError, match="has no effect on digit, which has optics, gel, render"):
        t2twin.Twin(target="digit", layout="cyskin-63")
