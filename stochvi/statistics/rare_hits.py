"""Splitting: probabilities of impacts so fast, or so sharp, that hardly any cluster holds one.

A trial is a stretch of the stationary response without stops, which is Gaussian, and the motion
that the stops turn it into. There are two kinds of trials. Where first impacts are rare, a crossing
of a stop is put into a trial (`AfterCrossings`). If that is a first impact, it is followed for as
long as its cluster lasts. Where impacts hardly pause, a trial is a piece of the whole motion
(`Windows`). The score of a trial is its largest impact speed or acceleration. The probability that
it exceeds a limit is a product of the probabilities to get from one level to the next (S. K. Au and
J. L. Beck, Probab. Eng. Mech. 16 (2001) 263). Trials that exceed a level are copied, and every copy
is moved by

    y <- sqrt(1 - s^2) y + s z

with z a fresh record, which leaves the Gaussian distribution as it is (R. M. Neal 1998); it is
taken back if it falls below the level. The whole record moves, and not the speed of the first
impact alone: where a limit is exceeded by later impacts of a cluster, these are found as well. For
several pairs some moves also draw anew which stop is crossed. All trials weigh the same. A pilot
that is no part of the answer fixes the levels and s. The mean over independent repetitions
therefore has no bias (F. Cerou, P. Del Moral, T. Furon and A. Guyader, Stat. Comput. 22 (2012)
795); their scatter gives its error.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

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
from stochvi.results.deadline import Deadline
from stochvi.results.errors import Interrupted, NotApplicable, NotConverged
from stochvi.results.estimates import TOO_FEW, Estimate
from stochvi.results.intervals import (
    events_suffice,
    jackknife_error,
    logarithmic_interval,
    most_events,
    student_factor,
    upper_limit_unseen,
)
from stochvi.sampling.options import AccuracyOptions
from stochvi.sampling.run import Run, sampled
from stochvi.sampling.sampler import TrialSampler
from stochvi.sampling.stop_flag import GivenUp
from stochvi.scenes.scene import Scene
from stochvi.statistics.bursts import UNFINISHED
from stochvi.statistics.cluster_paths import WINDOW_RELAXATIONS, WINDOWS, ClusterPaths
from stochvi.statistics.pair_crossings import Draws, GapRecords

FLOWN_TOGETHER = 128
"""Number of trials that one call of the engine simulates."""

TRIALS, TRIALS_PER_SECOND, TRIALS_FOR_ERROR = 512, 16.0, 2.56
"""Largest number of trials in one repetition of the splitting; largest number per second of budget,
so that a small budget, too, holds several repetitions; and largest number times the square of the
relative error asked for."""

MOST_SAMPLES = 2**21
"""Largest number of samples that the trials of one repetition hold together, of all modes: 32
MB."""

TINY = 1e-300
"""Smallest number that a score is the inverse of."""

FEWEST_TRIALS = 64
"""Smallest number of trials in one repetition, where each takes many samples."""

SHARE = 0.25
"""Share of the trials that should exceed the next level."""

MOVES = 4
"""Number of moves of every trial at each level, so that its copies come to differ."""

ACCEPTED = 0.35
"""Share of the moves that should leave a trial above its level; the work for a given error hardly
changes between 0.2 and 0.5."""

FIRST_SIZE, SMALLEST_SIZE = 0.7, 0.02
"""Size s of the first move of the pilot, and the smallest one."""

CHANGED = 0.25
"""Share of the trials of several pairs for which a move also draws the stop anew that is crossed:
a stop that is reached seldom, but then hit hard, is found so."""

SIZE_STEP = 1.3
"""Factor by which the pilot changes the size s after each move."""

MOST_LEVELS = 24
"""Largest number of levels: probabilities below 0.25^24 = 4e-15 of a trial are not looked for."""

FEWEST_REPETITIONS = 16
"""Smallest number of repetitions in an answer: Student's quantile is then 2.13."""

FEWEST_WITH_SHARE = 4
"""Smallest number of repetitions that tell the share of late exceedances."""

MOST_REPETITIONS = 2**14
"""Largest number of repetitions, whatever the budget."""

FOR_ANSWER = 0.7
"""Share of the time that the pilot leaves to the repetitions, each of which takes about as long: a
limit that it did not reach by then is given an upper limit, from the levels that it did reach."""

FOR_LIMIT = 2.0 / 3.0
"""Share of the levels reached that the repetitions go through where the pilot did not reach the
limit: the last ones are left out, so that there is time for enough repetitions."""

MARGIN = 1.1
"""Factor on the number of repetitions for which the error so far asks."""

PILOT = 2**20
"""Number of the repetition that is the pilot."""

STREAM = 0x5EED5
"""Number that keeps the random numbers of this module apart from other uses of a seed."""

