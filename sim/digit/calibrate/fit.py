"""Fitting the baked model to frames of ball presses at unknown places and depths.

Unknown are every press's place and depth, the LEDs' places and sizes, how the gel leaves the
ball, and the response of each LED in each colour. The response enters linearly, the rest does
not. All are fitted together by Levenberg and Marquardt's method (Marquardt 1963) to the grey
levels around the contacts, and the response is solved for again after every step.

Samples are blocks of 2 x 2 pixels, (ROWS / 2, COLUMNS / 2); a press's pose is (x_mm, y_mm,
depth_mm).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from t2twin.sim.digit import deflections
from t2twin.sim.digit.calibration import PLACE_TERMS, Calibration, led_columns, place_terms
from t2twin.sim.digit.camera import COLUMNS, ROWS, Camera
from t2twin.sim.digit.illumination import COSINE_TERMS
from t2twin.sim.digit.picture import linear
from t2twin.sim.digit.rays import Leds, Rays

GAMMA = 1.0
"""Exponent between light and grey levels of a real unit: shading goes with its grey levels
better than with their power 2.2 (measured by leaving out training presses)."""
PLACES = 6
"""Place polynomials of the response: degree two. A few presses determine no more (assumed)."""
POWERS = 3
"""Powers of the cosine of incidence (assumed)."""
RIDGE = 2e-4
"""Weight of the response's size, as a part of the mean square of its columns (assumed)."""
HALF_SAMPLES = 36
"""Half side of the square around a press that is fitted, samples: 7.5 mm, so that the shadows'
ends are in it."""
STEPS = 8
"""Most steps of the joint fit."""
GAIN = 2e-3
"""It stops when a step lowers the error by less than this part (assumed)."""
SHALLOWEST_MM, DEEPEST = 0.1, 0.93
"""Bounds of a press's depth: mm, and as a part of the ball's radius."""

# name, start, step of the difference quotient, spread of the prior
_GEOMETRY = (
    ("azimuth_0_deg", 30.0, 0.7, 10.0),  # as TACTO's configuration and the maker's notes
    ("azimuth_1_deg", 150.0, 0.7, 10.0),
    ("azimuth_2_deg", 270.0, 0.7, 10.0),
    ("elevation_0_deg", 19.0, 0.5, 6.0),  # assumed from the lengths of real shadows
    ("elevation_1_deg", 19.0, 0.5, 6.0),
    ("elevation_2_deg", 13.0, 0.5, 6.0),
    ("radius_mm", 19.0, 0.5, 4.0),  # assumed: beside the gel
    ("log_size_0", np.log(2.0), 0.05, 0.5),  # assumed: an LED behind a diffuser, mm
    ("log_size_1", np.log(2.0), 0.05, 0.5),
    ("log_size_2", np.log(3.0), 0.05, 0.5),
    ("hold", 0.75, 0.01, 0.1),  # assumed; t2twin.sim.digit.deflections
    ("skirt", 1.0, 0.03, 0.3),
)
_START = np.array([row[1] for row in _GEOMETRY])
_NUDGE = np.array([row[2] for row in _GEOMETRY])
_SPREAD = np.array([row[3] for row in _GEOMETRY])
_POSE_NUDGE = np.array([0.02, 0.02, 0.02])  # mm
_POSE_REACH = np.array([0.3, 0.3, 0.3])  # longest step of a pose, mm
_PRIOR = 2e-5
"""Weight of the priors: a parameter one spread away from its start costs as much as this mean
square error over one press, in (grey / 255)^2 (assumed)."""

Square = tuple[slice, slice]


def _leds_of(geometry: np.ndarray) -> Leds:
    """The LEDs that parameters in the order of _GEOMETRY stand for."""
    azimuth, elevation = np.radians(geometry[0:3]), np.radians(geometry[3:6])
    radius = geometry[6]
    places = np.stack(
        [radius * np.cos(azimuth), -radius * np.sin(azimuth), -radius * np.tan(elevation)], axis=1
    )
    return Leds(places, np.exp(geometry[7:10]))


@dataclass(frozen=True)
class State:
    """geometry: as in _GEOMETRY. poses: (n, 3). response: (RGB, 3 LEDs * PLACES * POWERS)."""

    geometry: np.ndarray
    poses: np.ndarray
    response: np.ndarray
    error: float


