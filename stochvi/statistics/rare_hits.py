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
impact alone: where a limit is exceeded by later impacts of a cluster, these are found as well. All
trials weigh the same. A pilot that is no part of the answer fixes the levels and s. The mean over
independent repetitions therefore has no bias (F. Cerou, P. Del Moral, T. Furon and A. Guyader,
Stat. Comput. 22 (2012) 795); their scatter gives its error.
"""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Vector
from stochvi.mathematics.impact_rates import rice_rate
from stochvi.methods.monte_carlo.kernels.rows import Extremes, Sums
from stochvi.methods.monte_carlo.tabulated import TabulatedPlan
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
from stochvi.statistics.cluster_paths import TOUCH, WINDOW_RELAXATIONS, WINDOWS
from stochvi.statistics.first_crossings import Records, crossing_plan

FLOWN_TOGETHER = 128
"""Number of trials that one call of the engine simulates."""

TRIALS, TRIALS_PER_SECOND, TRIALS_FOR_ERROR = 512, 16.0, 2.56
"""Largest number of trials in one repetition of the splitting; largest number per second of budget,
so that a small budget, too, holds several repetitions; and largest number times the square of the
relative error asked for."""

MOST_SAMPLES = 2**21
"""Largest number of samples that the trials of one repetition hold together: 32 MB."""

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
        (trials, samples, 2): x and x' without stops, before anything is made a crossing, m and m/s.
    pairs
        (trials, 2): standard normal numbers; the length of a pair is the slope of the crossing over
        the rms velocity (Rayleigh's distribution).
    side
        (trials,): number of the stop that is crossed.
    score
        (trials,): largest impact speed (m/s) or absolute acceleration (m/s^2); minus infinity where
        the crossing is no first impact.
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
    records
        Records of the response without stops: their plan and its correlation.
    event
        What the score measures: "impact_speed" or "peak_acceleration".
    samples
        Length of a trial, in samples.
    trials
        Number of trials in a repetition.
    sides
        (stops,): probability that a trial belongs to each stop.
    """

    records: Records
    event: str
    samples: int
    trials: int
    sides: Vector

    @property
    def plan(self) -> TabulatedPlan:
        """Synthesis of the response without stops."""
        return self.records.plan

    def fresh(self, draw: int) -> Trials:
        """Independent trials, without their scores; each `draw` has random numbers of its own."""
        plan, count = self.plan, self.records.count
        starts = np.arange(0, plan.samples - self.samples + 1, count)
        paths = math.ceil(self.trials / len(starts))
        records = np.empty((self.trials, self.samples, 2))
        done = 0
        for first in range(0, paths, plan.block):
            free = plan.free_response(self.records.seed, draw * TRIALS + first, plan.block, 0)
            for start in starts:
                part = free[start : start + self.samples]
                size = min(plan.block, self.trials - done)
                records[done : done + size, :, 0] = part[:, 0 : 2 * size : 2].T
                records[done : done + size, :, 1] = plan.model.omega * part[:, 1 : 2 * size : 2].T
                done += size
        random = np.random.default_rng([self.records.seed, STREAM, draw])
        pairs = random.standard_normal((self.trials, 2))
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
        (chosen,) = np.nonzero(self._counts(trials))
        plan = self.plan
        if coarse:
            plan = replace(plan, block_length=2.0 * plan.block_length)
        for first in range(0, len(chosen), FLOWN_TOGETHER):
            which = chosen[first : first + FLOWN_TOGETHER]
            rows, warm_up = self._rows(trials.chosen(which), 2 if coarse else 1)
            counted = len(rows) - warm_up - 1
            extremes = Extremes.zeros(len(which))
            sums = Sums.zeros(len(which), plan.contacts).table
            # the engine begins with the samples before the crossing, which stand at the end of a
            # record
            rows = np.ascontiguousarray(np.roll(rows, -warm_up - 1, axis=0))
            plan.add_impacts(
                rows, warm_up, counted // 2 if half else counted, sums, None, extremes.table
            )
            found[which] = self._score_of(extremes)
        return found

    def _score_of(self, extremes: Extremes) -> Vector:
        """The scores of trials with such extremes. Where no stop was hit, a negative number that
        rises with the largest acceleration stands for the speed: it shows which trials came
        close, and lies below all speeds."""
        if self.event == "peak_acceleration":
            return extremes.acceleration
        speed = extremes.impact_speed
        return np.where(speed > 0.0, speed, -1.0 / np.maximum(extremes.acceleration, 1e-300))

    @abstractmethod
    def _counts(self, trials: Trials) -> NDArray[np.bool_]:
        """(trials,): whether a trial has a score at all."""

    @abstractmethod
    def _rows(self, trials: Trials, stride: int) -> tuple[Vector, int]:
        """Rows for the engine, (samples, 2 trials), from one sample before the first one that is
        simulated, and how many samples are simulated before counting starts."""

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
    near: Vector
    far: Vector
    signs: Vector

    @property
    def window(self) -> float:
        """Seconds that are simulated after a first impact."""
        return (self.samples - self.records.count - 2) * self.plan.step

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
        count, ages = self.records.count, np.empty((1, len(trials.side), 1))
        for number in range(len(self.sides)):
            (which,) = np.nonzero(trials.side == number)
            found = self.records.ages_before(
                trials.records[which], np.array([count + 1]), self._slopes(trials)[which, None],
                1, self.near[[number]], self.far[[number]],
            )  # fmt: skip
            ages[:, which] = found
        return np.asarray(ages[0, :, 0])

    def _slopes(self, trials: Trials) -> Vector:
        return np.asarray(self.records.velocity_std * np.hypot(*trials.pairs.T))

    def _rows(self, trials: Trials, stride: int) -> tuple[Vector, int]:
        crossing = self.records.count + 1
        sample = np.arange(-stride, self.samples - crossing, stride)
        rows = after_crossings(
            self.records, trials.records[:, crossing + sample], trials.records[:, crossing],
            sample, self._slopes(trials), self.near[trials.side], self.signs[trials.side],
        )  # fmt: skip
        return rows, 0

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


