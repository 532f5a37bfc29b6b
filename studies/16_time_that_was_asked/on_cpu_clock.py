"""Run the command line with CPU time for its clock, on a machine that others use as well.

A command that waits for a core does not lose its budget by that. With one thread its CPU time is
what it would take on a quiet machine. The first argument is the CPU time in seconds after which
Ctrl-C comes, 0 for never; the others are the words of the command.
"""

import os
import signal
import sys
import time

start, cpu = time.time(), time.process_time
for name in ("time", "monotonic", "perf_counter"):
    setattr(time, name, lambda: start + cpu())

from stochvi.cli import main  # noqa: E402

signal.signal(signal.SIGPROF, lambda *_: os.kill(os.getpid(), signal.SIGINT))
signal.setitimer(signal.ITIMER_PROF, float(sys.argv.pop(1)))
try:
    main(prog_name="stochvi")
except KeyboardInterrupt:
    sys.exit(1)
