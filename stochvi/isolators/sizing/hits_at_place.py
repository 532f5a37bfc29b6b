"""Impacts with the stops at a place: by clusters where first impacts are rare, else by simulating
the whole motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.impact_counts import ImpactCounts, count_impacts


@dataclass(frozen=True, kw_only=True)
class PlaceTrial:
    """Impacts at one place, by clusters or by simulating the whole motion.

    `hits_per_burst` is the number of impacts of a cluster; None where it is not known. `unknown`
    names, in words, the accuracy that the budget did not suffice for.
    """

    rel_error: float
    counts: ImpactCounts
    hits_per_burst: float | None = None
    unknown: str = ""

    @property
    def speed(self) -> Estimate | None:
        """Mean impact speed of the only pair, m/s; None where there are several."""
        return None if len(self.counts.speeds) > 1 else next(iter(self.counts.speeds.values()))


@dataclass(kw_only=True)
class Hits:
    """Impacts of a scene at one place after the other, from the same random numbers.

    `scene_at` gives the scene at a place, and `words` says where the stops are. `first_rate` gives
    the limiting rate of first impacts (1/s), and the time for which a cluster is followed (s).
    """

    scene_at: Callable[[float], Scene]
    first_rate: Callable[[float], tuple[float, float]]
    words: Callable[[float], str]
    tried: dict[float, PlaceTrial] = field(default_factory=dict)

    def at(self, place: float, run: Run) -> PlaceTrial:
        """The impacts at a place: simulated unless they are known at least as accurately."""
        wanted = run.accuracy
        if place not in self.tried or self.tried[place].rel_error > wanted:
            first, window = self.first_rate(place)
            counts = count_impacts(self.scene_at(place), first * window, run)
            found = self._trial(place, wanted, counts, first)
            known = self.tried.get(place, found)
            # a finer look that the budget ended may know less than the rough one before it
            rougher = _relative_error(known.counts.rate) < _relative_error(found.counts.rate)
            self.tried[place] = (
                replace(known, rel_error=wanted, unknown=found.unknown) if rougher else found
            )
        return self.tried[place]

    def _trial(
        self, place: float, rel_error: float, found: ImpactCounts, first: float
    ) -> PlaceTrial:
        hits = found.hits_per_burst
        per_burst = None if hits is None else hits.value
        if hits is None and first and not found.rate.upper_95:
            per_burst = found.rate.value / first
        unknown = ""
        if found.short:
            unknown = (
                f"the budget ended before the impacts at {self.words(place)} were known to a "
                f"relative error of {rel_error:g}"
            )
        return PlaceTrial(
            rel_error=rel_error, counts=found, hits_per_burst=per_burst, unknown=unknown
        )


def _relative_error(rate: Estimate) -> float:
    """Standard error of a rate, relative to it; infinite where an upper limit alone is known."""
    return rate.standard_error / rate.value if rate.value > 0.0 else math.inf
