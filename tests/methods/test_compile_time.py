"""Compiling takes nothing from a budget."""

from __future__ import annotations

import numba

from stochvi.methods.compile_time import leave_out_of_budgets
from stochvi.results.deadline import Deadline, stood_still


def test_a_deadline_waits_while_numba_compiles_and_not_while_compiled_code_runs() -> None:
    leave_out_of_budgets()
    leave_out_of_budgets()  # of every room that has kernels: it counts once

    @numba.njit
    def twice(x: float) -> float:
        return 2.0 * x

    before, deadline = stood_still(), Deadline.after(60.0)
    twice(1.0)
    compiling = stood_still() - before
    assert compiling > 1e-3 and deadline.due - deadline.moment == compiling
    twice(2.0)
    assert stood_still() - before == compiling
