"""A force that is linear between the points of a table."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stochvi.engine.bounces import MOST_EVENTS
from stochvi.engine.law import MOST_NUMBERS, energy, force, rate, read, read_lane
from stochvi.engine.linear_pieces import STAYS, through_piece
from stochvi.engine.mass_contacts import through
from stochvi.engine.sums import IMPULSE, LEFT, LOSS, PLACE, SPEED, TIME

KINK = 2.0
"""How much shorter sub-steps are than for a straight line, since kinks lower their order to 3."""


class ForceTable(NamedTuple):
    """F = f_k + s_k (y - y_k) in the piece k.

    Parameters
    ----------
    numbers : (rows, width). A row begins with the number of pieces; then y_k, f_k and s_k follow
        for each piece, in m, m/s^2 and 1/s^2.
    row : the row of this table.
    """

    numbers: NDArray[np.float64]
    row: Any = 0

    @classmethod
    def of(cls, pieces: ArrayLike) -> Self:
        """The law of pieces (pieces, 3)."""
        found = np.asarray(pieces, float)
        return cls(np.concatenate([[len(found)], found.ravel()])[None])


@force.of(ForceTable)
def _(law, y, v):
    numbers, row = law
    piece = int(numbers[row, 0]) - 1
    while piece > 0 and y < numbers[row, 1 + 3 * piece]:
        piece -= 1
    k = 1 + 3 * piece
    return numbers[row, k + 1] + numbers[row, k + 2] * (y - numbers[row, k])


@energy.of(ForceTable)
def _(law, y):
    numbers, row = law
    stored, last = 0.0, int(numbers[row, 0]) - 1
    for piece in range(last + 1):
        k = 1 + 3 * piece
        end = min(y, numbers[row, k + 3]) if piece < last else y
        way = max(end - numbers[row, k], 0.0)
        stored += way * (numbers[row, k + 1] + 0.5 * numbers[row, k + 2] * way)
    return stored


@rate.of(ForceTable)
def _(law, y, v, push):
    numbers, row = law
    steepest = 0.0
    for piece in range(int(numbers[row, 0])):
        steepest = max(steepest, numbers[row, 3 + 3 * piece])
    return KINK * math.sqrt(steepest)


@read.of(ForceTable)
def _(law, numbers, row):
    return ForceTable(numbers, row)


@read_lane.of(ForceTable)
def _(law, lanes, lane, numbers):
    return ForceTable(numbers, int(lanes[lane, MOST_NUMBERS]))


@through.of(ForceTable)
def _(law, y, v, left, pressing, stiffness, found):
    numbers, row = law
    last, k = int(numbers[row, 0]) - 1, 0
    while k < last and y >= numbers[row, 1 + 3 * (k + 1)]:
        k += 1
    found[IMPULSE], found[LOSS], found[TIME] = 0.0, 0.0, 0.0
    for _ in range(MOST_EVENTS):
        at = 1 + 3 * k
        end = numbers[row, at + 3] if k < last else math.inf
        piece = numbers[row, at], end, numbers[row, at + 1], numbers[row, at + 2]
        where, y, v, left = through_piece(y, v, left, piece, pressing, stiffness, found)
        k += where
        if where == STAYS or k < 0:
            break
    over = k < 0
    found[PLACE], found[SPEED] = 0.0 if over else y, v
    found[LEFT] = left if over else 0.0
