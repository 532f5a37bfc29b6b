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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel

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


class Responses(NamedTuple):
    """Responses of a structure to a unit change of the speed of each pair, at time 0.

    Parameters
    ----------
    states : (pairs, states, terms), Taylor series in time of all displacements and velocities.
    gaps : (pairs, pairs, 3, terms), Taylor series of value, slope and curvature of every gap.
    accelerations : (pairs, outputs, terms), those that are followed: a series of a unit impulse's
        own acceleration, whose first term belongs to the force, the term k + 1 to the moment k.
    """

    states: NDArray[np.float64]
    gaps: NDArray[np.float64]
    accelerations: NDArray[np.float64]


SIXTH, SIXTIETH = 1.0 / 6.0, 1.0 / 60.0
"""A division by a number takes several times as long as a product."""


@kernel(inline="always")
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
def apply_push(pair, now, later, responses, gaps, change):
    """Add the response to a push to what is left of a step.

    Parameters
    ----------
    now, later : (MOMENTS,) and (terms,), moments of the push at the start and the end of that.
    gaps : (pairs, 6), value, slope and curvature of every gap at both ends.
    change : (states,), what pushes add to the states at the end of the step.
    """
    states, series, _ = responses
    for other in range(gaps.shape[0]):
        for what in range(3):
            first = last = 0.0
            for k in range(MOMENTS):
                first += series[pair, other, what, k] * now[k]
            for k in range(later.shape[0]):
                last += series[pair, other, what, k] * later[k]
            gaps[other, what] += first
            gaps[other, 3 + what] += last
    for row in range(change.shape[0]):
        total = 0.0
        for k in range(later.shape[0]):
            total += states[pair, row, k] * later[k]
        change[row] += total
