"""Fits the optics file of the LEDs in the default gel camera's file to pyrender's images.

Run it after changes of its LEDs, camera or dome: `python -m maintenance.bake_optics`, a minute.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from msgspec import structs

from t2twin.sim.contact.elastomer import Elastomer
from t2twin.sim.optical.camera import optical_grid
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.illumination import COSINE_TERMS, Leds, Rays
from t2twin.sim.optical.optics import PLACE_TERMS, Optics, led_columns, place_terms
from t2twin.sim.optical.pyrender_renderer import GAMMA, ReferenceRenderer
from t2twin.sim.optical.surface import ball_surface
from t2twin.sim.sensors.defaults import SOURCE
from t2twin.sim.sensors.files import load_sensor

DARK = 0.05  # linear light added to a pixel's where errors become grey levels: the ambient's
RIDGE = 1e-4  # ridge of the fit: keeps undetermined terms at zero (assumed)
FIT_POINTS = 4  # points per LED in the renders for the fit, which have no shadows
BACKGROUND_POINTS = 16  # points per LED in the render of the background
SKIRT_MM = 0.6  # decay length of the deflection outside a shape (assumed: part of the layer)


def probe_deflections(gel: Elastomer) -> list[np.ndarray]:
    """Deflections that cover places and slopes: balls, edges, and the gel at rest."""
    x, y = optical_grid(gel)
    rest = [np.zeros((y.size, x.size))]
    balls = [
        ball_surface(gel, x_mm, y_mm, depth_mm, radius_mm)
        for x_mm in (-4.0, 0.0, 4.0)
        for y_mm, depth_mm, radius_mm in ((-6.0, 1.0, 2.35), (-1.5, 1.5, 3.0), (4.0, 0.8, 4.0))
    ]
    edges = [
        block(gel, -2.0, 3.0, 0.6, 6.0, 5.0, 0.4),
        block(gel, 2.0, -3.0, 0.8, 9.0, 2.0, -0.7),
        ring(gel, 0.0, 0.0, 0.7, 2.0, 3.5),
    ]
    return rest + balls + edges


def block(
    gel: Elastomer, x_mm: float, y_mm: float, depth_mm: float, width_mm: float, length_mm: float,
    yaw_rad: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Deflection by a flat rectangle, mm, on optical_grid(gel); at yaw 0 its width is along x."""
    x, y = np.meshgrid(*optical_grid(gel))
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    along = (x - x_mm) * cos + (y - y_mm) * sin
    across = (y - y_mm) * cos - (x - x_mm) * sin
    beyond = np.stack([np.abs(along) - width_mm / 2, np.abs(across) - length_mm / 2])
    return depth_mm * np.exp(-np.hypot(*np.maximum(beyond, 0.0)) / SKIRT_MM)


def ring(
    gel: Elastomer, x_mm: float, y_mm: float, depth_mm: float, inner_mm: float, outer_mm: float
) -> np.ndarray:
    """Deflection by a flat ring, mm, with these inner and outer radii."""
    x, y = np.meshgrid(*optical_grid(gel))
    distance = np.hypot(x - x_mm, y - y_mm)
    outside = np.maximum(np.maximum(inner_mm - distance, distance - outer_mm), 0.0)
    return depth_mm * np.exp(-outside / SKIRT_MM)


def bake(sensor: GelCamera) -> Optics:
    """Fits the optics of a sensor with up to three LEDs."""
    camera, gel, ambient = sensor.camera, sensor.own_gel, sensor.spec.light.ambient
    leds = sensor.spec.light.leds
    with ReferenceRenderer(leds, ambient, camera, gel, led_points=BACKGROUND_POINTS) as renderer:
        x, y = optical_grid(gel)
        background = renderer.render(np.zeros((y.size, x.size)))
    pure = tuple(
        structs.replace(led, color=(float(k == 0), float(k == 1), float(k == 2)))
        for k, led in enumerate(leds)
    )
    surfaces = probe_deflections(gel)
    with ReferenceRenderer(pure, (0.0, 0.0, 0.0), camera, gel, False, FIT_POINTS) as renderer:
        renders = [renderer.render_linear(surface) for surface in surfaces]
    blank = Optics(
        background=background, leds_mm=np.array([led.position_mm for led in leds]),
        sizes_mm=np.array([led.size_mm for led in leds]),
        response=np.zeros((len(leds), 3, PLACE_TERMS, COSINE_TERMS)), gamma=GAMMA,
        camera=camera,
    )  # fmt: skip
    table = fit_response(blank, gel, surfaces, renders)
    colors = np.array([led.color for led in leds])
    return replace(blank, response=np.einsum("kij,kc->kcij", table, colors))


def fit_response(
    optics: Optics, gel: Elastomer, surfaces: Sequence[np.ndarray], renders: Sequence[np.ndarray]
) -> np.ndarray:
    """Least-squares response, (LEDs, PLACE_TERMS, COSINE_TERMS), from linear light of each LED;
    errors are weighted by the slope of the grey-level curve."""
    camera = optics.camera
    rays = Rays(camera, gel, shadows=False)
    in_blocks = (camera.rows // 2, 2, camera.columns // 2, 2, 3)
    leds, count = Leds(optics.leds_mm, optics.sizes_mm), len(optics.leds_mm)
    places = place_terms(*rays.places_mm)
    terms = PLACE_TERMS * COSINE_TERMS
    squares, products = np.zeros((count, terms, terms)), np.zeros((count, terms))
    for surface, render in zip(surfaces, renders, strict=True):
        cosine, weight = rays.incidence(rays.coated(surface), leds)
        blocks = render.reshape(in_blocks).mean(axis=(1, 3)).reshape(-1, 3)
        for led in range(count):
            columns = led_columns(cosine[led], weight[led], places)
            columns = columns[1:-1, 1:-1].reshape(-1, terms)
            slope = (blocks[:, led] + DARK) ** (1.0 / GAMMA - 1.0)
            weighted = columns * slope[:, None]
            squares[led] += weighted.T @ weighted
            products[led] += weighted.T @ (blocks[:, led] * slope)
    table = [
        np.linalg.solve(s + RIDGE * np.eye(terms), p)
        for s, p in zip(squares, products, strict=True)
    ]
    return np.array(table).reshape(count, PLACE_TERMS, COSINE_TERMS)


if __name__ == "__main__":
    sensor = load_sensor(SOURCE)
    assert isinstance(sensor, GelCamera) and sensor.optics_path is not None
    bake(sensor).save(sensor.optics_path)
    print(f"wrote {sensor.optics_path}")
