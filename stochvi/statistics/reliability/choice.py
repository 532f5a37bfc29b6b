"""Ways to the probability of a mission. Chapters: a pilot chooses crude simulation or splitting,
and a second stage answers; first crossings and clusters; missions of the motion without stops."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix
from stochvi.methods.monte_carlo import PILOT_SEED
from stochvi.model.model import Model, model_of
from stochvi.motion.choose_plan import HistoryPlan, plan_histories
from stochvi.motion.missions import (
    PARTICLES,
    SHARE,
    Counted,
    Levels,
    MissionPlan,
    Sample,
    crude,
    crude_block,
    of_missions,
    of_repetitions,
    pilot_levels,
    repetition,
)
from stochvi.results.deadline import NEVER, Deadline, partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import (
    Estimate,
    binomial_interval,
    logarithmic_interval,
    of_events,
    student_factor,
    upper_limit_unseen,
)
from stochvi.sampling.calculations import ListSampler, TrialSampler
from stochvi.sampling.run import Run
from stochvi.scenes.scene import Scene
from stochvi.statistics.clusters import ImpactCounts, count_impacts
from stochvi.statistics.crossings import first_crossings, own_distances
from stochvi.statistics.free_flights import linearised, windows_of
from stochvi.statistics.hardness import Limit
from stochvi.statistics.rare_hits import Windows, overlap_of, rare_hits
from stochvi.statistics.rare_hits import exceedance as exceedance_of_pairs
from stochvi.statistics.reliability.missions import Chance, GapRisk, PairRisk
from stochvi.statistics.trial_splitting import Question, RareHits

Way = Literal["crude", "splitting", "first crossings"]


class Hits(NamedTuple):
    """Expected impacts in a mission, their interval, and the number of time steps simulated (0 if
    not counted)."""

    estimate: Estimate
    interval: tuple[float, float]
    steps: int = 0


@dataclass
class Findings:
    """What was found of the mission of a scene: probabilities by event, expected impacts, why
    something is missing, what each pair, each of many gaps and each output risks; notes and
    warnings in sentences."""

    chances: dict[str, Chance] = field(default_factory=dict)
    hits: Hits | None = None
    missing: dict[str, str] = field(default_factory=dict)
    pairs: dict[str, PairRisk] = field(default_factory=dict)
    outputs: dict[str, Estimate] = field(default_factory=dict)
    gaps: dict[str, GapRisk] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


LOG = logging.getLogger(__name__)
"""Tells which way was chosen, and why."""

PILOT_MISSIONS = 4096
"""Largest number of missions in a pilot of crude simulation."""

PILOT_FEWEST = 256
"""Number of missions in that pilot where missions are long."""

PILOT_STEPS = 2.0**27
"""Number of time steps of all pilot missions together: a second or two."""

ENOUGH_FAILURES = 20
"""Number of failures in the pilot from which it gives the probability within some 20 %."""

PILOT_REPETITIONS = 8
"""Number of repetitions in a pilot of splitting: they give the spread within some 25 %."""

FEWEST_REPETITIONS = 20
"""Smallest number of repetitions of a splitting in an answer: Student's quantile is then 2.09."""

LARGEST_SPREAD = 0.5
"""Largest relative standard deviation of a repetition. Where it is larger, each repetition gets
more paths, so that no single repetition decides, and the mean of 20 is close to normal."""

MOST_PARTICLES = 2**16
"""Largest number of paths in a stage of a splitting."""

MARGIN = 1.3
"""Factor on the size of a sample for which the pilot asks, as its estimate of the spread may be
low."""

MISSED = 1.3
"""Ratio of the error reached to the error asked for, above which more is sampled."""

MOST_GROWTH = 4.0
"""Largest factor by which a sample grows at once."""

COARSE_SHARE = 0.25
"""Share of the trials that are simulated again at twice the step, for the bias."""

KEPT = 0.1
"""Share of the time left that every calculation keeps for those after it."""

