"""Damage where impacts are rare: clusters of impacts, each beside the same motion without stops.

A first impact meets the motion that the place has without stops (`statistics.bursts`). Records of
its acceleration begin a memory of the equipment before the impact. From there the motion goes on
with the stops, and once more without. Let lambda be the rate of first impacts, and clusters be far
apart. What the stops add to a sum over a cluster is then added lambda times a second to the sum of
the Gaussian motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.methods.monte_carlo.impact_logs import ImpactLog
from stochvi.methods.monte_carlo.kernels.equipment import BEFORE, NODES
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.estimates import Estimate
from stochvi.results.intervals import jackknife_error, upper_limit_unseen
from stochvi.sampling.sampler import TrialSampler
from stochvi.sampling.stop_flag import given_up_after
from stochvi.statistics.accelerations import carried_forces, pair_forces, velocity_jumps
from stochvi.statistics.bursts import UNFINISHED
from stochvi.statistics.cluster_paths import ClusterPaths, Records
from stochvi.statistics.damage.equipment import Equipment
from stochvi.statistics.damage.extremes import GROUPS, exceedance
from stochvi.statistics.damage.gaussian import LEVELS, GaussianEquipment
from stochvi.statistics.damage.records import contacts_above

PAST_LARGEST = 4.0
"""Largest level of an extreme over the largest response to the clusters that were simulated."""

RECORDED = 2**21
"""Largest number of samples of acceleration that are held together."""


class ClusterPart(NamedTuple):
    """What one block of paths gives.

    Parameters
    ----------
    ages
        Ages of its crossings, see `cluster_paths.Part`.
    path, weight
        (clusters,): path of each cluster, and its weight, as in `Bursts`.
    damage, squares, below, peaks
        (clusters, equipment): damage and integral of y^2 that the stops add; integral of a^2 below
        each frequency that they add; and the largest |y| with them.
    hits, late, work, loss
        (clusters,): impacts, those of the second half of the window, energy and loss, J.
    above
        (clusters, levels): contacts above each acceleration.
    """

    ages: NDArray[np.float32]
    path: NDArray[np.int64]
    weight: Vector
    damage: Matrix
    squares: Matrix
    below: Matrix
    peaks: Matrix
    hits: Vector
    late: Vector
    work: Vector
    loss: Vector
    above: Matrix


@dataclass(frozen=True, eq=False)
class ClusterSampler(TrialSampler):
    """Clusters at the stops of a scene, and the equipment on a place row . q."""

    clusters: ClusterPaths
    equipment: Equipment
    row: tuple[float, ...]
    levels: tuple[float, ...]

    @property
    def block(self) -> int:
        """Number of paths that are made together."""
        return self.clusters.together

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.clusters.motion.response.step

    @cached_property
    def before(self) -> int:
        """Samples before the first impact, a memory of the equipment."""
        return BEFORE + math.ceil(self.equipment.memory / self.step)

    @cached_property
    def after(self) -> int:
        """Samples from the first impact on."""
        return max(self.clusters.motion.window, self.before) + NODES

    @property
    def fits(self) -> bool:
        """Whether records are long enough for the memory of the equipment."""
        return self.before + self.after <= self.clusters.motion.response.samples // 2

    @property
    def window(self) -> int:
        """Samples in which the equipment is counted."""
        return self.after - NODES

    @property
    def seconds(self) -> float:
        """Length of the window, s."""
        return self.window * self.step

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> ClusterPart:
        """The part of one block of paths."""
        with given_up_after(deadline) if deadline != NEVER else nullcontext():
            return self._trial(first_path)

    def _trial(self, first_path: int) -> ClusterPart:
        clusters = self.clusters
        free = clusters.free(first_path)
        ages, chosen = clusters.first_impacts(free, first_path)
        at_once = max(1, RECORDED // (2 * (self.before + self.after)))
        found = [self._empty()]
        for one in chosen:
            for some in one.parts(at_once):
                motion = clusters.recorded(free, some, self.before, self.after)
                found.append(self._cluster(motion, first_path + some.path, some.weight))
        joined = [np.concatenate(part) for part in zip(*found, strict=True)]
        return ClusterPart(ages, *joined)

    def _empty(self) -> tuple[Any, ...]:
        wide, one = np.zeros((0, len(self.equipment.frequency_hz))), np.zeros(0)
        none = np.zeros((0, len(self.levels)))
        return np.zeros(0, int), one, wide, wide, wide, wide, one, one, one, one, none

    def _cluster(
        self, motion: NDArray[np.float64], path: NDArray[np.int64], weight: Vector
    ) -> tuple[Any, ...]:
        """Rows of a part, from the modal motion without stops (samples, modes, 2 clusters)."""
        clusters, before = self.clusters, self.before
        plan, model, count = clusters.plans[1], clusters.model, len(path)
        n = plan.modes.size
        record, impacts, sums = clusters.recorded_with_stops(motion[before - 1 :])
        weights: Vector = np.linalg.solve(model.mass, np.array(self.row)).astype(float)
        rest = (plan.modes.shapes @ plan.modes.rest)[:, None, None]

        # (modes, clusters, samples)
        free = motion.reshape(len(motion), n, count, 2).transpose(3, 1, 2, 0)
        x = np.tensordot(plan.modes.shapes, free[0], axes=1) + rest
        v = np.tensordot(plan.modes.shapes, plan.scale * free[1], axes=1)
        linear = carried_forces(model, x, v, {}, weights)
        states = record.transpose(2, 1, 0)
        x = np.tensordot(plan.modes.shapes, states[:n], axes=1) + rest
        v = np.tensordot(plan.modes.shapes, states[n : 2 * n], axes=1)
        forces = pair_forces(model, x, v)
        with_stops = carried_forces(model, x, v, forces, weights)
        struck = np.concatenate([linear[:, :before], with_stops], axis=1)
        logs, jumps = self._logs(impacts), None
        if any(stop.rigid for stop in model.stops):
            own = velocity_jumps(model, weights, logs, states[2 * n :], self.step)
            jumps = np.zeros((2 * count, struck.shape[1]))
            jumps[:count, before:] = own
        records = np.concatenate([struck, linear])
        below = self._below(records if jumps is None else records + jumps / self.step)
        answer = self.equipment.respond(records, self.step, before, self.window, 1, jumps)
        wear = answer.damage + answer.closing
        squares = self.seconds * answer.squares
        hits, late, work, loss = self._impacts(logs, sums)
        above = np.zeros((count, len(self.levels)))
        for force in forces.values():
            above += [
                contacts_above(pushed, a, self.levels)
                for pushed, a in zip(force, with_stops, strict=True)
            ]
        return (
            path, weight, wear[:count] - wear[count:], squares[:count] - squares[count:],
            below[:count] - below[count:], answer.peaks[:count, 0], hits, late, work, loss, above,
        )  # fmt: skip

    def _below(self, records: Matrix) -> Matrix:
        """Integrals of the squares of records from the first impact on, below each frequency."""
        kept = records[:, self.before :]
        size = next_fast_len(kept.shape[1], real=True)
        powers = np.abs(rfft(kept, size, axis=1)) ** 2 * (2.0 * self.step / size)
        powers[:, 0] *= 0.5
        total = np.cumsum(powers, axis=1)
        bins = np.array(self.equipment.frequency_hz) * size * self.step
        return np.array([np.interp(bins, np.arange(powers.shape[1]), each) for each in total])

    def _logs(self, impacts: Matrix) -> dict[str, ImpactLog]:
        """Impacts by pair, at times from the first impact on."""
        path, pair, time, speed = impacts
        found = {}
        for number, name in enumerate(self.clusters.pairs):
            own = pair == number
            found[name] = ImpactLog(
                path=path[own].astype(np.int64), time=time[own] - self.step, speed=speed[own]
            )
        return found

    def _impacts(self, logs: dict[str, ImpactLog], sums: Records) -> tuple[Vector, ...]:
        """Impacts, late ones, energy and loss of each cluster."""
        hits, late, work, loss = np.zeros((4, sums.shape[2]))
        names = self.clusters.plans[1].sums_of_pair
        for pair, added in zip(self.clusters.model.pairs, sums, strict=True):
            log = logs[pair.name]
            np.add.at(hits, log.path, 1.0)
            np.add.at(late, log.path, log.time > 0.5 * self.seconds)
            np.add.at(work, log.path, 0.5 * pair.mass * log.speed**2)
            for stop in pair.stops:
                if stop.summed:
                    loss += pair.mass * added[names.index(f"loss_{stop.name}")]
                    continue
                square = added[names.index(f"f2_{stop.name}")]
                loss += 0.5 * pair.mass * (1.0 - stop.law.restitution_mean_square) * square
        return hits, late, work, loss


@dataclass(frozen=True, eq=False)
class Clusters:
    """All clusters so far, and what follows from them by the second."""

    sampler: ClusterSampler
    part: ClusterPart

    @cached_property
    def first_rate(self) -> Estimate:
        """Rate of first impacts, 1/s."""
        return self.sampler.clusters.found(self.part.ages).first_rate()[0]

    @property
    def overlap(self) -> float:
        """Expected number of other first impacts in a window."""
        return self.first_rate.value * self.sampler.seconds

    @property
    def apart(self) -> bool:
        """Whether clusters end within the window and seldom meet."""
        total = float(self.part.weight @ self.part.hits)
        late = float(self.part.weight @ self.part.late) / total if total else 0.0
        return self.overlap < UNFINISHED and late - 0.5 * self.overlap < UNFINISHED

    @cached_property
    def _groups(self) -> list[NDArray[np.int64]]:
        """Clusters by group of paths."""
        paths = np.unique(self.part.path)
        return [
            np.flatnonzero(np.isin(self.part.path, group))
            for group in np.array_split(paths, min(GROUPS, len(paths)))
        ]

    def rates(self, what: NDArray[np.float64]) -> tuple[Vector, Vector]:
        """Rate per second of a quantity (clusters, ...), and its standard error."""
        weight = self.part.weight
        top = np.array([weight[g] @ what[g] for g in self._groups])
        bottom = np.array([weight[g].sum() for g in self._groups])
        whole = np.einsum("c,c...->...", weight, what) / weight.sum()
        left = (top.sum(axis=0) - top).T / (bottom.sum() - bottom)
        error = np.asarray(jackknife_error(left))
        rate = self.first_rate.value / (1.0 + self.overlap)
        share = self.first_rate.standard_error / self.first_rate.value
        return rate * whole, rate * np.hypot(error, share * np.abs(whole))

    def rate(self, counts: Vector, factor: float, events: bool = True) -> Estimate:
        """Events, or energy, per `factor` seconds; no energy has no upper limit."""
        value, error = self.rates(counts)
        how = f"{len(self.part.path)} clusters; bias: clusters that meet"
        if not value and not events:
            return Estimate(value=0.0, bias=None, how=f"none in {how}")
        if not value:
            most = upper_limit_unseen(1.0) * float(self.part.weight.max() / self.part.weight.sum())
            return Estimate(
                value=0.0, bias=None, how=f"none of {len(self.part.path)} clusters",
                upper_95=factor * self.first_rate.value * most,
            )  # fmt: skip
        bias = (self.first_rate.bias or 0.0) / self.first_rate.value + self.overlap
        return Estimate(
            value=factor * float(value), standard_error=factor * float(error),
            bias=factor * bias * float(value), how=how,
        )  # fmt: skip

    def extremes(
        self, gaussian: GaussianEquipment, mission: float, probabilities: Sequence[float]
    ) -> tuple[Vector, Vector, Vector, Matrix]:
        """Expected largest |y| of a mission with its standard error and bias, and the levels of
        probabilities: the largest of the Gaussian motion, or of a cluster."""
        rms = gaussian.rms
        clumps, crossings = gaussian.exceedance_rates(LEVELS)
        count = len(rms)
        value, error, bias = np.zeros((3, count))
        quantiles = np.empty((len(probabilities), count))
        everything = np.arange(len(self.part.weight))
        for i in range(count):
            top = max(LEVELS[-1] * rms[i], PAST_LARGEST * float(self.part.peaks[:, i].max()))
            levels = np.linspace(0.0, top, len(LEVELS))
            calm, other = (
                np.interp(levels, LEVELS * rms[i], each[i], right=0.0)
                for each in (clumps, crossings)
            )
            below = partial(self._below, i, levels, mission)
            whole = below(everything, calm)
            value[i] = _mean_of(whole, levels)
            for chance in (below(everything, calm, square=False), below(everything, other)):
                bias[i] += abs(_mean_of(chance, levels) - value[i])
            left = [
                _mean_of(below(np.setdiff1d(everything, group), calm), levels)
                for group in self._groups
            ]
            error[i] = jackknife_error(np.array(left))
            quantiles[:, i] = np.interp(probabilities, whole, levels)
        return value, error, bias, quantiles

    def _below(
        self, equipment: int, levels: Vector, mission: float, kept: NDArray[np.int64],
        calm: Vector, square: bool = True,
    ) -> Vector:  # fmt: skip
        """Probability that the largest response of a mission stays below levels, from some clusters
        and the rates without stops."""
        peaks, weight = self.part.peaks[kept, equipment], self.part.weight[kept]
        beyond = exceedance(peaks, weight, levels, square)
        rate = calm + self.first_rate.value * beyond
        return np.asarray(np.exp(-np.minimum(rate * mission, 700.0)))

    def shock(self, probability: float) -> Vector:
        """Level below which the response to a cluster stays with a probability."""
        order = np.argsort(self.part.peaks, axis=0)
        shares = np.cumsum(self.part.weight[order], axis=0) / self.part.weight.sum()
        rows = np.argmax(shares >= probability, axis=0)
        places = np.take_along_axis(order, rows[None], axis=0)[0]
        return np.asarray(self.part.peaks[places, np.arange(len(places))])


def joined_clusters(parts: Sequence[ClusterPart]) -> ClusterPart:
    """All clusters so far."""
    ages = np.concatenate([part.ages for part in parts], axis=3)
    return ClusterPart(
        ages, *(np.concatenate(each) for each in zip(*(p[1:] for p in parts), strict=True))
    )


def _mean_of(below: Vector, levels: Vector) -> float:
    """Mean of a positive quantity, from the probabilities that it stays below rising levels."""
    return float(np.trapezoid(1.0 - below, levels))
