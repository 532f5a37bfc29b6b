"""First roots of the polynomials that a displacement is between two instants.

Polynomials are given by values and slopes at both ends (cubics), or by their Bernstein coefficients
c0 ... c5 (quintics), whose hull holds the polynomial. A root counts where the polynomial rises.
"""

from __future__ import annotations

import math

from stochvi.engine.compiling import kernel

SHORTEST_PIECE = 2.0**-40
"""Smallest part of an interval in which a first root is searched: a shorter excursion is not
seen."""

ROOT_ERROR = 1e-7
"""Relative change of a root in the last Newton step to it: as the method is of second order, what
is left is about the square of that."""


@kernel(forceinline=True)
def rises_once(c1, c2, c3, c4, c5):
    """Whether Bernstein coefficients after a first one <= 0 change sign once, to positive."""
    early = ((c1 <= 0.0) | (c2 > 0.0)) & ((c2 <= 0.0) | (c3 > 0.0))
    return early & ((c3 <= 0.0) | (c4 > 0.0)) & (c5 > 0.0)


@kernel
def bracketed_root(c0, c1, c2, c3, c4, c5):
    """The upward root in (0, 1] of a polynomial that has one, c0 <= 0 < c5, and its slope there."""
    # coefficients by powers, from the differences
    k1, k2 = 5.0 * (c1 - c0), 10.0 * (c2 - 2.0 * c1 + c0)
    k3 = 10.0 * (c3 - 3.0 * (c2 - c1) - c0)
    k4 = 5.0 * (c4 - 4.0 * (c3 + c1) + 6.0 * c2 + c0)
    k5 = c5 - c0 - k1 - k2 - k3 - k4
    low, high, t = 0.0, 1.0, c0 / (c0 - c5)
    slope = 0.0
    for _ in range(100):
        value = c0 + t * (k1 + t * (k2 + t * (k3 + t * (k4 + t * k5))))
        slope = k1 + t * (2.0 * k2 + t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)))
        if value > 0.0:
            high = t
        else:
            low = t
        following = t - value / slope if slope > 0.0 else low
        if not (low < following < high):
            following = 0.5 * (low + high)
        near = abs(following - t) <= ROOT_ERROR * t
        t = following
        if near:
            break
    slope = k1 + t * (2.0 * k2 + t * (3.0 * k3 + t * (4.0 * k4 + t * 5.0 * k5)))
    return t, slope


@kernel
def first_root(c0, c1, c2, c3, c4, c5, stack):
    """First upward root in (0, 1] of a polynomial with c0 <= 0 and its slope there; 2 for no root.

    By Descartes' rule in Bernstein form there is no root without a sign change, and one root with
    one change; with more changes the interval is halved. The halves still to be searched are rows
    (coefficients, start, end) of `stack`.
    """
    start, end = 0.0, 1.0
    waiting = 0
    while True:
        positive, changes = False, 0
        for c in (c1, c2, c3, c4, c5):
            if c != 0.0 and (c > 0.0) != positive:
                positive = not positive
                changes += 1
        if changes == 1:
            t, slope = bracketed_root(c0, c1, c2, c3, c4, c5)
            return start + (end - start) * t, slope / (end - start)
        if changes > 1 and waiting < stack.shape[0] and end - start > SHORTEST_PIECE:
            # de Casteljau in the middle: the left half goes on, the right half waits
            row = stack[waiting]
            middle = 0.5 * (start + end)
            row[5], row[6], row[7] = c5, middle, end
            c1, c2, c3, c4, c5 = (
                0.5 * (c0 + c1), 0.5 * (c1 + c2), 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5),
            )  # fmt: skip
            row[4] = c5
            c2, c3, c4, c5 = 0.5 * (c1 + c2), 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[3] = c5
            c3, c4, c5 = 0.5 * (c2 + c3), 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[2] = c5
            c4, c5 = 0.5 * (c3 + c4), 0.5 * (c4 + c5)
            row[1] = c5
            c5 = 0.5 * (c4 + c5)
            row[0] = c5
            end = middle
            waiting += 1
            continue
        if waiting == 0:
            return 2.0, 0.0
        waiting -= 1
        row = stack[waiting]
        c0, c1, c2, c3, c4, c5 = min(row[0], 0.0), row[1], row[2], row[3], row[4], row[5]
        start, end = row[6], row[7]