def after_crossings(
    records: Records,
    record: Vector,
    here: Vector,
    sample: NDArray[np.int64],
    slopes: Vector,
    near: Vector,
    sign: Vector,
) -> Vector:
    """Records around crossings (see `kernels.crossings`), in rows for the engine.

    Parameters
    ----------
    record, here
        (clusters, samples, 2) and (clusters, 2): x and x' of stationary records at the samples, and
        at the one that is made a crossing.
    sample
        (samples,): numbers of the samples, from the crossing.
    slopes, near, sign
        (clusters,): speed of the crossing (m/s), distance of the stop (m), and 1 for an upper stop,
        -1 for a lower one.
    """
    rho, rho_rate, eta, eta_rate = records.shape[np.abs(sample)].T
    back = np.where(sample < 0, -1.0, 1.0)
    away = (1.0 + TOUCH) * near - here[:, 0]
    change = slopes - here[:, 1]
    y = record[:, :, 0] + away[:, None] * rho + change[:, None] * back * eta
    rate = record[:, :, 1] + away[:, None] * back * rho_rate + change[:, None] * eta_rate
    rows = np.empty((len(sample), 2 * len(record)))
    rows[:, 0::2] = (sign[:, None] * y).T
    rows[:, 1::2] = (sign[:, None] * rate).T / records.plan.model.omega
    return rows


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
        return self.counted * self.plan.step

    def _counts(self, trials: Trials) -> NDArray[np.bool_]:
        return np.ones(len(trials.side), bool)

    def _rows(self, trials: Trials, stride: int) -> tuple[Vector, int]:
        records = trials.records[:, ::stride]
        rows = np.empty((records.shape[1], 2 * len(records)))
        rows[:, 0::2] = records[:, :, 0].T
        rows[:, 1::2] = records[:, :, 1].T / self.plan.model.omega
        return rows, len(rows) - 1 - self.counted // stride

    def risk(self, exceeded: Vector, late: Vector, scored: Vector, mission: float) -> Vector:
        return risk_of_windows(exceeded, late, self.window, mission)

    def overlap(self, scored: float) -> float:
        return 0.0

    def bias(self, scored: float, mission: float) -> float:
        return 0.0

    def unfinished(self, exceeded: float, late: float, scored: float) -> float:
        return 0.0


