"""A clock that the program itself moves on: a budget ends at the same work on any machine."""

from __future__ import annotations

import threading
import time

import pytest

from stochvi.results import deadline


class Ticking:
    """The module `time` for deadlines: every look at the clock takes so many seconds.

    Threads that watch a deadline look at it by the true clock, and do not count.
    """

    monotonic = staticmethod(time.monotonic)

    def __init__(self, seconds: float) -> None:
        self.now, self.seconds = time.time(), seconds

    def time(self) -> float:
        if "watch" not in threading.current_thread().name:
            self.now += self.seconds
        return self.now


def tick(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    """Let every look at the clock of a deadline take so many seconds."""
    monkeypatch.setattr(deadline, "time", Ticking(seconds))
