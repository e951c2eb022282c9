"""The public API: what is listed, and how quickly it is there."""

from dataclasses import replace

import pytest
from session import python

import t2twin

PUBLIC = {
    "AttachedSensor", "Contact", "Elastomer", "FrameOrder", "Layout", "PressCommand", "Recipe",
    "Shape", "T2TwinError", "T2TwinWarning", "Touch", "TrainedTranslator", "Twin", "adapt",
    "attach", "calibrate", "evaluate", "export_onnx", "export_shapes", "guess_light",
    "import_pairs", "load", "load_layout", "load_recipe", "Markers", "load_shape", "make_dataset",
    "press", "read_all", "sensors", "shapes", "train", "translate_images", "verify_dataset",
    "write_data_report", "write_report",
}  # fmt: skip
"""What a later version must still have."""

SLOW = (
    "numpy",
    "torch",
    "cadquery",
    "trimesh",
    "numba",
    "mujoco",
    "scipy",
    "matplotlib",
    "pyarrow",
)
"""Libraries that are imported where they are used."""


def test_what_is_public_is_listed_once_and_there():
    assert set(t2twin.__all__) == PUBLIC and len(t2twin.__all__) == len(PUBLIC)
    assert set(dir(t2twin)) >= PUBLIC
    for name in t2twin.__all__:
        assert getattr(t2twin, name).__doc__, name
    with pytest.raises(AttributeError, match="twim"):
        _ = t2twin.twim  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    "script",
    [
        "import t2twin",
        "from t2twin.__main__ import main; sys.argv[1:] = ['--help']\n"
        "with contextlib.suppress(SystemExit): main()",
    ],
    ids=["import", "help"],
)
def test_import_and_help_load_nothing_slow(script):
    """Each of SLOW takes as long to import as all of these together may take."""
    script = f"import contextlib, sys\n{script}\nprint('loaded', *(set({SLOW}) & set(sys.modules)))"
    done = python("-c", script)
    assert done.stdout.splitlines()[-1] == "loaded"


def test_a_shape_a_name_and_a_file_press_alike(tmp_path):
    """Outlines of files are at the nearest points of the height map, those of names on the solid.
    They differ by half a point, 0.025 mm, on average."""
    shape = t2twin.load_shape("circle-2")
    shape.mesh.export(tmp_path / "circle.stl")
    twin = t2twin.Twin()
    by_name, by_shape, by_file = (
        twin.press(given) for given in ("circle-2", shape, tmp_path / "circle.stl")
    )
    assert (by_name.image == by_shape.image).all() and (by_name.counts == by_shape.counts).all()
    assert by_file.digit.depth_mm == pytest.approx(by_name.digit.depth_mm, rel=5e-3)


def test_noise_comes_from_the_seed_and_only_with_one():
    twin = t2twin.Twin(imperfections="all")
    still, again = twin.press("circle-1"), twin.press("circle-1")
    first, second, other = (twin.press("circle-1", seed=seed) for seed in (1, 1, 2))
    assert (still.counts == again.counts).all() and (still.image == again.image).all()
    assert (first.counts == second.counts).all() and (first.image == second.image).all()
    assert (first.counts != other.counts).any() and (first.image != still.image).any()


def test_a_saved_touch_replaces_an_earlier_one(tmp_path):
    twin, folder = t2twin.Twin(), tmp_path / "out"
    touch = twin.press("square-2", force_n=4.0)
    touch.save(folder)
    (folder / "mine.txt").write_text("mine")
    replace(touch, readings={"digit": touch["digit"]}).save(folder)
    assert {path.name for path in folder.glob("[!.]*")} == {
        "press.json", "shape.stl", "digit.png", "contact_digit.npz", "scene_digit.xml", "mine.txt",
    }  # fmt: skip
