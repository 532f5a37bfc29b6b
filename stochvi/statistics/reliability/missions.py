"""Risks of missions. Chapters: the answer; missions of several phases; noise of varying level."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy

from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.units import spoken_mission
from stochvi.mathematics.unsteady_noise import RandomLevel
from stochvi.model.coverage import free_motion
from stochvi.model.model import Model, model_of
from stochvi.results.base import (
    DataFrame,
    Named,
    Result,
    frame_by,
    frame_of,
    in_three_columns,
    named_with_units,
    stated,
)
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import (
    NEAR_ONE,
    Cost,
    Estimate,
    capital,
    chance_of,
    combined,
    count_of,
    over_percent,
    spoken_percent,
    total,
)
from stochvi.sampling.calculations import KINDS, AccuracyOptions
from stochvi.sampling.run import Run
from stochvi.scenes.phases import Phase, steps_of_bands
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossings import own_distances, rice_rate
from stochvi.statistics.hardness import HardestImpact, hardness_of
from stochvi.statistics.hazards import CERTAIN, Hazard, joined
from stochvi.statistics.mission_parts import (
    asked_in_parts,
    complete,
    said_of_parts,
    said_of_phases,
)

# ------------------------------------------------------------------------------
# The answer on a mission: probabilities with their intervals, how they were found, and the CPU
# time.
# ------------------------------------------------------------------------------


class RiskOptions(HardestImpact, AccuracyOptions, total=False):
    """Limits of the hardest impact (`HardestImpact`), and `AccuracyOptions`."""


KINDS[RiskOptions.__name__] = RiskOptions


@dataclass(frozen=True, kw_only=True)
class Chance:
    """The probability of one event in a mission.

    Parameters
    ----------
    event
        "hit", "passage", or a kind of hardness, as "impact_speed" or "peak_acceleration".
    limit
        Value, SI, above which an impact is as hard as that; None for "hit" and "passage".
    estimate
        P of the event in one mission.
    lower, upper, rule
        Confidence interval at `confidence`, statistical errors alone, and how it was made.
    wilson
        Wilson's interval, where missions were counted; else None.
    way, why
        The way in which it was found, and the reason for that way.
    trials
        Number of missions, or of repetitions of a splitting in `levels` levels.
    seconds
        CPU seconds of the answer, its pilot and its coarser steps included.
    seconds_per_mission
        CPU seconds of one crude mission, measured; None where none was simulated.
    crude_seconds
        CPU seconds that crude simulation would take for the same standard error.

    See Also
    --------
    stochvi.reliability : The answer that holds it.
    """

    in_document: ClassVar = {"crude_seconds": "crude_seconds"}

    event: str
    limit: float | None
    estimate: Estimate
    lower: float
    upper: float
    confidence: float
    rule: str
    way: str
    why: str
    wilson: tuple[float, float] | None = None
    trials: int = 0
    levels: int = 0
    steps: int = 0
    seconds: float = 0.0
    seconds_per_mission: float | None = None

    @property
    def crude_seconds(self) -> float | None:
        """CPU seconds per mission times (1 - P) / (P e^2), e the relative standard error."""
        p, error = self.estimate.value, self.estimate.standard_error
        if self.seconds_per_mission is None or not (p > 0.0 and error > 0.0):
            return None
        return self.seconds_per_mission * p * (1.0 - p) / error**2

    @property
    def words(self) -> str:
        """The event with its limit."""
        if self.limit is None:
            return EVENTS[self.event]
        return hardness_of(self.event).beyond(self.limit)

    @property
    def likely(self) -> str:
        """The probability in words: near 1 the number that it exceeds, and its upper limit where
        the event was never seen."""
        value = self.estimate.value
        if value > NEAR_ONE:
            return over_percent(self.lower) if self.lower >= SURELY else "hardly known"
        limit = None if value > 0.0 else self.upper
        return chance_of(Estimate(value=value, upper_95=limit))

    @property
    def interval(self) -> str:
        """The interval in words, with its level, and the bias that it leaves out where this
        matters."""
        ends = spoken_percent(self.lower) if self.lower > 0.0 else "0", spoken_percent(self.upper)
        level = "bounds" if self.confidence == 1.0 else f"{100.0 * self.confidence:g} %"
        found = f"{' to '.join(dict.fromkeys(ends))}, {level}"
        bias = self.estimate.printed_bias if self.estimate.bias_matters else None
        if not bias or self.confidence == 1.0:  # bounds hold it
            return found
        return f"{found}; bias up to {spoken_percent(float(f'{bias:.2g}'))}"


EVENTS = {"hit": "an impact", "passage": "a passage of the barrier"}
"""Events of a mission that have no limit, in words."""

SURELY = 0.9
"""Lower end of an interval that reaches to 1, from which on "over" and that end are told; where it
is lower the probability is hardly known."""


@dataclass(frozen=True, kw_only=True)
class PairRisk:
    """The risk of one of several pairs in a mission.

    Parameters
    ----------
    probability
        Probability that the pair is hit, as if it alone had stops.
    share_of_first_hits
        Share of the first impacts of a mission that falls to the pair. Where two pairs reach their
        stops at the same time, the hit counts for the earlier one in the scene.
    expected_hits, impact_speed_mean
        Impacts on the pair in a mission, with all stops at their places, and their mean speed, m/s;
        None where they are not known.
    """

    probability: Estimate
    share_of_first_hits: float
    expected_hits: Estimate | None = None
    impact_speed_mean: Estimate | None = None


@dataclass(frozen=True, kw_only=True)
class GapRisk:
    """The probability that one of many gaps closes in a mission, as if it alone could.

    Parameters
    ----------
    side
        The stop that is reached more often, "lower" or "upper".
    clearance
        Distance of that stop from the mean gap, less its tolerance, m.
    displacement_std
        Standard deviation of the gap without stops, m.
    crossings
        Expected crossings of its stops in the mission without stops (Rice).
    probability, at_least, at_most
        Probability of a contact, and its bounds.

    See Also
    --------
    stochvi.reliability : The answer that holds it.
    """

    side: str
    clearance: float = stated("gap", "m", MISSING)
    displacement_std: float = stated("rms motion", "m", MISSING)
    crossings: float = stated("crossings", "1", MISSING)
    probability: float = stated("probability", "1", MISSING)
    at_least: float = stated("at least", "1", MISSING)
    at_most: float = stated("at most", "1", MISSING)

    @property
    def hazard(self) -> Hazard:
        """That of a contact, between bounds."""
        return Hazard.of(self.probability, self.at_least, self.at_most, bounded=True)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Reliability(Result):
    """The risk of a mission: `chances` by event, and `hits`, the expected number of impacts.

    `hits` is None without stops; `hits_interval` is its confidence interval. `missing` says why
    something was not found, or not as accurately as asked for: then the answer comes with a
    `NotConverged`. `pairs` holds, by name, what each of several pairs risks, and `outputs` the
    probability that each coordinate or point alone exceeds the limit of the acceleration. `phases`
    holds, by name, the answer for each phase of the mission, where the scene has phases. `gaps`
    holds many pairs, or those of a certain contact, in the order of their probability;
    `gap_table()` is their table.

    See Also
    --------
    stochvi.reliability : The calculation.
    """

    in_document: ClassVar = {
        "no_hit": "no_hit", "expected_hits": "hits", "expected_hits_interval": "hits_interval",
    }  # fmt: skip
    sometimes = ("pairs", "outputs", "phases", "gaps")

    mission: float
    start: str
    chances: Mapping[str, Chance]
    hits: Estimate | None
    hits_interval: tuple[float, float] | None
    confidence: float
    assumptions: Sequence[str]
    missing: Mapping[str, str] = field(default_factory=dict)
    pairs: Mapping[str, PairRisk] = field(default_factory=dict)
    outputs: Mapping[str, Estimate] = field(default_factory=dict)
    phases: Mapping[str, Reliability] = field(default_factory=dict)
    gaps: Mapping[str, GapRisk] = field(default_factory=dict)
    method: str = "reliability"

    @property
    def no_hit(self) -> Estimate | None:
        """P(no impact in a mission); None where no impact was asked after."""
        chance = self.chances.get("hit") or self.chances.get("passage")
        if chance is None:
            return None
        found = chance.estimate
        return Estimate(
            value=1.0 - found.value,
            standard_error=found.standard_error,
            bias=found.bias,
            how=found.how,
        )

    @property
    def quantities(self) -> Mapping[str, Any]:
        """Under "mission" the probabilities by event, and the expected impacts."""
        chances = {name: chance.estimate for name, chance in self.chances.items()}
        return {"mission": Named(chances, expected_hits=self.hits)}

    def to_frame(self) -> DataFrame:
        """A row per probability."""
        own = "estimate.value estimate.standard_error estimate.bias"
        names = f"event limit {own} lower upper way trials seconds crude_seconds"
        table = frame_by(self.chances.values(), names)
        found = {str(name): str(name).removeprefix("estimate.") for name in table}
        return table.rename(columns=found | {"estimate.value": "probability"})

    def gap_table(self) -> DataFrame:
        """A row per gap, in the order of the probability of a contact, as `gaps.csv` has it; empty
        without `gaps`."""
        names = "side clearance displacement_std crossings probability at_least at_most"
        rows = frame_by(self.gaps.values(), names)
        rows.insert(0, "gap", list(self.gaps))
        return named_with_units(rows)

    @property
    def _parts(self) -> Mapping[str, Any]:
        return {**self.gaps, **self.quantities}

    def _shown(self) -> DataFrame:
        names = {"event": "quantity", "probability": "value", "way": "how"}
        return frame_of(in_three_columns(self.to_frame().rename(columns=names).assign(unit="1")))

    def verdict(self) -> str:
        """The probabilities with their intervals, and what was not found."""
        mission, told = spoken_mission(self.mission), []
        for each in self.chances.values():
            likely = f"{each.likely} likely" if "%" in each.likely else each.likely
            sure = each.likely.startswith("over")
            interval = "" if sure else f" ({each.interval})"
            told.append(f"{each.words} in {mission}: {likely}{interval}")
        for name, why in self.missing.items():
            what = "not accurate" if name in self.chances else "not found"
            told.append(f"{name.replace('_', ' ')}: {what}, {why}")
        return " ".join(f"{capital(each)}." for each in told)

    def summary(self) -> str:
        """The verdict, and the expected impacts."""
        mission = spoken_mission(self.mission)
        hits = f" Expected impacts in {mission}: {self.hits_in_words()}."
        return self.verdict() + (hits if self.hits is not None else "")

    def hits_in_words(self) -> str:
        """The expected impacts of the mission with their interval."""
        if self.hits is None:
            return "not known"
        own = "" if self.hits_interval is None else " to ".join(map(count_of, self.hits_interval))
        return f"{count_of(self.hits.value)}{own and f' ({own})'}"


# ------------------------------------------------------------------------------
# The risk of a mission of several phases, from the risks of its phases.
#
# Each phase starts in its own stationary motion, and the phases are independent, so that
#
#     P = 1 - (1 - P_1) (1 - P_2) ...
#
# The interval is made of the hazards -ln(1 - P_k), whose sum it is (`hazards.joined`).
# ------------------------------------------------------------------------------


NEGLIGIBLE = 1e-8
"""Share of the expected crossings of the busiest phase below which a phase is not simulated."""

LEAST = 1e-15
"""Smallest bound of a probability that is stated: smaller ones tell nobody more."""

LAG = 0.125
"""Largest share by which a sine that moves through a resonance moves a mass less than one that
stands still. It is that over w' / (zeta w)^2, with the change of its frequency w'. It was measured
up to a ratio of 1, at damping ratios of 0.02 to 0.1."""


def of_phases(
    scene: Scene, ask: Callable[[Scene, float, Run], Reliability], run: Run
) -> Reliability:
    """The risk of all phases of a scene.

    A phase in which an impact is far less probable than in another one, by Rice's formula, is not
    simulated.

    Parameters
    ----------
    ask
        Finds the risk of the scene of a phase, in its duration, by a part of the run.

    Raises
    ------
    NotConverged, Interrupted
        If a phase was not found as accurately as asked for; with the answer so far. A phase that
        has none leaves the probability as uncertain as Rice's number of its crossings.
    """
    scenes = {phase.name: phase.of(scene) for phase in scene.phases}
    durations = {phase.name: phase.duration for phase in scene.phases}
    idle = _idle(scenes, durations)
    busy = {name: duration for name, duration in durations.items() if name not in idle}
    found, missing = asked_in_parts(
        run, busy, lambda name, part: ask(scenes[name], durations[name], part), all_needed=False
    )
    like = next(iter(found.values()))
    unknown = {
        name: min(_most_hits(scenes[name], durations[name]) or 1.0, 1.0)
        for name in busy
        if name not in found
    }
    found |= {name: _never_hit(like, durations[name], most) for name, most in idle.items()}
    found |= {
        name: _never_hit(like, durations[name], most, NO_ANSWER) for name, most in unknown.items()
    }
    answer = _together(scene, {name: found[name] for name in scenes}, missing, idle, run)
    return complete(answer, missing, run, of="risk of every phase", where="in phase")


def _idle(scenes: Mapping[str, Scene], durations: Mapping[str, float]) -> dict[str, float]:
    """The phases whose impacts do not matter, each with the largest probability of an impact."""
    most = {name: _most_hits(scenes[name], durations[name]) for name in scenes}
    known = {name: bound for name, bound in most.items() if bound is not None}
    largest = min(max(known.values(), default=0.0), 1.0)
    return {name: bound for name, bound in known.items() if bound < NEGLIGIBLE * largest}


def _most_hits(scene: Scene, duration: float) -> float | None:
    """A bound of the probability of a first impact of linear motion; None where it is unknown.

    It is Rice's number of crossings of all stops in the duration, and the probability to start
    beyond one."""
    model = model_of(scene)
    if not model.pairs:
        return None
    try:
        crossings, outside = crossings_of(model)(1.0)
    except NotApplicable:
        return None
    return max(crossings * duration + outside, LEAST)


def lag_of(model: Model, sweep_rate: float) -> float:
    """How much less a frequency that moves by so many Hz/s moves a structure than one that stands
    still, at most, as a share (`LAG`)."""
    slowest = 0.5 * float(np.min(np.diag(model.modal.damping)))
    return LAG * 2.0 * math.pi * sweep_rate / slowest**2 if slowest > 0.0 else math.inf


def lags_of_hazards(scenes: Mapping[str, Scene], rates: Mapping[str, float]) -> dict[str, float]:
    """By how much, as a share, the hazard of each phase through which something moves may be too
    large: Rice's crossings of motion that is larger by `lag_of`."""
    found = {}
    for name, rate in rates.items():
        model = model_of(scenes[name])
        louder = scenes[name].at_level(20.0 * math.log10(1.0 + lag_of(model, rate)))
        try:
            known, more = (crossings_of(each)(1.0)[0] for each in (model, model_of(louder)))
        except NotApplicable:
            continue
        found[name] = more / known - 1.0 if known > 0.0 else 0.0
    return found