def kinds_of(
    scene: Scene, event: str, mission: float, rel_error: float, seed: int, budget: float | None
) -> tuple[AfterCrossings, Windows]:
    """Both kinds of trials of a scene. `budget` is what a user asked for, in seconds, and not what
    is left of it: no digit depends on the load of a machine.

    Raises `NotApplicable` as `first_crossings` does, or without stops on both sides of the mean
    position.
    """
    plan = crossing_plan(scene, HORIZONS)
    model = model_of(scene)
    stops = [
        (float(stop.side), stop.side * (stop.position - model.rest))
        for stop in model.stops_per_unit_mass
    ]
    if not stops or min(place for _, place in stops) <= 0.0:
        raise NotApplicable("rare impacts", ["needs a stop, and none beyond the mean position"])
    own = int(np.random.SeedSequence([seed, STREAM]).generate_state(1, np.uint64)[0] >> 1)
    near = np.array([place for _, place in stops])
    records = Records(plan, own, near[:1], near[:1])
    # the stops are not alike for what follows a crossing, even where they are equally far
    far = near[::-1] if len(near) == 2 else np.array([math.inf])
    rates = rice_rate(near, records.displacement_std, records.velocity_std)
    most = min(TRIALS, TRIALS_FOR_ERROR / rel_error**2)
    if budget is not None:
        most = min(most, TRIALS_PER_SECOND * budget)
    trials = 2 ** int(math.log2(max(most, 1.0)))

    def fitting(samples: int) -> int:
        return int(max(min(trials, MOST_SAMPLES // samples), FEWEST_TRIALS))

    after = math.ceil(WINDOWS * records.count)
    length = records.count + 2 + after
    bursts = AfterCrossings(
        records=records,
        event=event,
        samples=length,
        trials=fitting(length),
        sides=rates / rates.sum() if rates.sum() > 0.0 else np.full(len(near), 1.0 / len(near)),
        rate=float(rates.sum()),
        near=near,
        far=far.copy(),
        signs=np.array([sign for sign, _ in stops]),
    )
    counted = min(after, max(2, round(mission / plan.step)))
    length = after + 1 + counted
    windows = Windows(
        records=records,
        event=event,
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
    """Probabilities that one repetition found for a trial: of an exceedance, at the sampling
    interval and at twice that; of one in the second half of what counts alone; and of having a
    score."""

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
    moved = fresh._replace(side=trials.side)
    moved = moved._replace(score=kind.scores(moved))
    kept = moved.score > level
    for own, new in ((trials.records, moved.records), (trials.pairs, moved.pairs)):
        own[kept] = new[kept]
    trials.score[kept] = moved.score[kept]
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
    confidence: float = 0.95,
    **options: Unpack[AccuracyOptions],
) -> RareHits:
    """The probability that an impact of a mission exceeds an "impact_speed" (m/s) or a
    "peak_acceleration" (m/s^2). The motion is the stationary one of one oscillator under any
    Gaussian noise.

    It ends once the probability is known to `rel_error`, or at the end of the budget with the
    accuracy reached by then.

    Raises
    ------
    NotApplicable
        As `first_crossings`, or if there are no stops on both sides of the mean position.
    """
    run = Run.of(options)
    bursts, windows = kinds_of(scene, event, mission, run.accuracy, run.seed, run.deadline.budget)
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
        step = kind.plan.step_bias("impact_speed_rate", abs(at_twice - value))
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
