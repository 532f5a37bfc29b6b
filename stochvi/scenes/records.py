"""A measured record of acceleration (or force), and the one-sided density estimated from it."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics import numerics
from stochvi.mathematics.numerics import Vector
from stochvi.mathematics.spectra import (
    MOST_BREAKPOINTS,
    Table,
    response_moments,
    squared_gain,
    welch,
)
from stochvi.mathematics.units import checked, explain_methods
from stochvi.results.deadline import in_command
from stochvi.results.errors import SceneError
from stochvi.results.estimates import jackknife_error
from stochvi.scenes.frames import Frame
from stochvi.scenes.readers import TIME_RESPONSE, Columns, read_columns
from stochvi.scenes.text_tables import out_of_order

FEWEST_SAMPLES = 256
"""Smallest number of samples of a record: the segments of a shorter one would resolve nothing."""

LOWEST_RATE, HIGHEST_RATE = 1e-6, 1e12
"""The sampling rates that may be given, Hz: beyond any sensor."""

FEWEST_BINS = 16
"""Smallest number of samples in a window."""

FEWEST_SEGMENT_LENGTHS = 8
"""Smallest length of a record, in windows: the standard error of a bin is then 37 %."""

LONGEST_WINDOW = 1.9 * MOST_BREAKPOINTS
"""Largest number of samples that is asked for in a window: half as many lines, and a few more for a
length that a fast Fourier transform likes, are no more than a table may have."""

BINS_IN_BANDWIDTH = 6.0
"""Number of bins in a half-power bandwidth: a Hann window (1.5 bins) covers a quarter of it."""

BINS_BELOW_RESONANCE = 10.0
"""Smallest number of bins up to the natural frequency, because the energy below the first bin is
lost."""

HANN_OVERLAP_VARIANCE = 19.0 / 18.0
"""K times the variance of a mean over K half-overlapping Hann segments: 1 + 2 / 6^2."""

SMALLEST_DENSITY = 1e-16
"""Density that is given to a bin without energy, relative to the largest one: a table is
interpolated in logarithms and cannot hold 0."""

UNEVEN = 0.1
"""Largest distance of a time from the even grid, in sampling intervals, at which the values are
taken for those on the grid; beyond it they are interpolated."""

ROUNDED = 0.6
"""Largest distance of a time from the even grid, in units of its last digit: rounding moves it by
0.5 at most, and the grid that is fitted to rounded times is a little off."""

MOST_DIGITS = 9
"""Largest number of decimals, of times in seconds, that counts as rounding."""

SOME = 1000
"""Number of times that are compared with how those in single precision are written."""

LAG = 64
"""Number of sampling intervals over which the first estimate of their length is averaged."""

RATES_AGREE = 1e-3
"""Largest relative difference of two sampling rates that count as equal: it shifts the spectrum by
a hundredth of the bandwidth of a mount with a damping ratio of 0.05."""

RATES_EQUAL = 1e-6
"""Relative difference of a fitted sampling rate from the true one that counts as a rounding error:
it must not lengthen a segment by a sample."""

ROUNDING_ERRORS = 3.0
"""The times support a sampling rate up to this distance from the fitted one, in the standard errors
that rounded times leave."""

STRETCH, OTHER_RATE = 16, 1.25
"""Number of sampling intervals that a local rate is the mean of, and the ratio of two such rates
from which the sampling rate changes; a clock that drifts or jitters stays far below it."""

GAPS_LISTED = 3
"""Largest number of gaps that a sentence lists."""

CLIPPED_SAMPLES, CLIPPED_BAND, CLIPPED_RATIO = 8, 0.02, 2.0
"""A record counts as cut off where at least `CLIPPED_SAMPLES` of its samples lie at its largest (or
smallest) value. They must also be `CLIPPED_RATIO` times as many as in the band before it, whose
width is `CLIPPED_BAND` times that value."""

CUT_OFF = (
    "it is cut off at its largest or smallest value, as by a logger at the end of its range: the "
    "motion under it is too small; measure again with a larger range"
)
"""The words for such a record."""

BLOCKS = 16
"""Number of blocks of a record for the jackknife error of its kurtosis."""


@explain_methods
@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """Evenly sampled values in SI units, without their mean.

    Parameters
    ----------
    values
        Values of the record, m/s^2 (or N), of all segments one after the other.
    fs
        Sampling rate, 1/s.
    lengths
        Number of samples of each segment, between which there are gaps; empty for a record in one
        piece.
    gaps
        Start of each gap, s after the first sample, and its length, s.
    notes
        Sentences on what was taken from the file besides the numbers.
    interpolated
        A sentence on an uneven clock, from whose times the values were interpolated; else empty.
    mean
        The mean that reading took off, m/s^2 (or N); 0 for a record that was filtered, whose mean
        is none of the motion that was asked for.

    See Also
    --------
    stochvi.scenes.read_record : A record from its file.
    """

    values: Vector
    fs: float
    lengths: tuple[int, ...] = ()
    gaps: tuple[tuple[float, float], ...] = ()
    notes: tuple[str, ...] = ()
    interpolated: str = ""
    mean: float = 0.0

    @property
    def sampling(self) -> tuple[float, tuple[int, ...], int]:
        """Rate, lengths of the segments and number of values: records that are alike in them are
        read together."""
        return self.fs, self.lengths, len(self.values)

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Record)
            and (self.fs, self.lengths) == (other.fs, other.lengths)
            and np.array_equal(self.values, other.values)
        )

    def __hash__(self) -> int:
        return hash((self.fs, self.lengths, len(self.values), self.values[:BLOCKS].tobytes()))

    @property
    def segments(self) -> tuple[Vector, ...]:
        """The values of each segment without gaps."""
        return tuple(np.split(self.values, np.cumsum(self.lengths)[:-1]))

    @property
    def duration(self) -> float:
        """Length of the record without gaps, s."""
        return len(self.values) / self.fs

    @property
    def times(self) -> Vector:
        """Seconds of each value after the first line of the file."""
        found = np.arange(len(self.values)) / self.fs
        for start, length in self.gaps:
            found[found > start - 0.5 / self.fs] += length
        return found

    def scaled(self, factor: float) -> Record:
        """The record at `factor` times its values."""
        return replace(self, values=self.values * factor, mean=self.mean * factor)

    def filtered(self, low_hz: float, high_hz: float) -> Record:
        """The record without a straight line through each segment, and without frequencies outside
        a band, Hz, whose ends count as inside.

        >>> time = np.arange(2000) / 100.0
        >>> fast = np.sin(2.0 * np.pi * 5.0 * time)
        >>> both = np.cos(2.0 * np.pi * 0.1 * time) + fast
        >>> record = Record(values=both + time, fs=100.0).filtered(1.0, 20.0)
        >>> bool(np.abs(record.values - fast)[100:-100].max() < 0.01)  # away from the ends
        True
        """
        parts = []
        for part in self.segments:
            middle = np.arange(len(part)) - 0.5 * (len(part) - 1)
            trend = middle * (middle * part).sum() / max((middle**2).sum(), 1.0) + part.mean()
            lines = np.fft.rfft(part - trend)
            f = np.arange(len(lines)) * self.fs / len(part)
            parts.append(np.fft.irfft(lines * numerics.within(f, low_hz, high_hz), len(part)))
        return replace(self, values=np.concatenate(parts), mean=0.0)

    def slow_displacement(self, below_hz: float, omega: float, damping_rate: float) -> float:
        """Mean square displacement of an oscillator, m^2, that is due to frequencies below one,
        summed over the lines of whole segments.

        >>> slow = Record(values=np.sin(0.2 * np.pi * np.arange(1000) / 10.0), fs=10.0)
        >>> [round(slow.slow_displacement(f, 10.0, 0.1), 9) for f in (0.05, 0.5)]
        [0.0, 5.0397e-05]
        """
        total = 0.0
        for part in self.segments:
            count = min(numerics.ceil(below_hz * len(part) / self.fs), len(part) // 2)
            lines = np.abs(np.fft.rfft(part)[:count] / len(part)) ** 2
            lines[1:] *= 2.0
            f = np.arange(count) * self.fs / len(part)
            total += len(part) * float(np.sum(lines * squared_gain(f, omega, damping_rate)))
        return total / len(self.values)

    @property
    def rms(self) -> float:
        """Root mean square about the mean."""
        return float(np.sqrt(np.mean(self.values**2)))

    @property
    def peak(self) -> float:
        """Largest distance from the mean."""
        return float(np.max(np.abs(self.values)))

    def kurtosis(self) -> tuple[float, float]:
        """E a^4 / (E a^2)^2, 3 for a Gaussian record, and its standard error.

        The error comes from leaving out one of `BLOCKS` blocks after the other (jackknife), so
        that samples need not be independent.
        """
        blocks = self.values[: len(self.values) // BLOCKS * BLOCKS].reshape(BLOCKS, -1)
        second, fourth = np.mean(blocks**2, axis=1), np.mean(blocks**4, axis=1)
        value = fourth.mean() / second.mean() ** 2
        left_out = (fourth.sum() - fourth) / (second.sum() - second) ** 2 * (BLOCKS - 1)
        return float(value), jackknife_error(left_out)

    def resolution(self, omega: float | None = None, damping_rate: float | None = None) -> float:
        """Spacing of the bins, Hz, for an oscillator, or the finest one if none is given.

        For an oscillator it is the coarsest that resolves its resonance, but no finer than the
        record allows. The coarsest is the smallest of b / (2 pi) / 6 (b / (2 pi) = 2 zeta f_n is
        the half-power bandwidth), f_n / 10 and a sixteenth of the sampling rate. The finest is the
        largest of 8 / duration, one over the length of the longest segment, and the sampling rate
        over `LONGEST_WINDOW`.
        """
        longest = max(map(len, self.segments)) / self.fs
        finest = max(
            FEWEST_SEGMENT_LENGTHS / self.duration, 1.0 / longest, self.fs / LONGEST_WINDOW
        )
        if not omega or not damping_rate:
            return finest
        return max(finest, min(wanted_resolution(omega, damping_rate), self.fs / FEWEST_BINS))

    def density(self, resolution_hz: float) -> DensityEstimate:
        """One-sided density by Welch's method: Hann windows, half overlap, means subtracted.

        No window extends over a gap; a segment that is shorter than a window is left out.

        Parameters
        ----------
        resolution_hz
            Spacing of the bins, Hz; windows are 1 / `resolution_hz` long, s.

        Examples
        --------
        >>> noise = np.random.default_rng(1).normal(size=2**14)
        >>> found = Record(values=noise, fs=100.0).density(0.5)
        >>> found.segments, round(found.relative_error, 3)
        (162, 0.081)
        >>> round(float(found.table.density.mean()), 3)  # 2 / fs
        0.02
        """
        longest = max(map(len, self.segments))
        wanted = math.ceil((1.0 - RATES_EQUAL) * self.fs / resolution_hz)
        length = scipy.fft.next_fast_len(min(wanted, longest), True)
        return _welch(self, min(length, longest))


def cut_off(values: Vector) -> bool:
    """Whether samples pile up at the largest or the smallest value, as a logger leaves them."""
    for side in (values, -values):
        top = float(side.max())
        if top == float(np.median(side)):
            continue  # at rest for half of the time, as between shocks
        # neighbouring values of a logger with few digits count as one band
        following = float(np.max(side[side < top], initial=-math.inf))
        width = max(CLIPPED_BAND * abs(top), 1.5 * (top - following))
        at_top = int(np.sum(side == top))
        before = int(np.sum(side >= top - width)) - at_top
        if at_top >= CLIPPED_SAMPLES and at_top > CLIPPED_RATIO * before:
            return True
    return False


@dataclass(frozen=True, kw_only=True)
class DensityEstimate:
    """A density estimated from `segments` segments; one bin has the relative standard error
    `relative_error`, if the record is Gaussian and stationary."""

    table: Table
    resolution_hz: float
    segments: int
    relative_error: float


@lru_cache(maxsize=16)
def _welch(record: Record, length: int) -> DensityEstimate:
    """The density for a window of `length` samples, cached because a scene asks for it often."""
    overlap = length // 2
    parts = [part for part in record.segments if len(part) >= length]
    windows = [(len(part) - overlap) // (length - overlap) for part in parts]
    spectra = [welch(part, record.fs, length) for part in parts]
    frequency, segments = spectra[0][0], sum(windows)
    density = np.average([found for _, found in spectra], axis=0, weights=windows)
    floor = SMALLEST_DENSITY * float(density[1:].max())
    return DensityEstimate(
        table=Table(frequency_hz=frequency[1:], density=np.maximum(density[1:], floor)),
        resolution_hz=record.fs / length,
        segments=segments,
        relative_error=math.sqrt(HANN_OVERLAP_VARIANCE / segments),
    )


def wanted_resolution(omega: float, damping_rate: float) -> float:
    """Coarsest spacing of bins that resolves an oscillator, Hz (see `Record.resolution`)."""
    turn = 2.0 * math.pi
    return min(damping_rate / turn / BINS_IN_BANDWIDTH, omega / turn / BINS_BELOW_RESONANCE)


def response_error(
    record: Record, resolution_hz: float, omega: float, damping_rate: float
) -> tuple[float, float]:
    """Relative standard error and relative bias of the mean square response to a record's density.

    G is the density of the response. For any segments, an estimate of its area from T seconds has
    the relative variance int G^2 df / (T (int G df)^2). For a flat input this is 1 / (pi B T), B
    the half-power bandwidth. The window smears the input over 1.5 bins. Its bias is found by
    smearing the estimate once more. The weights 1/6, 2/3, 1/6 on three bins have the second moment
    of the kernel of a Hann window.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=2**15)
    >>> record = Record(values=noise, fs=200.0)
    >>> omega = 2.0 * np.pi * 12.0
    >>> bins = record.resolution(omega, 0.2 * omega)
    >>> error, bias = response_error(record, bins, omega, 0.2 * omega)
    >>> round(error, 2), round((np.pi * 2.4 * record.duration) ** -0.5, 2), abs(bias) < error
    (0.03, 0.03, True)
    """
    estimate = record.density(resolution_hz)
    table = estimate.table
    padded = np.pad(table.density, 1, mode="edge")
    smeared = Table(
        frequency_hz=table.frequency_hz,
        density=(padded[:-2] + 4.0 * padded[1:-1] + padded[2:]) / 6.0,
    )
    once, twice = (
        response_moments([density], omega, damping_rate).displacement
        for density in (table, smeared)
    )
    f = _grid(table, omega, damping_rate)
    response = squared_gain(f, omega, damping_rate) * table(f)
    # the scatter of the bins increases the mean of their squares
    squares = float(np.trapezoid(response**2, f)) / (1.0 + estimate.relative_error**2)
    return math.sqrt(squares / record.duration) / once, twice / once - 1.0


def _grid(table: Table, omega: float, damping_rate: float) -> Vector:
    """Frequencies of a table, and close ones about a resonance that may be narrower than bins."""
    natural, width = omega / (2.0 * math.pi), damping_rate / (2.0 * math.pi)
    near = natural + width * np.linspace(-20.0, 20.0, 801)
    low, high = table.frequency_hz[0], table.frequency_hz[-1]
    return np.union1d(table.frequency_hz, near[(near > low) & (near < high)])


@checked
def read_record(
    path: str | Path | Frame,
    *,
    fs: float | None = None,
    column: int | str | None = None,
    variables: Sequence[str] | None = None,
    dataset: int | None = None,
    full_scale: float | None = None,
    gaps: Literal["refuse", "split"] = "refuse",
    fewest: int = FEWEST_SAMPLES,
) -> tuple[Record, Columns]:
    """A record from a column of times and one of values, or from values only if `fs` is given.

    Times may be in seconds, in another unit that the heading states, or ISO 8601 stamps. They may
    be rounded, because the sampling rate is fitted to all of them. Where a clock drifts or is
    uneven, the values are interpolated to an even grid by cubic splines, and a note says so. A rate
    that changes is refused.
    Missing values and missing samples are gaps.

    Parameters
    ----------
    path
        File of the record, or the frame of its values (`stochvi.scenes.frames`).
    fs
        Sampling rate, 1/s; if the file has times, it must agree with them.
    column
        For a file with several columns or channels: name or number of the one that is read.
    variables
        Names of the vectors of a MATLAB file.
    dataset
        Number of the dataset of a UFF file, from 1.
    full_scale
        Largest value that a sound file (.wav) can hold.
    gaps
        "refuse" them, or "split" the record there into segments.
    fewest
        Smallest number of samples.

    Returns
    -------
    record, columns
        The record in the unit of the file, and the columns that were read, which state the unit.

    Raises
    ------
    SceneError
        If the file does not hold such a record. The message names the file, the line and a remedy.

    See Also
    --------
    stochvi.RecordedNoise : Noise of a record.
    stochvi.replay : What the record itself does.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "run.csv"
    >>> lines = ["time (s),a (g)", *(f"{0.01 * n:.2f},{n % 2}" for n in range(300))]
    >>> _ = file.write_text("\\n".join(lines))
    >>> record, columns = read_record(file)
    >>> round(record.fs), columns.unit.name
    (100, 'g')
    """
    if fs is not None and not LOWEST_RATE <= fs <= HIGHEST_RATE:
        raise SceneError("fs", f"must be from {LOWEST_RATE:g} to {HIGHEST_RATE:g} Hz, got {fs:g}")
    path = Path(path) if isinstance(path, str) else path
    if not isinstance(path, Path | Frame):
        raise ValueError(f"path must be a file or a Frame, got {path!r:.60}")
    identity = 0, 0, 0
    with contextlib.suppress(OSError, ValueError):  # what reads it says why
        if isinstance(path, Path):
            found = path.stat()
            identity = found.st_ino, found.st_size, found.st_mtime_ns
    names = None if variables is None else tuple(variables)
    with in_command():
        place = _Place(column, names, dataset, full_scale)
        return _read_once(path, identity, fs, place, gaps, fewest)


class _Place(NamedTuple):
    """Where in a file a record stands, see `read_columns`."""

    column: int | str | None
    variables: tuple[str, ...] | None
    dataset: int | None
    full_scale: float | None


@lru_cache(maxsize=2, typed=True)
def _read_once(
    path: Path | Frame, _: tuple[int, ...], fs: float | None, place: _Place,
    gaps: Literal["refuse", "split"], fewest: int,
) -> tuple[Record, Columns]:  # fmt: skip
    """The record of a file. The same file again, as a scene asks for it, costs nothing."""
    names = ("acceleration",) if fs is not None else ("time", "acceleration")
    columns = read_columns(path, names, function_type=TIME_RESPONSE, **place._asdict())
    times, values = columns.x, columns.y
    notes: tuple[str, ...] = ()
    missing = ~np.isfinite(values)
    if len(values) - missing.sum() < fewest:
        raise SceneError(
            f"{path} holds {len(values) - missing.sum()} samples, expected at least "
            f"{fewest}; take a longer record"
        )
    if times is None:
        assert fs is not None
        rate, breaks, interpolated = fs, np.zeros(len(values) - 1), ""
    else:
        rate, breaks, notes, interpolated = _sampling(times, path, columns)
        if fs is not None and abs(fs / rate - 1.0) > RATES_AGREE:
            raise SceneError(
                "fs",
                f"is {fs:g} Hz, but the times of {path} give {rate:.6g} Hz; take fs out or "
                "correct the one that is wrong",
            )
    lengths, found = _segments(missing, breaks, rate, times if interpolated else None)
    if found and gaps == "refuse":
        raise SceneError(
            f'{path} has {listed_gaps(found)}; say gaps = "split" to take what lies between as '
            "segments, or fill them in"
        )
    values = values[~missing]
    if interpolated:
        assert times is not None
        values, lengths = _on_even_grid(times[~missing], values, lengths, rate)
    mean = float(values.mean())
    values = values - mean
    if not np.any(values):
        raise SceneError(f"{path} holds a record whose values are all equal; choose another column")
    record = Record(
        values=values, fs=rate, lengths=lengths if len(lengths) > 1 else (), gaps=found,
        notes=notes, interpolated=interpolated, mean=mean,
    )  # fmt: skip
    return record, columns


def _segments(
    missing: NDArray[np.bool_], breaks: Vector, rate: float, times: Vector | None
) -> tuple[tuple[int, ...], tuple[tuple[float, float], ...]]:
    """Number of samples of each segment, and start and length (s) of the gaps between them.

    `breaks` are the seconds by which each interval between two samples is too long, and `times`
    those of a clock that is not even.
    """
    clock = np.concatenate([[0.0], np.cumsum(breaks)]) + np.arange(len(missing)) / rate
    if times is not None:
        clock = times - times[0]
    held = np.flatnonzero(~missing)
    step = np.diff(held) > 1
    step |= np.add.reduceat(breaks, held[:-1]) > 0.0 if len(held) > 1 else False
    ends = np.flatnonzero(step)
    found = [
        (
            float(clock[held[end]] + 1.0 / rate),
            float(clock[held[end + 1]] - clock[held[end]] - 1.0 / rate),
        )
        for end in ends
    ]
    if held[0] > 0:
        found.insert(0, (0.0, float(clock[held[0]])))
    if held[-1] < len(missing) - 1:
        found.append((float(clock[held[-1]] + 1.0 / rate), float(clock[-1] - clock[held[-1]])))
    cuts = np.concatenate([[0], ends + 1, [len(held)]])
    return tuple(int(size) for size in np.diff(cuts)), tuple(found)


def _on_even_grid(
    times: Vector, values: Vector, lengths: tuple[int, ...], rate: float
) -> tuple[Vector, tuple[int, ...]]:
    """Values of an uneven clock at even times, segment by segment, and the new lengths."""
    parts = []
    cuts = np.cumsum(lengths)[:-1]
    for when, held in zip(np.split(times, cuts), np.split(values, cuts), strict=True):
        if len(when) == 1:
            parts.append(held)
            continue
        since = when - when[0]
        grid = np.arange(numerics.floor(since[-1] * rate) + 1) / rate
        parts.append(scipy.interpolate.CubicSpline(since, held)(np.minimum(grid, since[-1])))
    return np.concatenate(parts), tuple(map(len, parts))


def listed_gaps(gaps: Sequence[tuple[float, float]]) -> str:
    """The number of gaps, and length and start of the first of them, in words."""
    count = "a gap" if len(gaps) == 1 else f"{len(gaps)} gaps"
    listed = ", ".join(f"{length:.4g} s at {start:.6g} s" for start, length in gaps[:GAPS_LISTED])
    more = f" and {len(gaps) - GAPS_LISTED} more" if len(gaps) > GAPS_LISTED else ""
    return f"{count} ({listed}{more})"


def _sampling(
    times: Vector, path: Path | Frame, columns: Columns
) -> tuple[float, Vector, tuple[str, ...], str]:
    """Sampling rate, 1/s; the seconds by which each interval is too long; notes; and a sentence
    where the times are off the even grid by more than their rounding.

    The rate comes from a least-squares fit to the times, with one slope for all segments.
    """
    if not np.all(np.isfinite(times)):
        place = columns.place(int(np.argmin(np.isfinite(times))))
        raise SceneError(f"{path}, {place}: the time is missing; take out the line, or fill it in")
    lag = min(LAG, len(times) - 1)
    interval = float(np.median(times[lag:] - times[:-lag])) / lag
    if np.all(np.diff(times) < 0.0):
        raise SceneError(
            f"{path} must have rising times in its first column, got falling ones; sort the rows "
            "by time"
        )
    if not interval > 0.0:
        raise SceneError(
            f"{path} must have rising times in its first column; give fs = .. for a file without "
            "times, or column = .. where the values are in another one"
        )
    single = _in_single_precision(times)
    if single is None:
        digits = _last_digits(times, interval)
    else:
        times, digits = single, np.spacing(single.astype(np.float32)).astype(float)
    digit = float(digits.max())
    steps = np.diff(times)
    if np.any(steps < -UNEVEN * interval):
        row = int(np.argmax(steps < -UNEVEN * interval)) + 1
        raise SceneError(
            f"{path}, {columns.place(row)}: times must rise, got {times[row]:.9g} s after "
            f"{times[row - 1]:.9g} s; {out_of_order(times, 'cut the record there')[1]}"
        )
    apart = steps > 1.5 * interval + np.maximum(digits[1:], digits[:-1])
    if apart.any():
        _check_one_rate(path, times, digit)
    segment = np.concatenate([[0], np.cumsum(apart)])
    count = np.bincount(segment)
    index = np.arange(len(times), dtype=float)
    centred = index - (np.bincount(segment, index) / count)[segment]
    offset = times - (np.bincount(segment, times) / count)[segment]
    if not np.any(centred):
        raise SceneError(
            f"{path} must be sampled evenly, but it has no two samples without a gap; give fs"
        )
    # sums with one rounding: those of a dot product depend on the processor
    squares = math.fsum(centred**2)
    slope = math.fsum(centred * offset) / squares
    coarse = digit**2 * squares
    if np.any(digits != digit):
        coarse = math.fsum((centred * digits) ** 2)
    doubt = ROUNDING_ERRORS * math.sqrt(coarse / 12.0) / squares
    doubt += 4.0 * float(np.spacing(np.abs(times).max())) / float(np.ptp(centred))
    slope = _shortest(slope, doubt / slope)
    off = offset - slope * centred
    starts = np.flatnonzero(np.diff(segment, prepend=-1))
    bound = np.maximum(UNEVEN * slope, ROUNDED * digits)
    # whether no even grid is near enough to all times of a segment
    least, most = np.maximum.reduceat(off - bound, starts), np.minimum.reduceat(off + bound, starts)
    breaks = np.where(apart, steps - slope, 0.0)
    uneven = bool(np.any(least > most))
    notes, interpolated = [], ""
    if digit > UNEVEN * slope:
        notes.append(f"its times have a last digit of {digit:g} s; the rate is fitted to all")
    if uneven:
        _check_one_rate(path, times, digit)
        if np.any(steps <= 0.0):
            row = int(np.argmax(steps <= 0.0)) + 1
            raise SceneError(
                f"{path}, {columns.place(row)}: times of an uneven clock must rise, got "
                f"{times[row]:.9g} s twice; write them with more digits, or take them out and give "
                "fs"
            )
        worst = float(np.abs(off).max())
        interpolated = (
            f"its times lie up to {worst:.2g} s ({worst / slope:.2g} samples) off an even grid; "
            f"the values were interpolated to {1.0 / slope:.6g} Hz"
        )
    return 1.0 / slope, breaks, tuple(notes), interpolated


def _check_one_rate(path: Path | Frame, times: Vector, digit: float) -> None:
    """Refuse times whose sampling rate changes: neither a spline nor gaps are right for them.

    Local rates are medians over parts of the record, which single gaps and jitter do not move.
    """
    local = (times[STRETCH:] - times[:-STRETCH]) / STRETCH
    places = np.array_split(np.arange(len(local)), min(max(len(local) // (4 * STRETCH), 1), 64))
    intervals = np.array([np.median(local[each]) for each in places])
    single = np.array([np.median(np.diff(times)[each]) for each in places])
    short, long = int(np.argmin(intervals)), int(np.argmax(intervals))
    # where many samples are missing, neighbours are still as near as elsewhere
    if (
        min(intervals[long] / intervals[short], (single[long] + digit) / max(single[short], digit))
        < OTHER_RATE
    ):
        return
    first, last = sorted((short, long))
    between = math.sqrt(intervals[first] * intervals[last])
    changed = (local > between) == (intervals[last] > between)
    row = int(np.argmax(changed & (np.arange(len(local)) >= places[first][0]))) + STRETCH // 2
    raise SceneError(
        f"{path} changes its sampling rate, from {1.0 / intervals[first]:.4g} to "
        f"{1.0 / intervals[last]:.4g} Hz about {times[row]:.4g} s; cut the record there, or "
        "resample it to the higher rate"
    )


def _shortest(interval: float, doubt: float) -> float:
    """The interval within the relative doubt that has the fewest digits, or whose rate has.

    >>> 1.0 / _shortest(0.005000000000000001, 1e-12), 1.0 / _shortest(0.01953125, 1e-6)
    (200.0, 51.2)
    """
    for digits in range(1, 18):
        for found in (1.0 / float(f"{1.0 / interval:.{digits}g}"), float(f"{interval:.{digits}g}")):
            if abs(found / interval - 1.0) <= doubt:
                return found
    return interval


def _last_digits(times: Vector, interval: float) -> Vector:
    """How coarse each time is, s: one with six digits in all has a decimal less from every power of
    ten on."""
    size = np.floor(np.log10(np.maximum(np.abs(times), interval)))
    found, finest = np.empty(len(times)), math.inf
    for power in range(int(size.max()), int(size.min()) - 1, -1):
        inside = size == power
        if inside.any():  # a few small times may happen to be round
            finest = min(finest, _last_digit(times[inside], interval))
            found[inside] = finest
    return found


def _in_single_precision(times: Vector) -> Vector | None:
    """Times in single precision as they were before they were written; None for others."""
    single = times.astype(np.float32)
    found = single.astype(float)
    written = (each for each in range(MOST_DIGITS) if _multiples(times, 10.0**-each))
    decimal = 10.0 ** -next(written, MOST_DIGITS)
    coarser = np.spacing(np.abs(single)) > decimal
    if not coarser.any():
        return None
    some = slice(None, None, max(len(times) // SOME, 1))
    shortest = np.array([float(str(each)) for each in single[some]])
    if np.all(np.abs(times - found) <= 0.51 * decimal) or np.array_equal(shortest, times[some]):
        return found
    return None


def _multiples(times: Vector, digit: float) -> bool:
    """Whether all times are multiples of a decimal unit, but for the rounding of binary numbers."""
    if len(times) > SOME and not _multiples(times[:SOME], digit):
        return False
    scaled = times / digit
    off = np.abs(scaled - np.round(scaled))
    return bool(np.all(off < 1e-6 + 1e-15 * np.abs(scaled)))


def _last_digit(times: Vector, interval: float) -> float:
    """The decimal unit, s, of which all times are multiples; 0 if it is far below the interval."""
    for digits in range(MOST_DIGITS + 1):
        digit = 10.0**-digits
        if digit < UNEVEN * interval:
            break
        if _multiples(times, digit):
            return digit
    return 0.0
