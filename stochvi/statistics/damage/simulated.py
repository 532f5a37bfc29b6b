"""Damage of simulated motion. Chapters: records of acceleration, and equipment on them
(`DamageSampler`); clusters of rare impacts beside the same motion without stops; counts, energies
and shocks of impacts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.model.model import Model
from stochvi.motion.choose_plan import HistoryPlan, ImpactLog
from stochvi.motion.kernels.crossings_and_cycles import BEFORE, NODES
from stochvi.results.deadline import NEVER, Deadline
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import (
    Estimate,
    jackknife_error,
    mean_and_error,
    of_events,
    upper_limit_unseen,
)
from stochvi.sampling.calculations import ListSampler, TrialSampler, given_up_after
from stochvi.scenes.impact_laws import CompliantLaw
from stochvi.statistics.clusters import UNFINISHED, ClusterPaths, ClustersSoFar
from stochvi.statistics.clusters import Records as PathRecords
from stochvi.statistics.damage.equipment import (
    LEVELS,
    Equipment,
    GaussianEquipment,
    Shocks,
    exceedance,
)
from stochvi.statistics.histories import (
    Accelerations,
    accelerations,
    carried_forces,
    pair_forces,
    velocity_jumps,
)

# ------------------------------------------------------------------------------
# Damage by plain simulation: records of acceleration, and the equipment that stands on them.
# ------------------------------------------------------------------------------


CONTACT_SAMPLES = 8.0
"""Number of samples in a contact with a compliant stop."""

KICKS_PER_SAMPLE = 2.0
"""Steps of white noise, which acts in kicks, in the longest step of the equipment."""

LEAST_SECONDS, MEMORIES, RELAXATIONS = 10.0, 10.0, 20.0
"""Smallest length of a record: seconds, memories of the equipment and relaxation times."""

MOST_SAMPLES = 2**22
"""Largest number of samples of a record."""


class RecordPiece(NamedTuple):
    """What records of some paths give; rows are paths.

    Parameters
    ----------
    damage, halving, squares
        (paths, equipment): damage of records that repeat themselves, and the others of
        `EquipmentRecords`. A record is a piece of a long one, in which later cycles close its own.
    below
        (paths, equipment): mean square of the acceleration below each frequency, (m/s^2)^2.
    peaks
        (paths, windows, equipment): largest responses, m/s^2.
    struck
        (paths, windows): whether an impact begins in the window.
    hits, work, loss
        (paths,): number of impacts, energy with which they arrive, and what they lose of it, J.
    above
        (paths, levels): contacts with a larger acceleration than each level.
    """

    damage: Matrix
    halving: Matrix
    squares: Matrix
    below: Matrix
    peaks: NDArray[np.float64]
    struck: NDArray[np.bool_]
    hits: Vector
    work: Vector
    loss: Vector
    above: Matrix


@dataclass(frozen=True, eq=False)
class DamageSampler(ListSampler):
    """Records of one coordinate or point, `row` . q, and the equipment on them."""

    plan: HistoryPlan
    equipment: Equipment
    row: tuple[float, ...]
    driven: bool
    levels: tuple[float, ...]
    seed: int

    @property
    def block(self) -> int:
        """Number of paths that are recorded together."""
        return self.plan.block

    @property
    def first(self) -> int:
        """Sample from which on the equipment counts."""
        return BEFORE + math.ceil(self.equipment.memory / self.plan.step)

    @property
    def window(self) -> int:
        """Samples of a window, the memory of the equipment."""
        return math.ceil(self.equipment.memory / self.plan.step)

    @property
    def windows(self) -> int:
        """Number of windows of a record."""
        return max(1, (self.plan.samples - self.first - NODES) // self.window)

    @property
    def seconds(self) -> float:
        """Counted length of a record, s."""
        return self.windows * self.window * self.plan.step

    @cached_property
    def _counted(self) -> slice:
        return slice(self.first, self.first + self.windows * self.window)

    def simulate(self, first_path: int, paths: int) -> RecordPiece:
        """What these paths give."""
        row = np.array(self.row)
        found = accelerations(self.plan, row, self.seed, first_path, paths, self.driven)
        step = self.plan.step
        answer = self.equipment.respond(
            found.smooth, step, self.first, self.window, self.windows, found.jumps
        )
        struck, hits, work, loss = self._impacts(found, paths)
        return RecordPiece(
            damage=answer.damage + answer.closing, halving=answer.halving, squares=answer.squares,
            below=self._below(found), peaks=answer.peaks, struck=struck, hits=hits, work=work,
            loss=loss, above=self._above(found),
        )  # fmt: skip

    def add_up(self, pieces: list[RecordPiece]) -> list[RecordPiece]:
        """The pieces."""
        return pieces

    def paths(self, sample: list[RecordPiece]) -> int:
        """Number of paths."""
        return sum(len(piece.hits) for piece in sample)

    def _below(self, found: Accelerations) -> Matrix:
        """Mean squares below the frequencies of the equipment, by Hann's window over the record;
        impulses of rigid stops count as those of one sample."""
        records = found.smooth[:, self._counted]
        if found.jumps is not None:
            records = records + found.jumps[:, self._counted] / self.plan.step
        return squares_below(records, self.equipment.frequency_hz, self.plan.step)

    def _impacts(
        self, found: Accelerations, paths: int
    ) -> tuple[NDArray[np.bool_], Vector, Vector, Vector]:
        """Struck windows, and numbers and energies of impacts by path."""
        struck = np.zeros((paths, self.windows), bool)
        hits, work, loss = np.zeros((3, paths))
        for pair in self.plan.model.pairs:
            log = found.impacts[pair.name]
            place = np.floor(log.time / self.plan.step).astype(int) - self.first
            inside = (place >= 0) & (place < self.windows * self.window)
            assert log.lost is not None
            np.add.at(loss, log.path[inside], log.lost[inside])
            inside &= np.abs(log.speed) >= self.plan.plan.layout.thresholds[pair.name]
            path, speed = log.path[inside], log.speed[inside]
            struck[path, place[inside] // self.window] = True
            np.add.at(hits, path, 1.0)
            np.add.at(work, path, 0.5 * pair.mass * speed**2)
        return struck, hits, work, loss

    def _above(self, found: Accelerations) -> Matrix:
        """Contacts with a larger acceleration than each level, by path."""
        above = np.zeros((len(found.smooth), len(self.levels)))
        if not self.levels:
            return above
        for force in found.forces.values():
            for path, (pushed, moved) in enumerate(zip(force, found.smooth, strict=True)):
                above[path] += contacts_above(
                    pushed[self._counted], moved[self._counted], self.levels
                )
        return above


def squares_below(records: Matrix, frequency_hz: Sequence[float], step: float) -> Matrix:
    """Mean squares of records (paths, samples) below frequencies, by Hann's window."""
    count = records.shape[1]
    taper = np.sqrt(2.0 / 3.0) * (1.0 - np.cos(2.0 * math.pi * np.arange(count) / count))
    size = scipy.fft.next_fast_len(count, real=True)
    powers = np.abs(scipy.fft.rfft(records * taper, size, axis=1)) ** 2 * (2.0 / (size * count))
    powers[:, 0] *= 0.5
    total = np.cumsum(powers, axis=1)
    bins = np.array(frequency_hz) * size * step
    return np.array([np.interp(bins, np.arange(powers.shape[1]), each) for each in total])


