"""Number of cores and CPU time of the machine, on every operating system."""

from __future__ import annotations

import os
import sys
import time


def usable_cores() -> int:
    """Number of processor cores that this process may use; at least 1.

    Python 3.13 knows the number. Before that, Linux knows to which cores a process is bound;
    macOS and Windows know only how many cores there are. `NUMBA_NUM_THREADS`, by which users of
    numba give a process fewer threads, lowers the number.

    >>> usable_cores() >= 1
    True
    """
    asked = os.environ.get("NUMBA_NUM_THREADS", "")
    cores = _cores()
    return min(cores, int(asked)) if asked.isdecimal() and int(asked) else cores


def _cores() -> int:
    if hasattr(os, "process_cpu_count"):
        return os.process_cpu_count() or 1
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def thread_seconds() -> float:
    """CPU seconds of the calling thread, for differences between two calls.

    On Windows it is wall time: CPU time comes in ticks of 1/64 s there, too coarse for a block of
    paths.
    """
    return time.perf_counter() if sys.platform == "win32" else time.thread_time()
