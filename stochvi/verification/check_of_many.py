"""`check_many`: one verdict over many scenes; and `zoo`, the scenes that ship for it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stochvi.model.calculations import calculation
from stochvi.results.base import Result, total_cost
from stochvi.results.deadline import Deadline, graceful_interrupt
from stochvi.results.intervals import normal_quantile
from stochvi.results.progress import Progress
from stochvi.sampling.options import check_options
from stochvi.scenes.datasets import zoo_files
from stochvi.scenes.scene import Scene, load_scene
from stochvi.verification.check import (
    AGREES,
    BALANCE,
    DISAGREES,
    FAMILY_ALARM_RATE,
    STOPPED_EARLY,
    Check,
    Comparison,
    MethodResponses,
    answers,
    compare,
    single_alarm_rate,
)

if TYPE_CHECKING:
    import pandas as pd

WORST_SHOWN = 3
"""Number of comparisons that the summary of a failed check names."""


def zoo(*names: str) -> dict[str, Scene]:
    """The scenes of `data/scenes/zoo` by name: all of them, or those of the names given.

    Parameters
    ----------
    *names
        Names of scenes of the zoo; none for all.

    Returns
    -------
    dict[str, Scene]
        Scenes by name.

    See Also
    --------
    stochvi.verification.check_many : Checks them all.
    stochvi.scenes.shipped_scene : The file of one scene.

    Examples
    --------
    >>> scenes = zoo("linear", "lossy-0.5")
    >>> scenes["lossy-0.5"].effects()
    ('white noise on x', 'rigid stop lower', 'rigid stop upper')
    >>> len(zoo()) >= 60
    True
    """
    files = zoo_files()
    unknown = [name for name in names if name not in files]
    if unknown:
        raise ValueError(
            f"names must be scenes of the zoo, got {unknown[0]!r}; known: {', '.join(files)}"
        )
    return {name: load_scene(files[name]) for name in names or files}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Checks(Result):
    """The verdict on many scenes, whose comparisons share one alarm rate.

    `judged` is the number of comparisons, and `z` the number of standard errors by which each of
    them may differ.

    See Also
    --------
    stochvi.verification.check_many : The calculation.
    """

    checks: Mapping[str, Check]
    seeds: Mapping[str, int]
    judged: int
    z: float
    rel_error: float | None = None

    @property
    def passed(self) -> bool:
        """Whether every scene was judged as sharply as asked for, and nothing disagrees."""
        return bool(self.checks) and all(verdict.passed for verdict in self.checks.values())

    @property
    def alarms(self) -> list[tuple[str, Comparison]]:
        """Every comparison that disagrees, with the name of its scene before it."""
        return [
            (name, row)
            for name, verdict in self.checks.items()
            for row in verdict.comparisons
            if row.verdict == DISAGREES
        ]

    def summary(self) -> str:
        """The verdict in a sentence."""
        alarms = self.alarms
        failed = [name for name, verdict in self.checks.items() if not verdict.passed]
        if alarms:
            worst = "; ".join(
                f"{row.quantity}{' balance' if row.of == BALANCE else ''} of {name}"
                for name, row in alarms[:WORST_SHOWN]
            )
            return f"{len(alarms)} of {self.judged} comparisons DISAGREE: {worst}"
        if failed:
            first = failed[0]
            return f"{len(failed)} scenes were not judged: {first}: {self.checks[first].summary()}"
        return (
            f"{len(self.checks)} scenes, {self.judged} comparisons agree within {self.z:.2f} "
            f"standard errors and the stated bias (alarm rate of all together "
            f"{100.0 * FAMILY_ALARM_RATE:g} %)"
        )

    def __repr__(self) -> str:
        return f"<checks: {self.summary()}>"

    def to_frame(self) -> pd.DataFrame:
        """One row per comparison of every scene."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"scene": name, **vars(row)}
                for name, verdict in self.checks.items()
                for row in verdict.comparisons
            ]
        )

    def overview(self) -> pd.DataFrame:
        """One row per scene: the methods, the numbers of comparisons, the largest score."""
        import pandas as pd

        return pd.DataFrame([_line(name, verdict) for name, verdict in self.checks.items()])

    def _shown(self) -> pd.DataFrame:
        return self.overview()

    def _document(self) -> dict[str, Any]:
        return {
            "method": "check",
            "passed": self.passed,
            "summary": self.summary(),
            "family_alarm_rate": FAMILY_ALARM_RATE,
            "z": self.z,
            "judged": self.judged,
            "rel_error": self.rel_error,
            "alarms": [{"scene": name, **vars(row)} for name, row in self.alarms],
            "scenes": {
                name: {
                    "passed": verdict.passed,
                    "summary": verdict.summary(),
                    "seed": self.seeds.get(name),
                    "methods": _methods(verdict),
                    "comparisons": verdict.comparisons,
                    "left_out": verdict.left_out,
                }
                for name, verdict in self.checks.items()
            },
            "warnings": self.warnings,
        }


