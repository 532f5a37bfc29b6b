"""The clock of everything with a budget, and what Ctrl-C does to it."""

from __future__ import annotations

import pickle
import signal
from types import SimpleNamespace

import pytest

from stochvi.results.deadline import NEVER, Deadline, heeding_ctrl_c, start_clock, stop_clock


def test_ctrl_c_ends_also_what_begins_after_it_within_the_same_command() -> None:
    """A deadline that a later part of the work made for itself used to know nothing of it."""
    with heeding_ctrl_c():
        assert not Deadline.after(60.0).passed()
        signal.raise_signal(signal.SIGINT)
        with heeding_ctrl_c():
            later = Deadline.after(60.0)
        assert later.interrupted and Deadline.after(None).passed()
    assert not Deadline.after(60.0).passed()  # another command


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, which passes only where a test says so."""
    moment = [1000.0]
    monkeypatch.setattr("stochvi.results.deadline.time", SimpleNamespace(time=lambda: moment[0]))
    return moment


def test_a_deadline_waits_while_the_clock_stands_still(now: list[float]) -> None:
    deadline = Deadline.after(10.0)
    now[0] += 4.0
    stop_clock()
    now[0] += 50.0
    assert deadline.left == 6.0  # also meanwhile
    stop_clock()  # a kernel that the first one calls
    now[0] += 50.0
    start_clock()
    start_clock()
    assert deadline.left == 6.0 and Deadline.after(10.0).left == 10.0
    now[0] += 6.0
    assert deadline.passed()


def test_a_deadline_that_another_process_gets_is_due_at_the_same_moment(now: list[float]) -> None:
    deadline = Deadline.after(10.0)
    stop_clock()
    now[0] += 3.0
    start_clock()
    sent = pickle.dumps(deadline)
    assert pickle.loads(sent).due == deadline.due == 1013.0
    assert pickle.loads(pickle.dumps(NEVER)) == NEVER


def test_a_deadline_may_be_put_off_but_never_brought_forward_so(now: list[float]) -> None:
    deadline = Deadline.after(10.0)
    assert deadline.in_no_less_than(3.0).left == 10.0
    now[0] += 9.0
    assert deadline.in_no_less_than(3.0).left == 3.0 and deadline.left == 1.0
    assert deadline.in_no_less_than(3.0).budget == 10.0
