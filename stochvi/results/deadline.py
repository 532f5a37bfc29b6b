"""The time that was asked for: the one clock at which everything with a budget looks."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

SHORTEST_BUDGET = 1e-3
"""Seconds that are handed on once a deadline has passed: a budget must be positive."""


@dataclass(frozen=True)
class Deadline:
    """The moment at which an answer is due.

    Parameters
    ----------
    moment
        A time of `time.time()`, s: workers on other machines have that clock as well. Infinite
        where nothing is due.

    Examples
    --------
    >>> Deadline.after(None).passed(), Deadline.after(60.0).passed(), Deadline.after(0.0).passed()
    (False, False, True)
    """

    moment: float = math.inf

    @classmethod
    def after(cls, budget: float | None) -> Deadline:
        """The deadline that so many seconds from now make; None for no limit."""
        return cls(math.inf if budget is None else time.time() + budget)

    def passed(self) -> bool:
        """Whether the answer is due."""
        return time.time() >= self.moment

    @property
    def left(self) -> float:
        """Seconds until the answer is due: infinite without a limit, zero once it has passed."""
        return max(self.moment - time.time(), 0.0)

    @property
    def budget(self) -> float | None:
        """The seconds that are left, as the `budget` of a calculation that begins now."""
        return None if math.isinf(self.moment) else max(self.left, SHORTEST_BUDGET)

    def sooner(self, share: float) -> Deadline:
        """The deadline that ends a share (0 to 1) of the time that is left before this one."""
        return self if math.isinf(self.moment) else Deadline(self.moment - share * self.left)


NEVER = Deadline()
"""The deadline of what may take as long as it needs."""
