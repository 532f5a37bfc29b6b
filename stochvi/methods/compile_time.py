"""The clock of all deadlines stands still while numba compiles: no budget pays for that.

Kernels are compiled once on each machine. That compiled ones are loaded from the disk takes a part
of a budget, as everything else does.
"""

from __future__ import annotations

from functools import cache

from numba.core.event import Event, Listener, register

from stochvi.results.deadline import start_clock, stop_clock


class _Compiling(Listener):  # type: ignore[misc]
    """What numba calls before and after it compiles a function, with those that this one calls."""

    def on_start(self, event: Event) -> None:
        stop_clock()

    def on_end(self, event: Event) -> None:
        start_clock()


@cache
def leave_out_of_budgets() -> None:
    """Let no deadline of this process count the time in which numba compiles from now on."""
    register("numba:compile", _Compiling())
