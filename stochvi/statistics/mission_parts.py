"""Missions asked part by part: phases, or levels of the noise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from stochvi.results.base import Result
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.estimates import provenance
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene

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
