"""Motion within one interval of time: free decay, and the cubic between two samples.

Between two samples the motion is the cubic through values and slopes at both ends. The change e
that an impact or a contact makes to it decays as e'' = -b e' - w0^2 e.

Symbols: x0, v0, x1, v1 values and slopes at the ends; s in [0, 1] the place in the interval.
"""

import math

from stochvi.engine.compiling import kernel


@kernel
def decay(t, damping_rate, omega):
    """Second column of A(t): displacement and velocity after a unit velocity at t = 0."""
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
def first_upward_root(c0, c1, c2, c3):
    """First s in (0, 1] where c0 + c1 s + c2 s^2 + c3 s^3 crosses 0 upwards, or 2 for none.

    The cubic starts at or below 0. Its pieces between extrema are monotone, so each holds at
    most one root, which Newton's method finds, kept within bounds by bisection.
    """
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
