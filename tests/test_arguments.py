"""The checks of arguments: what they return, and what they refuse."""

from fractions import Fraction

import numpy as np
import pytest

from t2twin.core import arguments
from t2twin.core.errors import T2TwinError


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int64(2), np.uint8(2), Fraction(2)])
def test_scalars_are_numbers(value):
    found = arguments.number(value, "x", 0, 3)
    assert found == 2.0 and type(found) is float
    if not isinstance(value, float | np.floating | Fraction):
        assert type(arguments.whole_number(value, "n", low=0, high=2)) is int


@pytest.mark.parametrize(
    "check, value, words",
    [
        (arguments.number, "8", "x is '8' of type str; expected a number"),
        (arguments.number, True, "expected a number"),
        (arguments.number, np.timedelta64(4, "s"), "of type timedelta64; expected a number"),
        (arguments.whole_number, np.timedelta64(4, "s"), "expected a whole number"),
        (arguments.number, np.ones(3), "of type ndarray; expected a number"),
        (arguments.number, 10**400, "expected a number of at most 1.79"),
        (arguments.number, float("nan"), "x is nan; expected a finite number"),
        (arguments.whole_number, 1.0, "expected a whole number"),
        (arguments.check_seed, -1, "seed is -1; expected"),
        (arguments.check_seed, 10**400, r"seed is 1.0*e.400; .* 9223372036854775807$"),
        (arguments.vector, np.ma.masked_equal([1.0, 2.0], 2.0), "expected an array of numbers"),
        (arguments.flag, 1, "expected True or False"),
        (arguments.path, "", "expected a path"),
        (arguments.path, b"x", "expected a path"),
        (arguments.paths, "x.png", "expected a list"),
        (arguments.paths, ["a", None], r"x\[1\] is None of type NoneType; expected a path"),
        (arguments.array, [[1.0], [1.0, 2.0]], "expected an array of numbers"),
        (arguments.vector, np.ones((2, 2)), r"x has shape \(2, 2\); expected \(n,\)"),
        (arguments.vector, [1.0, np.nan], "not finite"),
        (arguments.text, 5, "expected an object of the class str"),
        (arguments.function, 5, "expected a function"),
    ],
)
def test_wrong_values_are_named(check, value, words):
    with pytest.raises(T2TwinError, match=words) as error:
        check(value, *(("x",) if check is not arguments.check_seed else ()))
    assert "\n" not in str(error.value)


def test_bounds_are_named():
    for low, high, words in ((1, 2, "1 to 2"), (1, np.inf, "least 1"), (-np.inf, -3, "most -3")):
        with pytest.raises(T2TwinError, match=words):
            arguments.number(0, "x", low, high)
    with pytest.raises(T2TwinError, match="is 0; expected a whole number of at least 1"):
        arguments.whole_number(0, "n", low=1)
