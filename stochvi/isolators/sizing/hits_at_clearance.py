"""Impacts at a clearance: by clusters where first impacts are rare, else by simulating the whole
motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing.risk_curve import RiskCurve
from stochvi.results.estimates import Estimate
from stochvi.results.response import Response
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.cluster_paths import WINDOWS
from stochvi.statistics.impact_counts import ImpactCounts, count_impacts


@dataclass(frozen=True, kw_only=True)
class ClearanceTrial:
    """Rate and speed of the impacts at one clearance, by clusters or by simulating the whole
    motion.

    `unknown` names, in words, the accuracy that the budget did not suffice for.
    """

    clearance: float
    rel_error: float
    hit_rate: Estimate
    impact_speed_mean: Estimate | None
    hits_per_burst: float | None = None
    response: Response | None = None
    unknown: str = ""


@dataclass(kw_only=True)
class Hits:
    """Impacts of a scene at one clearance after the other, from the same random numbers.

    `part` returns the run of the next calculation, by its relative error.
    """

    scene: Scene
    curve: RiskCurve
    rel_error: float
    part: Callable[[float], Run]
    tried: dict[float, ClearanceTrial] = field(default_factory=dict)

    @property
    def window(self) -> float:
        """Seconds for which a cluster is simulated."""
        return WINDOWS * self.curve.crossings.horizon

    def at(self, clearance: float, rel_error: float | None = None) -> ClearanceTrial:
        """The impacts at a clearance: simulated unless they are known at least as accurately."""
        wanted = rel_error or self.rel_error
        if clearance not in self.tried or self.tried[clearance].rel_error > wanted:
            overlap = self.curve.first_rate(clearance) * self.window
            scene = at_clearances(self.scene, clearance)
            counts = count_impacts(scene, overlap, self.part(wanted))
            found = self._trial(clearance, wanted, counts)
            known = self.tried.get(clearance, found)
            # a finer look that the budget ended may know less than the rough one before it
            rougher = _relative_error(known.hit_rate) < _relative_error(found.hit_rate)
            self.tried[clearance] = (
                replace(known, rel_error=wanted, unknown=found.unknown) if rougher else found
            )
        return self.tried[clearance]

    def _trial(self, clearance: float, rel_error: float, found: ImpactCounts) -> ClearanceTrial:
        first, hits = self.curve.first_rate(clearance), found.hits_per_burst
        per_burst = None if hits is None else hits.value
        if hits is None and first and not found.rate.upper_95:
            per_burst = found.rate.value / first
        unknown = ""
        if found.short:
            unknown = (
                f"the budget ended before the impacts at {1e3 * clearance:.4g} mm were known to a "
                f"relative error of {rel_error:g}"
            )
        (speed,) = found.speeds.values()
        return ClearanceTrial(
            clearance=clearance, rel_error=rel_error, hit_rate=found.rate, impact_speed_mean=speed,
            hits_per_burst=per_burst, response=found.response, unknown=unknown,
        )  # fmt: skip


def _relative_error(rate: Estimate) -> float:
    """Standard error of a rate, relative to it; infinite where an upper limit alone is known."""
    return rate.standard_error / rate.value if rate.value > 0.0 else math.inf