class BallFit:
    """Frames of one ball, and the model that is fitted to them.

    background: (ROWS, COLUMNS, 3) uint8, cleaned. frames: (n, ROWS, COLUMNS, 3) uint8.
    patches: (n, 2) rows and columns, px, where the frames are touched.
    """

    def __init__(
        self,
        background: np.ndarray,
        frames: np.ndarray,
        patches: np.ndarray,
        radius_mm: float,
        camera: Camera,
    ) -> None:
        self.background, self.camera, self.radius_mm = background, camera, radius_mm
        self._rays = Rays(camera)
        self._places = place_terms(*self._rays.places_mm)[..., :PLACES]
        light = linear(background, GAMMA)
        self._changes = [_samples(linear(frame, GAMMA) - light) for frame in frames]
        self._squares = [_square(patch) for patch in patches]
        self._start_poses = np.array([self._pose_at(patch) for patch in patches])

    def fit(self) -> State:
        """Everything, from frames alone."""
        state = self._solved(_START, self._start_poses)
        state = self.with_poses(state)
        damping = 1e-2
        for _ in range(STEPS):
            before = state.error
            state, damping = self._step(state, damping)
            if before - state.error < GAIN * before:
                break
        return state

    def with_poses(self, state: State) -> State:
        """The state with every press's pose fitted again, the model held."""
        poses = np.array([self.pose(state, index, pose) for index, pose in enumerate(state.poses)])
        return self._solved(state.geometry, poses)

    def pose(self, state: State, index: int, start: np.ndarray | None = None) -> np.ndarray:
        """The pose of one frame under a model, from that frame alone: (x_mm, y_mm, depth_mm).

        Without a start it is looked for from several depths.
        """
        middle = self._start_poses[index]
        starts = (
            [start]
            if start is not None
            else [np.array([*middle[:2], share * self.radius_mm]) for share in (0.25, 0.45, 0.65)]
        )
        low = np.array([middle[0] - 1.5, middle[1] - 1.5, SHALLOWEST_MM])
        high = np.array([middle[0] + 1.5, middle[1] + 1.5, DEEPEST * self.radius_mm])
        leds, shape = _leds_of(state.geometry), state.geometry[10:12]
        square = self._squares[index]
        rest = self._columns(leds, None, shape, square)
        wanted = self._changes[index][square]

        def residual(pose: np.ndarray) -> np.ndarray:
            columns = self._columns(leds, pose, shape, square) - rest
            return (self._shown(columns, state.response, square) - wanted).ravel()

        fits = [
            least_squares(
                residual, np.clip(pose, low + 1e-6, high - 1e-6), bounds=(low, high),
                x_scale=0.3, diff_step=0.02, ftol=1e-4, xtol=1e-4, max_nfev=12,
            )
            for pose in starts
        ]  # fmt: skip
        return min(fits, key=lambda fit: fit.cost).x

    def calibration(self, state: State) -> Calibration:
        """The model as a file's content."""
        leds = _leds_of(state.geometry)
        response = np.zeros((3, 3, PLACE_TERMS, COSINE_TERMS))
        table = state.response.reshape(3, 3, PLACES, POWERS)
        response[:, :, :PLACES, :POWERS] = table.transpose(1, 0, 2, 3)
        return Calibration(
            background=self.background,
            leds_mm=leds.places_mm,
            sizes_mm=leds.sizes_mm,
            response=response,
            gamma=GAMMA,
            scale_px_per_mm=self.camera.scale_px_per_mm,
            distance_mm=self.camera.distance_mm,
        )

    def surface(self, state: State, pose: np.ndarray) -> np.ndarray:
        """The deflection, mm, that a pose stands for, on optical_grid()."""
        return self._surface(pose, state.geometry[10:12])

    def _surface(self, pose: np.ndarray, shape: np.ndarray) -> np.ndarray:
        depth = min(max(pose[2], SHALLOWEST_MM), DEEPEST * self.radius_mm)
        hold, skirt = min(max(shape[0], 0.3), 0.97), min(max(shape[1], 0.3), 4.0)
        return deflections.ball(pose[0], pose[1], depth, self.radius_mm, hold, skirt)

    def _pose_at(self, patch: np.ndarray) -> np.ndarray:
        """Where a patch's middle is: the first guess of a pose."""
        x_mm = (patch[1] - (COLUMNS - 1) / 2) / self.camera.scale_px_per_mm
        y_mm = (patch[0] - (ROWS - 1) / 2) / self.camera.scale_px_per_mm
        return np.array([x_mm, y_mm, 0.45 * self.radius_mm])

    def _columns(
        self, leds: Leds, pose: np.ndarray | None, shape: np.ndarray, square: Square
    ) -> np.ndarray:
        """(samples, entries) light per unit of each of the response's entries; no pose: at rest."""
        if pose is None:
            surface = np.zeros((self._rays.y_mm.size, self._rays.x_mm.size), dtype=np.float32)
        else:
            surface = self._surface(pose, shape)
        rows, columns = square
        inner = (slice(rows.start + 1, rows.stop + 1), slice(columns.start + 1, columns.stop + 1))
        region = (inner[0].start, inner[0].stop, inner[1].start, inner[1].stop)
        cosine, weight = self._rays.incidence(self._rays.coated(surface), leds, region)
        places = self._places[inner]
        entries = [
            led_columns(cosine[inner][..., k], weight[inner][..., k], places, POWERS)
            for k in range(3)
        ]
        return np.concatenate(entries, axis=-1).reshape(-1, 3 * PLACES * POWERS)

    def _shown(self, columns: np.ndarray, response: np.ndarray, square: Square) -> np.ndarray:
        """(rows, columns, RGB) change of the light."""
        rows, across = square
        return (columns @ response.T).reshape(rows.stop - rows.start, across.stop - across.start, 3)

    def _solved(self, geometry: np.ndarray, poses: np.ndarray) -> State:
        """The best response for a geometry and poses."""
        leds, shape = _leds_of(geometry), geometry[10:12]
        size = 3 * PLACES * POWERS
        squares, products = np.zeros((size, size)), np.zeros((size, 3))
        kept = []
        for pose, change, square in zip(poses, self._changes, self._squares, strict=True):
            columns = self._columns(leds, pose, shape, square)
            columns = columns - self._columns(leds, None, shape, square)
            kept.append(columns)
            squares += columns.T @ columns
            products += columns.T @ change[square].reshape(-1, 3)
        response = np.linalg.solve(squares + _ridge(squares), products).T
        error = float(
            np.mean(
                [
                    np.mean((self._shown(columns, response, square) - change[square]) ** 2)
                    for columns, change, square in zip(
                        kept, self._changes, self._squares, strict=True
                    )
                ]
            )
        )
        off = (geometry - _START) / _SPREAD
        return State(geometry, poses, response, error + _PRIOR / len(poses) * float(off @ off))

    def _step(self, state: State, damping: float) -> tuple[State, float]:
        """One step of the joint fit: the state, the same one if none is better, and the damping."""
        matrix, gradient = self._normal_equations(state)
        linear_part = state.response.size
        for _ in range(4):
            damped = matrix.copy()
            rest = np.arange(linear_part, len(gradient))
            damped[rest, rest] *= 1.0 + damping
            move = -np.linalg.solve(damped, gradient)[linear_part:]
            by_pose = move[: state.poses.size].reshape(-1, 3)
            poses = state.poses + np.clip(by_pose, -_POSE_REACH, _POSE_REACH)
            poses[:, 2] = np.clip(poses[:, 2], SHALLOWEST_MM, DEEPEST * self.radius_mm)
            geometry = state.geometry + np.clip(move[state.poses.size :], -_SPREAD, _SPREAD)
            moved = self._solved(geometry, poses)
            if moved.error < state.error:
                return moved, damping / 5.0
            damping *= 8.0
        return state, damping

    def _normal_equations(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Gauss and Newton's matrix and gradient over (response, poses, geometry)."""
        count, entries = len(state.poses), state.response.shape[1]
        size = 3 * entries + 3 * count + len(_START)
        matrix, gradient = np.zeros((size, size)), np.zeros(size)
        nudged = [(_leds_of(geometry), geometry) for geometry in state.geometry + np.diag(_NUDGE)]
        of_geometry = np.arange(size - len(_START), size)
        samples = 0
        for index in range(count):
            columns, residual, derivatives = self._linearised(state, index, nudged)
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
            ridge = _ridge(matrix[own, own])
            matrix[own, own] += ridge
            gradient[own] += ridge @ state.response[c]
        prior = samples * _PRIOR / _SPREAD**2
        matrix[of_geometry, of_geometry] += prior
        gradient[of_geometry] += prior * (state.geometry - _START)
        return matrix, gradient

    def _linearised(
        self, state: State, index: int, nudged: list[tuple[Leds, np.ndarray]]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One press about a state: columns (samples, entries), residual (samples, RGB), and the
        derivatives (3 of its pose and those of the geometry, samples, RGB) of what is shown.

        nudged: the geometry with each of its parameters in turn moved by its _NUDGE.
        """
        leds, shape = _leds_of(state.geometry), state.geometry[10:12]
        pose, square = state.poses[index], self._squares[index]
        rest = self._columns(leds, None, shape, square)
        columns = self._columns(leds, pose, shape, square) - rest
        shown = self._shown(columns, state.response, square)
        residual = (shown - self._changes[index][square]).reshape(-1, 3)
        derivatives = []
        for axis in range(3):
            other = pose + _POSE_NUDGE * (np.arange(3) == axis)
            beside = self._columns(leds, other, shape, square) - rest
            difference = self._shown(beside, state.response, square) - shown
            derivatives.append(difference / _POSE_NUDGE[axis])
        for (other, geometry), nudge in zip(nudged, _NUDGE, strict=True):
            beside = self._columns(other, pose, geometry[10:12], square)
            beside = beside - self._columns(other, None, geometry[10:12], square)
            derivatives.append((self._shown(beside, state.response, square) - shown) / nudge)
        return columns, residual, np.array(derivatives).reshape(len(derivatives), -1, 3)


def _ridge(squares: np.ndarray) -> np.ndarray:
    return RIDGE * np.trace(squares) / len(squares) * np.eye(len(squares))


def _samples(picture: np.ndarray) -> np.ndarray:
    return picture.reshape(ROWS // 2, 2, COLUMNS // 2, 2, 3).mean(axis=(1, 3))


def _square(patch: np.ndarray) -> Square:
    """The square of samples around a patch, inside the picture."""
    row = round(min(max(patch[0] / 2, HALF_SAMPLES), ROWS // 2 - HALF_SAMPLES))
    column = round(min(max(patch[1] / 2, HALF_SAMPLES), COLUMNS // 2 - HALF_SAMPLES))
    return (
        slice(row - HALF_SAMPLES, row + HALF_SAMPLES),
        slice(column - HALF_SAMPLES, column + HALF_SAMPLES),
    )
