"""A spring and a damper whose forces are polynomials; the Duffing spring is one of them."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.characteristic import damps, pull, read


class PolynomialSpring(NamedTuple):
    """F = a_1 x + a_2 x^2 + ... + a_n x^n per unit mass.

    Parameters
    ----------
    numbers : (rows, width). A row begins with n; then a_1, ..., a_n follow.
    row : the row of this polynomial.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, coefficients: ArrayLike) -> Self:
        """The spring with these coefficients, m/s^2 per power of m."""
        found = np.asarray(coefficients, float)
        return cls(np.concatenate([[len(found)], found])[None])


class PolynomialDamper(NamedTuple):
    """F = (c_1 + c_2 abs(v) + ... + c_n abs(v)^(n-1)) v per unit mass; the table is as that of
    `PolynomialSpring`."""

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, coefficients: ArrayLike) -> Self:
        """The damper with these coefficients, m/s^2 per power of m/s."""
        return cls(PolynomialSpring.of(coefficients).numbers)


@pull.of(PolynomialSpring)
def _(part, x, v, z):
    numbers, row = part
    total, k = 0.0, int(numbers[row, 0])
    while k > 0:
        total = (total + numbers[row, k]) * x
        k -= 1
    return total


@read.of(PolynomialSpring)
def _(part, numbers, row):
    return PolynomialSpring(numbers, row)


@pull.of(PolynomialDamper)
def _(part, x, v, z):
    numbers, row = part
    total, k, speed = 0.0, int(numbers[row, 0]), abs(v)
    while k > 0:
        total = total * speed + numbers[row, k]
        k -= 1
    return total * v


@damps.of(PolynomialDamper)
def _(part):
    return True


@read.of(PolynomialDamper)
def _(part, numbers, row):
    return PolynomialDamper(numbers, row)
