"""A rigid stop whose restitution depends on the speed of the impact."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.compiling import kernel
from stochvi.engine.law import is_rigid, mean_rebound, read, rebound


class SpeedRestitution(NamedTuple):
    """v+ = -R(v-) v-, with R linear between speeds and constant beyond them.

    Parameters
    ----------
    numbers : (rows, width). A row begins with the number n of speeds; then follow n increasing
        speeds, m/s, and n restitutions.
    row : the row of this law.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, speeds: ArrayLike, restitutions: ArrayLike) -> Self:
        """The law of restitutions at increasing speeds, m/s."""
        found = np.concatenate([[np.size(speeds)], np.ravel(speeds), np.ravel(restitutions)])
        return cls(found[None])


@kernel
def restitution_at(law, w):
    """R at the speed w."""
    numbers, row = law
    count = int(numbers[row, 0])
    # the last speed of the table that is not above w, by halving
    low, high = 0, count
    while high - low > 1:
        middle = (low + high) // 2
        if numbers[row, 1 + middle] <= w:
            low = middle
        else:
            high = middle
    before, r = numbers[row, 1 + low], numbers[row, 1 + count + low]
    if w <= before or low == count - 1:
        return r
    share = (w - before) / (numbers[row, 2 + low] - before)
    return r + share * (numbers[row, 2 + count + low] - r)


@rebound.of(SpeedRestitution)
def _(law, w, uniform):
    return restitution_at(law, w) * w


@mean_rebound.of(SpeedRestitution)
def _(law, w):
    # asked where a mass rests on the stop, by ever slower impacts
    return restitution_at(law, 0.0) * w


@is_rigid.of(SpeedRestitution)
def _(law):
    return True


@read.of(SpeedRestitution)
def _(law, numbers, row):
    return SpeedRestitution(numbers, row)
