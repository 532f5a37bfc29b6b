"""Tabulated noise: synthesise the response without stops, then add the impacts.

A path is a row of independent blocks, of which a part may be left uncounted. Within a block the
free response y is a periodic Gaussian signal, a sum over bins of width 1 / length whose variances
are the integrals of the response density |H|^2 G over the bins, so that the edges of a table are
exact. Bins up to the cut at half the sampling rate are synthesised; the last quarter of them is
scaled up so that the velocity variance beyond the cut is not lost.

What that leaves, for every shipped profile on mounts of 8, 12 and 50 Hz (zeta 0.1), by sums over
the bins against the frequency integrals: at most 2e-5 of the standard deviations of y and y', and
1.6e-4 of the rate at which y crosses 3 sigma. The cubics between the samples lose more, where the
velocity reaches up to the cut: they cross 3 sigma too seldom, by at most 0.04 % for a 12 Hz mount
on a truck (vertical) and 0.15 % for any profile.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import ifft, next_fast_len

from stochvi.errors import NotApplicable
from stochvi.monte_carlo.kernels.flight import N_LOWER, SUMS
from stochvi.monte_carlo.kernels.random_numbers import seed_streams
from stochvi.monte_carlo.kernels.response_domain import fill_spectrum, run_response
from stochvi.monte_carlo.white import default_threshold
from stochvi.scenes import System
from stochvi.spectra import Table, response_moments, squared_gain

SAMPLES_PER_PERIOD = 20.0
"""Of the natural period; more where the response to the table is broader than the resonance."""

LARGEST_LOSS = 0.005
"""Share of the velocity variance that may lie beyond the cut and be folded back."""

FOLD_FROM = 0.75
"""Bins from here to the cut take up the velocity variance that lies beyond it."""

BLOCK_RELAXATIONS = 120.0
"""Length of a block in time constants of the structure: resolves its resonance."""

WARM_UP_RELAXATIONS = 15.0
"""Flown before counting starts, for the decay e to forget that it began at rest."""

MOST_SAMPLES = 2**22
"""To a block of one path."""

LARGEST_BLOCK = 32
"""Paths synthesised together: loops over them are long enough, and threads have work in turn."""

BLOCK_SAMPLES = 2**19
"""Samples of paths synthesised together, at most: 8 MB, which the caches hold in part."""

MOST_BLOCKS = 2**20
"""Of a path: each block has a random stream, numbered from path * MOST_BLOCKS."""

GAP_PER_SAMPLE = 0.125
"""Share of the gap that the mass crosses between samples at its rms speed without stops."""

BIN_ERROR = 0.001
"""Share of the velocity variance that the width of bins may feign or hide."""

MOST_DOUBLINGS = 8
"""Of the length of a block, for a table that reaches far below the resonance."""


@dataclass(frozen=True, kw_only=True)
class TabulatedPlan:
    """Sampling and lengths for one scene under tabulated noise (SI units, per unit mass)."""

    system: System
    samples: int
    block_length: float
    counted: float
    blocks_per_path: int
    warm_up: float
    threshold: float
    bins: NDArray[np.float64]

    method = "response-domain synthesis"
    elastic = False

    def step_bias(self, name: str, difference: float) -> float | None:
        """What the sampling leaves in a quantity, from its difference to half the rate: of second
        order, as the response is smooth between samples."""
        return difference / 3.0

    @property
    def block(self) -> int:
        """Paths that are synthesised together: a few megabytes of samples, and a power of two,
        for the loops over paths to fill the processor's vectors."""
        fitting = max(1, min(LARGEST_BLOCK, BLOCK_SAMPLES // self.samples))
        return 1 << (fitting.bit_length() - 1)

    @property
    def duration(self) -> float:
        """Counted seconds of a path."""
        return self._counted_samples * self.step * self.blocks_per_path

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.block_length / self.samples

    @property
    def burn_in(self) -> float:
        """Uncounted seconds of a path."""
        return self.warm_up * self.blocks_per_path

    @property
    def steps_per_path(self) -> int:
        """All samples of a path, warm-up included."""
        return (self._counted_samples + self._warm_up_samples) * self.blocks_per_path

    @property
    def _counted_samples(self) -> int:
        return max(1, min(self.samples, math.ceil(self.counted / self.step)))

    @property
    def hits_in_a_cluster(self) -> float:
        """Periods in which the energy is remembered, at most one hit each on either stop."""
        return max(1.0, self.system.omega / (2.0 * math.pi) / self.system.damping_rate)

    @property
    def _warm_up_samples(self) -> int:
        return min(self.samples - 1, math.ceil(self.warm_up / self.step))

    @property
    def rest(self) -> float:
        """Mean position without stops."""
        return self.system.load / self.system.omega**2

    @property
    def origin(self) -> float:
        """Moments of x are taken from here."""
        return self.rest

    def coarser(self) -> TabulatedPlan:
        """The same paths at half the sampling rate: common bins have common amplitudes."""
        return replace(self, samples=2 * (self.samples // 4))

    def finer(self) -> TabulatedPlan:
        """Paths at twice the sampling rate."""
        return self.with_step(self.step / 2.0)

    def with_step(self, step: float) -> TabulatedPlan:
        """Paths at a chosen sampling interval, s."""
        samples = _even_fast_length(self.block_length / step)
        system = self.system
        bins, _ = _bin_variances(
            system.tables, system.omega, system.damping_rate, self.block_length, samples // 2
        )
        return replace(self, samples=samples, bins=bins)

    def shortest(self) -> TabulatedPlan:
        """A block of few samples: enough to have the kernels compiled."""
        return replace(self, samples=32, blocks_per_path=1)

    @property
    def recorded_samples(self) -> int:
        """Samples of a recorded path."""
        return self._counted_samples * self.blocks_per_path

    def averages(
        self, seed: int, first_path: int, paths: int, record: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """Time averages (SUMS, paths) of the paths first_path, first_path + 1, ..., with positions
        from the mean position without stops."""
        sums = np.zeros((SUMS, paths))
        for number in range(self.blocks_per_path):
            block_record = None
            if record is not None:
                counted = self._counted_samples
                block_record = record[number * counted : (number + 1) * counted]
            run_response(
                self._free_response(seed, first_path, paths, number),
                self.step,
                (self.system.omega, self.system.damping_rate),
                self._stop(self.system.lower, self.system.restitution_lower),
                self._stop(self.system.upper, self.system.restitution_upper),
                self.threshold,
                math.sqrt(self._velocity_variance),
                self._warm_up_samples,
                self._counted_samples,
                sums,
                block_record,
            )
        sums[:N_LOWER] /= self._counted_samples * self.blocks_per_path
        sums[N_LOWER:] /= self.duration
        return sums

    def _stop(
        self, position: float | None, restitution: float | None
    ) -> tuple[float, float] | None:
        if position is None or restitution is None:
            return None
        return (position - self.rest, restitution)

    @cached_property
    def _velocity_variance(self) -> float:
        omega, b = self.system.omega, self.system.damping_rate
        return response_moments(self.system.tables, omega, b).velocity

    @cached_property
    def _amplitudes(self) -> NDArray[np.float64]:
        """Standard deviation of the cosine and sine coefficients of each synthesised bin."""
        variance = self.bins[: self.samples // 2 - 1].copy()
        omega2 = (2.0 * np.pi / self.block_length * np.arange(1, len(variance) + 1)) ** 2
        last = int(FOLD_FROM * len(variance))
        top = float(np.sum((omega2 * variance)[last:]))
        missing = self._velocity_variance - float(np.sum(omega2 * variance))
        if top > 0.0 and missing > 0.0:
            variance[last:] *= 1.0 + missing / top
        deviation: NDArray[np.float64] = np.sqrt(variance)
        return deviation

    def _free_response(
        self, seed: int, first_path: int, paths: int, number: int
    ) -> NDArray[np.float64]:
        """y and y' / omega, in turn, of block `number` of each path, (samples, 2 paths)."""
        streams = np.empty((2, paths), np.uint64)
        # every (path, block) has a stream of its own, whatever the blocks of other paths need
        for index in range(paths):
            first = (first_path + index) * MOST_BLOCKS + number
            seed_streams(np.uint64(seed), first, streams[:, index : index + 1])
        amplitudes = self._amplitudes
        bins = np.arange(1, len(amplitudes) + 1)
        relative = 2.0 * np.pi / self.block_length / self.system.omega * bins
        spectrum = np.empty((self.samples, paths), complex)
        fill_spectrum(streams, amplitudes, relative, spectrum.view(np.float64))
        free = ifft(spectrum, axis=0, norm="forward", overwrite_x=True)
        response: NDArray[np.float64] = free.view(np.float64)
        return response


def plan_tabulated(
    system: System, threshold: float | None, duration: float | None
) -> TabulatedPlan:
    """Choose sampling and lengths for a scene whose noise is tabulated."""
    unmet = system.not_rigid()
    if system.intensity > 0.0:
        unmet.append("white and tabulated noise in one scene are not simulated together")
    if system.omega == 0.0:
        unmet.append("tabulated noise needs stiffness > 0, got 0")
    if system.damping_rate == 0.0:
        unmet.append("tabulated noise needs damping > 0, got 0")
    if unmet:
        raise NotApplicable("simulate", unmet)
    omega, b = system.omega, system.damping_rate
    half = b / 2.0
    slowest = half - math.sqrt(max(half * half - omega * omega, 0.0))
    relaxation = 1.0 / max(slowest, omega**2 / b / 2.0 if half > omega else half)
    length = _block_length(system, BLOCK_RELAXATIONS * max(relaxation, 1.0 / omega))
    counted, blocks = length, 1
    if duration is not None:
        if duration > MOST_BLOCKS * length:
            raise NotApplicable(
                "simulate",
                [
                    f"a path of {duration:.3g} s needs more than {MOST_BLOCKS} blocks of "
                    f"{length:.3g} s; give a shorter duration and more paths"
                ],
            )
        blocks = math.ceil(duration / length)
        counted = duration / blocks
    highest = max(float(table.frequency_hz[-1]) for table in system.tables)
    rate = max(SAMPLES_PER_PERIOD * omega / (2.0 * math.pi), _rate_for_gap(system))
    most = max(min(2.2 * highest * length, MOST_SAMPLES), rate * length)
    if rate * length > MOST_SAMPLES:
        raise NotApplicable("simulate", [_too_many(rate * length)])
    bins, velocities = _bin_variances(system.tables, omega, b, length, math.ceil(most / 2.0) + 1)
    kept = np.cumsum(velocities)
    enough = 1 + int(np.searchsorted(kept, (1.0 - LARGEST_LOSS) * kept[-1]))
    total = response_moments(system.tables, omega, b).velocity
    if kept[-1] < (1.0 - LARGEST_LOSS) * total:
        raise NotApplicable("simulate", [_too_many(2.2 * highest * length)])
    samples = _even_fast_length(max(rate * length, 2.0 * (enough + 1)))
    if threshold is None:
        threshold = default_threshold(system.elastic, math.sqrt(total))
    return TabulatedPlan(
        system=system,
        samples=samples,
        block_length=length,
        counted=counted,
        blocks_per_path=blocks,
        warm_up=WARM_UP_RELAXATIONS * relaxation,
        threshold=threshold,
        bins=bins,
    )


def _even_fast_length(samples: float) -> int:
    """An even number of samples of which the half is quick to transform."""
    return 2 * int(next_fast_len(math.ceil(max(samples, 32.0) / 2.0)))


def _too_many(samples: float) -> str:
    return (
        f"a block needs {samples:.2g} samples, at most {MOST_SAMPLES} are made: the fastest motion "
        "(table, or flight between the stops) and the slowest (decay of the resonance) are too "
        "far apart"
    )


def _rate_for_gap(system: System) -> float:
    """Samples per second for a mass between narrow stops, at the rms speed without them."""
    if system.lower is None or system.upper is None:
        return 0.0
    speed = math.sqrt(response_moments(system.tables, system.omega, system.damping_rate).velocity)
    return speed / (GAP_PER_SAMPLE * (system.upper - system.lower))


def _block_length(system: System, shortest: float) -> float:
    """Seconds of a block in which bins are narrow enough for the slowest part of the table.

    A bin has one frequency, its middle: the velocity variance so given must be the true one.
    """
    omega, b = system.omega, system.damping_rate
    length = shortest
    for _ in range(MOST_DOUBLINGS):
        count = math.ceil(min(omega / math.pi * length, MOST_SAMPLES / 2)) + 2
        variances, velocities = _bin_variances(system.tables, omega, b, length, count)
        omega2 = (2.0 * np.pi / length * np.arange(1, count)) ** 2
        total = response_moments(system.tables, omega, b).velocity
        if abs(float(np.sum(omega2 * variances - velocities))) <= BIN_ERROR * total:
            return length
        length *= 2.0
    raise NotApplicable(
        "simulate", ["the table reaches down to frequencies too far below the resonance"]
    )


def _bin_variances(
    tables: tuple[Table, ...], omega: float, damping_rate: float, length: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacement and velocity variances of the bins 1 ... count - 1, [(k -+ 1/2)] / length.

    What lies below the first bin is added to it. Bins are cut at the breakpoints of the tables,
    so that a jump of the density inside a bin does no harm.
    """
    nodes, weights = np.polynomial.legendre.leggauss(6)
    edges = (np.arange(count) + 0.5) / length
    edges[0] = 1e-6 / length
    variances, velocities = np.zeros((2, count - 1))
    for table in tables:
        cuts = np.unique(np.concatenate([edges, table.frequency_hz]))
        cuts = cuts[(cuts >= edges[0]) & (cuts <= edges[-1])]
        half, middle = np.diff(cuts) / 2.0, (cuts[1:] + cuts[:-1]) / 2.0
        f = middle[:, None] + half[:, None] * nodes
        density = squared_gain(f, omega, damping_rate) * table(f)
        owner = np.clip(np.searchsorted(edges, middle) - 1, 0, count - 2)
        np.add.at(variances, owner, half * (density @ weights))
        np.add.at(velocities, owner, half * ((density * (2.0 * np.pi * f) ** 2) @ weights))
    return variances, velocities
