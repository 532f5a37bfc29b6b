"""The time that was asked for: the one clock at which everything with a budget looks.

Ctrl-C is the same as a deadline that passes: what is under way ends with what it has.
"""

from __future__ import annotations

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, is_dataclass, replace
from typing import Any, TypeVar

from stochvi.results.errors import Interrupted, NotConverged

Found = TypeVar("Found")

_asked_for: ContextVar[float | None] = ContextVar("asked_for", default=None)
"""Seconds that a user asked for, of which calculations get parts; None if they get all of it."""

SHORTEST_BUDGET = 1e-3
"""Seconds that are handed on once a deadline has passed: a budget must be positive."""

_heard = [0]
"""How often Ctrl-C has ended what was under way in this process."""

_heeded_from: list[int] = []
"""How often it had when Ctrl-C began to be heeded (see `heeding_ctrl_c`); empty where it is not."""


_stood_still = [0.0]
"""Seconds for which the clock of all deadlines has stood still in this process."""

_stands_still_since: list[float] = []
"""When it was stopped and not started again, by `time.time()`, outermost first."""


def stood_still() -> float:
    """Seconds for which the clock of all deadlines has stood still: kernels were being compiled,
    which no budget pays for."""
    return _stood_still[0] + sum(time.time() - since for since in _stands_still_since[:1])


def stop_clock() -> None:
    """Let the clock of all deadlines stand still, until `start_clock` was called as often."""
    _stands_still_since.append(time.time())


def start_clock() -> None:
    """Let the clock of all deadlines go on."""
    since = _stands_still_since.pop()
    if not _stands_still_since:
        _stood_still[0] += time.time() - since


@dataclass(frozen=True)
class Deadline:
    """The moment at which an answer is due.

    Parameters
    ----------
    moment
        A time of `time.time()`, s: workers on other machines have that clock as well. Infinite
        where nothing is due.
    budget
        The seconds that were asked for, for messages (see `asked_for`); None for no limit.
    before
        How often Ctrl-C had been heard when it was made: one more, and it has passed. Infinite
        where Ctrl-C is not heard.
    stood
        For how many seconds the clock had stood still when it was made; it is `due` by as much
        later as that has grown since then.

    Examples
    --------
    >>> Deadline.after(None).passed(), Deadline.after(60.0).passed(), Deadline.after(0.0).passed()
    (False, False, True)
    """

    moment: float = math.inf
    budget: float | None = None
    before: float = math.inf
    stood: float = field(default_factory=stood_still, compare=False)

    def __reduce__(self) -> tuple[type[Deadline], tuple[float, float | None, float]]:
        # another process has a count of its own of the seconds for which its clock stood still
        return Deadline, (self.due, self.budget, self.before)

    @classmethod
    def after(cls, budget: float | None) -> Deadline:
        """The deadline that so many seconds from now make; None for no limit.

        A Ctrl-C that came earlier makes it pass as well, if it is part of what that one ended.
        """
        before = _heeded_from[0] if _heeded_from else _heard[0]
        if budget is None:
            return cls(math.inf, None, before)
        return cls(time.time() + budget, _asked_for.get() or budget, before)

    @property
    def due(self) -> float:
        """The moment, as time has stood still since it was made."""
        return self.moment + (stood_still() - self.stood)

    def passed(self) -> bool:
        """Whether the answer is due."""
        return self.interrupted or time.time() >= self.due

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C came since it was made, and was heeded (see `heeding_ctrl_c`)."""
        return _heard[0] > self.before

    @property
    def left(self) -> float:
        """Seconds until the answer is due: infinite without a limit, zero once it has passed."""
        return 0.0 if self.passed() else max(self.due - time.time(), 0.0)

    @property
    def rest(self) -> float | None:
        """The seconds that are left, as the `budget` of a calculation that begins now."""
        return None if math.isinf(self.left) else max(self.left, SHORTEST_BUDGET)

    def sooner(self, share: float) -> Deadline:
        """The deadline that leaves a share (0 to 1) of the seconds that are left unused."""
        if math.isinf(self.moment):
            return self
        return replace(self, moment=self.moment - share * self.left)

    def sooner_by(self, seconds: float) -> Deadline:
        """The deadline so many seconds before this one."""
        return replace(self, moment=self.moment - seconds)

    def in_no_less_than(self, seconds: float) -> Deadline:
        """This deadline, or that which so many seconds from now make if it is later."""
        moment = max(self.due, time.time() + seconds)
        return replace(self, moment=moment, stood=stood_still())

    def part(self, share: float) -> float | None:
        """A share (0 to 1) of the seconds that are left, as the `budget` of one of several
        calculations; None for no limit."""
        return None if self.rest is None else max(share * self.rest, SHORTEST_BUDGET)

    def fell_short(self, where: str, remedy: str, answer: Any = None) -> NotConverged | Interrupted:
        """The error to raise where an answer was due before it was what was asked for.

        Its message is "the budget of 5 s ended `where`; `remedy`", and it carries the answer so
        far. After Ctrl-C it is `Interrupted`, and the answer is marked.
        """
        if self.interrupted:
            if is_dataclass(answer) and hasattr(answer, "interrupted"):
                answer = replace(answer, interrupted=True)  # type: ignore[type-var]
            return Interrupted(f"interrupted by Ctrl-C {where}", answer)
        # a share of a budget is no round number
        budget = float(f"{self.budget or 0.0:.3g}")
        return NotConverged(f"the budget of {budget:g} s ended {where}; {remedy}", answer)


def as_far_as_it_got(calculate: Callable[..., Found], *arguments: Any, **named: Any) -> Found:
    """What a calculation finds, or what it had found when its budget or Ctrl-C ended it.

    For a calculation that is a part of another one, which looks at the errors of what it gets and
    at its own deadline.
    """
    try:
        return calculate(*arguments, **named)
    except (NotConverged, Interrupted) as reason:
        if reason.response is None:
            raise
        found: Found = reason.response
        return found


NEVER = Deadline()
"""The deadline of what may take as long as it needs, and does not heed Ctrl-C."""


@contextmanager
def asked_for(budget: float | None) -> Iterator[None]:
    """Messages of all deadlines that are made within name this budget, of which they get parts.

    >>> with asked_for(60.0):
    ...     str(Deadline.after(17.3).fell_short("on the way", "raise budget"))
    'the budget of 60 s ended on the way; raise budget'
    """
    before = _asked_for.set(budget)
    try:
        yield
    finally:
        _asked_for.reset(before)


@contextmanager
def heeding_ctrl_c() -> Iterator[None]:
    """Meanwhile the first Ctrl-C makes all deadlines pass instead of raising KeyboardInterrupt.

    A second one raises it as ever. Nothing changes outside the main thread, where a program has a
    handler of its own, or within another calculation that heeds it.
    """
    usual = signal.default_int_handler
    main = threading.current_thread() is threading.main_thread()
    if not main or _heeded_from or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return

    def hear(*_: Any) -> None:
        _heard[0] += 1
        signal.signal(signal.SIGINT, usual)

    _heeded_from.append(_heard[0])
    signal.signal(signal.SIGINT, hear)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        _heeded_from.clear()
