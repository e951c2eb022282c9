"""Recipes whose presses slide and twist."""

from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from moving import RECIPE

from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.types import PressCommand
from t2twin.sim.dataset.columns import MOTION, PATH, TRACTIONS
from t2twin.sim.dataset.store import read_split, verify_dataset
from t2twin.sim.sampling.plan import MotionPath, sample_commands, sample_paths
from t2twin.sim.sampling.recipe import Motion, load_recipe
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.pair import SensorPair

CELL_MM2 = SensorPair().array.dense_table.cell_mm2
TRACTION_COLUMNS = [f"target_{name}" for name in TRACTIONS]


@pytest.fixture(scope="module")
def made(moving_dataset: Path) -> Path:
    return moving_dataset


@pytest.fixture(scope="module")
def rows(made: Path) -> pa.Table:
    return pa.concat_tables([read_split(made, split) for split in ("train", "val")])


def column(rows: pa.Table, name: str) -> np.ndarray:
    return rows[name].to_numpy()


def test_a_dataset_with_motion_is_complete(made: Path, rows: pa.Table) -> None:
    assert verify_dataset(made) == []
    assert rows.num_rows == 15
    card = (made / "README.md").read_text()
    columns = [PATH, "source_markers", *TRACTION_COLUMNS]
    columns += [f"{role}_{name}" for role in ROLES for name in MOTION]
    assert set(columns) <= set(rows.column_names)
    assert all(name in card for name in columns)
    assert len(set(rows["source_markers"].to_pylist())) == 2


def test_a_path_starts_with_a_press_and_has_one_unit(rows: pa.Table) -> None:
    index, path = column(rows, "index"), column(rows, PATH)
    still = index == path
    assert 3 <= still.sum() < 15
    for role in ROLES:
        shear = np.hypot(*(column(rows, f"{role}_shear_{axis}_n") for axis in "xy"))
        torque = column(rows, f"{role}_torque_nmm")
        assert not shear[still].any() and not torque[still].any()
        assert (shear[~still] + np.abs(torque[~still]) > 0.0).all()
        limit = column(rows, f"{role}_friction") * column(rows, f"{role}_force_n")
        assert (shear <= 1.001 * limit).all()
        slip = column(rows, f"{role}_slip_share")
        assert (slip >= 0.0).all() and (slip <= 1.0).all() and slip[~still].any()
    units = {}
    names = ("shape", PATH, "source_unit", "source_friction")
    for shape, of, unit, friction in zip(*(rows[name].to_pylist() for name in names), strict=True):
        units.setdefault((shape, of), set()).add((unit, friction))
    assert all(len(each) == 1 for each in units.values())
    assert len(set(rows["source_friction"].to_pylist())) == 3  # one for each shape


def test_tractions_add_up_to_the_forces(rows: pa.Table) -> None:
    for name, force in zip(TRACTION_COLUMNS, ("force_n", "shear_x_n", "shear_y_n"), strict=True):
        sums = 1e-3 * CELL_MM2 * np.array(rows[name].to_pylist()).sum(axis=1)
        np.testing.assert_allclose(sums, column(rows, f"target_{force}"), atol=2e-3)


def test_paths_cover_each_touch_once() -> None:
    motion = Motion(still=0.5, slide=0.3, twist=0.2, steps=(2, 3))
    kinds = Counter()
    for number in range(200):
        paths = sample_paths(motion, 40, (0, 0), number)
        covered = [path.index + step for path in paths for step in range(1 + path.steps)]
        assert covered == list(range(40))
        assert all(2 <= path.steps <= 3 for path in paths[:-1] if path.kind != "still")
        kinds.update(path.kind for path in paths[:-1])
    shares = {kind: count / kinds.total() for kind, count in kinds.items()}
    assert shares == pytest.approx({"still": 0.5, "slide": 0.3, "twist": 0.2}, abs=0.03)


@pytest.mark.parametrize("kind", ["slide", "twist"])
def test_a_path_ends_at_its_sampled_length(kind) -> None:
    motion, start = Motion(force_change=(0.5, 0.5)), PressCommand("a", 1.0, 2.0, 3.0, 4.0)
    lengths = []
    for number in range(100):
        *_, middle, end = sample_commands(motion, MotionPath(0, kind, 4), start, (0, 0), number, 0)
        moved = np.hypot(end.x_mm - 1.0, end.y_mm - 2.0), np.rad2deg(abs(end.yaw_rad - 3.0))
        lengths.append(moved[kind == "twist"])
        assert moved[kind != "twist"] == 0.0 and end.force_n == pytest.approx(2.0)
        assert middle.x_mm == pytest.approx(1.0 + 0.75 * (end.x_mm - 1.0))
    low, high = motion.slide_mm if kind == "slide" else motion.twist_deg
    assert low <= min(lengths) and max(lengths) <= high
    assert np.median(lengths) == pytest.approx(np.sqrt(low * high), rel=0.5)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("twist = 0.3", "twist = 0.4", "expected shares whose sum is 1"),
        ("[0.05, 0.2]", "[0.2, 0.05]", "slide_mm is [0.2, 0.05]; expected low first"),
        ("[0.05, 0.2]", "[0.05, 200]", "$.motion.slide_mm"),
        ("steps = [1, 2]", "steps = [0, 2]", "$.motion.steps"),
        ("steps = [1, 2]", "steps = 3", "$.motion.steps"),
        ("markers = 0.5", "marker = 0.5", "unknown field `marker`"),
        ("markers = 0.5", "gel_friction = [0, 1]", "gel_friction"),
        ('kind = "drawn"\neach = "press"', "", "a fixed light has one unit"),
    ],
)
def test_wrong_motion_is_one_sentence(old: str, new: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(RECIPE.replace(old, new))
    with pytest.raises(T2TwinError) as error:
        load_recipe(path)
    assert said in str(error.value) and "\n" not in str(error.value)


def test_motion_needs_sampled_places(tmp_path: Path) -> None:
    path = tmp_path / "grid.toml"
    path.write_text('name = "a"\n[[parts]]\nshapes = "primitives"\n[motion]\n')
    with pytest.raises(T2TwinError, match="motion needs a part whose place is a distribution"):
        load_recipe(path)
