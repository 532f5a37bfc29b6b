"""Compliant stops in the response domain: one sampling interval with contacts in it.

Without the force of the stop the mass would follow the cubic z through the ends of the interval.
The force adds d, with d = d' = 0 when the interval, or the contact, begins:

    x = z + d,    d'' + b d' + w0^2 d = -F(y, y'),    y = x - stop the deflection

    elastic, tabulated    F = f_k + s_k (y - y_k) in each piece
    viscoelastic          F = max(K y + c y', 0)
    Hertz                 F = k y^(3/2)

d is integrated by the Runge-Kutta method of order 4, in sub-steps that are a fixed part of the
shortest time scale of the contact: its errors (CONTACT_ERROR, KINK_ERROR) are the same for any
stiffness and any sampling. Where the slope of F jumps (knots of a table, zero force of a
viscoelastic stop) the order is 3; at the touch of a Hertz stop it is 5/2, so that sub-steps are
shorter there. A contact ends where the cubic through a sub-step first crosses y = 0 downwards;
Newton's method refines that time by repeating the sub-step. Then d decays freely, and the rest of
the interval is a cubic again. A contact may last longer than the interval.

Symbols: a stop is seen as an upper one (a lower one with the signs of x and v changed); q is the
cubic, z - stop = q_0 + q_1 t + q_2 t^2 + q_3 t^3; r = d'. Forces and their sums per unit mass.
"""

import math
from typing import NamedTuple

from stochvi.engine.bounces import MOST_BOUNCES, RESTING
from stochvi.engine.compiling import kernel
from stochvi.engine.free_motion import decay
from stochvi.engine.impact_log import log_impact
from stochvi.engine.roots import time_to_stop
from stochvi.engine.sums import ENDED, IMPULSE, LOSS, PEAK, TIME
from stochvi.methods.monte_carlo.kernels.rows import (
    CONTACT_LOWER,
    CONTACT_UPPER,
    FASTEST,
    FORCE_SQUARE,
    N_LOWER,
    N_UPPER,
    POSITION_FORCE,
    SHARPEST,
)
from stochvi.methods.monte_carlo.kernels.steps import ContactStop

RIGID, PIECES, DAMPED, HERTZ = range(4)
"""Kinds of a `steps.ContactStop`. Its data holds (R,), the rows (y_k, f_k, s_k) of the pieces,
(K, c), or (k,), in this order of the kinds."""

CONTACT_ANGLE = 0.125
"""Length of a sub-step of a contact times the largest rate in that contact, rad: the longest for
which CONTACT_ERROR holds."""

HERTZ_START = 0.125
"""Length of the first and the last sub-step of a Hertz contact, as a share of a full one; lengths
double from the first on and halve towards the last. The force
y^(3/2) has no second derivative at the touch."""

CONTACT_ERROR = 3e-6
"""Relative error of speed, duration, impulse and peak force of a free contact with an elastic or
Hertz stop in such sub-steps: the largest error among a thousand random contacts."""

KINK_ERROR = 6e-4
"""Relative error of the same quantities with kinks: where the force of a viscoelastic stop becomes
zero, and where the slope of a table changes by a factor of some tens. It is 2e-3 for a table whose
slope falls to zero."""

MOST_NEWTON = 40
"""Largest number of Newton steps to the time at which a contact ends; each repeats a sub-step."""

TOP, SQUARE, LEVER = range(5, 8)
"""Entries of the tally of one contact after the five of `rows`: the largest absolute acceleration,
and the integrals of F^2 and of x F over time, with x from the mean position."""

TALLY = 8
"""Number of entries of the tally of one contact."""


class IntervalEnds(NamedTuple):
    """Displacements (m) and velocities (m/s) at the start and at the end of an interval."""

    x0: float
    v0: float
    x1: float
    v1: float


