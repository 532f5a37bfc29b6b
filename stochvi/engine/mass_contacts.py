"""A contact of one mass with a compliant stop, followed to its end or to the end of a step.

While it lasts, the mass moves under its spring and the force of the stop,

    y'' = pressing - stiffness y - F(y, y'),

y the deflection. A force that is linear is followed in closed form, by the files of such laws.
This file takes sub-steps for any force.
"""

from __future__ import annotations

import math

from stochvi.engine.compiling import kernel
from stochvi.engine.law import energy, force, is_lossy, is_smooth, margin, rate
from stochvi.engine.parts import generic
from stochvi.engine.pushes import parabola_maximum
from stochvi.engine.sub_steps import FIRST_SHARE
from stochvi.engine.sums import IMPULSE, LEFT, LOSS, PEAK, PLACE, SPEED, TIME

CONTACT_ANGLE = 0.125
"""Length of a sub-step times the largest rate in the contact, rad: the longest for which
CONTACT_ERROR holds."""

CONTACT_ERROR = 2e-5
"""Relative error of duration, impulse and peak force of a contact in sub-steps: among random
contacts with a ball, 99 of 100 were below 1.3e-5, and the state at any time below 3e-6 of the
largest. The peak of a force that depends on the rate has twice that error. The energy of a contact
without losses is kept. It is not resolved whether a mass that is pressed on leaves its stop with
less than a millionth of its energy."""

MOST_SUB_STEPS = 100_000
"""Largest number of sub-steps of a contact in a step."""

MOST_TRIES = 40
"""Largest number of Newton steps to the time of an event; each repeats a sub-step."""

EVENT_ERROR = 1e-13
"""Change of the time of an event in the last of these steps, as a share of a sub-step."""

MOVING = 0.01
"""Share of the energy of a motion from which on the energy says the speed better than sub-steps."""


@generic(inline=False)
def through(law, y, v, left, pressing, stiffness, found):
    """Follow the contact of one mass until it ends.

    Parameters
    ----------
    y, v : deflection, m, and its rate, m/s, at the start; y = 0 for a touch.
    left : s, how long the contact is followed at most.
    pressing : m/s^2, acceleration onto the stop at y = 0, without its force.
    stiffness : 1/s^2, that of the spring of the mass.
    found : the rows FOUND of `sums`, overwritten. PEAK is the largest force so far at the start.
    """


@kernel
def push_of(law, on, y, v):
    """Force of a stop that pushes where `on` is 1, and follows the mass without a force where it
    is 0."""
    return on * max(force(law, y, v), 0.0)


@kernel
def sub_step(law, on, y, v, h, pressing, stiffness):
    """A sub-step of the Runge-Kutta method of order 4: deflection, rate and its derivative at the
    end, and the impulse of the stop."""
    half, sixth = 0.5 * h, h / 6.0
    f0 = push_of(law, on, y, v)
    a0 = pressing - stiffness * y - f0
    y1, v1 = y + half * v, v + half * a0
    f1 = push_of(law, on, y1, v1)
    a1 = pressing - stiffness * y1 - f1
    y2, v2 = y + half * v1, v + half * a1
    f2 = push_of(law, on, y2, v2)
    a2 = pressing - stiffness * y2 - f2
    y3, v3 = y + h * v2, v + h * a2
    f3 = push_of(law, on, y3, v3)
    a3 = pressing - stiffness * y3 - f3
    return (
        y + sixth * (v + 2.0 * (v1 + v2) + v3),
        v + sixth * (a0 + 2.0 * (a1 + a2) + a3),
        a3,
        sixth * (f0 + 2.0 * (f1 + f2) + f3),
    )


@kernel
def distance_to_event(law, on, y, v, a):
    """Distance to the next event, m, its rate, and whether that event is the end of the contact.

    A stop that pushes ceases to do so where its margin ends. One that does not is left where y
    passes 0, or pushes again where its margin begins.
    """
    room, rise = margin(law, y, v), margin(law, v, a)
    if on > 0.0:
        return room, rise, not is_lossy(law)
    if y < 0.0:
        return y, v, True
    return -room, -rise, False


