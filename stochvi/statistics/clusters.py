"""Impact clusters. Chapters: clusters of a structure from first impacts of any pair; clusters of
one pair; impact rates by clusters or by whole records; missions part by part."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.engine.arithmetic import COLUMNS, Log
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.mathematics.units import explain_methods
from stochvi.mathematics.unsteady_noise import Crossings, Sines
from stochvi.methods.monte_carlo import simulate
from stochvi.model.coverage import free_motion
from stochvi.model.model import Model, model_of
from stochvi.model.scales import scales_of_free_motion
from stochvi.motion.choose_plan import GapResponse, shaken_by_tables, unmet
from stochvi.motion.kernels.crossings_and_cycles import motions_around
from stochvi.motion.modal_tables import ModalTablesPlan, plan_modal_tables
from stochvi.results.base import Response
from stochvi.results.deadline import Deadline, partial_result
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import (
    Estimate,
    correlated_total,
    jackknife_error,
    jackknife_ratio,
    of_events,
    upper_limit_unseen,
)
from stochvi.sampling.calculations import AccuracyOptions, TrialSampler
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.crossings import (
    FEWEST_PATHS,
    LEAST_PATHS,
    MEMORY_RELAXATIONS,
    STRIDES,
    Draws,
    FirstCrossings,
    GapRecords,
    PairMotion,
    own_distances,
)
from stochvi.statistics.hardness import NEEDS_FORCE, FromSpeed, hardness_of

# ------------------------------------------------------------------------------
# Clusters of impacts of a linear structure, simulated from first impacts of any of its pairs on.
#
# The motion of all modes without stops is synthesised, and an outcrossing of one gap is put into
# it. Given that the gap y_c reaches its stop u with the slope p at t = 0, the modes are
#
#     q_m(t) = x_m(t) + (u - x_c(0)) rho_m(t) + (p - x_c'(0)) eta_m(t),
#     rho_m(t) = E[q_m(t) y_c(0)] / E y_c^2,    eta_m(t) = E[q_m(t) y_c'(0)] / E y_c'^2
#
# before and after the crossing (`kernels.crossings_and_cycles`). Where the crossing is a first
# impact of any pair, the engine simulates what all stops change in that motion. Beside sines
# x_m is the noise alone, and the sines of each mode are added at the phases of the crossing.
# ------------------------------------------------------------------------------


Records = NDArray[np.float64]

TOUCH = 1e-9
"""Share of the clearance by which a crossing is put beyond the stop, so that the engine finds a
hit."""

WINDOW_RELAXATIONS = 15.0
"""Time that is simulated after a first impact, in time constants of the structure."""

WINDOWS = WINDOW_RELAXATIONS / MEMORY_RELAXATIONS
"""The same time in horizons, the time for which records look back from a crossing."""

LEAST_SHARE = 0.1
"""Smallest share of the first impacts of a stop that are simulated on: first impacts of a stop that
is hit seldom have little weight, but their clusters may differ from the others."""

CHOICE = 0xB0457
"""Number that keeps the choice of first impacts apart from other uses of a seed."""

FLOWN_SAMPLES = 2**21
"""Largest number of samples of all modes that are simulated together: 16 MB."""

LOGGED = 2**14
"""Number of impacts for which a log has room at first."""


class Part(NamedTuple):
    """What one block of paths gives: the ages of its crossings, (strides, sides, 1, paths, starts),
    and its clusters, (rows, clusters). The rows are path, weight, impacts in the first half of the
    window; impacts, sum of speeds and largest speed of each pair; largest acceleration of each
    output (see `Bursts`)."""

    ages: NDArray[np.float32]
    bursts: Vector


class ModalMotion(PairMotion):
    """The motion of all modes without stops, from which the motion of the gaps follows."""

    @cached_property
    def modes(self) -> GapResponse:
        """Synthesis of the modal displacements, in the same records as those of the gaps."""
        modal, law = self.model.modal, free_motion(self.model, with_sines=True).law
        n = modal.size
        return replace(
            self.response,
            modes=modal._replace(gaps=np.eye(n)),
            velocities=np.diag(law.covariance)[n : 2 * n],
        )

    @cached_property
    def modal_sines(self) -> Sines:
        """The sines of all modal displacements."""
        inverse: Matrix = np.linalg.inv(self.model.modal.shapes).astype(float)
        return self.sines(inverse)

    def sines_after(self, phases: Matrix, times: Any) -> tuple[Records, Records]:
        """Modal displacements and velocities by sines (times, modes, paths), so many seconds after
        they had these phases (paths, sines)."""
        turned = phases + times[:, None, None] * self.modal_sines.omega
        places, rates = self.modal_sines.at(turned)
        return places.transpose(1, 0, 2), rates.transpose(1, 0, 2)

    @cached_property
    def rows(self) -> Matrix:
        """The gaps that move, from modal displacements."""
        return np.asarray(self.model.modal.gaps[self.moving])

    @cached_property
    def window(self) -> int:
        """Number of samples that are simulated after a first impact."""
        return math.ceil(WINDOWS * self.count)

    @cached_property
    def lagged(self) -> Records:
        """Correlations of the modes over the window, see `GapResponse.correlations`."""
        return self.modes.correlations(max(self.window, self.count))

    @cached_property
    def correlations(self) -> Records:
        """Correlations of the gaps over the time for which records look back."""
        kept = self.lagged[:, : self.count + 1]
        return np.asarray(np.einsum("gm,olmn,hn->olgh", self.rows, kept, self.rows))

    def around(self, gap: int) -> Records:
        """rho, rho', eta and eta' of all modes around a crossing of one gap, (samples, modes, 4).

        They begin the longest of STRIDES before it and end with the window.
        """
        return self.shapes(gap, max(STRIDES), self.window + 1)

    def shapes(self, gap: int, before: int, after: int) -> Records:
        """The same from so many samples before the crossing to as many from it on."""
        row, lagged = self.rows[gap], self.lagged
        if max(before, after) > lagged.shape[1]:
            lagged = self.modes.correlations(max(before, after))
        # E[q_m(t) y(0)] at t > 0 is E[y(-t) q_m(0)]; every derivative changes sign
        later = np.einsum("m,olmn->oln", row, lagged[:, :after])
        later *= np.array([1.0, -1.0, 1.0])[:, None, None]
        earlier = np.einsum("olmn,n->olm", lagged[:, before:0:-1], row)
        r, rate, bend = np.concatenate([earlier, later], axis=1)
        own, own_bend = self.correlations[0, 0, gap, gap], self.correlations[2, 0, gap, gap]
        return np.stack([r / own, rate / own, rate / own_bend, bend / own_bend], axis=-1)


class FirstImpacts(NamedTuple):
    """First impacts on the stop of one side of the records, each (impacts,).

    Parameters
    ----------
    side
        Number of the side in `GapRecords.sides`.
    path, start
        Path within the block, and number of the start of its crossing.
    draws
        Random numbers of the crossing.
    sign, weight
        -1 where the motion is turned over; weight as in `Bursts`.
    """

    side: int
    path: NDArray[np.int64]
    start: NDArray[np.int64]
    draws: Draws
    sign: Vector
    weight: Vector

    def parts(self, size: int) -> Iterator[FirstImpacts]:
        """The impacts, so many at a time."""
        for first in range(0, len(self.path), size):
            part = slice(first, first + size)
            yield FirstImpacts(
                self.side, self.path[part], self.start[part], self.draws.of(part), self.sign[part],
                self.weight[part],
            )  # fmt: skip


class Followed(NamedTuple):
    """What stops make of given motions: path, pair, time and speed of each impact (4, impacts), the
    sums of each pair (pairs, sums_of_pair, paths), and the largest accelerations (paths, outputs).
    Then come the largest force (N) and deflection (m) of the stops of each pair, (paths, pairs)."""

    impacts: Matrix
    sums: Records
    accelerations: Matrix
    forces: Matrix
    deflections: Matrix


class ClusterPaths:
    """Paths of a linear structure under Gaussian noise, with clusters from their first impacts on.

    Half of a record is at least `memories` times as long as the memory of the gaps. Raises
    `NotApplicable` as `first_crossings` does, or where a law cannot be simulated.
    """

    def __init__(
        self, model: Model, seed: int, memories: float = WINDOWS, longest_step: float = math.inf
    ) -> None:
        if conditions := unmet(model):
            raise NotApplicable("bursts", conditions)
        self.model, self.seed = model, seed
        free_motion(model, with_sines=True)  # raises what no stationary motion covers
        # sines are a part of the motion that the stops change
        tables = shaken_by_tables(model.without_sines())
        plan = plan_modal_tables(tables, None, None, scales_of_free_motion)
        self.motion = ModalMotion(model, min(plan.step, longest_step), memories)
        self.plans: dict[int, ModalTablesPlan] = {
            stride: replace(plan, step=stride * self.motion.response.step) for stride in STRIDES
        }
        below, above = own_distances(model)
        self.records = GapRecords(self.motion, seed, below[None], above[None])
        self.pairs = tuple(pair.name for pair in model.pairs)
        # a rigid impact has no largest acceleration
        soft = tables.base_alone_moves and not any(stop.rigid for stop in model.stops)
        self.outputs = model.outputs if soft else ()

    def between(self, model: Model) -> ClusterPaths:
        """The same motions between stops at the same places with other laws, those of a model."""
        found, tables = copy.copy(self), shaken_by_tables(model.without_sines())
        found.model = model
        found.plans = {stride: replace(plan, model=tables) for stride, plan in self.plans.items()}
        return found

    @property
    def together(self) -> int:
        """Number of paths that are made together."""
        return self.motion.modes.block(self.motion.modes.gaps)

    def whole(self, free: Records) -> Records:
        """The records of one block as motions for `follow`, which go on from their ends to their
        starts."""
        motion = np.empty((free.shape[1], free.shape[2] // 2, 2 * len(free)))
        motion[:, :, 0::2] = free[:, :, 0::2].transpose(1, 2, 0)
        motion[:, :, 1::2] = free[:, :, 1::2].transpose(1, 2, 0) / self.plans[1].scale
        return motion

    def free(self, first_path: int) -> Records:
        """Motion of all modes without stops (paths, samples, 2 modes) of one block of paths."""
        modes = np.arange(self.model.modal.size)
        return self.motion.modes.records(self.seed, first_path, self.together, modes)

    def gaps(self, free: Records) -> Records:
        """The gaps of the records (paths, samples, 2 pairs), from the motion of all modes."""
        rows = self.motion.rows[self.records.chosen].T
        found = np.empty((*free.shape[:2], 2 * len(self.records.pairs)))
        found[:, :, 0::2], found[:, :, 1::2] = free[:, :, 0::2] @ rows, free[:, :, 1::2] @ rows
        return found

    def found(self, ages: NDArray[np.float32]) -> FirstCrossings:
        """The answer from the ages of all crossings so far."""
        return self.records.found(ages)

    def part(self, widening: float, first_path: int) -> Part:
        """Crossings of one block of paths, and the clusters after first impacts."""
        ages, motions = self.after_first_impacts(self.free(first_path), first_path, widening)
        columns = [np.empty((3 + 3 * len(self.pairs) + len(self.outputs), 0))]
        columns += [
            np.vstack([first_path + one.path, one.weight, self._cluster(motion)])
            for one, motion in motions
        ]
        return Part(ages, np.concatenate(columns, axis=1))

    def after_first_impacts(
        self, free: Records, first_path: int, widening: float
    ) -> tuple[NDArray[np.float32], Iterator[tuple[FirstImpacts, Records]]]:
        """Ages of the crossings in one block of paths; and first impacts, some at a time, with the
        motion without stops from them on, for `follow`."""
        ages, found = self.first_impacts(free, first_path, widening)
        size = max(1, FLOWN_SAMPLES // (2 * self.motion.window * self.model.modal.size))
        return ages, (
            (one, self.around(free, one.side, one.path, self.records.starts[one.start],
                              one.draws, one.sign))
            for each in found
            for one in each.parts(size)
        )  # fmt: skip

    def first_impacts(
        self, free: Records, first_path: int, widening: float = 1.0
    ) -> tuple[NDArray[np.float32], list[FirstImpacts]]:
        """Ages of the crossings in one block of paths, and the first impacts that are simulated on,
        by the stop that they meet."""
        records, gaps = self.records, self.gaps(free)
        draws = records.draws(first_path, self.together)
        ages = records.ages_in(gaps, draws, STRIDES)
        units, weights = widened(draws.units, widening)
        fast = draws._replace(units=units)
        wide = ages[:1] if widening == 1.0 else records.ages_in(gaps, fast, STRIDES[:1])
        rates = records.rice_rates[:, 0]
        kept = np.maximum(rates / rates.max(), LEAST_SHARE)
        random = np.random.default_rng([self.seed, CHOICE, first_path])
        chosen = random.random(wide[0, :, 0].shape) < kept[:, None, None]
        chosen &= wide[0, :, 0] > records.horizon - 0.5 * records.plan.step
        found = []
        for side, (gap, _, _) in enumerate(records.sides):
            p, s = np.nonzero(chosen[side])
            weight = rates[side] / kept[side] * weights[gap, p, s]
            sign = self._signs(side, p + s)
            found.append(FirstImpacts(side, p, s, fast.of((gap, p, s)), sign, weight))
        return ages, found

    def recorded(self, free: Records, some: FirstImpacts, before: int, after: int) -> Records:
        """Modal motion without stops (before + after, modes, 2 impacts) around first impacts, as
        `around`, in the order of time: so many samples before them, and from them on."""
        gap = self.records.sides[some.side][0]
        row = self.motion.rows[self.records.chosen[gap]]
        shape = self._recorded_shapes(int(self.records.chosen[gap]), before, after)
        start = self.records.starts[some.start]
        here = free[some.path, start]
        place, slope, phases = self._crossings(some.side, some.draws)
        away, change = place - here[:, 0::2] @ row, slope - here[:, 1::2] @ row
        seconds = self.plans[1].step * np.arange(-before, after)
        sines = self.motion.sines_after(phases, seconds) if phases.shape[1] else (0.0, 0.0)
        times = (start + np.arange(-before, after)[:, None]) % free.shape[1]
        motion = free[some.path, times].transpose(0, 2, 1)  # (samples, 2 modes, impacts)
        found = np.empty((before + after, len(row), 2 * len(start)))
        for part, scale in ((0, 1.0), (1, self.plans[1].scale)):
            moved = shape[:, :, part, None] * away + shape[:, :, 2 + part, None] * change
            moved += sines[part]
            found[:, :, part::2] = some.sign * (motion[:, part::2] + moved) / scale
        return found

    def _recorded_shapes(self, gap: int, before: int, after: int) -> Records:
        """rho, rho', eta and eta' of `around` over the samples of `recorded`."""
        known = self._shapes_by_length
        if (gap, before, after) not in known:
            known[gap, before, after] = self.motion.shapes(gap, before, after)
        return known[gap, before, after]

    @cached_property
    def _shapes_by_length(self) -> dict[tuple[int, int, int], Records]:
        return {}

    def recorded_with_stops(self, motion: Records) -> tuple[Records, Matrix, Records]:
        """What the stops make of a motion that begins one sample before it counts: the states of
        all samples that count (samples, impacts, record_width), and the impacts and sums as in
        `Followed`."""
        plan, rows = self.plans[1], LOGGED
        turned = np.ascontiguousarray(np.roll(motion, -1, axis=0))
        while True:
            log = Log(np.zeros((rows, COLUMNS)), np.zeros(1, np.int64), 0.0)
            record = np.zeros((len(motion) - 1, motion.shape[2] // 2, plan.record_width))
            sums = plan.follow(turned.copy(), log, None, record=record)
            if log.count[0] <= rows:
                return record, log.events[: log.count[0]].T, sums
            rows = int(log.count[0])

    def _signs(self, side: int, numbers: NDArray[np.int64]) -> Vector:
        """(clusters,): 1 where an upper stop is hit, -1 where the motion is turned over to hit a
        lower one; where lower stops are as far as upper ones, every other motion is."""
        if self.records.alike:
            return np.where(numbers % 2, -1.0, 1.0)
        near = self.records.sides[side][1]
        return np.full(len(numbers), 1.0 if near is self.records.above else -1.0)

    def around(
        self, free: Records, side: int, path: NDArray[np.int64], start: NDArray[np.int64],
        draws: Draws, signs: Vector, stride: int = 1,
    ) -> Records:  # fmt: skip
        """Modal displacements and velocities around crossings of the stop of one side, for
        `follow`.

        Parameters
        ----------
        path, start
            (crossings,): path and sample of the `free` motion that become a crossing.
        draws, signs
            (crossings,): random numbers of each, and -1 where the motion is turned over.
        stride
            Number of samples in a step.
        """
        gap = self.records.sides[side][0]
        row = self.motion.rows[self.records.chosen[gap]]
        shape = np.ascontiguousarray(self._around[gap][max(STRIDES) - stride :: stride])
        here = free[path, start]
        place, slope, phases = self._crossings(side, draws)
        away, change = place - here[:, 0::2] @ row, slope - here[:, 1::2] @ row
        motion = np.empty((len(shape), len(row), 2 * len(path)))
        motions_around(
            free, path, start, stride, shape, away, change, signs, self.plans[1].scale, motion
        )
        if phases.shape[1]:
            # from the crossing on; the last step is the one before it
            steps = (np.arange(len(shape)) + 1) % len(shape) - 1
            found = self.motion.sines_after(phases, self.plans[stride].step * steps)
            motion[:, :, 0::2] += signs * found[0]
            motion[:, :, 1::2] += signs * found[1] / self.plans[1].scale
        return motion

    def _crossings(self, side: int, draws: Draws) -> Crossings:
        """Crossings of the stop of one side, a little beyond it."""
        gap, near, _ = self.records.sides[side]
        found = self.records.crossings(side, draws)
        return found._replace(place=found.place + TOUCH * near[0, gap])

    @cached_property
    def _around(self) -> list[Records]:
        """`ModalMotion.around` of each gap of the records."""
        return [self.motion.around(int(gap)) for gap in self.records.chosen]

    def follow(
        self, motion: Records, *, accelerations: bool, stride: int = 1, burn_in: int = 0,
        counted: int | None = None,
    ) -> Followed:  # fmt: skip
        """What the stops make of a motion, by `ModalTablesPlan.follow`; without `accelerations`
        these, the forces and the deflections are 0."""
        outputs, pairs = len(self.outputs), len(self.pairs)
        largest = np.zeros((motion.shape[2] // 2, outputs + 2 * pairs))
        rows = LOGGED
        while True:
            log = Log(np.zeros((rows, COLUMNS)), np.zeros(1, np.int64), 0.0)
            largest[:] = 0.0
            sums = self.plans[stride].follow(
                motion, log, largest if accelerations and self.outputs else None, burn_in, counted
            )
            if log.count[0] <= rows:
                break
            rows = int(log.count[0])
        sharpest, hardest, deepest = np.split(largest, [outputs, outputs + pairs], axis=1)
        forces = hardest * self.model.masses_of_pairs  # kernels take accelerations
        return Followed(log.events[: log.count[0]].T, sums, sharpest, forces, deepest)

    def fastest(self, impacts: Matrix, paths: int) -> Matrix:
        """Largest impact speeds of each pair (pairs, paths), m/s; 0 where there is no impact."""
        path, pair, _, speed = impacts
        found = np.zeros((len(self.pairs), paths))
        np.maximum.at(found, (pair.astype(int), path.astype(int)), np.abs(speed))
        return found

    def _cluster(self, motion: Records) -> Matrix:
        """Rows of `Part.bursts` from the impacts in the first half of the window on."""
        bursts, plan = motion.shape[2] // 2, self.plans[1]
        impacts, sums, accelerations, _, _ = self.follow(motion, accelerations=True)
        early = impacts[0, impacts[2] <= 0.5 * self.motion.window * plan.step].astype(int)
        of = {name: row for row, name in enumerate(plan.sums_of_pair)}
        hits, speeds = (
            sums[:, of[f"{what}_lower"]] + sums[:, of[f"{what}_upper"]] for what in ("n", "f1")
        )
        counts = np.bincount(early, minlength=bursts)
        fastest = self.fastest(impacts, bursts)
        return np.vstack([counts, hits, speeds, fastest, accelerations.T])


def widened(unit: Vector, widening: float) -> tuple[Vector, Vector]:
    """The slopes (..., starts), every second one made larger, and the weight of each: the density
    of the unit law over that of the mixture."""
    slopes = unit.copy()
    slopes[..., 1::2] *= widening
    wide = np.exp(0.5 * slopes**2 * (1.0 - widening**-2)) / widening**2
    share = slopes[..., 1::2].size / slopes.size
    return slopes, 1.0 / (1.0 - share + share * wide)


# ------------------------------------------------------------------------------
# Impact clusters, simulated from their first impact on.
#
# Impacts of an isolator whose stops are far come in clusters. A first impact meets the motion that
# the mass has without stops; others follow from it. Crude simulation has to wait for clusters; here
# every record begins with one. First impacts are outcrossings of the free response without another
# one in the memory of the process before (`crossings.GapRecords`). From there the engine simulates
# on with the stops (`ClusterPaths`). Let lambda be the limiting rate of first impacts, and clusters
# be far apart. A quantity with the mean q in a cluster then happens lambda q times a second,
# however rare that is.
# ------------------------------------------------------------------------------


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


GROUPS = 20
"""Number of groups of paths that the jackknife leaves out in turn."""

NEVER = 1e-300
"""Smallest sum of weights that is divided by."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ClustersSoFar:
    """Clusters with their weights, and what follows from them by the second; or records of the
    whole motion, which have no first impacts.

    Parameters
    ----------
    first_rate
        Limiting rate of first impacts, 1/s; None of records.
    window
        Time for which each was simulated, s.
    path, weight
        (clusters,): path of each, and its weight, see `Bursts`.
    """

    first_rate: Estimate | None
    window: float
    path: NDArray[np.int64]
    weight: Vector

    @property
    def overlap(self) -> float:
        """Expected number of other first impacts in the window that is simulated; rates need it to
        be small."""
        return 0.0 if self.first_rate is None else self.first_rate.value * self.window

    @property
    def per_second(self) -> float:
        """Clusters, or records, per second, without the clusters that begin in the window of
        another one."""
        if self.first_rate is None:
            return 1.0 / self.window
        return self.first_rate.value / (1.0 + self.overlap)

    @property
    def relative_error(self) -> float:
        """Relative standard error of the rate of first impacts."""
        rate = self.first_rate
        return 0.0 if rate is None else rate.standard_error / rate.value

    @property
    def relative_bias(self) -> float:
        """Relative bias of rates: that of first impacts, and clusters that meet."""
        rate = self.first_rate
        return 0.0 if rate is None else (rate.bias or 0.0) / rate.value + self.overlap

    @property
    def most_unseen(self) -> float:
        """Upper limit of a rate of which no cluster has any, 1/s: as if that of the largest weight
        had it."""
        assert self.first_rate is not None
        share = float(self.weight.max() / self.weight.sum())
        return self.first_rate.value * upper_limit_unseen(1.0) * share

    def late(self, hits: Vector, late: Vector) -> float:
        """Share of the impacts (clusters,) in the second half of the window, without those of new
        clusters."""
        total = float(self.weight @ hits)
        if self.first_rate is None or total == 0.0:
            return 0.0
        return max(float(self.weight @ late) / total - 0.5 * self.overlap, 0.0)

    @cached_property
    def without_groups(self) -> list[NDArray[np.int64]]:
        """Clusters that remain without each group of paths."""
        paths = np.unique(self.path)
        return [
            np.flatnonzero(~np.isin(self.path, group))
            for group in np.array_split(paths, min(GROUPS, len(paths)))
        ]

    def ratio(self, above: Vector, below: Vector) -> tuple[Any, Any]:
        """Ratio of weighted sums of two quantities (clusters, ...) and (clusters,), and its
        standard error by the jackknife over groups of paths."""

        def of(kept: Any) -> Any:
            weight = self.weight[kept]
            return weight @ above[kept] / max(float(weight @ below[kept]), NEVER)

        left_out = np.array([of(kept) for kept in self.without_groups])
        return of(slice(None)), jackknife_error(left_out.T)