def spoken_lags(scenes: Mapping[str, Scene], phases: Sequence[Phase]) -> list[str]:
    """A sentence on each phase through which something moves."""
    most: dict[str, float] = {}
    for phase in phases:
        if phase.step_of is not None and phase.sweep_rate:
            lag = lag_of(model_of(scenes[phase.name]), phase.sweep_rate)
            most[phase.step_of] = max(most.get(phase.step_of, 0.0), lag)
    return [
        f"what moves through phase {name} stands still in each step; in truth it moves the mass by "
        f"at most {100.0 * lag:.2g} % less, which the bias states"
        for name, lag in most.items()
    ]


def crossings_of(model: Model) -> Callable[[float], tuple[float, float]]:
    """Rice's rate of crossings of all stops, 1/s, and the probability to be beyond one, as a
    function of a gain of the noise; sines stay.

    Raises `NotApplicable` where the motion without stops is not stationary and Gaussian.
    """
    motion = free_motion(model, with_sines=True)
    rows = np.array([pair.direction for pair in model.pairs]).reshape(len(model.pairs), -1)
    gaps, stops = motion.moving_means(rows), np.array(own_distances(model))

    def of_gain(gain: float) -> tuple[float, float]:
        louder = [replace(each, place=gain * each.place, speed=gain * each.speed) for each in gaps]
        outside = sum(
            gap.beyond(away)
            for own in stops.tolist()
            for gap, away in zip(louder, own, strict=True)
            if gap.place and math.isfinite(away)
        )
        return rice_rate(louder, stops), outside

    return of_gain