@kernel
def stop_force(y, v, kind, data):
    """Force of a stop in contact, and its derivatives by y and by v.

    Its values for y < 0 matter only in the sub-step in which a contact ends, which is shortened.
    """
    if kind == HERTZ:
        root = math.sqrt(max(y, 0.0))
        return data[0, 0] * y * root, 1.5 * data[0, 0] * root, 0.0
    if kind == DAMPED:
        force = data[0, 0] * y + data[0, 1] * v
        if force <= 0.0:
            return 0.0, 0.0, 0.0
        return force, data[0, 0], data[0, 1]
    piece = data.shape[0] - 1
    while piece > 0 and y < data[piece, 0]:
        piece -= 1
    return data[piece, 1] + data[piece, 2] * (y - data[piece, 0]), data[piece, 2], 0.0


@kernel
def contact_rate(y, v, push, structure, kind, data):
    """Largest rate in a contact, that of its oscillation or of its damping, 1/s.

    `push` is the acceleration with which the mass may be pressed onto a Hertz stop.
    """
    omega, damping_rate = structure
    slope = 0.0
    if kind == HERTZ:
        # where (2/5) k y^(5/2) = E + push y, one of the two terms is at least half of it
        k, y = data[0, 0], max(y, 0.0)
        kinetic = 0.5 * v * v + 0.4 * k * y * y * math.sqrt(y)
        deepest = max((5.0 * kinetic / k) ** 0.4, (5.0 * push / k) ** (2.0 / 3.0))
        slope = 1.5 * k * math.sqrt(deepest)
    elif kind == DAMPED:
        slope, damping_rate = data[0, 0], damping_rate + data[0, 1]
    else:
        for piece in range(data.shape[0]):
            slope = max(slope, data[piece, 2])
    return max(math.sqrt(omega * omega + slope), damping_rate)


@kernel
def cubic_at(q, t):
    """Value, slope and curvature of a cubic at the time t."""
    q0, q1, q2, q3 = q
    return (
        q0 + t * (q1 + t * (q2 + t * q3)),
        q1 + t * (2.0 * q2 + t * 3.0 * q3),
        2.0 * q2 + 6.0 * q3 * t,
    )


@kernel
def cubic_between(x0, v0, x1, v1, span):
    """Coefficients of the cubic with these values and slopes at 0 and `span`."""
    mean = (x1 - x0) / span
    return x0, v0, (3.0 * mean - 2.0 * v0 - v1) / span, (v0 + v1 - 2.0 * mean) / (span * span)


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
def motion_at(t, d, r, q, structure, kind, data):
    """r' and, at the same time, the force on the stop with its rate of change, y and y'."""
    omega, damping_rate = structure
    z, z_rate, z_curvature = cubic_at(q, t)
    y, v = z + d, z_rate + r
    force, stiffness, damping = stop_force(y, v, kind, data)
    a = -damping_rate * r - omega * omega * d - force
    return a, force, stiffness * v + damping * (z_curvature + a), y, v


@kernel
def sub_step(t, d, r, h, q, structure, kind, data):
    """d and r after a step h of the Runge-Kutta method of order 4.

    Further results are the impulse of the force, the work done on the stop, and the integrals of
    F^2 and y F.
    """
    a1, f1, _, y1, v1 = motion_at(t, d, r, q, structure, kind, data)
    half = 0.5 * h
    r2 = r + half * a1
    a2, f2, _, y2, v2 = motion_at(t + half, d + half * r, r2, q, structure, kind, data)
    r3 = r + half * a2
    a3, f3, _, y3, v3 = motion_at(t + half, d + half * r2, r3, q, structure, kind, data)
    r4 = r + h * a3
    a4, f4, _, y4, v4 = motion_at(t + h, d + h * r3, r4, q, structure, kind, data)
    sixth = h / 6.0
    return (
        d + sixth * (r + 2.0 * (r2 + r3) + r4),
        r + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        sixth * (f1 + 2.0 * (f2 + f3) + f4),
        sixth * (f1 * v1 + 2.0 * (f2 * v2 + f3 * v3) + f4 * v4),
        sixth * (f1 * f1 + 2.0 * (f2 * f2 + f3 * f3) + f4 * f4),
        sixth * (f1 * y1 + 2.0 * (f2 * y2 + f3 * y3) + f4 * y4),
    )


