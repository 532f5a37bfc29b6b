"""Forces that are drawn for a whole block of a simulated record, in the frequency domain: shocks at
random times, and noise with fast peaks.

The times of shocks are those of a Poisson process in a block, which repeats. Each is put on the
samples with the weights of a cubic B-spline, whose transform is taken out again. So the force is
that of shocks between samples up to the share (f / (r - f))^4 of frequencies f that are folded at
the sampling rate r: 8e-6 at 20 samples in a period.

Noise with fast peaks has a sampling of its own, by its own band: its peaks do not depend on how
finely the structure is sampled, which takes of it what it responds to.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.fft import rfft

from stochvi.mathematics.arrays import Vector, Waves
from stochvi.mathematics.fast_peaks import FastPeaks, PeakedRecords, UnreachableKurtosis
from stochvi.methods.monte_carlo.random_levels import MOST_BLOCKS
from stochvi.results.errors import NotApplicable
from stochvi.scenes.excitations.pulses import Pulses


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
        return np.asarray(self._filter * rfft(weights))

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
        raise NotApplicable("simulate", [str(reason)]) from reason
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
