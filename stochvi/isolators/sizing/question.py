"""The question of a sizing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stochvi.isolators.sizing.answer import Target
from stochvi.isolators.sizing.changes import Tolerances
from stochvi.sampling.run import Run


@dataclass(frozen=True, kw_only=True)
class Question:
    """The target of a sizing, and the run in which it is searched for, which has the relative error
    of the risk; see `size`. The tolerances are by default those that the scene states. Without
    `impacts` none is simulated for a probability, and the answer says nothing of them."""

    target: Target
    mission: float
    run: Run
    at: str | None = None
    pair: str | None = None
    common: Sequence[str] = ()
    tolerances: Tolerances | None = None
    impacts: bool = True