@kernel
def cubic_between(x0, v0, x1, v1, span):
    """Coefficients by powers of time of the cubic with these values and slopes at 0 and `span`."""
    mean = (x1 - x0) / span
    return x0, v0, (3.0 * mean - 2.0 * v0 - v1) / span, (v0 + v1 - 2.0 * mean) / (span * span)


@kernel
def cubic_at(q, t):
    """Value and slope of a cubic at the time t."""
    q0, q1, q2, q3 = q
    return q0 + t * (q1 + t * (q2 + t * q3)), q1 + t * (2.0 * q2 + t * 3.0 * q3)


@kernel
def cubic_maximum(f0, r0, f1, r1, span):
    """Largest value of the cubic with these values and slopes at the ends."""
    highest = max(f0, f1)
    if r0 > 0.0 and r1 < 0.0:
        _, c, half, third = cubic_between(f0, r0, f1, r1, span)
        # where c + 2 half t + 3 third t^2 falls through 0
        t = c / (math.sqrt(max(half * half - 3.0 * third * c, 0.0)) - half)
        highest = max(highest, f0 + t * (c + t * (half + t * third)))
    return highest


@kernel
def first_upward_root(c0, c1, c2, c3):
    """First s in (0, 1] where c0 + c1 s + c2 s^2 + c3 s^3 crosses 0 upwards, or 2 for none.

    The cubic starts at or below 0. Its pieces between extrema are monotone, so each holds at
    most one root, which Newton's method finds, kept within bounds by bisection.
    """
    if c0 == 0.0 and c1 == 0.0 and c2 > 0.0:
        return 0.0  # from rest on the stop
    extrema = (2.0, 2.0)
    discriminant = c2 * c2 - 3.0 * c1 * c3
    if discriminant > 0.0:
        q = -(c2 + math.copysign(math.sqrt(discriminant), c2))
        first = q / (3.0 * c3) if c3 != 0.0 else 2.0
        second = c1 / q if q != 0.0 else 2.0
        extrema = (min(first, second), max(first, second))
    left, left_value = 0.0, min(c0, 0.0)
    for piece in range(3):
        right = 1.0 if piece == 2 else extrema[piece]
        if not (left < right <= 1.0):
            continue
        right_value = c0 + right * (c1 + right * (c2 + right * c3))
        if left_value <= 0.0 and right_value > 0.0:
            low, high = left, right
            s = left - left_value * (right - left) / (right_value - left_value)
            for _ in range(60):
                value = c0 + s * (c1 + s * (c2 + s * c3))
                if value > 0.0:
                    high = s
                else:
                    low = s
                slope = c1 + s * (2.0 * c2 + s * 3.0 * c3)
                step = s - value / slope if slope != 0.0 else -1.0
                # the ends are allowed: at the root Newton's step may round to nothing
                following = step if low <= step <= high else 0.5 * (low + high)
                if abs(following - s) <= 1e-15 or high - low <= 1e-15:
                    break
                s = following
            return s
        left, left_value = right, right_value
    return 2.0


@kernel
def time_to_stop(x0, v0, x1, v1, span, stop):
    """Fraction of the interval until x crosses `stop` upwards, 2 for never, and the speed there."""
    top = max(max(x0 + v0 * span / 3.0, x1 - v1 * span / 3.0), max(x0, x1))
    if top <= stop:  # the cubic lies in the hull of its four control points
        return 2.0, 0.0
    rise = x1 - x0
    c1 = v0 * span
    c2 = 3.0 * rise - (2.0 * v0 + v1) * span
    c3 = (v0 + v1) * span - 2.0 * rise
    s = first_upward_root(x0 - stop, c1, c2, c3)
    return s, max((c1 + s * (2.0 * c2 + s * 3.0 * c3)) / span, 0.0)
