"""Shocks at random times, for simulated records: their force in the frequency domain.

The times of shocks are those of a Poisson process in a block, which repeats. Each is put on the
samples with the weights of a cubic B-spline, whose transform is taken out again. So the force is
that of shocks between samples up to the share (f / (r - f))^4 of frequencies f that are folded at
the sampling rate r: 8e-6 at 20 samples in a period.
"""

from __future__ import annotations

import numpy as np
from scipy.fft import rfft

from stochvi.mathematics.arrays import Vector, Waves
from stochvi.methods.monte_carlo.random_levels import MOST_BLOCKS
from stochvi.scenes.excitations.pulses import Pulses


def filter_of(pulses: Pulses, samples: int, step: float) -> Waves:
    """The force of a shock on the samples of a block over the weights of its time there, by bin
    (samples // 2 + 1,), N, or m/s^2 of the base."""
    assert pulses.shock is not None
    frequency = np.arange(samples // 2 + 1) / (samples * step)
    transform = pulses.size * pulses.shock.transform(2.0 * np.pi * frequency)
    return np.asarray(transform / (step * np.sinc(frequency * step) ** 4))


def shocks_of_block(
    pulses: Pulses, seed: tuple[int, int], first_path: int, paths: int, number: int,
    *, samples: int, step: float,
) -> Waves:  # fmt: skip
    """The weights of shocks in block `number` of the paths first_path, first_path + 1, ...: their
    transform (samples // 2 + 1, paths), by which `filter_of` is multiplied.

    `seed` is that of the paths, and the number of the excitation.
    """
    length = samples * step
    weights = np.zeros((samples, paths))
    for path in range(paths):
        stream = (first_path + path) * MOST_BLOCKS + number
        random = np.random.default_rng([*seed, stream])
        count = random.poisson(pulses.rate * length)
        times, sizes = random.uniform(0.0, samples, count), _sizes(pulses, count, random)
        first = np.floor(times).astype(int)
        for knot, weight in enumerate(_cubic(times - first)):
            np.add.at(weights[:, path], (first - 1 + knot) % samples, sizes * weight)
    return np.asarray(rfft(weights, axis=0))


def _sizes(pulses: Pulses, count: int, random: np.random.Generator) -> Vector:
    """Sizes of so many pulses over `Pulses.size`, with their directions."""
    drawn: Vector = np.ones(count)
    if pulses.sizes == "normal":
        drawn = np.abs(random.standard_normal(count))
    elif pulses.sizes == "exponential":
        drawn = random.standard_exponential(count)
    directions = random.choice([-1.0, 1.0], count) if pulses.two_sided else 1.0
    return np.asarray(drawn * directions)


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