def contacts_above(force: Vector, acceleration: Vector, levels: Sequence[float]) -> Vector:
    """Number of contacts, in which the force is not 0, with a larger acceleration than each
    level."""
    touching = np.flatnonzero(force)
    if not len(touching):
        return np.zeros(len(levels))
    starts = np.flatnonzero(np.diff(touching, prepend=-2) > 1)
    largest = np.maximum.reduceat(np.abs(acceleration[touching]), starts)
    return np.array([np.sum(largest > level) for level in levels], dtype=float)


def joined(pieces: list[RecordPiece]) -> RecordPiece:
    """All paths together."""
    return RecordPiece(*(np.concatenate(part) for part in zip(*pieces, strict=True)))


def sampled_for(plan: HistoryPlan, equipment: Equipment) -> HistoryPlan:
    """The plan of records that resolve the equipment and the contacts."""
    contact = contact_time(plan.model, plan.speed)
    step = min(plan.step, equipment.longest_step, contact / CONTACT_SAMPLES)
    if plan.plan.kicked:
        step = min(step, equipment.longest_step / KICKS_PER_SAMPLE)
    counted = max(LEAST_SECONDS, MEMORIES * equipment.memory, RELAXATIONS * plan.slowest)
    duration = counted + equipment.memory + 2.0 * NODES * step
    if duration / step > MOST_SAMPLES:
        raise NotApplicable(
            "damage",
            f"a record of {duration:.3g} s at steps of {step:.2g} s needs "
            f"{duration / step:.2g} samples, at most {MOST_SAMPLES} are made; ask for "
            "equipment in a narrower band (equipment), or replace a stop whose contacts are "
            "short by a rigid one with its restitution",
        )
    return plan.sampled(step, duration)


