"""Motion of one mass on its spring, without noise.

Symbols: y displacement and v velocity; a the acceleration at the start; b the damping rate (1/s);
omega the natural frequency W (rad/s), which may be 0.
"""

from __future__ import annotations

import math

from stochvi.engine.compiling import kernel


@kernel
def decay(t, damping_rate, omega):
    """Displacement and velocity at t after a unit velocity, y'' = -b y' - W^2 y."""
    half = 0.5 * damping_rate
    square = (omega - half) * (omega + half)
    root = math.sqrt(abs(square))
    if root * t < 1e-8:
        shape, slope = t, 1.0
    elif square > 0.0:
        shape, slope = math.sin(root * t) / root, math.cos(root * t)
    else:
        # written so that neither exponential overflows for strong damping
        fast, slow = math.exp(-2.0 * root * t), math.exp((root - half) * t)
        return (
            slow * (1.0 - fast) / (2.0 * root),
            slow * ((1.0 + fast) / 2.0 - half * (1.0 - fast) / (2.0 * root)),
        )
    envelope = math.exp(-half * t)
    return envelope * shape, envelope * (slope - half * shape)


@kernel
def undamped_motion(y, v, acceleration, t, omega):
    """Displacement and velocity at t, from y, v and this acceleration."""
    half = 0.5 * omega * t
    if half > 0.0:
        sine, cosine = math.sin(half), math.cos(half)
        s = sine / omega
        return (
            y + 2.0 * s * (cosine * v + s * acceleration),
            v * (1.0 - 2.0 * sine * sine) + 2.0 * s * cosine * acceleration,
        )
    return y + t * (v + 0.5 * t * acceleration), v + t * acceleration


@kernel
def travel_time(distance, v0, v1, turn, omega):
    """Time of an undamped motion from the velocity v0 to v1, less than a period.

    tan(W t / 2) = W distance / (v0 + v1) = W (v1 - v0) / turn, `turn` the sum of the accelerations
    at both ends. The first form serves velocities of one sign, the second those of two. Neither
    needs the centre of the motion, which for W = 0 is infinitely far.
    """
    if v0 * v1 >= 0.0:
        rise, run = abs(distance), abs(v0 + v1)
    else:
        rise, run = abs(v1 - v0), turn if v1 > v0 else -turn
    if omega > 0.0:
        return 2.0 * math.atan2(omega * rise, run) / omega
    if run > 0.0:
        return 2.0 * rise / run
    return 0.0 if rise == 0.0 else math.inf


@kernel
def time_to_touch(x, v, stop, span, stiffness, omega):
    """Time until an undamped mass crosses `stop` upwards, and its speed there.

    x and `stop` are measured from the rest position. The time is infinite where the mass does not
    come so far, or not in the time `span`. It is 0 for a mass that rests on a stop and is pressed
    onto it.
    """
    distance = stop - x
    if distance * distance > (v * v + stiffness * x * x) * span * span and distance > 0.0:
        return math.inf, 0.0
    # a mass that goes away turns after at least a quarter of a period
    leaving = v < 0.0 or (v == 0.0 and distance > 0.0)
    if leaving and distance >= 0.0 and stop >= 0.0 and 2.0 * omega * span < math.pi:
        return math.inf, 0.0
    square = v * v + stiffness * (x - stop) * (x + stop)
    w = math.sqrt(max(square, 0.0))
    if x >= stop and (v > 0.0 or (v == 0.0 and stiffness * stop < 0.0)):
        return 0.0, w
    if square <= 0.0 or (v <= 0.0 and stiffness == 0.0):
        return math.inf, 0.0
    return travel_time(distance, v, w, -stiffness * (x + stop), omega), w
