"""Datasets of other pairs of sensors than the default one."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from t2twin.cli import main
from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.sim.dataset.columns import schema_of
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.lerobot import convert_to_lerobot
from t2twin.sim.dataset.store import (
    INFO,
    iter_images,
    lists,
    read_info,
    read_split,
    split_shards,
    verify_dataset,
)
from t2twin.sim.sensors.defaults import ROLES
from t2twin.sim.sensors.files import load_sensor
from t2twin.translate.data.pairs import load_info

RECIPE = """
name = "few"
seed = 2
source = "{}"
target = "{}"
contact_maps = true
[[parts]]
shapes = "random"
count = 1
presses = 4
place = {{ normal_mm = 1.0 }}
force_n = {{ low = 2.0, high = 6.0 }}
background_share = 0.25
[light]
kind = "drawn"
each = "shape"
[motion]
still = 0.0
slide = 1.0
twist = 0.0
slide_mm = [0.1, 0.2]
steps = [1, 1]
"""

OF_VALUE = {
    "image": ["image", "unit", "background", "markers", "depth_map_um", "pressure_map_hpa"],
    "counts": ["counts", "dense_counts", "pressure_kpa", "shear_x_kpa", "shear_y_kpa"],
}
"""Columns of a sensor after its role, by its value."""

OF_ANY = ["depth_mm", "force_n", "settled", "bottomed", "friction", "shear_x_n", "torque_nmm"]

PAIRS = {
    ("digit", "digit"): ("image", "image"),
    ("cyskin-20", "digit"): ("counts", "image"),
    ("cyskin-63", "cyskin-20"): ("counts", "counts"),
}
"""Source and target with their values."""


@pytest.fixture(scope="module", params=PAIRS, ids="-to-".join)
def made(request, tmp_path_factory, shape_cache) -> tuple[Path, tuple[str, str]]:
    """A dataset and its sensors."""
    folder = tmp_path_factory.mktemp("few")
    text = RECIPE.format(*request.param)
    if "image" not in PAIRS[request.param]:
        text = text.replace("contact_maps = true", "").replace('kind = "drawn"', "")
    (folder / "few.toml").write_text(text)
    make_dataset(folder / "data", recipe=folder / "few.toml", workers=1, cache=shape_cache)
    return folder / "data", request.param


def test_columns_have_the_roles_of_the_sensors(made) -> None:
    folder, names = made
    info = read_info(folder)
    assert info.values == dict(zip(ROLES, PAIRS[names], strict=True))
    assert tuple(sensor.name for sensor in info.sensors.values()) == names
    table = read_split(folder, "train")
    assert table.column_names == schema_of(info.values, info.recipe).names
    for role, value in info.values.items():
        present = {f"{role}_{name}" for name in (*OF_VALUE[value], *OF_ANY)}
        others = {f"{role}_{n}" for kind, more in OF_VALUE.items() if kind != value for n in more}
        assert present <= set(table.column_names) and not others & set(table.column_names)
    force = table["force_n"].to_numpy()
    for role in ROLES:
        np.testing.assert_allclose(table[f"{role}_force_n"], force, rtol=0.02, atol=1e-6)
    for role, sensor in info.sensors.items():
        own: Any = load_sensor(sensor.name)
        assert sensor.spec is not None and sensor.spec["name"] == sensor.name
        if sensor.value == "image":
            (path,) = split_shards(info, "train")
            images = [decode_png(png) for png in iter_images(folder, path, f"{role}_image")]
            assert {image.shape for image in images} == {(320, 240, 3)} and len(images) == 4
            assert sensor.view_mm == pytest.approx(own.camera.seen_half_extent_mm())
            # A reader needs info.json alone: the pressures add up to the force in the view.
            assert sensor.contact_grid is not None and sensor.view_mm is not None
            cell_mm2 = 4 * np.prod(sensor.view_mm) / np.prod(sensor.contact_grid)
            pressure_kpa = 0.1 * lists(table, f"{role}_pressure_map_hpa")
            np.testing.assert_allclose(
                1e-3 * cell_mm2 * pressure_kpa.sum(axis=1), table[f"{role}_force_n"], atol=0.01
            )
            depth_mm = 1e-3 * lists(table, f"{role}_depth_map_um")
            assert depth_mm.shape == (4, np.prod(sensor.contact_grid))
            np.testing.assert_allclose(depth_mm.max(axis=1), table[f"{role}_depth_mm"], rtol=0.3)
        else:
            counts = lists(table, f"{role}_counts")
            assert counts.shape == (4, own.layout.size) and counts[force > 0].max() > 100
            assert lists(table, f"{role}_dense_counts").shape == (4, own.dense.size)
            assert len(sensor.x_mm) == own.layout.size


def test_they_are_verified_and_not_continued_with_another_sensor(made, capsys) -> None:
    folder, names = made
    assert verify_dataset(folder) == []
    with pytest.raises(SystemExit) as stop:
        main(["simdata", "--verify", str(folder)])
    assert stop.value.code == 0 and "is complete" in capsys.readouterr().out
    content = json.loads((folder / INFO).read_text())
    assert (content["source"]["name"], content["target"]["name"]) == names
    recipe = read_info(folder).recipe
    assert recipe is not None
    with pytest.raises(T2TwinError, match="made with another source"):
        other = "gelsight-mini" if content["source"]["value"] == "image" else "flexitac"
        make_dataset(folder, recipe=structs.replace(recipe, source=other), workers=1)


def test_the_card_and_lerobot_name_the_roles(made, tmp_path) -> None:
    folder, _ = made
    info, card = read_info(folder), (folder / "README.md").read_text()
    converted = convert_to_lerobot(folder, tmp_path / "out")
    features = set(converted["features"])
    for role, value in info.values.items():
        assert f"| {role}_{value} |" in card
        feature = f"images.{role}" if value == "image" else f"{role}_counts"
        assert {f"observation.{feature}", f"observation.{role}_contact"} <= features
    assert converted["total_frames"] == 4


def test_networks_have_both_sides_of_a_dataset(made) -> None:
    folder, names = made
    for reverse in (False, True):
        info = load_info(folder, reverse)
        values = [info.source.value, info.target.value]
        assert values == list(PAIRS[names])[:: -1 if reverse else 1]
    missing = {"image", "counts"} - {*values}
    for kind, name in (("image", "camera"), ("counts", "array")):
        if kind in missing:
            with pytest.raises(T2TwinError, match=f"contain no {kind}"):
                getattr(info, name)
        else:
            assert getattr(info, name).value == kind