HORIZONS = 2.0 * WINDOWS
"""Length of a trial of the whole motion, as a multiple of the time for which the response remembers
its past: the first half is not counted, so that the motion forgets its start."""


class Trials(NamedTuple):
    """Trials of one repetition.

    Parameters
    ----------
    records
        (trials, samples, 2 modes): displacement and velocity of each mode without stops, in turn,
        before anything is made a crossing.
    pairs
        (trials, 2 + sines): standard normal numbers. The length of the first two is the slope of
        the crossing over the rms velocity (Rayleigh's distribution). The third chooses the phases
        of sines at a crossing; where there is none, each number chooses the phase of one sine.
    side
        (trials,): number of the stop that is crossed, see `Kind`.
    score
        (trials,): largest impact speed (m/s) or absolute acceleration (m/s^2); below 0 where no
        stop is hit, and minus infinity where the crossing is no first impact.
    """

    records: Vector
    pairs: Vector
    side: NDArray[np.intp]
    score: Vector

    def chosen(self, which: NDArray[np.intp]) -> Trials:
        """Copies of the trials of these numbers."""
        return Trials(self.records[which], self.pairs[which], self.side[which], self.score[which])


@dataclass(frozen=True, kw_only=True, eq=False)
class Kind(ABC):
    """A kind of trials.

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

    def drawn(self, draw: int) -> Trials:
        """Independent trials with their scores."""
        trials = self.fresh(draw)
        return trials._replace(score=self.scores(trials))

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
        trials, sharp = motion.shape[2] // 2, self.event == "peak_acceleration"
        impacts, _, accelerations = self.paths.follow(
            motion, accelerations=sharp, stride=stride, burn_in=burn_in, counted=counted
        )
        score: Vector
        if sharp:
            score = accelerations[:, self.outputs].max(axis=1)
        else:
            score = self.paths.fastest(impacts, trials).max(axis=0)
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
    def risk(self, exceeded: Vector, late: Vector, scored: Vector, mission: float) -> Vector:
        """Probability of an exceedance in a mission, from three probabilities of a trial: of an
        exceedance (`exceeded`), of one in the second half of the count alone (`late`), and of a
        score (`scored`)."""

    @abstractmethod
    def overlap(self, scored: float) -> float:
        """Expected number of first impacts of other clusters in the time that is simulated."""

    @abstractmethod
    def bias(self, scored: float, mission: float) -> float:
        """Relative bias of the risk: from overlapping clusters, and from clusters cut by the start
        or the end of a mission."""

    @abstractmethod
    def unfinished(self, exceeded: float, late: float, scored: float) -> float:
        """Share of the exceedances in the second half of the count, without those of new
        clusters."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AfterCrossings(Kind):
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
        ages = self._ages(self.fresh(_draw(PILOT, 0, 0)))
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


def risk_of_windows(exceeded: Vector, late: Vector, window: float, mission: float) -> Vector:
    """Probability of an exceedance in a mission, s, from that in a window, s.

    `late` is the part of the latter in which the first exceedance falls into the second half of the
    window.
    """
    before = np.maximum(1.0 - (exceeded - late), 1e-300)
    rate = -np.log1p(-np.minimum(late / before, 1.0 - 1e-15)) / (0.5 * window)
    left = max(mission - window, 0.0)
    return np.asarray(1.0 - (1.0 - np.minimum(exceeded, 1.0)) * np.exp(-rate * left))


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows(Kind):
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

    def bias(self, scored: float, mission: float) -> float:
        return 0.0

    def unfinished(self, exceeded: float, late: float, scored: float) -> float:
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
    if event == "peak_acceleration" and not paths.outputs:
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


@dataclass(frozen=True)
class Levels:
    """The settings that the pilot fixes: the levels, each with the size of the moves there, and
    whether the last level is the limit."""

    levels: tuple[float, ...]
    sizes: tuple[float, ...]
    reached: bool


class Repetition(NamedTuple):
    """Probabilities that one repetition found for a trial.

    They are those of an exceedance (at the sampling interval, and at twice that), of one in the
    second half of the counted time, and of having a score.
    """

    exceeded: float
    coarse: float
    late: float
    scored: float


