"""Tabulated noise on one oscillator. Chapters: levels that vary at random; synthesis of the
response without stops, and impacts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.engine.arithmetic import NO_LOG, NO_RECORD, Log
from stochvi.engine.parts import rate
from stochvi.engine.sub_steps import ANGLE_OF_ONE_MASS
from stochvi.mathematics.impact_rates import COLLAPSE_RESTITUTION, moments_of_rises
from stochvi.mathematics.numerics import Matrix, gauss_legendre
from stochvi.mathematics.spectra import Table, band_of_velocity, response_moments, squared_gain
from stochvi.mathematics.units import density_from_intensity, intensity_from_density
from stochvi.mathematics.unsteady_noise import RandomLevel
from stochvi.methods.monte_carlo.kernels.flight import (
    N_LOWER,
    NO_EXTREMES,
    RigidStop,
    Sampling,
    Sums,
)
from stochvi.methods.monte_carlo.kernels.one_mass import (
    add_free_motion,
    fill_spectrum,
    run_response,
)
from stochvi.methods.monte_carlo.kernels.random_numbers import normal_rows, seed_streams
from stochvi.methods.monte_carlo.plan import (
    Histories,
    Layout,
    Records,
    Underway,
    bias_of_lasting_contact,
    bias_of_plain_step,
    bias_of_smooth_motion,
    columns_of_one,
    histories_of_one,
    layout_of_one,
    losses_of,
    lossiest,
)
from stochvi.methods.monte_carlo.white import (
    COARSE_SHARE,
    CONTACT_ROWS,
    StopsOfMass,
    pressing,
    pressing_onto,
    stops_of_mass,
    threshold_of,
)
from stochvi.model.model import Model, Signal, Stop
from stochvi.results.errors import NotApplicable
from stochvi.sampling.calculations import stop_flag
from stochvi.scenes.impact_laws import CompliantLaw

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
    for index in range(paths):
        stream = (first_path + index) * MOST_BLOCKS + MOST_BLOCKS // 2 + number
        seed_streams(np.uint64(seed), stream, streams[:, index : index + 1])
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
# Tabulated noise on one oscillator: the response without stops is synthesised, impacts are added.
#
# A path is a row of independent blocks, of which a part may be left uncounted. Within a block the
# free response y is a periodic Gaussian signal, a sum over bins of width 1 / length whose variances
# are the integrals of the response density |H|^2 G over the bins, so that the edges of a table are
# exact. Bins up to the cut at half the sampling rate are synthesised; the last quarter of them is
# scaled up so that the velocity variance beyond the cut is not lost. White and filtered noise that
# act together with a table become tables themselves; a sine adds its steady response.
#
# Relative errors for every shipped profile on mounts of 8, 12 and 50 Hz (zeta 0.1), from sums over
# the bins and frequency integrals: at most 2e-5 in the standard deviations of y and y', and 1.6e-4
# in the rate at which y crosses 3 sigma. The cubics between the samples add an error where the
# velocity has power up to the cut: they cross 3 sigma too seldom, by at most 0.04 % for a 12 Hz
# mount on a truck (vertical) and 0.15 % for any profile.
#
# Contacts with compliant stops are integrated in sub-steps of their own time scale, within the
# sampling interval (`engine.one_mass`).
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


@dataclass(frozen=True, kw_only=True)
class TabulatedPlan:
    """Sampling and lengths for one oscillator under tabulated noise, to which other noise and sines
    may be added.

    All in SI units, per unit mass. The `tables` hold all noise; `beyond` is the velocity
    variance that white noise brings above its table; `waves` are the sines, (omega, complex
    amplitude of the response without stops). The variances of `bin_count` - 1 bins are known.
    """

    model: Model
    tables: tuple[Table, ...]
    beyond: float
    waves: tuple[tuple[float, complex], ...]
    samples: int
    block_length: float
    counted: float
    blocks_per_path: int
    warm_up: float
    threshold: float
    bin_count: int

    method = "response-domain synthesis"
    states = 2
    coarse_share = COARSE_SHARE
    elastic = False
    kicked = False
    settling = 0

    @property
    def relative_bias(self) -> float:
        """None but that of the step."""
        return 0.0

    @property
    def contacts(self) -> bool:
        """Whether a stop is compliant; `averages` then have CONTACT_SUMS rows."""
        return not self.model.rigid

    def step_bias(self, name: str, difference: float) -> float | None:
        """The bias that the sampling leaves in a quantity, from its difference to half the sampling
        rate; None for rates of slow impacts under white noise (`step_bias`)."""
        if not self.beyond:
            lasts = pressing(self.model) > 0.0
            return (bias_of_lasting_contact if lasts else bias_of_smooth_motion)(difference)
        return bias_of_plain_step(name, difference, lossiest(self.model))

    @property
    def block(self) -> int:
        """Number of paths that are synthesised together: a few megabytes of samples, and a power of
        two, so that loops over paths fill the vectors of the processor."""
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
        """Number of samples of a path, warm-up included."""
        return (self._counted_samples + self.warm_up_samples) * self.blocks_per_path

    @property
    def _counted_samples(self) -> int:
        # the warm-up begins from the sample before it, at which a sine or a level has jumped
        most = self.samples
        most -= 1 + self.warm_up_samples if _unrepeated(self.model, self.waves) else 0
        return max(1, min(most, math.ceil(self.counted / self.step)))

    @property
    def hits_in_a_cluster(self) -> float:
        """Number of natural periods in a relaxation time of the energy, at least 1: there is at
        most one impact on a stop in a period."""
        return max(1.0, self.model.omega / (2.0 * math.pi) / self.model.damping_rate)

    @property
    def warm_up_samples(self) -> int:
        """Number of samples of a block before counting starts."""
        return min(self.samples - 1, math.ceil(self.warm_up / self.step))

    @property
    def speed(self) -> float:
        """Rms velocity under the noise, without stops."""
        return math.sqrt(self._velocity_variance)

    @property
    def origin(self) -> float:
        """The mean position without stops, from which moments of x are taken."""
        return self.model.rest

    @cached_property
    def layout(self) -> Layout:
        """Meaning of the rows of `averages`."""
        sums = tuple(CONTACT_ROWS) if self.contacts else ()
        return layout_of_one(self.model, self.origin, self.threshold, sums, self._controls)

    @cached_property
    def _controls(self) -> dict[str, float]:
        """Averages over the motion without stops, by name, and their expected values.

        They are known exactly, since the synthesised samples are normal: y^2, (y' / omega)^2, and
        for each stop the number of passages beyond it per second, with the sums of the rises and of
        their squares, m/s and m^2/s. There are none without stops, where nothing is left to
        simulate, nor with sines or a level that varies.
        """
        variances = self.amplitudes**2
        if _unrepeated(self.model, self.waves) or not self.model.stops or not np.any(variances):
            return {}
        relative = 2.0 * np.pi / self.block_length / self.model.omega
        beyond = {
            stop.name: stop.side * (stop.position - self.model.rest) for stop in self.model.stops
        }
        return expected_of_free_motion(variances, relative, self.samples, self.step, beyond)

    def coarser(self) -> TabulatedPlan:
        """The same paths at half the sampling rate; bins that both plans have keep their
        amplitudes."""
        return replace(self, samples=2 * (self.samples // 4))

    def finer(self) -> TabulatedPlan:
        """Paths at twice the sampling rate."""
        return self.with_step(self.step / 2.0)

    def with_step(self, step: float) -> TabulatedPlan:
        """Paths at a chosen sampling interval, s."""
        samples = _even_fast_length(self.block_length / step)
        omega, b = self.model.omega, self.model.damping_rate
        tables, beyond = self.tables, self.beyond
        if beyond:  # the table of white noise, the last one, ends at half the sampling rate
            flat = _longer(tables[-1], 0.5 * samples / self.block_length)
            tables = (*tables[:-1], flat)
            beyond = _white_beyond(flat, omega, b)
        return replace(self, tables=tables, beyond=beyond, samples=samples, bin_count=samples // 2)

    def with_block(self, length: float) -> TabulatedPlan:
        """Paths of blocks of a chosen length, s, at the same sampling interval."""
        return replace(self, block_length=length).with_step(self.step)

    def shortest(self, steps: int = 2) -> TabulatedPlan:
        """A block of few samples: enough to have the kernels compiled."""
        return replace(self, samples=32, blocks_per_path=1)

    @property
    def steps(self) -> int:
        """Counted samples of a path."""
        return self._counted_samples * self.blocks_per_path

    @property
    def fastest(self) -> float:
        """Natural frequency, rad/s."""
        return self.model.omega

    @property
    def relaxation(self) -> float:
        """Relaxation time of the energy, s."""
        return self.warm_up / WARM_UP_RELAXATIONS / 2.0

    @property
    def speeds(self) -> tuple[float, ...]:
        """The rms speed under the noise, without stops, m/s."""
        return (self.speed,)

    @property
    def excitation_known(self) -> bool:
        """Whether histories hold the excitation, which they do unless there are sines."""
        return not self.waves

    def record(self, seed: int, path: int) -> dict[str, NDArray[np.float64]]:
        """One path, by column."""
        record = np.zeros((self.steps, 1, 3))
        self.averages(seed, path, 1, record)
        return columns_of_one(self.model, record[:, 0])

    def sampled(self, step: float, duration: float) -> TabulatedPlan:
        """The plan for histories at an interval of at most `step`, of `duration` seconds."""
        plan = self
        length = duration + (plan.warm_up if _unrepeated(plan.model, plan.waves) else 0.0)
        if length > plan.block_length:
            plan = plan.with_block(length)
        plan = plan.with_step(min(step, plan.step))
        return replace(plan, counted=duration, blocks_per_path=1)

    def history_samples(self, duration: float) -> int:
        """Samples of a history."""
        return self.steps

    def record_size(self, samples: int) -> int:
        """Numbers that the record of one path takes."""
        return 3 * samples

    def histories(
        self, seed: int, first_path: int, paths: int, samples: int, log: Log | None = None
    ) -> Histories:
        """Records of the paths first_path, first_path + 1, ...: synthesised responses with
        impacts."""
        free = self.free_response(seed, first_path, paths, 0)
        # a path may be shorter than the block that is synthesised
        excitation = self._input_of(free)[: self.steps] if self.excitation_known else None
        record = np.zeros((self.steps, paths, 3))
        sums = Sums.zeros(paths, self.contacts).table
        self.add_impacts(free, self.warm_up_samples, self.steps, sums, record, log=log)
        lost = losses_of(self.model, self.layout, sums, 1.0)
        return histories_of_one(self.model, record, excitation, lost)

    def _input_of(self, free: Records, integrals: int = 0) -> Records:
        """The excitation of a synthesised response (samples, 2 paths): bin by bin, f = y / H."""
        bins = scipy.fft.rfft(free[:, 0::2], axis=0)
        w = 2.0 * math.pi / self.block_length * np.arange(1, len(bins))
        bins[0] = 0.0  # nothing is synthesised there
        bins[1:] *= (self._dynamic_stiffness(w) / (1j * w) ** integrals)[:, None]
        return np.asarray(scipy.fft.irfft(bins, self.samples, axis=0))

    def _dynamic_stiffness(self, w: NDArray[np.floating]) -> NDArray[np.complex128]:
        """1 / H at angular frequencies, 1/s^2: the excitation per unit of the free response."""
        omega, b = self.model.omega, self.model.damping_rate
        return np.asarray((omega - w) * (omega + w) + 1j * b * w)

    def drive(
        self, seed: int, path: int, samples: int, integrals: int
    ) -> NDArray[np.float64] | None:
        """The force of noise and sines (1, samples), N."""
        if integrals and (self.model.whites or self.model.filters):
            return None  # their densities reach down to frequency 0
        noise = replace(self, waves=()).free_response(seed, path, 1, 0)
        force = self._input_of(noise, integrals)[:samples, 0]
        for index, (omega, amplitude) in enumerate(self.waves):
            turn = self._turn(seed, path, 1, 0, index, omega)[:samples, 0]
            strength = amplitude * self._dynamic_stiffness(np.array([omega]))[0]
            force = force + (strength / (1j * omega) ** integrals * turn).real
        return self.model.unit_mass * force[None]

    def unbroken(self, duration: float) -> TabulatedPlan:
        """The plan with one block to a path, since the motion jumps from block to block."""
        return self.sampled(math.inf, duration)

    def averages(
        self,
        seed: int,
        first_path: int,
        paths: int,
        record: NDArray[np.float64] | None = None,
        extremes: NDArray[np.float64] | None = None,
        log: Log | None = None,
    ) -> NDArray[np.float64]:
        """Time averages (rows, paths) of the paths first_path, first_path + 1, ..., with positions
        from the mean position without stops.

        `extremes` (paths, EXTREMES) gets the extremes of each path, a `log` every impact.
        """
        underway = TabulatedPaths(self, seed, first_path, paths, record, extremes, log)
        underway.reach(underway.total)
        return underway.averages()

    def begin(self, seed: int, first_path: int, paths: int) -> TabulatedPaths:
        """The same paths before their first sample."""
        return TabulatedPaths(self, seed, first_path, paths)

    def cut(self, steps: int) -> TabulatedPlan:
        """The plan whose paths end after so many counted samples."""
        blocks = math.ceil(steps / self._counted_samples)
        return replace(self, counted=steps * self.step / blocks, blocks_per_path=blocks)

    def add_impacts(
        self,
        free: NDArray[np.float64],
        warm_up: int,
        counted: int,
        sums: NDArray[np.float64],
        record: NDArray[np.float64] | None = None,
        extremes: NDArray[np.float64] | None = None,
        log: Log | None = None,
    ) -> None:
        """Add impacts to free responses (samples, 2 paths): see `kernels.one_mass.run_response`."""
        state, peaks = self._before(free, warm_up)
        self._go_on(free, (-warm_up, counted), state, peaks, sums, record, extremes, log)

    def _before(
        self, free: NDArray[np.float64], warm_up: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
        """State and contacts of paths before their warm-up: they move as if there were no stops."""
        state = np.zeros((4, free.shape[1] // 2))
        before = free[len(free) - warm_up - 1]
        state[2], state[3] = before[0::2], self.model.omega * before[1::2]
        return state, np.zeros((free.shape[1] // 2, 2)) if self.contacts else None

    def _go_on(
        self,
        free: NDArray[np.float64],
        samples: tuple[int, int],
        state: NDArray[np.float64],
        peaks: NDArray[np.float64] | None,
        sums: NDArray[np.float64],
        record: NDArray[np.float64] | None,
        extremes: NDArray[np.float64] | None,
        log: Log | None,
    ) -> None:
        """Add impacts from one sample to before another one, to paths in a state."""
        first, last = samples
        run_response(
            free,
            Sampling(
                span=self.step,
                omega=self.model.omega,
                damping_rate=self.model.damping_rate,
                threshold=self.threshold,
                scale=math.sqrt(self._velocity_variance),
                first=first,
                last=last,
            ),
            self._stop(self.model.lower),
            self._stop(self.model.upper),
            self._compliant.for_kernel if self.contacts else None,
            state,
            peaks,
            sums,
            NO_RECORD if record is None else record,
            NO_EXTREMES if extremes is None else extremes,
            log or NO_LOG,
            stop_flag(),
        )

    def _stop(self, stop: Stop | None) -> RigidStop | None:
        """A stop for the kernel; None for none."""
        if stop is None:
            return None
        restitution = 0.0 if self.contacts else stop.law.restitution
        return RigidStop(stop.position - self.model.rest, restitution, -1.0)

    @cached_property
    def _compliant(self) -> StopsOfMass:
        """The stops where one is compliant, as the engine knows them."""
        return stops_of_mass(self.model, self.speed, self.step, shaken=True)

    @cached_property
    def _velocity_variance(self) -> float:
        """Velocity variance under the noise without stops, m^2/s^2."""
        omega, b = self.model.omega, self.model.damping_rate
        return response_moments(self.tables, omega, b).velocity + self.beyond

    @cached_property
    def bins(self) -> NDArray[np.float64]:
        """Displacement variances of the bins without stops, m^2."""
        omega, b = self.model.omega, self.model.damping_rate
        return _bin_variances(self.tables, omega, b, self.block_length, self.bin_count)[0]

    @cached_property
    def amplitudes(self) -> NDArray[np.float64]:
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

    def free_response(
        self, seed: int, first_path: int, paths: int, number: int
    ) -> NDArray[np.float64]:
        """y and y' / omega, in turn, of block `number` of each path, (samples, 2 paths)."""
        streams = np.empty((2, paths), np.uint64)
        # every (path, block) has its own stream, independent of the other paths
        for index in range(paths):
            first = (first_path + index) * MOST_BLOCKS + number
            seed_streams(np.uint64(seed), first, streams[:, index : index + 1])
        amplitudes = self.amplitudes
        bins = np.arange(1, len(amplitudes) + 1)
        relative = 2.0 * np.pi / self.block_length / self.model.omega * bins
        spectrum = np.empty((self.samples, paths), complex)
        fill_spectrum(streams, amplitudes, relative, spectrum.view(np.float64))
        free = scipy.fft.ifft(spectrum, axis=0, norm="forward", overwrite_x=True)
        if self.model.level is not None:
            gains = levels_of_block(
                self.model.level, seed, first_path, paths, number,
                samples=self.samples, step=self.step, before=self.warm_up_samples + 1,
            )  # fmt: skip
            free = self._modulated(free, gains)
        for index, (omega, amplitude) in enumerate(self.waves):
            free += self._wave(seed, first_path, paths, number, index, omega, amplitude)
        response: NDArray[np.float64] = free.view(np.float64)
        return response

    def _modulated(
        self, free: NDArray[np.complex128], gains: NDArray[np.float64]
    ) -> NDArray[np.complex128]:
        """A response y + i y' / w0 (samples, paths) whose excitation is larger by `gains`."""
        w = 2.0 * math.pi / self.block_length * np.arange(self.samples // 2 + 1)
        stiff = self._dynamic_stiffness(w)[:, None]
        force = scipy.fft.irfft(stiff * scipy.fft.rfft(free.real, axis=0), self.samples, axis=0)
        bins = scipy.fft.rfft(gains * force, axis=0) / stiff
        bins[-1] = 0.0
        place, speed = (
            scipy.fft.irfft(each, self.samples, axis=0)
            for each in (bins, (1j / self.model.omega * w)[:, None] * bins)
        )
        return np.asarray(place + 1j * speed)

    def _wave(
        self,
        seed: int,
        first_path: int,
        paths: int,
        number: int,
        index: int,
        omega: float,
        amplitude: complex,
    ) -> NDArray[np.complex128]:
        """y + i y' / w0 under a sine, (samples, paths)."""
        turn = self._turn(seed, first_path, paths, number, index, omega)
        free: NDArray[np.complex128] = (amplitude * turn).real + 1j * (
            1j * omega / self.model.omega * amplitude * turn
        ).real
        return free

    def _turn(
        self, seed: int, first_path: int, paths: int, number: int, index: int, omega: float
    ) -> NDArray[np.complex128]:
        """exp(i (omega t + phase)) of a sine, (samples, paths), with a random phase for each path.

        The samples of the warm-up stand at the end of a block, with times before 0.
        """
        streams = np.empty((2, paths), np.uint64)
        for path in range(paths):
            # phases use the last streams of a path, which no block reaches
            stream = (first_path + path + 1) * MOST_BLOCKS - 1 - index
            seed_streams(np.uint64(seed), stream, streams[:, path : path + 1])
        first, second = np.empty((2, 1, paths))
        normal_rows(streams[0], streams[1], first, second)
        sample = np.arange(self.samples)
        sample[self.samples - self.warm_up_samples - 1 :] -= self.samples
        time = self.step * (sample + number * self._counted_samples)
        return np.asarray(np.exp(1j * (omega * time[:, None] + np.arctan2(first, second))))


class TabulatedPaths(Underway):
    """Paths of a `TabulatedPlan` under way, a block after the other; see
    `TabulatedPlan.averages`."""

    def __init__(
        self, plan: TabulatedPlan, seed: int, first_path: int, paths: int,
        record: Records | None = None, extremes: NDArray[np.float64] | None = None,
        log: Log | None = None,
    ) -> None:  # fmt: skip
        warm_up, self.each = plan.warm_up_samples, plan._counted_samples
        super().__init__(warm_up + self.each, plan.blocks_per_path, warm_up)
        self.plan, self.which = plan, (seed, first_path, paths)
        self.record, self.extremes, self.log = record, extremes, log
        self.sums = Sums.zeros(paths, plan.contacts).table
        self.of_block = np.zeros_like(self.sums)
        self.controls = np.zeros((len(plan._controls), paths))
        self.sides = np.array([(s.side, s.position - plan.model.rest) for s in plan.model.stops])

    def advance(self, segment: int, first: int, last: int) -> None:
        """Simulate the samples first, first + 1, ... before `last` of a block."""
        plan, before = self.plan, segment * self.each
        if first == 0:
            self.sums += self.of_block
            self.of_block[:] = 0.0
            self.free = plan.free_response(*self.which, segment)
            self.state, self.peaks = plan._before(self.free, self.burn_in)
        samples = first - self.burn_in, last - self.burn_in
        if len(self.controls):
            add_free_motion(self.free, max(samples[0], 0), samples[1], self.sides, self.controls)
        record = None if self.record is None else self.record[before : before + self.each]
        log = self.log and self.log._replace(start=before * plan.step)
        plan._go_on(
            self.free, samples, self.state, self.peaks, self.of_block, record, self.extremes, log
        )

    def averages(self) -> NDArray[np.float64]:
        """Time averages over the counted samples so far."""
        sums, controls, counted = self.sums + self.of_block, self.controls.copy(), self.counted
        sums[:N_LOWER] /= counted
        sums[N_LOWER:] /= counted * self.plan.step
        controls[:2] /= counted
        controls[2:] /= counted * self.plan.step
        return np.concatenate([sums, controls])


def expected_of_free_motion(
    variances: NDArray[np.float64], relative: float, samples: int, step: float,
    beyond: Mapping[str, float],
) -> dict[str, float]:  # fmt: skip
    """Expected averages of `add_free_motion`, by name.

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


def _unrepeated(model: Model, waves: tuple[tuple[float, complex], ...]) -> bool:
    """Whether something in a block does not repeat, a sine or a level: the warm-up, which is the
    end of the block, must then not be counted as well."""
    return bool(waves) or model.level is not None


def plan_tabulated(model: Model, threshold: float | None, duration: float | None) -> TabulatedPlan:
    """Choose sampling and lengths for an oscillator with tabulated noise among its excitations."""
    unmet = []
    if model.omega == 0.0:
        unmet.append("tabulated noise needs structure.stiffness > 0, got 0")
    if model.damping_rate == 0.0:
        unmet.append("tabulated noise needs structure.damping (or zeta) > 0, got 0")
    if unmet:
        raise NotApplicable("simulate", unmet)
    omega, b = model.omega, model.damping_rate
    tables, beyond, waves = _as_tables(model)
    half = b / 2.0
    slowest = half - math.sqrt(max(half * half - omega * omega, 0.0))
    relaxation = 1.0 / max(slowest, omega**2 / b / 2.0 if half > omega else half)
    length = _block_length(tables, omega, b, BLOCK_RELAXATIONS * max(relaxation, 1.0 / omega))
    longest = length - (WARM_UP_RELAXATIONS * relaxation if _unrepeated(model, waves) else 0.0)
    counted, blocks = longest, 1
    if duration is not None:
        if duration > (MOST_BLOCKS // 2 - len(waves)) * longest:
            raise NotApplicable(
                "simulate",
                [
                    f"a path of {duration:.3g} s needs more than {MOST_BLOCKS // 2} blocks of "
                    f"{length:.3g} s; give a shorter duration and more paths"
                ],
            )
        blocks = math.ceil(duration / longest)
        counted = duration / blocks
    highest = max(float(table.frequency_hz[-1]) for table in tables)
    fastest = max([omega, *(frequency for frequency, _ in waves)])
    waving = sum(frequency**2 * abs(amplitude) ** 2 / 2.0 for frequency, amplitude in waves)
    speed = math.sqrt(response_moments(tables, omega, b).velocity + beyond + waving)
    rate = max(SAMPLES_PER_PERIOD * fastest / (2.0 * math.pi), _rate_for_gap(model, speed))
    if beyond and not model.rigid:
        # a long contact responds to frequencies that are folded at a lower rate: at half this rate,
        # E v^2 of a mass on a preloaded stop is 5 % too high
        rate = max(rate, 2.0 * float(tables[-1].frequency_hz[-1]))
    if rate * length > MOST_SAMPLES:
        raise NotApplicable("simulate", [_too_many(rate * length)])
    on_stops = _on_stops(model, speed)
    rate = max(rate, rate_on_stops(tables, on_stops, MOST_SAMPLES / length))
    most = max(min(2.2 * highest * length, MOST_SAMPLES), rate * length)
    bin_count = math.ceil(most / 2.0) + 1
    _, velocities = _bin_variances(tables, omega, b, length, bin_count)
    kept = np.cumsum(velocities)
    enough = 1 + int(np.searchsorted(kept, (1.0 - LARGEST_LOSS) * kept[-1]))
    total = response_moments(tables, omega, b).velocity
    if kept[-1] < (1.0 - LARGEST_LOSS) * total:
        raise NotApplicable("simulate", [_too_many(2.2 * highest * length)])
    samples = _even_fast_length(max(rate * length, 2.0 * (enough + 1)))
    if too_stiff := _too_stiff(model, speed, length / samples):
        raise NotApplicable("simulate", too_stiff)
    if threshold is None:
        threshold = threshold_of(model, speed)
    return TabulatedPlan(
        model=model,
        tables=tables,
        beyond=beyond,
        waves=waves,
        samples=samples,
        block_length=length,
        counted=counted,
        blocks_per_path=blocks,
        warm_up=WARM_UP_RELAXATIONS * relaxation,
        threshold=threshold,
        bin_count=bin_count,
    )


def _even_fast_length(samples: float) -> int:
    """An even number of samples whose half has a fast Fourier transform.

    Rounding cannot change a number that follows from its own step.
    """
    half = max(samples, 32.0) / 2.0
    return 2 * int(scipy.fft.next_fast_len(math.ceil(half * (1.0 - ROUNDING))))


def _too_many(samples: float) -> str:
    return (
        f"a block needs {samples:.2g} samples, at most {MOST_SAMPLES} are made: the fastest motion "
        "(table, or flight between the stops) and the slowest (decay of the resonance) are too "
        "far apart"
    )


def _rate_for_gap(model: Model, speed: float) -> float:
    """Samples per second for a mass between close stops at its rms speed without them; deflections
    of the stops are added to the gap."""
    if len(model.stops) < 2:
        return 0.0
    gap = model.upper_position - model.lower_position
    for stop in model.stops_per_unit_mass:
        if isinstance(stop.law, CompliantLaw):
            gap += stop.law.impact(speed, 1.0).peak_deflection
    return speed / (GAP_PER_SAMPLE * gap)


def _on_stops(model: Model, speed: float) -> list[float]:
    """Frequency (rad/s) of the mass on each stop onto which its load presses it; infinite on a
    rigid one."""
    return [
        math.hypot(rate(stop.law.compiled(), 0.0, speed, push), model.omega)
        if isinstance(stop.law, CompliantLaw)
        else math.inf
        for stop, push in zip(model.stops_per_unit_mass, pressing_onto(model), strict=True)
        if push > 0.0
    ]


def rate_on_stops(tables: Sequence[Table], on_stops: Sequence[float], most: float) -> float:
    """Samples per second, at most `most`, for masses that have the frequencies `on_stops` (rad/s)
    on stops onto which they are pressed.

    The structure filters the noise. A mass on a stop is shaken by the noise itself, as far as an
    oscillator on the stop follows it.
    """
    bands = [band_of_velocity(tables, omega, LARGEST_LOSS) for omega in on_stops]
    return min(SAMPLES_ON_STOP * max(bands, default=0.0), most)


def _too_stiff(model: Model, speed: float, step: float) -> list[str]:
    """Return a sentence for each stop that is too stiff to be followed while a mass stays on it.

    A mass stays where it is pressed onto the stop, or comes to rest there.
    """
    found = []
    for stop, push in zip(model.stops_per_unit_mass, pressing_onto(model), strict=True):
        if not isinstance(stop.law, CompliantLaw):
            continue
        if push <= 0.0 and stop.law.restitution > COLLAPSE_RESTITUTION:
            continue
        fastest = rate(stop.law.compiled(), 0.0, speed, max(push, 0.0))
        needed = step * math.hypot(fastest, model.omega, model.damping_rate) / ANGLE_OF_ONE_MASS
        if needed > MOST_SUB_STEPS:
            found.append(
                f"a mass that stays on a stop this stiff needs {needed:.2g} sub-steps per sample, "
                f"at most {MOST_SUB_STEPS} are made; take a rigid stop (law.kind = 'restitution')"
            )
    return found


def _as_tables(
    model: Model,
) -> tuple[tuple[Table, ...], float, tuple[tuple[float, complex], ...]]:
    """All noise as tables, with white noise as the last one; the velocity variance that white noise
    adds above its table; and the responses to the sines."""
    omega, b = model.omega, model.damping_rate
    tables, waves, beyond = list(model.acceleration_tables), [], 0.0
    for signal in model.signals:
        share = float(signal.direction[0]) / model.unit_mass
        if signal.amplitude:
            gain = 1.0 / (omega**2 - signal.omega**2 + 1j * b * signal.omega)
            waves.append((signal.omega, share * signal.amplitude * gain))
        else:
            tables.append(_filtered(signal, omega).scaled(share**2))
    if model.intensity > 0.0:
        natural = omega / (2.0 * math.pi)
        # of the velocity variance S0 / 2b, b / (pi^2 f) lies beyond a frequency f >> omega, b
        highest = max(b / (math.pi**2 * WHITE_LOSS), SAMPLES_PER_PERIOD * natural)
        flat = Table(
            frequency_hz=np.array([LOWEST_FREQUENCY * natural, highest]),
            density=np.full(2, density_from_intensity(model.intensity)),
        )
        tables.append(flat)
        beyond = _white_beyond(flat, omega, b)
    return tuple(tables), beyond, tuple(waves)


def _longer(flat: Table, highest: float) -> Table:
    """The table of white noise, extended to `highest` hertz if it ends below."""
    low, high = flat.frequency_hz
    return Table(frequency_hz=np.array([low, max(high, highest)]), density=flat.density)


def _white_beyond(flat: Table, omega: float, b: float) -> float:
    """Velocity variance by white noise above its table: S0 / 2b less the variance by the table."""
    theta = intensity_from_density(float(flat.density[0])) / (2.0 * b)
    return max(theta - response_moments([flat], omega, b).velocity, 0.0)


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


def _block_length(tables: tuple[Table, ...], omega: float, b: float, shortest: float) -> float:
    """Length of a block in s whose bins are narrow enough for the slowest part of the table.

    The velocity variance from the middle frequencies of the bins must agree with the integral.
    """
    length = shortest
    for _ in range(MOST_DOUBLINGS):
        count = math.ceil(min(omega / math.pi * length, MOST_SAMPLES / 2)) + 2
        variances, velocities = _bin_variances(tables, omega, b, length, count)
        omega2 = (2.0 * np.pi / length * np.arange(1, count)) ** 2
        total = response_moments(tables, omega, b).velocity
        if abs(float(np.sum(omega2 * variances - velocities))) <= BIN_ERROR * total:
            return length
        length *= 2.0
    raise NotApplicable(
        "simulate", ["the table reaches down to frequencies too far below the resonance"]
    )


AT_ONCE = 2**14
"""Bins whose variances are found at once: in the cache of a processor, and a budget may end between
two such parts."""


def _bin_variances(
    tables: tuple[Table, ...], omega: float, damping_rate: float, length: float, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacement and velocity variances of the bins 1 ... count - 1, [(k -+ 1/2)] / length.

    The variance below the first bin is added to it. Bins are cut at the breakpoints of the tables,
    so that a jump of the density inside a bin causes no error.
    """
    nodes, weights = gauss_legendre(6)
    edges = (np.arange(count) + 0.5) / length
    edges[0] = 1e-6 / length
    variances, velocities = np.zeros((2, count - 1))
    for table in tables:
        cuts = np.unique(np.concatenate([edges, table.frequency_hz]))
        cuts = cuts[(cuts >= edges[0]) & (cuts <= edges[-1])]
        for first in range(0, len(cuts) - 1, AT_ONCE):
            ends = cuts[first : first + AT_ONCE + 1]
            half, middle = np.diff(ends) / 2.0, (ends[1:] + ends[:-1]) / 2.0
            f = middle[:, None] + half[:, None] * nodes
            density = squared_gain(f, omega, damping_rate) * table(f)
            owner = np.clip(np.searchsorted(edges, middle) - 1, 0, count - 2)
            np.add.at(variances, owner, half * (density @ weights))
            np.add.at(velocities, owner, half * ((density * (2.0 * np.pi * f) ** 2) @ weights))
    return variances, velocities
