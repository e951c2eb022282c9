"""Fits the baked model to frames of ball presses at unknown positions and depths.

The parameters are the pose (x_mm, y_mm, depth_mm) of each press, the geometry that all presses
share, and the response of each LED in each color, which is linear. The geometry is that of the
LEDs, and the gel's profile around a ball. All are fitted jointly to the grey levels around the
contacts by the method of Levenberg and Marquardt (Marquardt 1963); the response is solved for after
each step.
Between two such fits select_terms selects the response's terms.

The response is found by ridge regression. Its entries are (LED, place, power), in this order:
polynomials of the place times powers of the cosine of incidence. High degrees need many presses, so
degree and ridge are chosen by cross-validation.

LEDs that the frames show are found by photometric stereo on surfaces of known normals, the balls,
whose shadows count too. On a ring of LEDs around the gel, those are chosen whose Lambertian light
explains the change of the background best. No color is presumed: an LED has any amount of each, in
each press another one.

A lobe can replace a tenth of the depths (measured on a real unit), so these are fitted without it.

A sample is a block of 2 x 2 pixels; an image has (rows / 2, columns / 2). A press is fitted to the
samples in a square around it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares, nnls

from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.camera import Camera
from t2twin.sim.optical.gel_camera import GelCamera
from t2twin.sim.optical.illumination import (
    COSINE_TERMS,
    LOBE_DEGREE,
    LOBE_PLACES,
    LOBE_TERMS,
    Leds,
    Rays,
    lobe_columns,
    normal_terms,
)
from t2twin.sim.optical.optics import (
    MAX_LEDS,
    PLACE_DEGREE,
    PLACE_TERMS,
    Optics,
    led_columns,
    place_degrees,
    place_terms,
)
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
NUDGE = 0.1  # step of those of the geometry, in standard deviations of the prior
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

GROWTH = 2.0  # factor of the ridge from one degree to the next (2 to 8 are equal on a real unit)
DEGREES = (2, 3, PLACE_DEGREE)
RIDGES = (1e-4, 3e-4, 1e-3, 3e-3)  # candidate degrees in the place and weights of the ridge
TIE_DB = 0.15
"""Difference in validation error that counts as a tie, dB (assumed): poses and LEDs were fitted to
the left-out presses too, which favors weak ridges."""
GROUPS = 4  # folds of the cross-validation: every fourth press is left out in turn (assumed)
LEAST_IMPROVEMENT = 1e-6
"""An LED is exchanged where this lowers the squared error by more than this part (assumed)."""

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
class Terms:
    """leds: their number. degree: the highest in the place. ridge: weight of a term of degree zero,
    in parts of the columns' mean square; GROWTH times as much for each further degree. lobe:
    whether the response's entries are followed by those of the lobe, (LED, place, normal term) in
    this order."""

    leds: int
    degree: int
    ridge: float
    lobe: bool = False

    @classmethod
    def first(cls, leds: int) -> "Terms":
        """Terms of the first fit of poses and LEDs."""
        return cls(leds, DEGREES[0], RIDGES[0])

    @classmethod
    def most(cls, leds: int) -> "Terms":
        """Terms that contain all others."""
        return cls(leds, DEGREES[-1], RIDGES[0], lobe=True)

    @property
    def place_degrees(self) -> np.ndarray:
        """(places,) degree of each polynomial."""
        return place_degrees(self.degree)

    @property
    def places(self) -> int:
        return len(self.place_degrees)

    @property
    def entries(self) -> int:
        of_lobe = self.leds * LOBE_PLACES * LOBE_TERMS if self.lobe else 0
        return self.cosine_entries + of_lobe

    @property
    def cosine_entries(self) -> int:
        """Number of the response's entries without the lobe."""
        return self.leds * self.places * COSINE_TERMS

    def penalty(self, squares: np.ndarray) -> np.ndarray:
        """(entries, entries) diagonal matrix, added to the columns' squares."""
        weights = np.tile(np.repeat(GROWTH**self.place_degrees, COSINE_TERMS), self.leds)
        if self.lobe:
            of_lobe = np.repeat(GROWTH ** place_degrees(LOBE_DEGREE), LOBE_TERMS)
            weights = np.concatenate([weights, np.tile(of_lobe, self.leds)])
        return np.diag(self.ridge * np.trace(squares) / len(squares) * weights)

    def tables(self, response: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """A response (RGB, entries) as (RGB, LEDs, places, COSINE_TERMS), and its lobe as (RGB,
        LEDs, LOBE_PLACES, LOBE_TERMS); None without."""
        cosines, lobe = np.split(response, [self.cosine_entries], axis=1)
        table = cosines.reshape(3, self.leds, self.places, COSINE_TERMS)
        of_lobe = 3, self.leds, LOBE_PLACES, LOBE_TERMS
        return table, lobe.reshape(of_lobe) if self.lobe else None

    def among(self, all_terms: "Terms") -> np.ndarray:
        """(entries,) indices of its entries among those of terms of a higher degree."""
        is_own = np.arange(all_terms.places) < self.places
        of_lobe = np.full(all_terms.entries - all_terms.cosine_entries, self.lobe)
        cosines = np.tile(np.repeat(is_own, COSINE_TERMS), self.leds)
        return np.flatnonzero(np.concatenate([cosines, of_lobe]))


@dataclass(frozen=True)
class Sums:
    """Sums over a press's samples for least squares: squares (entries, entries) and products
    (entries, RGB) of the columns, and the sum of squares of the target."""

    squares: np.ndarray
    products: np.ndarray
    target_square: float
    samples: int

    @classmethod
    def of(cls, columns: np.ndarray, target: np.ndarray) -> "Sums":
        """columns: (samples, entries). target: (samples, RGB) change of the light."""
        total = float(np.sum(target**2))
        return cls(columns.T @ columns, columns.T @ target, total, target.size)

    def error(self, response: np.ndarray, entries: np.ndarray) -> float:
        """Mean square error of a response (RGB, n), for n indices of entries."""
        squares, products = self.squares[np.ix_(entries, entries)], self.products[entries]
        fitted = np.sum((response @ squares) * response) - 2.0 * np.sum(response.T * products)
        return max(float(fitted + self.target_square), 0.0) / self.samples

    def explained(self, leds: Sequence[int]) -> float:
        """Square of the change that some LEDs explain, each with any amount of each color, for
        columns of one entry an LED."""
        squares, products = self.squares[np.ix_(leds, leds)], self.products[leds]
        floor = 1e-9 * max(float(np.trace(self.squares)), 1e-12)
        factor = np.linalg.cholesky(squares + floor * np.eye(len(squares)))
        wanted = np.linalg.solve(factor, products)
        return float(sum(w @ w - nnls(factor.T, w)[1] ** 2 for w in wanted.T))


def solve_ridge(squares: np.ndarray, products: np.ndarray, terms: Terms) -> np.ndarray:
    """(RGB, entries): the response with the least penalized error.

    Raises T2TwinError where no LED's light changes, as that of LEDs which the gel hides.
    """
    try:
        return np.linalg.solve(squares + terms.penalty(squares), products).T
    except np.linalg.LinAlgError as error:
        raise T2TwinError(
            "no press changes the light of the LEDs in the sensor's file; give LEDs beside the "
            "gel, on the camera's side of its surface"
        ) from error


def select_terms(presses: Sequence[Sums], leds: int) -> Terms:
    """The terms with the least cross-validation error.

    Among those within TIE_DB of the least error: the strongest ridge, and of it the best.
    presses: with the entries of Terms.most.
    """
    candidates = [
        Terms(leds, degree, ridge, lobe)
        for ridge in reversed(RIDGES) for degree in DEGREES for lobe in (False, True)
    ]  # fmt: skip
    errors = {terms: cross_validation_error(presses, terms) for terms in candidates}
    near = [terms for terms in candidates if errors[terms] <= min(errors.values()) + TIE_DB]
    strongest = (each for each in near if each.ridge == near[0].ridge)
    return min(strongest, key=lambda each: errors[each])


def cross_validation_error(presses: Sequence[Sums], terms: Terms) -> float:
    """Mean over the left-out presses of the mean square error in dB."""
    entries = terms.among(Terms.most(terms.leds))
    inner = np.ix_(entries, entries)
    errors = []
    for group in range(min(GROUPS, len(presses))):
        left_out = presses[group::GROUPS]
        fitted = [press for at, press in enumerate(presses) if at % GROUPS != group]
        squares = sum(press.squares[inner] for press in fitted)
        products = sum(press.products[entries] for press in fitted)
        response = solve_ridge(np.asarray(squares), np.asarray(products), terms)
        errors += [press.error(response, entries) for press in left_out]
    return float(np.mean(10.0 * np.log10(np.maximum(errors, 1e-12))))


def solve_step(matrix: np.ndarray, gradient: np.ndarray, radii_mm: np.ndarray) -> np.ndarray:
    """The solution of the normal equations of a joint fit.

    Raises T2TwinError where they are singular, which a depth at its limit causes.
    """
    try:
        return np.linalg.solve(matrix, gradient)
    except np.linalg.LinAlgError as error:
        raise T2TwinError(
            f"the ball of {2.0 * radii_mm.min():g} mm is too small for the contacts in the frames, "
            "which are nearly as wide as the ball; give the diameter of the ball, the scale of the "
            "image, and frames of one ball on the sensor of the background"
        ) from error


def choose_leds(presses: Sequence[Sums], count: int) -> list[int]:
    """The LEDs of a ring that explain the presses best: one after the other, then exchanged."""
    ring = range(len(presses[0].squares))

    def explained(numbers: list[int]) -> float:
        return sum(press.explained(numbers) for press in presses)

    chosen: list[int] = []
    for _ in range(count):
        left = [number for number in ring if number not in chosen]
        chosen.append(max(left, key=lambda number: explained([*chosen, number])))
    best, before = explained(chosen), 0.0
    while best > before * (1.0 + LEAST_IMPROVEMENT):
        before = best
        for place in range(count):
            for number in set(ring).difference(chosen):
                other = [*chosen[:place], number, *chosen[place + 1 :]]
                if explained(other) > best * (1.0 + LEAST_IMPROVEMENT):
                    chosen, best = other, explained(other)
    return chosen


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
        """Standard deviations of the prior (assumed): of azimuths, elevations, the distance, sizes,
        hold and skirt."""
        counts = [self.count, self.count, 1, self.count, 1, 1]
        return np.repeat([10.0, 6.0, 1.0, 0.5, 0.1, 0.3], counts)

    @property
    def deviation(self) -> np.ndarray:
        """Deviation from the start, in standard deviations."""
        return (self.values - self.start) / self.spread

    def moved(self, change: np.ndarray) -> "Geometry":
        """After a step of the fit, which has at most a standard deviation."""
        return replace(self, values=self.values + np.clip(change, -self.spread, self.spread))

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
            Sums.of(self._changed(geometry, index, pose, terms).astype(float), self._target(index))
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
        matrix, absorbed, gradient = self._normal_equations(state)
        free = np.ones(len(gradient), dtype=bool)
        free[2 : state.poses.size : 3] = not state.terms.lobe  # with a lobe the depths stay
        move = np.zeros(len(gradient))
        for _ in range(4):
            damped = matrix + damping * np.diag(np.diag(matrix)) - absorbed
            move[free] = -solve_step(damped[np.ix_(free, free)], gradient[free], self.radii_mm)
            by_pose, by_geometry = np.split(move, [state.poses.size])
            reach_mm = np.clip(by_pose.reshape(-1, 3), -POSE_REACH_MM, POSE_REACH_MM)
            poses = state.poses + reach_mm
            poses[:, 2] = np.clip(poses[:, 2], SHALLOWEST_MM, DEEPEST * self.radii_mm)
            moved = self._solved(state.geometry.moved(by_geometry), poses, state.terms)
            if moved.error < state.error:
                return moved, damping / 5.0
            damping *= 8.0
        return state, damping

    def _normal_equations(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the Gauss-Newton step over poses and geometry: the matrix, the part of it that the
        response absorbs (a Schur complement), and the gradient."""
        geometry, entries, first = state.geometry, state.response.shape[1], state.poses.size
        size = first + geometry.values.size
        matrix, gradient = np.zeros((size, size)), np.zeros(size)
        squares, cross = np.zeros((entries, entries)), np.zeros((entries, 3, size))
        samples, both = 0, ((0, 1), (0, 1))
        for index in range(len(state.poses)):
            columns, residual, derivatives = self._linearized(state, index)
            samples = residual.size
            at = np.r_[3 * index : 3 * index + 3, first:size]
            squares += columns.T @ columns
            cross[:, :, at] += np.tensordot(columns, derivatives, (0, 0))
            matrix[np.ix_(at, at)] += np.tensordot(derivatives, derivatives, both)
            gradient[at] += np.tensordot(derivatives, residual, both)
        matrix[first:, first:] += samples * PRIOR * np.diag(1.0 / geometry.spread**2)
        gradient[first:] += samples * PRIOR * geometry.deviation / geometry.spread
        response = solve_ridge(squares, cross.reshape(entries, -1), state.terms)
        absorbed = np.tensordot(cross, response.T.reshape(cross.shape), both)
        return matrix, absorbed, gradient

    def _linearized(self, state: State, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Linearization of one press: columns (samples, entries), residual (samples, RGB), and
        derivatives of the light (samples, RGB, parameters) by its pose and the geometry."""
        fitted, pose = state.geometry, state.poses[index]
        columns = self._changed(fitted, index, pose, state.terms).astype(float)
        shown = columns @ state.response.T
        gain = self._gain(state, index)
        lit = self._light(fitted, index, pose, gain)
        derivatives = []
        for nudged in pose + POSE_NUDGE_MM * np.eye(3):
            derivatives.append((self._light(fitted, index, nudged, gain) - lit) / POSE_NUDGE_MM)
        for step in np.diag(NUDGE * fitted.spread):
            geometry = replace(fitted, values=fitted.values + step)
            moved, rest = (self._light(geometry, index, each, gain) for each in (pose, None))
            derivatives.append((moved - rest - shown) / step.sum())
        return columns, shown - self._target(index), np.stack(derivatives, axis=-1)
