"""Pieces of the motion without stops under noise with fast peaks: whether they reach a stop.

Before its first contact the motion is linear, but not Gaussian: no formula for crossings holds. So
it is synthesised itself. Records of the noise are a cubic of Gaussian numbers and a filter
(`mathematics.fast_peaks`), of which the gaps are a linear function. The stops stand at the same
place of their rows of distances. The score of a piece is the farthest place at which it reaches
one; with the distances themselves at place 1, a stop is hit where the score exceeds 1.
`trial_splitting` moves the Gaussian numbers and finds how probable that is. Two probabilities give
that of a mission of any length: of pieces in which a stop is reached, and of pieces in whose second
half it is reached for the first time. Either half is as long as the memory of the gaps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft

from stochvi.mathematics.arrays import Vector, Waves
from stochvi.mathematics.fast_peaks import FastPeaks, PeakedRecords, UnreachableKurtosis
from stochvi.mathematics.frequency_response import bin_variances
from stochvi.methods.monte_carlo.gap_response import GapResponse
from stochvi.methods.monte_carlo.step_bias import bias_of_smooth_motion
from stochvi.model.coverage import not_gaussian
from stochvi.model.model import Model
from stochvi.results.errors import NotApplicable
from stochvi.statistics.pair_crossings import PairMotion, memory_of, pressed_pairs
from stochvi.statistics.trial_splitting import STREAM, Kind, Trials, risk_of_windows

TRIALS, FEWEST_TRIALS, MOST_NUMBERS = 512, 64, 2**22
"""Largest and smallest number of trials in one repetition, and the largest number of Gaussian
numbers that they hold together."""

TOGETHER = 2**19
"""Number of samples that are synthesised together."""

FARTHEST = 2.0
"""Share of the way to a stop up to which scores are told apart."""

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
        response, found = self.response, []
        # the tables of a model, in its order, then those of what is drawn, then all other noise
        first = len(self.model.tables)
        drawn: dict[int, FastPeaks] = {
            first + number: each
            for number, (each, _) in enumerate(self.model.drawn)
            if isinstance(each, FastPeaks)
        }
        for number, (table, _) in enumerate(response.tables):
            waves = response.amplitudes[:, :, number]
            if number not in drawn:
                found.append(
                    WindowSource(np.asarray(0.5 * response.samples * waves, complex), None)
                )
                continue
            records = drawn[number].over(response.block_length)
            sizes = np.sqrt(bin_variances(table, response.block_length, len(waves) + 1))
            gains: Waves = np.divide(
                waves, sizes[:, None], out=np.zeros_like(waves), where=sizes[:, None] > 0.0
            )
            scale = response.samples / records.samples
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
            self._closeness(
                self.gaps(trials.records[first : first + together])[: steps + 1 : stride]
            )
            for first in range(0, len(trials.records), together)
        ]
        return np.concatenate(found) if found else np.zeros(0)

    def gaps(self, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
        """Gaps from their means (samples, gaps, records), m, from Gaussian (records, numbers)."""
        response, first = self.response, 0
        bins = response.samples // 2 + 1
        total = np.zeros((bins, response.gaps, len(numbers)), complex)
        for gains, records in self.sources:
            count = len(gains) if records is None else records.count
            own = numbers[:, first : first + 2 * count].reshape(len(numbers), 2, count)
            first += 2 * count
            normals = own.transpose(1, 2, 0)
            if records is None:
                drawn = normals[0] - 1j * normals[1]
            else:
                drawn = records.bins_of(normals)[1:]
            kept = min(len(drawn), len(gains))
            total[1 : kept + 1] += gains[:kept, :, None] * drawn[:kept, None, :]
        return np.asarray(irfft(total, response.samples, axis=0))

    def _closeness(self, gaps: NDArray[np.float64]) -> Vector:
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


def windows_of(
    model: Model, lower: Sequence[float], upper: Sequence[float], longest: float, seed: int
) -> FreeWindows:
    """Pieces of the motion of a model without stops, of at most so many seconds; their score is the
    largest share of the way to a stop. Raises `NotApplicable` as `windows_over` does."""
    stops = np.array([lower, upper])
    near = np.where(np.isfinite(stops), 0.0, math.inf)
    rows = np.stack([near, FARTHEST * stops])
    return windows_over(model, np.array([0.0, FARTHEST]), rows, longest, seed)


def windows_over(
    model: Model, places: Vector, rows: NDArray[np.float64], longest: float, seed: int
) -> FreeWindows:
    """Pieces of at most so many seconds, whose score is the place of the stops that they reach:
    distances (places, 2, pairs), m.

    Raises
    ------
    NotApplicable
        If the noise beside that with fast peaks is not Gaussian, if the motion without stops is not
        stationary, or if a stop presses.
    """
    others = tuple(each for each in model.drawn if not isinstance(each[0], FastPeaks))
    unmet = [
        *not_gaussian(replace(model, drawn=())),
        *(["pulses must be left out beside noise with fast peaks"] if others else []),
        *(["sines must be left out beside noise with fast peaks"] if model.sines else []),
    ]
    unmet = unmet or pressed_pairs(model, *rows[-1])
    if unmet:
        raise NotApplicable("first_crossings", unmet)
    for each, _ in model.drawn:
        try:
            assert isinstance(each, FastPeaks)
            each.cubic  # noqa: B018
        except UnreachableKurtosis as reason:
            raise NotApplicable("first_crossings", [str(reason)]) from reason
    own = int(np.random.SeedSequence([seed, OWN]).generate_state(1, np.uint64)[0] >> 1)
    table = tuple(tuple(tuple(map(float, side)) for side in row) for row in rows)
    return FreeWindows(model, tuple(map(float, places)), table, longest, own)


def has_fast_peaks(model: Model) -> bool:
    """Whether noise with fast peaks shakes a model."""
    return any(isinstance(each, FastPeaks) for each, _ in model.drawn)


def without_peaks(model: Model) -> Model:
    """The model with Gaussian noise of the same density in the place of noise with fast peaks."""
    peaks = tuple(each for each in model.drawn if isinstance(each[0], FastPeaks))
    others = tuple(each for each in model.drawn if not isinstance(each[0], FastPeaks))
    return replace(replace(model, drawn=peaks).with_tables_of_drawn, drawn=others)
