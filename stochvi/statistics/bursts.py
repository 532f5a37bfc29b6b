"""Impact clusters, simulated from their first impact on.

Impacts of an isolator whose stops are far come in clusters. A first impact meets the motion that
the mass has without stops; others follow from it. Crude simulation has to wait for clusters; here
every record begins with one. First impacts are outcrossings of the free response without another
one in the memory of the process before (`pair_crossings`). From there the engine simulates on with
the stops (`cluster_paths`). Let lambda be the limiting rate of first impacts, and clusters be far
apart. A quantity with the mean q in a cluster then happens lambda q times a second, however rare
that is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.model.model import model_of
from stochvi.results.deadline import Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate, of_events
from stochvi.results.hardness import is_speed
from stochvi.results.intervals import jackknife_ratio, upper_limit_unseen
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import TrialSampler
from stochvi.scenes.scene import Scene
from stochvi.statistics.cluster_paths import WINDOWS, ClusterPaths, Part
from stochvi.statistics.crossing_ages import FEWEST_PATHS, LEAST_PATHS

UNFINISHED = 0.05
"""Clusters do not seem to end from this share of the impacts in the second half of the window on.
They meet from this expected number of other first impacts in the window on."""

LOOK = 4
"""Number of paths, as a multiple of FEWEST_PATHS, after which the simulation ends if it has seen
nothing of the `wanted` quantity."""

FAR, DOUBT = 2.0, 4.0
"""A value needs no more accuracy once it lies beyond the factor `FAR` from the wanted value. It
must lie there by more than `DOUBT` standard errors of its logarithm."""

FEWEST_WITH_BURSTS = 8
"""Smallest number of paths with a first impact among their crossings from which a standard error is
taken."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bursts:
    """Clusters that followed first impacts, each with its weight.

    Parameters
    ----------
    first_rate
        Limiting rate of first impacts, 1/s.
    window, horizon
        Time for which each cluster was simulated, and time without an impact before it, s.
    pairs, outputs
        Names of the pairs, and of the coordinates and named points whose accelerations are
        followed.
    path
        (clusters,) number of the path from which each cluster comes: paths are independent.
    weight
        (clusters,): probability of its slope over that with which it was drawn, times Rice's rate
        of crossings of the stop that it begins at.
    early_hits
        (clusters,): impacts above the speed threshold in the first half of the window, on any pair.
    hits, speeds, fastest
        (pairs, clusters): impacts above the speed threshold, the sum of all impact speeds, and the
        largest one (m/s).
    sharpest
        (outputs, clusters): largest absolute acceleration (m/s^2, or rad/s^2) while a stop is
        touched. Rigid impacts have none.

    See Also
    --------
    stochvi.size : The sizing that uses clusters where impacts are rare.
    """

    first_rate: Estimate
    window: float
    horizon: float
    pairs: tuple[str, ...]
    outputs: tuple[str, ...]
    path: NDArray[np.int64]
    weight: Vector
    early_hits: Vector
    hits: Matrix
    speeds: Matrix
    fastest: Matrix
    sharpest: Matrix

    @property
    def paths(self) -> int:
        """Number of independent paths with a cluster."""
        return len(np.unique(self.path))

    @property
    def overlap(self) -> float:
        """Expected number of other first impacts in the window that is simulated; the rates of this
        class need it to be small."""
        return self.first_rate.value * self.window

    @property
    def unfinished(self) -> float:
        """Share of the impacts in the second half of the window, without those of new clusters."""
        total = float(np.sum(self.weight * self.hits.sum(axis=0)))
        if total == 0.0:
            return 0.0
        late = 1.0 - float(np.sum(self.weight * self.early_hits)) / total
        return max(late - 0.5 * self.first_rate.value * self.window, 0.0)

    @property
    def apart(self) -> bool:
        """Whether clusters end within the window and seldom meet other clusters."""
        return self.overlap < UNFINISHED and self.unfinished < UNFINISHED

    def hits_per_burst(self) -> Estimate:
        """Mean number of impacts in a cluster."""
        return self._mean(self.hits.sum(axis=0))

    def hit_rate(self, pair: str | None = None) -> Estimate:
        """Impacts per second on the stops of all pairs, or of one."""
        return self._rate(self.hits[self._pairs(pair)].sum(axis=0))

    def impact_speed_mean(self, pair: str | None = None) -> Estimate:
        """Mean impact speed of all impacts, or of those on one pair, m/s."""
        chosen = self._pairs(pair)
        return self._ratio(self.speeds[chosen].sum(axis=0), self.hits[chosen].sum(axis=0))

    def largest(self, name: str, outputs: Sequence[str] | None = None) -> Vector:
        """(clusters,): the largest "impact_speed" of all pairs, or the largest "peak_acceleration"
        of some outputs, by default of all."""
        if is_speed(name):
            return np.asarray(self.fastest.max(axis=0))
        known = self.outputs
        rows = [known.index(each) for each in (known if outputs is None else outputs)]
        return np.asarray(self.sharpest[rows].max(axis=0))

    def exceedance_rate(
        self, name: str, limit: float, outputs: Sequence[str] | None = None
    ) -> Estimate:
        """Clusters per second of which the `largest` is above a limit."""
        return self._rate((self.largest(name, outputs) > limit).astype(float))

    def _pairs(self, pair: str | None) -> list[int]:
        """Rows of one pair, or of all."""
        return [*range(len(self.pairs))] if pair is None else [self.pairs.index(pair)]

    def _rate(self, what: Vector) -> Estimate:
        """`first_rate` times the mean of `what` in a cluster, without what new clusters add to the
        window.

        Symbols: h the horizon; d the time from a first impact until h has passed without one; m the
        mean of `what` in that time. Such times begin once in 1 / lambda + d seconds (renewal), so
        the rate is lambda m / (1 + lambda d). The window w holds m (1 + lambda (w - d)) of it, to
        first order in lambda: together lambda mean / (1 + lambda w). The bias states all of that.
        Where no cluster has any of it, the upper limit is taken as if the cluster of the largest
        weight had it.
        """
        mean = self._mean(what)
        rate = self.first_rate.value / (1.0 + self.overlap)
        value = rate * mean.value
        relative = math.hypot(
            self.first_rate.standard_error / self.first_rate.value,
            mean.standard_error / mean.value if mean.value else 0.0,
        )
        if not value:
            how = f"none of {len(self.path)} clusters"
            return Estimate(value=0.0, bias=None, how=how, upper_95=self._most_unseen)
        known = (self.first_rate.bias or 0.0) / self.first_rate.value
        return Estimate(
            value=value,
            standard_error=relative * value,
            bias=(known + self.overlap) * value,
            how=f"{len(self.path)} clusters; bias: clusters that meet",
        )

    @property
    def _most_unseen(self) -> float:
        """Upper limit of a rate of which no cluster has any, 1/s."""
        share = float(self.weight.max() / self.weight.sum())
        return self.first_rate.value * upper_limit_unseen(1.0) * share

    def limited(self, rate: Estimate) -> Estimate:
        """A rate, or its upper limit where too few clusters have any of it. That is never below the
        limit where none has: a cluster of small weight says nothing of those of large weight."""
        found = of_events(rate, self.paths)
        if found.upper_95 is None:
            return found
        return replace(found, upper_95=max(found.upper_95, self._most_unseen))

    def _mean(self, what: Vector) -> Estimate:
        return self._ratio(what, np.ones_like(what))

    def _ratio(self, above: Vector, below: Vector) -> Estimate:
        """Ratio of weighted sums, jackknife over paths."""
        count = int(self.path.max()) + 1
        top, bottom = (
            np.bincount(self.path, self.weight * each, count).astype(float)
            for each in (above, below)
        )
        value, error = jackknife_ratio(top, bottom)
        return Estimate(value=value, standard_error=error, how=f"{len(self.path)} clusters")


