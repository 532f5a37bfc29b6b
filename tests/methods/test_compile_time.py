"""Compiling takes nothing from a budget."""

from __future__ import annotations

import signal

import numba
import pytest

from stochvi.methods import compile_time
from stochvi.methods.compile_time import leave_out_of_budgets, outside_budgets
from stochvi.results.deadline import Deadline, graceful_interrupt, stood_still
from stochvi.results.errors import Interrupted
from stochvi.results.progress import showing


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


def test_ctrl_c_ends_compiling_and_the_function_can_be_compiled_later() -> None:
    """It used to be heard after minutes."""
    leave_out_of_budgets()

    @numba.njit
    def thrice(x: float) -> float:
        return 3.0 * x

    before = stood_still()
    with graceful_interrupt():
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Interrupted, match="while kernels were compiled"):
            thrice(1.0)
    assert thrice(1.0) == 3.0 and stood_still() > before
    compiled = stood_still()
    assert stood_still() == compiled  # the clock goes on


def test_compiling_is_announced_where_it_takes_time(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[tuple[float, str]] = []
    monkeypatch.setattr(compile_time, "ANNOUNCED_SECONDS", 0.0)
    with showing(lambda done, text: said.append((done, text))) as show:
        assert show is not None
        show(0.25, "on the way")
        with outside_budgets():
            for _ in range(10**7):
                if len(said) > 1:
                    break
    assert said[1] == (0.25, "compiling, once on each machine")
    monkeypatch.setattr(compile_time, "ANNOUNCED_SECONDS", 60.0)
    with showing(lambda done, text: said.append((done, text))), outside_budgets():
        pass  # kept code is there at once
    assert len(said) == 2
