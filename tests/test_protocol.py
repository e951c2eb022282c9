from collections import Counter

import numpy as np
import pytest
from scipy.spatial import KDTree

from t2twin.primitives_cad import catalogue
from t2twin.sim.sampling import protocol


def test_the_paper_scale_is_the_papers():
    scale = protocol.SCALES["paper"]
    counted = {"train": 0, "val": 0, "test": 0}
    for name in catalogue.NAMES:
        counted[catalogue.split(name)] += len(protocol.indices(name, scale))
    assert counted["train"] + counted["val"] == 18_816
    assert counted["train"] == 3 * counted["val"]
    assert counted["test"] == 1_260
    assert len(protocol.indices("square-1", scale)) == 588
    assert len(protocol.indices("pliers/teeth", scale)) == 63


@pytest.mark.parametrize("name", list(protocol.SCALES))
def test_smaller_scales_are_part_of_the_paper_and_hold_every_shape(name):
    for shape in catalogue.NAMES:
        chosen = protocol.indices(shape, protocol.SCALES[name])
        assert chosen and len(set(chosen)) == len(chosen)
        assert set(chosen) <= set(protocol.indices(shape, protocol.SCALES["paper"]))


def test_light_has_1000_pairs_of_all_orientations():
    scale, counted, turns = protocol.SCALES["light"], Counter[str](), set()
    for name in catalogue.NAMES:
        chosen = protocol.indices(name, scale)
        counted[catalogue.split(name)] += len(chosen)
        turns |= {index % protocol.grid_of(name)[1] for index in chosen}
    assert counted == {"train": 600, "val": 200, "test": 200} and turns == set(range(12))


def test_the_grid_turns_with_the_shape(shapes):
    shape = shapes("square-2")
    off_x, off_y = protocol.GRID_OFFSET_MM
    numbers = 24 * 12, *range(12)
    middle, *corner = (protocol.press_of("", shape.spacing_mm, number) for number in numbers)
    assert middle.x_mm == pytest.approx(off_x)
    yaws = np.array([press.yaw_rad for press in corner])
    assert yaws == pytest.approx(np.linspace(0, 7 / 4 * np.pi, 12))
    reach = 3 * shape.spacing_mm[0]
    at = (off_x - reach, off_y - reach)
    for press in corner:
        assert np.hypot(press.x_mm, press.y_mm) == pytest.approx(np.hypot(*at))
    assert (corner[0].x_mm, corner[0].y_mm) == pytest.approx(at)


@pytest.mark.parametrize("name", ["hemisphere-1", "circle-1", "bump-4", "circle-empty-4"])
def test_a_round_shape_is_hardly_ever_pressed_twice_in_one_place(name, shapes):
    spacing_mm = shapes(name).spacing_mm
    presses = [protocol.press_of(name, spacing_mm, index) for index in range(588)]
    places = np.array([(press.x_mm, press.y_mm) for press in presses])
    apart = KDTree(places).query(places, k=2)[0][:, 1]
    assert (apart < 0.02).sum() == 0
    assert (apart < 0.03).sum() < 20