def chance_of(rate: Estimate, mission: float, reach: float = 0.0) -> Estimate:
    """Probability that an event of this rate happens in a mission, 1 - exp(-rate mission); clusters
    that began before the mission, or end after it, leave a relative bias `reach`."""
    value = -math.expm1(-rate.value * mission)
    upper = None if rate.upper_95 is None else -math.expm1(-rate.upper_95 * mission)
    found = rate * (mission * (1.0 - value))
    bias = None if found.bias is None else found.bias + reach * value * (1.0 - value)
    return replace(found, value=value, upper_95=upper, bias=bias)


@sampled(rel_error=0.05)
def bursts(
    scene: Scene,
    *,
    wanted: Callable[[Bursts], Estimate] = Bursts.hit_rate,
    widening: float = 1.0,
    far_from: float | None = None,
    **options: Unpack[AccuracyOptions],
) -> Bursts:
    """Simulate clusters at the stops of a scene until `wanted` is known to `rel_error`.

    Ends before that where the budget does, or where nothing `wanted` is seen.

    Parameters
    ----------
    widening
        Half of the first impacts are drawn this many times faster, and weighted with what that
        makes of their probability: for exceedances of speeds that few impacts reach.
    far_from
        A value of `wanted` that is searched for: where what is found lies beyond doubt more than a
        factor FAR away from it, no more accuracy is needed.
    **options
        `AccuracyOptions`.

    Raises
    ------
    NotApplicable
        As for `first_crossings`, or where a law cannot be simulated.
    """
    run = Run.of(options)
    clusters = ClusterPaths(model_of(scene), run.seed)
    sampler = BurstSampler(clusters, widening)

    def error_of(parts: list[Part]) -> float:
        found = _join(clusters, parts)
        estimate = wanted(found)
        if is_far(estimate, far_from) and is_far(found.limited(estimate), far_from):
            return 0.0
        if estimate.value == 0.0:
            return 0.0 if sampler.paths(parts) >= LOOK * FEWEST_PATHS else math.inf
        return estimate.standard_error / estimate.value

    taken = run.to_accuracy(sampler, FEWEST_PATHS, error_of, run.accuracy, needed=2 * LEAST_PATHS)
    found = _join(clusters, taken.sample)
    if run.deadline.interrupted:
        raise run.deadline.fell_short(f"after {taken.paths} paths", "", found)
    return found


