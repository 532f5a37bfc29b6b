"""How one mass moves between its stops, in what is left of a step.

A flow is a class of named tuples, for which kernels are compiled:

    Rotation    on its spring alone; x is measured from the rest position.
    Chord       along the cubic through both ends of an interval between two samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.complete_contacts import (
    BRAKING,
    CELLS,
    DURATION,
    HARDEST,
    PUSHING,
    REBOUND,
    quantity_of,
)
from stochvi.engine.free_motion import decay, time_to_touch, undamped_motion
from stochvi.engine.law_calls import follow, follow_shaken
from stochvi.engine.parts import generic
from stochvi.engine.roots import cubic_at, cubic_between, time_to_stop
from stochvi.engine.sums import ENDED, IMPULSE, LOSS, PEAK, ROWS_OF_PAIR, ROWS_OF_STOP, TIME


class Rotation(NamedTuple):
    """Undamped motion on a spring: its `stiffness`, 1/s^2, and the natural frequency `omega`."""

    stiffness: float
    omega: float


class Chord(NamedTuple):
    """Motion along the cubic from a state to x1, v1, the end without the stops.

    A force F of a stop adds a response d to it, d'' + b d' + w0^2 d = -F. `damping` is b (1/s), and
    `omega` is w0 (rad/s).
    """

    x1: float
    v1: float
    damping: float
    omega: float


@generic
def touch(flow, x, v, side, stop, left):
    """Time until the mass touches a stop, and the speed there; the time is more than what is `left`
    where it does not. `side` is 1 for an upper stop, -1 for a lower one."""


@generic
def end_of(flow, x, v, left):
    """Displacement and velocity at the end of what is left, where no stop is touched."""


@generic
def pressing_on(flow, w, side, stop, left):
    """Mean acceleration onto a rigid stop that is touched at the speed w, m/s^2."""


@generic
def known_contact(flow, w, left, which, at, sums, lane):
    """A contact that is known as a whole, from its touch at the speed w: the speed after it, and
    what is left; -1 where it has to be followed."""


@generic
def follow_in(flow, y, v, left, which, at, found):
    """Follow a contact from the deflection y and its rate v; see `law_calls.follow`."""


@generic
def redirected(flow, x, v, left, x_after, v_after, left_after):
    """The flow after a stop has changed the motion: the state before that, and after it."""


# ---- the mass on its spring alone ----------------------------------------------------------------


@touch.of(Rotation)
def _(flow, x, v, side, stop, left):
    return time_to_touch(side * x, side * v, side * stop, left, flow.stiffness, flow.omega)


@end_of.of(Rotation)
def _(flow, x, v, left):
    return undamped_motion(x, v, -flow.stiffness * x, left, flow.omega)


@pressing_on.of(Rotation)
def _(flow, w, side, stop, left):
    return -flow.stiffness * side * stop


@known_contact.of(Rotation)
def _(flow, w, left, which, at, sums, lane):
    place = (math.log(w) - at.complete.first) * at.complete.per_cell if w > 0.0 else -1.0
    if not 0.0 <= place < CELLS:
        return 0.0, -1.0
    cell = int(place)
    u = place - cell
    left -= quantity_of(at.complete.terms, which, cell, DURATION, u)
    if not left > 0.0:
        return 0.0, -1.0
    row = ROWS_OF_PAIR + ROWS_OF_STOP * which
    back = w * quantity_of(at.complete.terms, which, cell, REBOUND, u)
    sums[lane, row + IMPULSE] += w * quantity_of(at.complete.terms, which, cell, BRAKING, u)
    sums[lane, row + LOSS] += 0.5 * (w - back) * (w + back) if at.lossy[which] else 0.0
    sums[lane, row + TIME] += quantity_of(at.complete.terms, which, cell, PUSHING, u)
    sums[lane, row + PEAK] += w * quantity_of(at.complete.terms, which, cell, HARDEST, u)
    sums[lane, row + ENDED] += 1.0
    return back, left


@follow_in.of(Rotation)
def _(flow, y, v, left, which, at, found):
    pressing = -flow.stiffness * (2.0 * which - 1.0) * at.places[which]
    follow(
        at.laws, at.kinds[which], at.numbers, which, y, v, left, pressing, flow.stiffness, found
    )  # fmt: skip


@redirected.of(Rotation)
def _(flow, x, v, left, x_after, v_after, left_after):
    return flow


# ---- along a cubic -------------------------------------------------------------------------------


@touch.of(Chord)
def _(flow, x, v, side, stop, left):
    s, w = time_to_stop(side * x, side * v, side * flow.x1, side * flow.v1, left, side * stop)
    return s * left, w


@end_of.of(Chord)
def _(flow, x, v, left):
    return flow.x1, flow.v1


@pressing_on.of(Chord)
def _(flow, w, side, stop, left):
    return (side * flow.v1 - w) / left if left > 0.0 else 0.0


@known_contact.of(Chord)
def _(flow, w, left, which, at, sums, lane):
    return 0.0, -1.0


@follow_in.of(Chord)
def _(flow, y, v, left, which, at, found):
    b, stiffness = flow.damping, flow.omega * flow.omega
    side, stop = 2.0 * which - 1.0, at.places[which]
    q0, q1, q2, q3 = cubic_between(y, v, side * (flow.x1 - stop), side * flow.v1, left)
    # what shakes a mass that follows this cubic without the stop
    motion = (
        2.0 * q2 + b * q1 + stiffness * q0,
        6.0 * q3 + 2.0 * b * q2 + stiffness * q1,
        3.0 * b * q3 + stiffness * q2,
        stiffness * q3,
        stiffness,
        b,
        side * stop,
    )
    follow_shaken(at.laws, at.kinds[which], at.numbers, which, y, v, left, motion, found)


@redirected.of(Chord)
def _(flow, x, v, left, x_after, v_after, left_after):
    x1, v1, b, omega = flow
    if left_after > 0.0:
        z, slope = cubic_at(cubic_between(x, v, x1, v1, left), left - left_after)
        d, r = x_after - z, v_after - slope
        shape, change = decay(left_after, b, omega)
        x1 += (change + b * shape) * d + shape * r
        v1 += change * r - omega * omega * shape * d
    return Chord(x1, v1, b, omega)
