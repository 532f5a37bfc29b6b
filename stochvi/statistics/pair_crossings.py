"""Probability that any of several impact pairs is hit at all: first crossings of a Gaussian vector.

Before the first contact the gaps of a linear structure are a stationary Gaussian process. Beside
sines or shocks it is one about means that move (`mathematics.moving_means`).
A first impact of any pair is its first outcrossing of the region in which no gap is beyond a stop.
Every stop has its own outcrossings, with the rate of Rice; around one of them all gaps are
Gaussian, with the cross-correlations of the process (`monte_carlo.kernels.crossings`). Before it
lies the last exceedance of any stop of any pair. The time between them says for how long it would
have been the first impact (`crossing_ages`). Pairs that move together are thereby counted together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr, ndtri

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.moving_means import Crossings, MovingMean, Sines, even_phases
from stochvi.mathematics.random_shocks import MOST_IN_WINDOW, Shocks
from stochvi.methods.monte_carlo.gap_response import GapResponse, plan_gaps
from stochvi.methods.monte_carlo.kernels.crossings import (
    ShockResponses,
    StatesAtCrossings,
    Waves,
    outcrossing_ages,
)
from stochvi.methods.monte_carlo.tabulated import MOST_SAMPLES
from stochvi.model.coverage import not_gaussian
from stochvi.model.free_motion import free_motion
from stochvi.model.model import ALIKE, Model, sharing_of
from stochvi.results.errors import NotApplicable
from stochvi.results.estimates import Estimate
from stochvi.sampling.run import Run
from stochvi.scenes.excitations.pulses import Pulses
from stochvi.statistics.crossing_ages import (
    STRIDES,
    CrossingAges,
    Exposure,
    until_accurate,
)

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
            raise NotApplicable("first_crossings", ["the scene needs an impact_pair"])
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
                [f"noise must move the gap of {still[0]}, got sines alone; `sine` follows these"],
            )

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """Numbers of the pairs whose gaps move: others are never hit."""
        (found,) = np.nonzero(self.displacement_std)
        if not len(found):
            raise NotApplicable(
                "first_crossings",
                ["excitation must move at least one gap, got none that moves; check its on"],
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
                [f"a shock must be shorter than {plan.block_length - remembered:.3g} s for this "
                 f"mount, got {pulses.shock.duration:.3g} s"],
            )  # fmt: skip
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


def own_distances(model: Model) -> tuple[Vector, Vector]:
    """(pairs,) distances of the lower and of the upper stops from the mean gaps, m."""
    rest = model.mean_gaps
    found = np.full((2, len(model.pairs)), math.inf)
    for number, (pair, place) in enumerate(zip(model.pairs, rest, strict=True)):
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
                [
                    "the input is too narrow to be resolved: its memory of "
                    f"{memory_of(plan):.3g} s or more does not fit into half a record of "
                    f"{MOST_SAMPLES // plan.gaps} samples"
                ],
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
        ages = [
            [
                self.ages_before(side, records, self.starts, draws.of(gap), stride)
                for side, (gap, _, _) in enumerate(self.sides)
            ]
            for stride in strides
        ]
        return np.array(ages, np.float32)

    def ages_before(
        self, side: int, records: Vector, starts: NDArray[np.int64], draws: Draws, stride: int = 1
    ) -> Vector:
        """Ages (levels, paths, starts) of crossings of the stop of one side.

        They are put at the samples `starts` of records; the draws (paths, starts) are those of the
        gap.
        """
        gap, near, far = self.sides[side]
        ages = np.empty((len(near), *draws.units.shape))
        states = sines = shocks = None
        if self.beside.number:
            found = [self.crossings(side, draws, level) for level in range(len(near))]
            known = (np.ascontiguousarray(each) for each in map(np.array, zip(*found, strict=True)))
            states = StatesAtCrossings(*known)
            if isinstance(self.beside, Sines):
                waves = self.beside.waves
                parts = (np.ascontiguousarray(each) for each in (waves.real, waves.imag))
                sines = Waves(self.beside.omega, *parts)
            else:
                moved = self._turn(side) * self.beside.responses
                shocks = ShockResponses(np.ascontiguousarray(moved))
        outcrossing_ages(
            records, starts, self.motions[gap].speed * draws.units, self._looking_back[gap], gap,
            self.plan.step, stride, near, far, states, sines, shocks, ages,
        )  # fmt: skip
        return ages

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