def contact_time(model: Model, speed: float) -> float:
    """Shortest contact of a compliant stop at an rms speed (m/s), s; infinite without one."""
    times = [
        stop.law.impact(speed, pair.mass).contact_time
        for pair in model.pairs
        for stop in pair.stops
        if isinstance(stop.law, CompliantLaw) and speed > 0.0
    ]
    return min(times, default=math.inf)


# ------------------------------------------------------------------------------
# Damage where impacts are rare: clusters of impacts, each beside the same motion without stops.
#
# A first impact meets the motion that the place has without stops (`statistics.clusters`). Records
# of its acceleration begin a memory of the equipment before the impact. From there the motion goes
# on with the stops, and once more without. Let lambda be the rate of first impacts, and clusters be
# far apart. What the stops add to a sum over a cluster is then added lambda times a second to the
# sum of the Gaussian motion.
# ------------------------------------------------------------------------------


PAST_LARGEST = 4.0
"""Largest level of an extreme over the largest response to the clusters that were simulated."""

RECORDED = 2**21
"""Largest number of samples of acceleration that are held together."""


class ClusterPart(NamedTuple):
    """What one block of paths gives.

    Parameters
    ----------
    ages
        Ages of its crossings, see `clusters.Part`.
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
        size = scipy.fft.next_fast_len(kept.shape[1], real=True)
        powers = np.abs(scipy.fft.rfft(kept, size, axis=1)) ** 2 * (2.0 * self.step / size)
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

    def _impacts(self, logs: dict[str, ImpactLog], sums: PathRecords) -> tuple[Vector, ...]:
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Clusters(ClustersSoFar):
    """All clusters so far, and what follows from them by the second."""

    first_rate: Estimate
    sampler: ClusterSampler
    part: ClusterPart

    @classmethod
    def of(cls, sampler: ClusterSampler, parts: Sequence[ClusterPart]) -> Clusters:
        """Those of some blocks of paths."""
        ages = np.concatenate([part.ages for part in parts], axis=3)
        part = ClusterPart(
            ages, *(np.concatenate(each) for each in zip(*(p[1:] for p in parts), strict=True))
        )
        return cls(
            sampler=sampler, part=part, first_rate=sampler.clusters.found(ages).first_rate()[0],
            window=sampler.seconds, path=part.path, weight=part.weight,
        )  # fmt: skip

    @property
    def apart(self) -> bool:
        """Whether clusters end within the window and seldom meet."""
        part = self.part
        return self.overlap < UNFINISHED and self.late(part.hits, part.late) < UNFINISHED

    def rates(self, what: NDArray[np.float64]) -> tuple[Vector, Vector]:
        """Rate per second of a quantity (clusters, ...), and its standard error."""
        mean, error = self.ratio(what, np.ones(len(what)))
        error = np.hypot(error, self.relative_error * np.abs(mean))
        return self.per_second * mean, self.per_second * error

    def per_hour(self, counts: Vector, events: bool = True) -> Estimate:
        """Events, or energy, per hour; no energy has no upper limit."""
        value, error = self.rates(counts)
        how = f"{len(self.part.path)} clusters; bias: clusters that meet"
        if not value and not events:
            return Estimate(value=0.0, bias=None, how=f"none in {how}")
        if not value:
            return Estimate(
                value=0.0, bias=None, how=f"none of {len(self.part.path)} clusters",
                upper_95=HOUR * self.most_unseen,
            )  # fmt: skip
        return Estimate(
            value=HOUR * float(value), standard_error=HOUR * float(error),
            bias=HOUR * self.relative_bias * float(value), how=how,
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
            left = [_mean_of(below(kept, calm), levels) for kept in self.without_groups]
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


def _mean_of(below: Vector, levels: Vector) -> float:
    """Mean of a positive quantity, from the probabilities that it stays below rising levels."""
    return float(np.trapezoid(1.0 - below, levels))


# ------------------------------------------------------------------------------
# Impacts in the answer of `damage`: counts, energies and shocks, by clusters or by records.
# ------------------------------------------------------------------------------


RARE = 0.01
"""Share of the windows with an impact that exceed the worst shock."""

HOUR = 3600.0


class DamageHits(NamedTuple):
    """Impacts of a scene; fields as in `Damage`."""

    shocks: Shocks | None
    impacts_per_hour: Estimate
    contacts_above: Mapping[str, Estimate]
    work_per_hour: Estimate
    loss_per_hour: Estimate


def _all_rigid(model: Model) -> bool:
    return all(stop.rigid for stop in model.stops)


def damage_hits(
    per_hour: Callable[..., Estimate], shocks: Shocks | None, soft: Sequence[float],
    hits: Any, work: Any, loss: Any, above: Iterable[Any],
) -> DamageHits:  # fmt: skip
    """Impacts by the hour, from counts of impacts, of contacts above levels of `soft` stops, and
    from energies, which are no events."""
    return DamageHits(
        shocks=shocks, impacts_per_hour=per_hour(hits),
        contacts_above={f"{a:g}": per_hour(each) for a, each in zip(soft, above, strict=False)},
        work_per_hour=per_hour(work, False), loss_per_hour=per_hour(loss, False),
    )  # fmt: skip


def hits_of_clusters(found: Clusters, levels: Sequence[float]) -> DamageHits:
    """Impacts of all clusters."""
    part, rigid = found.part, _all_rigid(found.sampler.clusters.model)
    shocks = Shocks(
        typical=found.shock(0.5), worst=found.shock(1.0 - RARE), window=found.sampler.seconds,
        windows=len(part.path),
    )  # fmt: skip
    soft = () if rigid else levels
    return damage_hits(found.per_hour, shocks, soft, part.hits, part.work, part.loss, part.above.T)


class Records(NamedTuple):
    """Records of a scene, and the counts of their impacts."""

    sampler: DamageSampler
    sample: RecordPiece

    @property
    def paths(self) -> int:
        """Number of independent records."""
        return len(self.sample.hits)

    @property
    def seconds(self) -> float:
        """Counted time of all records, s."""
        return self.paths * self.sampler.seconds

    @property
    def work(self) -> dict[str, int]:
        """What was simulated."""
        plan = self.sampler.plan
        steps = self.paths * (plan.samples + plan.plan.settling)
        return {"steps": steps, "paths": self.paths, "impacts": int(self.sample.hits.sum())}

    def per_hour(self, counts: Vector, events: bool = True) -> Estimate:
        """Events, or energy, per hour; no energy has no upper limit."""
        value, error = mean_and_error(counts)
        how = f"{self.paths} records, {self.seconds:.4g} s"
        if not value and not events:
            return Estimate(value=0.0, bias=None, how=f"none in {how}")
        if not value:
            most = HOUR * upper_limit_unseen(self.seconds)
            return Estimate(value=0.0, bias=None, how=f"none in {how}", upper_95=most)
        hourly = HOUR / self.sampler.seconds
        found = Estimate(value=value * hourly, standard_error=error * hourly, how=how)
        return of_events(found, self.paths)

    def hits(self, levels: Sequence[float]) -> DamageHits:
        """Impacts of all records. Rigid stops have no contacts with an acceleration."""
        soft = () if _all_rigid(self.sampler.plan.model) else levels
        sums = self.sample
        return damage_hits(
            self.per_hour, self.shocks(), soft, sums.hits, sums.work, sums.loss, sums.above.T
        )

    def shocks(self) -> Shocks | None:
        """Shock spectra of the windows with an impact."""
        struck = self.sample.peaks[self.sample.struck]
        if not len(struck):
            return None
        return Shocks(
            typical=np.median(struck, axis=0), worst=np.quantile(struck, 1.0 - RARE, axis=0),
            window=self.sampler.window * self.sampler.plan.step, windows=len(struck),
        )  # fmt: skip
