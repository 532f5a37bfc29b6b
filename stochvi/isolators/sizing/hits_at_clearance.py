"""Hits at a clearance: by bursts where first hits are rare, else by simulating the whole motion."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from stochvi.isolators.moved_stops import at_clearances
from stochvi.isolators.sizing.risk_curve import RiskCurve
from stochvi.methods.monte_carlo import simulate
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.response import Response
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import UNFINISHED, bursts
from stochvi.statistics.cluster_paths import WINDOWS


@dataclass(frozen=True, kw_only=True)
class ClearanceTrial:
    """Rate and speed of the hits at one clearance, by bursts or by simulating the whole motion.

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
    """Hits of a scene at one clearance after the other, from the same random numbers.

    `part` returns the run of the next calculation, by its relative error.
    """

    scene: Scene
    curve: RiskCurve
    rel_error: float
    part: Callable[[float], Run]
    tried: dict[float, ClearanceTrial] = field(default_factory=dict)

    @property
    def window(self) -> float:
        """Seconds for which a burst is simulated."""
        return WINDOWS * self.curve.crossings.horizon

    def at(self, clearance: float, rel_error: float | None = None) -> ClearanceTrial:
        """The hits at a clearance: simulated unless they are known at least as accurately."""
        wanted = rel_error or self.rel_error
        if clearance not in self.tried or self.tried[clearance].rel_error > wanted:
            scene = at_clearances(self.scene, clearance)
            rare = self.curve.first_rate(clearance) * self.window < UNFINISHED
            by_bursts = self._by_bursts(scene, clearance, wanted) if rare else None
            found = by_bursts or self._by_simulation(scene, clearance, wanted)
            known = self.tried.get(clearance, found)
            # a finer look that the budget ended may know less than the rough one before it
            rougher = _relative_error(known.hit_rate) < _relative_error(found.hit_rate)
            self.tried[clearance] = (
                replace(known, rel_error=wanted, unknown=found.unknown) if rougher else found
            )
        return self.tried[clearance]

    def _by_bursts(self, scene: Scene, clearance: float, rel_error: float) -> ClearanceTrial | None:
        """The hits by bursts; None if bursts do not end or no pause separates them."""
        try:
            asked = self.part(rel_error).options(rel_error=rel_error)
            found = partial_result(bursts, scene, **asked)
        except NotApplicable:
            return None
        if not found.apart:
            return None
        return ClearanceTrial(
            clearance=clearance,
            rel_error=rel_error,
            hit_rate=of_events(found.hit_rate(), found.paths),
            impact_speed_mean=found.impact_speed_mean(),
            hits_per_burst=found.hits_per_burst().value,
        )

    def _by_simulation(self, scene: Scene, clearance: float, rel_error: float) -> ClearanceTrial:
        unknown = ""
        try:
            response = simulate(scene, **self.part(rel_error).options(rel_error=rel_error))
        except (NotConverged, Interrupted) as reason:
            if reason.partial is None:
                raise
            response = reason.partial
            unknown = (
                f"the budget ended before the impacts at {1e3 * clearance:.4g} mm were known to a "
                f"relative error of {rel_error:g}"
            )
        pair = response.impact_pairs[scene.impact_pairs[0].name]
        hit_rate, speed = pair["collision_rate"], pair["impact_speed_mean"]
        assert isinstance(hit_rate, Estimate)
        first = self.curve.first_rate(clearance)
        return ClearanceTrial(
            clearance=clearance,
            rel_error=rel_error,
            hit_rate=hit_rate,
            impact_speed_mean=speed if isinstance(speed, Estimate) else None,
            hits_per_burst=hit_rate.value / first if first and not hit_rate.upper_95 else None,
            response=response,
            unknown=unknown,
        )


def _relative_error(rate: Estimate) -> float:
    """Standard error of a rate, relative to it; infinite where an upper limit alone is known."""
    return rate.standard_error / rate.value if rate.value > 0.0 else math.inf
