"""Sliding contact against closed forms, tamaas and finite elements.

    python -m benchmarks slides

- Closed forms of a half-space (`slides_closed_forms`): a ball that is pushed, twisted,
  and pushed back and forth, and stuck punches. The half-space's spectra are compared with tamaas.
- A ball and a square punch that slide on flat layers, against CalculiX (`slides_fem`).
  A press of t2twin has the force of CalculiX; each state after it has the same motion and force.

Needs tamaas (`pip install '.[oracle]'`) and CalculiX (`apt-get install calculix-ccx`).
"""

import tempfile
from argparse import Namespace
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.contact.solids import block
from benchmarks.evidence import Benchmark, Figure
from benchmarks.motion import slides_closed_forms as closed_forms
from benchmarks.motion import slides_fem as fem
from t2twin.primitives_cad.shape import ball
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer, Friction
from t2twin.sim.contact.sliding import advance
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.sensors.pair import SensorPair

BENCHMARK = Benchmark(
    module="benchmarks.motion.slides",
    minutes=14,
    sources=("sim/contact", "primitives_cad"),
    figures=(
        Figure("pushed_ball.*.traction_error", most=0.015),
        Figure("pushed_ball.compressible.stick_radius_error", most=0.007),
        # The closed form is an approximation here: without traction across the push.
        Figure("pushed_ball.incompressible.stick_radius_error", most=0.01),
        Figure("pushed_ball.*.compliance_error", most=0.01),
        Figure("twisted_ball.torque_error", most=0.02),
        Figure("twisted_ball.stick_radius_error", most=0.02),
        Figure("loop.loading_error", most=0.02),
        Figure("loop.unloading_error", most=0.02),
        Figure("loop.reloading_error", most=0.02),
        Figure("loop.closed_loop_error", most=0.01),
        Figure("loop.least_work_share", least=0.0),
        Figure("stuck_punches.*", most=0.02),
        Figure("tamaas.largest_error", most=1e-3),
        Figure("calculix.*.force_error", most=0.03),
        Figure("calculix.*.marker_error", most=0.08),
        Figure("calculix.*.depth_error"),
    ),
)

SHARES = (0.3, 0.6, 0.9)
"""Of the friction limit, at which a ball is pushed, and of the contact radius that sticks when it
is twisted."""

BALL_PITCH_MM = 0.00625
PUNCH_PITCH_MM = 0.02
"""Grids of the closed forms, for contacts of radius 1 mm."""

RADIUS_MM, SIDE_MM = 30.0, 4.0
"""Ball and square punch of the comparison with CalculiX."""

SLIDE_MM, SLIDE_FRICTION, SLIDE_POISSON = 0.2, 0.8, 0.45


PAIR = SensorPair()


@dataclass(frozen=True)
class Layer:
    """A flat layer of the comparison with CalculiX. block_mm: half the block's width. depths_mm: of
    the press of the ball and the punch. pitch_mm: of t2twin's contact."""

    thickness_mm: float
    young_mpa: float
    block_mm: float
    depths_mm: tuple[float, float]
    pitch_mm: float


LAYERS = {
    "gel": Layer(4.07, PAIR.source.elastomer.young_mpa, 11.0, (0.08, 0.05), PAIR.source.pitch_mm),
    "cover": Layer(2.0, PAIR.target.elastomer.young_mpa, 7.0, (0.06, 0.03), PAIR.target.pitch_mm),
}

FEM_PITCH_MM = {"ball": 0.25, "punch": 0.08}


def measure(options: Namespace) -> dict[str, Any]:
    fem.require_calculix()
    half_space = closed_forms.against_tamaas(PAIR.source.elastomer.poisson)
    worst = closed_forms.largest
    return {
        "pushed_ball": {
            name: worst([closed_forms.pushed_ball(nu, share, BALL_PITCH_MM) for share in SHARES])
            for name, nu in (("compressible", 0.0), ("incompressible", 0.499))
        },
        "twisted_ball": worst(
            [closed_forms.twisted_ball(share, 2 * BALL_PITCH_MM) for share in SHARES]
        ),
        "loop": closed_forms.loop(PUNCH_PITCH_MM),
        "stuck_punches": worst([closed_forms.stuck_punches(PUNCH_PITCH_MM)]),
        "tamaas": {"largest_error": max(half_space.values()), **half_space},
        "calculix": against_calculix(),
    }