@dataclass(frozen=True, eq=False)
class BurstSampler(TrialSampler):
    """Crossings and the clusters after them, in blocks of paths."""

    clusters: ClusterPaths
    widening: float

    @property
    def block(self) -> int:
        """Number of paths that are made together."""
        return self.clusters.together

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> Part:
        """The part of one block of paths."""
        return self.clusters.part(self.widening, first_path)


def is_far(estimate: Estimate, place: float | None) -> bool:
    """Whether an estimate lies beyond doubt more than a factor FAR from a place."""
    if place is None or not estimate.value:
        return place is not None and (estimate.upper_95 or math.inf) < place / FAR
    # of the logarithm: one cluster beyond a limit has a standard error of its own size, but says no
    # more than the order of magnitude
    doubt = math.exp(DOUBT * min(estimate.standard_error / estimate.value, DOUBT))
    return estimate.value * doubt < place / FAR or estimate.value / doubt > place * FAR


def _join(clusters: ClusterPaths, parts: list[Part]) -> Bursts:
    """All clusters so far."""
    found = clusters.found(np.concatenate([part.ages for part in parts], axis=3))
    columns = np.concatenate([part.bursts for part in parts], axis=1)
    if len(np.unique(columns[0])) < FEWEST_WITH_BURSTS:
        raise NotApplicable("bursts", ["stops as near as these are hit without a pause"])
    path, weight, early = columns[:3]
    pairs, outputs = clusters.pairs, clusters.outputs
    hits, speeds, fastest, sharpest = np.split(columns[3:], len(pairs) * np.arange(1, 4))
    return Bursts(
        first_rate=found.first_rate()[0],
        window=WINDOWS * found.horizon,
        horizon=found.horizon,
        pairs=pairs,
        outputs=outputs,
        path=path.astype(np.int64),
        weight=weight,
        early_hits=early,
        hits=hits,
        speeds=speeds,
        fastest=fastest,
        sharpest=sharpest,
    )
