"""Rare events by splitting: paths that come close are copied, and count for less.

A mission that fails passes through states of higher and higher energy. With levels of energy
E_1 < ... < E_m and the event F,

    P(F) = P(E_1 reached) P(E_2 reached | E_1 reached) ... P(F | E_m reached),

and each factor, some 0.2, is a share of N paths that start where earlier ones reached the level
before: splitting with fixed effort (P. Glasserman, P. Heidelberger, P. Shahabuddin and T. Zajic,
Oper. Res. 47 (1999) 585; M. Garvels, thesis, Twente 2000). Each survivor is copied as often as any
other, once more or less by lot, so that the product is unbiased for levels fixed beforehand; paths
with common ancestors are not independent, so that the error comes from independent repetitions of
the whole. The energy is the right measure of closeness for light damping: a vibration forgets its
phase in a period, its energy in many.

Levels are the quantiles of the largest energies of a pilot (adaptive multilevel splitting: F.
Cerou and A. Guyader, Stoch. Anal. Appl. 25 (2007) 417), whose own biased result is not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.methods.monte_carlo.missions import NO_EVENT, Fleet, MissionPlan
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotConverged
from stochvi.results.intervals import binomial_interval, logarithmic_interval, mean_and_error
from stochvi.results.machine import thread_seconds
from stochvi.sampling.blocks import LANES
from stochvi.sampling.stop_flag import GivenUp, given_up_after

SHARE = 0.2
"""Share p of the paths that should reach the next level. The work at a given error is proportional
to (1 - p) / (p log(p)^2), which is flat about its minimum near there."""

PARTICLES = 1024
"""Number of paths in each stage of a repetition."""

MOST_LEVELS = 64
"""Largest number of levels: probabilities below 0.2^64 = 2e-45 are not sought."""

BLOCK_STEPS = 2.0**23
"""Number of steps of all crude missions in one task, which take about 0.1 s."""


class Trial(NamedTuple):
    """One repetition of a splitting, or one block of crude missions.

    `chance` estimates P of the event, and `hits` the expected number of impacts, without bias.
    """

    missions: int
    chance: float
    hits: float
    hits_square: float
    steps: int
    seconds: float


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A confidence interval at `confidence`, and the name of the rule that gave it."""

    lower: float
    upper: float
    confidence: float
    rule: str


def crude(
    plan: MissionPlan,
    seed: int,
    hits: bool,
    first_path: int,
    missions: int,
    deadline: Deadline = NEVER,
) -> Trial:
    """Estimate by independent missions of equal weight (crude Monte Carlo).

    After a deadline all of them are given up (`GivenUp`), never a part of them, since those that
    have failed by then would be over-represented.
    """
    started = thread_seconds()
    with given_up_after(deadline):
        fleet = plan.fleet(seed, first_path, missions)
        steps = plan.settled * missions + plan.advance(fleet, math.inf)
        happened = fleet.happened
        numbers = np.zeros(1)
        if hits:
            numbers, more = _hits_of(plan, fleet)
            steps += more
    return Trial(
        missions=missions,
        chance=float(happened.mean()),
        hits=float(numbers.sum() / missions),
        hits_square=float(np.sum(numbers**2) / missions),
        steps=steps,
        seconds=thread_seconds() - started,
    )


