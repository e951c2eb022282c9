from dataclasses import replace

import numpy as np
import pytest
from kinds import GEL
from scipy.sparse.linalg import spsolve

from benchmarks.contact import oracle
from benchmarks.contact.solid import COARSEST_MM, Gel, Mesh, half_axis_mm, quarter, solve, stiffness
from t2twin.core.errors import T2TwinError
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.layer import compliance_mm_per_mpa

E, NU = GEL.young_mpa, GEL.poisson
FLAT = replace(GEL, dome_width_radius_mm=np.inf, dome_length_radius_mm=np.inf)


@pytest.fixture(scope="module")
def gel():
    return Gel(GEL, 1.0)


def crooked() -> Mesh:
    """A domed mesh with its inner nodes moved at random."""
    axis = np.linspace(0.0, 8.0, 6)
    mesh = quarter(GEL, axis, axis, 4)
    nodes = mesh.nodes_mm.copy()
    inner = _inside(mesh)
    nodes[inner] += np.random.default_rng(0).uniform(-0.1, 0.1, (inner.sum(), 3))
    return replace(mesh, nodes_mm=nodes)


def _inside(mesh: Mesh) -> np.ndarray:
    # A node inside belongs to eight elements.
    return np.bincount(mesh.hexahedra.ravel()) == 8


def test_uniform_strain_is_exact_on_a_crooked_mesh():
    mesh = crooked()
    whole = stiffness(mesh, E, NU).toarray()
    moved = mesh.nodes_mm @ np.random.default_rng(1).uniform(-0.1, 0.1, (3, 3))
    inner = np.repeat(_inside(mesh), 3)
    given = moved.ravel()[~inner]
    solved = np.linalg.solve(whole[np.ix_(inner, inner)], -whole[np.ix_(inner, ~inner)] @ given)
    assert solved == pytest.approx(moved.ravel()[inner], abs=1e-10)


def test_energy_of_uniform_strain_is_that_of_the_material():
    mesh = crooked()
    strain = np.array([[0.02, 0.01, 0.0], [0.01, -0.03, 0.005], [0.0, 0.005, 0.04]])
    moved = (mesh.nodes_mm @ strain).ravel()
    volume = _volume_mm3(mesh)
    shear, lame = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
    density = shear * (strain**2).sum() + lame / 2 * np.trace(strain) ** 2
    assert moved @ stiffness(mesh, E, NU) @ moved / 2 == pytest.approx(density * volume, rel=1e-9)


def _volume_mm3(mesh: Mesh) -> float:
    # Work of a unit pressure in a body whose stiffness is only bulk: p V = K tr(e) V.
    stretched = (mesh.nodes_mm / 3).ravel()
    bulk = E / (3 * (1 - 2 * NU))
    return float(stretched @ stiffness(mesh, E, NU) @ stretched / bulk)


def test_moving_and_turning_as_a_whole_needs_no_force():
    mesh = crooked()
    whole = stiffness(mesh, E, NU)
    for moved in (np.ones_like(mesh.nodes_mm), np.cross([0.3, -0.5, 0.7], mesh.nodes_mm)):
        assert np.abs(whole @ moved.ravel()).max() < 1e-10


def test_the_volume_of_a_block_is_its_sides_product():
    block = quarter(FLAT, np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0]), 3)
    assert _volume_mm3(block) == pytest.approx(3 * 2 * 4.07, rel=1e-9)


def test_an_element_inside_out_is_refused():
    mesh = crooked()
    with pytest.raises(T2TwinError, match="inside out"):
        stiffness(replace(mesh, hexahedra=mesh.hexahedra[:, ::-1]), E, NU)


def test_columns_keep_the_pitch_and_end_at_the_rim():
    axis = half_axis_mm(9.2, 0.5, np.inf)
    assert np.diff(axis)[:-1] == pytest.approx(0.5)
    assert axis[0] == 0.0
    assert axis[-1] == 9.2
    assert np.diff(half_axis_mm(36.0, 0.5, 5.0)).max() < 1.5 * COARSEST_MM


