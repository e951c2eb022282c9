"""Fields of a recipe that have no effect are refused; so is a share of no shape."""

from contextlib import nullcontext
from pathlib import Path

import pytest
from msgspec import structs

import t2twin
from t2twin.core.errors import T2TwinError, T2TwinWarning
from t2twin.sim.sampling.recipe import GEL_CAMERA, TAXEL_ARRAY, bundled_recipes, checked, for_pair

HEAD = 'name = "w"\n'
PART = (
    '[[parts]]\nshapes = "random"\ncount = 10\npresses = 2\nplace = { normal_mm = 2.0 }\n'
    "force_n = 4.0\n"
)
STILL, SLIDES = (f"still = {still}\nslide = {1.0 - still}\ntwist = 0.0\n" for still in (1.0, 0.5))
DRAWN = '[light]\nkind = "drawn"\n'


def load(folder: Path, text: str) -> t2twin.Recipe:
    path = folder / "w.toml"
    path.write_text(HEAD + text)
    return t2twin.load_recipe(path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[light.draw]\nled_size_mm = [1.0, 2.0]\n", 'draw of light needs kind = "drawn"'),
        ('[light]\neach = "press"\n', 'each of light needs kind = "drawn"'),
        (f"[motion]\n{SLIDES}twist_deg = [1.0, 5.0]\n", "twist_deg of motion needs twist above 0"),
        (
            "[motion]\n" + STILL + "force_change = [1.0, 2.0]\n",
            "force_change of motion needs slide or twist above 0",
        ),
        (
            f"{DRAWN}[light.draw]\nspecks = [0, 0]\nspeck_px = [1.0, 2.0]\n",
            "speck_px of light.draw needs specks above 0",
        ),
        (
            f"{DRAWN}[light.artifacts]\nworn = 0\nwear_part = [0.0, 0.1]\n",
            "wear_part of light.artifacts needs worn above 0",
        ),
        ('scale = "small"\n', "random shapes: scale small has no effect"),
        ('split = "val"\nval_share = 0.5\n', "split val must not have val_share"),
        (f"{DRAWN}[light.draw]\naround_part = [0.0, 0.1]\n", "around_part .* has no optics"),
        (
            f'{DRAWN}optics = "c.npz"\n[light.draw]\nled_size_mm = [1.0, 2.0]\n',
            "led_size_mm of light.draw .* has an optics file",
        ),
        ("[motion]\n", "motion needs 5 presses or more, by its steps; a part has 2"),
        ("[motion]\nsteps = [1, 1]\nforce_change = [1, 9]\n", "is 40 to 360; expected 0.01 to 100"),
    ],
)
def test_a_field_without_effect_is_refused(text: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(T2TwinError, match=rf"w\.toml: .*{said}"):
        load(tmp_path, PART.replace("4.0", "40.0") + text)


@pytest.mark.parametrize(
    "text",
    [
        "[light.draw]\nled_size_mm = [1.0, 9.0]\n",  # the default
        "[motion]\nstill = 1.0\nslide = 0.0\ntwist = 0.0\nmarkers = 1.0\n",
        f'{DRAWN}optics = "c.npz"\n[light.draw]\naround_part = [0.0, 0.1]\n',
        f"{DRAWN}[light.draw]\nled_size_mm = [1.0, 2.0]\n[light.artifacts]\nglares = [0, 0]\n",
    ],
)
def test_fields_with_an_effect_are_accepted(text: str, tmp_path: Path) -> None:
    assert load(tmp_path, PART + text).name == "w"


def test_recipes_from_python_are_checked_too(tmp_path: Path) -> None:
    recipe = load(tmp_path, PART)
    with pytest.raises(T2TwinError, match=r"the recipe: .*seed"):
        checked(structs.replace(recipe, seed="one"))


@pytest.mark.parametrize("top, tables, role, said", [
    ("", DRAWN, "source", "light needs a gel camera"),
    ("contact_maps = true\n", "", "source", "contact_maps needs a gel camera"),
    ("background_frames = true\n", "", "source", "background_frames needs a gel camera"),
    ("", "[motion]\nsteps = [1, 1]\nmarkers = 1\n", "source", "markers needs a gel camera"),
    ("", "[motion]\nsteps = [1, 1]\ncover_friction = [1, 2]\n", "target", "needs a taxel array"),
    ("dense_counts = true\n", "", "target", "dense_counts needs a taxel array"),
])  # fmt: skip
def test_a_field_without_effect_on_the_sensors_is_refused(top, tables, role, said, tmp_path):
    other = {"source": "cyskin-63", "target": "digit"}[role]
    load(tmp_path, f'{top}{role} = "{other}"\n{PART}{tables}')
    with pytest.raises(T2TwinError, match=said):
        t2twin.make_dataset(tmp_path / "out", recipe=tmp_path / "w.toml")


@pytest.mark.parametrize("kind, said", [(GEL_CAMERA, ""), (TAXEL_ARRAY, "light needs a gel cam")])
def test_a_bundled_recipe_is_for_any_pair(kind, said):
    with pytest.warns(T2TwinWarning, match="it is left out") if said else nullcontext() as found:
        recipes = [for_pair(t2twin.load_recipe(name), [kind]) for name in bundled_recipes()]
    assert not said or any(str(each.message).startswith(said) for each in found or ())
    frames = {each.background_frames for each in recipes if each.name != "paper"}
    assert frames == {kind == GEL_CAMERA} == {not each.dense_counts for each in recipes[:1]}


def test_a_share_of_no_shape_is_refused(tmp_path: Path) -> None:
    recipe = load(tmp_path, f"{PART}val_share = 0.02\n")
    with pytest.raises(T2TwinError, match=r"val_share of .* is 0\.02, which is less than half a"):
        t2twin.make_dataset(tmp_path / "out", recipe=recipe)
    assert not (tmp_path / "out").exists()
