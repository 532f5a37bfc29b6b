"""Missions part by part. Chapters: parts asked one after the other, phases or levels of the noise;
the hazards of parts together."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, TypeVar

import numpy as np

from stochvi.results.base import Result
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.estimates import provenance
from stochvi.sampling.run import Run
from stochvi.scenes.phases import bias_of_steps
from stochvi.scenes.scene import Scene

# ------------------------------------------------------------------------------
# A mission asked part by part: its phases, or the levels of its noise.
# ------------------------------------------------------------------------------


Answer = TypeVar("Answer", bound=Result)

INDEPENDENT = "each phase starts in its own stationary motion, and phases are independent"
"""Assumption of missions of several phases."""


LATE_SECONDS = 0.5
"""Seconds after the end of the budget until which a further part of a mission is begun: the least
answer of a part takes some tenths of a second, and there may be a hundred."""


def parts_of_mission(run: Run, durations: Mapping[str, float]) -> Iterator[tuple[str, Run]]:
    """The names of parts, each with its part of a run. Parts have paths of their own, so that their
    errors are independent."""
    ends = np.cumsum([0.0, *durations.values()]) / sum(durations.values())
    for number, (name, (low, high)) in enumerate(zip(durations, pairwise(ends), strict=True)):
        share = run.deadline.share(1.0 / (len(durations) - number))
        yield name, run.part(low, high, f"phase {name}", share, seed=run.seed + number)


def asked_in_parts(
    run: Run, durations: Mapping[str, float], ask: Callable[[str, Run], Answer], *,
    all_needed: bool = True,
) -> tuple[dict[str, Answer], dict[str, str]]:  # fmt: skip
    """The answer for each part of a mission by name, and why what was not found as accurately as
    asked for was not: by event, where an answer tells its events apart.

    A part may have no answer where not all are needed, as long as another one has; once the budget
    is over, no more parts are begun then.
    """
    found: dict[str, Answer] = {}
    missing: dict[str, str] = {}
    late: list[str] = []
    for name, part in parts_of_mission(run, durations):
        if found and not all_needed and run.deadline.passed_by(LATE_SECONDS):
            late.append(name)
            continue
        try:
            found[name] = ask(name, part)
        except (NotConverged, Interrupted) as error:
            if error.partial is None and (all_needed or not found):
                if isinstance(error, NotConverged):
                    raise NotConverged(f"there is no answer without {name}: {error}") from None
                raise
            if error.partial is None:
                missing[f"{name}, answer"] = str(error)
                continue
            found[name] = error.partial
            reasons = getattr(error.partial, "missing", None) or {"accuracy": str(error)}
            missing |= {f"{name}, {event}": why for event, why in reasons.items()}
    if late:
        names = " to ".join(dict.fromkeys((late[0], late[-1])))
        missing[f"{names}, answer"] = "no time was left; raise budget"
    return found, missing


def complete(
    answer: Answer, missing: Mapping[str, str], run: Run, *, of: str, where: str
) -> Answer:
    """The answer of all parts, carried by an error where one was interrupted or fell short."""
    if run.deadline.interrupted:
        raise run.deadline.fell_short(f"before the {of} was found", "", answer)
    if missing:
        alike: dict[str, list[str]] = {}
        for name, why in missing.items():
            alike.setdefault(why, []).append(name.replace("_", " "))
        reasons = "; ".join(
            names[0] + (f" and {len(names) - 1} more" if len(names) > 1 else "") + f": {why}"
            for why, names in alike.items()
        )
        raise NotConverged(f"{where} {reasons}", answer)
    return answer


def said_of_parts(
    scene: Scene, found: Mapping[str, Result], run: Run, *counts: str
) -> dict[str, Any]:
    """Cost and provenance of an answer of several parts."""
    costs = [each.cost for each in found.values()]
    return {
        "cost": run.cost(**{name: sum(getattr(one, name) for one in costs) for name in counts}),
        "provenance": provenance(scene.document(), run.seed),
        "interrupted": False,
    }


def said_of_phases(
    scene: Scene, found: Mapping[str, Any], run: Run, *counts: str, more: Sequence[str] = ()
) -> dict[str, Any]:
    """The same of independent phases, with their assumptions, behind `more`, and warnings."""
    own = dict.fromkeys(one for each in found.values() for one in each.assumptions)
    warned = [f"in phase {name}: {one}" for name, each in found.items() for one in each.warnings]
    told = {"assumptions": [INDEPENDENT, *more, *own], "warnings": warned}
    return told | said_of_parts(scene, found, run, *counts)


# ------------------------------------------------------------------------------
# Hazards of parts of a mission together.
#
# The hazard of an event is -ln(1 - P): the probability at the start, and the integrated rate of
# first events. Those of independent parts add up, and so do expected numbers of events. Half widths
# of intervals are added as roots of sums of squares, each side for itself (G. Y. Zou and A. Donner,
# Construction of confidence limits about effect measures: a general approach, Statistics in
# Medicine 27, 2008, 1693).
# ------------------------------------------------------------------------------


CERTAIN = 1.0 - 1e-15
"""A larger probability counts as this one, so that its hazard is finite."""


class Hazard(NamedTuple):
    """The hazard of an event, or an expected number of events, in a part of a mission.

    Parameters
    ----------
    value
        -ln(1 - P), or the number.
    below, above
        How far its interval reaches either way.
    bias
        What the steps of moving bands leave in it.
    bounded
        Whether a bound alone is known, and may hold in all such parts together.
    """

    value: float
    below: float = 0.0
    above: float = 0.0
    bias: float = 0.0
    bounded: bool = False

    @classmethod
    def of(cls, chance: float, lower: float, upper: float, *, bounded: bool = False) -> Hazard:
        """That of a probability with its interval.

        >>> round(Hazard.of(0.5, 0.25, 0.5).value, 3)
        0.693
        """
        value, low, high = -np.log1p(-np.minimum([chance, lower, upper], CERTAIN))
        return cls(float(value), float(value - low), float(high - value), bounded=bounded)

    @classmethod
    def within(cls, value: float, half: float) -> Hazard:
        """A hazard with half of its interval, bias included."""
        return cls(value, half, half)

    @property
    def half(self) -> float:
        """Half of the interval, upwards, with the bias."""
        return self.above + self.bias


def joined(
    parts: Mapping[str, Hazard], steps: Sequence[Sequence[str]] = (),
    lags: Mapping[str, float] | None = None,
) -> Hazard:  # fmt: skip
    """The hazard of independent parts together. Some of them are the `steps` of a moving band, with
    the `lags` of their hazards.

    >>> joined({"road": Hazard(1.0, 0.3, 0.3), "air": Hazard(2.0, 0.4, 0.4)})[:3]
    (3.0, 0.5, 0.5)
    """
    each, values = parts.values(), {name: one.value for name, one in parts.items()}
    return Hazard(
        sum(values.values()),
        math.hypot(*(one.below for one in each if not one.bounded))
        + sum(one.below for one in each if one.bounded),
        math.hypot(*(one.above for one in each if not one.bounded))
        + sum(one.above for one in each if one.bounded),
        bias_of_steps(steps, values, lags),
    )