def against_calculix() -> dict[str, dict[str, Any]]:
    """Slides of a ball and a punch on each layer of LAYERS."""
    found = {}
    for name, layer in LAYERS.items():
        for kind, depth_mm in zip(("ball", "punch"), layer.depths_mm, strict=True):
            slide = slide_of(kind, layer, depth_mm)
            with tempfile.TemporaryDirectory() as folder:
                found[f"{kind}_on_{name}"] = compare(kind, layer, slide, Path(folder))
    return found


def slide_of(kind: str, layer: Layer, depth_mm: float) -> fem.Slide:
    """The slide of a "ball" or a "punch", with markers 1 mm apart.

    No marker is on the edge of the punch, where the displacement has a kink.
    """
    is_ball = kind == "ball"
    markers = np.stack(np.meshgrid(np.arange(-5.5, 6.0), np.arange(0.5, 6.0)), axis=-1)
    return fem.Slide(
        heights_mm=lambda x, y: is_ball * (RADIUS_MM - np.sqrt(RADIUS_MM**2 - x**2 - y**2)),
        reach_mm=SIDE_MM / 2,
        depth_mm=depth_mm,
        slide_mm=SLIDE_MM,
        friction=SLIDE_FRICTION,
        thickness_mm=layer.thickness_mm,
        young_mpa=layer.young_mpa,
        poisson=SLIDE_POISSON,
        side_mm=layer.block_mm,
        pitch_mm=FEM_PITCH_MM[kind],
        markers_mm=markers.reshape(-1, 2),
        has_edge=not is_ball,
    )


def compare(kind: str, layer: Layer, slide: fem.Slide, folder: Path) -> dict[str, Any]:
    """Errors of depth, tangential force (over the largest) and markers (L2) of one slide."""
    expected = fem.solve(slide, folder)
    elastomer = Elastomer(
        "flat", layer.thickness_mm, layer.young_mpa, SLIDE_POISSON, 24.0, 24.0, law="linear"
    )
    shape = ball(RADIUS_MM) if kind == "ball" else block(SIDE_MM, SIDE_MM)
    command = PressCommand(kind, 0.0, 0.0, 0.0, float(expected.normal_n[0]))
    contact = solve_contact(shape, command, elastomer, layer.pitch_mm)
    found = {"depth_error": contact.depth_mm / slide.depth_mm - 1}
    states, largest_n = [], float(expected.tangential_n.max())
    for moved_mm, *state in zip(np.diff(expected.moved_mm), *expected.after_press(), strict=True):
        normal_n, tangential_n, markers_mm = state
        contact = advance(
            contact, float(moved_mm), 0.0, 0.0, float(normal_n), Friction(SLIDE_FRICTION)
        )
        error_n = float(contact.shear_n[0] - tangential_n)
        found_mm = _at_markers(contact, slide.markers_mm)
        states.append(
            {
                "force_error": error_n / largest_n,
                "marker_error": closed_forms.distance(found_mm, markers_mm),
                "slip_share": contact.slip_share,
            }
        )
    worst = closed_forms.largest(states)
    return found | {key: worst[key] for key in ("force_error", "marker_error")} | {"states": states}


def _at_markers(contact: Contact, markers_mm: np.ndarray) -> np.ndarray:
    """(n, 2) displacement of places on the surface along x and y, mm."""
    axes = contact.y_mm, contact.x_mm
    fields = RegularGridInterpolator(axes, np.moveaxis(contact.displacement_mm[:2], 0, -1))
    return fields(markers_mm[:, ::-1])
