"""Probabilities that the hardest impact of a mission exceeds a limit, over limits and clearances.

Where first impacts are rare, clusters are simulated from first impacts on, and fast first impacts
are drawn more often and weighted. Where clusters follow without a pause, windows of the whole
motion are simulated.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Unpack

import numpy as np

from stochvi.isolators.moved_stops import at_clearances
from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.gap_response import shaken_by_tables
from stochvi.methods.monte_carlo.modal_tables import plan_modal_tables
from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.results.hardness import IMPACT_SPEED, PEAK_ACCELERATION, unit_of_limit
from stochvi.results.intervals import GAUSSIAN_95, binomial_interval
from stochvi.sampling.options import RunOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import Bursts, bursts
from stochvi.statistics.structure_hits import WindowSampler

if TYPE_CHECKING:
    import pandas as pd


LIMITS = 16
"""Number of limits on a curve of probabilities; each is the same multiple of the one before."""

WIDENING = 2.5
"""Factor on the speeds of every second first impact, so that rare hard impacts are seen as well."""

MARKS = 3
"""Number of limits that are followed over all clearances where the caller gives none."""

FEWEST = 5
"""Smallest number of clusters, or windows, with an impact as hard as a limit for which its
probability is given."""

REL_ERROR = 0.1
"""Relative standard error to which the rate of impacts, or of impacts beyond the first mark, is
simulated."""

MOST_ERROR = 0.5
"""Relative standard error above which a probability is left out."""

WINDOW, MOST_WINDOWS = 18.0, 4096
"""Length (s) and largest number of the windows of the whole motion that are simulated where impacts
come without a pause."""


def event_of(scene: Scene) -> str:
    """The quantity by which the hardest impact is judged: its peak acceleration or, where a stop is
    rigid and has no stiffness, its speed."""
    rigid = any(stop.rigid for stop in model_of(scene).stops)
    return IMPACT_SPEED if rigid else PEAK_ACCELERATION


@sampled
def exceedances(
    scene: Scene,
    clearances: Sequence[float],
    mission: float,
    *,
    event: str | None = None,
    marks: Sequence[float] = (),
    **options: Unpack[RunOptions],
) -> pd.DataFrame:
    """Probability that any impact of a mission exceeds a limit: over limits, at each clearance.

    Parameters
    ----------
    scene
        One oscillator under Gaussian noise between stops, whose laws are kept.
    clearances
        Metres per side from the static equilibrium.
    event
        "peak_acceleration" (absolute, m/s^2, while a stop is touched) or "impact_speed" (m/s); by
        default `event_of`.
    marks
        Limits for which every clearance has a row where their probability is known; that of the
        first one is found to `REL_ERROR` if the budget allows it. By default, and where no
        clearance exceeds any of them often enough, limits that most clearances have in common.
    **options
        `RunOptions`: `budget` is that of all clearances together.

    Returns
    -------
    pandas.DataFrame
        `clearance` (m), `event`, `limit` (SI), `mark` (whether the limit is one of the
        marks), `probability` with its 95 % limits
        `probability_low`, `probability_high`, and `by`, "bursts" or "windows". Limits that are
        exceeded too seldom for a standard error are left out; so is a clearance at which no limit
        is left.
    """
    import pandas as pd

    event, run = event or event_of(scene), Run.of(options)
    unit_of_limit(event)  # refuses others before any work
    seen: list[TrialExtremes] = []
    for number, clearance in enumerate(clearances):
        stopped = at_clearances(scene, clearance)
        one = replace(run, deadline=run.deadline.share(1.0 / (len(clearances) - number)))
        seen.append(
            _by_bursts(stopped, event, mission, marks, one)
            or _by_windows(stopped, event, mission, one)
        )
    marks = [mark for mark in marks if any(each.chance(mark) for each in seen)] or _common(seen)
    rows = [
        {"clearance": clearance, "event": event, "limit": limit, "mark": limit in marks,
         "probability": value, "probability_low": low, "probability_high": high, "by": each.by}
        for clearance, each in zip(clearances, seen, strict=True)
        for limit in sorted({*each.limits(), *marks})
        if (found := each.chance(limit)) is not None
        for value, low, high in (found,)
    ]  # fmt: skip
    names = ["clearance", "event", "limit", "mark"]
    more = ["probability", "probability_low", "probability_high", "by"]
    return pd.DataFrame(rows, columns=[*names, *more])


Chance = tuple[float, float, float]
"""A probability and its 95 % limits."""


@dataclass(frozen=True, eq=False)
class TrialExtremes(ABC):
    """Largest speeds, or accelerations, of trials at one clearance."""

    largest: Vector
    mission: float

    by: ClassVar[str]

    @abstractmethod
    def chance(self, limit: float) -> Chance | None:
        """Probability that the limit is exceeded in the mission; None where that is not known."""

    def ends(self) -> tuple[float, float] | None:
        """A limit that nearly every trial exceeds, and one that few do."""
        ordered = np.sort(self.largest[self.largest > 0.0])
        if len(ordered) <= FEWEST:
            return None
        return float(ordered[len(ordered) // 50]), float(ordered[-FEWEST])

    def limits(self) -> list[float]:
        """Limits of a curve."""
        ends = self.ends()
        return [] if ends is None else [float(f"{x:.4g}") for x in np.geomspace(*ends, LIMITS)]


@dataclass(frozen=True, eq=False)
class _Bursts(TrialExtremes):
    """Clusters from first impacts on, each with a weight."""

    event: str
    bursts: Bursts

    by = "bursts"

    def chance(self, limit: float) -> Chance | None:
        rate = self.bursts.exceedance_rate(self.event, limit)
        if not rate.value or rate.standard_error > MOST_ERROR * rate.value:
            return None
        half = rate.half_width_95()
        rates = (rate.value, max(rate.value - half, 0.0), rate.value + half)
        value, low, high = (-math.expm1(-each * self.mission) for each in rates)
        return value, low, high


@dataclass(frozen=True, eq=False)
class _TrialWindows(TrialExtremes):
    """Windows of the whole motion, of this length in s, taken for independent."""

    window: float

    by = "windows"

    def chance(self, limit: float) -> Chance | None:
        return None if self.exceeding(limit) < FEWEST else self.interval(limit)

    def exceeding(self, limit: float) -> int:
        """Number of windows in which the limit is exceeded."""
        return int((self.largest > limit).sum())

    def estimate(self, limit: float) -> Estimate:
        """The probability in the mission, or its upper limit where few windows exceed the limit."""
        value, low, high = self.interval(limit)
        how = f"{self.exceeding(limit)} of {len(self.largest)} windows"
        if self.exceeding(limit) < FEWEST:
            return Estimate(value=0.0, upper_95=high, how=how)
        return Estimate(value=value, standard_error=(high - low) / (2.0 * GAUSSIAN_95), how=how)

    def interval(self, limit: float) -> Chance:
        """The probability in the mission and its 95 % limits, however few windows exceed the
        limit."""
        count, trials = self.exceeding(limit), len(self.largest)
        windows = self.mission / self.window
        value, low, high = (
            1.0 if chance >= 1.0 else -math.expm1(windows * math.log1p(-chance))
            for chance in (count / trials, *binomial_interval(count, trials))
        )
        return value, low, high


def _common(seen: Sequence[TrialExtremes]) -> tuple[float, ...]:
    """Limits of two digits whose probability is known at as many clearances as possible."""
    ends = [each for each in (one.ends() for one in seen) if each is not None]
    if not ends:
        return ()
    low = max(each[0] for each in ends)
    high = min(each[1] for each in ends)
    if not high > low:
        low, high = min(each[0] for each in ends), max(each[1] for each in ends)
    spaced = np.geomspace(low, high, MARKS + 2)[1:-1]
    return tuple(dict.fromkeys(float(f"{limit:.2g}") for limit in spaced))


def _by_bursts(
    scene: Scene, event: str, mission: float, marks: Sequence[float], run: Run
) -> _Bursts | None:
    """Trials by clusters; None where clusters do not end, or overlap."""
    wanted: Callable[[Bursts], Estimate] = Bursts.hit_rate
    if marks:
        wanted = partial(Bursts.exceedance_rate, name=event, limit=marks[0])
    try:
        found: Bursts = partial_result(
            bursts, scene, wanted=wanted, widening=WIDENING, **run.options(rel_error=REL_ERROR)
        )
    except NotApplicable:
        return None
    return _Bursts(found.largest(event), mission, event, found) if found.apart else None


def _by_windows(scene: Scene, event: str, mission: float, run: Run) -> _TrialWindows:
    """Trials by windows of the whole motion, as many as the time allows."""
    window = min(WINDOW, mission)
    parts = run.until(window_sampler(scene, event, window, run.seed), MOST_WINDOWS).sample
    return _TrialWindows(_largest(parts), mission, window)


def window_sampler(scene: Scene, event: str, window: float, seed: int) -> WindowSampler:
    """Windows of one oscillator, s, in which every contact counts, however slow."""
    model = shaken_by_tables(model_of(scene))
    return WindowSampler(plan_modal_tables(model, 0.0, window), event, model.outputs, seed)


def _largest(sample: list[Vector]) -> Vector:
    """(windows,): the largest speed or acceleration of each window."""
    return np.concatenate([part[0].max(axis=0) for part in sample])


@sampled
def chance_in_windows(
    scene: Scene, event: str, limit: float, mission: float, *, accepted: float,
    **options: Unpack[RunOptions],
) -> Estimate | None:  # fmt: skip
    """Probability that any impact of a mission exceeds a limit, by windows of the whole motion,
    however closely impacts follow each other: sampled until its interval lies on one side of an
    `accepted` probability, or the budget ends. None where windows are not simulated.
    """
    window, run = min(WINDOW, mission), Run.of(options)
    try:
        sampler = window_sampler(scene, event, window, run.seed)
    except NotApplicable:
        return None

    def more(parts: list[Vector]) -> int:
        seen = _TrialWindows(_largest(parts), mission, window)
        _, low, high = seen.interval(limit)
        known = high <= accepted or low > accepted
        return 0 if known else len(seen.largest)  # few looks: each may err once in 40

    parts = run.until(sampler, LEAST_WINDOWS, more).sample
    return _TrialWindows(_largest(parts), mission, window).estimate(limit)


LEAST_WINDOWS = 1024
"""Number of windows at the first look at a probability."""
