"""What a sizing is asked."""

from __future__ import annotations

from dataclasses import dataclass

from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.results.progress import Progress


def silent(done: float, text: str) -> None:
    """Report no progress."""


@dataclass(frozen=True, kw_only=True)
class Question:
    """The target of a sizing and how it is searched for; see `size`. The tolerances are by default
    those that the scene states, and the budget is in seconds."""

    target: Target
    mission: float
    at: str | None = None
    pair: str | None = None
    tolerances: Tolerances | None = None
    rel_error: float = 0.05
    seed: int = 0
    threads: int | None = None
    budget: float = 60.0
    report: Progress = silent