PURPOSES = ("pilot missions", "levels", "pilot repetitions", "answer", "twice the step")
"""Uses of a seed that share no random number."""

OF_THE_ANSWER = PURPOSES[3:]
"""Uses of the seed of the answer; the pilot has its own, so that the luck of a seed does not decide
between the ways, nor the levels of a splitting."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """The result of a second stage, with the way in which it was found: at the step and, if there
    was time, at twice the step.

    `price` are the CPU seconds of one crude mission, `steps` the time steps and `seconds` the CPU
    seconds of pilot and second stage together.
    """

    fine: Sample
    coarse: Sample | None
    way: str
    why: str
    levels: int
    price: float
    steps: int
    seconds: float


@dataclass(frozen=True, eq=False)
class PlanSampler(TrialSampler):
    """Trials of a plan of missions."""

    plan: MissionPlan
    seed: int


@dataclass(frozen=True, eq=False)
class MissionSampler(PlanSampler):
    """Crude missions."""

    hits: bool

    @property
    def block(self) -> int:
        """Number of missions in a block."""
        return crude_block(self.plan)

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> Any:
        """Some crude missions."""
        return crude(self.plan, self.seed, self.hits, first_path, paths, deadline)


@dataclass(frozen=True, eq=False)
class HitSampler(PlanSampler):
    """Repetitions of a splitting with fixed levels."""

    levels: tuple[float, ...]
    hits: bool
    particles: int

    @property
    def block(self) -> int:
        """Number of paths in a stage of a repetition."""
        return self.particles

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> Any:
        """One repetition."""
        return repetition(self.plan, self.levels, self.seed, self.hits, first_path, paths, deadline)


@dataclass(frozen=True, eq=False)
class LevelSampler(PlanSampler):
    """The levels of a splitting, from one pilot."""

    particles: int

    @property
    def block(self) -> int:
        """Number of paths in a stage of the pilot."""
        return self.particles

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> Any:
        """The levels."""
        return pilot_levels(self.plan, self.seed, first_path, paths, deadline)


@dataclass(kw_only=True)
class Jobs:
    """The settings with which probabilities are found: the run with its seed and accuracy, and
    budget.

    `until` is the deadline of the present calculation; `cut_short` says what it left undone.
    """

    run: Run
    confidence: float
    deadline: Deadline
    until: Deadline = NEVER
    cut_short: list[str] = field(default_factory=list)

    @property
    def part(self) -> Run:
        """The run of another calculation for the same answer, in the time that is left."""
        return self.run.part(deadline=self.deadline.sooner(KEPT))

    def sharing(self, others: int) -> Jobs:
        """The settings of a calculation that leaves to so many `others` as much time as it has. The
        cheap ones come first: what they leave is for the others."""
        return replace(self, deadline=self.deadline.sooner(others / (others + 1.0)))

    @property
    def sampling(self) -> dict[str, Any]:
        """The options of that calculation, with the accuracy that is asked for."""
        return self.part.options(rel_error=self.rel_error)

    @property
    def rel_error(self) -> float:
        """The relative error that is asked for."""
        return self.run.accuracy

    def chance(self, plan: MissionPlan, event: str, limit: float | None, way: Way | None) -> Chance:
        """The probability of the event in a mission of the plan."""
        found = self._found(plan, event, way, hits=False)
        fine, coarse = found.fine, found.coarse
        interval = fine.interval(self.confidence)
        wilson = None
        if isinstance(fine, Counted):
            ends = fine.wilson(self.confidence)
            wilson = ends.lower, ends.upper
        estimate = Estimate(
            value=fine.chance,
            standard_error=fine.error,
            bias=None if coarse is None else _bias(plan, fine.chance, coarse.chance),
            how=f"{interval.rule}; {_source(coarse)}",
            upper_95=interval.upper if fine.chance == 0.0 else None,
        )
        lower, upper = interval.lower, interval.upper
        if not isinstance(fine, Counted):  # whose interval is exact, however few there are
            estimate = of_events(estimate, fine.trials)
        if estimate.upper_95 is not None:
            lower, upper = 0.0, min(estimate.upper_95, 1.0)
            estimate = replace(estimate, upper_95=upper)
        return Chance(
            event=event,
            limit=limit,
            estimate=estimate,
            lower=lower,
            upper=upper,
            confidence=self.confidence,
            rule=interval.rule,
            wilson=wilson,
            way=found.way,
            why=found.why,
            trials=fine.trials,
            levels=found.levels,
            steps=found.steps,
            seconds=found.seconds,
            seconds_per_mission=found.price,
        )

    def hits(self, plan: MissionPlan, way: Way | None, missions: float = 1.0) -> Hits:
        """Expected impacts in so many missions of the plan, and their interval."""
        found = self._found(plan, "expected impacts", way, hits=True)
        fine = found.fine
        estimate = of_events(
            Estimate(
                value=fine.hits,
                standard_error=fine.hits_error,
                bias=None if found.coarse is None else _bias(plan, fine.hits, found.coarse.hits),
                how=f"{found.way}, {fine.trials} {_trials(found.way)}; {_source(found.coarse)}",
            ),
            fine.trials,
        )
        if estimate.value == 0.0 and estimate.upper_95 is None:
            stops = len(plan.base.model.stops)
            most = stops * plan.base.hits_in_a_cluster * upper_limit_unseen(fine.missions)
            estimate = replace(estimate, bias=None, upper_95=most)
        estimate = estimate * missions
        return Hits(estimate, self.interval(estimate, fine.trials), found.steps)

    def interval(self, estimate: Estimate, samples: int) -> tuple[float, float]:
        """Confidence interval of expected impacts with their bias, as far as it is known; from 0
        where an upper limit alone is known."""
        if estimate.upper_95 is not None:
            return 0.0, estimate.upper_95
        # the standard error is Student's already where samples are few (`of_events`)
        error = estimate.standard_error / student_factor(samples)
        return logarithmic_interval(
            estimate.value, error, samples - 1, self.confidence, estimate.bias or 0.0
        )

    def _found(self, plan: MissionPlan, event: str, way: Way | None, hits: bool) -> Found:
        """Run the pilot, choose a way, and run the second stage."""
        plan.base.shortest().averages(0, 0, 2)  # compiled, or taken from the cache
        self.until = self.deadline.sooner(KEPT)
        tried = int(min(max(PILOT_STEPS // plan.steps_per_path, PILOT_FEWEST), PILOT_MISSIONS))
        pilot = self._missions(plan, "pilot missions", tried, hits)
        price, steps = pilot.seconds / pilot.missions, pilot.steps
        spent = pilot.seconds
        levels: Levels | None = None
        repeated: Sample | None = None
        particles = PARTICLES
        if way != "crude" and (way == "splitting" or pilot.chance < SHARE):
            sampler = LevelSampler(plan, self._seed("levels"), particles)
            (levels,) = self._all(sampler, particles)
            steps, spent = steps + levels.steps, spent + levels.seconds
            while True:
                repeated = self._repeated(
                    plan, levels, "pilot repetitions", PILOT_REPETITIONS, particles, hits
                )
                steps, spent = steps + repeated.steps, spent + repeated.seconds
                spread = math.sqrt(_variance(repeated, hits))
                if spread <= LARGEST_SPREAD or particles >= MOST_PARTICLES:
                    break
                particles = min(4 * particles, MOST_PARTICLES)
        missions = self._missions_needed(pilot, repeated, hits)
        repetitions = 0
        if repeated is not None:
            wanted = MARGIN * _variance(repeated, hits) / self.rel_error**2
            repetitions = max(FEWEST_REPETITIONS, math.ceil(wanted))
        chosen, why = self._choice(pilot, repeated, missions, repetitions, way)
        LOG.debug("%s: %s", event.replace("_", " "), why)
        if chosen == "splitting":
            assert levels is not None
            at, count = levels, PILOT_REPETITIONS
            fine, asked = self._enough(
                lambda trials: self._repeated(plan, at, "answer", trials, particles, hits, count),
                repetitions,
                hits,
            )
            less = max(count, math.ceil(COARSE_SHARE * fine.trials))
            coarse = self._if_in_time(
                lambda: self._repeated(plan.coarser(), at, "twice the step", less, particles, hits)
            )
        else:
            levels = None
            fine, asked = self._enough(
                lambda trials: self._missions(plan, "answer", trials, hits, 1), missions, hits
            )
            less = max(pilot.missions, math.ceil(COARSE_SHARE * fine.trials))
            coarse = self._if_in_time(
                lambda: self._missions(plan.coarser(), "twice the step", less, hits)
            )
        name = event.replace("_", " ")
        if fine.trials < asked:
            self.cut_short.append(f"the relative error of {name} was {self.rel_error:g}")
        if coarse is None:
            self.cut_short.append(f"the bias of {name} was known")
        return Found(
            fine=fine,
            coarse=coarse,
            way=chosen,
            why=why,
            levels=0 if levels is None else len(levels.levels),
            price=price,
            steps=steps + fine.steps + (coarse.steps if coarse else 0),
            seconds=spent + fine.seconds + (coarse.seconds if coarse else 0.0),
        )

    def _enough(
        self, sample: Callable[[int], Sample], trials: int, hits: bool
    ) -> tuple[Sample, int]:
        """A sample of so many trials, or of more where its error is larger than the pilot predicted
        and time is left; and the number of trials that it should have had."""
        found = sample(trials)
        while (
            found.trials >= trials
            and math.sqrt(_variance(found, hits) / found.trials) > MISSED * self.rel_error
            and (found.chance > 0.0 or self.deadline.budget is not None)  # it may never happen
        ):
            wanted = MARGIN * _variance(found, hits) / self.rel_error**2
            trials = math.ceil(min(wanted, MOST_GROWTH * found.trials))
            try:
                more = sample(trials)
            except (NotConverged, Interrupted):
                break
            found = more if more.trials > found.trials else found
        return found, trials

    def _if_in_time(self, calculate: Callable[[], Sample]) -> Sample | None:
        """A sample that the answer can do without; None if it is late, as a part of it would
        depend on the time."""
        try:
            return calculate()
        except (NotConverged, Interrupted):
            return None

    def _missions_needed(self, pilot: Counted, repeated: Sample | None, hits: bool) -> int:
        """Crude missions for the accuracy asked for, from the better guess of the probability."""
        if pilot.failed >= ENOUGH_FAILURES or repeated is None:
            # where no failure was seen, one is assumed
            variance = _variance(pilot, hits) if pilot.failed else float(pilot.missions)
        else:
            variance = (1.0 - repeated.chance) / max(repeated.chance, 1e-300)
        return max(pilot.missions, math.ceil(MARGIN * variance / self.rel_error**2))

    def _choice(
        self,
        pilot: Counted,
        repeated: Sample | None,
        missions: int,
        repetitions: int,
        way: Way | None,
    ) -> tuple[str, str]:
        """The way that is chosen, and a sentence on the reason."""
        seen = f"{pilot.failed} of {pilot.missions} pilot missions failed"
        if way is not None:
            return way, f"{way}, as asked for; {seen}"
        if repeated is None:
            return "crude", f"crude: {seen}, so that {missions:.2g} missions suffice"
        crude_steps = missions * pilot.steps / pilot.missions
        splitting_steps = repetitions * repeated.steps / repeated.trials
        compared = (
            f"{seen}; for a relative error of {self.rel_error:g} crude simulation takes "
            f"{missions:.2g} missions, {crude_steps:.2g} steps, splitting "
            f"{splitting_steps:.2g} steps"
        )
        chosen = "crude" if crude_steps <= splitting_steps else "splitting"
        return chosen, f"{chosen}: {compared}"

    def _missions(
        self, plan: MissionPlan, purpose: str, missions: int, hits: bool, enough: float = math.inf
    ) -> Counted:
        sampler = MissionSampler(plan, self._seed(purpose), hits)
        return of_missions(self._all(sampler, missions, enough))

    def _repeated(
        self, plan: MissionPlan, levels: Levels, purpose: str, count: int, particles: int,
        hits: bool, enough: float = math.inf,
    ) -> Sample:  # fmt: skip
        sampler = HitSampler(plan, self._seed(purpose), levels.levels, hits, particles)
        return of_repetitions(self._all(sampler, count * particles, enough))

    def _all(self, sampler: TrialSampler, paths: int, enough: float = math.inf) -> list[Any]:
        """The trials of so many paths, in their order; when time is up, the first ones if they are
        `enough` blocks."""
        blocks = math.ceil(paths / sampler.block)

        def tell(done: list[Any]) -> tuple[float, str]:
            return len(done) / blocks, f"{len(done)} of {blocks} parts"

        done: list[Any] = []
        try:
            done = self.run.until(sampler, paths, deadline=self.until, needed=0, tell=tell).sample
        except NotConverged:
            if not self.until.passed():
                raise
        if len(done) < min(blocks, enough):
            raise self.deadline.fell_short(
                f"after {len(done)} of {blocks} parts of a stage", "raise budget or rel_error"
            )
        return done

    def _seed(self, purpose: str) -> int:
        seed = self.run.seed if purpose in OF_THE_ANSWER else PILOT_SEED
        sequence = np.random.SeedSequence([seed, PURPOSES.index(purpose)])
        return int(sequence.generate_state(1, np.uint64)[0] >> np.uint64(1))


def _variance(sample: Sample, hits: bool) -> float:
    """Relative variance of one trial; infinite where nothing was seen."""
    value, error = (sample.hits, sample.hits_error) if hits else (sample.chance, sample.error)
    return sample.trials * (error / value) ** 2 if value > 0.0 else math.inf


def _bias(plan: MissionPlan, fine: float, coarse: float) -> float | None:
    """Bias of the step, taken as that of a sum of impact speeds (`plan.extrapolated`)."""
    return plan.base.step_bias("impact_speed_rate", abs(coarse - fine))


def _source(coarse: Sample | None) -> str:
    return "bias of the step unknown" if coarse is None else "bias from twice the step"


def _trials(way: str) -> str:
    return "repetitions" if way == "splitting" else "missions"


# ------------------------------------------------------------------------------
# Probabilities from records that are conditioned on a crossing: first crossings of the motion
# without stops, and the clusters after them.
# ------------------------------------------------------------------------------


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
                "the static equilibrium must lie between the stops or barriers, got one that "
                f"is {max(-below, -above):.4g} m beyond; move them; for a mass that is pressed "
                "onto a stop, impacts counts the returns",
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
    why = {
        "bursts": "clusters: records hold a first impact of any pair, a fast one more often; the "
        "motion after it is simulated with all stops",
        "windows": "windows: clusters follow without a pause here; windows of the whole motion are "
        "simulated with all stops",
    }[found.way]
    chance = _by_jackknife(
        limit.event, estimate, found.degrees + 1, jobs, started, limit=limit.value, way=found.way,
        why=why, trials=found.trials,
    )  # fmt: skip
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


FIRST_CROSSINGS: Way = "first crossings"
"""The way of a probability from records that are conditioned on a crossing."""


def _from_crossings(
    event: str, estimate: Estimate, paths: int, jobs: Jobs, started: float
) -> Chance:
    """The probability of a first impact, which first crossings found since CPU second `started`."""
    why = (
        "first crossings: before the first impact the motion is stationary and Gaussian; records "
        "hold a crossing, however rare, and none is waited for"
    )
    estimate = of_events(estimate, paths)
    found = _by_jackknife(event, estimate, paths, jobs, started, way=FIRST_CROSSINGS, why=why)
    never = not estimate.value and estimate.upper_95 is None
    return replace(found, upper=SMALLEST) if never else found


def _by_jackknife(
    event: str, estimate: Estimate, paths: int, jobs: Jobs, started: float, **said: Any
) -> Chance:
    """A probability from independent paths since CPU second `started`, with the interval of its
    logarithm; from 0 where an upper limit alone is known."""
    error, most = estimate.standard_error, estimate.upper_95
    rule = f"Student's, of the logarithm, from a jackknife over {paths} paths"
    lower, upper = logarithmic_interval(estimate.value, error, paths - 1, jobs.confidence)
    if most is not None:
        lower, upper, rule = 0.0, most, f"upper limit: {estimate.how}"
        estimate = replace(estimate, upper_95=min(most, 1.0))
    return Chance(
        event=event, estimate=estimate, lower=lower, upper=min(upper, 1.0), rule=rule,
        confidence=jobs.confidence, seconds=time.process_time() - started,
        **{"limit": None, "trials": paths} | said,
    )  # fmt: skip


def by_conditioning(
    scene: Scene, ends: Ends, limits: list[Limit], mission: float, jobs: Jobs
) -> Findings:
    """Probabilities and expected impacts from a stationary start under noise with a memory of its
    own."""
    chance = first_hit(scene, ends, mission, jobs, surely=True)
    assert chance is not None
    found = Findings(chances={chance.event: chance})
    if not scene.impact_pairs:
        if limits:
            raise NotApplicable(
                "reliability", "impacts need a stop, got a scene without impact_pair"
            )
        return found
    try:
        found.hits = _hits(scene, mission, jobs.sharing(len(limits)))
    except (NotConverged, Interrupted) as error:
        found.missing["expected_hits"] = str(error)
    for done, limit in enumerate(limits):
        some = jobs.sharing(len(limits) - done - 1)
        try:
            found.chances[limit.event] = exceedance(scene, limit, mission, some)
        except (NotConverged, Interrupted) as error:
            found.missing[limit.event] = str(error)
    return found


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


def first_hit_in_pieces(scene: Scene, pair: str | None, mission: float, jobs: Jobs) -> Chance:
    """P(any impact), or P(an impact on one pair), under noise with fast peaks, or on springs and
    dampers that are functions."""
    model, started = model_of(scene), time.process_time()
    below, above = own_distances(linearised(model))
    if pair is not None:
        others = np.array([each.name != pair for each in model.pairs])
        below, above = (np.where(others, math.inf, each) for each in (below, above))
    pieces = windows_of(model, below.tolist(), above.tolist(), mission, jobs.run.seed)
    found = Question(1.0, mission, jobs.confidence, jobs.part).answer(pieces)
    assert found is not None  # pieces always end
    moved = "the steps of simulate follow it" if model.functions else (
        "noise with fast peaks moves it as it comes"
    )  # fmt: skip
    why = f"pieces of the motion: {moved}, and a splitting finds the pieces that reach a stop"
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


# ------------------------------------------------------------------------------
# The probability of a first impact by counting missions of the motion without stops.
# ------------------------------------------------------------------------------


SAMPLES_PER_PERIOD = 24.0
"""Samples in a period of the fastest motion: a peak between two of them may be 0.9 % higher, and is
found by a parabola."""

FEWEST_MISSIONS = 64
"""Smallest number of missions that are counted."""

MOST_SAMPLES = 2**20
"""Largest number of samples of a mission."""


@dataclass(frozen=True, eq=False)
class MissionsWithoutStops(ListSampler):
    """Missions without stops, and whether any gap of the pairs of `model` closes in them."""

    plan: HistoryPlan
    model: Model
    kept: tuple[str, ...]
    seed: int

    @property
    def block(self) -> int:
        """Number of missions that are made together."""
        return self.plan.block

    def simulate(self, first_path: int, paths: int) -> NDArray[np.bool_]:
        """Whether each mission is hit by its samples, and by every second of them (2, paths)."""
        moved = self.plan.histories(self.seed, first_path, paths).displacement
        hit = np.zeros((2, paths), bool)
        for pair in self.model.pairs:
            if pair.name in self.kept:
                gap = np.tensordot(pair.direction, moved, axes=1)
                for stop in pair.stops:
                    for row, stride in enumerate((1, 2)):
                        reached = highest(stop.side * gap[:, ::stride])
                        hit[row] |= reached > stop.side * stop.position
        return hit

    def add_up(self, pieces: list[NDArray[np.bool_]]) -> list[NDArray[np.bool_]]:
        """The pieces."""
        return pieces

    def paths(self, sample: list[NDArray[np.bool_]]) -> int:
        """Number of missions."""
        return sum(each.shape[1] for each in sample)


def highest(records: Matrix) -> NDArray[np.float64]:
    """Highest point of each record (paths, samples), by parabolas through its highest samples."""
    before, at, after = records[:, :-2], records[:, 1:-1], records[:, 2:]
    bend = np.maximum(2.0 * at - before - after, np.finfo(float).tiny)
    peak = np.where(
        (at >= before) & (at >= after), at + (after - before) ** 2 / (8.0 * bend), -np.inf
    )
    ends = np.maximum(records[:, 0], records[:, -1])
    return np.asarray(np.maximum(peak.max(axis=1, initial=-np.inf), ends))


def counted_hits(
    scene: Scene, model: Model, pairs: Sequence[str], mission: float, jobs: Jobs
) -> Chance:
    """P(any of the pairs is hit) in the stationary motion, by missions that are simulated."""
    started = time.process_time()
    plan = plan_histories(scene.replace(impact_pairs=()), jobs.deadline)
    step = 2.0 * math.pi / (SAMPLES_PER_PERIOD * plan.fastest)
    if mission / step > MOST_SAMPLES:
        raise NotApplicable(
            "reliability",
            f"shocks that meet are counted in whole missions of at most {MOST_SAMPLES} "
            f"samples, got {mission / step:.3g}; ask for a mission of at most "
            f"{MOST_SAMPLES * step:.3g} s",
        )
    sampler = MissionsWithoutStops(
        plan.sampled(min(step, plan.step), mission), model, tuple(pairs), jobs.run.seed
    )
    plan.plan.shortest().histories(jobs.run.seed, 0, 2, samples=2)  # compiled, off the clock

    def counts(sample: list[NDArray[np.bool_]]) -> tuple[int, int, int]:
        both = np.concatenate(sample, axis=1)
        return both.shape[1], int(both[0].sum()), int(both[1].sum())

    def error(sample: list[NDArray[np.bool_]]) -> float:
        missions, hit, _ = counts(sample)
        return math.sqrt((1.0 - hit / missions) / hit) if hit else math.inf

    taken = jobs.run.to_accuracy(
        sampler, FEWEST_MISSIONS, error, jobs.rel_error, deadline=jobs.deadline, needed=2
    )
    missions, hit, seldom = counts(taken.sample)
    share = hit / missions
    lower, upper = binomial_interval(hit, missions, jobs.confidence)
    spread = math.sqrt(max(share * (1.0 - share), 1.0 / missions) / missions)
    how = f"{missions} missions without stops"
    return Chance(
        event="hit", limit=None,
        estimate=Estimate(
            value=share, standard_error=spread if hit else 0.0,
            bias=abs(hit - seldom) / missions if hit else None,
            upper_95=None if hit else upper, how=how,
        ),
        lower=lower, upper=upper, confidence=jobs.confidence,
        rule="exact binomial interval (Clopper and Pearson)", way="missions",
        why="shocks meet: each acts while the motion after the one before it is remembered",
        trials=missions, seconds=time.process_time() - started,
    )  # fmt: skip
