"""Fits the baked model to frames of ball presses at unknown positions and depths.

The parameters are the pose (x_mm, y_mm, depth_mm) of each press, the LEDs and the gel's profile
around a ball, and the linear response of each LED in each color. They are fitted jointly to the
grey levels around the contacts, by the method of Levenberg and Marquardt (1963). The response is
found after each step by ridge regression. Its entries are (LED, place, power): polynomials of the
place times powers of the cosine of incidence, which select_terms selects between two fits.

LEDs that the frames show are found by photometric stereo on the balls. On a ring of LEDs, those are
chosen whose Lambertian light explains the change of the background best. A lobe can replace a tenth
of the depths (measured on a real unit), so these are fitted without it. A sample is a block of
2 x 2 pixels.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares, nnls

from t2twin.core.errors import T2TwinError
from t2twin.sim.calibrate.frames import contact_width_px
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
# Part of the change that the file's LEDs may leave before the fit also starts from LEDs in the
POORLY_EXPLAINED = 0.08  # frames (measured: 0.12 to 0.19 with turned LEDs, below 0.11 without)
# Largest part of the change, in mean square, that the first light and poses may leave (assumed: it
MAX_UNEXPLAINED = 0.25  # is 0.01 to 0.11 on a real unit and sampled ones)
POSE_NUDGE_MM, POSE_REACH_MM = 0.02, 0.3  # difference step and longest fit step of a pose, mm
NUDGE = 0.1  # step of those of the geometry, in standard deviations of the prior
# Mean square error over one press, (grey / 255)^2, that costs as much as one standard deviation of
PRIOR = 2e-5  # a parameter's prior (assumed)
HALF_MM = 3.75  # half side of the square around a press, mm, which contains the shadows
SHALLOWEST_MM, DEEPEST = 0.1, 0.93  # bounds of a depth: mm, and in parts of the ball's radius

HOLD, SKIRT = 0.75, 1.0  # initial profile of the gel around a ball (assumed; see ball_surface)
SMALLEST_LED_MM = 0.3  # initial, mm (assumed: a smaller one has as sharp a shadow)
ELEVATIONS_DEG = (10.0, 18.0, 30.0)  # of the rings of LEDs (assumed: low light to half the slopes)
RING = MAX_LEDS  # number of LEDs of a ring

GROWTH = 2.0  # factor of the ridge from one degree to the next (2 to 8 are equal on a real unit)
DEGREES = (2, 3, PLACE_DEGREE)
RIDGES = (1e-4, 3e-4, 1e-3, 3e-3)  # candidate degrees in the place and weights of the ridge
# Difference in validation error that is a tie, dB (assumed): poses and LEDs were fitted to the
TIE_DB = 0.15  # left-out presses too, which favors weak ridges
GROUPS = 4  # folds of the cross-validation: every fourth press is left out in turn (assumed)
MIN_IMPROVEMENT = 1e-6  # part of the squared error by which exchanging an LED lowers it (assumed)


@dataclass(frozen=True)
class Presses:
    """Presses into one sensor."""

    sensor: GelCamera
    background: np.ndarray  # (rows, columns, 3) uint8, for a fit cleaned
    frames: np.ndarray  # (n, rows, columns, 3) uint8
    patches: np.ndarray  # (n, 2) row and column of each contact, px
    diameters_mm: np.ndarray  # (n,) of the balls
    # Measurements, (n,); NaN where there is none
    depths_mm: np.ndarray  # from first contact
    forces_n: np.ndarray
    names: Sequence[str]  # of the frames' files
    notes: Sequence[str] = ()  # what was found in the frames, in words

    @property
    def has_depths(self) -> bool:
        return bool(np.isfinite(self.depths_mm).any())

    def subset(self, presses: Sequence[int], background: np.ndarray) -> "Presses":
        """The presses with these indices, with another background."""
        arrays = ("frames", "patches", "diameters_mm", "depths_mm", "forces_n")
        picked: Any = {name: getattr(self, name)[presses] for name in arrays}
        names = [self.names[index] for index in presses]
        return replace(self, background=background, names=names, **picked)


def is_at_limit(poses: np.ndarray, diameters_mm: np.ndarray) -> np.ndarray:
    """(n,) bool: whether the depth of a pose (n, 3) is at a limit of the fit."""
    return ~(
        (poses[:, 2] > 1.001 * SHALLOWEST_MM) & (poses[:, 2] < 0.4995 * DEEPEST * diameters_mm)
    )


def too_small(presses: Presses, index: int, camera: Camera) -> T2TwinError:
    """The exception for a ball that is too small for the contact in a frame."""
    width_px = contact_width_px(presses.frames[index], presses.background)
    return T2TwinError(
        f"the ball of {presses.diameters_mm[index]:g} mm is too small for the contact in "
        f"{presses.names[index]}, which is about {width_px / camera.scale_px_per_mm:.1f} mm wide "
        f"at {camera.scale_px_per_mm:g} px/mm; give a diameter of that, a larger scale, or frames "
        "of one ball on the sensor of the background"
    )


@dataclass(frozen=True)
class Terms:
    """The entries of a response and, after them, of its lobe: (LED, place, normal term)."""

    leds: int  # their number
    degree: int  # the highest in the place
    # weight of degree zero, in parts of the columns' mean square; GROWTH times for each further one
    ridge: float
    lobe: bool = False

    @classmethod
    def most(cls, leds: int) -> "Terms":
        """Terms that contain all others."""
        return cls(leds, DEGREES[-1], RIDGES[0], lobe=True)

    @property
    def places(self) -> int:
        return len(place_degrees(self.degree))

    @property
    def cosine_entries(self) -> int:
        """Number of the response's entries without the lobe."""
        return self.leds * self.places * COSINE_TERMS

    @property
    def entries(self) -> int:
        return self.cosine_entries + (self.leds * LOBE_PLACES * LOBE_TERMS if self.lobe else 0)

    def penalty(self, squares: np.ndarray) -> np.ndarray:
        """(entries, entries) diagonal matrix, added to the columns' squares."""
        weights = np.tile(np.repeat(GROWTH ** place_degrees(self.degree), COSINE_TERMS), self.leds)
        if self.lobe:
            of_lobe = np.repeat(GROWTH ** place_degrees(LOBE_DEGREE), LOBE_TERMS)
            weights = np.concatenate([weights, np.tile(of_lobe, self.leds)])
        return np.diag(self.ridge * np.trace(squares) / len(squares) * weights)

    def tables(self, response: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """A response (RGB, entries) and its lobe, None without, each (RGB, LEDs, places, terms)."""
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
    """Sums over a press's samples for least squares."""

    squares: np.ndarray  # (entries, entries) of the columns
    products: np.ndarray  # (entries, RGB) of columns and target
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
        """Square of the change that some LEDs explain, each with any amount of each color."""
        squares, products = self.squares[np.ix_(leds, leds)], self.products[leds]
        floor = 1e-9 * max(float(np.trace(self.squares)), 1e-12)
        factor = np.linalg.cholesky(squares + floor * np.eye(len(squares)))
        wanted = np.linalg.solve(factor, products)
        return float(sum(w @ w - nnls(factor.T, w)[1] ** 2 for w in wanted.T))


def solve_ridge(squares: np.ndarray, products: np.ndarray, terms: Terms) -> np.ndarray:
    """(RGB, entries): the response with the least penalized error."""
    try:
        return np.linalg.solve(squares + terms.penalty(squares), products).T
    except np.linalg.LinAlgError as error:
        raise T2TwinError(
            "no press changes the light of the LEDs in the sensor's file; give LEDs beside the "
            "gel, on the camera's side of its surface"
        ) from error


def select_terms(presses: Sequence[Sums], leds: int) -> Terms:
    """The terms with the least validation error; of ties, the best of the strongest ridge."""
    candidates = [
        Terms(leds, degree, ridge, lobe)
        for ridge in reversed(RIDGES) for degree in DEGREES for lobe in (False, True)
    ]  # fmt: skip
    errors: dict[Terms, float] = {}  # mean over the left-out presses of the mean square error, dB
    for terms in candidates:
        entries = terms.among(Terms.most(leds))
        inner, left_out_errors = np.ix_(entries, entries), []
        for group in range(min(GROUPS, len(presses))):
            fitted = [press for at, press in enumerate(presses) if at % GROUPS != group]
            squares = sum(press.squares[inner] for press in fitted)
            products = sum(press.products[entries] for press in fitted)
            response = solve_ridge(np.asarray(squares), np.asarray(products), terms)
            left_out_errors += [one.error(response, entries) for one in presses[group::GROUPS]]
        errors[terms] = float(np.mean(10.0 * np.log10(np.maximum(left_out_errors, 1e-12))))
    near = [terms for terms in candidates if errors[terms] <= min(errors.values()) + TIE_DB]
    strongest = (each for each in near if each.ridge == near[0].ridge)
    return min(strongest, key=lambda each: errors[each])


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
    while best > before * (1.0 + MIN_IMPROVEMENT):
        before = best
        for place in range(count):
            for number in set(ring).difference(chosen):
                other = [*chosen[:place], number, *chosen[place + 1 :]]
                if explained(other) > best * (1.0 + MIN_IMPROVEMENT):
                    chosen, best = other, explained(other)
    return chosen


@dataclass(frozen=True)
class Geometry:
    """LEDs and the gel's profile, as a vector of parameters."""

    # azimuths and elevations, degrees; a change of all distances from the axis, mm; logarithms of
    # sizes, mm; hold and skirt of ball_surface
    values: np.ndarray
    start: np.ndarray  # the values from which the fit starts
    distances_mm: np.ndarray  # (LEDs,) initial distances from the axis

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
        """Standard deviations of the prior (assumed), in the order of the values."""
        counts = [self.count, self.count, 1, self.count, 1, 1]
        return np.repeat([10.0, 6.0, 1.0, 0.5, 0.1, 0.3], counts)

    @property
    def deviation(self) -> np.ndarray:
        """Deviation from the start, in standard deviations."""
        return (self.values - self.start) / self.spread


@dataclass(frozen=True)
class State:
    """Fitted parameters."""

    camera: Camera  # at the scale of the fit
    geometry: Geometry
    poses: np.ndarray  # (n, 3)
    terms: Terms
    response: np.ndarray  # (RGB, entries of its terms)
    error: float  # mean square error with the priors

    def optics(self, background: np.ndarray) -> Optics:
        """The fitted optics of a background, without noise and modulus."""
        leds = self.geometry.leds
        response = np.zeros((self.geometry.count, 3, PLACE_TERMS, COSINE_TERMS))
        table, lobe = self.terms.tables(self.response)
        response[:, :, : self.terms.places] = table.transpose(1, 0, 2, 3)
        return Optics(
            background=background, leds_mm=leds.places_mm, sizes_mm=leds.sizes_mm,
            response=response, gamma=GAMMA, camera=self.camera,
            lobe=None if lobe is None else lobe.transpose(1, 0, 2, 3),
        )  # fmt: skip


class BallFit:
    """The model of presses of balls; the fit starts from the LEDs of the sensor."""

    def __init__(self, presses: Presses, camera: Camera) -> None:
        optics = presses.sensor.optics
        self.camera, self.gel, self._presses = camera, presses.sensor.own_gel, presses
        self.radii_mm = presses.diameters_mm / 2
        self._start = Geometry.of(Leds(optics.leds_mm, optics.sizes_mm))
        self._rays = Rays(camera, self.gel)
        self._places = place_terms(*self._rays.places_mm)
        light = linear(presses.background, GAMMA)
        half = round(HALF_MM * camera.scale_px_per_mm / 2)
        rows, columns = camera.rows // 2, camera.columns // 2  # whole blocks
        self._targets, self._squares = [], []
        for frame, patch in zip(presses.frames, presses.patches, strict=True):
            sides = []  # of the square about the contact, moved into the image
            for middle, count in zip(patch / 2, (rows, columns), strict=True):
                reach = min(half, count // 2)
                first = round(min(max(middle, reach), count - reach)) - reach
                sides += [first, first + 2 * reach]
            top, bottom, left, right = sides
            change = linear(frame, GAMMA) - light
            change = change[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2, 3)
            samples = change.mean(axis=(1, 3))[top:bottom, left:right]
            self._targets.append(samples.reshape(-1, 3))
            # the lattice of samples has one more row and column at each edge
            self._squares.append((top + 1, bottom + 1, left + 1, right + 1))
        # At the middles of the contacts, at a medium depth.
        y_mm, x_mm = ((presses.patches - camera.middle) / camera.scale_px_per_mm).T
        self._start_poses = np.stack([x_mm, y_mm, 0.45 * self.radii_mm], axis=1)

    def fit(self, start: State | None = None) -> State:
        """Fit all parameters. start: state of another fit, for the initial LEDs and the terms."""
        if start is None:
            state = self._refined(self._first())
            terms = self._selected(state)
        else:
            poses = [self.pose(start, index) for index in range(len(self._targets))]
            state, terms = replace(start, poses=np.array(poses)), start.terms
        state = self._refined(self._solved(state.geometry, state.poses, replace(terms, lobe=False)))
        terms = terms if start else self._selected(state)
        if not terms.lobe:
            return state
        return self._refined(self._solved(state.geometry, state.poses, terms))

    def _first(self) -> State:
        """Poses and light from the initial LEDs or, if these are poor, those in the frames."""
        change = float(np.mean([np.mean(target**2) for target in self._targets]))
        state = self._located(self._start)
        if state.error > POORLY_EXPLAINED * change:
            others = [self._located(geometry) for geometry in self._estimated()]
            state = min((state, *others), key=lambda each: each.error)
        left = state.error / change
        if left > MAX_UNEXPLAINED:
            sums, entries = (
                self._sums(state.geometry, state.poses, state.terms),
                state.terms.entries,
            )
            errors = [press.error(state.response, np.arange(entries)) for press in sums]
            worst = self._presses.names[int(np.argmax(errors))]
            raise T2TwinError(
                f"the light of {self._start.count} LEDs leaves {100 * left:.0f} % of the presses' "
                f"change of the background unexplained, more than {100 * MAX_UNEXPLAINED:.0f} %, "
                f"most in {worst}; use frames of one ball of the given diameter, pressed into the "
                "sensor of the background"
            )
        return state

    def _located(self, geometry: Geometry) -> State:
        """The presses located in the light of given LEDs."""
        state = self._solved(
            geometry, self._start_poses, Terms(geometry.count, DEGREES[0], RIDGES[0])
        )
        poses = [self.pose(state, index, pose) for index, pose in enumerate(state.poses)]
        return self._solved(geometry, np.array(poses), state.terms)

    def _estimated(self) -> list[Geometry]:
        """As many LEDs as initially where the frames show them, one ring for each elevation."""
        distance_mm, size_mm = self._start.distances_mm.mean(), self._start.leds.sizes_mm.mean()
        azimuth = 2.0 * np.pi * np.arange(RING) / RING
        x, y = distance_mm * np.cos(azimuth), -distance_mm * np.sin(azimuth)
        estimated = []
        for elevation_deg in ELEVATIONS_DEG:
            z = np.full(RING, -distance_mm * np.tan(np.radians(elevation_deg)))
            ring = Geometry.of(Leds(np.stack([x, y, z], axis=1), np.full(RING, size_mm)))
            presses = []
            for index, pose in enumerate(self._start_poses):
                (_, lit, _), (_, rest, _) = (
                    self._incidence(ring, index, each, lobe=False) for each in (pose, None)
                )
                presses.append(Sums.of((lit - rest).astype(float), self._targets[index]))
            chosen, leds = choose_leds(presses, self._start.count), ring.leds
            estimated.append(Geometry.of(Leds(leds.places_mm[chosen], leds.sizes_mm[chosen])))
        return estimated

    def _selected(self, state: State) -> Terms:
        """The terms that cross-validation selects."""
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
        """(x_mm, y_mm, depth_mm) of one frame, the model fixed. start: None for several depths."""
        middle, radius_mm = self._start_poses[index], self.radii_mm[index]
        starts = [np.array([*middle[:2], share * radius_mm]) for share in (0.25, 0.45, 0.65)]
        starts = starts if start is None else [start]
        low = np.array([middle[0] - 1.5, middle[1] - 1.5, SHALLOWEST_MM])
        high = np.array([middle[0] + 1.5, middle[1] + 1.5, DEEPEST * radius_mm])
        gain = self._gain(state, index)
        target = self._light(state.geometry, index, None, gain) + self._targets[index]

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

    def surface(self, geometry: Geometry, index: int, pose: np.ndarray) -> np.ndarray:
        """The deflection by one frame's ball at a pose within bounds, mm, on optical_grid(gel)."""
        (x_mm, y_mm, depth), radius_mm = pose, self.radii_mm[index]
        depth = min(max(depth, SHALLOWEST_MM), DEEPEST * radius_mm)
        hold, skirt = geometry.values[-2:]
        hold, skirt = min(max(hold, 0.3), 0.97), min(max(skirt, 0.3), 4.0)
        return ball_surface(self.gel, x_mm, y_mm, depth, radius_mm, hold, skirt)

    def _incidence(
        self, geometry: Geometry, index: int, pose: np.ndarray | None, lobe: bool
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Cosines and weights (samples, LEDs), and for a lobe normals; at rest for no pose."""
        if pose is None:
            surface = np.zeros((self._rays.y_mm.size, self._rays.x_mm.size), dtype=np.float32)
        else:
            surface = self.surface(geometry, index, pose)
        top, bottom, left, right = region = self._squares[index]
        coated = self._rays.coated(surface)
        cosine, weight = (
            np.ascontiguousarray(of[:, top:bottom, left:right].reshape(len(of), -1).T)
            for of in self._rays.incidence(coated, geometry.leds, region)
        )
        if not lobe:
            return cosine, weight, None
        normals = self._rays.normals(coated, region)[:, top:bottom, left:right]
        return cosine, weight, normals.reshape(2, -1).T

    def _place_terms(self, index: int, terms: Terms) -> np.ndarray:
        """(samples, places) polynomials of the place in a press's square."""
        top, bottom, left, right = self._squares[index]
        places = self._places[top:bottom, left:right]
        return places.reshape(-1, places.shape[-1])[:, : terms.places]

    def _changed(
        self, geometry: Geometry, index: int, pose: np.ndarray, terms: Terms
    ) -> np.ndarray:
        """(samples, entries) float64: change of the light by a pose, per unit of each entry."""
        places, leds, columns = self._place_terms(index, terms), range(terms.leds), []
        for each in (pose, None):
            cosine, weight, normals = self._incidence(geometry, index, each, terms.lobe)
            entries = [led_columns(cosine[:, k], weight[:, k], places) for k in leds]
            if normals is not None:
                entries += [lobe_columns(normals, weight[:, k], places) for k in leds]
            columns.append(np.concatenate(entries, axis=-1))
        return (columns[0] - columns[1]).astype(float)

    def _gain(self, state: State, index: int) -> list[np.ndarray]:
        """The response and any lobe at each sample's place: (samples, LEDs, terms, RGB)."""
        places = self._place_terms(index, state.terms)
        return [
            np.einsum("sp,ckpj->skjc", places[:, : table.shape[2]], table, optimize=True)
            for table in state.terms.tables(state.response)
            if table is not None
        ]

    def _light(
        self, geometry: Geometry, index: int, pose: np.ndarray | None, gain: list[np.ndarray]
    ) -> np.ndarray:
        """(samples, RGB) light of a pose, computed without columns."""
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
            Sums.of(self._changed(geometry, index, pose, terms), self._targets[index])
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
        return State(self.camera, geometry, poses, terms, response, error)

    def _step(self, state: State, damping: float) -> tuple[State, float]:
        """One step of the joint fit: the better state, or the same one, and the next damping."""
        matrix, absorbed, gradient = self._normal_equations(state)
        free = np.ones(len(gradient), dtype=bool)
        free[2 : state.poses.size : 3] = not state.terms.lobe  # with a lobe the depths stay
        move = np.zeros(len(gradient))
        for _ in range(4):
            damped = matrix + damping * np.diag(np.diag(matrix)) - absorbed
            try:
                move[free] = -np.linalg.solve(damped[np.ix_(free, free)], gradient[free])
            except np.linalg.LinAlgError as error:  # a depth at its limit
                deepest = int(np.argmax(state.poses[:, 2] / self.radii_mm))
                raise too_small(self._presses, deepest, self.camera) from error
            by_pose, by_geometry = np.split(move, [state.poses.size])
            reach_mm = np.clip(by_pose.reshape(-1, 3), -POSE_REACH_MM, POSE_REACH_MM)
            poses = state.poses + reach_mm
            poses[:, 2] = np.clip(poses[:, 2], SHALLOWEST_MM, DEEPEST * self.radii_mm)
            spread = state.geometry.spread  # a step has at most a standard deviation
            values = state.geometry.values + np.clip(by_geometry, -spread, spread)
            moved = self._solved(replace(state.geometry, values=values), poses, state.terms)
            if moved.error < state.error:
                return moved, damping / 5.0
            damping *= 8.0
        return state, damping

    def _normal_equations(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of a step: matrix, its part that the response absorbs (Schur complement), gradient."""
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
        """Of one press: columns, residual, and derivatives of the light by pose and geometry."""
        fitted, pose = state.geometry, state.poses[index]
        columns = self._changed(fitted, index, pose, state.terms)
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
        return columns, shown - self._targets[index], np.stack(derivatives, axis=-1)
