"""A spring whose force is linear between the points of a table."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.characteristic import pull, read


class SpringTable(NamedTuple):
    """F through the points (x_k, F_k), straight on beyond the first and the last one.

    Parameters
    ----------
    numbers : (rows, width). A row begins with the number of points; then x_k, m, F_k, m/s^2, and
        the slope from there on, 1/s^2, follow for each.
    row : the row of this table.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, x: ArrayLike, force: ArrayLike) -> Self:
        """The table of these points."""
        places, forces = np.asarray(x, float), np.asarray(force, float)
        slopes = np.diff(forces) / np.diff(places)
        points = np.stack([places[:-1], forces[:-1], slopes], axis=1)
        return cls(np.concatenate([[len(points)], points.ravel()])[None])


@pull.of(SpringTable)
def _(part, x, v, z):
    numbers, row = part
    low, high = 0, int(numbers[row, 0])
    while high - low > 1:
        middle = (low + high) // 2
        if x < numbers[row, 1 + 3 * middle]:
            high = middle
        else:
            low = middle
    k = 1 + 3 * low
    return numbers[row, k + 1] + numbers[row, k + 2] * (x - numbers[row, k])


@read.of(SpringTable)
def _(part, numbers, row):
    return SpringTable(numbers, row)
