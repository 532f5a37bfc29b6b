"""Where kernels write impacts down one by one, each at the time at which it happens.

A kernel that is given no log (`None`) holds no code for one.
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

COLUMNS = 4
"""Numbers of an impact in a log: path, pair, time, speed."""


class Log(NamedTuple):
    """Room for the impacts of a block of paths.

    Parameters
    ----------
    events : (rows, COLUMNS): number of the path in the block, number of the pair, time in s, and
        impact speed in m/s, negative at the lower stop.
    count : (1,), how many impacts there were, stored or not.
    start : s, the time at which the first counted step begins.
    """

    events: NDArray[np.float64]
    count: NDArray[np.int64]
    start: float


class Page(NamedTuple):
    """The part of a log for one path in one step, which begins at the time `start`.

    Impacts of steps that are not `counted` are not written down.
    """

    events: NDArray[np.float64]
    count: NDArray[np.int64]
    counted: bool
    path: int
    start: float


@numba.njit(cache=True, error_model="numpy")
def page_of(log, path, number, step):
    """The page of a path in the counted step `number`, or None without a log.

    Steps of the burn-in have negative numbers.
    """
    if log is None:
        return None
    return Page(log.events, log.count, number >= 0, path, log.start + number * step)


@numba.njit(cache=True, error_model="numpy")
def later(page, elapsed):
    """The page of the rest of a step, or None without a log."""
    if page is None:
        return None
    return Page(page.events, page.count, page.counted, page.path, page.start + elapsed)


@numba.njit(cache=True, error_model="numpy")
def write_down(page, pair, elapsed, speed):
    """Write an impact into the next row, as long as there are rows; all are counted.

    `elapsed` is the time since the step began.
    """
    if page.counted:
        k = page.count[0]
        if k < page.events.shape[0]:
            page.events[k, 0], page.events[k, 1] = page.path, pair
            page.events[k, 2], page.events[k, 3] = page.start + elapsed, speed
        page.count[0] = k + 1
