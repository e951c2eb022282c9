"""The response's terms: how many a unit's presses determine, and the fit of their sizes.

The response is linear in its entries, (LED, place, power) in this order: polynomials of the place
times powers of the cosine of incidence. Many presses determine high degrees, few do not; how
many is found out by leaving presses out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from t2twin.sim.digit.calibration import PLACE_DEGREE, place_degrees
from t2twin.sim.digit.light.illumination import COSINE_TERMS

LEDS = 3
GROWTH = 2.0
"""How much dearer a term is than one of a degree less (on a real unit 2 to 8 are alike)."""
DEGREES = (2, 3, PLACE_DEGREE)
RIDGES = (1e-4, 3e-4, 1e-3, 3e-3)
"""Degrees in the place and weights of the ridge among which presses left out choose."""
TIE_DB = 0.15
"""Decibels that count as equally near (assumed): places and LEDs have seen the presses left out,
which favours weak ridges."""
GROUPS = 4
"""Parts of the presses, one of which is left out in turn: every fourth press (assumed)."""


@dataclass(frozen=True)
class Terms:
    """degree: highest in the place. ridge: weight of the response's size, as a part of the mean
    square of its columns, of a term of degree zero; GROWTH times as much for each degree more.
    """

    degree: int
    ridge: float

    @property
    def place_degrees(self) -> np.ndarray:
        """(places,) degree of each polynomial."""
        return place_degrees(self.degree)

    @property
    def places(self) -> int:
        return len(self.place_degrees)

    @property
    def entries(self) -> int:
        return LEDS * self.places * COSINE_TERMS

    def penalty(self, squares: np.ndarray) -> np.ndarray:
        """(entries, entries) diagonal that is added to the columns' squares."""
        dear = np.tile(np.repeat(GROWTH**self.place_degrees, COSINE_TERMS), LEDS)
        return np.diag(self.ridge * np.trace(squares) / len(squares) * dear)

    def among(self, all_terms: "Terms") -> np.ndarray:
        """(entries,) where its entries lie among those of terms of a higher degree."""
        chosen = np.arange(all_terms.places) < self.places
        return np.flatnonzero(np.tile(np.repeat(chosen, COSINE_TERMS), LEDS))


FIRST_TERMS = Terms(DEGREES[0], RIDGES[0])
"""What the first fit of places and LEDs takes."""
MAX_TERMS = Terms(DEGREES[-1], RIDGES[0])


@dataclass(frozen=True)
class Sums:
    """What a least-squares fit needs of a press: squares (entries, entries) and products
    (entries, RGB) of its columns, and the square of what was wanted, over its samples."""

    squares: np.ndarray
    products: np.ndarray
    wanted: float
    samples: int

    @classmethod
    def of(cls, columns: np.ndarray, wanted: np.ndarray) -> "Sums":
        """columns: (samples, entries). wanted: (samples, RGB) change of the light."""
        return cls(
            columns.T @ columns,
            columns.T @ wanted,
            float(np.sum(wanted**2)),
            wanted.size,
        )

    def error(self, response: np.ndarray, entries: np.ndarray) -> float:
        """Mean square error of a response (RGB, entries chosen)."""
        squares, products = self.squares[np.ix_(entries, entries)], self.products[entries]
        fitted = np.sum((response @ squares) * response) - 2.0 * np.sum(response.T * products)
        return max(float(fitted + self.wanted), 0.0) / self.samples


def solved(squares: np.ndarray, products: np.ndarray, terms: Terms) -> np.ndarray:
    """(RGB, entries): the response that fits best."""
    return np.linalg.solve(squares + terms.penalty(squares), products).T


def chosen(presses: Sequence[Sums]) -> Terms:
    """The terms that come nearest to presses left out of the fit, by their mean error in decibels.

    Of those within TIE_DB of the nearest the strongest ridge is taken, and of it the best degree.
    presses: with the entries of MAX_TERMS.
    """
    candidates = [Terms(degree, ridge) for ridge in reversed(RIDGES) for degree in DEGREES]
    errors = [left_out_error(presses, terms) for terms in candidates]
    near = [(terms, error) for terms, error in zip(candidates, errors, strict=True)
            if error <= min(errors) + TIE_DB]  # fmt: skip
    strongest = near[0][0].ridge
    return min((error, terms.degree, terms) for terms, error in near if terms.ridge == strongest)[2]


def left_out_error(presses: Sequence[Sums], terms: Terms) -> float:
    """Mean error of presses left out, each the decibels of its mean square error."""
    entries = terms.among(MAX_TERMS)
    inner = np.ix_(entries, entries)
    errors = []
    for group in range(min(GROUPS, len(presses))):
        left_out = presses[group::GROUPS]
        fitted = [press for at, press in enumerate(presses) if at % GROUPS != group]
        squares = sum(press.squares[inner] for press in fitted)
        products = sum(press.products[entries] for press in fitted)
        response = solved(np.asarray(squares), np.asarray(products), terms)
        errors += [press.error(response, entries) for press in left_out]
    return float(np.mean(10.0 * np.log10(np.maximum(errors, 1e-12))))
