"""Fits the baked model to frames of ball presses at unknown positions and depths.

The parameters are the pose (x_mm, y_mm, depth_mm) of each press, the geometry that all presses
share, and the response of each LED in each color, which is linear. The geometry is that of the
LEDs, and the gel's profile around a ball. All are fitted jointly to the grey levels around the
contacts by the method of Levenberg and Marquardt (Marquardt 1963); the response is solved for after
each step.
Between two such fits ridge.select_terms selects the response's terms.

A lobe can replace a tenth of the depths (measured on a real unit), so these are fitted without it.

A sample is a block of 2 x 2 pixels; an image has (rows / 2, columns / 2). A press is fitted to the
samples in a square around it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.ridge import (
    Sums,
    Terms,
    choose_leds,
    select_terms,
    solve_ridge,
    solve_step,
)
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.illumination import COSINE_TERMS, Leds, Rays, lobe_columns, normal_terms
from t2twin.sim.optical.optics import MAX_LEDS, PLACE_TERMS, Optics, led_columns, place_terms
from t2twin.sim.optical.response import linear
from t2twin.sim.optical.surface import ball_surface

GAMMA = 1.0  # exponent between light and grey levels of a real unit (measured by cross-validation)
MAX_STEPS = 8  # largest number of steps of the joint fit
MIN_GAIN = 2e-3  # the fit ends when a step lowers the error by less than this fraction (assumed)
POORLY_EXPLAINED = 0.08
"""The part that the LEDs of the sensor's file may leave before the fit also starts from LEDs that
the frames show. It is 0.12 to 0.19 on units whose LEDs are turned around the gel by 30 to 180
degrees (measured), and below 0.11 on sampled ones, for which both starts are alike."""
MAX_UNEXPLAINED = 0.25
"""Largest part of the change of the light, in mean square, that the first light and poses may leave
(assumed). It is 0.01 to 0.11 on a real unit and sampled ones."""
POSE_NUDGE_MM, POSE_REACH_MM = 0.02, 0.3
"""Step of the difference quotients of a pose, and its longest step in the fit, mm."""
PRIOR = 2e-5
"""Weight of the priors: one standard deviation of a parameter costs as much as this mean square
error over one press, in (grey / 255)^2 (assumed)."""
HALF_MM = 3.75  # half side of the square around a press, mm, which contains the shadows
SHALLOWEST_MM, DEEPEST = 0.1, 0.93
"""Bounds of a press's depth: mm, and in parts of the ball's radius."""

HOLD, SKIRT = 0.75, 1.0
"""Initial profile of the gel around a ball (assumed; t2twin.sim.optical.surface)."""
SMALLEST_LED_MM = 0.3
"""Smallest initial size of an LED, mm (assumed: a smaller one has as sharp a shadow)."""
ELEVATIONS_DEG = (10.0, 18.0, 30.0)
"""Elevations of the rings of LEDs over the apex (assumed: from low light to half of the slopes)."""
RING = MAX_LEDS  # number of LEDs of a ring

Square = tuple[slice, slice]  # rows and columns of samples


@dataclass(frozen=True)
class Measurements:
    """Measurements of n presses, each (n,).

    diameters_mm: of the balls. depths_mm: from first contact. forces_n. The last two are NaN where
    there is no measurement.
    """

    diameters_mm: np.ndarray
    depths_mm: np.ndarray
    forces_n: np.ndarray

    def subset(self, presses: Sequence[int]) -> "Measurements":
        """The measurements of the presses with these indices."""
        return Measurements(
            self.diameters_mm[presses], self.depths_mm[presses], self.forces_n[presses]
        )

    @property
    def has_depths(self) -> bool:
        return bool(np.isfinite(self.depths_mm).any())

    @property
    def has_forces(self) -> bool:
        return bool(np.isfinite(self.forces_n).any())


@dataclass(frozen=True)
class Presses:
    """Presses into one sensor.

    background: (rows, columns, 3) uint8, for a fit cleaned. frames: (n, rows, columns, 3) uint8.
    patches: (n, 2) row and column of each contact, px. names: of the frames' files.
    """

    sensor: GelCamera
    background: np.ndarray
    frames: np.ndarray
    patches: np.ndarray
    measurements: Measurements
    names: Sequence[str] = ()

    def subset(self, presses: Sequence[int], background: np.ndarray) -> "Presses":
        """The presses with these indices, with another background."""
        return Presses(
            self.sensor, background, self.frames[presses], self.patches[presses],
            self.measurements.subset(presses), [self.names[index] for index in presses],
        )  # fmt: skip


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
class State:
    """Fitted parameters.

    poses: (n, 3). response: (RGB, entries of its terms). error:
    mean square error with the priors.
    """

    geometry: Geometry
    poses: np.ndarray
    terms: Terms
    response: np.ndarray
    error: float


def samples_of(image: np.ndarray) -> np.ndarray:
    """(rows / 2, columns / 2, 3): the block means of an image (rows, columns, 3)."""
    rows, columns, colors = image.shape
    return image.reshape(rows // 2, 2, columns // 2, 2, colors).mean(axis=(1, 3))


def square_about(patch: np.ndarray, camera: Camera) -> Square:
    """The square of samples around a contact (row, column), px, moved into the image."""
    sides = []
    for middle, count in zip(patch / 2, (camera.rows // 2, camera.columns // 2), strict=True):
        half = min(round(HALF_MM * camera.scale_px_per_mm / 2), count // 2)
        first = round(min(max(middle, half), count - half)) - half
        sides.append(slice(first, first + 2 * half))
    return sides[0], sides[1]


def inner(square: Square) -> Square:
    """The same square on the lattice of samples, which has one more row and column at each edge."""
    rows, columns = (slice(side.start + 1, side.stop + 1) for side in square)
    return rows, columns


class BallFit:
    """The model of presses of balls; the fit starts from the LEDs of the sensor."""

    def __init__(self, presses: Presses, camera: Camera) -> None:
        optics = presses.sensor.optics
        self.camera, self.gel = camera, presses.sensor.own_gel
        self.background, self.radii_mm = presses.background, presses.measurements.diameters_mm / 2
        self._start = Geometry.of(Leds(optics.leds_mm, optics.sizes_mm))
        self._rays = Rays(camera, self.gel)
        self._places = place_terms(*self._rays.places_mm)
        light = linear(self.background, GAMMA)
        self._changes = [samples_of(linear(frame, GAMMA) - light) for frame in presses.frames]
        self._squares = [square_about(patch, camera) for patch in presses.patches]
        # At the middles of the contacts, at a medium depth.
        y_mm, x_mm = ((presses.patches - camera.middle) / camera.scale_px_per_mm).T
        self._start_poses = np.stack([x_mm, y_mm, 0.45 * self.radii_mm], axis=1)

    def fit(self, start: State | None = None) -> State:
        """Fit all parameters. start: state of another fit, for the initial LEDs and the terms.

        Raises T2TwinError for frames that are no presses of such balls into such a sensor.
        """
        if start is None:
            state = self._refined(self._first())
            terms = self._selected(state)
        else:
            poses = [self.pose(start, index) for index in range(len(self._changes))]
            state, terms = replace(start, poses=np.array(poses)), start.terms
        state = self._refined(self._solved(state.geometry, state.poses, replace(terms, lobe=False)))
        terms = terms if start else self._selected(state)
        if not terms.lobe:
            return state
        return self._refined(self._solved(state.geometry, state.poses, terms))

    def _first(self) -> State:
        """Poses and light from the initial LEDs or, where these explain the presses poorly, from
        the better of them and the LEDs that the frames show.

        Raises T2TwinError for a state that leaves most of the presses unexplained.
        """
        changes = [np.mean(self._target(index) ** 2) for index in range(len(self._changes))]
        state = self._located(self._start)
        if state.error > POORLY_EXPLAINED * np.mean(changes):
            others = [self._located(geometry) for geometry in self._estimated()]
            state = min((state, *others), key=lambda each: each.error)
        left = state.error / float(np.mean(changes))
        if left > MAX_UNEXPLAINED:
            raise T2TwinError(
                f"the light of {self._start.count} LEDs leaves {100 * left:.0f} % of the presses' "
                "change of the background unexplained, more than "
                f"{100 * MAX_UNEXPLAINED:.0f} %; use frames of one ball of the given diameter, "
                "pressed into the sensor of the background"
            )
        return state

    def _located(self, geometry: Geometry) -> State:
        """The presses located in the light of given LEDs."""
        state = self._solved(geometry, self._start_poses, Terms.first(geometry.count))
        poses = [self.pose(state, index, pose) for index, pose in enumerate(state.poses)]
        return self._solved(geometry, np.array(poses), state.terms)

    def _estimated(self) -> list[Geometry]:
        """As many LEDs as initially where the frames show them, for several elevations."""
        estimated = []
        for ring in self._start.rings():
            presses = []
            for index, pose in enumerate(self._start_poses):
                (_, lit, _), (_, rest, _) = (
                    self._incidence(ring, index, each, lobe=False) for each in (pose, None)
                )
                presses.append(Sums.of((lit - rest).astype(float), self._target(index)))
            estimated.append(ring.chosen(choose_leds(presses, self._start.count)))
        return estimated

    def _selected(self, state: State) -> Terms:
        leds = state.geometry.count
        return select_terms(self._sums(state.geometry, state.poses, Terms.most(leds)), leds)

    def _refined(self, state: State) -> State:
        """The joint fit, from an initial state."""
        damping = 1e-2
        for _ in range(MAX_STEPS):
            before, (state, damping) = state.error, self._step(state, damping)
            if before - state.error < MIN_GAIN * before:
                break
        return state

    def pose(self, state: State, index: int, start: np.ndarray | None = None) -> np.ndarray:
        """(x_mm, y_mm, depth_mm) of one frame, the model fixed.

        start: the initial pose; None for several initial depths.
        """
        middle, radius_mm = self._start_poses[index], self.radii_mm[index]
        starts = (
            [start]
            if start is not None
            else [np.array([*middle[:2], share * radius_mm]) for share in (0.25, 0.45, 0.65)]
        )
        low = np.array([middle[0] - 1.5, middle[1] - 1.5, SHALLOWEST_MM])
        high = np.array([middle[0] + 1.5, middle[1] + 1.5, DEEPEST * radius_mm])
        gain = self._gain(state, index)
        target = self._light(state.geometry, index, None, gain) + self._target(index)

        def residual(pose: np.ndarray) -> np.ndarray:
            return (self._light(state.geometry, index, pose, gain) - target).ravel()

        fits = [
            least_squares(
                residual, np.clip(pose, low + 1e-6, high - 1e-6), bounds=(low, high),
                x_scale=0.3, diff_step=0.02, ftol=1e-4, xtol=1e-4, max_nfev=12,
            )
            for pose in starts
        ]  # fmt: skip
        return min(fits, key=lambda fit: fit.cost).x

    def optics(self, state: State) -> Optics:
        """The fitted optics, without noise and modulus."""
        leds = state.geometry.leds
        response = np.zeros((state.geometry.count, 3, PLACE_TERMS, COSINE_TERMS))
        table, lobe = state.terms.tables(state.response)
        response[:, :, : state.terms.places] = table.transpose(1, 0, 2, 3)
        return Optics(
            background=self.background,
            leds_mm=leds.places_mm,
            sizes_mm=leds.sizes_mm,
            response=response,
            gamma=GAMMA,
            **self.camera.placement,
            lobe=None if lobe is None else lobe.transpose(1, 0, 2, 3),
        )

    def surface(self, geometry: Geometry, index: int, pose: np.ndarray) -> np.ndarray:
        """The deflection by one frame's ball at a pose within bounds, mm, on optical_grid(gel)."""
        (x_mm, y_mm, depth), radius_mm = pose, self.radii_mm[index]
        depth = min(max(depth, SHALLOWEST_MM), DEEPEST * radius_mm)
        hold, skirt = geometry.values[-2:]
        hold, skirt = min(max(hold, 0.3), 0.97), min(max(skirt, 0.3), 4.0)
        return ball_surface(self.gel, x_mm, y_mm, depth, radius_mm, hold, skirt)

    def _target(self, index: int) -> np.ndarray:
        """(samples, RGB) change of the light in a press's square."""
        return self._changes[index][self._squares[index]].reshape(-1, 3)

    def _incidence(
        self, geometry: Geometry, index: int, pose: np.ndarray | None, lobe: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Cosines and weights (samples, LEDs), and for a lobe normals (samples, 2).

        pose: None for the gel at rest.
        """
        if pose is None:
            surface = np.zeros((self._rays.y_mm.size, self._rays.x_mm.size), dtype=np.float32)
        else:
            surface = self.surface(geometry, index, pose)
        rows, columns = inner(self._squares[index])
        region = (rows.start, rows.stop, columns.start, columns.stop)
        coated = self._rays.coated(surface)
        cosine, weight = self._rays.incidence(coated, geometry.leds, region)
        normals = None
        if lobe:
            normals = self._rays.normals(coated, region)[:, rows, columns].reshape(2, -1).T
        cosine, weight = (
            np.ascontiguousarray(of[:, rows, columns].reshape(len(of), -1).T)
            for of in (cosine, weight)
        )
        return cosine, weight, normals

    def _columns(
        self, geometry: Geometry, index: int, pose: np.ndarray | None, terms: Terms
    ) -> np.ndarray:
        """(samples, entries) light per unit of each of the response's entries."""
        cosine, weight, normals = self._incidence(geometry, index, pose, terms.lobe)
        places = self._place_terms(index, terms)
        leds = range(terms.leds)
        entries = [led_columns(cosine[:, k], weight[:, k], places) for k in leds]
        if normals is not None:
            entries += [lobe_columns(normals, weight[:, k], places) for k in leds]
        return np.concatenate(entries, axis=-1)

    def _place_terms(self, index: int, terms: Terms) -> np.ndarray:
        """(samples, places) polynomials of the place in a press's square."""
        places = self._places[inner(self._squares[index])]
        return places.reshape(-1, places.shape[-1])[:, : terms.places]

    def _changed(
        self, geometry: Geometry, index: int, pose: np.ndarray, terms: Terms
    ) -> np.ndarray:
        """(samples, entries) the columns of a pose minus those at rest."""
        pressed, rest = (self._columns(geometry, index, each, terms) for each in (pose, None))
        return pressed - rest

    def _gain(self, state: State, index: int) -> list[np.ndarray]:
        """The response and, if fitted, the lobe at each sample's place, for _light: (samples, LEDs,
        COSINE_TERMS or LOBE_TERMS, RGB)."""
        places = self._place_terms(index, state.terms)
        return [
            np.einsum("sp,ckpj->skjc", places[:, : table.shape[2]], table, optimize=True)
            for table in state.terms.tables(state.response)
            if table is not None
        ]

    def _light(
        self, geometry: Geometry, index: int, pose: np.ndarray | None, gain: list[np.ndarray]
    ) -> np.ndarray:
        """(samples, RGB) light of a pose: _columns times the response, computed without them."""
        cosine, weight, normals = self._incidence(geometry, index, pose, len(gain) > 1)
        powers = weight[..., None] * cosine[..., None] ** np.arange(COSINE_TERMS)
        light = np.einsum("skj,skjc->sc", powers, gain[0], optimize=True)
        if normals is not None:
            powers = weight[..., None] * normal_terms(normals)[:, None, :]
            light += np.einsum("skj,skjc->sc", powers, gain[1], optimize=True)
        return light

    def _sums(self, geometry: Geometry, poses: np.ndarray, terms: Terms) -> list[Sums]:
        """Of each press, for the fit of the response."""
        return [
            Sums.of(
                self._changed(geometry, index, pose, terms).astype(float),
                self._target(index),
            )
            for index, pose in enumerate(poses)
        ]

    def _solved(self, geometry: Geometry, poses: np.ndarray, terms: Terms) -> State:
        """The state with the best response of these terms."""
        sums = self._sums(geometry, poses, terms)
        squares = np.sum([press.squares for press in sums], axis=0)
        products = np.sum([press.products for press in sums], axis=0)
        response = solve_ridge(squares, products, terms)
        everything = np.arange(terms.entries)
        error = float(np.mean([press.error(response, everything) for press in sums]))
        error += PRIOR / len(poses) * float(geometry.deviation @ geometry.deviation)
        return State(geometry, poses, terms, response, error)

    def _step(self, state: State, damping: float) -> tuple[State, float]:
        """One step of the joint fit: the better state, or the same one, and the next damping."""
        matrix, gradient = self._normal_equations(state)
        linear_part = state.response.size
        for _ in range(4):
            damped = matrix.copy()
            rest = np.arange(linear_part, len(gradient))
            damped[rest, rest] *= 1.0 + damping
            move = -solve_step(damped, gradient, self.radii_mm)[linear_part:]
            by_pose = move[: state.poses.size].reshape(-1, 3)
            poses = state.poses + np.clip(by_pose, -POSE_REACH_MM, POSE_REACH_MM)
            poses[:, 2] = np.clip(poses[:, 2], SHALLOWEST_MM, DEEPEST * self.radii_mm)
            geometry = state.geometry.moved(move[state.poses.size :])
            moved = self._solved(geometry, poses, state.terms)
            if moved.error < state.error:
                return moved, damping / 5.0
            damping *= 8.0
        return state, damping

    def _normal_equations(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Matrix and gradient of the Gauss-Newton step over (response, poses, geometry)."""
        count, entries = len(state.poses), state.response.shape[1]
        parameters = state.geometry.values.size
        size = 3 * entries + 3 * count + parameters
        matrix, gradient = np.zeros((size, size)), np.zeros(size)
        of_geometry = np.arange(size - parameters, size)
        samples = 0
        for index in range(count):
            columns, residual, derivatives = self._linearized(state, index)
            samples = residual.size
            at = np.concatenate([3 * entries + 3 * index + np.arange(3), of_geometry])
            gram = columns.T @ columns
            for c in range(3):
                own = slice(c * entries, (c + 1) * entries)
                by_parameter = derivatives[:, :, c].T
                matrix[own, own] += gram
                cross = columns.T @ by_parameter
                matrix[own, at] += cross
                matrix[at, own] += cross.T
                matrix[np.ix_(at, at)] += by_parameter.T @ by_parameter
                gradient[own] += columns.T @ residual[:, c]
                gradient[at] += by_parameter.T @ residual[:, c]
        for c in range(3):
            own = slice(c * entries, (c + 1) * entries)
            ridge = state.terms.penalty(matrix[own, own])
            matrix[own, own] += ridge
            gradient[own] += ridge @ state.response[c]
        prior, spread = samples * PRIOR, state.geometry.spread
        matrix[of_geometry, of_geometry] += prior / spread**2
        gradient[of_geometry] += prior * state.geometry.deviation / spread
        if state.terms.lobe:  # the depths stay
            depths = 3 * entries + 3 * np.arange(count) + 2
            matrix[depths], matrix[:, depths] = 0.0, 0.0
            matrix[depths, depths], gradient[depths] = 1.0, 0.0
        return matrix, gradient

    def _linearized(self, state: State, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Linearization of one press: columns (samples, entries), residual (samples, RGB), and
        derivatives of the light (parameters, samples, RGB) by its pose and the geometry."""
        fitted, pose = state.geometry, state.poses[index]
        columns = self._changed(fitted, index, pose, state.terms).astype(float)
        shown = columns @ state.response.T
        gain = self._gain(state, index)
        lit = self._light(fitted, index, pose, gain)
        derivatives = []
        for nudged in pose + POSE_NUDGE_MM * np.eye(3):
            derivatives.append((self._light(fitted, index, nudged, gain) - lit) / POSE_NUDGE_MM)
        for geometry, nudge in fitted.nudged():
            moved, rest = (self._light(geometry, index, each, gain) for each in (pose, None))
            derivatives.append((moved - rest - shown) / nudge)
        return columns, shown - self._target(index), np.array(derivatives)
