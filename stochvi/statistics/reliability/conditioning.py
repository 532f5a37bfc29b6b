"""Probabilities from records that are conditioned on a crossing: first crossings of the motion
without stops, and the clusters after them."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stochvi.model.model import model_of
from stochvi.results.deadline import partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.intervals import logarithmic_interval
from stochvi.scenes.scene import Scene
from stochvi.statistics.first_crossings import first_crossings
from stochvi.statistics.free_windows import windows_of
from stochvi.statistics.impact_counts import ImpactCounts, count_impacts
from stochvi.statistics.pair_crossings import own_distances
from stochvi.statistics.rare_hits import Windows, rare_hits
from stochvi.statistics.reliability.answer import Chance, PairRisk
from stochvi.statistics.reliability.choice import Hits, Jobs
from stochvi.statistics.structure_hits import Limit, overlap_of
from stochvi.statistics.structure_hits import exceedance as exceedance_of_pairs
from stochvi.statistics.trial_splitting import Question, RareHits

Ends = tuple[float | None, float | None]
"""Lower and upper stop or barrier, m; None for none."""

SMALL = 0.5
"""Probability of a first impact up to which first crossings reach the accuracy asked for."""


def first_hit(
    scene: Scene, ends: Ends, mission: float, jobs: Jobs, *, surely: bool
) -> Chance | None:
    """P(any impact, or passage) of the stationary motion; None where another way is better, unless
    this way is asked for (`surely`)."""
    rest = model_of(scene).rest
    below, above = (
        math.inf if end is None else side * (end - rest)
        for side, end in zip((-1.0, 1.0), ends, strict=True)
    )
    if not (below > 0.0 and above > 0.0):
        if surely:
            raise NotApplicable(
                "first crossings",
                [
                    "the static equilibrium must lie between the stops or barriers, got one that "
                    f"is {max(-below, -above):.4g} m beyond; move them; for a mass that is pressed "
                    "onto a stop, impacts counts the returns"
                ],
            )
        return None
    started = time.process_time()
    crossings = partial_result(
        first_crossings, scene, lower=[below], upper=[above], mission=mission,
        **jobs.sampling,
    )  # fmt: skip
    (estimate,) = crossings.probability(mission)
    if not surely and not 0.0 < estimate.value < SMALL:
        return None
    event = "hit" if scene.impact_pairs else "passage"
    return _from_crossings(event, estimate, crossings.ages.shape[-2], jobs, started)


def first_hits_of_pairs(
    scene: Scene, pair: str | None, mission: float, jobs: Jobs
) -> tuple[Chance, dict[str, PairRisk], float]:
    """P(any pair is hit) in the stationary motion, or that of one `pair` as if it alone had stops;
    the risk of each pair; and the `overlap_of` clusters."""
    started = time.process_time()
    model = model_of(scene)
    below, above = own_distances(model)
    names = [each.name for each in model.pairs]
    kept = [[True] * len(names), *np.eye(len(names), dtype=bool)]
    if pair is not None:
        kept = [kept[1 + names.index(pair)]]
    crossings = partial_result(
        first_crossings, scene, lower=np.where(kept, below, np.inf),
        upper=np.where(kept, above, np.inf), mission=mission, **jobs.sampling,
    )  # fmt: skip
    estimate, *alone = crossings.probability(mission)
    shares = crossings.shares(mission)[0]
    risks = {
        name: PairRisk(probability=chance, share_of_first_hits=float(share))
        for name, chance, share in zip(names, alone, shares, strict=False)
    }
    chance = _from_crossings("hit", estimate, crossings.ages.shape[-2], jobs, started)
    return chance, risks, overlap_of(crossings)


def harder_hits_of_pairs(
    scene: Scene, limit: Limit, mission: float, overlap: float, jobs: Jobs
) -> tuple[Chance, dict[str, Estimate]]:
    """The probability that any impact of the mission exceeds a limit and, for an acceleration, the
    probability for every output alone.

    Where hardly any cluster or window exceeds it, the splitting of `exceedance` finds it, for all
    outputs together.
    """
    started = time.process_time()
    found = exceedance_of_pairs(scene, limit, mission, overlap, jobs.part)
    estimate = found.chance
    if estimate.upper_95 is not None and not jobs.deadline.passed():
        split = exceedance(scene, limit, mission, jobs)
        only = limit.outputs[0] if len(limit.outputs) == 1 else None
        return split, {} if only is None else {only: split.estimate}
    lower, upper = logarithmic_interval(
        estimate.value, estimate.standard_error, found.degrees, jobs.confidence
    )
    rule = f"Student's, of the logarithm, from a jackknife over {found.degrees + 1} paths"
    if estimate.value == 0.0:
        rule, upper = f"upper limit: {estimate.how}", estimate.upper_95 or 1.0
    why = {
        "bursts": "clusters: records hold a first impact of any pair, a fast one more often; the "
        "motion after it is simulated with all stops",
        "windows": "windows: clusters follow without a pause here; windows of the whole motion are "
        "simulated with all stops",
    }[found.way]
    chance = Chance(
        event=limit.event,
        limit=limit.value,
        estimate=estimate,
        lower=lower,
        upper=min(upper, 1.0),
        confidence=jobs.confidence,
        rule=rule,
        way=found.way,
        why=why,
        trials=found.trials,
        seconds=time.process_time() - started,
    )
    return chance, dict(found.by_output)


def hits_of_pairs(
    scene: Scene, mission: float, overlap: float, risks: Mapping[str, PairRisk], jobs: Jobs
) -> tuple[Hits, dict[str, PairRisk]]:
    """Expected impacts of a mission on all pairs, and the risk of each pair with its own
    impacts."""
    found = count_impacts(scene, overlap, jobs.part)
    named = [pair.name for pair in scene.impact_pairs]
    known = {
        name: replace(
            risk,
            expected_hits=found.rates[name] * mission,
            impact_speed_mean=found.speeds[name],
        )
        for name, risk in risks.items()
        if name in named
    }
    return _in_mission(found, mission, jobs), dict(risks) | known


SMALLEST = sys.float_info.min
"""Smallest probability that a floating-point number holds with all its digits. Stops some 38
standard deviations away are crossed less often; the probability is then given as 0, with this
number as its upper limit."""


def _from_crossings(
    event: str, estimate: Estimate, paths: int, jobs: Jobs, started: float
) -> Chance:
    """The probability of a first impact, which first crossings found since CPU second `started`."""
    lower, upper = 0.0, SMALLEST
    if estimate.value > 0.0:
        lower, upper = logarithmic_interval(
            estimate.value, estimate.standard_error, paths - 1, jobs.confidence
        )
        estimate = of_events(estimate, paths)
    if estimate.upper_95 is not None:
        lower, upper = 0.0, estimate.upper_95
        estimate = replace(estimate, upper_95=min(upper, 1.0))
    return Chance(
        event=event,
        limit=None,
        estimate=estimate,
        lower=lower,
        upper=min(upper, 1.0),
        confidence=jobs.confidence,
        rule=f"Student's, of the logarithm, from a jackknife over {paths} paths",
        way="first crossings",
        why=(
            "first crossings: before the first impact the motion is stationary and Gaussian; "
            "records hold a crossing, however rare, and none is waited for"
        ),
        trials=paths,
        seconds=time.process_time() - started,
    )


def by_conditioning(
    scene: Scene, ends: Ends, limits: dict[str, float], mission: float, jobs: Jobs
) -> tuple[dict[str, Chance], Hits | None, dict[str, str]]:
    """Probabilities and expected impacts from a stationary start under noise with a memory of its
    own, and the reasons why something was not found."""
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
    hits = None
    try:
        hits = _hits(scene, mission, jobs.sharing(len(limits)))
    except (NotConverged, Interrupted) as error:
        missing["expected_hits"] = str(error)
    for done, (name, limit) in enumerate(limits.items()):
        some = jobs.sharing(len(limits) - done - 1)
        try:
            chances[name] = exceedance(scene, Limit(name, limit), mission, some)
        except (NotConverged, Interrupted) as error:
            missing[name] = str(error)
    return chances, hits, missing


def exceedance(scene: Scene, limit: Limit, mission: float, jobs: Jobs) -> Chance:
    """The probability that any impact of the mission exceeds a limit, by splitting of trials."""
    found = rare_hits(
        scene, limit.event, limit.value, mission=mission, outputs=limit.outputs or None,
        confidence=jobs.confidence, **jobs.sampling,
    )  # fmt: skip
    way, why = (
        "bursts",
        (
            "clusters: records hold a first impact, and the motion after it is simulated; a "
            "splitting finds those clusters in which any impact exceeds the limit"
        ),
    )
    if isinstance(found.kind, Windows):
        way, why = (
            "windows",
            (
                "windows: clusters follow without a pause here; the whole motion is simulated, and "
                "a splitting finds those pieces of it that exceed the limit"
            ),
        )
    return _from_splitting(found, limit.event, limit.value, way, why, jobs)


def first_hit_under_peaks(scene: Scene, pair: str | None, mission: float, jobs: Jobs) -> Chance:
    """P(any impact), or P(an impact on one pair), under noise with fast peaks."""
    model, started = model_of(scene), time.process_time()
    below, above = own_distances(model)
    if pair is not None:
        others = np.array([each.name != pair for each in model.pairs])
        below, above = (np.where(others, math.inf, each) for each in (below, above))
    kind = windows_of(model, below.tolist(), above.tolist(), mission, jobs.run.seed)
    found = Question(1.0, mission, jobs.confidence, jobs.part).answer(kind)
    assert found is not None  # pieces always end
    why = (
        "pieces of the motion: noise with fast peaks moves it as it comes, and a splitting finds "
        "the pieces that reach a stop"
    )
    found = replace(found, seconds=time.process_time() - started)
    return _from_splitting(found, "hit", None, "splitting", why, jobs)


def _from_splitting(
    found: RareHits, event: str, limit: float | None, way: str, why: str, jobs: Jobs
) -> Chance:  # fmt: skip
    """The probability that a splitting of trials found."""
    rule = f"Student's, of the logarithm, from a jackknife over {found.repetitions} repetitions"
    if found.chance.value == 0.0:
        rule = f"upper limit: {found.chance.how}"
    return Chance(
        event=event,
        limit=limit,
        estimate=found.chance,
        lower=found.lower,
        upper=found.upper,
        confidence=jobs.confidence,
        rule=rule,
        way=way,
        why=why,
        trials=found.repetitions,
        levels=found.levels,
        seconds=found.seconds,
    )


def _hits(scene: Scene, mission: float, jobs: Jobs) -> Hits:
    """Rate of impacts times mission."""
    return _in_mission(count_impacts(scene, 0.0, jobs.part), mission, jobs)


def _in_mission(found: ImpactCounts, mission: float, jobs: Jobs) -> Hits:
    """Expected impacts of a mission from their rate."""
    rate = found.rate
    estimate = replace(rate * mission, how=f"{mission:g} s times the rate: {rate.how}")
    return Hits(estimate, jobs.interval(estimate, found.samples), found.steps)
