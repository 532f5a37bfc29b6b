"""The clock of all deadlines stands still while numba compiles: no budget pays for that.

Kernels are compiled once on each machine. The time in which compiled kernels are loaded from the
disk counts for a budget, as any other time does.
"""

from __future__ import annotations

from functools import cache

from numba.core.event import Event, Listener, register

from stochvi.results.deadline import start_clock, stop_clock


class _Compiling(Listener):  # type: ignore[misc]
    """Listener that numba calls before and after it compiles a function and the functions that this
    one calls."""

    def on_start(self, event: Event) -> None:
        stop_clock()

    def on_end(self, event: Event) -> None:
        start_clock()


@cache
def leave_out_of_budgets() -> None:
    """Let no deadline of this process count the time in which numba compiles from now on."""
    register("numba:compile", _Compiling())
