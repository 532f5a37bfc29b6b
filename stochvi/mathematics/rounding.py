"""Comparisons that the rounding of floating-point numbers must not decide."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

ROUNDING = 1e-9
"""Relative difference of two numbers that counts as rounding: far above what sums and libraries
of different processors leave, far below what anyone measures."""

CANCELLATION = 1e-12
"""Size of a sum of numbers that cancel each other, relative to these numbers, up to which it counts
as 0: some thousand rounding errors of one number."""


def ceil(ratio: float) -> int:
    """Least whole number that is not below a ratio by more than rounding.

    >>> ceil(0.3 / 0.1 + 1e-12), ceil(3.001)
    (3, 4)
    """
    return math.ceil(ratio - ROUNDING * abs(ratio))


def floor(ratio: float) -> int:
    """Largest whole number that is not above a ratio by more than rounding.

    >>> floor(0.3 / 0.1), floor(2.999), math.floor(0.3 / 0.1)
    (3, 2, 2)
    """
    return math.floor(ratio + ROUNDING * abs(ratio))


def within(value: ArrayLike, low: float, high: float) -> NDArray[np.bool_]:
    """Whether positive values lie in [low, high], ends included whatever the rounding.

    >>> within([5.000000000000002, 5.1], 0.1, 5.0).tolist()
    [True, False]
    """
    value = np.asarray(value)
    return (value >= low * (1.0 - ROUNDING)) & (value <= high * (1.0 + ROUNDING))