BOUND = "Rice"
"""The way of a phase of which a bound alone is known."""

NO_ANSWER = "no answer was found in time"
"""Why a phase that may matter has a bound alone."""


def _never_hit(
    like: Reliability, duration: float, most: float, why: str = "crossings are too rare"
) -> Reliability:
    """The answer for a phase of which a bound alone is known, with the events of another phase:
    none of them is more probable than an impact."""
    limit = Estimate(value=0.0, upper_95=most, how="at most Rice's number of crossings")
    chances = {
        event: replace(
            chance, estimate=limit, lower=0.0, upper=most, rule=limit.how, way=BOUND, wilson=None,
            why=why, trials=0, levels=0, steps=0, seconds=0.0,
            seconds_per_mission=None,
        )
        for event, chance in like.chances.items()
    }  # fmt: skip
    return replace(
        like, mission=duration, chances=chances, hits=None, hits_interval=None, missing={},
        warnings=(), pairs={}, outputs={}, gaps={}, cost=Cost(wall_time=0.0),
    )  # fmt: skip


def _together(
    scene: Scene, found: Mapping[str, Reliability], missing: dict[str, str],
    idle: Mapping[str, float], run: Run,
) -> Reliability:  # fmt: skip
    busy = {name: each for name, each in found.items() if name not in idle}
    first, steps = next(iter(busy.values())), steps_of_bands(scene.phases)
    scenes = {phase.name: phase.of(scene) for phase in scene.phases}
    lags = lags_of_hazards(
        scenes, {p.name: p.sweep_rate for p in scene.phases if p.sweep_rate and p.name in busy}
    )
    hits, interval, unseen = _hits_together(busy), None, _unseen(busy)
    if hits is not None and hits.upper_95 is not None and len(unseen) < len(busy):
        why = "no impact was seen; raise budget"
        missing |= {f"{name}, expected_hits": why for name in unseen} | missing
        hits = None
    if hits is not None:
        whole = joined({name: _hazard_of_hits(each) for name, each in found.items()}, steps, lags)
        interval = max(whole.value - whole.below - whole.bias, 0.0), whole.value + whole.half
        hits = replace(hits, bias=None if hits.bias is None else hits.bias + whole.bias)
    chances = {
        event: joint_chance({k: each.chances[event] for k, each in found.items()}, steps, lags)
        for event in first.chances
        if all(event in each.chances for each in found.values())
    }
    bounds = (
        f"impacts of phase {name} are not counted: Rice's number of them is at most {most:.1g}"
        for name, most in idle.items()
    )
    more = [*spoken_lags(scenes, scene.phases), *bounds]
    return replace(
        first, mission=sum(each.mission for each in found.values()), chances=chances, hits=hits,
        hits_interval=interval, missing=missing, pairs={}, outputs={}, phases=found,
        gaps=_gaps_together([each.gaps for each in busy.values()]),
        **said_of_phases(scene, found, run, "steps", "paths", more=more),
    )  # fmt: skip


