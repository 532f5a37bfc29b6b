"""Levels that vary at random, for simulated records of noise of varying level.

The level in decibels is known at knots, of which many fall into its correlation time, and is
straight between them. Knots do not depend on the sampling: records at half the rate have the same
level. The record of a block repeats, but its level does not: it jumps before the warm-up, which the
end of the block is.
"""

from __future__ import annotations

import math

import numpy as np

from stochvi.mathematics.arrays import Matrix
from stochvi.mathematics.random_level import RandomLevel
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_rows, seed_streams

MOST_BLOCKS = 2**20
"""Largest number of blocks of a path. Each block has a random stream of its own, numbered from
path * MOST_BLOCKS; levels have those from half of this number on."""

KNOTS = 200.0
"""Knots in a correlation time. Between them the mean square of the level in decibels is too small
by 1 / (3 KNOTS) on average, which changes a kurtosis of 5 by 0.02 %."""


def levels_of_block(
    level: RandomLevel, seed: int, first_path: int, paths: int, number: int,
    *, samples: int, step: float, before: int,
) -> Matrix:  # fmt: skip
    """Levels (samples, paths) of block `number` of the paths first_path, first_path + 1, ...

    Parameters
    ----------
    before
        Samples of the warm-up at the end of the block, whose times lie before 0, and of the one
        from which they begin.
    """
    from scipy.signal import lfilter  # takes a second to import

    times = step * ((np.arange(samples) + before) % samples)
    spacing = level.time / KNOTS
    count = math.ceil(times.max() / spacing) + 2
    streams = np.empty((2, paths), np.uint64)
    for index in range(paths):
        stream = (first_path + index) * MOST_BLOCKS + MOST_BLOCKS // 2 + number
        seed_streams(np.uint64(seed), stream, streams[:, index : index + 1])
    half = math.ceil(count / 2)
    first, second = np.empty((2, half, paths))
    normal_rows(streams[0], streams[1], first, second)
    noise = np.stack([first, second], axis=1).reshape(2 * half, paths)[:count]
    decay = math.exp(-1.0 / KNOTS)
    noise[1:] *= math.sqrt(-math.expm1(-2.0 / KNOTS))
    normal = lfilter([1.0], [1.0, -decay], noise, axis=0)
    place = times / spacing
    knot = place.astype(int)
    share = (place - knot)[:, None]
    return level.gain((1.0 - share) * normal[knot] + share * normal[knot + 1])
