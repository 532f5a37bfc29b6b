"""A contact of one mass with a compliant stop, followed to its end or to the end of a step.

While it lasts, the mass moves under its spring and the force of the stop,

    y'' = pressing - stiffness y - F(y, y'),

y the deflection. A force that is linear is followed in closed form, by the files of such laws.
This file takes sub-steps for any force. They also follow a mass that is shaken,

    y'' = p(t) - stiffness y - damping y' - F(y, y'),    p a polynomial of third order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.compiling import kernel
from stochvi.engine.law import energy, force, is_lossy, is_smooth, margin, rate
from stochvi.engine.parts import generic
from stochvi.engine.pushes import parabola_maximum, share_above_zero
from stochvi.engine.roots import cubic_maximum
from stochvi.engine.sub_steps import FIRST_SHARE
from stochvi.engine.sums import (
    EXTREME,
    FORCE_SQUARE,
    IMPULSE,
    LEFT,
    LOSS,
    PEAK,
    PLACE,
    POSITION_FORCE,
    SHARPEST,
    SPEED,
    TIME,
)

CONTACT_ANGLE = 0.125
"""Length of a sub-step times the largest rate in the contact, rad: the longest for which
CONTACT_ERROR holds."""

CONTACT_ERROR = 2e-5
"""Relative error of duration, impulse and peak force of a contact in sub-steps: among random
contacts with a ball, 99 of 100 were below 1.3e-5, and the state at any time below 3e-6 of the
largest. The peak of a force that depends on the rate has twice that error. The energy of a contact
without losses is kept. It is not resolved whether a mass that is pressed on leaves its stop with
less than a millionth of its energy."""

KINK_ERROR = 6e-4
"""Relative error of the same quantities of a mass that is shaken, where the slope of the force
jumps."""

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


class Swing(NamedTuple):
    """A mass on its spring: the acceleration `pressing` onto the stop at y = 0, m/s^2, and the
    `stiffness` w0^2, 1/s^2."""

    pressing: float
    stiffness: float


class Shaken(NamedTuple):
    """A mass on spring and damper under p0 + p1 t + p2 t^2 + p3 t^3, m/s^2.

    `stiffness` and `damping` are w0^2 (1/s^2) and b (1/s), and `place` is that of the stop, m.
    """

    p0: float
    p1: float
    p2: float
    p3: float
    stiffness: float
    damping: float
    place: float


@generic
def acceleration(motion, t, y, v):
    """Acceleration of the mass without the force of the stop, m/s^2."""


@generic
def largest_pressing(motion, left):
    """Largest acceleration onto the stop at y = 0 in what is left, m/s^2."""


@generic
def square_of_rates(motion):
    """Square of the largest rate of the mass without the stop, 1/s^2."""


@generic
def push_over(motion, law, on, t, start, end, h, found):
    """Largest force in a sub-step, from (y, y') at its start and (y, y', y'') at its end; what else
    a motion adds up over it is added to `found`."""


@generic
def settle(motion, law, y0, v0, y, v, found):
    """The rate at the end of a contact from y0 and v0, as well as it is known; notes LOSS."""


@kernel
def push_of(law, on, y, v):
    """Force of a stop that pushes where `on` is 1, and follows the mass without a force where it
    is 0."""
    return on * max(force(law, y, v), 0.0)


@kernel
def sub_step(motion, law, on, t, y, v, h):
    """A sub-step of the Runge-Kutta method of order 4: deflection, rate and its derivative at the
    end, and the impulse of the stop."""
    half, sixth = 0.5 * h, h / 6.0
    f0 = push_of(law, on, y, v)
    a0 = acceleration(motion, t, y, v) - f0
    y1, v1 = y + half * v, v + half * a0
    f1 = push_of(law, on, y1, v1)
    a1 = acceleration(motion, t + half, y1, v1) - f1
    y2, v2 = y + half * v1, v + half * a1
    f2 = push_of(law, on, y2, v2)
    a2 = acceleration(motion, t + half, y2, v2) - f2
    y3, v3 = y + h * v2, v + h * a2
    f3 = push_of(law, on, y3, v3)
    a3 = acceleration(motion, t + h, y3, v3) - f3
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
def time_of_push(motion, law, t, start, end, h):
    """How long the stop pushes in a sub-step, s, from (y, y') at its start and (y, y', y'') at its
    end. A stop without a margin of its own may cease to push, or begin to, within it."""
    (y, v), (y1, v1, a1) = start, end
    if not is_lossy(law):
        return h
    f0 = force(law, y, v)
    middle, speed = middle_of(motion, t, y, v, y1, v1, a1, max(f0, 0.0), h)
    return h * share_above_zero(f0, force(law, middle, speed), force(law, y1, v1))


@kernel
def middle_of(motion, t, y, v, y1, v1, a1, f0, h):
    """Deflection and rate in the middle of a sub-step, whose force at the start is f0."""
    a0 = acceleration(motion, t, y, v) - f0
    return 0.5 * (y + y1) + 0.125 * h * (v - v1), 0.5 * (v + v1) + 0.125 * h * (a0 - a1)


@kernel
def push_at_turn(law, on, y, v, y1, v1, h, f0, f1):
    """Largest force in a sub-step of a stop without losses: that at an end, or where the motion
    turns back."""
    if v <= 0.0 or v1 >= 0.0:
        return max(f0, f1)
    return push_of(law, on, cubic_maximum(y, v, y1, v1, h), 0.0)


@kernel
def largest_rate(motion, law, y, v, left):
    """Largest rate of the motion in a contact, rad/s."""
    pressing = largest_pressing(motion, left)
    fast, pull = rate(law, y, v, max(pressing, 0.0)), max(-pressing, 0.0)
    square = v * v + 2.0 * pull * y
    # a slow mass that is pulled off the stop turns back before its force counts
    turn = pull * pull / square if square > 0.0 else 0.0
    return math.sqrt(square_of_rates(motion) + fast * fast + turn)


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


@kernel
def follow_by_sub_steps(motion, law, y, v, left, found):
    """`through` for any force and motion."""
    y0, v0, over, ends, t = y, v, False, False, 0.0
    longest = CONTACT_ANGLE / largest_rate(motion, law, y, v, left)
    on = 1.0 if y <= 0.0 or margin(law, y, v) > 0.0 else 0.0
    impulse, lasted, peak = 0.0, 0.0, found[PEAK]
    found[LOSS] = 0.0
    for _ in range(MOST_SUB_STEPS):
        whole = h = min(length_of_sub_step(law, y, v, longest), left)
        y1, v1, a1, push = sub_step(motion, law, on, t, y, v, h)
        if v < 0.0 < v1:  # it may have left the stop where it turned back
            turn = h * v / (v - v1)
            low, _, _, _ = sub_step(motion, law, on, t, y, v, turn)
            if low < 0.0:
                whole = h = turn
                y1, v1, a1, push = sub_step(motion, law, on, t, y, v, h)
        distance, rise, ends = distance_to_event(law, on, y1, v1, a1)
        event = distance < 0.0
        for _ in range(MOST_TRIES if event else 0):
            following = min(max(h - distance / rise, 0.25 * h), whole) if rise < 0.0 else 0.5 * h
            if abs(following - h) <= EVENT_ERROR * whole:
                break
            h = following
            y1, v1, a1, push = sub_step(motion, law, on, t, y, v, h)
            # the event that was found stays the one that is looked for
            distance, rise = (y1, v1) if ends else (margin(law, y1, v1), margin(law, v1, a1))
            distance, rise = (-distance, -rise) if on == 0.0 and not ends else (distance, rise)
        peak = max(peak, push_over(motion, law, on, t, (y, v), (y1, v1, a1), h, found))
        impulse += push
        lasted += on * time_of_push(motion, law, t, (y, v), (y1, v1, a1), h)
        left -= h
        t += h
        y, v = y1, v1
        over = event and (ends or y <= 0.0)
        on = 1.0 - on if event else on
        if over or left <= 0.0:
            break
    y = 0.0 if over else y
    found[IMPULSE], found[PEAK], found[TIME] = impulse, peak, lasted
    found[SPEED] = settle(motion, law, y0, v0, y, v, found)
    found[PLACE], found[LEFT] = y, max(left, 0.0) if over else 0.0


@through.of(object)
def _(law, y, v, left, pressing, stiffness, found):
    follow_by_sub_steps(Swing(pressing, stiffness), law, y, v, left, found)


# ---- the mass on its spring ----------------------------------------------------------------------


@acceleration.of(Swing)
def _(motion, t, y, v):
    return motion.pressing - motion.stiffness * y


@largest_pressing.of(Swing)
def _(motion, left):
    return motion.pressing


@square_of_rates.of(Swing)
def _(motion):
    return motion.stiffness


@push_over.of(Swing)
def _(motion, law, on, t, start, end, h, found):
    (y, v), (y1, v1, a1) = start, end
    f0, f1 = push_of(law, on, y, v), push_of(law, on, y1, v1)
    if not is_lossy(law):
        return push_at_turn(law, on, y, v, y1, v1, h, f0, f1)
    middle, speed = middle_of(motion, t, y, v, y1, v1, a1, f0, h)
    return parabola_maximum(f0, push_of(law, on, middle, speed), f1)


@settle.of(Swing)
def _(motion, law, y0, v0, y, v, found):
    pressing, stiffness = motion
    if not is_lossy(law):
        held = 0.0 if y0 == y else energy(law, y0) - energy(law, y)
        v = speed_by_energy(held, y0, v0, y, v, pressing, stiffness)
    found[LOSS] = lost_energy(y0, v0, y, v, pressing, stiffness)
    return v


# ---- the mass that is shaken ---------------------------------------------------------------------


@acceleration.of(Shaken)
def _(motion, t, y, v):
    shaking = motion.p0 + t * (motion.p1 + t * (motion.p2 + t * motion.p3))
    return shaking - motion.stiffness * y - motion.damping * v


@largest_pressing.of(Shaken)
def _(motion, left):
    return max(motion.p0, acceleration(motion, left, 0.0, 0.0))


@square_of_rates.of(Shaken)
def _(motion):
    return motion.stiffness + motion.damping * motion.damping


@push_over.of(Shaken)
def _(motion, law, on, t, start, end, h, found):
    (y, v), (y1, v1, a1) = start, end
    f0, f1 = push_of(law, on, y, v), push_of(law, on, y1, v1)
    middle, speed = middle_of(motion, t, y, v, y1, v1, a1, f0, h)
    centre = push_of(law, on, middle, speed)
    sixth = h / 6.0
    found[LOSS] += sixth * (f0 * v + 4.0 * centre * speed + f1 * v1)
    square = sixth * (f0 * f0 + 4.0 * centre * centre + f1 * f1)
    lever = sixth * (f0 * y + 4.0 * centre * middle + f1 * y1)
    lever += motion.place * sixth * (f0 + 4.0 * centre + f1)
    highest = parabola_maximum(f0, centre, f1)
    if not is_lossy(law):
        highest = push_at_turn(law, on, y, v, y1, v1, h, f0, f1)
    # what the structure adds to the largest force hardly changes within a sub-step
    structural = motion.stiffness * (motion.place + middle) + motion.damping * speed
    found[EXTREME + FORCE_SQUARE] += square
    found[EXTREME + POSITION_FORCE] += lever
    found[EXTREME + SHARPEST] = max(found[EXTREME + SHARPEST], highest + structural)
    return highest


@settle.of(Shaken)
def _(motion, law, y0, v0, y, v, found):
    return v
