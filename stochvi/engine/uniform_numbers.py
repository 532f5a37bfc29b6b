"""Random numbers that belong to an event of a path, and not to its stream.

SplitMix64 turns a word that belongs to a path and a step, and the number of an event in that step,
into one uniform number. Nothing is kept or advanced: the number is the same however paths are
gathered into blocks. The normals of the path are the same with and without it.

Generator: G. L. Steele, D. Lea and C. H. Flood, OOPSLA 2014, 453.
"""

from __future__ import annotations

import numpy as np

from stochvi.engine.compiling import kernel

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
MIX_2 = np.uint64(0x94D049BB133111EB)
S12, S27, S30, S31 = (np.uint64(n) for n in (12, 27, 30, 31))
UNIT = 2.0**-52
LOW_BITS = 0xFFFFFFFF
"""Bits of the number of a step, which is negative in a burn-in."""


@kernel(forceinline=True)
def split_mix(z):
    """One output of SplitMix64 for the counter z."""
    z = (z ^ (z >> S30)) * MIX_1
    z = (z ^ (z >> S27)) * MIX_2
    return z ^ (z >> S31)


@kernel
def word_of_step(word, number):
    """The word of a step of a path, from a word of its stream and the number of the step."""
    return word + np.uint64(number & LOW_BITS) * GOLDEN


@kernel
def uniform_of(word, number):
    """A uniform number in (0, 1) of the event `number` that belongs to a word."""
    bits = split_mix(split_mix(word) + np.uint64(number) * GOLDEN) >> S12
    return (np.float64(bits) + 0.5) * UNIT
