"""First crossings of a stationary Gaussian process. Chapters: probability and rate from ages of
outcrossings; several pairs as a Gaussian vector; probability that any stop is touched."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import explain_methods
from stochvi.mathematics.unsteady_noise import (
    MOST_IN_WINDOW,
    Crossings,
    MovingMean,
    Shocks,
    Sines,
    even_phases,
)
from stochvi.model.coverage import (
    beyond_one_oscillator,
    free_motion,
    not_gaussian,
    without_free_response,
    without_noise,
)
from stochvi.model.model import ALIKE, Model, Pair, model_of, sharing_of
from stochvi.motion.choose_plan import GapResponse, plan_gaps
from stochvi.motion.kernels.crossings_and_cycles import (
    ShockResponses,
    StatesAtCrossings,
    Waves,
    outcrossing_ages,
)
from stochvi.motion.synthesis import MOST_SAMPLES
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, jackknife_error
from stochvi.sampling.calculations import AccuracyOptions, TrialSampler, calculation, more_paths
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.excitations.drawn import Pulses
from stochvi.scenes.scene import Scene
from stochvi.statistics.hazards import HazardCurve

# ------------------------------------------------------------------------------
# The probability of a first impact and its rate, from the ages of outcrossings.
#
# The age of an outcrossing of a stop is the time before it in which no stop was exceeded. With nu_s
# the rate of outcrossings of stop s (S. O. Rice 1944) and G_s(t) the probability that the age of
# one of them is above t, a stationary process has
#
#     P(hit before T) = P(beyond a stop at 0) + sum_s nu_s integral_0^T G_s(t) dt
#
# exactly. Beyond the memory of the process (`horizon`) the survivors are hit at a constant rate,
# the limiting decay rate
#
#     lambda = sum_s nu_s G_s(t) / P(no impact before t)
#
# which thus needs no record as long as the mission. Beside sines all of these are averages over
# their phases, and the rate at which survivors are hit follows the phases. Where a beat, or a slow
# sine, lasts as long as the mission, missions differ in their `Exposure`. The gaps of any number of
# pairs, at one place or many, are the case of `first_crossings`.
# ------------------------------------------------------------------------------


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


@dataclass(frozen=True, eq=False)
class CrossingSampler(TrialSampler):
    """Ages of crossings in blocks of paths, which are numbered from `first` on."""

    records: GapRecords
    first: int

    @property
    def block(self) -> int:
        """Number of paths that are made together."""
        return self.records.together

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> NDArray[np.float32]:
        """The ages in one block of paths."""
        return self.records.ages(self.first + first_path)


def until_accurate(
    run: Run, records: GapRecords, mission: float, rel_error: float
) -> FirstCrossings:
    """As many paths as a pilot finds necessary for `rel_error`, see `first_crossings`."""

    def found(sample: list[NDArray[np.float32]]) -> FirstCrossings:
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


# ------------------------------------------------------------------------------
# Probability that any of several impact pairs is hit at all: first crossings of a Gaussian vector.
#
# Before the first contact the gaps of a linear structure are a stationary Gaussian process. Beside
# sines or shocks it is one about means that move (`mathematics.unsteady_noise`). A first impact of
# any pair is its first outcrossing of the region in which no gap is beyond a stop. Every stop has
# its own outcrossings, with the rate of Rice; around one of them all gaps are Gaussian, with the
# cross-correlations of the process (`kernels.crossings_and_cycles`). Before it lies the last
# exceedance of any stop of any pair. The time between them says for how long it would have been the
# first impact (`CrossingAges`). Pairs that move together are thereby counted together.
# ------------------------------------------------------------------------------


SAMPLES_PER_PERIOD = 40.0
"""Number of samples in a natural period. White noise leaves the path rough between samples: with
half as many (and zeta 0.05) the limiting rate is 1.2(4) % higher at 2 sigma, 0.18(5) % at 3,
0.03(2) % at 5."""

FELT = 1e-4
"""Share of a sine in the velocity variance of a gap, from which on its period is sampled as finely
as a natural period."""

MEMORY_RELAXATIONS = 6.0
"""Horizon in time constants of the structure; in its second half the rate of first impacts is
constant."""

MEMORY_CORRELATIONS = 24.0
"""Horizon in integrals of the squared correlation; for a lightly damped resonance these are the
same 6 time constants."""

SLOPES = 0x5107E5
"""Number that keeps the random slopes apart from other uses of a seed."""

STARTS = 4096
"""Number of samples beyond each stop that are drawn for the probability to be beyond any stop at
the start: its standard error is then below 1 %."""


SIDES_WITH_ALL = 4
"""Number of stops up to which each stop has as many crossings in a record as fit into it; with more
stops each has fewer, in proportion."""

ADDED_VARIANCE = 1e-12
"""Share of its own variance that is added to each gap. The covariance of gaps that are one motion
then has no negative eigenvalues from rounding."""


class ShocksMeet(NotApplicable):
    """Shocks come before the motion after the last one is forgotten."""


@explain_methods
@dataclass(frozen=True, kw_only=True, eq=False)
class FirstCrossings(CrossingAges):
    """Ages of outcrossings of the stops of pairs, from which the first impacts of any follow.

    Parameters
    ----------
    pairs
        Names of the pairs.
    lower, upper
        (levels, pairs): distances of the stops from the mean gaps, m; infinite for none.
    displacement_std, velocity_std
        (pairs,): standard deviations of the gaps and of their rates, m and m/s.
    crossing
        (sides,): number of the stop to which each row of `rice_rates` belongs: first all lower
        stops, then all upper ones. An upper one stands for both where they are alike.
    directions
        (pairs, n): the gaps as combinations of coordinates.
    outside_error
        (levels,): standard error of `outside`.

    See Also
    --------
    stochvi.reliability : The probability of any impact in a mission.
    """

    pairs: tuple[str, ...]
    lower: Matrix
    upper: Matrix
    displacement_std: Vector
    velocity_std: Vector
    crossing: NDArray[np.int64]
    directions: Matrix
    outside_error: Vector

    def probability(self, mission: float) -> list[Estimate]:
        """Probability that any pair is hit in the first `mission` seconds of the stationary motion.

        Where hardly any motion outlasts the memory it is a lower limit, and the bias reaches to 1.
        """
        return [
            replace(found, standard_error=math.hypot(found.standard_error, error))
            for found, error in zip(super().probability(mission), self.outside_error, strict=True)
        ]

    def hazards(
        self, places: Vector, mission: float, expected: Callable[[float], float] | None = None
    ) -> HazardCurve:
        """The hazard of any impact against the place of the stops, one for each level and rising,
        over expected crossings."""
        return HazardCurve.of(
            places, self.probability(mission), mission, largest_error(self, mission),
            first_rates=self.first_rate(), expected=expected,
        )  # fmt: skip

    def shares(self, mission: float) -> Matrix:
        """(levels, pairs): share of the first impacts of a mission that falls to each pair; pairs
        that are hit at once share their impacts."""
        known = np.minimum(self.ages[0].astype(float), mission).mean(axis=(-2, -1))
        of_stops = np.zeros((len(self.lower), 2 * len(self.pairs)))
        np.add.at(of_stops.T, self.crossing, self.rice_rates * known)
        for level, rows in enumerate(zip(self.lower, self.upper, strict=True)):
            sharing = sharing_of(self.directions, *rows)
            if sharing is not None:
                of_stops[level] = sharing @ of_stops[level]
        found = of_stops.reshape(len(of_stops), 2, -1).sum(axis=1)
        total = found.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(found, total, out=np.zeros_like(found), where=total > 0.0))


class PairMotion:
    """The motion of all gaps of a model without stops, into which crossings of stops at any places
    are put.

    Parameters
    ----------
    model
        A linear structure with impact pairs under Gaussian noise, and sines beside it.
    longest_step
        Longest sampling interval of the records, s.
    memories
        Length of half a record, as a multiple of the memory of the gaps.
    """

    def __init__(self, model: Model, longest_step: float = math.inf, memories: float = 1.0) -> None:
        if not model.pairs:
            raise NotApplicable("first_crossings", "the scene needs an impact_pair")
        self.model, self.longest_step, self.memories = model, longest_step, memories
        self.directions = np.array([pair.direction for pair in model.pairs])
        motion = free_motion(model, with_sines=True)
        self.shocks: Shocks | None = None
        self.motions, self.sines = motion.moving_means(self.directions), motion.sines
        self.displacement_std, self.velocity_std = np.array(
            [each.deviations for each in self.motions]
        ).T
        still = [
            pair.name
            for pair, each in zip(model.pairs, self.motions, strict=True)
            if not each.place and each.reach
        ]
        if still:
            raise NotApplicable(
                "first_crossings",
                f"noise must move the gap of {still[0]}, got sines alone; `sine` follows these",
            )

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """Numbers of the pairs whose gaps move: others are never hit."""
        (found,) = np.nonzero(self.displacement_std)
        if not len(found):
            raise NotApplicable(
                "first_crossings",
                "excitation must move at least one gap, got none that moves; check its on",
            )
        return found

    @cached_property
    def response(self) -> GapResponse:
        """Synthesis of the gaps that move."""
        plan = crossing_response(self.model, self.directions[self.moving], self.memories)
        longest = min(self.longest_step, *map(_longest_step, self.motions))
        return plan.with_step(longest) if plan.step > longest else plan

    @classmethod
    def under_shocks(cls, model: Model) -> PairMotion:
        """The motion under the noise of a model and its shocks, if there are any."""
        if not model.drawn:
            return cls(model)
        pulses, direction = shocks_apart(model)
        found = cls(replace(model, drawn=()))
        shocks = found._shocks(pulses, direction)
        found.shocks = shocks
        found.motions = [
            replace(each, shocks=shocks.of(row[None]))
            for each, row in zip(found.motions, np.eye(len(found.motions)), strict=True)
        ]
        found.displacement_std, found.velocity_std = np.array(
            [each.deviations for each in found.motions]
        ).T
        return found

    def _shocks(self, pulses: Pulses, direction: Vector) -> Shocks:
        """The shocks that move the gaps of all pairs."""
        assert pulses.shock is not None
        plan, remembered = self.response, self.count * self.response.step
        length, shapes = pulses.shock.duration + remembered, self.model.modal.shapes
        if length > plan.block_length:
            raise NotApplicable(
                "first_crossings",
                f"a shock must be shorter than {plan.block_length - remembered:.3g} s for this "
                f"mount, got {pulses.shock.duration:.3g} s",
            )
        moved = plan.shock_responses(self.directions @ shapes, shapes.T @ direction, pulses)
        shocks = Shocks(
            rate=pulses.rate, step=plan.step, responses=moved[:, : math.ceil(length / plan.step)],
            window=length + remembered, sizes=pulses.sizes, two_sided=pulses.two_sided,
        )  # fmt: skip
        if shocks.expected > MOST_IN_WINDOW:
            raise ShocksMeet(
                "first_crossings",
                [f"shocks must be apart, got {shocks.expected:.3g} in the {shocks.window:.3g} s "
                 "for which their motion is remembered; reliability counts missions"],
            )  # fmt: skip
        return shocks

    @cached_property
    def count(self) -> int:
        """Number of samples that records look back: a multiple of every stride."""
        steps = memory_of(self.response) / self.response.step / max(STRIDES)
        return max(STRIDES) * math.ceil(steps)

    @cached_property
    def correlations(self) -> NDArray[np.float64]:
        """See `GapResponse.correlations`."""
        return self.response.correlations(self.count)

    def crossings(
        self, lower: ArrayLike | None, upper: ArrayLike | None, mission: float, run: Run
    ) -> FirstCrossings:
        """First impacts at many levels, see `first_crossings`."""
        own = own_distances(self.model)
        given = [
            np.atleast_2d(np.asarray(each if each is not None else place, dtype=float))
            for each, place in zip((lower, upper), own, strict=True)
        ]
        below, above = np.broadcast_arrays(*given)
        records = GapRecords(self, run.seed, below, above)
        return until_accurate(run, records, mission, run.accuracy)


def _longest_step(motion: MovingMean) -> float:
    """Longest sampling interval for the sines that move a gap, s."""
    moved = 0.5 * np.abs(motion.sines.omega * motion.sines.waves[0]) ** 2
    (fast,) = np.nonzero(moved >= FELT * motion.speed**2)
    if not len(fast):
        return math.inf
    return 2.0 * math.pi / float(motion.sines.omega[fast].max()) / SAMPLES_PER_PERIOD


def shocks_apart(model: Model) -> tuple[Pulses, Vector]:
    """The shocks beside the noise of a model, with the forces per unit; `NotApplicable` where they
    are not of one kind, or something else is there."""
    unmet = []
    if model.sines:
        unmet.append("sines must be left out beside shocks")
    others = tuple(each for each in model.drawn if not isinstance(each[0], Pulses))
    shocks = [(each, row) for each, row in model.drawn if isinstance(each, Pulses)]
    if len(shocks) > 1:
        unmet.append(f"shocks must be of one kind, got {len(shocks)} excitations")
    unmet += not_gaussian(replace(model, drawn=others)) if others else []
    if unmet:
        raise NotApplicable("first_crossings", unmet)
    return shocks[0]


def rice_rate(motions: Sequence[MovingMean], stops: Matrix, gain: float = 1.0) -> float:
    """Crossings per second of stops (2, pairs) at distances from the mean gaps, m, infinite for
    none, under noise that is louder by a gain (Rice). One that lies beyond the mean is crossed as
    often as that."""
    return sum(
        motion.towards(side).rate(max(distance, 0.0) / gain)
        for side, own in zip((-1.0, 1.0), stops.tolist(), strict=True)
        for motion, distance in zip(motions, own, strict=True)
        if motion.place and math.isfinite(distance)
    )


def own_distances(model: Model) -> tuple[Vector, Vector]:
    """(pairs,) distances of the lower and of the upper stops from the mean gaps, m."""
    found = np.full((2, len(model.pairs)), math.inf)
    for number, (pair, place) in enumerate(zip(model.pairs, model.mean_gaps, strict=True)):
        for stop in pair.stops:
            found[int(stop.side > 0), number] = stop.side * (stop.position - place)
    return found[0], found[1]


def pressed_pairs(model: Model, below: Vector, above: Vector) -> list[str]:
    """Sentences about the pairs whose mean gaps lie beyond a stop, from the distances (pairs,)."""
    found = []
    for pair, *distances in zip(model.pairs, below, above, strict=True):
        found += [
            f"the mean gap of {pair.name} must lie between its stops: without them it would be "
            f"{-distance:.4g} m beyond its {side} stop, and be pressed onto it from the start; "
            "move that stop, take this pair out of the scene, or let simulate count its impacts"
            for side, distance in zip(("lower", "upper"), distances, strict=True)
            if distance <= 0.0
        ]
    return found


def same_gaps(model: Model) -> list[str]:
    """Sentences about pairs whose gaps are one motion, so that they are hit together."""
    found = []
    for number, pair in enumerate(model.pairs):
        for earlier in model.pairs[:number]:
            if turn_between(earlier.direction, pair.direction):
                found.append(
                    f"{earlier.name} and {pair.name} have the same gap: where their stops are "
                    "equally far, both are hit at once, and share the impacts"
                )
                break
    return found


def listed_under_first(model: Model) -> list[str]:
    """Sentences about rigid stops that are hit at once, for lists of single impacts: each impact
    stands under the pair that the scene names first."""
    if model.sharing is None:
        return []
    stops, others = np.nonzero(model.sharing)
    number = len(model.pairs)
    twins = {(int(i) % number, int(j) % number) for i, j in zip(stops, others, strict=True)}
    return [
        f"{model.pairs[one].name} and {model.pairs[two].name} are hit at once where their stops "
        f"are equally far: such impacts stand under {model.pairs[one].name} alone"
        for one, two in sorted(twins)
        if one < two
    ]


def turn_between(one: Vector, other: Vector) -> int:
    """1 where two gaps (n,) are one motion, -1 where the second is the first with the opposite
    sign, else 0."""
    size = ALIKE * np.linalg.norm(one)
    return next((turn for turn in (1, -1) if np.linalg.norm(other - turn * one) <= size), 0)


def crossing_response(model: Model, directions: Matrix, memories: float = 1.0) -> GapResponse:
    """Synthesis of gaps, sampled finely enough for peaks.

    A record repeats itself: half of it is at least `memories` times as long as the memory of the
    gaps. A narrow response is remembered for longer than the structure says. It then has the
    bandwidth of 12 bins at least (see `memory_of`).
    """
    plan = plan_gaps(model, directions)
    plan = plan.with_step(min(plan.step, 2.0 * math.pi / plan.fastest / SAMPLES_PER_PERIOD))
    while memories * memory_of(plan) > 0.5 * plan.block_length:
        if 2 * plan.samples * plan.gaps > MOST_SAMPLES:
            raise NotApplicable(
                "first_crossings",
                "the input is too narrow to be resolved: its memory of "
                f"{memory_of(plan):.3g} s or more does not fit into half a record of "
                f"{MOST_SAMPLES // plan.gaps} samples",
            )
        plan = plan.with_block(2.0 * plan.block_length)
    return plan


def memory_of(plan: GapResponse) -> float:
    """Seconds after which every gap has forgotten its past.

    It follows from the integral of the squared correlation. v_k are the variances of the bins of a
    record of length L. The integral is L / 4 times sum v_k^2 / (sum v_k)^2, one over the bandwidth
    in bins (Parseval).
    """
    variances = np.sum(np.abs(plan.amplitudes) ** 2, axis=2)
    bins = variances.sum(axis=0) ** 2 / np.sum(variances**2, axis=0)
    correlation = MEMORY_CORRELATIONS * plan.block_length / (4.0 * float(bins.min()))
    return max(correlation, MEMORY_RELAXATIONS * plan.relaxation)


BesideCrossings = tuple[StatesAtCrossings | None, Waves | None, ShockResponses | None]
"""States beside the noise at crossings, and the sines or the shocks that have them; None without
any."""


class Draws(NamedTuple):
    """Random numbers of crossings: slopes of the unit Rayleigh distribution and, beside sines,
    numbers between 0 and 1 that choose the phases, None without sines."""

    units: Vector
    shares: Vector | None

    def of(self, which: Any) -> Draws:
        """Those of one gap, or of some crossings."""
        return Draws(self.units[which], None if self.shares is None else self.shares[which])


class GapRecords:
    """Stationary records of all gaps that have stops, and the crossings that are put into them."""

    def __init__(self, motion: PairMotion, seed: int, lower: Matrix, upper: Matrix) -> None:
        pressed = pressed_pairs(motion.model, lower.min(axis=0), upper.min(axis=0))
        if pressed:
            raise NotApplicable("first_crossings", pressed)
        self.motion, self.seed, self.lower, self.upper = motion, seed, lower, upper
        self.plan, self.count = motion.response, motion.count
        stopped = np.any(np.isfinite(lower) | np.isfinite(upper), axis=0)
        (self.chosen,) = np.nonzero(stopped[motion.moving])
        self.pairs = motion.moving[self.chosen]
        above, below = (np.ascontiguousarray(side[:, self.pairs]) for side in (upper, lower))
        self.above, self.below = above, below
        # where the motion is as likely with the opposite sign, stops that are alike are looked at
        # once
        self.alike = np.array_equal(above, below) and self.beside.symmetric
        self.sides = [
            (gap, ahead, behind)
            for ahead, behind in [(above, below), (below, above)][: 2 - self.alike]
            for gap in range(len(self.pairs))
            if np.any(np.isfinite(ahead[:, gap]))
        ]
        # every stop has crossings of its own: with many stops, fewer of each give the same accuracy
        apart = self.count * max(1, len(self.sides) // SIDES_WITH_ALL)
        self.starts = np.arange(0, max(self.plan.samples - self.count, 1), apart)

    @cached_property
    def correlations(self) -> NDArray[np.float64]:
        """See `GapResponse.correlations`, of the chosen gaps."""
        return self.motion.correlations[:, :, self.chosen][..., self.chosen]

    @property
    def together(self) -> int:
        """Number of paths that are made together."""
        return self.plan.block(len(self.pairs))

    @property
    def horizon(self) -> float:
        """Time for which records look back, s."""
        return self.count * self.plan.step

    @cached_property
    def sines(self) -> Sines:
        """The sines of the chosen gaps."""
        return self.motion.sines(self.motion.directions[self.pairs])

    @cached_property
    def beside(self) -> Sines | Shocks:
        """What moves the means of the chosen gaps."""
        shocks = self.motion.shocks
        return (
            self.sines if shocks is None else shocks.of(np.eye(len(shocks.responses))[self.pairs])
        )

    @cached_property
    def motions(self) -> list[MovingMean]:
        """The chosen gaps, with the noise of the records."""
        variance, bend = (np.diag(self.correlations[order, 0]) for order in (0, 2))
        return [
            replace(self.motion.motions[pair], place=math.sqrt(square), speed=math.sqrt(-rate))
            for square, rate, pair in zip(variance, bend, self.pairs, strict=True)
        ]

    def _turn(self, side: int) -> float:
        """The sign of the motion towards the stop of a side; 1 where either is as likely."""
        below = self.sides[side][1] is self.below
        return -1.0 if below and not self.beside.symmetric else 1.0

    def _ahead(self, side: int) -> MovingMean:
        """The gap that crosses the stop of a side, positive towards that stop."""
        gap, near, _ = self.sides[side]
        return self.motions[gap].towards(-1.0 if near is self.below else 1.0)

    @cached_property
    def rice_rates(self) -> Matrix:
        """(sides, levels), see `CrossingAges`."""
        rates = [
            [self._ahead(side).rate(float(each)) for each in near[:, gap]]
            for side, (gap, near, _) in enumerate(self.sides)
        ]
        return (1.0 + self.alike) * np.array(rates)

    @cached_property
    def _uneven(self) -> Vector | None:
        """(levels,): relative error of the sum of `rice_rates` by the net of shocks, from half of
        its points; None for sines."""
        if isinstance(self.beside, Sines):
            return None
        half = [
            [self._ahead(side).rate(float(each), coarse=True) for each in near[:, gap]]
            for side, (gap, near, _) in enumerate(self.sides)
        ]
        known = self.rice_rates.sum(axis=0)
        less = (1.0 + self.alike) * np.array(half).sum(axis=0)
        return np.asarray(np.abs(less / np.maximum(known, np.finfo(float).tiny) - 1.0))

    @cached_property
    def exposure(self) -> Exposure:
        """How missions differ by the phases of the sines."""
        return Exposure(self.sines.omega, self.rates_at)

    def rates_at(self, level: int, phases: Matrix) -> Vector:
        """Outcrossings of all stops per second at one level, at phases (..., sines)."""
        found = np.zeros(phases.shape[:-1])
        # where stops are alike, the lower ones are crossed half a turn later
        for turn in (0.0, math.pi)[: 1 + self.alike]:
            for gap, near, _ in self.sides:
                ahead = turn if near is self.above else turn + math.pi
                found += self.motions[gap].rates_at(float(near[level, gap]), phases + ahead)
        return found

    @cached_property
    def _looking_back(self) -> list[Vector]:
        """rho, rho', eta and eta' of all gaps before a crossing of each, (gaps, count + 1, 4)."""
        found = []
        for gap in range(len(self.pairs)):
            r, rate, bend = self.correlations[..., gap]
            own, own_bend = r[0, gap], bend[0, gap]
            rows = np.stack([r / own, rate / own, rate / own_bend, bend / own_bend], axis=-1)
            found.append(np.ascontiguousarray(rows.transpose(1, 0, 2)))
        return found

    def draws(self, first_path: int, paths: int) -> Draws:
        """Random numbers of the crossings in one block of paths."""
        random = np.random.default_rng([self.seed, SLOPES, first_path])
        size = len(self.pairs), paths, len(self.starts)
        units = random.rayleigh(size=size)
        return Draws(units, random.random(size) if self.beside.number else None)

    def ages(self, first_path: int) -> NDArray[np.float32]:
        """Ages (strides, sides, levels, paths, starts) of the crossings in one block of paths."""
        records = self.plan.records(self.seed, first_path, self.together, self.chosen)
        return self.ages_in(records, self.draws(first_path, self.together), STRIDES)

    def ages_in(self, records: Vector, draws: Draws, strides: Sequence[int]) -> NDArray[np.float32]:
        """The ages of crossings in records (paths, samples, 2 pairs) and with random numbers that
        have been made."""
        ages = []
        for side, (gap, _, _) in enumerate(self.sides):
            own = draws.of(gap)
            beside = self.beside_crossings(side, own)  # the same at every stride
            ages.append(
                [
                    self.ages_before(side, records, self.starts, own, stride, beside)
                    for stride in strides
                ]
            )
        return np.ascontiguousarray(np.array(ages, np.float32).swapaxes(0, 1))

    def ages_before(
        self, side: int, records: Vector, starts: NDArray[np.int64], draws: Draws, stride: int = 1,
        beside: BesideCrossings | None = None,
    ) -> Vector:  # fmt: skip
        """Ages (levels, paths, starts) of crossings of the stop of one side.

        They are put at the samples `starts` of records; the draws (paths, starts) are those of the
        gap, and lead to what is `beside` the noise.
        """
        gap, near, far = self.sides[side]
        ages = np.empty((len(near), *draws.units.shape))
        outcrossing_ages(
            records, starts, self.motions[gap].speed * draws.units, self._looking_back[gap], gap,
            self.plan.step, stride, near, far, *(beside or self.beside_crossings(side, draws)),
            ages,
        )  # fmt: skip
        return ages

    def beside_crossings(self, side: int, draws: Draws) -> BesideCrossings:
        """What is beside the noise at the crossings of the stop of one side."""
        if not self.beside.number:
            return None, None, None
        levels = range(len(self.sides[side][1]))
        found = [self.crossings(side, draws, level) for level in levels]
        known = (np.ascontiguousarray(each) for each in map(np.array, zip(*found, strict=True)))
        states = StatesAtCrossings(*known)
        if isinstance(self.beside, Sines):
            waves = self.beside.waves
            parts = (np.ascontiguousarray(each) for each in (waves.real, waves.imag))
            return states, Waves(self.beside.omega, *parts), None
        moved = self._turn(side) * self.beside.responses
        return states, None, ShockResponses(np.ascontiguousarray(moved))

    def crossings(self, side: int, draws: Draws, level: int = 0) -> Crossings:
        """Crossings of the stop of one side at one level, from the draws of its gap.

        Those of a lower stop belong to the process with the opposite sign, whose phases have the
        same law; shocks in one direction are turned over as well.
        """
        gap, near, _ = self.sides[side]
        return self._ahead(side).crossings(float(near[level, gap]), draws.units, draws.shares)

    def found(self, ages: NDArray[np.float32]) -> FirstCrossings:
        """The answer from the ages of all crossings so far."""
        outside, error = self._beyond
        return FirstCrossings(
            outside=outside,
            outside_error=error,
            pairs=tuple(pair.name for pair in self.motion.model.pairs),
            lower=self.lower,
            upper=self.upper,
            displacement_std=self.motion.displacement_std,
            velocity_std=self.motion.velocity_std,
            crossing=np.array(
                [
                    self.pairs[gap] + (near is self.above) * len(self.motion.directions)
                    for gap, near, _ in self.sides
                ]
            ),
            directions=self.motion.directions,
            horizon=self.horizon,
            interval=self.plan.step,
            rice_rates=self.rice_rates,
            ages=ages,
            exposure=self.exposure if self.sines.number else None,
            missed=0.0 if isinstance(self.beside, Sines) else self.beside.missed_rate,
            uneven=self._uneven,
        )

    @cached_property
    def _means(self) -> tuple[Matrix, Vector]:
        """Means (gaps, states) of what is beside the noise, and the probabilities of the states."""
        if isinstance(self.beside, Sines):
            means = self.beside.at(even_phases(self.beside.number, STARTS))[0]
            shape = len(self.pairs), STARTS
            return np.broadcast_to(means, shape), np.full(STARTS, 1.0 / STARTS)
        states, weights = self.beside.net
        # noise alone, the first state, has as many samples as there are starts
        states = np.concatenate([np.repeat(states[:1], STARTS, axis=0), states[1:]])
        weights = np.concatenate([np.full(STARTS, weights[0] / STARTS), weights[1:]])
        return self.beside.at(states)[0], weights

    @cached_property
    def _beyond(self) -> tuple[Vector, Vector]:
        """Probabilities to be beyond any stop at the start, level by level, and their standard
        errors.

        It is the sum over stops of the probability to be beyond the stop. Each state counts one
        over the number of stops that its gaps are beyond (R. J. Adler, J. H. Blanchet and J. Liu,
        Ann. Appl. Probab. 22 (2012) 1167).
        """
        covariance = self.correlations[0, 0]
        std = np.sqrt(np.diag(covariance))
        random = np.random.default_rng([self.seed, SLOPES])
        root = np.linalg.cholesky(covariance + ADDED_VARIANCE * np.diag(std**2))
        means, weights = self._means
        normal = random.standard_normal((len(weights), len(std))) @ root.T
        uniform = random.random(len(weights))
        total, variance = np.zeros((2, len(self.lower)))
        rows = zip(self.lower[:, self.pairs], self.upper[:, self.pairs], strict=True)
        for level, (lower, upper) in enumerate(rows):
            for near, far, side in ((upper, lower, 1.0), (lower, upper, -1.0)):
                # distances from the means of the noise, (gaps, phases)
                ahead, behind = near[:, None] - side * means, far[:, None] + side * means
                for gap in np.flatnonzero(np.isfinite(near)):
                    chance = ndtr(-ahead[gap] / std[gap])
                    if chance.max() < np.finfo(float).tiny:
                        continue
                    least = np.maximum(chance, np.finfo(float).tiny)
                    place = np.maximum(-std[gap] * ndtri(least * uniform), ahead[gap])
                    share = covariance[gap] / covariance[gap, gap]
                    gaps = normal + (place - normal[:, gap])[:, None] * share
                    gaps[:, gap] = place
                    stops = np.sum((gaps >= ahead.T) | (gaps <= -behind.T), axis=1)
                    some = chance / stops
                    share = float(weights @ some)
                    total[level] += share
                    variance[level] += float(weights**2 @ (some - share) ** 2)
        # one gap is beyond one stop at most: the mean over states, which are even, is no sample
        return total, np.sqrt(variance) * (len(self.pairs) > 1)


# ------------------------------------------------------------------------------
# Probability that any stop is touched at all: first crossings of a stationary Gaussian process.
#
# Before the first contact the gaps move as if there were no stops: linearly, and Gaussian where the
# excitation is. The probability of any impact in a mission depends on no impact law, therefore, and
# needs no impact. Around an outcrossing of a stop the process is Slepian's (see
# `kernels.crossings_and_cycles`), so the records of gaps (`GapRecords`) look back from a given
# crossing of one gap. A probability of 1e-9 costs no more than one of 0.1, and the same records
# serve any number of levels. `CrossingAges` has the formulas.
# ------------------------------------------------------------------------------


@calculation
@sampled(rel_error=0.05)
def first_crossings(
    scene: Scene,
    clearances: ArrayLike | None = None,
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    mission: float = 3600.0,
    **options: Unpack[AccuracyOptions],
) -> FirstCrossings:
    """First impacts of one oscillator, or of any pair of a structure, from one set of records.

    Parameters
    ----------
    scene
        A linear structure with impact pairs under Gaussian noise of any kind and constant loads,
        and sines or shocks of a shape beside it. The stops of one oscillator do not matter where
        distances are given.
    clearances
        (levels,): distances of two stops of one oscillator from its mean position, m.
    lower, upper
        Instead: (levels,), distances of its lower and of its upper stop; leave one out for one
        stop. Or (levels, pairs), distances of the stops of pairs from their mean gaps, m, infinite
        for none; by default those of the scene, at one level.
    **options
        `AccuracyOptions`: `rel_error` is that of the probability of an impact in `mission` seconds,
        at every level where that probability is below 1/2; at the end of the `budget` it ends with
        larger errors.

    Raises
    ------
    NotApplicable
        If the motion without stops is not a stationary Gaussian process, beside sines about a mean
        that moves.

    Examples
    --------
    >>> from stochvi.scenes.excitations import WhiteNoise
    >>> from stochvi.scenes.structures import Oscillator
    >>> scene = Scene(
    ...     structure=Oscillator(mass=1.0, damping=0.1, stiffness=1.0),
    ...     excitations=[WhiteNoise(intensity=0.2)],
    ... )
    >>> rate = first_crossings(scene, [3.0]).first_rate()[0]
    >>> abs(rate.value - 0.0018091405) < 4.5 * rate.standard_error + rate.bias
    True

    Two rods between the same two masses are hit together, and count once.

    >>> from stochvi import ImpactPair, Matrices, Restitution
    >>> stops = {"lower": -3.0, "upper": 3.0, "law": Restitution(coefficient=0.5)}
    >>> scene = Scene(
    ...     structure=Matrices(
    ...         coordinates=("x", "z"), mass=[[1, 0], [0, 1]],
    ...         damping=[[0.1, 0], [0, 0.1]], stiffness=[[1, 0], [0, 1]],
    ...     ),
    ...     impact_pairs=[ImpactPair(name=name, on="x", **stops) for name in ("left", "right")],
    ...     excitations=[WhiteNoise(intensity=0.2, on="x")],
    ... )
    >>> rate = first_crossings(scene).first_rate()[0]
    >>> abs(rate.value - 0.0018091405) < 4.5 * rate.standard_error + rate.bias
    True
    """
    run, model = Run.of(options), model_of(scene)
    given = [np.ndim(each) for each in (clearances, lower, upper) if each is not None]
    if given and max(given) < 2:
        below, above = _levels(clearances, lower, upper)
        lower, upper, model = below[:, None], above[:, None], one_gap(model)
    return PairMotion.under_shocks(model).crossings(lower, upper, mission, run)


def one_gap(model: Model) -> Model:
    """One oscillator whose displacement is a gap, with no stops of its own.

    Raises `NotApplicable` if its motion is not a stationary Gaussian process of one oscillator,
    shocks beside it left out.
    """
    free = replace(model, pairs=())
    unmet = (
        beyond_one_oscillator(free, with_filters=True, with_sines=True)
        or without_noise(free)
        or without_free_response(free)
        or not_gaussian(replace(free, drawn=()))
    )
    if unmet:
        raise NotApplicable("first_crossings", unmet)
    gap = Pair(
        name=model.coordinates[0], direction=np.ones(1), mass=model.unit_mass, relative=False,
        stops=(),
    )  # fmt: skip
    return replace(free, pairs=(gap,))


def _levels(
    clearances: ArrayLike | None, lower: ArrayLike | None, upper: ArrayLike | None
) -> tuple[Vector, Vector]:
    """(levels,): distances below and above, infinite for no stop."""
    if clearances is not None:
        if lower is not None or upper is not None:
            raise ValueError("give clearances, or lower and upper, not both")
        lower = upper = clearances
    size = max(0 if side is None else np.size(side) for side in (upper, lower))
    above, below = (
        np.full(size, math.inf) if side is None else np.atleast_1d(np.asarray(side, dtype=float))
        for side in (upper, lower)
    )
    if len(above) != len(below):
        raise ValueError(f"needs as many lower as upper stops, got {len(below)} and {len(above)}")
    if not (np.all(above > 0.0) and np.all(below > 0.0)):
        raise ValueError("distances of stops must be positive, m from the mean position")
    return below, above