@kernel
def integrate_contact(x0, v0, x1, v1, span, structure, position, kind, data, tally):
    """Contact with a stop from y = x0 until it ends or the interval is over.

    x0 and x1 are measured from the stop at `position`; x1, v1 is the end of the interval without
    the force. Returns y, y', the time left, and d, r; the sums of the contact are added to `tally`.
    """
    omega, damping_rate = structure
    q = cubic_between(x0, v0, x1, v1, span)
    push = 2.0 * max(max(q[2], q[2] + 3.0 * q[3] * span), 0.0)
    longest = CONTACT_ANGLE / contact_rate(x0, v0, push, structure, kind, data)
    t, d, r = 0.0, 0.0, 0.0
    _, force, rate, y, v = motion_at(t, d, r, q, structure, kind, data)
    while t < span:
        h = longest
        if kind == HERTZ and v != 0.0:
            # as long as it has lasted so far, or half as long as it will last
            distance = y / v if v > 0.0 else -0.5 * y / v
            h = min(h, max(HERTZ_START * h, distance))
        h = min(h, span - t)
        d1, r1, impulse, work, square, lever = sub_step(t, d, r, h, q, structure, kind, data)
        _, force1, rate1, y1, v1 = motion_at(t + h, d1, r1, q, structure, kind, data)
        s, _ = time_to_stop(-y, -v, -y1, -v1, h, 0.0)
        left = s <= 1.0
        if left:
            whole, h = h, s * h
            for _ in range(MOST_NEWTON):
                d1, r1, impulse, work, square, lever = sub_step(
                    t, d, r, h, q, structure, kind, data
                )
                _, force1, rate1, y1, v1 = motion_at(t + h, d1, r1, q, structure, kind, data)
                following = min(max(h - y1 / v1, 0.5 * h), whole) if v1 < 0.0 else 0.5 * h
                if abs(following - h) <= 1e-13 * whole:
                    break
                h = following
        if kind == DAMPED:
            highest = cubic_maximum(force, rate, force1, rate1, h)
            pushed = data[0, 0] * y + data[0, 1] * v, data[0, 0] * y1 + data[0, 1] * v1
            share = max(pushed[0], 0.0) + max(pushed[1], 0.0)
            if share > 0.0:
                tally[TIME] += h * share / (abs(pushed[0]) + abs(pushed[1]))
            tally[LOSS] += work
        else:
            highest, _, _ = stop_force(cubic_maximum(y, v, y1, v1, h), 0.0, kind, data)
            tally[TIME] += h
        tally[PEAK] = max(tally[PEAK], highest)
        tally[IMPULSE] += impulse
        tally[SQUARE] += square
        tally[LEVER] += lever + position * impulse
        # what the structure adds to the largest force hardly changes within a sub-step
        structural = omega * omega * (position + 0.5 * (y + y1)) + damping_rate * 0.5 * (v + v1)
        tally[TOP] = max(tally[TOP], highest + structural)
        t, d, r, y, v, force, rate = t + h, d1, r1, y1, v1, force1, rate1
        if left:
            return 0.0, min(v, 0.0), max(span - t, 0.0), d, r
    return y, v, 0.0, d, r


@kernel
def next_stop(x0, v0, x1, v1, span, lower, upper):
    """Fraction of the interval until the first stop is touched, the speed there, and its side.

    The fraction is -1 for a mass that is in contact already, and 2 where no stop is touched.
    """
    s, w, side = 2.0, 0.0, 1.0
    if upper is not None:
        if x0 > upper.position and upper.kind != RIGID:
            return -1.0, v0, 1.0
        s, w = time_to_stop(x0, v0, x1, v1, span, upper.position)
    if lower is not None:
        if x0 < lower.position and lower.kind != RIGID:
            return -1.0, -v0, -1.0
        t, below = time_to_stop(-x0, -v0, -x1, -v1, span, -lower.position)
        if t < s:
            s, w, side = t, below, -1.0
    return s, w, side