def _methods(verdict: Check) -> list[str]:
    """The methods that were judged, the reference first."""
    rows = [row for row in verdict.comparisons if row.verdict in (AGREES, DISAGREES)]
    names = [row.reference for row in rows if row.of != BALANCE] + [row.method for row in rows]
    return list(dict.fromkeys(names))


BALANCES_ONLY = "balances hold"
"""Verdict where only one method covers the scene: its balances hold, and nothing was compared."""


def _line(name: str, verdict: Check) -> dict[str, Any]:
    rows = [row for row in verdict.comparisons if row.verdict in (AGREES, DISAGREES)]
    scores = [abs(row.score) for row in rows if row.score is not None]
    return {
        "scene": name,
        "methods": ", ".join(_methods(verdict)),
        "comparisons": sum(row.of != BALANCE for row in rows),
        "balances": sum(row.of == BALANCE for row in rows),
        "largest score": max(scores, default=None),
        "verdict": _word(verdict),
    }


def _word(verdict: Check) -> str:
    judged = [row.of for row in verdict.comparisons if row.verdict in (AGREES, DISAGREES)]
    if verdict.passed:
        return "passed" if set(judged) != {BALANCE} else BALANCES_ONLY
    if any(row.verdict == DISAGREES for row in verdict.comparisons):
        return DISAGREES
    return "stopped early" if verdict.stopped_early else "not judged"


@calculation
def check_many(
    scenes: Mapping[str, Scene],
    *,
    rel_error: float = 0.01,
    seed: int = 0,
    threads: int | None = None,
    budget: float | None = None,
    progress: Progress | None = None,
) -> Checks:
    """`check` of many scenes, under one alarm rate for all their comparisons together.

    The probability that any comparison of any scene raises an alarm although all methods are right
    is `FAMILY_ALARM_RATE` (Sidak over all comparisons; this is safe where they depend on each
    other). Each scene gets random numbers of its own, from the seed and its place in `scenes`.

    Parameters
    ----------
    scenes
        The scenes by name; `zoo()` gives those that ship.
    rel_error, seed, threads
        The same arguments as those of `check`.
    budget
        Seconds for the simulations of all scenes together, None for no limit; each may take its
        share of what is left. A scene that is not begun in time is not judged.
    progress
        Called with the fraction done and the name of a scene.

    Returns
    -------
    Checks
        The verdict on all scenes.

    Raises
    ------
    Interrupted
        After Ctrl-C; it carries the verdict on the scenes so far.

    See Also
    --------
    stochvi.check : One scene.
    stochvi.verification.zoo : The scenes that ship.

    Examples
    --------
    >>> found = check_many(zoo("linear", "elastic-half-sigma"), rel_error=0.05)
    >>> found.passed, len(found.checks)
    (True, 2)
    """
    check_options({"rel_error": rel_error, "seed": seed, "budget": budget, "threads": threads})
    seeds = dict(zip(scenes, seeds_of(seed, len(scenes)), strict=True))
    found: dict[str, MethodResponses] = {}
    deadline = Deadline.after(budget)
    with graceful_interrupt():
        for done, (name, scene) in enumerate(scenes.items()):
            if progress:
                progress(done / len(scenes), name)
            if deadline.passed():
                late = f"{STOPPED_EARLY}: no time was left for this scene; raise budget"
                found[name] = MethodResponses(responses=[], approximations=[], left_out=[late])
                continue
            found[name] = answers(
                scene, rel_error=rel_error, seed=seeds[name], threads=threads,
                deadline=deadline.sooner(1.0 - 1.0 / (len(scenes) - done)),
            )  # fmt: skip
    verdict = compare_many(found, seeds, rel_error)
    if deadline.interrupted:
        raise deadline.fell_short("before all scenes were checked", "", verdict)
    return verdict


def compare_many(
    found: Mapping[str, MethodResponses],
    seeds: Mapping[str, int] | None = None,
    rel_error: float | None = None,
) -> Checks:
    """Judge responses to many scenes under one alarm rate, as `check_many` does with its own."""
    judged = sum(each.judged for each in found.values())
    checks = {
        name: compare(each.responses, each.approximations, each.left_out, family=judged)
        for name, each in found.items()
    }
    return Checks(
        checks=checks,
        seeds=seeds or {},
        judged=judged,
        z=normal_quantile(single_alarm_rate(max(judged, 1))),
        rel_error=rel_error,
        warnings=tuple(f"{name}: {each}" for name in checks for each in checks[name].warnings),
        cost=total_cost(verdict.cost for verdict in checks.values()),
    )


def seeds_of(seed: int, count: int) -> Sequence[int]:
    """Seeds of `count` independent simulations, made of one seed.

    >>> seeds_of(0, 2) == seeds_of(0, 3)[:2], len(set(seeds_of(0, 100)))
    (True, 100)
    """
    words = np.random.SeedSequence(seed).generate_state(count, np.uint64)
    return [int(word >> np.uint64(1)) for word in words]
