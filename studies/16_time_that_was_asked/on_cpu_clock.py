"""Run the command line with CPU time for its clock, on a machine that others use as well.

A command that waits for a core does not lose its budget by that. With one thread its CPU time is
what it would take on a quiet machine. The first argument is the CPU time in seconds after which
Ctrl-C comes, 0 for never; the others are the words of the command.
"""

import os
import signal
import sys
import threading
import time

start, cpu = time.time(), time.process_time
for name in ("time", "monotonic", "perf_counter"):
    setattr(time, name, lambda: start + cpu())

from stochvi.__main__ import run  # noqa: E402

LOOK_SECONDS = 0.02
"""Seconds between two looks at the CPU time for the moment of Ctrl-C."""


def press_ctrl_c(after: float) -> None:
    """Send Ctrl-C to the process once it has used so much CPU time.

    A timer of the process would interrupt the thread that runs, as a terminal does not: a main
    thread that waits for another would not notice.
    """
    while cpu() < after:
        time.sleep(LOOK_SECONDS)
    os.kill(os.getpid(), signal.SIGINT)


moment = float(sys.argv.pop(1))
if moment:
    threading.Thread(target=press_ctrl_c, args=[moment], daemon=True).start()
run()
