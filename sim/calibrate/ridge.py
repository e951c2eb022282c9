"""Least squares of the light: the response by ridge regression, and LEDs that frames show.

The response is linear in its entries, (LED, place, power) in this order: polynomials of the place
times powers of the cosine of incidence. High degrees need many presses, so degree and ridge are
chosen by cross-validation.

Photometric stereo finds the directions of the light from surfaces of known normals. Here the
surfaces are those of the balls, and the shadows that they cast count too. On a ring of LEDs around
the gel, those are chosen whose Lambertian light explains the change of the background best. No
color is presumed: an LED has any amount of each, in each press another one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from t2twin.core.errors import T2TwinError
from t2twin.sim.optical.illumination import COSINE_TERMS, LOBE_DEGREE, LOBE_PLACES, LOBE_TERMS
from t2twin.sim.optical.optics import PLACE_DEGREE, place_degrees

GROWTH = 2.0  # factor of the ridge from one degree to the next (2 to 8 are equal on a real unit)
DEGREES = (2, 3, PLACE_DEGREE)
RIDGES = (1e-4, 3e-4, 1e-3, 3e-3)  # candidate degrees in the place and weights of the ridge
TIE_DB = 0.15
"""Difference in validation error that counts as a tie, dB (assumed): poses and LEDs were fitted to
the left-out presses too, which favors weak ridges."""
GROUPS = 4  # folds of the cross-validation: every fourth press is left out in turn (assumed)
LEAST_IMPROVEMENT = 1e-6
"""An LED is exchanged where this lowers the squared error by more than this part (assumed)."""


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
