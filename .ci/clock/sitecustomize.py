"""Python imports this as it starts: all its clocks go CLOCK_SPEED times as fast as the true one.

A program takes so many times longer by them, as on a slower machine, or on a faster one with a
speed below 1. Processes that a process starts share its time.
"""

import os
import time
from collections.abc import Callable

SPEED = float(os.environ.get("CLOCK_SPEED", "1"))
BEGAN = float(os.environ.setdefault("CLOCK_BEGAN", repr(time.time())))
"""The moment at which all clocks of the day show the same."""


def scaled(clock: Callable[[], float], began: float) -> Callable[[], float]:
    return lambda: began + SPEED * (clock() - began)


if SPEED != 1.0:
    time.time = scaled(time.time, BEGAN)
    for name in ("perf_counter", "monotonic", "process_time", "thread_time"):
        setattr(time, name, scaled(getattr(time, name), 0.0))
    sleep = time.sleep
    time.sleep = lambda seconds: sleep(seconds / SPEED)
