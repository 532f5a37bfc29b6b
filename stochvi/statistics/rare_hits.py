"""Impacts of a mission that exceed a limit. Chapters: rare exceedances by splitting; number and
hardest of the impacts of several pairs."""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from stochvi.engine.arithmetic import COLUMNS, Log
from stochvi.mathematics.numerics import Matrix, Vector
from stochvi.model.model import Model, model_of
from stochvi.motion.choose_plan import with_tables
from stochvi.motion.modal_tables import ModalTablesPlan, plan_modal_tables
from stochvi.motion.plan import bias_of_plain_step, bias_of_smooth_motion, lossiest
from stochvi.results.estimates import (
    Estimate,
    binomial_interval,
    jackknife_error,
    of_events,
    upper_limit_unseen,
)
from stochvi.sampling.calculations import AccuracyOptions, ListSampler
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.clusters import (
    UNFINISHED,
    WINDOW_RELAXATIONS,
    WINDOWS,
    Bursts,
    ClusterPaths,
    chance_of,
    clusters_apart,
)
from stochvi.statistics.crossings import Draws, FirstCrossings, GapRecords, PairMotion
from stochvi.statistics.hardness import FromSpeed, Limit, hardness_of
from stochvi.statistics.trial_splitting import (
    PILOT,
    STREAM,
    Kind,
    Question,
    RareHits,
    Trials,
    draw_of,
    risk_of_windows,
)

# ------------------------------------------------------------------------------
# Splitting: probabilities of impacts so fast, or so sharp, that hardly any cluster holds one.
#
# A trial is a stretch of the stationary response without stops, which is Gaussian, and the motion
# that the stops turn it into. There are two kinds of trials. Where first impacts are rare, a
# crossing of a stop is put into a trial (`AfterCrossings`). If that is a first impact, it is
# followed for as long as its cluster lasts. Where clusters follow without a pause, a trial is a
# piece of the whole motion (`Windows`). The score of a trial is its largest impact speed or
# acceleration, whose exceedance `trial_splitting` finds. The whole record moves, and not the speed
# of the first impact alone: where a limit is exceeded by later impacts of a cluster, these are
# found as well. For several pairs some moves also draw anew which stop is crossed.
# ------------------------------------------------------------------------------

FLOWN_TOGETHER = 128
"""Number of trials that one call of the engine simulates."""

TRIALS, TRIALS_PER_SECOND, TRIALS_FOR_ERROR = 512, 16.0, 2.56
"""Largest number of trials in one repetition of the splitting; largest number per second of budget,
so that a small budget, too, holds several repetitions; and largest number times the square of the
relative error asked for."""

MOST_SAMPLES = 2**21
"""Largest number of samples that the trials of one repetition hold together, of all modes: 32
MB."""

FEWEST_TRIALS = 64
"""Smallest number of trials in one repetition, where each takes many samples."""

HORIZONS = 2.0 * WINDOWS
"""Length of a trial of the whole motion, as a multiple of the time for which the response remembers
its past: the first half is not counted, so that the motion forgets its start."""


