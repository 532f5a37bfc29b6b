"""Splitting: probabilities of impacts so fast, or so sharp, that hardly any cluster holds one.

A trial is a stretch of the stationary response without stops, which is Gaussian, and the motion
that the stops turn it into. There are two kinds of trials. Where first impacts are rare, a crossing
of a stop is put into a trial (`AfterCrossings`). If that is a first impact, it is followed for as
long as its cluster lasts. Where clusters follow without a pause, a trial is a piece of the whole
motion (`Windows`). The score of a trial is its largest impact speed or acceleration, whose
exceedance `trial_splitting` finds. The whole record moves, and not the speed of the first impact
alone: where a limit is exceeded by later impacts of a cluster, these are found as well. For several
pairs some moves also draw anew which stop is crossed.
"""

from __future__ import annotations

import math
import time
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Unpack

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from stochvi.mathematics.arrays import Vector
from stochvi.methods.monte_carlo.missions import NEEDS_FORCE
from stochvi.methods.monte_carlo.step_bias import (
    bias_of_plain_step,
    bias_of_smooth_motion,
    lossiest,
)
from stochvi.model.model import model_of
from stochvi.results.errors import NotApplicable
from stochvi.results.hardness import is_speed
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import UNFINISHED
from stochvi.statistics.cluster_paths import WINDOW_RELAXATIONS, WINDOWS, ClusterPaths
from stochvi.statistics.pair_crossings import Draws, GapRecords
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
        What the score measures: "impact_speed" of any pair or "peak_acceleration".
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
        trials, sharp = motion.shape[2] // 2, not is_speed(self.event)
        found = self.paths.follow(
            motion, accelerations=sharp, stride=stride, burn_in=burn_in, counted=counted
        )
        score: Vector
        if sharp:
            score = found.accelerations[:, self.outputs].max(axis=1)
        else:
            score = self.paths.fastest(found.impacts, trials).max(axis=0)
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
        # a window holds first impacts of other clusters as well, see `bursts.Bursts`
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
    paths = ClusterPaths(model, own, HORIZONS)
    if not is_speed(event) and not paths.outputs:
        raise NotApplicable("peak_acceleration", [NEEDS_FORCE])
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
    """The probability that an impact of a mission exceeds an "impact_speed" (m/s) or a
    "peak_acceleration" (m/s^2). The motion is the stationary one of a linear structure under any
    Gaussian noise, and sines beside it; an acceleration is that of some `outputs`, by default of
    all.

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