def pilot(kind: Kind, limit: float, deadline: Deadline) -> Levels:
    """Levels and sizes of moves. About `SHARE` of the trials above one level exceed the next; about
    `ACCEPTED` of the moves stay above their level."""
    random = np.random.default_rng([kind.records.seed, STREAM, PILOT])
    trials = kind.drawn(_draw(PILOT, 0, 0))
    levels: list[float] = []
    sizes: list[float] = []
    size = FIRST_SIZE
    while len(levels) < MOST_LEVELS:
        level = float(np.quantile(trials.score, 1.0 - SHARE, method="lower"))
        if math.isinf(level):
            level = 0.0  # few trials have a score: the first level is to have one
        if level >= limit:
            return Levels((*levels, limit), tuple(sizes), True)
        if (levels and level <= levels[-1]) or not np.any(trials.score > level):
            break
        levels.append(level)
        trials = _copies(trials, np.flatnonzero(trials.score > level), random)
        for move in range(MOVES):
            if deadline.passed():
                return Levels(tuple(levels[:-1]), tuple(sizes), False)
            trials, kept = _moved(
                kind, trials, level, size, _draw(PILOT, len(levels), move), random
            )
            size = size * SIZE_STEP if kept > ACCEPTED else size / SIZE_STEP
            size = min(max(size, SMALLEST_SIZE), 1.0)
        sizes.append(size)
    return Levels(tuple(levels), tuple(sizes), False)


def repetition(kind: Kind, levels: Levels, number: int, deadline: Deadline) -> Repetition:
    """One splitting with fixed levels; `GivenUp` if the deadline came before its end."""
    random = np.random.default_rng([kind.records.seed, STREAM, number])
    trials = kind.drawn(_draw(number, 0, 0))
    scored = float(np.mean(trials.score > -math.inf))
    chance = 1.0
    last = len(levels.levels) - 1
    for stage, level in enumerate(levels.levels):
        above = np.flatnonzero(trials.score > level)
        if stage == last:
            break
        if not len(above):
            return Repetition(0.0, 0.0, 0.0, scored)
        chance *= len(above) / len(trials.score)
        trials = _copies(trials, above, random)
        for move in range(MOVES):
            if deadline.passed():
                raise GivenUp
            draw = _draw(number, stage + 1, move)
            trials, _ = _moved(kind, trials, level, levels.sizes[stage], draw, random)
    level = levels.levels[last]
    early = kind.scores(trials.chosen(above), half=True) > level
    coarse = kind.scores(trials, coarse=True) > level
    return Repetition(
        exceeded=chance * len(above) / len(trials.score),
        coarse=chance * float(np.mean(coarse)),
        late=chance * float(np.sum(~early)) / len(trials.score),
        scored=scored,
    )


def _draw(number: int, stage: int, move: int) -> int:
    """The number of a draw of trials in a stage of a repetition."""
    return (number * (MOST_LEVELS + 1) + stage) * MOVES + move


