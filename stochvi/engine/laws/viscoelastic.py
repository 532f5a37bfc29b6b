"""A linear spring, alone or with a damper beside it."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.bounces import MOST_EVENTS
from stochvi.engine.compiling import kernel
from stochvi.engine.free_motion import decay, travel_time, undamped_motion
from stochvi.engine.law import energy, force, is_lossy, margin, rate, read
from stochvi.engine.linear_pieces import STAYS, through_piece
from stochvi.engine.mass_contacts import lost_energy, through
from stochvi.engine.sums import IMPULSE, LEFT, LOSS, PEAK, PLACE, SPEED, TIME

MOST_NEWTON = 60
"""Largest number of Newton steps to a root: as many as bisection needs for double precision."""


class Viscoelastic(NamedTuple):
    """F = K y + c y' while it is positive, with the `stiffness` K (1/s^2) and `damping` c (1/s)."""

    stiffness: float
    damping: float


@force.of(Viscoelastic)
def _(law, y, v):
    return law.stiffness * y + law.damping * v


@energy.of(Viscoelastic)
def _(law, y):
    return 0.5 * law.stiffness * y * y


@margin.of(Viscoelastic)
def _(law, y, v):
    return y + law.damping / law.stiffness * v


@rate.of(Viscoelastic)
def _(law, y, v, push):
    return max(math.sqrt(law.stiffness), law.damping)


@is_lossy.of(Viscoelastic)
def _(law):
    return law.damping > 0.0


@read.of(Viscoelastic)
def _(law, numbers, row):
    return Viscoelastic(numbers[row, 0], numbers[row, 1])


# ---- the contact of one mass, in closed form ----------------------------------------------------


@through.of(Viscoelastic)
def _(law, y, v, left, pressing, stiffness, found):
    found[IMPULSE], found[LOSS], found[TIME] = 0.0, 0.0, 0.0
    if law.damping == 0.0:
        piece = 0.0, math.inf, 0.0, law.stiffness
        where, y, v, left = through_piece(y, v, left, piece, pressing, stiffness, found)
        over = where != STAYS
    else:
        over, y, v, left = through_damper(law, y, v, left, pressing, stiffness, found)
    found[PLACE], found[SPEED] = 0.0 if over else y, v
    found[LEFT] = left if over else 0.0


@kernel
def through_damper(law, y, v, left, pressing, stiffness, found):
    """Follow a contact with a damped stop: whether it ends, y, v and the time left.

    Where K y + c v < 0 the stop withdraws without a force, as fast as the mass. With
    q = y + (c / K) v, which in free motion swings about the same centre as y, it pushes again when
    q passes 0 upwards, and is left when y passes 0 downwards.
    """
    omega, lag = math.sqrt(stiffness), law.damping / law.stiffness
    pushes = y + lag * v > 0.0
    for _ in range(MOST_EVENTS):
        if pushes:
            t, ends, peak = time_to_zero_force(law, y, v, left, pressing, stiffness)
            y1, v1 = damped_motion(law, y, v, t, pressing, stiffness)
            way, change, square = y1 - y, v1 - v, stiffness + law.stiffness
            found[PEAK] = max(found[PEAK], peak)
            found[IMPULSE] += law.damping * way + law.stiffness / square * (
                pressing * t - change - law.damping * way
            )
            found[LOSS] += lost_energy(y, v, y1, v1, pressing, stiffness)
            found[TIME] += t
            pushes = False
            if not ends:
                return False, y1, v1, 0.0
            y, v = max(y1, 0.0), v1
        else:
            out, again, w = free_events(y, v, lag, pressing, stiffness, omega)
            t = min(min(out, again), left)
            y1, v1 = undamped_motion(y, v, pressing - stiffness * y, t, omega)
            if t == left:
                return False, y1, v1, 0.0
            if out <= again:
                return True, 0.0, -w, left - t
            y, v = max(y1, 0.0), v1
            pushes = True
        left -= t
    return False, y, v, 0.0