TINY = 1e-300
"""Smallest number that a score is the inverse of."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ImpactTrials(Kind):
    """Trials of motion that the stops turn.

    Parameters
    ----------
    paths
        Motion without stops, and what the stops make of it.
    event
        Kind of hardness that the score measures.
    samples
        Length of a trial, in samples.
    trials
        Number of trials in a repetition.
    sides
        (stops,): probability that a trial belongs to each stop.
    outputs
        Numbers of the coordinates and points whose acceleration counts.
    """

    paths: ClusterPaths
    event: str
    outputs: tuple[int, ...]
    samples: int
    trials: int
    sides: Vector

    @property
    def records(self) -> GapRecords:
        """The gaps without stops, and crossings that are put into them."""
        return self.paths.records

    @property
    def seed(self) -> int:
        """Seed of the records."""
        return self.records.seed

    @property
    def size(self) -> int:
        """Number of trials in a repetition."""
        return self.trials

    @property
    def several(self) -> bool:
        """Whether there are several pairs."""
        return len(self.paths.pairs) > 1

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.records.plan.step

    def step_bias(self, difference: float) -> float | None:
        """The bias that the sampling leaves in a probability, from its difference to half the
        sampling rate."""
        model = self.paths.model
        if not model.whites:
            return bias_of_smooth_motion(difference)
        return bias_of_plain_step("impact_speed_rate", difference, lossiest(model))

    def fresh(self, draw: int) -> Trials:
        """Independent trials, without their scores; each `draw` has random numbers of its own."""
        block, modes = self.paths.together, self.paths.model.modal.size
        starts = np.arange(0, self.records.plan.samples - self.samples + 1, self.records.count)
        paths = math.ceil(self.trials / len(starts))
        records = np.empty((self.trials, self.samples, 2 * modes))
        done = 0
        for first in range(0, paths, block):
            free = self.paths.free(draw * TRIALS + first)
            for start in starts:
                size = min(block, self.trials - done)
                records[done : done + size] = free[:size, start : start + self.samples]
                done += size
        random = np.random.default_rng([self.records.seed, STREAM, draw])
        pairs = random.standard_normal((self.trials, 2 + self.records.sines.number))
        side = random.choice(len(self.sides), self.trials, p=self.sides)
        return Trials(records, pairs, side, np.full(self.trials, -math.inf))

    def scores(self, trials: Trials, *, half: bool = False, coarse: bool = False) -> Vector:
        """The score of every trial; with `half` from the first half of what counts alone, with
        `coarse` at twice the sampling interval."""
        found = np.full(len(trials.side), -math.inf)
        for which in self._together(trials):
            motion, burn_in = self._motion(trials.chosen(which), 2 if coarse else 1)
            counted = (len(motion) - 1 - burn_in) // (2 if half else 1)
            found[which] = self._score_of(motion, burn_in, counted, 2 if coarse else 1)
        return found

    def _together(self, trials: Trials) -> Iterator[NDArray[np.intp]]:
        """Numbers of the trials that have a score, in parts that are simulated together and belong
        to one stop."""
        scored = self._counts(trials)
        for number in range(len(self.sides)):
            (chosen,) = np.nonzero(scored & (trials.side == number))
            for first in range(0, len(chosen), FLOWN_TOGETHER):
                yield chosen[first : first + FLOWN_TOGETHER]

    def _score_of(self, motion: Vector, burn_in: int, counted: int, stride: int) -> Vector:
        """The scores of trials with such a motion without stops. Where no stop is hit, it is a
        negative number that rises with how close the motion comes to a stop."""
        kind, trials = hardness_of(self.event), motion.shape[2] // 2
        found = self.paths.follow(
            motion, accelerations=not isinstance(kind, FromSpeed), stride=stride,
            burn_in=burn_in, counted=counted,
        )  # fmt: skip
        score: Vector
        if isinstance(kind, FromSpeed):
            speeds = self.paths.fastest(found.impacts, trials)
            score = kind.of_pairs(speeds, self.paths.model.masses_of_pairs)
        else:
            score = found.accelerations[:, self.outputs].max(axis=1)
        (missed,) = np.nonzero(score == 0.0)
        if len(missed):
            gaps = motion[:counted, :, 2 * missed].transpose(2, 0, 1)
            reached = gaps @ self.paths.motion.rows[self.records.chosen].T
            above, below = self.records.above[0], self.records.below[0]
            closeness = np.maximum(reached / above, -reached / below).max(axis=(1, 2))
            score[missed] = -1.0 / np.maximum(closeness, TINY)
        return score

    @abstractmethod
    def _counts(self, trials: Trials) -> NDArray[np.bool_]:
        """(trials,): whether a trial has a score at all."""

    @abstractmethod
    def _motion(self, trials: Trials, stride: int) -> tuple[Vector, int]:
        """Motion without stops of trials that belong to one stop, for `ClusterPaths.follow`, and
        how many samples are simulated before counting starts."""

    @abstractmethod
    def overlap(self, scored: float) -> float:
        """Expected number of first impacts of other clusters in the time that is simulated."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AfterCrossings(ImpactTrials):
    """Trials with a crossing, that count where the crossing is a first impact: no stop was reached
    for `Records.horizon` seconds before.

    A first impact happens `rate` times P(score) times a second, `rate` that of all crossings
    (Rice).
    """

    rate: float
    crossed: tuple[tuple[int, float], ...]
    """The side of the records and the sign of each stop, see `ClusterPaths.around`."""

    @property
    def window(self) -> float:
        """Seconds that are simulated after a first impact."""
        return (self.samples - self.records.count - 2) * self.step

    @property
    def relaxation(self) -> float:
        """Time constant of the structure, s."""
        return self.window / WINDOW_RELAXATIONS

    def rare(self) -> bool:
        """Whether first impacts are so rare that hardly any falls into the window after another
        one."""
        ages = self._ages(self.fresh(draw_of(PILOT, 0, 0)))
        # see `first_crossings`: the probability of no impact for so long, and the limiting rate
        quiet = 1.0 - self.rate * float(ages.mean())
        first_rate = self.rate * float(np.mean(ages >= self.records.horizon))
        return quiet > 0.5 and first_rate / quiet * self.window < UNFINISHED

    def _counts(self, trials: Trials) -> NDArray[np.bool_]:
        return self._ages(trials) >= self.records.horizon

    def _ages(self, trials: Trials) -> Vector:
        """(trials,): seconds without an impact before the crossing, up to the horizon."""
        crossing, ages = self.records.count + 1, np.empty(len(trials.side))
        gaps = self.paths.gaps(trials.records[:, : crossing + 1])
        for number, (side, _) in enumerate(self.crossed):
            (which,) = np.nonzero(trials.side == number)
            found = self.records.ages_before(
                side, gaps[which], np.array([crossing]), _draws(trials).of((which, None))
            )
            ages[which] = found[0, :, 0]
        return ages

    def _motion(self, trials: Trials, stride: int) -> tuple[Vector, int]:
        side, sign = self.crossed[trials.side[0]]
        count = len(trials.side)
        crossing = np.full(count, self.records.count + 1)
        motion = self.paths.around(
            trials.records, side, np.arange(count), crossing, _draws(trials),
            np.full(count, sign), stride,
        )  # fmt: skip
        return motion, 0

    def risk(self, exceeded: Vector, late: Vector, scored: Vector, mission: float) -> Vector:
        # a window holds first impacts of other clusters as well, see `clusters.Bursts`
        others = self.rate * scored * (self.window - self.records.horizon)
        return np.asarray(-np.expm1(-self.rate * exceeded / (1.0 + others) * mission))

    def overlap(self, scored: float) -> float:
        return self.rate * scored * self.window

    def bias(self, scored: float, mission: float) -> float:
        # clusters that began before a mission may exceed the limit in it
        return self.overlap(scored) + self.relaxation / mission

    def unfinished(self, exceeded: float, late: float, scored: float) -> float:
        share = late / exceeded if exceeded else 0.0
        return max(share - 0.5 * self.overlap(scored), 0.0)  # without those of new clusters


