import json
import re

import numpy as np
import pytest
from moving import digests
from msgspec import structs

from t2twin.cli import main
from t2twin.cli.dataset import simdata
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.primitives_cad import catalogue
from t2twin.sim.dataset import shard
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.info import SPLITS
from t2twin.sim.dataset.store import LOG, lists, read_info, read_split, verify_dataset
from t2twin.sim.optical import pyrender_renderer
from t2twin.sim.sampling import plan as planning
from t2twin.sim.sampling.plan import MAX_ATTEMPTS, MotionPath, plan, sample_force, sample_press
from t2twin.sim.sampling.recipe import ForceRange, bundled_recipes, load_recipe
from t2twin.sim.sensors.defaults import ROLES

MINE = """
name = "mine"
seed = 3
imperfections = "white"

[[parts]]
shapes = "random"
count = 5
presses = 4
place = { normal_mm = 2.5 }
force_n = { low = 0.5, high = 12.0, leave_out = [[2.7, 3.3]] }
background_share = 0.25
val_share = 0.2

[[parts]]
shapes = "tools"
split = "test"
scale = "smoke"
force_n = [1.0, 4.0]

[light]
kind = "drawn"
"""

TOOL = ("allen-key/long-arm",)


@pytest.fixture(scope="module")
def recipe_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("recipe") / "mine.toml"
    path.write_text(MINE)
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory, shape_cache, recipe_file):
    folder = tmp_path_factory.mktemp("recipe") / "data"
    make_dataset(folder, recipe=recipe_file, workers=1, cache=shape_cache, shapes=TOOL)
    return folder


def test_what_ships_can_be_planned():
    assert len(bundled_recipes()) == 14
    named = set(re.findall(r"[\w-]+", str(simdata.__doc__)))
    assert set(bundled_recipes()) <= named
    open_recipe = load_recipe("open")
    batches = plan(open_recipe)
    assert sum(batch.pairs for batch in batches) == 100_000
    assert {batch.pairs for batch in batches} == {500}
    assert {batch.split for batch in batches} == {"train", "val"}
    assert open_recipe.light.kind == "drawn"
    forces = plan(load_recipe("forces"))
    assert sum(batch.pairs for batch in forces if batch.split == "test") == 7 * 1_260
    union = plan(load_recipe("union"))
    pairs = {split: sum(b.pairs for b in union if b.split == split) for split in SPLITS}
    assert pairs == {"train": 45_000 + 14_112, "val": 4_704, "test": 1_260}
    unseen = load_recipe("unseen-forces").parts[0].force_n
    assert isinstance(unseen, ForceRange) and unseen.leave_out == ((2.7, 3.3), (5.4, 6.6))
    paper = plan(load_recipe("paper"))
    assert sum(batch.pairs for batch in paper) == 20_076
    assert [batch.shapes[0] for batch in paper] == list(catalogue.NAMES)


def test_no_shape_is_in_two_splits_or_recipes():
    recipe = load_recipe("open")
    by_split: dict[str, set] = {}
    for batch in plan(recipe):
        by_split.setdefault(batch.split, set()).update(batch.shapes)
    assert not by_split["train"] & by_split["val"]
    assert len(by_split["train"] | by_split["val"]) == 25_000
    few = structs.replace(recipe.parts[0], count=10, split="test", val_share=0.0)
    held = [batch for batch in plan(structs.replace(recipe, parts=(*recipe.parts, few)))
            if batch.split == "test"]  # fmt: skip
    assert not by_split["train"] & {name for batch in held for name in batch.shapes}
    other = plan(structs.replace(recipe, seed=1))
    assert not by_split["train"] & {name for batch in other for name in batch.shapes}


def test_a_recipe_is_whole_and_says_what_it_is(made):
    assert verify_dataset(made) == []
    info = read_info(made)
    assert info.recipe_name == "mine" and info.scale is None
    assert info.recipe is not None and info.recipe.light.kind == "drawn"
    assert info.pairs == {"train": 16, "val": 4, "test": 2} and info.complete
    said = json.loads((made / "info.json").read_text())
    assert said["recipe"]["parts"][0]["force_n"]["leave_out"] == [[2.7, 3.3]]
    assert "mine" in (made / "README.md").read_text()