def _copies(trials: Trials, above: NDArray[np.intp], random: np.random.Generator) -> Trials:
    """As many trials as before, copied from those above a level, each about equally often."""
    count = len(trials.score)
    extra = random.permutation(above)[: count % len(above)]
    return trials.chosen(np.concatenate([np.repeat(above, count // len(above)), extra]))


def _moved(
    kind: Kind, trials: Trials, level: float, size: float, draw: int, random: np.random.Generator
) -> tuple[Trials, float]:
    """Every trial moved, and taken back if its score is not above the level; the share kept."""
    fresh = kind.fresh(draw)
    rest = math.sqrt((1.0 - size) * (1.0 + size))
    fresh.records[:] *= size
    fresh.records[:] += rest * trials.records
    fresh.pairs[:] = rest * trials.pairs + size * fresh.pairs
    side = trials.side
    if len(kind.paths.pairs) > 1:
        side = np.where(random.random(len(side)) < CHANGED, fresh.side, side)
    moved = fresh._replace(side=side)
    moved = moved._replace(score=kind.scores(moved))
    kept = moved.score > level
    for own, new in zip(trials, moved, strict=True):
        own[kept] = new[kept]
    return trials, float(np.mean(kept))


@dataclass(frozen=True, kw_only=True, eq=False)
class RareHits:
    """The probability of an exceedance in a mission, from repetitions of a splitting.

    Parameters
    ----------
    chance
        The probability, with the bias of the sampling interval and of clusters that meet. Where no
        trial exceeded the limit it is 0, with an upper limit.
    lower, upper
        Ends of the confidence interval; 0 and the upper limit where no trial exceeded the limit.
    kind
        The kind of trials from which the probability was found.
    repetitions, levels
        Number of repetitions, and of levels in each.
    seconds
        CPU seconds of the pilot and the repetitions.
    """

    chance: Estimate
    lower: float
    upper: float
    kind: Kind
    repetitions: int
    levels: int
    seconds: float = 0.0

    @property
    def relative_error(self) -> float:
        """Standard error over value; infinite where nothing was seen."""
        value = self.chance.value
        return self.chance.standard_error / value if value > 0.0 else math.inf


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
    ask = _Question(limit, mission, confidence, run)
    # where impacts hardly pause, or clusters hardly end, trials are pieces of the whole motion
    found = (ask.answer(bursts) if rare else None) or ask.answer(windows)
    assert found is not None
    return replace(found, seconds=time.process_time() - began)


@dataclass(frozen=True, eq=False)
class RepetitionSampler(TrialSampler):
    """Repetitions of a splitting with fixed levels, each of which stands for a path."""

    kind: Kind
    levels: Levels

    @property
    def block(self) -> int:
        """One repetition is a block."""
        return 1

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> Repetition:
        """One repetition."""
        return repetition(self.kind, self.levels, first_path, deadline)

    def describe(self, sample: list[Repetition]) -> str:
        """Their number, in words."""
        return f"{len(sample)} repetitions"


@dataclass(frozen=True)
class _Question:
    """A limit and a mission, the accuracy to which the probability is wanted, and the deadline."""

    limit: float
    mission: float
    confidence: float
    run: Run

    def answer(self, kind: Kind) -> RareHits | None:
        """The probability from one kind of trials; None where clusters do not end."""
        run = self.run
        levels = pilot(kind, self.limit, run.deadline.sooner(FOR_ANSWER))
        if not levels.reached:
            kept = math.ceil(FOR_LIMIT * len(levels.levels))
            levels = replace(levels, levels=levels.levels[:kept])
        if not levels.levels:
            return self._found(kind, levels, [])

        def error(done: list[Repetition]) -> float:
            enough = not levels.reached or len(done) >= MOST_REPETITIONS
            if enough or _unfinished(kind, done):
                return 0.0
            return self._found(kind, levels, done).relative_error

        try:
            done = run.to_accuracy(
                RepetitionSampler(kind, levels), FEWEST_REPETITIONS, error, run.accuracy, needed=0
            ).sample
        except (NotConverged, Interrupted):  # not one has ended
            done = []
        return None if _unfinished(kind, done) else self._found(kind, levels, done)

    def _found(self, kind: Kind, levels: Levels, done: list[Repetition]) -> RareHits:
        """The answer from the repetitions."""
        count, tried = len(done), kind.trials * (len(done) + 1)
        exceeded, coarse, late, scored = np.array(done).reshape(-1, 4).T
        if count < 2 or not exceeded.any():
            # the first trials of each repetition, and of the pilot, are independent
            most = upper_limit_unseen(tried, self.confidence)
            upper = float(
                kind.risk(np.array(most), np.array(0.5 * most), np.array(1.0), self.mission)
            )
            return self._at_most(kind, levels, count, upper, f"{tried} trials without one")

        def risk(rows: Vector) -> Vector:
            return kind.risk(rows[0], rows[1], rows[2], self.mission)

        rows = np.stack([exceeded, late, scored])
        value = float(risk(rows.mean(axis=1)))
        left_out = (rows.sum(axis=1, keepdims=True) - rows) / (count - 1)
        error = jackknife_error(risk(left_out))
        lower, upper = logarithmic_interval(value, error, count - 1, self.confidence)
        if not events_suffice(value, error, count):
            upper = most_events(value, error, count, self.confidence)
            words = f"seen {TOO_FEW}: {count} repetitions"
            return self._at_most(kind, levels, count, upper, words)
        if not levels.reached:
            words = f"the probability of exceeding {levels.levels[-1]:.4g}, {count} repetitions"
            return self._at_most(kind, levels, count, upper, words)
        at_twice = float(risk(np.array([coarse.mean(), late.mean(), scored.mean()])))
        step = kind.step_bias(abs(at_twice - value))
        apart = value * kind.bias(float(scored.mean()), self.mission)
        return RareHits(
            chance=Estimate(
                value=value,
                standard_error=error * student_factor(count),
                bias=None if step is None else step + apart,
                how=f"{count} repetitions; bias from twice the sampling interval",
            ),
            lower=lower,
            upper=min(upper, 1.0),
            kind=kind,
            repetitions=count,
            levels=len(levels.levels),
        )

    def _at_most(self, kind: Kind, levels: Levels, count: int, upper: float, how: str) -> RareHits:
        """The answer where no trial exceeded the limit: 0, with an upper limit of the
        probability."""
        most = min(upper, 1.0)
        return RareHits(
            chance=Estimate(value=0.0, bias=None, how=how, upper_95=most),
            lower=0.0,
            upper=most,
            kind=kind,
            repetitions=count,
            levels=len(levels.levels),
        )


def _unfinished(kind: Kind, done: list[Repetition]) -> bool:
    """Whether the exceedances of clusters come so late that clusters do not seem to end."""
    if len(done) < FEWEST_WITH_SHARE:
        return False
    exceeded, _, late, scored = np.mean(done, axis=0)
    return kind.unfinished(exceeded, late, scored) > UNFINISHED
