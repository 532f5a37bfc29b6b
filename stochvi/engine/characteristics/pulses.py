"""Instantaneous impulses at random times."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.characteristic import kicked, pull, read, remembers
from stochvi.engine.drive import MOST_DRAWS, drawn, draws, kept
from stochvi.engine.parts import generic
from stochvi.engine.uniform_numbers import uniform_of


class EqualPulses(NamedTuple):
    """Impulses of one size at the times of a Poisson process; z is their sum in a kick.

    Parameters
    ----------
    rate : mean number of impulses per second.
    size : change of the rate of the displacement, m/s, which scales all sizes.
    two_sided : whether one impulse in two has the opposite direction.
    """

    rate: float
    size: float
    two_sided: float


class NormalPulses(NamedTuple):
    """`EqualPulses` with sizes that are absolute values of a normal number of this deviation."""

    rate: float
    size: float
    two_sided: float


class ExponentialPulses(NamedTuple):
    """`EqualPulses` with exponentially distributed sizes of this mean."""

    rate: float
    size: float
    two_sided: float


KINDS = EqualPulses, NormalPulses, ExponentialPulses


@generic
def relative_size(part, uniform, other):
    """Size of an impulse in units of `size`, from two uniform numbers; it must not change with
    other to 1 - other in its distribution, as `other` also gives the direction."""


@relative_size.of(EqualPulses)
def _(part, uniform, other):
    return 1.0


@relative_size.of(NormalPulses)
def _(part, uniform, other):
    return math.sqrt(-2.0 * math.log(uniform)) * abs(math.cos(2.0 * math.pi * other))


@relative_size.of(ExponentialPulses)
def _(part, uniform, other):
    return -math.log(uniform)


@pull.of(*KINDS)
def _(part, x, v, z):
    return 0.0


@kicked.of(*KINDS)
def _(part, x, v, z, push, damping, h):
    return v + push * h + z


@remembers.of(*KINDS)
def _(part):
    return True


@draws.of(*KINDS)
def _(part):
    return True


@kept.of(*KINDS)
def _(part, z):
    return 0.0


@drawn.of(*KINDS)
def _(part, z, word, event, h):
    # the number of impulses is the inverse of the distribution function of Poisson
    expected, uniform, count = part.rate * h, uniform_of(word, event), 0
    probability = math.exp(-expected)
    below = probability
    while uniform > below and probability > 0.0:
        count += 1
        probability *= expected / count
        below += probability
    for k in range(min(count, MOST_DRAWS // 2 - 1)):
        other = uniform_of(word, event + 2 * k + 2)
        size = part.size * relative_size(part, uniform_of(word, event + 2 * k + 1), other)
        z += -size if part.two_sided * other > 0.5 else size
    return z


@read.of(EqualPulses)
def _(part, numbers, row):
    return EqualPulses(numbers[row, 0], numbers[row, 1], numbers[row, 2])


@read.of(NormalPulses)
def _(part, numbers, row):
    return NormalPulses(numbers[row, 0], numbers[row, 1], numbers[row, 2])


@read.of(ExponentialPulses)
def _(part, numbers, row):
    return ExponentialPulses(numbers[row, 0], numbers[row, 1], numbers[row, 2])