def _gaps_together(phases: Sequence[Mapping[str, GapRisk]]) -> dict[str, GapRisk]:
    """Many gaps in independent phases, in the order of the whole mission, each with its motion in
    its worst phase; none where they are not known in every phase."""
    found = {}
    for name in phases[0] if all(phases) else ():
        each = [phase[name] for phase in phases]
        chance, low, high = joined({str(k): one.hazard for k, one in enumerate(each)}).chances
        found[name] = replace(
            max(each, key=lambda one: one.crossings), probability=chance, at_least=low,
            at_most=high, crossings=math.fsum(one.crossings for one in each),
        )  # fmt: skip
    order = sorted(found, key=lambda name: (-found[name].probability, -found[name].crossings))
    return {name: found[name] for name in order}


TOGETHER = "of independent phases"
"""How a number of all phases was found."""


def _hits_together(phases: Mapping[str, Reliability]) -> Estimate | None:
    """Expected impacts of all phases; None where one does not know them."""
    known = [each.hits for each in phases.values() if each.hits is not None]
    return total(known, how=TOGETHER) if len(known) == len(phases) else None


def _unseen(phases: Mapping[str, Reliability]) -> dict[str, float]:
    """Limits of the impacts of phases in which none was seen."""
    return {
        name: each.hits.upper_95
        for name, each in phases.items()
        if each.hits is not None and each.hits.upper_95 is not None
    }