@explain_methods
@dataclass(frozen=True, kw_only=True, eq=False)
class Bursts(ClustersSoFar):
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
    masses
        (pairs,): reduced masses, kg.
    sharpest
        (outputs, clusters): largest absolute acceleration (m/s^2, or rad/s^2) while a stop is
        touched. Rigid impacts have none.

    See Also
    --------
    stochvi.size : The sizing that uses clusters where impacts are rare.
    """

    first_rate: Estimate
    horizon: float
    pairs: tuple[str, ...]
    outputs: tuple[str, ...]
    early_hits: Vector
    hits: Matrix
    speeds: Matrix
    fastest: Matrix
    sharpest: Matrix
    masses: Vector

    @property
    def paths(self) -> int:
        """Number of independent paths with a cluster."""
        return len(np.unique(self.path))

    @property
    def unfinished(self) -> float:
        """Share of the impacts in the second half of the window, without those of new clusters."""
        hits = self.hits.sum(axis=0)
        return self.late(hits, hits - self.early_hits)

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
        """(clusters,): how hard the hardest impact is by a kind of hardness, on any pair or in the
        accelerations of some outputs, by default of all."""
        kind = hardness_of(name)
        if isinstance(kind, FromSpeed):
            return kind.of_pairs(self.fastest, self.masses)
        rows = _rows("outputs", self.outputs if outputs is None else outputs, self.outputs)
        if not rows:
            raise NotApplicable(name, NEEDS_FORCE)
        return np.asarray(self.sharpest[rows].max(axis=0))

    def exceedance_rate(
        self, name: str, limit: float, outputs: Sequence[str] | None = None
    ) -> Estimate:
        """Clusters per second of which the `largest` is above a limit."""
        return self._rate((self.largest(name, outputs) > limit).astype(float))

    def _pairs(self, pair: str | None) -> list[int]:
        """Rows of one pair, or of all."""
        return _rows("pair", self.pairs if pair is None else [pair], self.pairs)

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
        value = self.per_second * mean.value
        if not value:
            how = f"none of {len(self.path)} clusters"
            return Estimate(value=0.0, bias=None, how=how, upper_95=self.most_unseen)
        return Estimate(
            value=value,
            standard_error=math.hypot(self.relative_error, mean.standard_error / mean.value)
            * value,
            bias=self.relative_bias * value,
            how=f"{len(self.path)} clusters; bias: clusters that meet",
        )

    def limited(self, rate: Estimate) -> Estimate:
        """A rate, or its upper limit where too few clusters have any of it. That is never below the
        limit where none has: a cluster of small weight says nothing of those of large weight."""
        found = of_events(rate, self.paths)
        if found.upper_95 is None:
            return found
        return replace(found, upper_95=max(found.upper_95, self.most_unseen))

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


def _rows(name: str, chosen: Sequence[str], known: Sequence[str]) -> list[int]:
    """Rows of chosen names, or a sentence with the known ones."""
    for each in chosen:
        if each not in known:
            raise ValueError(f"{name} must be among {', '.join(known) or 'none'}, got {each!r}")
    return [known.index(each) for each in chosen]


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
        raise NotApplicable("bursts", "stops as near as these are hit without a pause")
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
        masses=clusters.model.masses_of_pairs,
    )


# ------------------------------------------------------------------------------
# Impacts per second on one pair or several: by clusters where these are apart, else by simulating
# everything.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class ImpactCounts:
    """Impacts per second, together and by pair, and their mean speeds (m/s; None where unknown).

    `way` is "bursts" or "simulation", and `samples` the number of independent paths. `response` is
    that of the simulation; it is `short` where the budget ended before it was accurate enough, or
    hardly an impact was seen.
    """

    rate: Estimate
    rates: Mapping[str, Estimate]
    speeds: Mapping[str, Estimate | None]
    way: str
    samples: int
    hits_per_burst: Estimate | None = None
    response: Response | None = None
    short: bool = False

    @property
    def steps(self) -> int:
        """Number of steps of the simulation; 0 where there is none."""
        return 0 if self.response is None else self.response.cost.steps


def count_impacts(scene: Scene, overlap: float, run: Run) -> ImpactCounts:
    """Count impacts on all stops of a scene.

    Parameters
    ----------
    overlap
        Expected first impacts in the time for which a cluster is followed; 0 where that is not
        known.
    """
    found = clusters_apart(scene, overlap, run)
    if found is not None:
        return ImpactCounts(
            rate=of_events(found.hit_rate(), found.paths),
            rates={name: of_events(found.hit_rate(name), found.paths) for name in found.pairs},
            speeds={
                # a mean of one path has no error
                name: found.impact_speed_mean(name)
                if len(np.unique(found.path[hits > 0])) > 1
                else None
                for name, hits in zip(found.pairs, found.hits, strict=True)
            },
            way="bursts",
            samples=found.paths,
            hits_per_burst=found.hits_per_burst(),
        )
    short = False
    try:
        response = simulate(scene, **run.options(rel_error=run.rel_error))
    except (NotConverged, Interrupted) as reason:
        if reason.partial is None:
            raise
        response, short = reason.partial, True
    rates, speeds = {}, {}
    for pair in scene.impact_pairs:
        rate, speed = (
            response.impact_pairs[pair.name].get(name)
            for name in ("collision_rate", "impact_speed_mean")
        )
        assert isinstance(rate, Estimate)
        rates[pair.name] = rate
        speeds[pair.name] = speed if isinstance(speed, Estimate) else None
    short = short or all(rate.upper_95 is not None for rate in rates.values())
    return ImpactCounts(
        rate=correlated_total([*rates.values()]), rates=rates, speeds=speeds, way="simulation",
        samples=response.cost.paths, response=response, short=short,
    )  # fmt: skip


def clusters_apart(
    scene: Scene, overlap: float, run: Run,
    wanted: Callable[[Bursts], Estimate] = Bursts.hit_rate, **asked: Any,
) -> Bursts | None:  # fmt: skip
    """The clusters of a scene; None where they meet, or where no pause separates them."""
    if overlap >= UNFINISHED:
        return None
    options = run.options(rel_error=run.rel_error)
    try:
        found: Bursts = partial_result(bursts, scene, wanted=wanted, **asked, **options)
    except NotApplicable:
        return None
    return found if found.apart else None
