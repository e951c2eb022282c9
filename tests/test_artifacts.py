"""Artifacts of sampled DIGIT units: streaks, glares, worn gels, drift."""

from dataclasses import replace

import numpy as np
import pytest
from kinds import gel_camera
from msgspec import structs

from t2twin.core.errors import T2TwinError
from t2twin.core.images import decode_png
from t2twin.sim.dataset.generate import make_dataset
from t2twin.sim.dataset.store import read_info, read_split
from t2twin.sim.optical.artifacts import Artifacts, with_artifacts
from t2twin.sim.optical.image_renderer import ImageRenderer
from t2twin.sim.optical.optics import Optics
from t2twin.sim.optical.response import linear
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.optical.units import Unit, UnitRanges, sample_unit
from t2twin.sim.sampling.recipe import load_recipe

NO_ARTIFACTS = Artifacts(streaks=(0, 0), glares=(0, 0), worn=0.0, drift_grey=(0.0, 0.0))
DIGIT = gel_camera()
LEDS = DIGIT.spec.light.leds
NOISE_GREY = DIGIT.spec.camera.noise_grey
BALL = ball_surface(DIGIT.own_gel, 0.5, -1.0, 1.1)

TOOL = ("allen-key/long-arm",)

RECIPE = """
name = "used"
[[parts]]
shapes = "tools"
split = "test"
presses = 6
place = { normal_mm = 1.0 }
background_share = 0.9
[light]
kind = "drawn"
each = "press"
"""


def gray_unit(level: int = 120, gamma: float = 2.0) -> Unit:
    """A unit with an even background frame."""
    background = np.full((320, 240, 3), level, dtype=np.uint8)
    return Unit(replace(DIGIT.optics, background=background, gamma=gamma), 2.8)


def used(seed: int, unit: Unit, artifacts: Artifacts) -> Unit:
    return with_artifacts(np.random.default_rng(seed), unit, artifacts, LEDS)


def earlier(unit: Unit) -> np.ndarray:
    assert unit.earlier_background is not None
    return unit.earlier_background


def test_artifacts_of_zero_strength_keep_all_frames() -> None:
    unit = sample_unit(np.random.default_rng(0), DIGIT.spec, UnitRanges())
    same = used(1, unit, NO_ARTIFACTS)
    for frame in (same.optics.background, earlier(same)):
        np.testing.assert_array_equal(frame, unit.optics.background)
    plain, again = DIGIT.with_unit(unit), DIGIT.with_unit(same)
    for image in (lambda digit, rng: digit.background_frame(rng),
                  lambda digit, rng: digit.image_renderer.render(BALL, rng)):  # fmt: skip
        frames = [image(digit, np.random.default_rng(2)) for digit in (plain, again)]
        np.testing.assert_array_equal(*frames)


@pytest.mark.parametrize("even", [0.0, 1.0])
def test_drift_has_the_stated_rms_in_each_color(even: float) -> None:
    only = structs.replace(NO_ARTIFACTS, drift_grey=(4.0, 4.0), drift_even_part=(even, even))
    for seed in range(5):
        unit = used(seed, gray_unit(), only)
        np.testing.assert_array_equal(unit.optics.background, 120)
        drift = earlier(unit).astype(float) - 120.0
        rms = np.sqrt((drift**2).mean(axis=(0, 1)) - (1 / 12 if even == 0.0 else 0.0))
        np.testing.assert_allclose(rms, 4.0, rtol=0.01)
        rough = np.abs(np.diff(drift, axis=0)).max()
        assert rough == 0 if even == 1.0 else rough <= 2
        assert len({tuple(color) for color in drift.reshape(-1, 3).T.tolist()}) > 1 or even == 1.0


def test_worn_gel_multiplies_the_light() -> None:
    worn = structs.replace(NO_ARTIFACTS, worn=1.0, wear_part=(0.1, 0.1), speckle_part=(0.0, 0.0))
    unit = used(3, gray_unit(), worn)
    albedo = unit.optics.albedo
    assert albedo is not None and 0.03 < albedo.std() < 0.2
    before = linear(np.full((320, 240), 120), 2.0) * albedo
    shown = linear(unit.optics.background, 2.0)
    np.testing.assert_allclose(shown, before[..., None].repeat(3, axis=2), atol=0.006)
    new, old = (
        ImageRenderer(each.optics, DIGIT.own_gel, NOISE_GREY).render(BALL)
        for each in (gray_unit(), unit)
    )
    inside = (new > 30) & (new < 200)
    wanted = 255 * np.sqrt(np.clip(linear(new, 2.0) * albedo[..., None], 0.0, 1.0))
    assert np.abs(old - wanted)[inside].max() < 3
    assert np.abs(old - wanted)[inside].mean() < 1


def test_a_worn_optics_file_is_in_its_file(tmp_path) -> None:
    unit = used(3, gray_unit(), structs.replace(NO_ARTIFACTS, worn=1.0))
    unit.optics.save(tmp_path / "worn.npz")
    again = Optics.load(tmp_path / "worn.npz")
    np.testing.assert_array_equal(again.albedo, unit.optics.albedo)
    with pytest.raises(T2TwinError, match=r"albedo has shape \(2, 2\)"):
        replace(again, albedo=np.ones((2, 2)))
    with pytest.raises(T2TwinError, match=r"albedo reaches 0; it must lie between 0\.01"):
        replace(again, albedo=np.zeros((320, 240)))