def _hazard_of_hits(phase: Reliability) -> Hazard:
    """The expected impacts of a phase with their interval; none where they are not counted."""
    if phase.hits is None or phase.hits_interval is None:
        return Hazard(0.0)
    value, (low, high) = phase.hits.value, phase.hits_interval
    return Hazard(value, value - low, high - value)


def joint_chance(
    chances: Mapping[str, Chance], steps: Sequence[Sequence[str]] = (),
    lags: Mapping[str, float] | None = None,
) -> Chance:  # fmt: skip
    """The probability that an event comes in any of several independent phases, see `joined`."""
    each = list(chances.values())
    parts = {
        name: Hazard.of(one.estimate.value, one.lower, one.upper, bounded=one.way == BOUND)
        for name, one in chances.items()
    }
    whole = joined(parts, steps, lags)
    hazard, (chance, lower, above) = whole.value, whole.chances
    kept = np.exp([one.value - hazard for one in parts.values()])  # no other phase brings the event
    estimate = combined(chance, kept, [one.estimate for one in each], how=TOGETHER)
    if estimate.bias is not None:
        estimate = replace(estimate, bias=estimate.bias + whole.bias * math.exp(-hazard))
    worst = max(parts, key=lambda name: parts[name].value)
    return Chance(
        event=each[0].event, limit=each[0].limit, confidence=min(one.confidence for one in each),
        estimate=replace(estimate, upper_95=None if estimate.value else above),
        lower=lower, upper=above, way="phases",
        rule="square roots of sums of squares of the half widths of the hazards of the phases",
        why=f"phase {worst} has {100.0 * parts[worst].value / hazard:.3g} % of the risk"
        if hazard > 0.0
        else "the event was seen in no phase",
        **_work(each),
    )  # fmt: skip


