"""What a push on a pair changes: an impact, or a contact of any length, described by its moments.

A force f(t') on a pair, per unit of its reduced mass, changes a gap y as

    y(t) = z(t) + int R(t - t') f(t') dt',    R(s) = sum_k c_k s^k

where z is the gap without the force. R is the response of the linear structure to a unit change
of the speed of the pair. Only the moments of the push enter,

    y(t) = z(t) + sum_k c_k S_k(t),    S_k(t) = int (t - t')^k f(t') dt'

An impact that changes the speed by J, a time s ago, has S_k = J s^k. As time goes on without force,
moments change as the powers of a time do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel
from stochvi.engine.fused import fma

MOMENTS = 6
"""Number of moments that are followed during a push. What is left out is below (omega t)^6 / 720 of
the response, where t is the length of the push, at most one step."""

MOST_TERMS = 20
"""Largest number of terms of the series R."""

BINOMIAL = np.array(
    [[1.0 if m == 0 else 0.0 for m in range(MOMENTS)] for _ in range(MOST_TERMS + 1)]
)
for _k in range(1, MOST_TERMS + 1):
    for _m in range(1, MOMENTS):
        BINOMIAL[_k, _m] = BINOMIAL[_k - 1, _m - 1] + BINOMIAL[_k - 1, _m]
"""Binomial coefficients (k over m)."""


BUNDLE, TERMS_AT_ONCE = 16, 4
"""Numbers at the end of a step, and terms of their series, are padded to multiples of these. They
then fill the vectors of a processor."""

Y0, V0, A0, Y1, V1, A1 = range(6)
"""Rows of the ends of what is left of a step: value, slope and curvature of every gap."""


class Responses(NamedTuple):
    """Responses of a structure to a unit change of the speed of each pair, at time 0.

    Parameters
    ----------
    states : (pairs, states, terms), Taylor series in time of all displacements and velocities.
    gaps : (pairs, pairs, 3, terms), Taylor series of value, slope and curvature of every gap.
    accelerations : (pairs, outputs, terms), those that are followed: a series of a unit impulse's
        own acceleration, whose first term belongs to the force, the term k + 1 to the moment k.
    starts : (pairs, MOMENTS, 3 pairs), the terms of value, slope and curvature of all gaps.
    ends : (pairs, terms, numbers), those of all gaps, then those of all states, then zeros.
    """

    states: NDArray[np.float64]
    gaps: NDArray[np.float64]
    accelerations: NDArray[np.float64]
    starts: NDArray[np.float64]
    ends: NDArray[np.float64]


def responses_of(
    states: NDArray[np.float64], gaps: NDArray[np.float64], accelerations: NDArray[np.float64]
) -> Responses:
    """`Responses` from the series of states, gaps and accelerations."""
    pairs, _, terms = states.shape
    of_gaps = gaps.transpose(0, 3, 2, 1).reshape(pairs, terms, 3 * pairs)
    numbers = padded(3 * pairs + states.shape[1], BUNDLE)
    ends = np.zeros((pairs, padded(terms, TERMS_AT_ONCE), numbers))
    ends[:, :terms, : 3 * pairs] = of_gaps
    ends[:, :terms, 3 * pairs : 3 * pairs + states.shape[1]] = states.transpose(0, 2, 1)
    # C order for one pair and for several: each order of arrays has a compiled kernel
    return Responses(
        *(np.ascontiguousarray(each) for each in (states, gaps, accelerations)),
        np.ascontiguousarray(of_gaps[:, :MOMENTS]), ends,
    )  # fmt: skip


@kernel
def padded(number, multiple):
    """The next multiple."""
    return -(-number // multiple) * multiple


SIXTH, SIXTIETH = 1.0 / 6.0, 1.0 / 60.0
"""A division by a number takes several times as long as a product."""


@kernel(forceinline=True)
def next_moments(s0, s1, s2, s3, s4, s5, h, f, middle, end):
    """Moments after h s in which the force is the parabola through its values f, middle, end."""
    h2 = h * h
    h3, h4 = h2 * h, h2 * h2
    h5, h6 = h4 * h, h3 * h3
    return (
        s0 + h * SIXTH * (f + 4.0 * middle + end),
        s1 + h * s0 + h2 * SIXTH * (f + 2.0 * middle),
        s2 + 2.0 * h * s1 + h2 * s0 + h3 * SIXTIETH * (9.0 * f + 12.0 * middle - end),
        s3 + 3.0 * (h * s2 + h2 * s1) + h3 * s0 + h4 * SIXTIETH * (8.0 * f + 8.0 * middle - end),
        s4
        + 4.0 * (h * s3 + h3 * s1)
        + 6.0 * h2 * s2
        + h4 * s0
        + h5 * (1.0 / 210.0) * (25.0 * f + 20.0 * middle - 3.0 * end),
        s5
        + 5.0 * (h * s4 + h4 * s1)
        + 10.0 * (h2 * s3 + h3 * s2)
        + h5 * s0
        + h6 * (1.0 / 84.0) * (9.0 * f + 6.0 * middle - end),
    )


@kernel
def moments_later(now, left, later):
    """The moments from 0 on of a push `left` s later, from the first ones now."""
    power = 1.0
    for k in range(later.shape[0]):
        later[k] = 0.0
    for shift in range(later.shape[0]):
        for m in range(min(MOMENTS, later.shape[0] - shift)):
            later[m + shift] += BINOMIAL[m + shift, m] * power * now[m]
        power *= left


@kernel
def powers_later(change, left, later):
    """The moments of an impact that changes the speed by `change`, `left` s later."""
    for k in range(later.shape[0]):
        later[k] = change
        change *= left


@kernel
def add_terms(target, first, weights, series, pair):
    """Add the rows series[pair, k] with these weights to the numbers of `target` from `first`
    on."""
    for k in range(weights.shape[0]):
        weight = weights[k]
        for i in range(series.shape[2]):
            target[first + i] = fma(weight, series[pair, k, i], target[first + i])


@kernel
def add_four_terms(target, first, weights, series, pair):
    """The same, four rows at a time, for a number of rows that is a multiple of TERMS_AT_ONCE."""
    for k in range(0, weights.shape[0], TERMS_AT_ONCE):
        a, b, c, d = weights[k], weights[k + 1], weights[k + 2], weights[k + 3]
        for i in range(series.shape[2]):
            two = fma(b, series[pair, k + 1, i], fma(a, series[pair, k, i], target[first + i]))
            more = fma(d, series[pair, k + 3, i], c * series[pair, k + 2, i])
            target[first + i] = two + more


@kernel
def parabola_maximum(f0, middle, f1):
    """Largest value of the parabola through values at 0, 1/2 and 1."""
    slope, bend = 4.0 * middle - 3.0 * f0 - f1, 2.0 * (f0 + f1) - 4.0 * middle
    highest = max(f0, f1)
    if bend < 0.0 and 0.0 < slope < -2.0 * bend:
        highest = max(highest, f0 - 0.25 * slope * slope / bend)
    return highest


@kernel(forceinline=True)
def share_above_zero(f0, middle, f1):
    """Share of the way from 0 to 1 on which the parabola through values at 0, 1/2 and 1 is
    positive, where it changes its sign once at most."""
    falls, rises = (f0 > 0.0) & (f1 < 0.0), (f0 < 0.0) & (f1 > 0.0)
    start, end = (f0, f1) if falls else (f1, f0)
    slope, bend = 4.0 * middle - 3.0 * start - end, 2.0 * (start + end) - 4.0 * middle
    root = 0.0
    if falls | rises:
        root = 2.0 * start / (math.sqrt(max(slope * slope - 4.0 * bend * start, 0.0)) - slope)
    whole = 1.0 if (f0 >= 0.0) & (f1 >= 0.0) else 0.0
    return root if falls | rises else whole
