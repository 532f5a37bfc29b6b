"""The run of a calculation, for a part of it that is tested alone."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from stochvi.results.deadline import Deadline
from stochvi.sampling.run import Run
from stochvi.sampling.workers import pool_of


@contextmanager
def run_of(rel_error: float, seed: int = 0, budget: float | None = None) -> Iterator[Run]:
    """A run on one thread."""
    with pool_of(None, 1) as pool:
        yield Run(pool, Deadline.after(budget), seed=seed, rel_error=rel_error)