def _work(chances: Sequence[Chance]) -> dict[str, Any]:
    """The work that probabilities took together."""
    names = ("trials", "steps", "seconds")
    return {name: sum(getattr(one, name) for one in chances) for name in names}


# ------------------------------------------------------------------------------
# The risk of a mission under noise of varying level, from the risks at steady levels.
#
# Conditioned on its level the noise is Gaussian. At some levels the risk is that of Gaussian noise,
# in the correlation time of the level, or in the mission where that is shorter. Its hazard -ln(1 -
# P) over that of Rice's crossings changes slowly with the level: its logarithm is interpolated.
# `RandomLevel.probability` follows the hazard along the level as it varies.
#
# The motion is taken to follow the level at once. What it feels is less, as it averages the level
# over its memory (`RandomLevel.felt`): what this changes is stated as a bias.
# ------------------------------------------------------------------------------


TRIED = 7
"""Number of levels at which the risk is simulated."""

LEFT_OUT = 1e-3
"""Share of Rice's crossings below the lowest of these levels, and above the highest one."""

LEAST_FELT = 0.8
"""Least share of the excess kurtosis of the noise that the motion must feel."""

FOLLOWED = (
    "at each level the motion is that of Gaussian noise, and follows the level at once; what it "
    "feels less is the bias"
)


