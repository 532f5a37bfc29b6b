"""A path that takes long is given up once its answer is due, as its kernel looks at a flag.

Every kernel that advances paths (`run_white`, `run_contacts`, `run_response`, `run_modes`,
`run_missions`) looks at it in every step or every other one. A path that is given up leaves no
result, so that no number depends on the clock. Blocks of `simulate` are cut in time before that
(`blocks.go_on`), and their paths end between two steps.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from stochvi.results.deadline import Deadline

Flag = NDArray[np.uint8]
"""One number, 0 as long as kernels go on."""

WAIT_SECONDS = 1.0
"""Seconds after the deadline, or after Ctrl-C, for which paths under way are waited for: half of
the 2 s within which a command ends after Ctrl-C, as its answer has yet to be written."""

LOOK_SECONDS = 0.1
"""Seconds between two looks at the deadline while paths are under way."""

_own = threading.local()


class GivenUp(Exception):
    """Paths were given up on the way, as their answer was due."""


def stop_flag() -> Flag:
    """The flag at which the kernels look that this thread calls."""
    if not hasattr(_own, "flag"):
        _own.flag = np.zeros(1, np.uint8)
    flag: Flag = _own.flag
    return flag


def check_flag() -> None:
    """Raise `GivenUp` if the flag of this thread is set."""
    if stop_flag()[0]:
        raise GivenUp


@contextmanager
def given_up_after(deadline: Deadline) -> Iterator[None]:
    """Set the flag of this thread WAIT_SECONDS after the deadline, if this block lasts so long."""
    before, flag, ended = stop_flag(), np.zeros(1, np.uint8), threading.Event()

    def watch() -> None:
        end: Deadline | None = None
        while not ended.wait(LOOK_SECONDS):
            if end is None and deadline.passed():
                end = Deadline(time.time() + WAIT_SECONDS)
            if end is not None and end.passed():
                flag[0] = 1
                return

    _own.flag = flag
    threading.Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        ended.set()
        _own.flag = before
