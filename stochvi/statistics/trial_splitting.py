"""Splitting of trials. Chapters: probability that the score of random motion exceeds a limit; noise
with fast peaks; the hazard of reaching a place."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.mathematics.spectra import Table, bin_variances
from stochvi.mathematics.unsteady_noise import FastPeaks, PeakedRecords
from stochvi.model.model import Model
from stochvi.motion.choose_plan import GapResponse
from stochvi.motion.plan import bias_of_smooth_motion
from stochvi.results.deadline import Deadline
from stochvi.results.errors import Interrupted, NotConverged
from stochvi.results.estimates import (
    TOO_FEW,
    Estimate,
    events_suffice,
    jackknife_error,
    logarithmic_interval,
    most_events,
    student_factor,
    upper_limit_unseen,
)
from stochvi.sampling.calculations import GivenUp, TrialSampler
from stochvi.sampling.run import Run
from stochvi.statistics.clusters import UNFINISHED
from stochvi.statistics.crossings import PairMotion, memory_of
from stochvi.statistics.hazards import KNOWN, HazardCurve

# ------------------------------------------------------------------------------
# Splitting: the probability that the score of a stretch of random motion exceeds a limit, however
# small.
#
# A trial is made of numbers with a Gaussian distribution, and its score is a function of them. The
# probability that it exceeds a limit is a product of the probabilities to get from one level to the
# next (S. K. Au and J. L. Beck, Probab. Eng. Mech. 16 (2001) 263). Trials that exceed a level are
# copied, and every copy is moved by
#
#     y <- sqrt(1 - s^2) y + s z
#
# with z a fresh trial, which leaves the Gaussian distribution as it is (R. M. Neal 1998); it is
# taken back if it falls below the level. All trials weigh the same. A pilot that is no part of the
# answer fixes the levels and s. The mean over independent repetitions therefore has no bias (F.
# Cerou, P. Del Moral, T. Furon and A. Guyader, Stat. Comput. 22 (2012) 795); their scatter gives
# its error.
# ------------------------------------------------------------------------------

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


class Trials(NamedTuple):
    """Trials of one repetition.

    Parameters
    ----------
    records
        (trials, ...): Gaussian numbers. Those of impacts are (trials, samples, 2 modes):
        displacement and velocity of each mode without stops, in turn, before anything is made a
        crossing.
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


