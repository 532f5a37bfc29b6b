"""The clock of everything with a budget, and what Ctrl-C does to it."""

from __future__ import annotations

import signal

from stochvi.results.deadline import Deadline, heeding_ctrl_c


def test_ctrl_c_ends_also_what_begins_after_it_within_the_same_command() -> None:
    """A deadline that a later part of the work made for itself used to know nothing of it."""
    with heeding_ctrl_c():
        assert not Deadline.after(60.0).passed()
        signal.raise_signal(signal.SIGINT)
        with heeding_ctrl_c():
            later = Deadline.after(60.0)
        assert later.interrupted and Deadline.after(None).passed()
    assert not Deadline.after(60.0).passed()  # another command
