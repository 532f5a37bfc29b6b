"""A measured record of acceleration (or force), and the one-sided density estimated from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stochvi.mathematics.spectra import Table, response_moments, squared_gain
from stochvi.results.errors import SceneError
from stochvi.results.intervals import jackknife_error
from stochvi.scenes.readers import TIME_RESPONSE, read_columns

Vector = NDArray[np.float64]

FEWEST_SAMPLES = 256
"""Smallest number of samples of a record: the segments of a shorter one would resolve nothing."""

FEWEST_SEGMENT_LENGTHS = 8
"""Smallest length of a record in segments: one bin of the density then scatters by 37 %."""

BINS_IN_BANDWIDTH = 6.0
"""Number of bins in a half-power bandwidth, of which a Hann window covers a quarter (1.5 bins)."""

BINS_BELOW_RESONANCE = 10.0
"""Number of bins up to the natural frequency: the energy below the first bin is lost."""

HANN_OVERLAP_VARIANCE = 19.0 / 18.0
"""K times the variance of a mean over K half-overlapping Hann segments: 1 + 2 / 6^2."""

SMALLEST_DENSITY = 1e-16
"""Density of a bin without energy, relative to the largest: a table in logarithms cannot hold 0."""

UNEVEN = 0.1
"""Largest distance of a time from the even grid, in sampling intervals: printed digits are few."""

BLOCKS = 16
"""Number of blocks of a record from which the standard error of its kurtosis is taken."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """Evenly sampled values, in SI units, mean taken off.

    Parameters
    ----------
    values
        Values of the record, m/s^2 (or N).
    fs
        Sampling rate, 1/s.
    """

    values: Vector
    fs: float

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Record)
            and self.fs == other.fs
            and np.array_equal(self.values, other.values)
        )

    def __hash__(self) -> int:
        return hash((self.fs, len(self.values), self.values[:BLOCKS].tobytes()))

    @property
    def duration(self) -> float:
        """Length, s."""
        return len(self.values) / self.fs

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
        """Spacing of the bins, Hz: the coarsest that serves an oscillator, if the record is long
        enough for it; without one, the finest that the record allows.

        The coarsest is the smaller of b / (2 pi) / 6 (b / (2 pi) = 2 zeta f_n is the half-power
        bandwidth) and f_n / 10, the finest 8 / duration.
        """
        finest = FEWEST_SEGMENT_LENGTHS / self.duration
        if not omega or not damping_rate:
            return finest
        return max(finest, wanted_resolution(omega, damping_rate))

    def density(self, resolution_hz: float) -> DensityEstimate:
        """One-sided density by Welch's method: Hann windows, half overlap, means taken off.

        Parameters
        ----------
        resolution_hz
            Spacing of the bins; segments are 1 / `resolution_hz` long.

        Examples
        --------
        >>> noise = np.random.default_rng(1).normal(size=2**14)
        >>> found = Record(values=noise, fs=100.0).density(0.5)
        >>> found.segments, round(found.relative_error, 3)
        (162, 0.081)
        >>> round(float(found.table.density.mean()), 3)  # 2 / fs
        0.02
        """
        from scipy.fft import next_fast_len

        length = next_fast_len(min(math.ceil(self.fs / resolution_hz), len(self.values)), True)
        return _welch(self, min(length, len(self.values)))


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
    """Kept, because a scene asks for its tables again and again."""
    from scipy.signal import welch

    frequency, density = welch(record.values, record.fs, nperseg=length)
    segments = (len(record.values) - length // 2) // (length - length // 2)
    floor = SMALLEST_DENSITY * float(density[1:].max())
    return DensityEstimate(
        table=Table(frequency_hz=frequency[1:], density=np.maximum(density[1:], floor)),
        resolution_hz=record.fs / length,
        segments=segments,
        relative_error=math.sqrt(HANN_OVERLAP_VARIANCE / segments),
    )


def wanted_resolution(omega: float, damping_rate: float) -> float:
    """Spacing of bins that an oscillator's response needs, Hz (see `Record.resolution`)."""
    turn = 2.0 * math.pi
    return min(damping_rate / turn / BINS_IN_BANDWIDTH, omega / turn / BINS_BELOW_RESONANCE)


def response_error(
    record: Record, resolution_hz: float, omega: float, damping_rate: float
) -> tuple[float, float]:
    """Relative standard error and relative bias of the mean square response to a record's density.

    With G the density of the response, an estimate of its area from T seconds has the relative
    variance int G^2 df / (T (int G df)^2), whatever the segments: for a flat input
    1 / (pi B T), B the half-power bandwidth. The window smears the input over 1.5 bins; what it
    takes or adds is found by smearing the estimate once more, with 1/6, 2/3, 1/6 of three bins,
    which have the second moment of a Hann window's kernel.

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
    # the scatter of the bins adds to the mean of their squares
    squares = float(np.trapezoid(response**2, f)) / (1.0 + estimate.relative_error**2)
    return math.sqrt(squares / record.duration) / once, twice / once - 1.0


def _grid(table: Table, omega: float, damping_rate: float) -> Vector:
    """Frequencies of a table, and close ones about a resonance that may be narrower than bins."""
    natural, width = omega / (2.0 * math.pi), damping_rate / (2.0 * math.pi)
    near = natural + width * np.linspace(-20.0, 20.0, 801)
    low, high = table.frequency_hz[0], table.frequency_hz[-1]
    return np.union1d(table.frequency_hz, near[(near > low) & (near < high)])


def read_record(
    path: Path,
    *,
    factor: float = 1.0,
    fs: float | None = None,
    variables: tuple[str, ...] | None = None,
    dataset: int | None = None,
) -> tuple[Record, str | None]:
    """A record from two columns (time in s, value), or from one where `fs` is given.

    Returns the record, its values times `factor`, and the unit that the file states, if any.
    """
    names = ("acceleration",) if fs is not None else ("time", "acceleration")
    columns = read_columns(
        path, names, variables=variables, dataset=dataset, function_type=TIME_RESPONSE
    )
    values = columns.y
    if not np.all(np.isfinite(values)):
        row = int(np.argmin(np.isfinite(values))) + 1
        raise SceneError([("file", f"{path} holds {values[row - 1]} in row {row}")])
    if len(values) < FEWEST_SAMPLES:
        raise SceneError(
            [("file", f"{path} holds {len(values)} samples, expected at least {FEWEST_SAMPLES}")]
        )
    rate = fs if fs is not None or columns.x is None else _sampling_rate(columns.x, path)
    assert rate is not None
    values = (values - values.mean()) * factor
    if not np.any(values):
        raise SceneError([("file", f"{path} holds a record that does not move")])
    return Record(values=values, fs=rate), columns.unit


def _sampling_rate(time: Vector, path: Path) -> float:
    """1/s; the times of a record must be evenly spaced."""
    step = (time[-1] - time[0]) / (len(time) - 1)
    if not math.isfinite(step) or step <= 0.0:
        raise SceneError([("file", f"{path} must have rising times in its first column")])
    off = np.abs(time - (time[0] + step * np.arange(len(time))))
    if off.max() > UNEVEN * step:
        row = int(np.argmax(off)) + 1
        raise SceneError(
            [
                (
                    "file",
                    f"{path} must be sampled evenly: time {time[row - 1]:g} s in row {row} lies "
                    f"{off.max():.2g} s off the grid of {step:.4g} s; resample it, or give one "
                    "column and fs",
                )
            ]
        )
    return float(1.0 / step)
