"""Logs of single impacts, each with the time at which it happens.

A kernel that gets `None` for a log is compiled without the code for one.
"""

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

COLUMNS = 4
"""Number of columns of a log, one row an impact: path, pair, time, speed."""


class Log(NamedTuple):
    """The impacts of a block of paths.

    Parameters
    ----------
    events : (rows, COLUMNS): number of the path in the block, number of the pair, time in s, and
        impact speed in m/s, negative at the lower stop.
    count : (1,), number of impacts, including those for which there was no row left.
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
    """Part of a log for a path in the counted step `number`; None without a log.

    Steps of the burn-in have negative numbers.
    """
    if log is None:
        return None
    return Page(log.events, log.count, number >= 0, path, log.start + number * step)


@numba.njit(cache=True, error_model="numpy")
def page_after(page, elapsed):
    """Part of a log for what is left of a step after `elapsed` s; None without a log."""
    if page is None:
        return None
    return Page(page.events, page.count, page.counted, page.path, page.start + elapsed)


@numba.njit(cache=True, error_model="numpy")
def log_impact(page, pair, elapsed, speed):
    """Count an impact, and write it into the next row of the log if there is one left.

    `elapsed` is the time since the step began, s; `speed` is negative at the lower stop, m/s.
    """
    if page.counted:
        k = page.count[0]
        if k < page.events.shape[0]:
            page.events[k, 0], page.events[k, 1] = page.path, pair
            page.events[k, 2], page.events[k, 3] = page.start + elapsed, speed
        page.count[0] = k + 1