def test_a_confined_block_sinks_by_the_confined_modulus():
    axis = np.linspace(0.0, 4.0, 3)
    block = quarter(FLAT, axis, axis, 3)
    whole = stiffness(block, E, NU)
    held = np.zeros(block.nodes_mm.shape, bool)
    held[block.nodes_mm[:, 2] == 0, 2] = True
    for side in (0, 1):
        held[(block.nodes_mm[:, side] == 0) | (block.nodes_mm[:, side] == 4), side] = True
    free = np.flatnonzero(~held)
    load = np.zeros(held.shape)
    weight = np.array([0.5, 1.0, 0.5]) * 2.0
    load[-9:, 2] = -0.01 * np.outer(weight, weight).ravel()
    moved = np.zeros(held.size)
    moved[free] = np.linalg.solve(whole[free][:, free].toarray(), load.ravel()[free])
    confined = 4.07 * (1 - 2 * NU) * (1 + NU) / ((1 - NU) * E)
    assert moved.reshape(-1, 3)[-9:, 2] == pytest.approx(-0.01 * confined, rel=1e-9)


def answer(whole, free: np.ndarray, load: np.ndarray) -> np.ndarray:
    return np.asarray(spsolve(whole[free][:, free].tocsc(), load.ravel()[free]))


@pytest.mark.parametrize("half_wave_mm", [4.0, 8.0, 16.0])
def test_plane_waves_sink_as_in_closed_form(half_wave_mm):
    # A strip of half a wave: mirror planes at both ends, no strain along y.
    pitch = 0.25
    axis = np.arange(round(half_wave_mm / pitch) + 1) * pitch
    strip = quarter(FLAT, axis, np.array([0.0, pitch]), 12)
    held = np.zeros(strip.nodes_mm.shape, bool)
    held[strip.nodes_mm[:, 2] == 0] = True
    held[:, 1] = True
    held[(strip.nodes_mm[:, 0] == 0) | (strip.nodes_mm[:, 0] == axis[-1]), 0] = True
    free = np.flatnonzero(~held)
    wave = np.cos(np.pi * axis / half_wave_mm)
    width = np.full(axis.size, pitch)
    width[[0, -1]] /= 2
    load = np.zeros(held.shape)
    load[-2 * axis.size :, 2] = -np.tile(width * wave, 2) * pitch / 2
    moved = np.zeros(held.size)
    moved[free] = answer(stiffness(strip, E, NU), free, load)
    sunk = -moved.reshape(-1, 3)[-axis.size :, 2]
    sinking = (sunk * width * wave).sum() / (wave * width * wave).sum()
    truth = compliance_mm_per_mpa(np.array([np.pi / half_wave_mm]), 4.07, E, NU)[0]
    assert sinking == pytest.approx(truth, rel=0.006)


def test_forces_answer_each_other_and_mirror(gel):
    first, second = (np.random.default_rng(seed).random(gel.rest_mm.shape) for seed in (2, 3))
    sunk = gel.deflection_mm(first)
    assert (second * sunk).sum() == pytest.approx((first * gel.deflection_mm(second)).sum())
    assert gel.deflection_mm(first[::-1]) == pytest.approx(sunk[::-1], abs=1e-9)
    assert gel.deflection_mm(first[:, ::-1]) == pytest.approx(sunk[:, ::-1], abs=1e-9)