def crude_block(plan: MissionPlan) -> int:
    """Number of missions in one task."""
    return int(min(max(BLOCK_STEPS // plan.steps_per_path, LANES), 2**16))


def repetition(
    plan: MissionPlan,
    levels: tuple[float, ...],
    seed: int,
    hits: bool,
    first_path: int,
    particles: int,
    deadline: Deadline = NEVER,
) -> Trial:
    """One splitting with fixed levels and `particles` paths in each stage.

    Raises `GivenUp` if the deadline passes before it ends.
    """
    with given_up_after(deadline):
        return _repetition(plan, levels, seed, hits, first_path, particles, deadline)


def _repetition(
    plan: MissionPlan, levels: tuple[float, ...], seed: int, hits: bool, first_path: int,
    particles: int, deadline: Deadline,
) -> Trial:  # fmt: skip
    started, index = thread_seconds(), first_path // particles
    fleet = plan.fleet(seed, _first_path(index, 0, particles), particles)
    random = np.random.default_rng([seed, index])
    chance, steps = 1.0, plan.settled * particles
    for stage, level in enumerate((*levels, math.inf)):
        if deadline.passed():
            raise GivenUp
        steps += plan.advance(fleet, level)
        reached = np.flatnonzero(fleet.top >= level)
        chance *= len(reached) / particles
        if chance == 0.0 or level == math.inf:
            break
        fleet = copies(fleet, reached, random, seed, _first_path(index, stage + 1, particles))
    number = 0.0
    if hits and chance > 0.0:
        numbers, more = _hits_of(plan, fleet)
        number, steps = float(numbers.mean()), steps + more
    return Trial(
        missions=particles,
        chance=chance,
        hits=chance * number,
        hits_square=0.0,
        steps=steps,
        seconds=thread_seconds() - started,
    )


def copies(
    fleet: Fleet, reached: NDArray[np.intp], random: np.random.Generator, seed: int, first_path: int
) -> Fleet:
    """The same number of paths, copied from those that reached the level, each with a new
    stream."""
    paths, survivors = len(fleet.x), len(reached)
    extra = random.permutation(reached)[: paths % survivors]
    chosen = np.concatenate([np.repeat(reached, paths // survivors), extra])
    streams = np.empty((2, paths), np.uint64)
    seed_streams(np.uint64(seed), first_path, streams)
    # a path in which the event happened stops; its steps left are kept to count its impacts
    left = np.where(fleet.happened, -np.abs(fleet.left), fleet.left)
    return fleet._replace(left=left).chosen(chosen)._replace(streams=streams)


def _hits_of(plan: MissionPlan, fleet: Fleet) -> tuple[Vector, int]:
    """Number of impacts in the whole mission of each path in which the event happened, and the
    number of steps made."""
    chosen = fleet.happened
    rest = fleet.chosen(chosen)
    rest = rest._replace(left=np.abs(rest.left), hits=np.zeros(len(rest.x)))
    steps = plan.advance(rest, math.inf, NO_EVENT)
    return fleet.hits[chosen] + rest.hits, steps


def _first_path(index: int, stage: int, particles: int) -> int:
    return (index * (MOST_LEVELS + 1) + stage) * particles


class Levels(NamedTuple):
    """Levels of twice the energy, the probability that the pilot estimated, and its steps and CPU
    seconds."""

    levels: tuple[float, ...]
    chance: float
    steps: int
    seconds: float


def pilot_levels(
    plan: MissionPlan,
    seed: int,
    first_path: int = 0,
    particles: int = PARTICLES,
    deadline: Deadline = NEVER,
) -> Levels:
    """Levels that a share of about SHARE of the paths reach from the level before.

    Every stage is simulated twice: to its end, for the largest energies, and up to the level.
    Raises `GivenUp` if the deadline passes before it ends.
    """
    with given_up_after(deadline):
        return _pilot_levels(plan, seed, first_path, particles, deadline)


def _pilot_levels(
    plan: MissionPlan, seed: int, first_path: int, particles: int, deadline: Deadline
) -> Levels:
    started = thread_seconds()
    fleet = plan.fleet(seed, first_path, particles)
    random = np.random.default_rng(seed)
    levels: list[float] = []
    chance, steps = 1.0, plan.settled * particles
    while True:
        if deadline.passed():
            raise GivenUp
        again = fleet.chosen(np.arange(particles))
        steps += plan.advance(fleet, math.inf)
        happened = float(fleet.happened.mean())
        if happened >= SHARE:
            seconds = thread_seconds() - started
            return Levels(tuple(levels), chance * happened, steps, seconds)
        level = float(np.quantile(fleet.top, 1.0 - SHARE, method="lower"))
        last = levels[-1] if levels else 0.0
        if not level > last:  # most paths are copies of one, and none reached a higher energy
            level = float(np.min(fleet.top[fleet.top > last], initial=math.inf))
        if len(levels) == MOST_LEVELS or level == math.inf:
            raise NotConverged(
                f"splitting found no way to the event: {len(levels)} levels of energy were reached "
                f"with a chance of {chance:.2g}, and no higher one; the limit is out of reach, or "
                "the stops take so much energy in an impact that it is no guide: ask for less"
            )
        steps += plan.advance(again, level)
        reached = np.flatnonzero(again.top >= level)
        levels.append(level)
        chance *= len(reached) / particles
        fleet = copies(again, reached, random, seed, _first_path(0, len(levels), particles))


@dataclass(frozen=True, kw_only=True)
class Sample:
    """The estimate from all independent trials together.

    Parameters
    ----------
    chance, error
        Mean of the trials, and its standard error.
    hits, hits_error
        Mean number of impacts in a mission over the trials, and its standard error.
    missions
        Number of missions of all trials together.
    steps, seconds
        Number of steps of all trials together, and the CPU time they took, s.
    """

    trials: int
    missions: int
    chance: float
    error: float
    hits: float
    hits_error: float
    steps: int
    seconds: float

    @property
    def relative_error(self) -> float:
        """Standard error over value; infinite where nothing was seen."""
        return self.error / self.chance if self.chance > 0.0 else math.inf

    def interval(self, confidence: float) -> Interval:
        """Student's interval of the logarithm of the mean over repetitions."""
        lower, upper = logarithmic_interval(self.chance, self.error, self.trials - 1, confidence)
        rule = f"Student's, of the logarithm of the mean of {self.trials} repetitions"
        return Interval(lower=lower, upper=min(upper, 1.0), confidence=confidence, rule=rule)


def of_repetitions(trials: list[Trial]) -> Sample:
    """The mean over repetitions of a splitting, with errors from their scatter."""
    count = len(trials)
    chances, hits = np.array([[trial.chance, trial.hits] for trial in trials]).T
    (chance, error), (number, number_error) = mean_and_error(chances), mean_and_error(hits)
    return Sample(
        trials=count,
        missions=sum(trial.missions for trial in trials),
        chance=chance,
        error=error,
        hits=number,
        hits_error=number_error,
        steps=sum(trial.steps for trial in trials),
        seconds=sum(trial.seconds for trial in trials),
    )


@dataclass(frozen=True, kw_only=True)
class Counted(Sample):
    """The estimate from crude missions: the number of failures follows the binomial law."""

    @property
    def failed(self) -> int:
        """Number of missions in which the event happened."""
        return round(self.chance * self.missions)

    def interval(self, confidence: float) -> Interval:
        """Clopper and Pearson's interval, whose coverage is at least `confidence`."""
        return self._binomial("clopper-pearson", "Clopper and Pearson", confidence)

    def wilson(self, confidence: float) -> Interval:
        """Wilson's interval, whose coverage is about `confidence`."""
        return self._binomial("wilson", "Wilson", confidence)

    def _binomial(
        self, rule: Literal["clopper-pearson", "wilson"], name: str, confidence: float
    ) -> Interval:
        lower, upper = binomial_interval(self.failed, self.missions, confidence, rule)
        words = f"{name}, {self.failed} of {self.missions} missions"
        return Interval(lower=lower, upper=upper, confidence=confidence, rule=words)


def of_missions(trials: list[Trial]) -> Counted:
    """The estimate from blocks of crude missions, with errors from the binomial law."""
    missions = sum(trial.missions for trial in trials)
    chance = sum(trial.chance * trial.missions for trial in trials) / missions
    hits = sum(trial.hits * trial.missions for trial in trials) / missions
    square = sum(trial.hits_square * trial.missions for trial in trials) / missions
    return Counted(
        trials=missions,
        missions=missions,
        chance=chance,
        error=math.sqrt(chance * (1.0 - chance) / missions),
        hits=hits,
        hits_error=math.sqrt(max(square - hits**2, 0.0) / missions),
        steps=sum(trial.steps for trial in trials),
        seconds=sum(trial.seconds for trial in trials),
    )