def _draws(trials: Trials) -> Draws:
    """Random numbers (trials,) of the crossings."""
    units: Vector = np.hypot(trials.pairs[:, 0], trials.pairs[:, 1])
    return Draws(units, ndtr(trials.pairs[:, 2]) if trials.pairs.shape[1] > 2 else None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows(ImpactTrials):
    """Trials of the whole motion, of which the last `counted` samples count."""

    counted: int

    @property
    def window(self) -> float:
        """Counted seconds of a trial."""
        return self.counted * self.step

    def _counts(self, trials: Trials) -> NDArray[np.bool_]:
        return np.ones(len(trials.side), bool)

    def _motion(self, trials: Trials, stride: int) -> tuple[Vector, int]:
        records = trials.records[:, ::stride]
        count, samples, width = records.shape
        motion = np.empty((samples, width // 2, 2 * count))
        motion[:, :, 0::2] = records[:, :, 0::2].transpose(1, 2, 0)
        motion[:, :, 1::2] = records[:, :, 1::2].transpose(1, 2, 0) / self.paths.plans[1].scale
        burn_in = samples - 1 - self.counted // stride
        if trials.pairs.shape[1] > 2:
            phases = 2.0 * math.pi * ndtr(trials.pairs[:, 2:])
            found = self.paths.motion.sines_after(phases, stride * self.step * np.arange(samples))
            motion[:, :, 0::2] += found[0]
            motion[:, :, 1::2] += found[1] / self.paths.plans[1].scale
        return np.roll(motion, -burn_in - 1, axis=0), burn_in

    def risk(self, exceeded: Vector, late: Vector, scored: Vector, mission: float) -> Vector:
        return risk_of_windows(exceeded, late, self.window, mission)

    def overlap(self, scored: float) -> float:
        return 0.0


def kinds_of(
    scene: Scene, event: str, mission: float, rel_error: float, seed: int, budget: float | None,
    outputs: Sequence[str] | None = None,
) -> tuple[AfterCrossings, Windows]:  # fmt: skip
    """Both kinds of trials of a scene, whose score is the largest acceleration of some `outputs`,
    by default of all. `budget` is what a user asked for, in seconds, and not what
    is left of it: no digit depends on the load of a machine.

    Raises `NotApplicable` as `bursts` does, and where a stop has no force, so that its impacts have
    no acceleration.
    """
    model = model_of(scene)
    own = int(np.random.SeedSequence([seed, STREAM]).generate_state(1, np.uint64)[0] >> 1)
    hardness_of(event).check(model)
    paths = ClusterPaths(model, own, HORIZONS)
    records, modes = paths.records, paths.model.modal.size
    chosen = paths.outputs if outputs is None else outputs
    columns = tuple(paths.outputs.index(name) for name in chosen)
    # stops that are equally far are not alike in what follows a crossing
    signs = (1.0, -1.0)
    crossed = [
        (number, sign, rate / 2.0 if records.alike else rate)
        for number, ((_, near, _), rate) in enumerate(
            zip(records.sides, records.rice_rates[:, 0], strict=True)
        )
        for sign in (signs if records.alike else signs[int(near is not records.above) :][:1])
    ]
    rates = np.array([rate for _, _, rate in crossed])
    most = min(TRIALS, TRIALS_FOR_ERROR / rel_error**2)
    if budget is not None:
        most = min(most, TRIALS_PER_SECOND * budget)
    trials = 2 ** int(math.log2(max(most, 1.0)))

    def fitting(samples: int) -> int:
        return int(max(min(trials, MOST_SAMPLES // (samples * modes)), FEWEST_TRIALS))

    after = paths.motion.window
    length = records.count + 2 + after
    bursts = AfterCrossings(
        paths=paths,
        event=event,
        outputs=columns,
        samples=length,
        trials=fitting(length),
        sides=rates / rates.sum() if rates.sum() > 0.0 else np.full(len(rates), 1.0 / len(rates)),
        rate=float(rates.sum()),
        crossed=tuple((number, sign) for number, sign, _ in crossed),
    )
    counted = min(after, max(2, round(mission / records.plan.step)))
    length = after + 1 + counted
    windows = Windows(
        paths=paths,
        event=event,
        outputs=columns,
        samples=length,
        trials=fitting(length),
        sides=np.ones(1),
        counted=counted,
    )
    return bursts, windows


@sampled(rel_error=0.05)
def rare_hits(
    scene: Scene,
    event: str,
    limit: float,
    *,
    mission: float,
    outputs: Sequence[str] | None = None,
    confidence: float = 0.95,
    **options: Unpack[AccuracyOptions],
) -> RareHits:
    """The probability that an impact of a mission exceeds a limit, by the kind of hardness of this
    name. The motion is the stationary one of a linear structure under any Gaussian noise, and sines
    beside it; an acceleration is that of some `outputs`, by default of all.

    It ends once the probability is known to `rel_error`, or at the end of the budget with the
    accuracy reached by then.

    Raises
    ------
    NotApplicable
        As `bursts`, and for accelerations at rigid stops.
    """
    run = Run.of(options)
    bursts, windows = kinds_of(
        scene, event, mission, run.accuracy, run.seed, run.deadline.budget, outputs
    )
    began = time.process_time()
    rare = mission > bursts.window and bursts.rare()
    ask = Question(limit, mission, confidence, run)
    # where clusters follow without a pause, or hardly end, trials are pieces of the whole motion
    found = (ask.answer(bursts) if rare else None) or ask.answer(windows)
    assert found is not None
    return replace(found, seconds=time.process_time() - began)


# ------------------------------------------------------------------------------
# Impacts of several pairs of a structure in a mission: their number, and how hard the hardest is.
#
# Where first impacts are rare, clusters are followed from first impacts on (`bursts`). Fast first
# impacts are drawn more often where a limit asks for them. Where clusters follow without a pause,
# pieces of the whole motion are simulated (`Windows`). Two shares then give the probability that a
# limit is exceeded in a mission: of windows in which it is exceeded, and of windows in whose second
# half it is exceeded for the first time.
# ------------------------------------------------------------------------------


TYPICAL_SPEED = 1.25
"""Speed of a usual first impact in rms velocities: about half of the first impacts are faster."""

WIDEST = 3.0
"""Largest factor on the speeds of first impacts; statistical weights grow with this factor."""

FEWEST_WINDOWS, MOST_WINDOWS = 64, 2**15
"""Smallest and largest number of windows of the whole motion."""

LOGGED = 2**16
"""Number of impacts for which the log of a block of windows has room at first."""


@dataclass(frozen=True, kw_only=True)
class Exceedance:
    """The probability that a limit is exceeded in a mission, with the interval from so many trials.

    Parameters
    ----------
    chance
        The probability; 0 with an upper limit where no trial exceeded the limit.
    by_output
        The probability of each output alone, of a limit of an acceleration.
    way
        "bursts" or "windows".
    degrees
        Number of independent paths less one.
    """

    chance: Estimate
    by_output: Mapping[str, Estimate]
    way: str
    trials: int
    degrees: int


def exceedance(
    scene: Scene, limit: Limit, mission: float, overlap: float, run: Run,
    far_from: float | None = None,
) -> Exceedance:  # fmt: skip
    """The probability that any impact of the mission exceeds a limit; `overlap` as for
    `count_impacts`, and `far_from` a rate of exceedances as for `bursts`."""

    def rate(found: Bursts, outputs: tuple[str, ...] = limit.outputs) -> Estimate:
        return found.exceedance_rate(limit.event, limit.value, outputs)

    widening = widening_of(model_of(scene), limit)
    found = clusters_apart(scene, overlap, run, rate, widening=widening, far_from=far_from)
    if found is None:
        return windows(scene, limit, mission, **run.options(rel_error=run.rel_error))
    reach = found.window / WINDOW_RELAXATIONS / mission

    def chance(outputs: tuple[str, ...]) -> Estimate:
        return chance_of(found.limited(rate(found, outputs)), mission, reach)

    return Exceedance(
        chance=chance(limit.outputs),
        by_output={name: chance((name,)) for name in limit.outputs},
        way="bursts",
        trials=len(found.path),
        degrees=max(found.paths - 1, 1),
    )


def overlap_of(crossings: FirstCrossings) -> float:
    """Expected first impacts in the time for which a cluster is followed, at the first level."""
    return crossings.first_rate()[0].value * WINDOWS * crossings.horizon


def widening_of(model: Model, limit: Limit) -> float:
    """Factor on the speeds of the first impacts that are drawn, so that some impacts exceed a
    limit."""
    ratio = min(
        limit.kind.speed_of(model, pair, limit) / speed
        for pair, speed in zip(model.pairs, PairMotion(model).velocity_std, strict=True)
        if speed > 0.0
    )
    return float(min(max(ratio / TYPICAL_SPEED, 1.0), WIDEST))


# Windows of the whole motion ---------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class WindowSampler(ListSampler):
    """Windows of the motion with stops, each a path of its own of `plan`.

    A sample are arrays (parts, names, windows): how hard the hardest impact is, by accelerations
    that of each of the outputs, in each of these `parts` of a window from its start.
    """

    plan: ModalTablesPlan
    event: str
    outputs: tuple[str, ...]
    seed: int
    parts: tuple[float, ...] = (1.0,)

    @property
    def block(self) -> int:
        """Number of windows that are simulated together."""
        return self.plan.block

    @property
    def window(self) -> float:
        """Length of a window, s."""
        return self.plan.steps * self.plan.step

    def add_up(self, pieces: list[Vector]) -> list[Vector]:
        """The windows of a block."""
        return [np.concatenate(pieces, axis=2)]

    def paths(self, sample: list[Vector]) -> int:
        """Number of windows."""
        return sum(each.shape[2] for each in sample)

    def simulate(self, first_path: int, paths: int) -> Vector:
        """The largest of some windows."""
        kind = hardness_of(self.event)
        if isinstance(kind, FromSpeed):
            found = np.zeros((len(self.parts), 1, paths))
            path, pair, time, speed = self._impacts(first_path, paths)
            hardness = kind.at(np.abs(speed), self.plan.model.masses_of_pairs[pair.astype(int)])
            for part, largest in zip(self.parts, found, strict=True):
                early = time <= part * self.window
                np.maximum.at(largest[0], path[early].astype(int), hardness[early])
            return found
        names = self.plan.model.outputs
        rows = [names.index(name) for name in self.outputs]
        found = np.zeros((len(self.parts), paths, len(names)))
        for part, largest in zip(self.parts, found, strict=True):
            plan = self.plan if part == 1.0 else replace(self.plan, duration=part * self.window)
            plan.averages(self.seed, first_path, paths, accelerations=largest)
        return found[:, :, rows].swapaxes(1, 2)

    def _impacts(self, first: int, paths: int) -> Matrix:
        """Path, pair, time and signed speed (4, impacts) of all impacts."""
        rows = LOGGED
        while True:
            log = Log(np.zeros((rows, COLUMNS)), np.zeros(1, np.int64), 0.0)
            self.plan.averages(self.seed, first, paths, log=log)
            if log.count[0] <= rows:
                break
            rows = int(log.count[0])
        return log.events[: log.count[0]].T


@sampled(rel_error=0.05)
def windows(
    scene: Scene, limit: Limit, mission: float, **options: Unpack[AccuracyOptions]
) -> Exceedance:
    """The probability that a limit is exceeded in a mission, from windows of the motion with
    stops."""
    run = Run.of(options)
    plan = plan_modal_tables(with_tables(model_of(scene)), None, None)
    longest = plan.block_length - plan.burn_in
    plan = replace(plan, duration=max(min(longest, mission), 2.0 * plan.step))
    sampler = WindowSampler(plan, limit.event, limit.outputs, run.seed, parts=(0.5, 1.0))

    def chance_in(sample: list[Vector], name: int | None = None) -> Estimate:
        seen = np.concatenate(sample, axis=2) > limit.value
        chosen = seen.any(axis=1) if name is None else seen[:, name]
        return _of_windows(np.asarray(chosen), sampler.window, mission)

    def error(sample: list[Vector]) -> float:
        chance = chance_in(sample)
        if sampler.paths(sample) >= MOST_WINDOWS:
            return 0.0
        return chance.standard_error / chance.value if chance.value else math.inf

    taken = run.to_accuracy(sampler, max(plan.block, FEWEST_WINDOWS), error, run.accuracy)
    by_output = {name: chance_in(taken.sample, number) for number, name in enumerate(limit.outputs)}
    found = Exceedance(
        chance=chance_in(taken.sample), by_output=by_output, way="windows", trials=taken.paths,
        degrees=taken.paths - 1,
    )  # fmt: skip
    if run.deadline.interrupted:
        raise run.deadline.fell_short(f"after {taken.paths} windows", "", found)
    return found


def _of_windows(seen: NDArray[np.bool_], window: float, mission: float) -> Estimate:
    """The probability in a mission from exceedances (2, windows): in the first half of each window,
    and in the whole window."""
    count = seen.shape[1]
    early, whole = seen.astype(float)
    if not whole.any():
        most = upper_limit_unseen(count)
        upper = float(risk_of_windows(np.array(most), np.array(0.5 * most), window, mission))
        how = f"{count} windows without one"
        return Estimate(value=0.0, bias=None, how=how, upper_95=min(upper, 1.0))
    late = whole - early

    def risk(exceeded: Vector, late: Vector) -> Vector:
        return risk_of_windows(exceeded, late, window, mission)

    value = float(risk(whole.mean(), late.mean()))
    left_out = risk((whole.sum() - whole) / (count - 1), (late.sum() - late) / (count - 1))
    error = jackknife_error(left_out)
    if whole.all():  # the error then follows from the lower limit of the probability
        least = binomial_interval(count, count)[0]
        error = 0.5 * float(1.0 - risk(np.array(least), np.array(0.0)))
    found = Estimate(
        value=value, standard_error=error, bias=0.0, how=f"{count} windows of {window:.3g} s"
    )
    at_most = found if whole.all() else of_events(found, count)
    return replace(at_most, upper_95=at_most.upper_95 and min(at_most.upper_95, 1.0))
