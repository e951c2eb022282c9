"""The geometry that all presses share, and its estimate from frames alone.

Photometric stereo finds the directions of the light from surfaces of known normals. Here the
surfaces are those of the balls, and the shadows that they cast count too. On a ring of LEDs around
the gel, those are chosen whose Lambertian light explains the change of the background best. No
color is presumed: an LED has any amount of each, in each press another one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from t2twin.sim.optical.light.ray_casting import Leds
from t2twin.sim.optical.optics import MAX_LEDS

HOLD, SKIRT = 0.75, 1.0
"""Initial profile of the gel around a ball (assumed; t2twin.sim.optical.surface)."""
SMALLEST_LED_MM = 0.3
"""Smallest initial size of an LED, mm (assumed: a smaller one has as sharp a shadow)."""
ELEVATIONS_DEG = (10.0, 18.0, 30.0)
"""Elevations of the rings of LEDs over the apex (assumed: from low light to half of the slopes)."""
RING = MAX_LEDS
"""Number of LEDs of a ring."""
LEAST_IMPROVEMENT = 1e-6
"""An LED is exchanged where this lowers the squared error by more than this part (assumed)."""


@dataclass(frozen=True)
class Geometry:
    """LEDs and the gel's profile, as a vector of parameters.

    values: azimuth and elevation of each LED, degrees; a change of all their distances from the
    axis, mm; the logarithm of each size, mm; hold and skirt of ball_surface. start: the values from
    which the fit starts. distances_mm: (LEDs,) initial distances from the axis.
    """

    values: np.ndarray
    start: np.ndarray
    distances_mm: np.ndarray

    @classmethod
    def of(cls, leds: Leds) -> "Geometry":
        """The start of a fit from given LEDs."""
        x, y, z = leds.places_mm.T
        distances_mm = np.hypot(x, y)
        azimuth_deg = np.degrees(np.arctan2(-y, x))
        elevation_deg = np.degrees(np.arctan2(-z, distances_mm))
        sizes = np.log(np.maximum(leds.sizes_mm, SMALLEST_LED_MM))
        start = np.concatenate([azimuth_deg, elevation_deg, [0.0], sizes, [HOLD, SKIRT]])
        return cls(start, start, distances_mm)

    @property
    def count(self) -> int:
        """Number of LEDs."""
        return len(self.distances_mm)

    @property
    def leds(self) -> Leds:
        angles, sizes = self.values[: 2 * self.count], self.values[2 * self.count + 1 : -2]
        azimuth, elevation = np.radians(angles.reshape(2, -1))
        distance = self.distances_mm + self.values[2 * self.count]
        x, y, z = np.cos(azimuth), -np.sin(azimuth), -np.tan(elevation)
        return Leds(distance[:, None] * np.stack([x, y, z], axis=1), np.exp(sizes))

    @property
    def profile(self) -> tuple[float, float]:
        """Hold and skirt."""
        return self.values[-2], self.values[-1]

    @property
    def spread(self) -> np.ndarray:
        """Standard deviations of the prior (assumed)."""
        return self._each(10.0, 6.0, 1.0, 0.5, 0.1, 0.3)

    @property
    def deviation(self) -> np.ndarray:
        """Deviation from the start, in standard deviations."""
        return (self.values - self.start) / self.spread

    def moved(self, change: np.ndarray) -> "Geometry":
        """After a step of the fit, which has at most a standard deviation."""
        return replace(self, values=self.values + np.clip(change, -self.spread, self.spread))

    def nudged(self) -> Iterator[tuple["Geometry", float]]:
        """With each value changed by a step of its difference quotient, and the step."""
        for number, step in enumerate(self._each(0.7, 0.5, 0.5, 0.05, 0.01, 0.03)):
            values = self.values.copy()
            values[number] += step
            yield replace(self, values=values), step

    def _each(self, *values: float) -> np.ndarray:
        """Values of an azimuth, an elevation, the distance, a size, hold and skirt."""
        return np.repeat(values, [self.count, self.count, 1, self.count, 1, 1])

    def rings(self) -> list["Geometry"]:
        """Geometries of LEDs all around, one for each of ELEVATIONS_DEG, of the mean distance and
        size."""
        distance_mm, size_mm = self.distances_mm.mean(), self.leds.sizes_mm.mean()
        azimuth = 2.0 * np.pi * np.arange(RING) / RING
        x, y = distance_mm * np.cos(azimuth), -distance_mm * np.sin(azimuth)
        heights = (np.full(RING, -distance_mm * np.tan(np.radians(deg))) for deg in ELEVATIONS_DEG)
        sizes = np.full(RING, size_mm)
        return [Geometry.of(Leds(np.stack([x, y, z], axis=1), sizes)) for z in heights]

    def chosen(self, numbers: Sequence[int]) -> "Geometry":
        """Some of its LEDs."""
        leds = self.leds
        return Geometry.of(Leds(leds.places_mm[list(numbers)], leds.sizes_mm[list(numbers)]))


@dataclass(frozen=True)
class Shading:
    """Sums over a press's samples: squares (LEDs, LEDs) of changes of the LEDs' Lambertian light,
    and products (LEDs, RGB) with the change of the light in the frame."""

    squares: np.ndarray
    products: np.ndarray

    @classmethod
    def of(cls, columns: np.ndarray, target: np.ndarray) -> "Shading":
        """columns: (samples, LEDs). target: (samples, RGB)."""
        return cls(columns.T @ columns, columns.T @ target)

    def explained(self, numbers: Sequence[int]) -> float:
        """Square of the change that some LEDs explain, each with any amount of each color."""
        squares, products = self.squares[np.ix_(numbers, numbers)], self.products[numbers]
        floor = 1e-9 * max(float(np.trace(self.squares)), 1e-12)
        factor = np.linalg.cholesky(squares + floor * np.eye(len(squares)))
        wanted = np.linalg.solve(factor, products)
        return float(sum(w @ w - nnls(factor.T, w)[1] ** 2 for w in wanted.T))


def choose_leds(presses: Sequence[Shading], count: int) -> list[int]:
    """The LEDs of a ring that explain the presses best: one after the other, then exchanged."""

    def explained(numbers: list[int]) -> float:
        return sum(press.explained(numbers) for press in presses)

    chosen: list[int] = []
    for _ in range(count):
        left = [number for number in range(RING) if number not in chosen]
        chosen.append(max(left, key=lambda number: explained([*chosen, number])))
    best, before = explained(chosen), 0.0
    while best > before * (1.0 + LEAST_IMPROVEMENT):
        before = best
        for place in range(count):
            for number in set(range(RING)).difference(chosen):
                other = [*chosen[:place], number, *chosen[place + 1 :]]
                if explained(other) > best * (1.0 + LEAST_IMPROVEMENT):
                    chosen, best = other, explained(other)
    return chosen
