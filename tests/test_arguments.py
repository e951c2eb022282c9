"""The checks of arguments: what they return, and one plain sentence for everything else."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int64(2), np.uint8(2), Fraction(2)])
def test_scalars_are_numbers(value):
    found = arguments.number(value, "x", 0, 3)
    assert found == 2.0 and type(found) is float


@pytest.mark.parametrize("value", [2, np.int64(2), np.uint8(2)])
def test_integers_are_whole_numbers(value):
    assert type(arguments.whole_number(value, "n", low=0, high=2)) is int


@pytest.mark.parametrize(
    "check, value, words",
    [
        (arguments.number, "8", "x is '8' of type str; expected a number"),
        (arguments.number, True, "x is True of type bool; expected a number"),
        (arguments.number, np.True_, "expected a number"),
        (arguments.number, 1j, "expected a number"),
        (arguments.number, np.ones(3), r"x is of type ndarray, shape \(3,\) and float64; expected"),
        (arguments.number, float("nan"), "x is nan; expected a finite number"),
        (arguments.number, -(10**400), "x is -inf; expected a finite number"),
        (arguments.whole_number, 1.0, "x is 1.0 of type float; expected a whole number"),
        (arguments.flag, 1, "expected True or False"),
        (arguments.path, "", "expected a path"),
        (arguments.path, b"x", "expected a path"),
        (arguments.path, "a\0b", "expected a path"),
        (arguments.paths, "x.png", "expected a list of paths"),
        (arguments.paths, ["a", None], r"x\[1\] is None; expected a path"),
        (arguments.array, [[1.0], [1.0, 2.0]], "expected an array of numbers"),
        (arguments.vector, np.ones((2, 2)), r"x has shape \(2, 2\); expected \(n,\)"),
        (arguments.vector, [1.0, np.nan], "not finite"),
        (arguments.text, "x" * 100, None),
        (arguments.text, 5, "expected text"),
        (arguments.function, 5, "expected a function"),
    ],
)
def test_one_sentence_names_the_argument_the_value_and_what_is_allowed(check, value, words):
    if words is None:
        assert check(value, "x") == value
        return
    with pytest.raises(T2TwinError, match=words) as error:
        check(value, "x")
    assert "\n" not in str(error.value) and len(str(error.value)) < 150


def test_bounds_are_named():
    for low, high, words in (
        (1, 2, "from 1 to 2"),
        (1, np.inf, "of at least 1"),
        (-np.inf, -3, "of at most -3"),
    ):
        with pytest.raises(T2TwinError, match=words):
            arguments.number(0, "x", low, high)
    with pytest.raises(T2TwinError, match="is 0; expected a whole number of at least 1"):
        arguments.whole_number(0, "n", low=1)


def test_paths_are_paths():
    assert arguments.path("a/b", "x") == Path("a/b")
    assert arguments.paths(("a", Path("b")), "x") == [Path("a"), Path("b")]
