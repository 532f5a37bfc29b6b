"""Impacts per second on one pair or several: by clusters where these are apart, else by simulating
everything."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stochvi.methods.monte_carlo import simulate
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.response import Response
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import UNFINISHED, Bursts, bursts


@dataclass(frozen=True, kw_only=True)
class ImpactCounts:
    """Impacts per second, together and by pair, and their mean speeds (m/s; None where unknown).

    `way` is "bursts" or "simulation", and `samples` the number of independent paths. `response` is
    that of the simulation; it is `short` where the budget ended before it was accurate enough, or
    hardly an impact was seen.
    """

    rate: Estimate
    rates: Mapping[str, Estimate]
    speeds: Mapping[str, Estimate | None]
    way: str
    samples: int
    hits_per_burst: Estimate | None = None
    response: Response | None = None
    short: bool = False

    @property
    def steps(self) -> int:
        """Number of steps of the simulation; 0 where there is none."""
        return 0 if self.response is None else self.response.cost.steps


def count_impacts(scene: Scene, overlap: float, run: Run) -> ImpactCounts:
    """Count impacts on all stops of a scene.

    Parameters
    ----------
    overlap
        Expected first impacts in the time for which a cluster is followed; 0 where that is not
        known.
    """
    found = clusters_apart(scene, overlap, run)
    if found is not None:
        return ImpactCounts(
            rate=of_events(found.hit_rate(), found.paths),
            rates={name: of_events(found.hit_rate(name), found.paths) for name in found.pairs},
            speeds={
                # a mean of one path has no error
                name: found.impact_speed_mean(name)
                if len(np.unique(found.path[hits > 0])) > 1
                else None
                for name, hits in zip(found.pairs, found.hits, strict=True)
            },
            way="bursts",
            samples=found.paths,
            hits_per_burst=found.hits_per_burst(),
        )
    short = False
    try:
        response = simulate(scene, **run.options(rel_error=run.rel_error))
    except (NotConverged, Interrupted) as reason:
        if reason.partial is None:
            raise
        response, short = reason.partial, True
    rates, speeds = {}, {}
    for pair in scene.impact_pairs:
        rate, speed = (
            response.impact_pairs[pair.name].get(name)
            for name in ("collision_rate", "impact_speed_mean")
        )
        assert isinstance(rate, Estimate)
        rates[pair.name] = rate
        speeds[pair.name] = speed if isinstance(speed, Estimate) else None
    short = short or all(rate.upper_95 is not None for rate in rates.values())
    return ImpactCounts(
        rate=_sum([*rates.values()]), rates=rates, speeds=speeds, way="simulation",
        samples=response.cost.paths, response=response, short=short,
    )  # fmt: skip


def clusters_apart(
    scene: Scene, overlap: float, run: Run,
    wanted: Callable[[Bursts], Estimate] = Bursts.hit_rate, **asked: Any,
) -> Bursts | None:  # fmt: skip
    """The clusters of a scene; None where they meet, or where no pause separates them."""
    if overlap >= UNFINISHED:
        return None
    options = run.options(rel_error=run.rel_error)
    try:
        found: Bursts = partial_result(bursts, scene, wanted=wanted, **asked, **options)
    except NotApplicable:
        return None
    return found if found.apart else None


def _sum(rates: list[Estimate]) -> Estimate:
    """Sum of rates of one simulation, whose errors add up at worst."""
    if len(rates) == 1:
        return rates[0]
    known = [each for each in rates if each.upper_95 is None]
    if not known:
        return replace(rates[0], upper_95=math.fsum(each.upper_95 or 0.0 for each in rates))
    return replace(
        known[0],
        value=math.fsum(each.value for each in known),
        standard_error=math.fsum(each.standard_error for each in known),
        # impacts on pairs of which an upper limit alone is known are left out
        bias=math.fsum(each.bias or each.upper_95 or 0.0 for each in rates),
    )
