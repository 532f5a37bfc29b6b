"""A mission asked part by part: its phases, or the levels of its noise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import TypeVar

import numpy as np

from stochvi.results.base import Result
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.sampling.run import Run

Answer = TypeVar("Answer", bound=Result)

INDEPENDENT = "each phase starts in its own stationary motion, and phases are independent"
"""Assumption of missions of several phases."""


def parts_of_mission(run: Run, durations: Mapping[str, float]) -> Iterator[tuple[str, Run]]:
    """The names of parts, each with its part of a run. Parts have paths of their own, so that their
    errors are independent."""
    ends = np.cumsum([0.0, *durations.values()]) / sum(durations.values())
    for number, (name, (low, high)) in enumerate(zip(durations, pairwise(ends), strict=True)):
        share = run.deadline.share(1.0 / (len(durations) - number))
        yield name, run.part(low, high, f"phase {name}", share, seed=run.seed + number)


def asked_in_parts(
    run: Run, durations: Mapping[str, float], ask: Callable[[str, Run], Answer]
) -> tuple[dict[str, Answer], dict[str, str]]:
    """The answer for each part of a mission by name, and why what was not found as accurately as
    asked for was not: by event, where an answer tells its events apart."""
    found: dict[str, Answer] = {}
    missing: dict[str, str] = {}
    for name, part in parts_of_mission(run, durations):
        try:
            found[name] = ask(name, part)
        except (NotConverged, Interrupted) as error:
            if error.partial is None:
                raise
            found[name] = error.partial
            reasons = getattr(error.partial, "missing", None) or {"accuracy": str(error)}
            missing |= {f"{name}, {event}": why for event, why in reasons.items()}
    return found, missing


def complete(
    answer: Answer, missing: Mapping[str, str], run: Run, *, of: str, where: str
) -> Answer:
    """The answer of all parts, carried by an error where one was interrupted or fell short."""
    if run.deadline.interrupted:
        raise run.deadline.fell_short(f"before the {of} was found", "", answer)
    if missing:
        reasons = "; ".join(f"{name.replace('_', ' ')}: {why}" for name, why in missing.items())
        raise NotConverged(f"{where} {reasons}", answer)
    return answer