@kernel
def impact_or_contact(ends, span, sampling, stop, which, tally, peaks, extremes, sums):
    """An impact on a rigid stop, or a contact until it ends or the interval is over.

    `ends` are the state at the stop, which is the lower one for `which` = 0 and is seen as an upper
    one, and the end of the interval as it would be without the stop. Returns both as they are
    afterwards, and the time between them: 0 for a mass that stays at the stop.
    """
    x0, v0, x1, v1 = ends
    omega, damping_rate = sampling.omega, sampling.damping_rate
    position, kind, data = stop
    row = CONTACT_UPPER if which == 1 else CONTACT_LOWER
    if kind == RIGID:
        restitution = data[0, 0]
        if v0 <= RESTING * sampling.scale:
            return position, 0.0, position, 0.0, 0.0
        d, r = 0.0, -(1.0 + restitution) * v0
        sums[row + IMPULSE] -= r
        y, v, left = 0.0, -restitution * v0, span
    else:
        tally[:] = 0.0
        tally[PEAK] = peaks[which]
        y, v, left, d, r = integrate_contact(
            x0 - position, v0, x1 - position, v1, span, (omega, damping_rate), position, kind,
            data, tally,
        )  # fmt: skip
        extremes[SHARPEST] = max(extremes[SHARPEST], tally[TOP])
        extremes[FORCE_SQUARE] += tally[SQUARE]
        extremes[POSITION_FORCE] += tally[LEVER]
        sums[row + IMPULSE] += tally[IMPULSE]
        sums[row + LOSS] += tally[LOSS]
        sums[row + TIME] += tally[TIME]
        peaks[which] = tally[PEAK]
        if y == 0.0:
            sums[row + PEAK] += tally[PEAK]
            sums[row + ENDED] += 1.0
            peaks[which] = 0.0
        if left <= 0.0:
            return position + y, v, position + y, v, 0.0
    shape, slope = decay(left, damping_rate, omega)
    x1 += (slope + damping_rate * shape) * d + shape * r
    v1 += slope * r - omega * omega * shape * d
    return position, v, x1, v1, left


@kernel
def interval_with_contacts(ends, sampling, lower, upper, tally, peaks, extremes, sums, page):
    """One sampling interval with any number of contacts and impacts; returns the end (x, v).

    Parameters
    ----------
    ends : `IntervalEnds`, of which the end is that without the stops.
    sampling : `steps.Sampling`.
    lower, upper : None, or a `steps.ContactStop`.
    tally : (TALLY,), overwritten by the sums of one contact.
    peaks : (2,), largest force so far of a contact that lasts, of the lower and the upper stop.
    extremes, sums : (EXTREMES,) and (CONTACT_SUMS,) of the path, updated.
    page : part of a log.
    """
    x0, v0, x1, v1 = ends
    threshold = sampling.threshold
    whole = span = sampling.span
    for _ in range(MOST_BOUNCES):
        s, w, side = next_stop(x0, v0, x1, v1, span, lower, upper)
        if s > 1.0:
            return x1, v1
        x, row = side * x0, N_UPPER if side > 0.0 else N_LOWER
        if s >= 0.0:
            if upper is not None:
                x = upper.position if side > 0.0 else x
            if lower is not None:
                x = -lower.position if side < 0.0 else x
            sums[row] += 1.0 if w >= threshold else 0.0
            sums[row + 1] += w
            sums[row + 2] += w * w
            extremes[FASTEST] = max(extremes[FASTEST], w)
            span *= 1.0 - s
            if page.open and w >= threshold:
                log_impact(page, 0, whole - span, side * w)
        if span <= 0.0:
            return side * x, side * w
        if upper is not None and side > 0.0:
            x0, v0, x1, v1, span = impact_or_contact(
                IntervalEnds(x, w, x1, v1), span, sampling, upper, 1, tally, peaks, extremes, sums
            )
        if lower is not None and side < 0.0:
            mirrored = ContactStop(-lower.position, lower.kind, lower.data)
            x0, v0, x1, v1, span = impact_or_contact(
                IntervalEnds(x, w, -x1, -v1), span, sampling, mirrored, 0, tally, peaks, extremes,
                sums,
            )  # fmt: skip
            x0, v0, x1, v1 = -x0, -v0, -x1, -v1
        if span <= 0.0:
            return x1, v1
    return x0, 0.0
