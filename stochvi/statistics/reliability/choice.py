"""Crude simulation or splitting: a pilot chooses, a second stage answers."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from stochvi.methods.monte_carlo.missions import MissionPlan
from stochvi.methods.monte_carlo.simulation import PILOT_SEED
from stochvi.methods.monte_carlo.splitting import (
    PARTICLES,
    SHARE,
    Counted,
    Levels,
    Sample,
    crude,
    crude_block,
    of_missions,
    of_repetitions,
    pilot_levels,
    repetition,
)
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.intervals import logarithmic_interval, student_factor, upper_limit_unseen
from stochvi.sampling.run import Run
from stochvi.sampling.sampler import TrialSampler
from stochvi.statistics.reliability.answer import Chance

Way = Literal["crude", "splitting", "first crossings"]


class Hits(NamedTuple):
    """Expected impacts in a mission, their interval, and the number of time steps simulated (0 if
    not counted)."""

    estimate: Estimate
    interval: tuple[float, float]
    steps: int = 0


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
        plan.advance(plan.fleet(0, 0, 2), 0.0)  # compiled, or taken from the cache
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
    """Bias of the step, taken as that of a sum of impact speeds (`step_bias.extrapolated`)."""
    return plan.base.step_bias("impact_speed_rate", abs(coarse - fine))


def _source(coarse: Sample | None) -> str:
    return "bias of the step unknown" if coarse is None else "bias from twice the step"


def _trials(way: str) -> str:
    return "repetitions" if way == "splitting" else "missions"