@dataclass(frozen=True)
class LevelHazard:
    """The hazard of an event while the level varies, from its rates at levels that were tried.

    Parameters
    ----------
    level, felt
        How the level varies, and the level that the motion feels.
    mission, duration
        Seconds that are asked about, and seconds for which each level was tried.
    expected
        Rates of Rice's crossings at gains of the noise, 1/s.
    tried
        Values of the normal process of the level at which the event is known, increasing.
    """

    level: RandomLevel
    felt: RandomLevel
    mission: float
    duration: float
    expected: Callable[[Vector], Vector]
    tried: Vector

    @cached_property
    def _rice(self) -> Vector:
        """Rates of Rice's crossings at the levels that were tried, 1/s."""
        return self.expected(self.level.gain(self.tried))

    def rates(self, known: Vector, level: RandomLevel) -> Vector:
        """Rates at the gains of a level, 1/s, from those at the levels that were tried."""
        normal = np.log(level.gains) / self.level.spread + self.level.spread
        inside = np.clip(normal, self.tried[0], self.tried[-1])
        logarithms = np.log(np.maximum(known, np.finfo(float).tiny) / self._rice)
        ratio = scipy.interpolate.PchipInterpolator(self.tried, logarithms)(inside)
        return np.asarray(self.expected(level.gains) * np.exp(ratio))

    def probability(self, known: Vector, level: RandomLevel) -> float:
        """The probability of the event in the mission."""
        return level.probability(self.rates(known, level), self.mission)

    def number(self, known: Vector, level: RandomLevel) -> float:
        """The expected number of events in the mission."""
        return self.mission * level.mean(self.rates(known, level))

    def changes(self, of: OfRates, known: Vector, others: Vector) -> Vector:
        """What a number of the mission changes by, with another rate at one of the levels."""
        rows = np.where(np.eye(len(known), dtype=bool), others, known)
        return np.array([of(row, self.level) for row in rows]) - of(known, self.level)

    def estimate(
        self, of: OfRates, known: Vector, errors: Vector, biases: Vector | None, how: str
    ) -> Estimate:
        """A number of the mission, with its errors from rates that are off by an error, and by a
        bias."""
        value, bias = of(known, self.level), None
        if biases is not None:
            at_once = abs(of(known, self.felt) - value)
            bias = float(np.abs(self.changes(of, known, biases)).sum()) + at_once
        error = float(np.linalg.norm(self.changes(of, known, errors)))
        return Estimate(value=value, standard_error=error, bias=bias, how=how)

    def chance(self, chances: Sequence[Chance]) -> Chance:
        """The probability of an event from those at the levels that were tried."""

        def rates(values: Any) -> Vector:
            return np.asarray(-np.log1p(-np.clip(values, 0.0, CERTAIN)) / self.duration)

        found = [one.estimate for one in chances]
        known, low, high = map(
            rates, np.transpose([(one.estimate.value, one.lower, one.upper) for one in chances])
        )
        # where hardly a motion survives, its hazard is as uncertain upwards as downwards
        high = np.minimum(high, known * (known / np.maximum(low, np.finfo(float).tiny)))
        estimate = self.estimate(
            self.probability, known,
            # to the side on which the hazard stays finite
            rates([one.value - one.standard_error for one in found]),
            None if any(one.bias is None for one in found)
            else rates([one.value + (one.bias or 0.0) for one in found]),
            "from the risks at steady levels",
        )  # fmt: skip
        below, above = (
            float(np.linalg.norm(self.changes(self.probability, known, end))) for end in (low, high)
        )
        return replace(
            chances[0], estimate=estimate, lower=max(estimate.value - below, 0.0),
            upper=min(estimate.value + above, 1.0), wilson=None,
            rule="square root of the sum of squares of what the intervals at the levels change",
            way="levels", why=self._where(known), levels=0, seconds_per_mission=None,
            **_work(chances),
        )  # fmt: skip

    def _where(self, known: Vector) -> str:
        """A sentence on the levels at which the event comes."""
        level = self.level
        held = np.minimum(self.rates(known, level), 1.0 / self.duration)
        shares = np.cumsum(level.weights * held)
        ends = np.interp([0.25, 0.75], shares / shares[-1], level.normals)
        low, high = 20.0 * np.log10(level.gain(ends))
        return f"half of the risk comes at levels from {low:+.1f} to {high:+.1f} dB"

    def hits(self, found: Sequence[Estimate]) -> Estimate:
        """The expected number of events from those at the levels that were tried."""
        values, errors = np.array([(one.value, one.standard_error) for one in found]).T
        biases = [one.bias for one in found]
        most = None if None in biases else (values + np.array(biases, float)) / self.duration
        return self.estimate(
            self.number, values / self.duration, (values + errors) / self.duration, most,
            "from the expected impacts at steady levels",
        )  # fmt: skip


