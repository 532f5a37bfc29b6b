"""Chances from what is given: first crossings of the motion without stops, bursts after them."""

from __future__ import annotations

import math
import time
from dataclasses import replace

from stochvi.methods.monte_carlo import simulate
from stochvi.methods.monte_carlo.missions import NEEDS_FORCE
from stochvi.model.model import model_of
from stochvi.results.deadline import as_far_as_it_got
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import logarithmic_interval, normal_quantile
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import Bursts, bursts
from stochvi.statistics.first_crossings import first_crossings
from stochvi.statistics.reliability.answer import Chance
from stochvi.statistics.reliability.choice import Hits, Jobs

Ends = tuple[float | None, float | None]
"""Lower and upper stop or barrier, m; None for none."""

SMALL = 0.5
"""A chance of a first hit up to which first crossings reach the accuracy asked for."""


WIDENING = 1.5
"""Half of the first hits are drawn so much faster, and weighted: fast hits are seen more often."""


def first_hit(
    scene: Scene, ends: Ends, mission: float, jobs: Jobs, *, surely: bool
) -> Chance | None:
    """P(any hit, or passage) of the stationary motion; None where another way is better, unless
    it is to be this one `surely`."""
    rest = model_of(scene).rest
    below, above = (
        math.inf if end is None else side * (end - rest)
        for side, end in zip((-1.0, 1.0), ends, strict=True)
    )
    if not (below > 0.0 and above > 0.0):
        if surely:
            raise NotApplicable(
                "first crossings", ["the rest position must lie between the stops or barriers"]
            )
        return None
    started = time.process_time()
    crossings = as_far_as_it_got(
        first_crossings, scene, lower=[below], upper=[above], mission=mission,
        rel_error=jobs.rel_error, **jobs.sampling,
    )  # fmt: skip
    (estimate,) = crossings.probability(mission)
    if not surely and not 0.0 < estimate.value < SMALL:
        return None
    paths = crossings.ages.shape[-2]
    lower, upper = logarithmic_interval(
        estimate.value, estimate.standard_error, paths - 1, jobs.confidence
    )
    return Chance(
        event="hit" if scene.impact_pairs else "passage",
        limit=None,
        estimate=estimate,
        lower=lower,
        upper=min(upper, 1.0),
        confidence=jobs.confidence,
        rule=f"Student's, of the logarithm, from a jackknife over {paths} paths",
        way="first crossings",
        why=(
            "first crossings: before the first hit the motion is stationary and Gaussian, and "
            "crossings that are given need not be waited for, however rare"
        ),
        trials=paths,
        seconds=time.process_time() - started,
    )


def by_conditioning(
    scene: Scene, ends: Ends, limits: dict[str, float], mission: float, jobs: Jobs
) -> tuple[dict[str, Chance], Hits | None, dict[str, str]]:
    """Of noise with a memory of its own, from a stationary start; and why what is missing was not
    found."""
    chance = first_hit(scene, ends, mission, jobs, surely=True)
    assert chance is not None
    chances = {chance.event: chance}
    if not scene.impact_pairs:
        if limits:
            raise NotApplicable(
                "reliability", ["impacts need a stop, got a scene without impact_pair"]
            )
        return chances, None, {}
    missing: dict[str, str] = {}
    for name, limit in limits.items():
        try:
            chances[name] = _exceedance(scene, name, limit, mission, jobs)
        except (NotConverged, Interrupted) as error:
            missing[name] = str(error)
    try:
        return chances, _hits(scene, mission, jobs), missing
    except (NotConverged, Interrupted) as error:
        return chances, None, missing | {"expected_hits": str(error)}


def _exceedance(scene: Scene, name: str, limit: float, mission: float, jobs: Jobs) -> Chance:
    """1 - exp(-rate T), bursts with an exceedance being apart and so a Poisson process."""
    rigid = any(law.rigid for _, law in scene.impact_pairs[0].stops())
    if name == "peak_acceleration" and rigid:
        raise NotApplicable("peak_acceleration", [NEEDS_FORCE])
    started = time.process_time()

    def wanted(found: Bursts) -> Estimate:
        return found.exceedance_rate(name, limit)

    found = as_far_as_it_got(
        bursts, scene, rel_error=jobs.rel_error, wanted=wanted, widening=WIDENING, **jobs.sampling
    )
    rate = wanted(found)
    if not found.apart:
        raise NotApplicable(
            name,
            ["under noise that is not white hits must come in bursts that are far apart; here they "
             "meet: widen the gap, or ask for hits alone"],
        )  # fmt: skip
    risk = -math.expm1(-rate.value * mission)
    left = mission * math.exp(-rate.value * mission)
    ends = logarithmic_interval(
        rate.value, rate.standard_error, len(set(found.path.tolist())) - 1, jobs.confidence
    )
    if rate.value == 0.0:
        ends = 0.0, (rate.upper_95 or 0.0)
    lower, upper = (-math.expm1(-end * mission) for end in ends)
    return Chance(
        event=name,
        limit=limit,
        estimate=Estimate(
            value=risk,
            standard_error=left * rate.standard_error,
            bias=None if rate.bias is None else left * rate.bias,
            how=rate.how,
        ),
        lower=lower,
        upper=upper,
        confidence=jobs.confidence,
        rule="Student's, of the logarithm of the rate, from a jackknife over paths",
        way="bursts",
        why=(
            "bursts: first hits are given, what follows them is simulated, and bursts as far apart "
            "as these are independent"
        ),
        trials=len(found.path),
        seconds=time.process_time() - started,
    )


def _hits(scene: Scene, mission: float, jobs: Jobs) -> Hits:
    """Rate times mission: by bursts where they are apart, else by simulating everything."""
    found = as_far_as_it_got(bursts, scene, rel_error=jobs.rel_error, **jobs.sampling)
    rate, steps = found.hit_rate(), 0
    if not found.apart:
        response = as_far_as_it_got(simulate, scene, rel_error=jobs.rel_error, **jobs.sampling)
        simulated = response.impact_pairs[scene.impact_pairs[0].name]["collision_rate"]
        assert isinstance(simulated, Estimate)
        rate, steps = simulated, response.cost.steps
    estimate = replace(rate * mission, how=f"{mission:g} s times the rate: {rate.how}")
    reach = normal_quantile(1.0 - jobs.confidence) * estimate.standard_error
    return Hits(estimate, (max(estimate.value - reach, 0.0), estimate.value + reach), steps)
