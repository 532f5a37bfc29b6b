"""Compiling is announced, and no budget pays for it: the clock of all deadlines stands still.

Kernels are compiled once on each machine. The time in which compiled kernels are loaded from the
disk counts for a budget, as any other time does. Ctrl-C ends compiling at the next of its passes.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import cache
from threading import Timer
from typing import Any

from numba.core.event import Event, Listener, register

from stochvi.results.deadline import ctrl_c_was_heard, start_clock, stop_clock
from stochvi.results.errors import Interrupted
from stochvi.results.progress import announce

ANNOUNCED_SECONDS = 1.0
"""Seconds of compiling after which it is announced."""


@contextmanager
def outside_budgets() -> Iterator[None]:
    """Stop the clock of all deadlines within the `with` block, and announce it if it takes long."""
    speaker = Timer(ANNOUNCED_SECONDS, announce, ["compiling, once on each machine"])
    speaker.daemon = True
    speaker.start()
    stop_clock()
    try:
        yield
    finally:
        start_clock()
        speaker.cancel()


def check_ctrl_c() -> None:
    """Raise `Interrupted` if Ctrl-C was heard, whose answer nobody waits for in compiling."""
    if ctrl_c_was_heard():
        raise Interrupted("interrupted by Ctrl-C while kernels were compiled; nothing was kept")


class _Compiling(Listener):  # type: ignore[misc]
    """Listener to compilation. numba calls it before and after it compiles a function with those
    that it calls; a kernel calls it before and after it waits for another process."""

    def __init__(self) -> None:
        self.under_way: list[AbstractContextManager[Any]] = []

    def on_start(self, event: Event) -> None:
        self.under_way.append(outside_budgets())
        self.under_way[-1].__enter__()

    def on_end(self, event: Event) -> None:
        self.under_way.pop().__exit__(None, None, None)


class _Passing(Listener):  # type: ignore[misc]
    """Listener that is called before each of the some forty passes of compiling a function, and
    before each look whether another process has compiled it."""

    def on_start(self, event: Event) -> None:
        check_ctrl_c()

    def on_end(self, event: Event) -> None:
        pass


@cache
def leave_out_of_budgets() -> None:
    """Let no deadline of this process count the time in which numba compiles from now on."""
    compiling, passing = _Compiling(), _Passing()
    for kind in ("numba:compile", "stochvi:wait"):
        register(kind, compiling)
    for kind in ("numba:run_pass", "stochvi:look"):
        register(kind, passing)
