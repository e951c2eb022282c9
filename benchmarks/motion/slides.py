"""Sliding contact against closed forms, tamaas and finite elements, and random slides.

    python -m benchmarks.motion.slides [--slides N]

- Closed forms of a half-space (`slides_closed_forms`): a ball that is pushed, twisted,
  and pushed back and forth, and stuck punches. The half-space's spectra are compared with tamaas.
- A ball and a square punch that slide on flat layers, against CalculiX (`slides_fem`).
  A press of t2twin has the force of CalculiX; each state after it has the same motion and force.
- Slides of random shapes on both sensors: exceptions, warnings and steps that did not converge.

Needs tamaas (`pip install '.[oracle]'`) and CalculiX (`apt-get install calculix-ccx`).
"""

import tempfile
import warnings
from argparse import Namespace
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from tqdm import tqdm

from benchmarks.contact.solids import block
from benchmarks.evidence import Argument, Benchmark, Figure, main
from benchmarks.motion import slides_closed_forms as closed_forms
from benchmarks.motion import slides_fem as fem
from t2twin.core.errors import T2TwinError
from t2twin.core.machine import cores
from t2twin.primitives_cad import catalogue
from t2twin.primitives_cad.shape import ball
from t2twin.sim.contact.contact_solver import solve_contact
from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.contact.sliding import advance
from t2twin.sim.contact.types import Contact, PressCommand
from t2twin.sim.sampling.plan import random_name
from t2twin.sim.sensors.pair import SensorPair
from t2twin.sim.slide import slide_to

BENCHMARK = Benchmark(
    module="benchmarks.motion.slides",
    measures="Accuracy of sliding against closed forms and finite elements, and failures.",
    minutes=15,
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
        Figure("random.slides"),
        Figure("random.exceptions", most=0),
        Figure("random.warnings", most=0),
        Figure("random.unsettled", most=0),
        Figure("random.unsettled_percent", "%"),
        Figure("random.refused"),
        Figure("random.force_error", most=0.002),
    ),
    arguments=(Argument("--slides", "random slides; 5,000 take three hours", int, 250),),
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

SEED = 4_322
"""A recipe's seed that no shipped recipe has."""

CHUNK, STEPS = 20, 4
"""Slides that a process does at once, and touches of a slide after its press."""

FORCES_N, FRICTIONS, MAX_MM, MAX_DEG = (0.5, 12.0), (0.3, 1.5), 3.0, 45.0
"""Ranges of random slides."""

PLACES_MM = (2.0, 3.0)
"""Standard deviations of the place of a random slide along x and y."""


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
        "random": random_slides(options.slides),
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


def slide_of(
    kind: str, layer: Layer, depth_mm: float, finer: float = 1.0, stiffness: float = 1.0
) -> fem.Slide:
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
        pitch_mm=FEM_PITCH_MM[kind] / finer,
        markers_mm=markers.reshape(-1, 2),
        has_edge=not is_ball,
        stiffness=stiffness,
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
        contact = advance(contact, float(moved_mm), 0.0, 0.0, float(normal_n), SLIDE_FRICTION)
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


def random_slides(slides: int) -> dict[str, Any]:
    """Counts over slides of random shapes on both sensors; see `slide_some`."""
    total, failed, force_error = Counter[str](), [], 0.0
    with ProcessPoolExecutor(cores(), mp_context=get_context("spawn")) as pool:
        starts = range(0, slides, CHUNK)
        chunks = pool.map(partial(slide_some, last=slides), starts)
        for counts, lines, error in tqdm(chunks, total=len(starts), unit=f"{CHUNK} slides"):
            total.update(counts)
            failed += lines
            force_error = max(force_error, error)
    return {
        "slides": slides,
        **{
            key: total[key]
            for key in ("steps", "exceptions", "refused", "warnings", "unsettled", "unresolved")
        },
        "unsettled_percent": 100.0 * total["unsettled"] / max(total["steps"], 1),
        "force_error": force_error,
        "failed": failed,
    }


def slide_some(first: int, last: int) -> tuple[Counter[str], list[str], float]:
    """The slides of a chunk: counts, a line for each failure, and the largest error of a force.

    A refusal is a T2TwinError, such as that of a shape that leaves a pad. A step is unresolved if
    its press was smaller than the grid, as under a needle.
    """
    sensors, counts, failed, force_error = SensorPair(), Counter[str](), [], 0.0
    for number in range(first, min(first + CHUNK, last)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                for step, (contact, is_resolved) in enumerate(random_slide(sensors, number)):
                    counts["steps"] += 1
                    off = abs(contact.force_n / contact.command.force_n - 1)
                    force_error = max(force_error, off)
                    counts["unresolved"] += not is_resolved
                    if is_resolved and not contact.settled:
                        counts["unsettled"] += 1
                        failed.append(
                            f"{number}, {contact.elastomer.name} {step // 2 + 1}: unsettled"
                        )
            except T2TwinError:
                counts["refused"] += 1
            except Exception as error:
                counts["exceptions"] += 1
                failed.append(f"{number}: {error!r}")
        counts["warnings"] += len(caught)
        failed += [f"{number}: {warning.message}" for warning in caught]
    return counts, failed, force_error


def random_slide(sensors: SensorPair, number: int) -> list[tuple[Contact, bool]]:
    """The contacts after each step of one random slide, and whether the grid resolves the contact
    of its press. Raises T2TwinError as a slide does."""
    rng = np.random.default_rng((SEED, number))
    shape = catalogue.load(random_name(SEED, number))
    force_n, friction = np.exp(rng.uniform(*np.log(FORCES_N))), rng.uniform(*FRICTIONS)
    x_mm, y_mm = rng.normal(0.0, PLACES_MM)
    yaw, turn = rng.uniform(0, 2 * np.pi), np.deg2rad(rng.uniform(-MAX_DEG, MAX_DEG))
    length_mm, direction = rng.uniform(0, MAX_MM), rng.uniform(0, 2 * np.pi)
    end = length_mm * np.array([np.cos(direction), np.sin(direction)])
    path = np.linspace((x_mm, y_mm, yaw), (x_mm + end[0], y_mm + end[1], yaw + turn), STEPS + 1)
    first, *later = (PressCommand(shape.name, x, y, yaw, float(force_n)) for x, y, yaw in path)
    touch, contacts = sensors.press(shape, first), []
    resolved = {name: not each.smaller_than_grid for name, each in touch.contacts.items()}
    for command in later:
        touch = slide_to(sensors, touch, command, float(friction))
        contacts += [(contact, resolved[name]) for name, contact in touch.contacts.items()]
    return contacts


if __name__ == "__main__":
    main(BENCHMARK)
