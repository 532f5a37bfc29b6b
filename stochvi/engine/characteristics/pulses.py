"""Instantaneous impulses at random times."""

from __future__ import annotations

import math
from typing import NamedTuple

from stochvi.engine.characteristic import kicked, pull, read, remembers
from stochvi.engine.compiling import kernel
from stochvi.engine.drive import MOST_DRAWS, drawn, draws, kept
from stochvi.engine.uniform_numbers import uniform_of

SIZES = "equal", "normal", "exponential"
"""Names of the distributions of sizes, whose numbers here are their kinds."""


class RandomPulses(NamedTuple):
    """Impulses at the times of a Poisson process; z is their sum in a kick.

    Parameters
    ----------
    rate : mean number of impulses per second.
    size : change of the rate of the displacement, m/s, which scales all sizes.
    two_sided : whether one impulse in two has the opposite direction.
    sizes : distribution of the sizes over `size`, a number of `SIZES`: 1, the absolute value of a
        normal number, or an exponential number.
    """

    rate: float
    size: float
    two_sided: float
    sizes: float


@kernel
def relative_size(sizes, uniform, other):
    """Size of an impulse in units of `size`, from two uniform numbers; it must not change with
    other to 1 - other in its distribution, as `other` also gives the direction."""
    if sizes == 0.0:
        return 1.0
    exponential = -math.log(uniform)
    if sizes == 1.0:
        return math.sqrt(2.0 * exponential) * abs(math.cos(2.0 * math.pi * other))
    return exponential


@pull.of(RandomPulses)
def _(part, x, v, z):
    return 0.0


@kicked.of(RandomPulses)
def _(part, x, v, z, push, damping, h):
    return v + push * h + z


@remembers.of(RandomPulses)
def _(part):
    return True


@draws.of(RandomPulses)
def _(part):
    return True


@kept.of(RandomPulses)
def _(part, z):
    return 0.0


@drawn.of(RandomPulses)
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
        size = part.size * relative_size(part.sizes, uniform_of(word, event + 2 * k + 1), other)
        z += -size if part.two_sided * other > 0.5 else size
    return z


@read.of(RandomPulses)
def _(part, numbers, row):
    return RandomPulses(numbers[row, 0], numbers[row, 1], numbers[row, 2], numbers[row, 3])
