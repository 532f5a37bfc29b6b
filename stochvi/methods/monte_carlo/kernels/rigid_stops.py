"""Rigid stops of one oscillator whose restitution scatters, beside `steps.RigidStop`.

Kernels choose what a stop does by its class while they are compiled, so that a constant restitution
costs what it did.
"""

from typing import NamedTuple

from stochvi.engine.law import rebound
from stochvi.engine.laws.scattered_restitution import ScatteredRestitution
from stochvi.engine.parts import generic
from stochvi.engine.uniform_numbers import uniform_of


class ScatteredStop(NamedTuple):
    """A rigid stop whose restitution is drawn at each impact.

    As `steps.RigidStop`; `restitution` is the mean, and `slow` infinite: every step with an impact
    is followed impact by impact. `law` is that of the engine.
    """

    position: float
    restitution: float
    slow: float
    law: ScatteredRestitution


@generic
def restitution_of(stop, word, number):
    """Restitution of the impact `number` of those that belong to a word (`uniform_numbers`)."""


@generic
def is_scattered(stop):
    """Whether the restitution of a stop is drawn."""


@restitution_of.of(object)
def _(stop, word, number):
    return stop.restitution


@restitution_of.of(ScatteredStop)
def _(stop, word, number):
    return rebound(stop.law, 1.0, uniform_of(word, number))


@is_scattered.of(object)
def _(stop):
    return False


@is_scattered.of(type(None))
def _(stop):
    return False


@is_scattered.of(ScatteredStop)
def _(stop):
    return True
