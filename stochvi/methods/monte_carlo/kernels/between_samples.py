"""Free decay within an interval of time.

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
