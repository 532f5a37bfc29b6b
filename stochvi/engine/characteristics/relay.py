"""A drive whose force of constant size switches by the motion, at once or with a delay."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.characteristic import damps, kicked, pull, read, remembers, watched
from stochvi.engine.characteristics.coulomb import growth
from stochvi.engine.compiling import kernel

AT_REST = 4.0
"""Rate down to which a mass counts as at rest, in units of that of a kick."""


class Relay(NamedTuple):
    """A force along the rate, per unit mass, against it beyond two displacements.

    Parameters
    ----------
    force : m/s^2.
    above, below : m; the force is against the rate above the first on the way up, and below the
        second on the way down.
    """

    force: float
    above: float
    below: float


class LateRelay(NamedTuple):
    """`Relay` that switches when another direction has been wanted for a time, the `delay`, s.

    Its memory is the direction, 1 or -1, plus or minus the time for which the other one has been
    wanted; 0 before the first kick.
    """

    force: float
    above: float
    below: float
    delay: float


@kernel
def wanted(part, x, v):
    """Direction of the force at a displacement and a rate."""
    if v >= 0.0:
        return 1.0 if x < part.above else -1.0
    return -1.0 if x > part.below else 1.0


@kernel
def share_before(left, v, h):
    """Share of the time from -h to h that a mass spends before a place that is `left` m ahead."""
    return min(max(0.5 + 0.5 * left / (h * v), 0.0), 1.0)


@kernel
def mean_direction(part, x, v, h):
    """Mean direction over the time from -h to h: half of a switch within it acts in either kick."""
    if v > 0.0:
        return 2.0 * share_before(part.above - x, v, h) - 1.0
    if v < 0.0:
        return 1.0 - 2.0 * share_before(x - part.below, -v, h)
    return wanted(part, x, v)


@pull.of(Relay)
def _(part, x, v, z):
    return -part.force * wanted(part, x, v)


@damps.of(Relay)
def _(part):
    return True


@kicked.of(Relay)
def _(part, x, v, z, push, damping, h):
    gain = push + part.force * mean_direction(part, x, v, h)
    after = v + (gain + damping * v) * growth(damping, h)
    if after * v >= 0.0:
        return after
    stopped = -v / gain if damping == 0.0 else -math.log1p(damping * v / gain) / damping
    return (push + part.force * wanted(part, x, after)) * growth(damping, h - stopped)


@read.of(Relay)
def _(part, numbers, row):
    return Relay(numbers[row, 0], numbers[row, 1], numbers[row, 2])


@watched.of(LateRelay)
def _(part, x, v, z, h):
    # a mass that the force of a kick presses onto its stop does not move down
    side = wanted(part, x, v + AT_REST * part.force * h)
    now = math.copysign(1.0, z) if z != 0.0 else side
    if side == now:
        return now
    # half a kick is the mean time since the change at the first kick that meets it
    waited = abs(z) - 1.0
    waited += h if waited > 0.0 else 0.5 * h
    return side if waited >= part.delay else math.copysign(1.0 + waited, now)


@pull.of(LateRelay)
def _(part, x, v, z):
    return -part.force * math.copysign(1.0, z if z != 0.0 else wanted(part, x, v))


@remembers.of(LateRelay)
def _(part):
    return True


@kicked.of(LateRelay)
def _(part, x, v, z, push, damping, h):
    return v + (push + damping * v - pull(part, x, v, z)) * growth(damping, h)


@read.of(LateRelay)
def _(part, numbers, row):
    return LateRelay(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])
