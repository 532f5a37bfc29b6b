"""A rigid stop whose restitution is drawn at each impact."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.law import is_rigid, mean_rebound, read, rebound

CELLS = 512
"""Number of cells of equal probability. E R and E R^2 are exact, and a restitution is drawn within
its cell or the next: the distribution function is off by 4e-4 for mean 0.7 and std 0.1."""


class ScatteredRestitution(NamedTuple):
    """v+ = -R v-, with R uniform in a cell that is drawn.

    Parameters
    ----------
    numbers : (rows, 1 + 2 CELLS). A row begins with E R; then follow the middles of the cells, and
        their widths.
    row : the row of this law.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, law: Any) -> Self:
        """The law of a distribution with a mean and with `cells`."""
        middles, widths = law.cells(CELLS)
        return cls(np.concatenate([[law.mean], middles, widths])[None])


@rebound.of(ScatteredRestitution)
def _(law, w, uniform):
    numbers, row = law
    place = uniform * CELLS
    cell = int(place)
    r = numbers[row, 1 + cell] + numbers[row, 1 + CELLS + cell] * (place - cell - 0.5)
    return min(max(r, 0.0), 1.0) * w


@mean_rebound.of(ScatteredRestitution)
def _(law, w):
    return law.numbers[law.row, 0] * w


@is_rigid.of(ScatteredRestitution)
def _(law):
    return True


@read.of(ScatteredRestitution)
def _(law, numbers, row):
    return ScatteredRestitution(numbers, row)
