"""Impacts of a single pair of rigid stops, many lanes at once.

Within a step the gap y = phi . q of the pair is the quintic through its values, slopes and
curvatures at both ends. A lane is handled here if it meets one stop once; its end of the step is
changed by -(1 + R) w T(remaining time), T the Taylor series of the response to a unit reset.

Symbols: c0 ... c5 are the Bernstein coefficients of the distance beyond a stop, w is the impact
speed and R the restitution.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel
from stochvi.engine.impact_log import log_impact, page_of
from stochvi.engine.roots import ROOT_ERROR, quintic, rises_once
from stochvi.methods.monte_carlo.kernels.matrix_passes import matrix_pass

NEWTON_STEPS = 5
"""Number of Newton steps from the root of the chord to that of the polynomial, the same in all
lanes; a lane that needs more is handled alone."""


class SinglePair(NamedTuple):
    """The only pair of a structure, for the impacts of many lanes at once.

    Parameters
    ----------
    step : s, length of a step.
    stops : (1, 2, 3), position, restitution and speed threshold of the lower and the upper stop.
    impact : table of a matrix pass from powers of the time left to the response to a unit reset.
    first_row : the first row of the pair in the sums.
    """

    step: float
    stops: NDArray[np.float64]
    impact: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]
    first_row: int


class LaneArrays(NamedTuple):
    """Arrays (lanes,) in which single impacts are computed.

    Parameters
    ----------
    c0 ... c5 : Bernstein coefficients of the distance beyond the stop.
    root, slope, bend : fraction of the step at which the stop is reached; first and second
        derivative of the polynomial there.
    side : 1 for the upper stop, -1 for the lower one, 0 for a lane that is not handled.
    powers : (terms, lanes), powers of the time left after the impact.
    response : (rows, lanes), response to a unit reset at the end of the step.
    """

    c0: NDArray[np.float64]
    c1: NDArray[np.float64]
    c2: NDArray[np.float64]
    c3: NDArray[np.float64]
    c4: NDArray[np.float64]
    c5: NDArray[np.float64]
    root: NDArray[np.float64]
    slope: NDArray[np.float64]
    bend: NDArray[np.float64]
    side: NDArray[np.float64]
    powers: NDArray[np.float64]
    response: NDArray[np.float64]


@kernel
def lane_arrays(lanes, terms, rows):
    """`LaneArrays` for that number of lanes, powers, and rows of the response."""
    c = np.zeros((10, lanes))
    return LaneArrays(
        c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9],
        np.zeros((terms, lanes)), np.zeros((rows, lanes)),
    )  # fmt: skip


@kernel
def newton_roots(c0, c1, c2, c3, c4, c5, t, count):
    """Root t in each lane of a polynomial that is <= 0 at 0 and rises through 0 once."""
    for i in range(count):
        s = c0[i] / (c0[i] - c5[i])
        for _ in range(NEWTON_STEPS):
            value, slope = quintic(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], s)
            s = min(max(s - value / slope, 0.0), 1.0)
        t[i] = s if s >= 0.0 else 0.0  # a NaN would stay in the lanes of `response`


@kernel
def root_slopes(c0, c1, c2, c3, c4, c5, t, slope, count):
    """Slope of the polynomial of each lane at t, or -1 where t is no root."""
    for i in range(count):
        value, rise = quintic(c0[i], c1[i], c2[i], c3[i], c4[i], c5[i], t[i])
        slope[i] = rise if abs(value) <= ROOT_ERROR * rise else -1.0


@kernel
def root_curvatures(c0, c1, c2, c3, c4, c5, t, bend, count):
    """Second derivative of the polynomial of each lane at t."""
    for i in range(count):
        s, u = t[i], 1.0 - t[i]
        d0, d1 = c2[i] - 2.0 * c1[i] + c0[i], c3[i] - 2.0 * c2[i] + c1[i]
        d2, d3 = c4[i] - 2.0 * c3[i] + c2[i], c5[i] - 2.0 * c4[i] + c3[i]
        d0, d1, d2 = u * d0 + s * d1, u * d1 + s * d2, u * d2 + s * d3
        d0, d1 = u * d0 + s * d1, u * d1 + s * d2
        bend[i] = 20.0 * (u * d0 + s * d1)


@kernel
def remaining_powers(t, step, powers, count):
    """Powers 0, 1, ... of the time left after the root, one row each."""
    for i in range(count):
        powers[0, i] = 1.0
    for k in range(1, powers.shape[0]):
        for i in range(count):
            powers[k, i] = powers[k - 1, i] * ((1.0 - t[i]) * step)


@kernel
def single_impacts(pair, ends, new, index, count, sums, arrays, log, first_path, number):
    """Impacts of a `SinglePair` that are alone in their step, many lanes at once.

    A lane is handled here if its end lies beyond one stop, its quintic rises through that stop
    once, and the hull of the motion after the impact stays between the stops. The other lanes are
    put at the front of `index`, in order; returns their number.

    Parameters
    ----------
    ends : (y0, v0, a0, y1, v1, a1), each (1, lanes), of which the end y1 is changed.
    new : (states, lanes), states at the end of the step, changed.
    index, count : numbers of the lanes that may reach a stop, and how many they are.
    sums : (rows, lanes); impacts of counted steps (`number` >= 0) are added from `first_row` on.
    arrays : `LaneArrays`, overwritten.
    log : None, or an `impact_log.Log`, where `first_path` is the number of the first lane.
    """
    step, stops, table, first_row = pair
    y0, v0, a0, y1, v1, a1 = ends
    c0, c1, c2, c3, c4, c5, t, slope, bend, side, powers, response = arrays
    fifth, twentieth = 0.2 * step, 0.05 * step * step
    for k in range(count):
        i = index[k]
        sign = 1.0 if y1[0, i] > stops[0, 1, 0] else -1.0
        stop = stops[0, 1, 0] if sign > 0.0 else stops[0, 0, 0]
        begin, end = sign * (y0[0, i] - stop), sign * (y1[0, i] - stop)
        c0[k], c5[k] = begin, end
        c1[k] = begin + fifth * sign * v0[0, i]
        c2[k] = begin + 2.0 * fifth * sign * v0[0, i] + twentieth * sign * a0[0, i]
        c4[k] = end - fifth * sign * v1[0, i]
        c3[k] = end - 2.0 * fifth * sign * v1[0, i] + twentieth * sign * a1[0, i]
        once = rises_once(c1[k], c2[k], c3[k], c4[k], end)
        side[k] = sign if once & (begin <= 0.0) else 0.0
    newton_roots(c0, c1, c2, c3, c4, c5, t, count)
    root_slopes(c0, c1, c2, c3, c4, c5, t, slope, count)
    root_curvatures(c0, c1, c2, c3, c4, c5, t, bend, count)
    remaining_powers(t, step, powers, count)
    matrix_pass(response, 0.0, powers, table, count)
    left = 0
    width = stops[0, 1, 0] - stops[0, 0, 0]
    for k in range(count):
        i, sign, rest = index[k], side[k], powers[1, k]
        which = 1 if sign > 0.0 else 0
        restitution = stops[0, which, 1]
        w = slope[k] / step
        change = -(1.0 + restitution) * w
        end = c5[k] + change * response[0, k]
        speed = sign * v1[0, i] + change * response[1, k]
        curve = sign * a1[0, i] + change * response[2, k]
        # Bernstein coefficients of the motion after the impact
        b1 = -0.2 * rest * restitution * w
        b2 = 2.0 * b1 + 0.05 * rest * rest * bend[k] / (step * step)
        b4 = end - 0.2 * rest * speed
        b3 = end - 0.4 * rest * speed + 0.05 * rest * rest * curve
        highest = max(max(b1, b2), max(max(b3, b4), end))
        lowest = min(min(b1, b2), min(min(b3, b4), end))
        if (sign == 0.0) | (slope[k] < 0.0) | (highest > 0.0) | (lowest < -width):
            index[left] = i
            left += 1
            continue
        for row in range(response.shape[0] - 3):
            new[row, i] += sign * change * response[3 + row, k]
        y1[0, i] += sign * change * response[0, k]
        if number >= 0:
            row = first_row + 3 * which
            sums[row, i] += 1.0 if w >= stops[0, which, 2] else 0.0
            sums[row + 1, i] += w
            sums[row + 2, i] += w * w
        if log is not None:
            page = page_of(log, first_path + i, number, step)
            if page.open and w >= stops[0, which, 2]:
                log_impact(page, 0, t[k] * step, sign * w)
    return left
