"""Impacts at one clearance on stops of many stiffnesses, from the same motions.

Where first impacts are rare, a trial is a cluster from its first impact on; fast first impacts are
drawn more often, and weighted. Where they are not, it is a record of the whole motion. The motion
without stops is made once, and what stops of each stiffness make of it is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.model import Model
from stochvi.results.deadline import Deadline
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import jackknife_error
from stochvi.sampling.sampler import TrialSampler
from stochvi.sampling.stop_flag import given_up_after
from stochvi.statistics.bursts import UNFINISHED
from stochvi.statistics.cluster_paths import FLOWN_SAMPLES, WINDOWS, ClusterPaths
from stochvi.statistics.damage.clusters import PAST_LARGEST
from stochvi.statistics.damage.extremes import GROUPS, exceedance

WIDENING = 2.5
"""Factor on the speeds of every second first impact, so that rare hard impacts are seen as well."""

LEVELS = 400
"""Number of speeds at which the rate of trials with a faster impact is known."""

FEWEST = 5
"""Smallest number of trials with an impact from which a speed is found."""

TINY = 1e-9
"""Smallest speed of an impact over the largest one of a `Curve`."""

NEVER = 1e-300
"""Rate of events that are not seen, 1/s, so that its logarithm is finite."""


class Curve(NamedTuple):
    """Speeds of impacts that rise from 0, m/s, and a quantity of the contacts that would follow on
    a base at rest."""

    speed: Vector
    value: Vector


ROWS = 7
"""Number of quantities of a trial, see `TrialPart`."""


class TrialPart(NamedTuple):
    """What one block of paths gives.

    Parameters
    ----------
    ages
        Ages of its crossings, see `cluster_paths.Part`.
    path, weight
        (trials,): path of each trial, and its weight, as in `Bursts`; 1 of records.
    fastest, sharpest, hardest, deepest
        (stiffnesses, trials): fastest impact, m/s; and the largest absolute acceleration (m/s^2),
        force (N) and deflection (m) in contacts; 0 without a contact.
    hits, late, squares
        (stiffnesses, trials): number of impacts, and of those in the second half of the trial; and
        the sum of the squares of their speeds, m^2/s^2.
    """

    ages: NDArray[np.float32]
    path: NDArray[np.int64]
    weight: Vector
    fastest: Matrix
    sharpest: Matrix
    hardest: Matrix
    deepest: Matrix
    hits: Matrix
    late: Matrix
    squares: Matrix


@dataclass(frozen=True, eq=False)
class ClearanceTrials(TrialSampler):
    """Trials at one clearance, with the stops of all `models`, which are at the same places."""

    clusters: ClusterPaths
    models: tuple[Model, ...]

    @cached_property
    def apart(self) -> bool:
        """Whether trials are clusters, because Rice's crossings in one are few."""
        records = self.clusters.records
        return float(records.rice_rates.sum()) * WINDOWS * records.horizon < UNFINISHED

    @property
    def block(self) -> int:
        """Number of paths that are made together."""
        return self.clusters.together

    @cached_property
    def seconds(self) -> float:
        """Length of a trial, s."""
        motion = self.clusters.motion
        return (motion.window if self.apart else motion.response.samples) * motion.response.step

    @cached_property
    def _between(self) -> list[ClusterPaths]:
        return [self.clusters.between(model) for model in self.models]

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> TrialPart:
        """The part of one block of paths; `GivenUp` where it outlasts the budget.

        The first block of a clearance is needed, and may outlast the share of that clearance.
        """
        with given_up_after(deadline.sooner_by(-(deadline.budget or 0.0))):
            return self._part(first_path)

    def _part(self, first_path: int) -> TrialPart:
        clusters = self.clusters
        free = clusters.free(first_path)
        if not self.apart:
            plan, motion = clusters.plans[1], clusters.whole(free)
            burn_in = min(math.ceil(plan.burn_in / plan.step), len(motion) - 1)
            found = self._followed(motion, burn_in, len(motion))
            none = np.zeros((1, 0, 1, len(free), 0), np.float32)
            return TrialPart(none, first_path + np.arange(len(free)), np.ones(len(free)), *found)
        ages, chosen = clusters.first_impacts(free, first_path, WIDENING)
        size = max(1, FLOWN_SAMPLES // (2 * clusters.motion.window * clusters.model.modal.size))
        path, weight = [np.zeros(0, np.int64)], [np.zeros(0)]
        columns = [np.zeros((ROWS, len(self.models), 0))]
        for each in chosen:
            for one in each.parts(size):
                starts = clusters.records.starts[one.start]
                motion = clusters.around(free, one.side, one.path, starts, one.draws, one.sign)
                columns.append(self._followed(motion))
                path.append(first_path + one.path)
                weight.append(one.weight)
        return TrialPart(
            ages, np.concatenate(path), np.concatenate(weight), *np.concatenate(columns, axis=2)
        )

    def _followed(
        self, motion: NDArray[np.float64], burn_in: int = 0, counted: int | None = None
    ) -> NDArray[np.float64]:
        """The last rows of a part, (ROWS, stiffnesses, trials)."""
        trials = motion.shape[2] // 2
        found = np.zeros((ROWS, len(self.models), trials))
        for row, clusters in enumerate(self._between):
            impacts, sums, *extremes = clusters.follow(
                motion, accelerations=True, burn_in=burn_in, counted=counted
            )
            of = {name: k for k, name in enumerate(clusters.plans[1].sums_of_pair)}
            (pair,) = sums
            late = impacts[0, impacts[2] > 0.5 * self.seconds].astype(int)
            found[:, row] = (
                clusters.fastest(impacts, trials)[0], *(each[:, 0] for each in extremes),
                pair[of["n_lower"]] + pair[of["n_upper"]], np.bincount(late, minlength=trials),
                pair[of["f2_lower"]] + pair[of["f2_upper"]],
            )  # fmt: skip
        return found


@dataclass(frozen=True, eq=False)
class Trials:
    """All trials so far at one clearance and stiffness, and what follows from them."""

    sampler: ClearanceTrials
    first_rate: Estimate | None
    part: TrialPart
    row: int

    @property
    def overlap(self) -> float:
        """Expected number of other first impacts in the time of a cluster."""
        rate = self.first_rate
        return 0.0 if rate is None else rate.value * self.sampler.seconds

    @property
    def unfinished(self) -> float:
        """Share of the impacts in the second half of clusters, without those of new ones."""
        total = float(self.part.weight @ self.part.hits[self.row])
        if self.first_rate is None or not total:
            return 0.0
        return float(self.part.weight @ self.part.late[self.row]) / total - 0.5 * self.overlap

    @cached_property
    def _groups(self) -> list[NDArray[np.int64]]:
        """Trials that remain without each group of paths."""
        paths = np.unique(self.part.path)
        return [
            np.flatnonzero(~np.isin(self.part.path, group))
            for group in np.array_split(paths, min(GROUPS, len(paths)))
        ]

    def level(
        self, largest: Matrix, wanted: float, curve: Curve | None = None
    ) -> tuple[float, float, float]:
        """Value that the `largest` ones (stiffnesses, trials) exceed `wanted` times a second, its
        standard error, and its bias; 0 where impacts are rarer. NaN where too few were seen.

        Speeds are extrapolated, and what is no speed as the speed that would give it by `curve`.
        """
        everything, own = np.arange(len(self.part.path)), largest[self.row]
        if np.count_nonzero(own) < FEWEST:
            return math.nan, math.nan, math.nan
        if curve is not None:
            least = TINY * curve.speed[-1]
            own = np.where(own > 0.0, np.interp(own, curve.value, curve.speed).clip(least), 0.0)
        levels = np.linspace(0.0, PAST_LARGEST * float(own.max()), LEVELS)

        def at(kept: NDArray[np.int64], rate: float = wanted, square: bool = True) -> float:
            rates = np.maximum(self._rates(own, kept, levels, square), NEVER)
            if rates[0] < rate:
                return 0.0
            speed = float(np.interp(-math.log(rate), -np.log(rates), levels))
            return speed if curve is None else float(np.interp(speed, curve.speed, curve.value))

        value = at(everything)
        error = float(jackknife_error(np.array([at(kept) for kept in self._groups])))
        bias = abs(at(everything, square=False) - value)
        if self.first_rate is not None:
            relative = self.first_rate.standard_error / self.first_rate.value
            factor = 1.0 + relative if value else 1.0 / (1.0 + relative)
            error = math.hypot(error, value - at(everything, wanted * factor))
            bias += value - at(everything, wanted * (1.0 + self.overlap))
        return value, error, bias

    def _rates(self, own: Vector, kept: NDArray[np.int64], levels: Vector, square: bool) -> Vector:
        """Trials per second in which the largest one, of those in `own`, is beyond each level."""
        weight, largest = self.part.weight[kept], own[kept]
        struck = largest > 0.0
        share = exceedance(largest[struck], weight[struck], levels, square)
        share *= weight[struck].sum() / weight.sum()
        if self.first_rate is None:
            return -np.log1p(-np.minimum(share, 1.0 - 1e-12)) / self.sampler.seconds
        return self.first_rate.value / (1.0 + self.overlap) * share

    def per_second(self) -> tuple[float, float]:
        """Impacts per second, and their standard error."""
        every = 1.0 / self.sampler.seconds
        relative = 0.0
        if self.first_rate is not None:
            every = self.first_rate.value / (1.0 + self.overlap)
            relative = self.first_rate.standard_error / self.first_rate.value
        mean, error = self._ratio(self.part.hits[self.row], np.ones(len(self.part.path)))
        return every * mean, every * math.hypot(error, relative * mean)

    def mean_square_speed(self) -> tuple[float, float]:
        """Mean square of the impact speeds, m^2/s^2, and its standard error."""
        return self._ratio(self.part.squares[self.row], self.part.hits[self.row])

    def _ratio(self, above: Vector, below: Vector) -> tuple[float, float]:
        top, bottom = self.part.weight * above, self.part.weight * below
        if not bottom.any():
            return math.nan, math.nan
        left = [top[kept].sum() / max(float(bottom[kept].sum()), NEVER) for kept in self._groups]
        value = float(top.sum() / bottom.sum())
        return value, float(jackknife_error(np.array(left)))


def trials_of(sampler: ClearanceTrials, parts: Sequence[TrialPart]) -> list[Trials]:
    """The trials so far, stiffness by stiffness."""
    ages = np.concatenate([part.ages for part in parts], axis=3)
    rate = sampler.clusters.found(ages).first_rate()[0] if sampler.apart else None
    joined = [np.concatenate(each, axis=-1) for each in zip(*(p[1:] for p in parts), strict=True)]
    whole = TrialPart(ages, *joined)
    return [Trials(sampler, rate, whole, row) for row in range(len(sampler.models))]
