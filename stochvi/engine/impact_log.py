"""Logs of single impacts, each with the time at which it happens.

Without a request for impacts a log has no rows, and impacts are not counted. Most kernels lose no
time by that, and are compiled once. Kernels of many single steps get `None` instead: they are
compiled a second time without the code for a log, which saves 5 to 10 % of their time.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.compiling import kernel

COLUMNS = 4
"""Number of columns of a log, one row an impact: path, pair, time, speed."""

NO_ENERGIES = np.empty(0)
"""The energies of a log that nobody asks for them."""


class Log(NamedTuple):
    """The impacts of a block of paths.

    Parameters
    ----------
    events : (rows, COLUMNS): number of the path in the block, number of the pair, time in s, and
        impact speed in m/s, negative at the lower stop.
    count : (1,), number of impacts, including those for which there was no row left.
    start : s, the time at which the first counted step begins.
    taken : (rows,), what a compliant stop has taken from the path before each of its impacts, per
        unit of the reduced mass; the last contact before it is over then. With it the log has slow
        impacts on compliant stops as well. By default there is none.
    """

    events: NDArray[np.float64]
    count: NDArray[np.int64]
    start: float
    taken: NDArray[np.float64] = NO_ENERGIES


class Page(NamedTuple):
    """The part of a log for one path in one step, which begins at the time `start`.

    Impacts are logged where it is `open`: in counted steps, and if the log has rows.
    """

    events: NDArray[np.float64]
    count: NDArray[np.int64]
    open: bool
    path: int
    start: float
    taken: NDArray[np.float64]


NO_LOG = Log(np.empty((0, COLUMNS)), np.zeros(1, np.int64), 0.0)
"""The log of a kernel whose impacts are not logged."""

NO_RECORD = np.empty((0, 0, 0))
"""The record of a kernel whose states are not recorded."""


@kernel
def page_of(log, path, number, step):
    """Part of a log for a path in the counted step `number`; None without a log.

    Steps of the burn-in have negative numbers.
    """
    if log is None:
        return None
    opened = (number >= 0) & (log.events.shape[0] > 0)
    return Page(log.events, log.count, opened, path, log.start + number * step, log.taken)


@kernel
def page_after(page, elapsed):
    """Part of a log for what is left of a step after `elapsed` s."""
    return Page(
        page.events, page.count, page.open, page.path, page.start + elapsed, page.taken
    )  # fmt: skip


@kernel
def log_impact(page, pair, elapsed, speed):
    """Count an impact, and write it into the next row of an open page if there is one left.

    `elapsed` is the time since the step began, s; `speed` is negative at the lower stop, m/s.
    """
    k = page.count[0]
    if k < page.events.shape[0]:
        page.events[k, 0], page.events[k, 1] = page.path, pair
        page.events[k, 2], page.events[k, 3] = page.start + elapsed, speed
    page.count[0] = k + 1


@kernel
def log_contact(page, pair, elapsed, speed, counted, taken):
    """Log the touch of a compliant stop, which has `taken` so much before it.

    Touches that do not count are logged where the page asks for energies.
    """
    if page.open and (counted or page.taken.shape[0] > 0):
        k = page.count[0]
        if k < page.taken.shape[0]:
            page.taken[k] = taken
        log_impact(page, pair, elapsed, speed)
