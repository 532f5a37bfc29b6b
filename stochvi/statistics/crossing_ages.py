"""The probability of a first impact and its rate, from the ages of outcrossings.

The age of an outcrossing of a stop is the time before it in which no stop was exceeded. With nu_s
the rate of outcrossings of stop s (S. O. Rice 1944) and G_s(t) the probability that the age of one
of them is above t, a stationary process has

    P(hit before T) = P(beyond a stop at 0) + sum_s nu_s integral_0^T G_s(t) dt

exactly. Beyond the memory of the process (`horizon`) the survivors are hit at a constant rate, the
limiting decay rate

    lambda = sum_s nu_s G_s(t) / P(no impact before t)

which thus needs no record as long as the mission. Beside sines all of these are averages over
their phases, and the rate at which survivors are hit follows the phases. Where a beat, or a slow
sine, lasts as long as the mission, missions differ in their `Exposure`. The gaps of any number of
pairs, at one place or many, are the case of `first_crossings`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.moving_means import even_phases
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import jackknife_error
from stochvi.sampling.run import Run
from stochvi.sampling.sampler import TrialSampler, more_paths

FEWEST_PATHS = 64
"""Smallest number of paths from which a standard error can be trusted; each path holds some 20
crossings."""

PILOT = 2**32
"""Number of the first path of a pilot, which finds how many paths an answer needs and is no part of
that answer: a simulation that stops as soon as its error looks small states an error that is too
small, by some 5 %."""

MISSED = 1.3
"""Ratio of the error reached to the error asked for, above which paths are added."""

LEAST_PATHS = 8
"""Smallest number of paths, taken even where the budget is too short for them."""

FEWEST_SURVIVORS = 0.05
"""Share of the motions that must outlast the horizon without an impact for a limiting rate: 64
paths show it in spite of their noise. A smaller share is replaced by this one. That changes the
probability of an impact by less than the difference."""

STRIDES = (1, 2)
"""Strides through the samples of a record: every sample, and every second one, which shows what the
cubics between samples may miss."""


EXPOSURES, TIMES = 128, 2048
"""Number of missions with phases of their own, and of times in each, over which rates are
averaged."""

MANY_PERIODS = 1000
"""Periods of a single sine in a mission from which on all missions are alike: the last period, of
which phases decide, is a thousandth of it."""

RARE, FREQUENT = 1e-4, 50.0
"""Expected first impacts of a mission outside of which it does not matter how missions differ."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """How the missions under sines differ: by the rate of outcrossings that their phases bring.

    Parameters
    ----------
    omega
        Frequencies of the sines, rad/s.
    rates_at
        Outcrossings per second of all stops at one level, at phases (..., sines).
    """

    omega: Vector
    rates_at: Callable[[int, Matrix], Vector]
    known: dict[tuple[int, float], Vector] = field(default_factory=dict)

    def of(self, level: int, mission: float) -> Vector:
        """(EXPOSURES,): mean rate of outcrossings in missions with other phases at the start, over
        that of all missions."""
        if len(self.omega) == 1 and self.omega[0] * mission > 2.0 * math.pi * MANY_PERIODS:
            return np.ones(1)
        if (level, mission) not in self.known:
            self.known[level, mission] = self._averaged(level, mission)
        return self.known[level, mission]

    def _averaged(self, level: int, mission: float) -> Vector:
        starts = even_phases(len(self.omega), EXPOSURES)
        jitter = np.random.default_rng(0).random((EXPOSURES, TIMES))
        times = mission * (np.arange(TIMES) + jitter) / TIMES
        found = np.array(
            [
                self.rates_at(level, start + each[:, None] * self.omega).mean()
                for start, each in zip(starts, times, strict=True)
            ]
        )
        return np.asarray(found / found.mean())


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossingAges:
    """Ages of outcrossings at several levels, and the probability and rate of first impacts that
    follow from them.

    Parameters
    ----------
    outside
        (levels,): probability to be beyond a stop at the start.
    horizon, interval
        Time for which the records look back, and their sampling interval, s.
    rice_rates
        (sides, levels): outcrossings per second of each stop (Rice); one row for both stops where
        they are alike.
    ages
        (strides, sides, levels, paths, records): how long before such an outcrossing the last
        exceedance of any stop ended, s, at most `horizon`.
    exposure
        How missions differ by the phases of sines; None without sines.
    missed
        Rate of outcrossings that are not looked at, at most, 1/s.
    uneven
        (levels,): relative error of `rice_rates` by the net over what is beside the noise; None
        where that is known to be small.
    """

    outside: Vector
    horizon: float
    interval: float
    rice_rates: Vector
    ages: NDArray[np.float32]
    exposure: Exposure | None = None
    missed: float = 0.0
    uneven: Vector | None = None

    @cached_property
    def rice_rate(self) -> Vector:
        """(levels,): outcrossings per second of all stops (S. O. Rice 1944)."""
        return np.asarray(self.rice_rates.sum(axis=0))

    def first_rate(self) -> list[Estimate]:
        """Limiting rate of first impacts, lambda, at each level, 1/s."""
        return self._estimates(self._rate)

    def probability(self, mission: float) -> list[Estimate]:
        """Probability of any impact in the first `mission` seconds of the stationary motion.

        Where hardly any motion outlasts the memory it is a lower limit, and the bias reaches to 1.
        """
        if not 0.0 < mission < math.inf:
            raise ValueError(f"mission must be a positive number of seconds, got {mission}")

        def chance(sums: Vector) -> Vector:
            return self._probability(sums, mission)

        found = self._with_bias_of_rates(self._estimates(chance, mission), mission)
        limits = self._few(self._path_means(0, mission).mean(axis=-1), mission)
        found = [
            replace(found, bias=max(found.bias or 0.0, 1.0 - found.value)) if limit else found
            for found, limit in zip(found, limits, strict=True)
        ]
        if self.exposure is None or mission <= self.horizon:
            return found
        return [self._exposed(level, each, mission) for level, each in enumerate(found)]

    def _with_bias_of_rates(self, chances: list[Estimate], mission: float) -> list[Estimate]:
        """Probabilities with the bias that errors of the rates of outcrossings leave."""
        if self.uneven is None:
            return chances
        found = []
        for chance, uneven in zip(chances, self.uneven, strict=True):
            alive = max(1.0 - chance.value, 0.0)
            hazard = -math.log(max(alive, FEWEST_SURVIVORS**4))
            bias = alive * (float(uneven) * hazard + self.missed * mission)
            found.append(replace(chance, bias=(chance.bias or 0.0) + bias))
        return found

    def _exposed(self, level: int, found: Estimate, mission: float) -> Estimate:
        """A probability of missions that differ in their exposure to sines.

        First impacts are taken to follow the phases as all outcrossings do. They follow them less
        where outcrossings come in clumps: the share of outcrossings that are no first impacts, of
        all that this changes, is the bias.
        """
        assert self.exposure is not None
        hazard = -math.log1p(-min(found.value, 1.0 - FEWEST_SURVIVORS**4))
        if not RARE < hazard < FREQUENT:
            return found
        shares = self.exposure.of(level, mission)
        value = -float(np.mean(np.expm1(-hazard * shares)))
        slope = float(np.mean(shares * np.exp(-hazard * shares))) / math.exp(-hazard)
        first = min(hazard / mission / float(self.rice_rate[level]), 1.0)
        return replace(
            found,
            value=value,
            standard_error=found.standard_error * slope,
            bias=(found.bias or 0.0) * slope + (1.0 - first) * abs(value - found.value),
        )

    def _few(self, means: Vector, mission: float) -> NDArray[np.bool_]:
        """(levels,): whether these sums leave fewer survivors than `FEWEST_SURVIVORS`, so that this
        share is taken instead."""
        half = self.horizon / 2.0
        few = self.outside + means[0] > 1.0 - FEWEST_SURVIVORS
        if mission > self.horizon:
            few |= (1.0 - self.outside) * half - means[2] < FEWEST_SURVIVORS * half
        return np.asarray(few)

    def _held(self, means: Vector) -> Vector:
        """The sums, lowered where they leave fewer survivors than `FEWEST_SURVIVORS`, so that they
        leave that share."""
        half, left = self.horizon / 2.0, 1.0 - self.outside
        early = np.minimum(means[0], left - FEWEST_SURVIVORS)
        area = np.minimum(means[2], (left - FEWEST_SURVIVORS) * half)
        return np.stack([early, means[1], area])

    def _estimates(
        self, statistic: Callable[[Vector], Vector], mission: float = math.inf
    ) -> list[Estimate]:
        """A statistic of every level, with its error by a jackknife over paths and a bias from what
        half as many samples change."""
        fine, coarse = (self._path_means(stride, mission) for stride in range(len(STRIDES)))
        paths = fine.shape[-1]
        values = statistic(fine.mean(axis=-1))
        left_out = statistic((fine.sum(axis=-1, keepdims=True) - fine) / (paths - 1))
        errors = jackknife_error(left_out)
        # where every crossing in the sample was a first one, the share of others is still uncertain
        # by about one in the number of crossings
        crossings = paths * self.ages.shape[-1]
        errors = np.maximum(errors, values / crossings)
        # where hardly any crossing was a first one, one more would change the means by this much
        first = self._integrals(np.full((1, 1), self.horizon), mission)[:, 0] * self.rice_rate
        seen = fine.mean(axis=-1)
        errors = np.maximum(errors, np.abs(statistic(seen + (first - seen) / crossings) - values))
        # where `FEWEST_SURVIVORS` stands for the share that was seen, it does not vary with that
        # share
        error = fine.std(axis=-1, ddof=1) / math.sqrt(paths)
        fewer = np.abs(statistic(self._held(seen) - error) - values)
        errors = np.where(self._few(seen + error, mission), np.maximum(errors, fewer), errors)
        # a cubic between samples misses peaks at an order of 2 at least
        bias = np.abs(statistic(coarse.mean(axis=-1)) - values) / 3.0
        how = f"{paths} paths of {self.ages.shape[-1]} crossings; bias from half the sampling"
        return [
            Estimate(value=float(v), standard_error=float(e), bias=float(b), how=how)
            for v, e, b in zip(values, errors, bias, strict=True)
        ]

    def _path_means(self, stride: int, mission: float) -> Vector:
        """(3, levels, paths): nu times three integrals of G: from 0 to min(horizon, mission), over
        the second half of the horizon, and of the first one over the second half."""
        integrals = self._integrals(self.ages[stride].astype(float), mission).mean(axis=-1)
        return np.asarray(np.einsum("sl,islp->ilp", self.rice_rates, integrals))

    def _integrals(self, ages: Vector, mission: float) -> Vector:
        """The three integrals of `_path_means`, divided by nu, for crossings of these ages."""
        first, last = self.horizon / 2.0, self.horizon
        late = np.maximum(ages - first, 0.0)
        # int_first^last min(age, t) dt
        area = np.minimum(ages, first) * (last - first) + late * (last - first) - 0.5 * late**2
        return np.stack([np.minimum(ages, mission), late, area])

    def _rate(self, means: Vector) -> Vector:
        first, last = self.horizon / 2.0, self.horizon
        half = last - first
        exposure = (1.0 - _columns(self.outside, means[1])) * half - means[2]
        fewest = FEWEST_SURVIVORS * half
        # where hardly any survive, they are assumed to be hit at least as fast as those before them
        lost = np.where(exposure < fewest, -math.log(FEWEST_SURVIVORS) / last, 0.0)
        return np.asarray(np.maximum(means[1] / np.maximum(exposure, fewest), lost))

    def _probability(self, means: Vector, mission: float) -> Vector:
        early = np.minimum(_columns(self.outside, means[0]) + means[0], 1.0 - FEWEST_SURVIVORS)
        later = max(mission - self.horizon, 0.0)
        return np.asarray(-np.expm1(np.log1p(-early) - self._rate(means) * later))


def _columns(levels: Vector, like: Vector) -> Vector:
    """(levels,) as a column where there are several paths."""
    return levels if like.ndim == 1 else levels[:, None]


Ages_co = TypeVar("Ages_co", bound=CrossingAges, covariant=True)


class Source(Protocol[Ages_co]):
    """Records with crossings put into them, a block of paths at a time."""

    @property
    def together(self) -> int:
        """Number of paths that are made together."""

    def ages(self, first_path: int) -> NDArray[np.float32]:
        """Ages (strides, sides, levels, paths, records) of the crossings in one block of paths."""

    def found(self, ages: NDArray[np.float32]) -> Ages_co:
        """The answer from the ages of all crossings so far."""


@dataclass(frozen=True, eq=False)
class CrossingSampler(TrialSampler):
    """Ages of crossings in blocks of paths, which are numbered from `first` on."""

    records: Source[CrossingAges]
    first: int

    @property
    def block(self) -> int:
        """Number of paths that are made together."""
        return self.records.together

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> NDArray[np.float32]:
        """The ages in one block of paths."""
        return self.records.ages(self.first + first_path)


def until_accurate(run: Run, records: Source[Ages_co], mission: float, rel_error: float) -> Ages_co:
    """As many paths as a pilot finds necessary for `rel_error`, see `first_crossings`."""

    def found(sample: list[NDArray[np.float32]]) -> Ages_co:
        return records.found(np.concatenate(sample, axis=3))

    def error(sample: list[NDArray[np.float32]]) -> float:
        return largest_error(found(sample), mission)

    def missed(sample: list[NDArray[np.float32]]) -> float:
        """The error, where it is clearly larger than asked for."""
        known = error(sample)
        return known if known > MISSED * rel_error else 0.0

    pilot = run.until(CrossingSampler(records, PILOT), FEWEST_PATHS, needed=LEAST_PATHS)
    taken = pilot
    if not run.deadline.passed():
        asked = pilot.paths + more_paths(pilot.paths, error(pilot.sample), rel_error)
        answer = run.to_accuracy(CrossingSampler(records, 0), asked, missed, rel_error)
        taken = answer if answer.paths >= min(asked, pilot.paths) else pilot
    if run.deadline.interrupted:
        raise run.deadline.fell_short(f"after {taken.paths} paths", "", found(taken.sample))
    return found(taken.sample)


def largest_error(found: CrossingAges, mission: float) -> float:
    """Largest relative standard error of the probabilities that `rel_error` governs in
    `first_crossings`."""
    chances = [chance for chance in found.probability(mission) if 0.0 < chance.value < 0.5]
    return max((chance.standard_error / chance.value for chance in chances), default=0.0)
