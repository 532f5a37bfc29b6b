"""What synthesised records are made of. Chapters: levels that vary at random; forces drawn for a
whole record (shocks, fast peaks); sampling, lengths and expected averages."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.impact_rates import moments_of_rises
from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.mathematics.spectra import Table, band_of_velocity, squared_gain
from stochvi.mathematics.units import density_from_intensity
from stochvi.mathematics.unsteady_noise import (
    FastPeaks,
    PeakedRecords,
    RandomLevel,
    UnreachableKurtosis,
)
from stochvi.model.model import Signal
from stochvi.motion.kernels.modes import fill_modal_spectrum
from stochvi.motion.kernels.random_numbers import normal_rows, seed_streams
from stochvi.results.errors import NotApplicable
from stochvi.scenes.excitations.drawn import Pulses

# ------------------------------------------------------------------------------
# Levels that vary at random, for simulated records of noise of varying level.
#
# The level in decibels is known at knots, of which many fall into its correlation time, and is
# straight between them. Knots do not depend on the sampling: records at half the rate have the same
# level. The record of a block repeats, but its level does not: it jumps before the warm-up, which
# the end of the block is.
# ------------------------------------------------------------------------------


MOST_BLOCKS = 2**20
"""Largest number of blocks of a path. Each block has a random stream of its own, numbered from
path * MOST_BLOCKS; levels have those from half of this number on."""

KNOTS = 200.0
"""Knots in a correlation time. Between them the mean square of the level in decibels is too small
by 1 / (3 KNOTS) on average, which changes a kurtosis of 5 by 0.02 %."""


def levels_of_block(
    level: RandomLevel, seed: int, first_path: int, paths: int, number: int,
    *, samples: int, step: float, before: int,
) -> Matrix:  # fmt: skip
    """Levels (samples, paths) of block `number` of the paths first_path, first_path + 1, ...

    Parameters
    ----------
    before
        Samples of the warm-up at the end of the block, whose times lie before 0, and of the one
        from which they begin.
    """
    times = step * ((np.arange(samples) + before) % samples)
    spacing = level.time / KNOTS
    count = math.ceil(times.max() / spacing) + 2
    streams = np.empty((2, paths), np.uint64)
    own = first_path * MOST_BLOCKS + MOST_BLOCKS // 2 + number
    seed_streams(seed, own, streams, MOST_BLOCKS)
    half = math.ceil(count / 2)
    first, second = np.empty((2, half, paths))
    normal_rows(streams[0], streams[1], first, second)
    noise = np.stack([first, second], axis=1).reshape(2 * half, paths)[:count]
    decay = math.exp(-1.0 / KNOTS)
    noise[1:] *= math.sqrt(-math.expm1(-2.0 / KNOTS))
    normal = scipy.signal.lfilter([1.0], [1.0, -decay], noise, axis=0)
    place = times / spacing
    knot = place.astype(int)
    share = (place - knot)[:, None]
    return level.gain((1.0 - share) * normal[knot] + share * normal[knot + 1])


# ------------------------------------------------------------------------------
# Forces that are drawn for a whole block of a simulated record, in the frequency domain: shocks at
# random times, and noise with fast peaks.
#
# The times of shocks are those of a Poisson process in a block, which repeats. Each is put on the
# samples with the weights of a cubic B-spline, whose transform is taken out again. So the force is
# that of shocks between samples up to the share (f / (r - f))^4 of frequencies f that are folded at
# the sampling rate r: 8e-6 at 20 samples in a period.
#
# Noise with fast peaks has a sampling of its own, by its own band: its peaks do not depend on how
# finely the structure is sampled, which takes of it what it responds to.
# ------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BlockForce(ABC):
    """A force in blocks of `samples` at an interval of `step` seconds."""

    samples: int
    step: float

    def bins(self, seed: tuple[int, int], first_path: int, paths: int, number: int) -> Waves:
        """The force in block `number` of the paths first_path, first_path + 1, ...: its transform
        (samples // 2 + 1, paths), N, or m/s^2 of the base.

        `seed` is that of the paths, and the number of the excitation.
        """
        streams = [(first_path + path) * MOST_BLOCKS + number for path in range(paths)]
        random = [np.random.default_rng([*seed, stream]) for stream in streams]
        return np.stack([self._bins(each) for each in random], axis=1)

    @abstractmethod
    def _bins(self, random: np.random.Generator) -> Waves:
        """The transform (samples // 2 + 1,) of one path."""


@dataclass(frozen=True, eq=False)
class ForceOfShocks(BlockForce):
    """Shocks at random times."""

    pulses: Pulses

    def _bins(self, random: np.random.Generator) -> Waves:
        weights = np.zeros(self.samples)
        count = random.poisson(self.pulses.rate * self.samples * self.step)
        times = random.uniform(0.0, self.samples, count)
        sizes = self.pulses.drawn_sizes(count, random)
        first = np.floor(times).astype(int)
        for knot, weight in enumerate(_cubic(times - first)):
            np.add.at(weights, (first - 1 + knot) % self.samples, sizes * weight)
        return np.asarray(self._filter * scipy.fft.rfft(weights))

    @cached_property
    def _filter(self) -> Waves:
        """The force of a shock in the bins over the weights of its time."""
        assert self.pulses.shock is not None
        frequency = np.arange(self.samples // 2 + 1) / (self.samples * self.step)
        transform = self.pulses.size * self.pulses.shock.transform(2.0 * np.pi * frequency)
        return np.asarray(transform / (self.step * np.sinc(frequency * self.step) ** 4))


@dataclass(frozen=True, eq=False)
class ForceOfPeaks(BlockForce):
    """Noise with fast peaks."""

    peaks: FastPeaks

    def _bins(self, random: np.random.Generator) -> Waves:
        records, found = self._records, np.zeros(self.samples // 2 + 1, complex)
        bins = self.samples / records.samples * records.bins(random, 1)[:, 0]
        kept = min(len(bins), len(found))
        found[:kept] = bins[:kept]
        return found

    @cached_property
    def _records(self) -> PeakedRecords:
        return self.peaks.over(self.samples * self.step)


def force_of(excitation: Pulses | FastPeaks, samples: int, step: float) -> BlockForce:
    """What draws an excitation in blocks of so many samples at an interval, s.

    Raises
    ------
    NotApplicable
        If noise of its density cannot have the kurtosis.
    """
    if isinstance(excitation, Pulses):
        return ForceOfShocks(samples, step, excitation)
    try:
        excitation.cubic  # noqa: B018
    except UnreachableKurtosis as reason:
        raise NotApplicable("simulate", str(reason)) from reason
    return ForceOfPeaks(samples, step, excitation)


def _cubic(share: Vector) -> tuple[Vector, Vector, Vector, Vector]:
    """Weights of a cubic B-spline at the sample before, at the two around and at the one after a
    time that lies a share of a step beyond a sample."""
    rest = 1.0 - share
    return (
        rest**3 / 6.0,
        2.0 / 3.0 - share**2 + share**3 / 2.0,
        2.0 / 3.0 - rest**2 + rest**3 / 2.0,
        share**3 / 6.0,
    )


# ------------------------------------------------------------------------------
# Sampling and lengths of synthesised records, and expected averages over the motion without stops.
#
# A path is a row of independent blocks, of which a part may be left uncounted. Within a block the
# motion without stops is a periodic Gaussian signal, a sum over bins of width 1 / length whose
# variances are the integrals of the response density over the bins, so that the edges of a table
# are exact. Bins up to the cut at half the sampling rate are synthesised; the last quarter of them
# is scaled up so that the velocity variance beyond the cut is not lost.
#
# Relative errors for every shipped profile on mounts of 8, 12 and 50 Hz (zeta 0.1), from sums over
# the bins and frequency integrals: at most 2e-5 in the standard deviations of y and y', and 1.6e-4
# in the rate at which y crosses 3 sigma. The cubics between the samples add an error where the
# velocity has power up to the cut: they cross 3 sigma too seldom, by at most 0.04 % for a 12 Hz
# mount on a truck (vertical) and 0.15 % for any profile.
# ------------------------------------------------------------------------------


SAMPLES_PER_PERIOD = 20.0
"""Smallest number of samples in a natural period. There are more if the response to the table is
broader than the resonance."""

LARGEST_LOSS = 0.005
"""Largest share of the velocity variance above half the sampling rate (the cut), which is folded
back into the highest synthesised bins."""

FOLD_FROM = 0.75
"""Share of the synthesised bins above which the bins take up the velocity variance that lies beyond
the cut."""

BLOCK_RELAXATIONS = 120.0
"""Length of a block in time constants of the structure, so that its bins resolve the resonance."""

WARM_UP_RELAXATIONS = 15.0
"""Length of the warm-up before counting starts, in relaxation times of the structure: the
difference to the response without stops begins at zero and must become stationary."""

MOST_SAMPLES = 2**22
"""Largest number of samples of a block of one path: 64 MB of complex numbers."""

LARGEST_BLOCK = 32
"""Largest number of paths that are synthesised together: the loops over paths are then long enough
for the processor's vectors, and there are blocks enough for all threads."""

BLOCK_SAMPLES = 2**19
"""Largest number of samples of all paths that are synthesised together: 8 MB, which the caches hold
in part."""

GAP_PER_SAMPLE = 0.125
"""Largest share of the gap between two stops that the mass crosses between two samples at the rms
speed that it has without stops."""

SAMPLES_ON_STOP = 2.75
"""Smallest number of samples in a period of the highest frequency that shakes a mass which its load
presses onto a stop. A mass under gravity on a truck had impacts 5 % too seldom on a rigid stop with
1.4 samples. With 2.75 samples it was 2 %, and 0.1 % on stops of 60 to 1000 Hz. At the rate that the
free response needs, 0.35 samples, it was 27 to 35 %."""

BIN_ERROR = 0.001
"""Largest relative error of the velocity variance that the finite width of the bins may cause."""

MOST_DOUBLINGS = 8
"""Largest number of times that the length of a block is doubled, for a table that reaches far below
the resonance."""

MOST_SUB_STEPS = 1000
"""Largest number of sub-steps of a contact in one sampling interval, for a mass that stays on a
stop."""

LOWEST_FREQUENCY = 1e-5
"""Lowest frequency of the table that represents white noise, in natural frequencies."""

NODES_PER_DECADE = 400.0
"""Number of breakpoints per decade of the table that represents filtered noise; they are closer
near its resonance."""

ROUNDING = 1e-12
"""Relative error of a number of samples that is the ratio of two times."""

WHITE_LOSS = LARGEST_LOSS / 2.0
"""Share of the velocity variance by white noise that lies above its table and is folded back."""


def expected_of_free_motion(
    variances: NDArray[np.float64], relative: float, samples: int, step: float,
    beyond: Mapping[str, float],
) -> dict[str, float]:  # fmt: skip
    """Expected averages over the motion without stops, by name.

    Parameters
    ----------
    variances
        Variance of each synthesised bin, m^2, up to half the sampling rate at most.
    relative
        Frequency of the first bin over the one by which velocities are divided.
    samples, step
        Number of samples of a block, and their interval, s.
    beyond
        Distance of each stop from the mean position by its name, m; negative where the mean
        position lies beyond the stop.
    """
    bins = np.arange(1, len(variances) + 1)
    variance = float(np.sum(variances))
    speeds = float(np.sum((relative * bins) ** 2 * variances))
    found = {"free xx": variance, "free vv": speeds}
    turned = np.sin(np.pi * bins / samples) ** 2
    change = 2.0 * float(np.sum(variances * turned))
    for stop, distance in beyond.items():
        moments = moments_of_rises(distance, variance, change / variance)
        for name, moment in zip(("n", "rises", "squares"), moments, strict=True):
            found[f"free {name}_{stop}"] = moment / step
    return found


def folded(waves: Waves, velocities: Vector, length: float) -> Waves:
    """Amplitudes (bins, rows, tables) with the last quarter scaled up, so that the rows have these
    velocity variances over a block of `length` seconds: what lies beyond the bins is not lost."""
    omega2 = (2.0 * np.pi / length * np.arange(1, len(waves) + 1)) ** 2
    known = omega2[:, None] * np.sum(np.abs(waves) ** 2, axis=2)
    missing, last = velocities - known.sum(axis=0), int(FOLD_FROM * len(waves))
    top = known[last:].sum(axis=0)
    grown = np.divide(missing, top, out=np.zeros_like(top), where=(top > 0.0) & (missing > 0.0))
    waves[last:] *= np.sqrt(1.0 + grown)[:, None]
    return waves


def synthesised(
    waves: Waves, streams: NDArray[np.uint64], samples: int, length: float, scale: float
) -> Waves:
    """Values + i slopes / `scale` (samples, rows, paths) of a block of `length` seconds, from the
    amplitudes (bins, rows, tables) and the streams (2, paths), which are advanced."""
    relative = 2.0 * np.pi / length / scale * np.arange(1, len(waves) + 1)
    spectrum = np.empty((samples, waves.shape[1], streams.shape[1]), complex)
    real, imaginary = np.ascontiguousarray(waves.real), np.ascontiguousarray(waves.imag)
    fill_modal_spectrum(streams, real, imaginary, relative, spectrum.view(np.float64))
    return np.asarray(scipy.fft.ifft(spectrum, axis=0, norm="forward", overwrite_x=True))


def _even_fast_length(samples: float) -> int:
    """An even number of samples whose half has a fast Fourier transform.

    Rounding cannot change a number that follows from its own step.
    """
    half = max(samples, 32.0) / 2.0
    return 2 * int(scipy.fft.next_fast_len(math.ceil(half * (1.0 - ROUNDING))))


def rate_on_stops(tables: Sequence[Table], on_stops: Sequence[float], most: float) -> float:
    """Samples per second, at most `most`, for masses that have the frequencies `on_stops` (rad/s)
    on stops onto which they are pressed.

    The structure filters the noise. A mass on a stop is shaken by the noise itself, as far as an
    oscillator on the stop follows it.
    """
    bands = [band_of_velocity(tables, omega, LARGEST_LOSS) for omega in on_stops]
    return min(SAMPLES_ON_STOP * max(bands, default=0.0), most)


def _filtered(signal: Signal, omega: float) -> Table:
    """Density of white noise passed through a resonance, 2 S0 |H|^2 with H(0) = 1."""
    middle = signal.omega / (2.0 * math.pi)
    natural = omega / (2.0 * math.pi)
    low = min(1e-4 * middle, LOWEST_FREQUENCY * natural)
    high = max(100.0 * middle, 10.0 * natural)
    nodes = math.ceil(NODES_PER_DECADE * math.log10(high / low))
    width = signal.damping_rate / signal.omega
    near = middle * (1.0 + width * np.linspace(-20.0, 20.0, 1601))
    grid = np.unique(np.concatenate([np.geomspace(low, high, nodes), near[near > low]]))
    gain = squared_gain(grid, signal.omega, signal.damping_rate) * signal.omega**4
    return Table(frequency_hz=grid, density=density_from_intensity(signal.intensity) * gain)