def test_parts_of_the_answer_are_the_whole_answer(gel):
    nodes = np.array([5, 200, gel.rest_mm.size // 2, 400])
    force = np.zeros(gel.rest_mm.size)
    force[nodes] = [1.0, 2.0, 3.0, 4.0]
    sunk = gel.deflection_mm(force.reshape(gel.rest_mm.shape)).ravel()[nodes]
    assert gel.compliance(nodes) @ force[nodes] == pytest.approx(sunk)


def test_four_quarters_are_the_whole_gel_and_its_base_carries_the_force():
    # All of a coarse gel at once, no symmetry used.
    small = Gel(GEL, 1.5)
    force = np.random.default_rng(4).random(small.rest_mm.shape)
    mesh = whole_mesh(small, layers=2)
    stiff = stiffness(mesh, E, NU)
    free = np.flatnonzero(np.repeat(mesh.nodes_mm[:, 2] > 0, 3))
    load = np.zeros(mesh.nodes_mm.shape)
    load[-force.size :, 2] = -force.ravel()
    moved = np.zeros(load.size)
    moved[free] = answer(stiff, free, load)
    on_top = moved.reshape(-1, 3)[-force.size :, 2].reshape(force.shape)
    assert small.deflection_mm(force) == pytest.approx(-on_top, rel=1e-6)
    carried = (stiff @ moved).reshape(-1, 3)[mesh.nodes_mm[:, 2] == 0].sum(axis=0)
    assert carried == pytest.approx([0.0, 0.0, force.sum()], abs=1e-8)


def whole_mesh(gel: Gel, layers: int) -> Mesh:
    part = quarter(FLAT, gel.x_mm - gel.x_mm[0], gel.y_mm - gel.y_mm[0], layers)
    nodes = part.nodes_mm + np.array([gel.x_mm[0], gel.y_mm[0], 0.0])
    nodes[:, 2] *= GEL.thickness_at_mm(nodes[:, 0], nodes[:, 1]) / FLAT.thickness_mm
    return replace(part, nodes_mm=nodes)


def ball_gap_mm(x_mm, y_mm, radius_mm=4.0):
    x, y = np.meshgrid(x_mm, y_mm)
    return radius_mm - np.sqrt(np.maximum(radius_mm**2 - x**2 - y**2, 0.0))


def test_a_ball_on_a_wide_block_as_by_the_oracle():
    pitch, n = 0.125, 48
    axis = (np.arange(n) - (n - 1) / 2) * pitch
    kernel = oracle.kernel(n, n, pitch, 4.07, E, NU)
    truth = oracle.solve(ball_gap_mm(axis, axis), 2.0, pitch, kernel)
    # Its sides are so far away that they do not matter.
    wide = Gel(replace(FLAT, width_mm=60, length_mm=60), 0.5, fine_mm=2.5)
    pressed = solve(wide, ball_gap_mm(wide.x_mm, wide.y_mm), 2.0)
    assert pressed.depth_mm == pytest.approx(truth.depth_mm, rel=0.03)


def test_contact_carries_the_force_pushes_only_and_does_not_overlap(gel):
    gap = ball_gap_mm(gel.x_mm - 6.0, gel.y_mm + 3.0) - gel.rest_mm
    pressed = solve(gel, gap, 2.0)
    assert pressed.force_n.sum() == pytest.approx(2.0)
    assert pressed.force_n.min() >= 0
    assert (pressed.depth_mm - gap - pressed.deflection_mm).max() < 1e-8
    touching = pressed.force_n > 0
    assert pressed.deflection_mm[touching] == pytest.approx((pressed.depth_mm - gap)[touching])


def test_the_thinner_ends_are_stiffer_and_free_sides_softer(gel):
    def sunk_mm(ground, y_mm):
        x, y = np.meshgrid(ground.x_mm, ground.y_mm)
        pressed = (np.abs(x) < 2.5) & (np.abs(y - y_mm) < 2.5)
        return ground.deflection_mm(pressed * ground.area_mm2)[pressed].mean()

    flat = Gel(FLAT, 1.0)
    assert sunk_mm(gel, 8.0) < 0.95 * sunk_mm(flat, 8.0)
    assert sunk_mm(flat, 10.0) > 1.1 * sunk_mm(flat, 0.0)


def test_a_normal_force_rises_where_it_stands_by_its_energy(gel):
    # Work of a force along the normal is that of its three parts on the three displacements.
    force = np.random.default_rng(6).random(gel.rest_mm.shape)
    mesh = whole_mesh(gel, layers=3)
    x, y = np.meshgrid(gel.x_mm, gel.y_mm)
    beyond = np.sign(y) * np.maximum(np.abs(y) - GEL.dome_flat_mm, 0)
    down = [
        -across / np.sqrt(radius**2 - across**2)
        for across, radius in (
            (x, GEL.dome_width_radius_mm),
            (beyond, GEL.dome_length_radius_mm),
        )
    ]
    load = np.zeros(mesh.nodes_mm.shape)
    load[-force.size :] = np.stack([force * down[0], force * down[1], -force], axis=-1).reshape(
        -1, 3
    )
    free = np.flatnonzero(np.repeat(mesh.nodes_mm[:, 2] > 0, 3))
    pressed = answer(stiffness(mesh, E, NU), free, load)
    normal = Gel(GEL, 1.0, along_normal=True)
    work = (force * normal.deflection_mm(force)).sum()
    assert work == pytest.approx(pressed @ load.ravel()[free], rel=1e-4)


def test_along_the_normal_is_the_same_where_the_top_is_flat():
    flat = Elastomer("flat", 3.0, E, NU, width_mm=10, length_mm=8)
    force = np.random.default_rng(5).random((9, 11))
    vertical = Gel(flat, 1.0).deflection_mm(force)
    assert Gel(flat, 1.0, along_normal=True).deflection_mm(force) == pytest.approx(vertical)