@kernel
def largest_push(law, on, y, v, y1, v1, a1, h, pressing, stiffness):
    """Largest force in a sub-step: that of the parabola through the forces at its start, middle and
    end. Without losses it is that at an end, unless the motion turns back."""
    f0, f1 = push_of(law, on, y, v), push_of(law, on, y1, v1)
    if not is_lossy(law) and (v <= 0.0 or v1 >= 0.0):
        return max(f0, f1)
    a0 = pressing - stiffness * y - f0
    centre = push_of(
        law, on, 0.5 * (y + y1) + 0.125 * h * (v - v1), 0.5 * (v + v1) + 0.125 * h * (a0 - a1)
    )
    return parabola_maximum(f0, centre, f1)


@kernel
def largest_rate(law, y, v, pressing, stiffness):
    """Largest rate of the motion in a contact, rad/s."""
    fast, pull = rate(law, y, v, max(pressing, 0.0)), max(-pressing, 0.0)
    square = v * v + 2.0 * pull * y
    # a slow mass that is pulled off the stop turns back before its force counts
    turn = pull * pull / square if square > 0.0 else 0.0
    return math.sqrt(stiffness + fast * fast + turn)


@kernel
def length_of_sub_step(law, y, v, longest):
    """Length of the next sub-step, s, shorter near the touch of a stop that is not smooth there."""
    if is_smooth(law) or v == 0.0:
        return longest
    there = y / v if v > 0.0 else -0.5 * y / v
    return min(longest, max(FIRST_SHARE * longest, there))


@kernel
def speed_by_energy(held, y, v, y1, v1, pressing, stiffness):
    """The rate v1 at the deflection y1 with the size that the energy gives it, where it is not too
    small for that; `held` is what the stop has given back since y and v."""
    square = v * v + 2.0 * held + (y1 - y) * (2.0 * pressing - stiffness * (y1 + y))
    return math.copysign(math.sqrt(square), v1) if square > MOVING * v * v else v1


@kernel
def lost_energy(y, v, y1, v1, pressing, stiffness):
    """What the motion has lost between two states in contact: losses, and what the stop holds."""
    return (y1 - y) * (pressing - 0.5 * stiffness * (y1 + y)) - 0.5 * (v1 - v) * (v1 + v)


@through.of(object)
def _(law, y, v, left, pressing, stiffness, found):
    y0, v0, over, ends = y, v, False, False
    longest = CONTACT_ANGLE / largest_rate(law, y, v, pressing, stiffness)
    on = 1.0 if y <= 0.0 or margin(law, y, v) > 0.0 else 0.0
    impulse, lasted, peak = 0.0, 0.0, found[PEAK]
    for _ in range(MOST_SUB_STEPS):
        whole = h = min(length_of_sub_step(law, y, v, longest), left)
        y1, v1, a1, push = sub_step(law, on, y, v, h, pressing, stiffness)
        if v < 0.0 < v1:  # it may have left the stop where it turned back
            turn = h * v / (v - v1)
            low, _, _, _ = sub_step(law, on, y, v, turn, pressing, stiffness)
            if low < 0.0:
                whole = h = turn
                y1, v1, a1, push = sub_step(law, on, y, v, h, pressing, stiffness)
        distance, rise, ends = distance_to_event(law, on, y1, v1, a1)
        event = distance < 0.0
        for _ in range(MOST_TRIES if event else 0):
            following = min(max(h - distance / rise, 0.25 * h), whole) if rise < 0.0 else 0.5 * h
            if abs(following - h) <= EVENT_ERROR * whole:
                break
            h = following
            y1, v1, a1, push = sub_step(law, on, y, v, h, pressing, stiffness)
            # the event that was found stays the one that is looked for
            distance, rise = (y1, v1) if ends else (margin(law, y1, v1), margin(law, v1, a1))
            distance, rise = (-distance, -rise) if on == 0.0 and not ends else (distance, rise)
        peak = max(peak, largest_push(law, on, y, v, y1, v1, a1, h, pressing, stiffness))
        impulse += push
        lasted += on * h
        left -= h
        y, v = y1, v1
        over = event and (ends or y <= 0.0)
        on = 1.0 - on if event else on
        if over or left <= 0.0:
            break
    y = 0.0 if over else y
    if not is_lossy(law):
        held = 0.0 if y0 == y else energy(law, y0) - energy(law, y)
        v = speed_by_energy(held, y0, v0, y, v, pressing, stiffness)
    found[IMPULSE], found[PEAK], found[TIME] = impulse, peak, lasted
    found[LOSS] = lost_energy(y0, v0, y, v, pressing, stiffness)
    found[PLACE], found[SPEED], found[LEFT] = y, v, max(left, 0.0) if over else 0.0