def test_pairs_hold_dense_counts_and_background_frame(made):
    table = read_split(made, "train")
    counts, field = (
        lists(table, "target_counts"),
        np.array(table["target_dense_counts"].to_pylist()),
    )
    array = read_info(made).array
    assert array.dense is not None and field.shape == (16, array.dense.x_mm.size)
    places = np.hypot(
        np.subtract.outer(array.x_mm, array.dense.x_mm),
        np.subtract.outer(array.y_mm, array.dense.y_mm),
    )
    assert (places.min(axis=1) == 0.0).all()
    # a reading differs from the noiseless field at the taxels by its noise alone
    assert np.abs(counts - field[:, places.argmin(axis=1)]).max() < 40
    units = table["source_unit"].to_pylist()
    frames = [decode_png(row["bytes"]) for row in table["source_background"].to_pylist()]
    images = [decode_png(row["bytes"]) for row in table["source_image"].to_pylist()]
    for first, frame in zip(units, frames, strict=True):
        assert np.array_equal(frame, frames[units.index(first)])
    assert len(set(units)) == 4 and len({frame.tobytes() for frame in frames}) == 4
    for frame, image, force in zip(frames, images, table["force_n"].to_pylist(), strict=True):
        apart = np.abs(frame.astype(int) - image).mean()
        assert apart < 2.0 if force == 0.0 else apart > 0.3


def test_forces_and_untouched_presses(made):
    table = read_split(made, "train")
    force = table["force_n"].to_numpy()
    touched = force > 0
    assert 1 <= (~touched).sum() <= 8
    assert ((force[touched] >= 0.5) & (force[touched] <= 12.0)).all()
    for role in ROLES:
        carried = table[f"{role}_force_n"].to_numpy()
        np.testing.assert_allclose(carried[touched], force[touched], rtol=0.005)
        assert (carried[~touched] == 0).all()
    assert lists(table, "target_counts")[~touched].max() < 40
    tools = read_split(made, "test")
    assert tools["force_n"].to_pylist() == [1.0, 4.0]
    assert (
        lists(tools, "target_counts").sum(axis=1)[1]
        > 2 * lists(tools, "target_counts").sum(axis=1)[0]
    )


@pytest.mark.exhaustive
def test_same_seed_same_bytes_however_made(made, recipe_file, tmp_path, shape_cache):
    make_dataset(tmp_path / "two", recipe=recipe_file, workers=2, cache=shape_cache, shapes=TOOL)
    assert digests(tmp_path / "two") == digests(made)
    (tmp_path / "two" / "train" / "part-0-00000.parquet").unlink()
    make_dataset(tmp_path / "two", recipe=recipe_file, workers=1, cache=shape_cache, shapes=TOOL)
    assert digests(tmp_path / "two") == digests(made)


def test_another_shape_stands_in_for_one_that_cannot_be_touched(
    made, recipe_file, tmp_path, shape_cache, monkeypatch
):
    """The second shape and its first stand-in go to the base plate wherever they are pressed."""
    slivers = [f"random-3{number:09d}" for number in (1, 500_000_001)]
    stand_in = "random-3550000001"
    ask = shard.rejection_reason

    def why(touch):
        return "on the base plate" if touch.command.shape in slivers else ask(touch)

    monkeypatch.setattr(shard, "rejection_reason", why)
    recipe, folder = load_recipe(recipe_file), tmp_path / "stood-in"
    part = structs.replace(recipe.parts[0], background_share=0.0, force_n=2.0)
    whole = structs.replace(recipe, parts=(part,))
    make_dataset(folder, recipe=whole, workers=1, cache=shape_cache)
    rows = read_split(folder, "train")
    names, poses = rows["shape"].to_pylist(), list(zip(rows["x_mm"].to_pylist(), strict=True))
    assert names[4:8] == [stand_in] * 4
    assert len(set(poses)) == 16 and not {*slivers} & {*names}
    (said,) = [json.loads(line) for line in (folder / LOG).read_text().splitlines()]
    assert said["rejected"]["on the base plate"] >= 2 * MAX_ATTEMPTS
    assert verify_dataset(folder) == []
    with pytest.raises(T2TwinError, match="no attempt at a press touched random-3000000001"):
        monkeypatch.setattr(planning, "max_attempts", lambda part: MAX_ATTEMPTS)
        make_dataset(tmp_path / "none", recipe=whole, workers=1, cache=shape_cache)