class Kind(ABC):
    """A kind of trials."""

    @property
    @abstractmethod
    def seed(self) -> int:
        """Seed of all its random numbers."""

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of trials in a repetition."""

    @property
    def several(self) -> bool:
        """Whether trials belong to several stops, of which a move may choose another one."""
        return False

    @abstractmethod
    def fresh(self, draw: int) -> Trials:
        """Independent trials, without their scores; each `draw` has random numbers of its own."""

    @abstractmethod
    def scores(self, trials: Trials, *, half: bool = False, coarse: bool = False) -> Vector:
        """The score of every trial; with `half` from the first half of what counts alone, with
        `coarse` at twice the sampling interval."""

    def drawn(self, draw: int) -> Trials:
        """Independent trials with their scores."""
        trials = self.fresh(draw)
        return trials._replace(score=self.scores(trials))

    @abstractmethod
    def risk(self, exceeded: Vector, late: Vector, scored: Vector, mission: float) -> Vector:
        """Probability of an exceedance in a mission, from three probabilities of a trial: of an
        exceedance (`exceeded`), of one in the second half of the count alone (`late`), and of a
        score (`scored`)."""

    @abstractmethod
    def step_bias(self, difference: float) -> float | None:
        """The bias that the sampling leaves in a probability, from its difference to half the
        sampling rate."""

    def bias(self, scored: float, mission: float) -> float:
        """Relative bias of the risk: from overlapping clusters, and from clusters cut by the start
        or the end of a mission."""
        return 0.0

    def unfinished(self, exceeded: float, late: float, scored: float) -> float:
        """Share of the exceedances in the second half of the count, without those of new
        clusters."""
        return 0.0


def risk_of_windows(exceeded: Vector, late: Vector, window: float, mission: float) -> Vector:
    """Probability of an exceedance in a mission, s, from that in a window, s.

    `late` is the part of the latter in which the first exceedance falls into the second half of the
    window.
    """
    before = np.maximum(1.0 - (exceeded - late), 1e-300)
    rate = -np.log1p(-np.minimum(late / before, 1.0 - 1e-15)) / (0.5 * window)
    left = max(mission - window, 0.0)
    return np.asarray(1.0 - (1.0 - np.minimum(exceeded, 1.0)) * np.exp(-rate * left))


@dataclass(frozen=True)
class Levels:
    """The settings that the pilot fixes: the levels, each with the size of the moves there, and
    whether the last level is the limit."""

    levels: tuple[float, ...]
    sizes: tuple[float, ...]
    reached: bool


class Repetition(NamedTuple):
    """Probabilities that one repetition found for a trial.

    They are those of an exceedance at the sampling interval, and at twice that. Then come those of
    one in the second half of the counted time, and of having a score.
    """

    exceeded: float
    coarse: float
    late: float
    scored: float


def pilot(kind: Kind, limit: float, deadline: Deadline, most: int = MOST_LEVELS) -> Levels:
    """At most so many levels, and sizes of moves. About `SHARE` of the trials above one level
    exceed the next; about `ACCEPTED` of the moves stay above their level."""
    random = np.random.default_rng([kind.seed, STREAM, PILOT])
    trials = kind.drawn(draw_of(PILOT, 0, 0))
    levels: list[float] = []
    sizes: list[float] = []
    size = FIRST_SIZE
    while len(levels) < most:
        level = float(np.quantile(trials.score, 1.0 - SHARE, method="lower"))
        if math.isinf(level):
            level = 0.0  # few trials have a score: the first level is to have one
        if level >= limit:
            return Levels((*levels, limit), tuple(sizes), True)
        if (levels and level <= levels[-1]) or not np.any(trials.score > level):
            break
        levels.append(level)
        trials = copies(trials, np.flatnonzero(trials.score > level), random)
        for move in range(MOVES):
            if deadline.passed():
                return Levels(tuple(levels[:-1]), tuple(sizes), False)
            trials, kept = moved(
                kind, trials, level, size, draw_of(PILOT, len(levels), move), random
            )
            size = size * SIZE_STEP if kept > ACCEPTED else size / SIZE_STEP
            size = min(max(size, SMALLEST_SIZE), 1.0)
        sizes.append(size)
    return Levels(tuple(levels), tuple(sizes), False)


def repetition(kind: Kind, levels: Levels, number: int, deadline: Deadline) -> Repetition:
    """One splitting with fixed levels; `GivenUp` if the deadline came before its end."""
    before = [()] * (len(levels.levels) - 1)
    return at_limits(kind, levels, [*before, levels.levels[-1:]], number, deadline)[0]


def at_limits(
    kind: Kind, levels: Levels, limits: Sequence[Sequence[float]], number: int, deadline: Deadline
) -> list[Repetition]:
    """What one splitting found at limits, in order: those of each stage lie above the level before
    its own."""
    random = np.random.default_rng([kind.seed, STREAM, number])
    trials, chance = kind.drawn(draw_of(number, 0, 0)), 1.0
    scored = float(np.mean(trials.score > -math.inf))
    found: list[Repetition] = []
    for stage, level in enumerate(levels.levels):
        found += _seen_at(kind, trials, limits[stage], chance, scored)
        if stage == len(levels.levels) - 1:
            break
        above = np.flatnonzero(trials.score > level)
        if not len(above):
            left = sum(map(len, limits)) - len(found)
            return [*found, *left * [Repetition(0.0, 0.0, 0.0, scored)]]
        chance *= len(above) / len(trials.score)
        trials = copies(trials, above, random)
        for move in range(MOVES):
            if deadline.passed():
                raise GivenUp
            draw = draw_of(number, stage + 1, move)
            trials, _ = moved(kind, trials, level, levels.sizes[stage], draw, random)
    return found


def _seen_at(
    kind: Kind, trials: Trials, limits: Sequence[float], chance: float, scored: float
) -> list[Repetition]:
    """What trials, which come with a probability, tell at limits."""
    if not limits:
        return []
    above = np.flatnonzero(trials.score > limits[0])
    halves, coarse = kind.scores(trials.chosen(above), half=True), kind.scores(trials, coarse=True)
    known = trials.score[above]
    return [
        Repetition(
            exceeded=chance * float(np.mean(trials.score > limit)),
            coarse=chance * float(np.mean(coarse > limit)),
            late=chance * float(np.sum((known > limit) & ~(halves > limit))) / len(trials.score),
            scored=scored,
        )
        for limit in limits
    ]


def draw_of(number: int, stage: int, move: int) -> int:
    """The number of a draw of trials in a stage of a repetition."""
    return (number * (MOST_LEVELS + 1) + stage) * MOVES + move


def copies(trials: Trials, above: NDArray[np.intp], random: np.random.Generator) -> Trials:
    """As many trials as before, copied from those above a level, each about equally often."""
    count = len(trials.score)
    extra = random.permutation(above)[: count % len(above)]
    return trials.chosen(np.concatenate([np.repeat(above, count // len(above)), extra]))


def moved(
    kind: Kind, trials: Trials, level: float, size: float, draw: int, random: np.random.Generator
) -> tuple[Trials, float]:
    """Every trial moved, and taken back if its score is not above the level; the share kept."""
    fresh = kind.fresh(draw)
    rest = math.sqrt((1.0 - size) * (1.0 + size))
    fresh.records[:] *= size
    fresh.records[:] += rest * trials.records
    fresh.pairs[:] = rest * trials.pairs + size * fresh.pairs
    side = trials.side
    if kind.several:
        side = np.where(random.random(len(side)) < CHANGED, fresh.side, side)
    tried = fresh._replace(side=side)
    tried = tried._replace(score=kind.scores(tried))
    kept = tried.score > level
    for own, new in zip(trials, tried, strict=True):
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
class Question:
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
        count, tried = len(done), kind.size * (len(done) + 1)
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


# ------------------------------------------------------------------------------
# Pieces of the motion without stops under noise with fast peaks: whether they reach a stop.
#
# Before its first contact the motion is linear, but not Gaussian: no formula for crossings holds.
# So it is synthesised itself. Records of the noise are a cubic of Gaussian numbers and a filter
# (`mathematics.unsteady_noise`), of which the gaps are a linear function. The stops stand at the
# same place of their rows of distances. The score of a piece is the farthest place at which it
# reaches one; with the distances themselves at place 1, a stop is hit where the score exceeds 1.
# `trial_splitting` moves the Gaussian numbers and finds how probable that is. Two probabilities
# give that of a mission of any length: of pieces in which a stop is reached, and of pieces in whose
# second half it is reached for the first time. Either half is as long as the memory of the gaps.
# ------------------------------------------------------------------------------


TRIALS, FEWEST_TRIALS, MOST_NUMBERS = 512, 64, 2**22
"""Largest and smallest number of trials in one repetition, and the largest number of Gaussian
numbers that they hold together."""

TOGETHER = 2**19
"""Number of samples that are synthesised together."""

OWN = 0xF4EE
"""Number that keeps these records apart from other uses of a seed."""


class WindowSource(NamedTuple):
    """A noise in the records.

    Parameters
    ----------
    gains
        (bins, gaps): transforms of the gaps per unit of that of the noise in the same bin, from the
        second bin on; for Gaussian noise per standard normal number.
    records
        Records of noise with fast peaks; None of Gaussian noise.
    """

    gains: Waves
    records: PeakedRecords | None

    @property
    def drawn_bins(self) -> int:
        """Number of bins that are drawn."""
        return len(self.gains) if self.records is None else self.records.count


@dataclass(frozen=True, eq=False)
class FreeWindows(Kind):
    """Pieces of the motion without stops.

    Parameters
    ----------
    model
        A linear structure with impact pairs under noise with fast peaks, and Gaussian noise beside.
    places
        Places of the stops, increasing: those before the first and after the last one count as
        these.
    rows
        (places, 2, pairs): distances of the lower and upper stops of each pair from its mean gap
        at each place, m, increasing; infinite for none.
    longest
        Longest piece, s.
    own_seed
        Seed of the records.
    """

    model: Model
    places: tuple[float, ...]
    rows: tuple[tuple[tuple[float, ...], ...], ...]
    longest: float
    own_seed: int

    @cached_property
    def response(self) -> GapResponse:
        """Linear response of the gaps. Its records repeat after three memories, of which a piece
        takes two: its ends are independent."""
        found = PairMotion(self.model.with_tables_of_drawn).response
        return found.with_block(3.0 * memory_of(found))

    @cached_property
    def counted(self) -> int:
        """Steps in a piece: a multiple of four, for halves at twice the step."""
        response = self.response
        wanted = min(2.0 * response.block_length / 3.0, self.longest)
        return 4 * max(1, round(wanted / (4.0 * response.step)))

    @property
    def window(self) -> float:
        """Length of a piece, s."""
        return self.counted * self.response.step

    @cached_property
    def moving(self) -> NDArray[np.int64]:
        """Numbers of the pairs whose gaps move."""
        return PairMotion(self.model.with_tables_of_drawn).moving

    @cached_property
    def sources(self) -> list[WindowSource]:
        """All noises, in the order of the tables of the response."""
        response = self.response
        waves = response.amplitudes.transpose(2, 0, 1)
        return self.sources_of(
            [table for table, _ in response.tables], waves, response.samples,
            response.block_length,
        )  # fmt: skip

    def sources_of(
        self, tables: Sequence[Table], waves: Waves, samples: int, length: float
    ) -> list[WindowSource]:
        """Noises from the amplitudes (tables, bins, rows) of what they move, m, in records of so
        many samples and `length` seconds."""
        found = []
        # the tables of a model, in its order, then those of what is drawn, then all other noise
        first = len(self.model.tables)
        drawn: dict[int, FastPeaks] = {
            first + number: each
            for number, (each, _) in enumerate(self.model.drawn)
            if isinstance(each, FastPeaks)
        }
        for number, (table, own) in enumerate(zip(tables, waves, strict=True)):
            if number not in drawn:
                found.append(WindowSource(np.asarray(0.5 * samples * own, complex), None))
                continue
            records = drawn[number].over(length)
            sizes = np.sqrt(bin_variances(table, length, len(own) + 1))
            gains: Waves = np.divide(
                own, sizes[:, None], out=np.zeros_like(own), where=sizes[:, None] > 0.0
            )
            scale = samples / records.samples
            found.append(WindowSource(np.asarray(scale * gains, complex), records))
        return found

    @property
    def seed(self) -> int:
        """Seed of the records."""
        return self.own_seed

    @cached_property
    def size(self) -> int:
        """Number of trials in a repetition."""
        numbers = sum(2 * source.drawn_bins for source in self.sources)
        return int(min(TRIALS, max(FEWEST_TRIALS, MOST_NUMBERS // numbers)))

    def fresh(self, draw: int) -> Trials:
        """Independent trials."""
        numbers = sum(2 * source.drawn_bins for source in self.sources)
        random = np.random.default_rng([self.own_seed, STREAM, OWN, draw])
        return Trials(
            random.standard_normal((self.size, numbers)),
            np.zeros((self.size, 0)),
            np.zeros(self.size, np.intp),
            np.full(self.size, -math.inf),
        )

    def scores(self, trials: Trials, *, half: bool = False, coarse: bool = False) -> Vector:
        """The farthest place in each trial at which a stop is reached."""
        together = max(1, TOGETHER // self.response.samples)
        steps, stride = self.counted // (2 if half else 1), 2 if coarse else 1
        found = [
            self.closeness(
                self.gaps(trials.records[first : first + together])[: steps + 1 : stride]
            )
            for first in range(0, len(trials.records), together)
        ]
        return np.concatenate(found) if found else np.zeros(0)

    def gaps(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Gaps from their means (samples, gaps, records), m, from Gaussian (records, numbers)."""
        samples = self.response.samples
        return np.asarray(scipy.fft.irfft(self.transform(numbers, samples), samples, axis=0))

    def transform(self, numbers: NDArray[np.float64], samples: int) -> Waves:
        """Transform (bins, rows, records) of records of so many samples, from Gaussian (records,
        numbers); bins beyond it are left out."""
        first, rows = 0, self.sources[0].gains.shape[1]
        total = np.zeros((samples // 2 + 1, rows, len(numbers)), complex)
        for gains, records in self.sources:
            count = len(gains) if records is None else records.count
            own = numbers[:, first : first + 2 * count].reshape(len(numbers), 2, count)
            first += 2 * count
            normals = own.transpose(1, 2, 0)
            if records is None:
                drawn = normals[0] - 1j * normals[1]
            else:
                drawn = records.bins_of(normals)[1:]
            kept = min(len(drawn), len(gains), samples // 2)
            total[1 : kept + 1] += gains[:kept, :, None] * drawn[:kept, None, :]
        return total

    def closeness(self, gaps: NDArray[np.float64]) -> Vector:
        """The farthest place at which a stop is reached, with peaks between samples by
        parabolas."""
        distances = np.array(self.rows)[:, :, self.moving]
        found = [
            np.interp(peaks, distances[:, side, pair], self.places)
            for side, sign in enumerate((-1.0, 1.0))
            for pair, peaks in enumerate(_highest(sign * gaps))
            if math.isfinite(distances[0, side, pair])
        ]
        return np.asarray(np.max(found, axis=0))

    def risk(self, exceeded: Vector, late: Vector, scored: Vector, mission: float) -> Vector:
        """Probability of any impact in a mission."""
        return risk_of_windows(exceeded, late, self.window, mission)

    def step_bias(self, difference: float) -> float | None:
        """The bias of the sampling."""
        return bias_of_smooth_motion(difference)


def _highest(records: NDArray[np.float64]) -> NDArray[np.float64]:
    """The highest value of each record (samples, ...), by a parabola through the largest sample and
    its neighbours."""
    place = np.clip(np.argmax(records, axis=0), 1, len(records) - 2)[None]
    before, at, after = (
        np.take_along_axis(records, place + shift, axis=0)[0] for shift in (-1, 0, 1)
    )
    bend = 2.0 * at - before - after
    rise = np.divide((after - before) ** 2, 8.0 * bend, out=np.zeros_like(at), where=bend > 0.0)
    inside = (at >= before) & (at >= after)
    return np.asarray(np.where(inside, at + rise, np.maximum(before, after)))


def has_fast_peaks(model: Model) -> bool:
    """Whether noise with fast peaks shakes a model."""
    return any(isinstance(each, FastPeaks) for each, _ in model.drawn)


def without_peaks(model: Model) -> Model:
    """The model with Gaussian noise of the same density in the place of noise with fast peaks."""
    peaks = tuple(each for each in model.drawn if isinstance(each[0], FastPeaks))
    others = tuple(each for each in model.drawn if not isinstance(each[0], FastPeaks))
    return replace(replace(model, drawn=peaks).with_tables_of_drawn, drawn=others)


# ------------------------------------------------------------------------------
# The hazard of reaching a place in a mission, against the place, from one splitting of trials.
#
# The levels of a splitting are places that trials reach ever more seldom. So it tells the
# probability at all of them on its way to the last one. -ln(1 - P) changes by a factor of some four
# from one level to the next, and its logarithm is interpolated (monotone cubic).
# ------------------------------------------------------------------------------


FREQUENT = (0.95, 0.75, 0.5)
"""Probabilities of a trial at the places before the first level."""

DEPTH = 50.0
"""Factor by which the smallest hazard of a curve lies below the one that is wanted."""

TINY = 1e-300
"""Smallest probability of which a logarithm is taken."""


@dataclass(frozen=True, eq=False)
class CurveSampler(TrialSampler):
    """Repetitions of a splitting with fixed levels, which tell its probabilities at limits."""

    kind: FreeWindows
    levels: Levels
    limits: tuple[tuple[float, ...], ...]

    @property
    def block(self) -> int:
        """One repetition is a block."""
        return 1

    def trial(self, first_path: int, paths: int, deadline: Deadline) -> list[Repetition]:
        """One repetition."""
        return at_limits(self.kind, self.levels, self.limits, first_path, deadline)


def hazard_curve(
    kind: FreeWindows, wanted: float, mission: float, run: Run, depth: float = DEPTH
) -> HazardCurve:
    """The hazard of a mission, s, against the place that pieces of the motion reach, around a
    hazard that is wanted.

    Raises
    ------
    NotConverged
        If the budget ended before the pilot, or before two repetitions of the splitting.
    """
    windows = max(mission / kind.window, 1.0)
    least = -math.expm1(-wanted / (depth * windows))
    count = min(max(math.ceil(math.log(least) / math.log(SHARE)) + 1, 2), MOST_LEVELS)
    levels = pilot(kind, math.inf, run.deadline.sooner(FOR_ANSWER), count)
    if len(levels.levels) < count:
        raise run.deadline.fell_short("before pieces reached the stops", "raise budget")
    first = kind.drawn(draw_of(PILOT, 0, 0)).score
    frequent = np.quantile(first, 1.0 - np.array(FREQUENT), method="lower")
    limits = [(*map(float, frequent), levels.levels[0]), *((each,) for each in levels.levels[1:])]
    places = np.concatenate(limits)

    def found(done: Sequence[Sequence[Repetition]]) -> HazardCurve:
        return _curve_of(kind, places, np.array(done), wanted, mission)

    def error(done: Sequence[Sequence[Repetition]]) -> float:
        return 0.0 if len(done) >= MOST_REPETITIONS else found(done).reached

    taken = run.to_accuracy(
        CurveSampler(kind, levels, tuple(limits)), FEWEST_REPETITIONS, error, run.accuracy, needed=2
    )
    return found(taken.sample)


def _curve_of(
    kind: FreeWindows, places: Vector, done: Matrix, wanted: float, mission: float
) -> HazardCurve:
    """The curve from repetitions (repetitions, places, 4)."""
    count = len(done)
    parts = done.transpose(2, 1, 0)

    def risk(exceeded: Vector, late: Vector, scored: Vector) -> Vector:
        return kind.risk(exceeded, late, scored, mission)

    exceeded, coarse, late, scored = parts.mean(axis=2)
    value, at_twice = risk(exceeded, late, scored), risk(coarse, late, scored)
    left_out = (parts.sum(axis=2, keepdims=True) - parts) / (count - 1)
    errors = student_factor(count) * jackknife_error(risk(left_out[0], left_out[2], left_out[3]))
    chances = [
        Estimate(value=each, standard_error=error, bias=kind.step_bias(abs(change)) or 0.0)
        for each, error, change in zip(value, errors, at_twice - value, strict=True)
    ]
    hazard = -np.log1p(-np.clip(value, TINY, KNOWN))
    nearest = int(np.argmin(np.abs(np.log(hazard / wanted))))
    left = (1.0 - value[nearest]) * hazard[nearest]
    return HazardCurve.of(places, chances, mission, float(errors[nearest] / left))