OfRates = Callable[[Vector, RandomLevel], float]
"""A number of a mission, from rates at the levels that were tried and how the level varies."""


def felt_by(model: Model) -> RandomLevel:
    """The level that the slowest mode of a model feels.

    Raises `NotApplicable` where it feels hardly anything of it.
    """
    level = model.level
    assert level is not None
    slowest = float(np.min(np.diag(model.modal.damping)))
    if slowest > 0.0:
        felt = level.felt(slowest)
        if felt.kurtosis - 3.0 >= LEAST_FELT * (level.kurtosis - 3.0):
            return felt
    memory = 1.0 / slowest if slowest > 0.0 else math.inf
    raise NotApplicable(
        "Gaussian motion at each level",
        f"level_time must be long beside the memory of the motion, {memory:.3g} s, got "
        f"{level.time:g} s; simulate follows it",
    )


def of_random_level(
    scene: Scene, mission: float, ask: Callable[[Scene, float, Run], Reliability], run: Run
) -> Reliability:
    """The probability of any impact, and expected impacts, under noise of varying level.

    Parameters
    ----------
    ask
        Finds the risk of a scene of steady level in a duration, by a part of the run.

    Raises
    ------
    NotApplicable
        If the level varies too fast for the motion to follow, or nothing can be hit.
    NotConverged, Interrupted
        If the risk at a level was not found as accurately as asked for.
    """
    model, level = model_of(scene), scene.random_level
    assert level is not None
    felt = felt_by(model)
    expected = _rice(scene)
    duration = min(mission, level.time)
    tried, names = _levels_to_try(level, expected, mission)
    found, missing = asked_in_parts(
        run, dict.fromkeys(names, duration),
        lambda name, part: ask(scene.at_steady_level(names[name]), duration, part),
    )  # fmt: skip
    asked = LevelHazard(level, felt, mission, duration, expected, tried)
    answer = _levels_together(scene, asked, found, missing, run)
    return complete(answer, missing, run, of="risk of every level", where="at a level of")


def _rice(scene: Scene) -> Callable[[Vector], Vector]:
    """Rice's rates of crossings of all stops, 1/s, at gains of the noise."""
    steady = model_of(scene.at_steady_level(0.0))
    crossings = crossings_of(steady)
    return lambda gains: np.array([crossings(float(gain))[0] for gain in gains])


def _levels_to_try(
    level: RandomLevel, expected: Callable[[Vector], Vector], mission: float
) -> tuple[Vector, dict[str, float]]:
    """Values of the normal process between which nearly all first crossings come, and their levels
    in dB, by the words that name them."""
    hazard = np.minimum(expected(level.gains), 1.0 / min(level.time, mission))
    shares = np.cumsum(level.weights * hazard)
    if not shares[-1] > 0.0:
        raise NotApplicable("reliability", "stops must be near enough to be crossed at any level")
    low, high = np.interp([LEFT_OUT, 1.0 - LEFT_OUT], shares / shares[-1], level.normals)
    tried = np.linspace(low, high, TRIED)
    decibels = 20.0 * np.log10(level.gain(tried))
    return tried, {f"{each:+.1f} dB": float(each) for each in decibels}


def _levels_together(
    scene: Scene, asked: LevelHazard, found: Mapping[str, Reliability], missing: dict[str, str],
    run: Run,
) -> Reliability:  # fmt: skip
    levels, own = list(found.values()), scene.assumptions()
    first, hits = levels[0], [each.hits for each in levels if each.hits is not None]
    number = asked.hits(hits) if len(hits) == len(levels) else None
    return replace(
        first, mission=asked.mission, missing=missing, pairs={}, gaps={}, hits=number,
        hits_interval=None if number is None else number.interval(first.confidence),
        chances={
            event: asked.chance([each.chances[event] for each in levels])
            for event in first.chances
            if all(event in each.chances for each in levels)
        },
        assumptions=[*own, FOLLOWED, *(each for each in first.assumptions if each not in own)],
        warnings=[one for one in first.warnings if all(one in each.warnings for each in levels)],
        **said_of_parts(scene, found, run, "steps", "paths"),
    )  # fmt: skip
