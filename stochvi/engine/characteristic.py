"""What a kernel asks of a spring or damper that is a function.

A characteristic is a class of named tuples of numbers, for forces per unit mass. It has one body of
its own, and others where the defaults are wrong:

    pull(part, x, v, z)    force against the displacement x at the rate v, with the memory z

A kick changes the rate v while x stays: v' = k x + c v + f - pull. The affine force is in the flow
of the linear structure, and a kick takes it out again. `kicked` solves this equation; by default v
does not enter the force. A part whose force depends on v says so by `damps`.

A force with hysteresis has a memory z that changes with x alone, by `moved`, whose rate is `slope`.
What sees the motion in time changes its memory in each kick, by `watched`, before it acts.
"""

from __future__ import annotations

from typing import NamedTuple

from stochvi.engine.parts import generic


class Affine(NamedTuple):
    """The force k x + c v + f per unit mass that the linear structure holds in the place of a part.

    Parameters
    ----------
    stiffness, damping, force : k, 1/s^2, c, 1/s, and f, m/s^2.
    """

    stiffness: float
    damping: float
    force: float


@generic
def pull(part, x, v, z):
    """Force per unit mass, m/s^2, at the displacement x (m) and the rate v (m/s)."""


@generic
def damps(part):
    """Whether the force depends on the rate."""


@generic
def kicked(part, x, v, z, push, damping, h):
    """Rate, m/s, after the time h (s) of v' = push + damping v - pull at a fixed displacement."""


@generic
def remembers(part):
    """Whether the force depends on a memory."""


@generic
def moved(part, z, way):
    """Memory after the displacement has changed by `way` (m), in one direction."""


@generic
def slope(part, z, way):
    """Slope of the memory over the displacement, 1/m, in the direction of `way`."""


@generic
def watched(part, x, v, z, h):
    """Memory in a kick of the time h (s), at the displacement x and the rate v."""


@generic
def read(part, numbers, row):
    """The part of this class whose numbers are a row of a table."""


@damps.of(object)
def _(part):
    return False


@remembers.of(object)
def _(part):
    return False


@moved.of(object)
def _(part, z, way):
    return z


@slope.of(object)
def _(part, z, way):
    return 0.0


@watched.of(object)
def _(part, x, v, z, h):
    return z


@kicked.of(object)
def _(part, x, v, z, push, damping, h):
    if not damps(part):
        # the exponential of the linear damper by its series: damping h is small against 1
        growth = h * (1.0 + damping * h / 2.0 * (1.0 + damping * h / 3.0))
        return v + growth * (push + damping * v - pull(part, x, 0.0, z))
    # the classical method of Runge and Kutta, as nothing is known of the force
    a = push + damping * v - pull(part, x, v, z)
    b = push + damping * (v + 0.5 * h * a) - pull(part, x, v + 0.5 * h * a, z)
    c = push + damping * (v + 0.5 * h * b) - pull(part, x, v + 0.5 * h * b, z)
    d = push + damping * (v + h * c) - pull(part, x, v + h * c, z)
    return v + h * (a + 2.0 * b + 2.0 * c + d) / 6.0