def test_draws_keep_to_their_distributions():
    recipe = load_recipe("open")
    drawn = [sample_press(recipe, 0, "random-0", n, MotionPath(k), 0)[0][0] for n in range(500)
             for k in range(4)]  # fmt: skip
    forces = np.array([command.force_n for command in drawn])
    assert 0.01 < (forces == 0).mean() < 0.035
    logs = np.log(forces[forces > 0])
    assert np.log(0.5) <= logs.min() and logs.max() <= np.log(12.0)
    assert logs.mean() == pytest.approx((np.log(0.5) + np.log(12.0)) / 2, abs=0.08)
    places = np.array([(command.x_mm, command.y_mm) for command in drawn])
    assert places.std(axis=0) == pytest.approx([2.5, 2.5], rel=0.06)
    left_out = ForceRange(0.5, 12.0, ((2.7, 3.3), (5.4, 6.6)))
    rng = np.random.default_rng(0)
    for _ in range(2000):
        force = sample_force(rng, left_out)
        assert not 2.7 <= force <= 3.3 and not 5.4 <= force <= 6.6


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ('shapes = "random"', "count is missing, the number of random shapes"),
        ('shapes = "primitives"\npresses = 3', "presses is for a distribution of place"),
        ('shapes = "tools"\nforce_n = { low = 5.0, high = 2.0 }', "force_n is 5 to 2; expected"),
    ],
)
def test_a_wrong_part_is_one_sentence(changed, message, tmp_path, capsys):
    path = tmp_path / "wrong.toml"
    path.write_text(f'name = "wrong"\n[[parts]]\n{changed}\n')
    with pytest.raises(SystemExit) as stop:
        main(["simdata", "--recipe", str(path), "--out", str(tmp_path / "out")])
    error = capsys.readouterr().err
    assert stop.value.code == 2 and message in error and len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_of_solids_is_a_recipe_but_not_of_tools(tmp_path, shape_cache, shapes):
    solids = tmp_path / "solids"
    solids.mkdir()
    shapes("circle-2").mesh.export(solids / "mine.stl")
    path = tmp_path / "own.toml"
    path.write_text(
        f'name = "own"\ndense_counts = false\nbackground_frames = false\n[[parts]]\n'
        f'shapes = "{solids}"\npresses = 2\nplace = {{ uniform_mm = 2.0 }}\n'
    )
    info = make_dataset(tmp_path / "data", recipe=path, workers=1, cache=shape_cache)
    assert info.pairs["train"] == 2 and list(info.files or {}) == [str(solids / "mine.stl")]
    assert verify_dataset(tmp_path / "data") == []
    shapes("wrench/shank").mesh.export(solids / "innocent.stl")
    with pytest.raises(T2TwinError, match="is the tool wrench"):
        make_dataset(tmp_path / "other", recipe=path, workers=1, cache=shape_cache)
    assert not (tmp_path / "other").exists()


def test_pyrender_itself_makes_a_recipes_pictures(tmp_path, shape_cache, monkeypatch, capsys):
    monkeypatch.setattr(pyrender_renderer, "LED_POINTS", 1)
    part = structs.replace(load_recipe("open").parts[0], count=1, presses=1, background_share=0.0,
                           val_share=0.0, force_n=4.0)  # fmt: skip
    recipe = structs.replace(load_recipe("open-8n"), parts=(part,))
    images = {}
    for renderer in ("baked", "pyrender"):
        recipe = structs.replace(recipe, light=structs.replace(recipe.light, renderer=renderer))
        make_dataset(tmp_path / renderer, recipe=recipe, workers=1, cache=shape_cache)
        row = read_split(tmp_path / renderer, "train").to_pylist()[0]
        images[renderer] = decode_png(row["source_image"]["bytes"]).astype(float)
    assert "pyrender takes 1.1 s" in capsys.readouterr().out
    apart = np.abs(images["baked"] - images["pyrender"])
    assert 0.0 < apart.mean() < 2.0
    changed = np.abs(images["baked"] - images["baked"][0, 0]).std()
    assert apart.std() < 0.5 * changed
