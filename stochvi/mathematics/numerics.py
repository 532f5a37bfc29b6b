"""Basic numerics. Chapters: types of arrays; comparisons that rounding must not decide;
Gauss-Legendre quadrature; roots by the methods of Brent and of Newton."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

# ------------------------------------------------------------------------------
# Types of arrays, which name what an array holds, not how many axes it has.
# ------------------------------------------------------------------------------


Vector = NDArray[np.float64]
"""Real numbers, one for each of the things that a name or a docstring states."""

Matrix = NDArray[np.float64]
"""Real numbers with two axes or more, of which the last two are rows and columns."""

Array = NDArray[np.float64]
"""Real numbers of any shape."""

Whole = NDArray[np.int64]
"""Whole numbers."""

Waves = NDArray[np.complex128]
"""Complex amplitudes."""

Booleans = NDArray[np.bool_]
"""Truth values."""


# ------------------------------------------------------------------------------
# Comparisons that the rounding of floating-point numbers must not decide.
# ------------------------------------------------------------------------------


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


# ------------------------------------------------------------------------------
# Gauss-Legendre quadrature: one rule, and the same rule on each panel of a range.
# ------------------------------------------------------------------------------


@cache
def gauss_legendre(nodes: int) -> tuple[Vector, Vector]:
    """Nodes and weights of the Gauss-Legendre rule on [-1, 1].

    The rule with n nodes is exact for polynomials up to the degree 2 n - 1. The arrays are shared
    by all callers and cannot be written to.

    Examples
    --------
    >>> nodes, weights = gauss_legendre(2)
    >>> round(float(weights @ nodes**2), 12)
    0.666666666667
    """
    points, weights = np.polynomial.legendre.leggauss(nodes)
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights


def gauss_panels(edges: ArrayLike, nodes: int) -> tuple[Vector, Vector]:
    """Nodes and weights of the Gauss-Legendre rule on every panel between neighbouring edges.

    Parameters
    ----------
    edges
        Ends of the panels along the last axis, (..., panels + 1), in any unit; a panel may be
        empty.
    nodes
        Number of nodes in each panel.

    Returns
    -------
    tuple of ndarray
        Nodes and weights in the unit of the edges, both (..., panels * nodes).

    Examples
    --------
    >>> x, weights = gauss_panels([0.0, 1.0, 3.0], 2)
    >>> round(float(weights @ x**3), 12)
    20.25
    """
    points, weights = gauss_legendre(nodes)
    ends = np.asarray(edges, dtype=float)
    half = np.diff(ends)[..., None] / 2.0
    centre = (ends[..., 1:] + ends[..., :-1])[..., None] / 2.0
    shape = (*ends.shape[:-1], (ends.shape[-1] - 1) * nodes)  # also for no rows at all
    return (centre + half * points).reshape(shape), (half * weights).reshape(shape)


# ------------------------------------------------------------------------------
# The root of a function in a bracket, by the method of Brent, without loading scipy.optimize.
#
# That module takes a quarter of a second to load, a tenth of a first answer. The steps are those of
# its `brentq`, with the same digits: R. P. Brent, Algorithms for Minimization Without Derivatives,
# 1973, chapter 4.
# ------------------------------------------------------------------------------


ROOT_ERROR = 2.0**-50
"""Relative error of a root, four roundings: the least that `brentq` takes, and its default."""

MOST_STEPS = 100


def root_between(
    function: Callable[[float], float], low: float, high: float, error: float = 2e-12
) -> float:
    """Return a root between two places at which the signs of a function differ.

    Parameters
    ----------
    error : largest absolute error of the root, besides ROUNDING.

    Raises
    ------
    ValueError
        If the signs at both ends are the same.
    RuntimeError
        If MOST_STEPS do not suffice, as near a root of high order.
    """
    before, here = low, high
    f_before, f_here = function(before), function(here)
    if f_before == 0.0:
        return before
    if f_here == 0.0:
        return here
    if (f_before > 0.0) == (f_here > 0.0):
        raise ValueError(f"the function must change its sign in [{low:g}, {high:g}]")
    other = f_other = earlier = last = 0.0  # the other end of the bracket, and two last steps
    for _ in range(MOST_STEPS):
        if f_before != 0.0 and f_here != 0.0 and (f_before > 0.0) != (f_here > 0.0):
            other, f_other = before, f_before
            earlier = last = here - before
        if abs(f_other) < abs(f_here):
            before, here, other = here, other, here
            f_before, f_here, f_other = f_here, f_other, f_here
        least = (error + ROOT_ERROR * abs(here)) / 2.0
        half = (other - here) / 2.0
        if f_here == 0.0 or abs(half) < least:
            return here
        step = half
        if abs(earlier) > least and abs(f_here) < abs(f_before):
            if before == other:
                step = -f_here * (here - before) / (f_here - f_before)
            else:
                slope = (f_before - f_here) / (before - here)
                slope_other = (f_other - f_here) / (other - here)
                step = -f_here * (f_other * slope_other - f_before * slope)
                step /= slope_other * slope * (f_other - f_before)
        short = 2.0 * abs(step) < min(abs(earlier), 3.0 * abs(half) - least)
        earlier, last = (last, step) if step is not half and short else (half, half)
        before, f_before = here, f_here
        here += last if abs(last) > least else math.copysign(least, half)
        f_here = function(here)
    raise RuntimeError(f"no root in [{low:g}, {high:g}] after {MOST_STEPS} steps")


# ------------------------------------------------------------------------------
# Newton's method for many problems at once, with slopes by differences.
# ------------------------------------------------------------------------------


STEPS, HALVINGS = 60, 12
"""Largest numbers of Newton steps, and of halvings of one step."""

POLISHED = 1e-12
"""Imbalance at which Newton steps end: the last step usually reaches rounding."""

DIFFERENCE = 1e-7
"""Change of an unknown, of order 1, that gives the slope of the imbalances."""

LARGEST_STEP = 2.0
"""Largest Newton step of an unknown."""


def newton(
    problem: Callable[[Array, Any], Array], start: Array, enough: float = POLISHED
) -> tuple[Array, Vector]:
    """Roots of many problems (unknowns, problems), and the imbalances that are left, by Newton's
    method with each step halved until the largest imbalance falls, until that is small `enough`.

    `problem` gives the imbalances of some problems, whose places are its second argument. All
    unknowns are of order 1.

    >>> found, left = newton(lambda x, some: x**2 - np.array([2.0, 9.0])[some], np.ones((1, 2)))
    >>> found.round(9).tolist(), bool(left.max() < 1e-12)
    ([[1.414213562, 3.0]], True)
    """
    unknowns, every = start.copy(), np.arange(start.shape[1])
    values = problem(unknowns, every)
    moving = every[_size(values) > enough]
    for _ in range(STEPS):
        if not len(moving):
            break
        here, there = unknowns[:, moving], values[:, moving]
        before = _size(there)
        step = _step(problem, moving, here, there)
        left, share = np.arange(len(moving)), 1.0
        for _ in range(HALVINGS + 1):
            tried = here[:, left] + share * step[:, left]
            found = problem(tried, moving[left])
            better = _size(found) < before[left]
            places = moving[left[better]]
            unknowns[:, places], values[:, places] = tried[:, better], found[:, better]
            left, share = left[~better], share / 2.0
            if not len(left):
                break
        going = _size(values[:, moving]) > enough
        going[left] = False
        moving = moving[going]
    return unknowns, _size(values)


def _step(
    problem: Callable[[Vector, Any], Vector], some: Any, here: Vector, there: Vector
) -> Vector:
    """The Newton step of each problem, at most LARGEST_STEP; 0 where there is none."""
    ahead = DIFFERENCE * np.eye(len(here))
    slopes = [(problem(here + each[:, None], some) - there) / DIFFERENCE for each in ahead]
    jacobian = np.transpose(np.array(slopes), (2, 1, 0))
    with np.errstate(all="ignore"):
        jacobian[~(np.abs(np.linalg.det(jacobian)) > 0.0)] = np.nan
        step = -np.linalg.solve(jacobian, there.T[..., None])[..., 0].T
        step = step * np.minimum(1.0, LARGEST_STEP / np.abs(step).max(axis=0))
    return np.where(np.isfinite(step).all(axis=0), step, 0.0)


def _size(imbalance: Vector) -> Vector:
    """Largest imbalance of each problem; infinite where it is not a number."""
    largest = np.abs(imbalance).max(axis=0)
    return np.where(np.isnan(largest), np.inf, largest)