def test_a_streak_has_its_brightness_and_area() -> None:
    bar = {
        "streaks": (1, 1), "streak_grey": (60.0, 60.0), "streak_px": (10.0, 10.0),
        "streak_length_px": (50.0, 50.0), "streak_bend_part": (0.0, 0.0),
        "other_color_part": (0.0, 0.0), "changed_part": (0.5, 0.5),
    }  # fmt: skip
    artifacts = structs.replace(NO_ARTIFACTS, streak_moved_px=(0.0, 0.0), **bar)
    whole = 0
    for seed in range(12):
        unit = used(seed, gray_unit(), artifacts)
        added = unit.optics.background.astype(float) - 120.0
        in_color = added.sum(axis=(0, 1)) > 0
        assert in_color.sum() == 1 and added.min() == 0.0
        if any(edge.any() for edge in (added[0], added[-1], added[:, 0], added[:, -1])):
            continue
        whole += 1
        # integrals of 1 - u^2 and (1 - v^2)^2: 4/3 of the half length and 16/15 of the half width
        assert added.sum() == pytest.approx(60.0 * 50.0 * 4 / 3 * 10.0 * 16 / 15, rel=0.02)
        assert 59 <= added.max() <= 60
        assert (earlier(unit) - 120.0).max() == pytest.approx(90.0, abs=1.0)
    assert whole >= 3


def test_glare_lies_at_the_edge_toward_its_led() -> None:
    artifacts = structs.replace(
        NO_ARTIFACTS, glares=(1, 1), glare_grey=(90.0, 90.0), other_color_part=(0.0, 0.0),
        glare_px=(6.0, 6.0),
    )  # fmt: skip
    found = set()
    for seed in range(20):
        unit = used(seed, gray_unit(), artifacts)
        added = unit.optics.background.astype(float) - 120.0
        led = int(added.sum(axis=(0, 1)).argmax())
        row, column = np.unravel_index(added[..., led].argmax(), (320, 240))
        edge = min(row, 319 - row, column, 239 - column)
        x_mm, y_mm = unit.optics.leds_mm[led, :2]
        assert edge <= 40 and (column - 120) * x_mm + (row - 160) * y_mm > 0.0
        assert added.max() <= 90
        found.add(led)
    assert found == {0, 1, 2}


def test_a_recipe_with_artifacts_differs_in_the_light_alone(tmp_path, shape_cache) -> None:
    rows = {}
    for name, more in (("plain", ""), ("used", "[light.artifacts]\nworn = 1.0\n")):
        recipe = tmp_path / f"{name}.toml"
        recipe.write_text(RECIPE + more)
        make_dataset(tmp_path / name, recipe=recipe, workers=1, cache=shape_cache, shapes=TOOL)
        rows[name] = read_split(tmp_path / name, "test")
    recipe = read_info(tmp_path / "used").recipe
    assert recipe is not None and recipe.light.artifacts == Artifacts(worn=1.0)
    for column in ("force_n", "target_counts"):
        assert rows["plain"][column].to_pylist() == rows["used"][column].to_pylist()
    apart = {}
    for name, table in rows.items():
        still = [row for row in table.to_pylist() if row["force_n"] == 0.0]
        columns = ("source_image", "source_background")
        frames = [[decode_png(row[column]["bytes"]) for column in columns] for row in still]
        apart[name] = [np.abs(one.astype(int) - other).mean() for one, other in frames]
    assert len(apart["plain"]) >= 1 and max(apart["plain"]) < 1.5 < max(apart["used"])


def test_a_share_of_the_units_is_the_fixed_one_without_artifacts(tmp_path, shape_cache) -> None:
    recipe = tmp_path / "mixed.toml"
    light = RECIPE.replace('kind = "drawn"', 'kind = "drawn"\nfixed_share = 0.5')
    light = light.replace("presses = 6", "presses = 16")
    recipe.write_text(light + "[light.artifacts]\nworn = 1.0\n")
    make_dataset(tmp_path / "mixed", recipe=recipe, workers=1, cache=shape_cache, shapes=TOOL)
    default = DIGIT.background_frame()
    rows = read_split(tmp_path / "mixed", "test").to_pylist()
    frames = [decode_png(row["source_background"]["bytes"]) for row in rows]
    off = np.array([np.abs(frame.astype(float) - default).mean() for frame in frames])
    is_fixed = off < 1.5
    assert 3 <= is_fixed.sum() <= 13 and off[~is_fixed].min() > 5.0


@pytest.mark.parametrize(
    "old, new, sentence",
    [
        ('kind = "drawn"', 'kind = "fixed"', 'of light needs kind = "drawn"'),
        ("[light.artifacts]", "[light.artifacts]\nworn = 2.0", "<= 1.0 - at .*worn"),
        ("[light.artifacts]", "[light.artifacts]\nstreaks = [3, 1]", "expected low first"),
        ("[light.artifacts]", "[light.artifacts]\nstreak_grey = [0, 9]", ">= 0.1 .*streak_grey"),
    ],
)
def test_wrong_artifacts_are_refused(tmp_path, old, new, sentence) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text((RECIPE + "[light.artifacts]\n").replace(old, new))
    with pytest.raises(T2TwinError, match=sentence):
        load_recipe(path)