@kernel
def free_events(y, v, lag, pressing, stiffness, omega):
    """Times until a stop that follows the mass without a force is left, and until it pushes again;
    and the speed at which it is left."""
    a, out, again, w = pressing - stiffness * y, math.inf, math.inf, 0.0
    energy = v * v - (a + pressing) * y
    if energy > 0.0:
        w = math.sqrt(energy)
        out = travel_time(y, v, -w, a + pressing, omega)
    q, rise = min(y + lag * v, 0.0), v + lag * a
    a_q = pressing - stiffness * q
    energy = rise * rise - (a_q + pressing) * q
    if q == 0.0 and rise > 0.0:
        again = 0.0
    elif energy > 0.0:
        again = travel_time(q, rise, math.sqrt(energy), a_q + pressing, omega)
    return out, again, w


@kernel
def damped_motion(law, y, v, t, pressing, stiffness):
    """Deflection and rate after t under spring and stop, also where the stop pulls."""
    square = stiffness + law.stiffness
    shape, slope = decay(t, law.damping, math.sqrt(square))
    push = pressing - square * y
    return (
        y + v * shape + push * (1.0 - slope - law.damping * shape) / square,
        v * slope + push * shape,
    )


@kernel
def zeros_of_rate(rise, curvature, damping, square):
    """Times of the first two zeros of r, r'' + c r' + W^2 r = 0, r(0) = rise, r'(0) = curvature.

    Infinite where there is none. A zero at t = 0 counts where r is negative afterwards.
    """
    half = 0.5 * damping
    gain = curvature + half * rise
    inner = square - half * half
    root = math.sqrt(abs(inner))
    falls = rise > 0.0 or (rise == 0.0 and gain < 0.0)
    sine, cosine = (rise, -gain) if falls else (-rise, gain)
    if inner > 0.0:
        first = math.atan2(root * sine, cosine) / root
        if rise == 0.0 and not falls:
            first = math.pi / root
        return first, first + math.pi / root
    if (rise == 0.0 and not falls) or cosine <= 0.0 or root * sine >= cosine:
        return math.inf, math.inf
    if root * sine < 1e-8 * cosine:
        return sine / cosine, math.inf
    return math.atanh(root * sine / cosine) / root, math.inf


@kernel
def time_to_zero_force(law, y, v, left, pressing, stiffness):
    """Time until the force is zero, at most `left`, whether it becomes so, and its largest value.

    F = K y + c v obeys F'' + c F' + W^2 F = constant, so that F' has its zeros at known times.
    Between a maximum and the next minimum F falls all the way, so it passes 0 there or, as minima
    rise where the constant is positive, never; a root there is found by Newton's method, kept
    between bounds.
    """
    square = stiffness + law.stiffness
    a = pressing - square * y - law.damping * v
    push = max(law.stiffness * y + law.damping * v, 0.0)
    rise = law.stiffness * v + law.damping * a
    curvature = law.stiffness * a - law.damping * (square * v + law.damping * a)
    first, second = zeros_of_rate(rise, curvature, law.damping, square)
    rising = rise >= 0.0
    low, high = (first, second) if rising else (0.0, first)
    peak = push
    if rising:
        y1, v1 = damped_motion(law, y, v, min(low, left), pressing, stiffness)
        peak = max(peak, law.stiffness * y1 + law.damping * v1)
    if low >= left:
        return left, False, peak
    high = min(high, left)
    y1, v1 = damped_motion(law, y, v, high, pressing, stiffness)
    if law.stiffness * y1 + law.damping * v1 >= 0.0:
        # it goes on; the next maximum may be the largest
        if not rising and second < math.inf:
            y1, v1 = damped_motion(law, y, v, min(second, left), pressing, stiffness)
            peak = max(peak, law.stiffness * y1 + law.damping * v1)
        return left, False, peak
    t = 0.5 * (low + high)
    for _ in range(MOST_NEWTON):
        y1, v1 = damped_motion(law, y, v, t, pressing, stiffness)
        value = law.stiffness * y1 + law.damping * v1
        if value > 0.0:
            low = t
        else:
            high = t
        rise = law.stiffness * v1 + law.damping * (pressing - square * y1 - law.damping * v1)
        following = t - value / rise if rise < 0.0 else low
        if not (low < following < high):
            following = 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * following:
            break
        t = following
    return t, True, peak
