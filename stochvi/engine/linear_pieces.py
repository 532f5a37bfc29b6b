"""One mass in contact with a stop, within a linear piece of its force: in closed form.

The force is force + slope (y - start) from the deflection `start` to `end`, and the motion a
rotation with the frequency W, W^2 = stiffness + slope.
"""

from __future__ import annotations

import math

from stochvi.engine.compiling import kernel
from stochvi.engine.free_motion import travel_time, undamped_motion
from stochvi.engine.sums import IMPULSE, PEAK, TIME

DOWN, STAYS, UP = -1, 0, 1
"""Where the mass leaves a piece, or that its time ends in it."""


@kernel
def way_to(y, v, end, here, there):
    """Square of the speed at the end of a piece, from the accelerations at y and there."""
    return v * v + (here + there) * (end - y)


@kernel
def through_piece(y, v, left, piece, pressing, stiffness, found):
    """Follow the mass through a piece (start, end, force, slope), for at most `left` s.

    Returns where it leaves the piece, deflection and rate there, and the time left. Impulse, time
    and peak force are added to `found`.
    """
    start, end, force, slope = piece
    square = stiffness + slope
    omega = math.sqrt(square)
    a = pressing - stiffness * y - force - slope * (y - start)
    below = pressing - stiffness * start - force
    down, up, w, w_up = math.inf, math.inf, 0.0, 0.0
    energy = way_to(y, v, start, a, below)
    if energy > 0.0:
        w = math.sqrt(energy)
        down = travel_time(start - y, v, -w, a + below, omega)
    if end < math.inf:
        above = pressing - stiffness * end - force - slope * (end - start)
        energy = way_to(y, v, end, a, above)
        if energy > 0.0:
            w_up = math.sqrt(energy)
            up = travel_time(end - y, v, w_up, a + above, omega)
    t = min(min(down, up), left)
    where = STAYS if t == left else (DOWN if down <= up else UP)
    if where == STAYS:
        y1, v1 = undamped_motion(y, v, a, t, omega)
        top = math.inf
        if omega > 0.0:
            angle = math.atan2(omega * v, -a)
            top = (angle if angle >= 0.0 else angle + 2.0 * math.pi) / omega
        elif v > 0.0 and a < 0.0:
            top = -v / a
        turned = top <= t
    elif where == DOWN:
        y1, v1, turned = start, -w, v > 0.0
    else:
        y1, v1, turned = end, w_up, False
    highest = y1
    if turned:
        largest = math.sqrt(a * a + square * v * v)
        if a > 0.0:
            highest = y + (largest + a) / square
        elif largest > 0.0:
            highest = y + v * v / (largest - a)
    found[PEAK] = max(found[PEAK], force + slope * (max(highest, y) - start))
    change = v1 - v
    found[IMPULSE] += (pressing - stiffness * y) * t - change
    if square > 0.0:
        found[IMPULSE] -= stiffness / square * (a * t - change)
    found[TIME] += t
    return where, y1, v1, left - t
