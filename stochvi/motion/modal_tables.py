"""Structures of any number of modes under synthesised records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import scipy
from numpy.typing import NDArray

from stochvi.mathematics.numerics import Matrix, Vector, Waves
from stochvi.mathematics.spectra import (
    beyond,
    bin_amplitudes,
    bin_variances,
    covariance,
    damping_at,
    eigenvalues,
    square_root,
)
from stochvi.model.coverage import Settling, slowest_of
from stochvi.model.modal import UNSTABLE, ModalForm
from stochvi.model.model import UPPER, Model, Pair
from stochvi.model.scales import Scales, scales_of
from stochvi.motion.kernels.random_numbers import seed_streams
from stochvi.motion.modal import (
    INDEPENDENT,
    ModalPlan,
    Which,
    _second_moments,
    _squares,
    basis,
    check_stiffness,
    rate_of_contact,
)
from stochvi.motion.plan import Key, gap_of
from stochvi.motion.synthesis import (
    BIN_ERROR,
    BLOCK_RELAXATIONS,
    GAP_PER_SAMPLE,
    LARGEST_BLOCK,
    LARGEST_LOSS,
    MOST_BLOCKS,
    MOST_DOUBLINGS,
    MOST_SAMPLES,
    SAMPLES_PER_PERIOD,
    WARM_UP_RELAXATIONS,
    BlockForce,
    _even_fast_length,
    expected_of_free_motion,
    folded,
    force_of,
    levels_of_block,
    rate_on_stops,
    synthesised,
)
from stochvi.results.errors import NotApplicable

# ------------------------------------------------------------------------------
# Tabulated noise on structures of several modes: the plan, and a block of paths.
#
# The response to the tables without stops is synthesised: a periodic Gaussian signal of all modes
# at once. It is a sum over bins of width 1 / length with common coefficients, each mode through its
# own H (see `spectra.bin_amplitudes`). The changes by impacts and contacts are added step by step,
# as is the response to white noise (kicks) and signals (states). These are exact over a step.
# ------------------------------------------------------------------------------


LINE_SECONDS, PAIR_SECONDS = 1.5e-4, 1.5e-5
"""Seconds that a line of a table adds to a plan with stops, once and for each pair of the
coordinates (measured: 0.7e-6 s at each of 6 nodes for 2 coordinates, 18e-6 s for 20; a plan renews
its springs in the place of stops up to 40 times)."""

LINES_OF_A_MODE = 15.0
"""Lines of a table that take as long as the panels towards one resonance."""

RENEWALS = 16.0
"""How much longer a plan with stops takes than one without, which has no springs to renew
(measured)."""

MOST_BLOCK_SAMPLES = 2**22
"""Largest number of samples of all modes and paths that are synthesised together, 64 MB. A step of
32 paths costs hardly more than one of 8, which weighs more than that the samples of 8 stay in the
caches: on an AMD EPYC, six modes with eight pairs take 0.6 s of one core for an hour of motion with
32 paths, and 1.4 s with 8."""

MOST_STIFFNESSES = 2**20
"""Largest number of elements of dynamic stiffnesses that are made at once, 16 MB."""

SAMPLES_OF_MODULATION = 4.0
"""Samples in a period of the highest frequency of a modulation that is tabulated noise: at half of
them, which show the bias of the step, the table is still whole."""

CANCELLED = 1e-18
"""Variance of a sum of modal motions, relative to the square of the sum of their standard
deviations, up to which it is rounding."""


@dataclass(frozen=True, kw_only=True)
class ModalTablesPlan(ModalPlan):
    """Sampling and lengths for a structure of any kind under tabulated noise, to which white noise
    and signals may be added (SI units). Each of the `blocks` of a path has its own `burn_in`."""

    samples: int
    block_length: float
    blocks: int

    @property
    def method(self) -> str:
        """Name of the scheme, for the assumptions of a response."""
        return "response-domain synthesis in modal coordinates"

    @cached_property
    def _pulls(self) -> Matrix | None:
        """See `ModalPlan`; None with branches, whose forces are not synthesised."""
        return None if self.modes.branches is not None else super()._pulls

    @property
    def block(self) -> int:
        """Number of paths that are synthesised together: a power of two, as many as fill the lanes
        of a step unless their samples take too much memory."""
        room = MOST_BLOCK_SAMPLES // (self.samples * self.modes.size)
        return 1 << (max(1, min(LARGEST_BLOCK, room)).bit_length() - 1)

    @property
    def counted_of_block(self) -> int:
        # a level jumps before the sample from which the warm-up begins
        most = self.samples - (1 + self.burn_in_steps if self.model.level is not None else 0)
        return max(1, min(most, round(self.duration / self.blocks / self.step)))

    @property
    def _stride(self) -> int:
        # over all samples of a block the mean of one mode without stops is 0
        return 1 if self.modes.size == 1 else super()._stride

    @property
    def steps(self) -> int:
        """Counted samples of a path."""
        return self.counted_of_block * self.blocks

    @property
    def burn_in_steps(self) -> int:
        return min(self.samples - 1, math.ceil(self.burn_in / self.step))

    @property
    def steps_per_path(self) -> int:
        """Number of samples of a path, warm-up included."""
        return self.steps + self.burn_in_steps * self.blocks

    def with_step(self, step: float) -> Self:
        """Paths at a chosen sampling interval, s; bins that both plans have keep their
        amplitudes."""
        self.check_step(step)
        return self._with_samples(_even_fast_length(self.block_length / step))

    def with_block(self, length: float) -> Self:
        """Paths of one block of `length` seconds, at about the same sampling interval."""
        return replace(self, block_length=length, blocks=1).with_step(self.step)

    def coarser(self) -> ModalTablesPlan:
        """The same paths at half the sampling rate."""
        return self._with_samples(2 * (self.samples // 4))

    settling = 0
    """A record has no samples to leave out: the burn-in of a block is not recorded."""

    def sampled(self, step: float, duration: float) -> Self:
        """The plan for histories of `duration` seconds at an interval of at most `step`, s.

        Its one block is long enough that no part of the burn-in repeats in the record.
        """
        length = max(self.block_length, duration + self.burn_in)
        plan = self.with_block(length).with_step(min(step, self.step))
        return replace(plan, duration=duration)

    def unbroken(self, duration: float) -> Self:
        """The plan with one block to a path, since the motion jumps from block to block."""
        return self.sampled(math.inf, duration)

    def history_samples(self, duration: float) -> int:
        """Samples of a history."""
        return self.steps

    def record_size(self, samples: int) -> int:
        """Number of floats in the record of one path, or in its synthesised response if that is
        larger."""
        return self.record_width * max(samples, self.samples)

    def _with_samples(self, samples: int) -> Self:
        return replace(self, samples=samples, step=self.block_length / samples)

    def shortest(self, steps: int = 2) -> Self:
        """A few samples: enough to have the kernels compiled."""
        return replace(
            self, samples=32, block_length=32 * self.step, blocks=1,
            burn_in=self.step, duration=2.0 * self.step,
        )  # fmt: skip

    @property
    def excitation_known(self) -> bool:
        """Whether histories hold the excitation: that of one mass which is synthesised as a
        whole."""
        return self.modes.size == 1 and not (self._unknown_noise or self.modes.sines)

    def excitation(self, which: Which, free: NDArray[np.float64] | None, samples: int) -> Matrix:
        """Force on one mass over that mass in the last block, (paths, samples)."""
        assert free is not None
        return np.asarray(self.modes.shapes[0, 0] * self._forces_of(free)[:, :samples, 0])

    def cut(self, steps: int) -> Self:
        """The plan whose paths end after so many counted samples."""
        blocks = math.ceil(steps / self.counted_of_block)
        return replace(self, duration=steps * self.step, blocks=blocks)

    @property
    def _heights(self) -> dict[str, int]:
        """Number of rows by what they hold; those of passages are three of the lower stop of each
        pair, and three of the upper one."""
        n = self.modes.size
        return super()._heights | {"free": n * (n + 2), "passages": 6 * len(self._ways)}

    @property
    def _controls(self) -> dict[Key, float]:
        """Keys of what `_control_rows` gives, and expected values: of noise, then of the motion
        without stops."""
        return super()._controls | self._expected

    @cached_property
    def _expected(self) -> dict[Key, float]:
        """Averages over the motion without stops by key, and their expected values."""
        relative = 2.0 * math.pi / self.block_length
        known: dict[Key, float] = {}
        for owner, row, pair in self._followed:
            variances = np.sum(np.abs(self._waves_of(row)) ** 2, axis=1)
            stops, rest = () if pair is None else pair.stops, float(row @ self.modes.rest)
            beyond = {stop.name: stop.side * (stop.position - rest) for stop in stops}
            found = expected_of_free_motion(variances, relative, self.samples, self.step, beyond)
            kept = list(found)[0 if _has_moments(pair) else 2 :]
            known |= {(owner, name): found[name] for name in kept}
        return known

    @cached_property
    def _followed(self) -> list[tuple[str, Vector, Pair | None]]:
        """Owners and rows (n,) of the displacements row . q whose motion without stops is averaged,
        with the pair if it is a gap whose stops no table moves; none without stops, where nothing
        is left to simulate, nor where the level varies, or anything is drawn for a whole record."""
        modes, pairs = self.modes, self.model.pairs
        if not self.model.stops or self.model.level is not None or self.model.drawn:
            return []
        found: list[tuple[str, Vector, Pair | None]] = [
            (gap_of(pair), row, pair)
            for pair, row in zip(pairs, modes.gaps, strict=True)
            if all(each.sample is None for each in pair.moved)
        ]
        shapes = self.model.output_rows @ modes.shapes
        found += [(name, row, None) for name, row in zip(self.model.outputs, shapes, strict=True)]
        deviations = np.sqrt(np.sum(np.abs(self.amplitudes) ** 2, axis=(0, 2)))

        def moves(row: Vector) -> bool:
            variance = float(np.sum(np.abs(self._waves_of(row)) ** 2))
            return variance > CANCELLED * float(np.abs(row) @ deviations) ** 2

        return [each for each in found if moves(each[1])]

    def _waves_of(self, row: Vector) -> NDArray[np.complex128]:
        """Amplitudes (bins, tables) of the displacement row . q without stops, m."""
        return np.asarray(np.einsum("m,bmt->bt", row, self.amplitudes))

    def _control_rows(self, averages: Matrix) -> Matrix:
        """The rows of `_controls` (rows, paths), from the averages of a kernel."""
        free, passages = (averages[self._rows[what]] for what in ("free", "passages"))
        displacements, velocities = _second_moments(free, self.modes.size)
        passages = passages.reshape(-1, 2, 3, averages.shape[1])
        of_pair = dict(zip(self.model.pairs, passages, strict=False))
        rows = [super()._control_rows(averages)]
        for _, row, pair in self._followed:
            if _has_moments(pair):
                rows += [_squares(row[None], each) for each in (displacements, velocities)]
            if pair is not None:
                rows += [of_pair[pair][int(stop.side == UPPER)] for stop in pair.stops]
        return np.concatenate(rows)

    def at_whole_periods(self, period: float) -> Self:
        """The plan with blocks of whole periods, s, of a whole number of samples each, at about the
        same sampling interval."""
        samples = scipy.fft.next_fast_len(math.ceil(period / self.step))
        periods = scipy.fft.next_fast_len(2 * math.ceil(self.block_length / period / 2.0))
        periods += periods % 2
        return replace(
            self, block_length=periods * period, samples=periods * samples, step=period / samples
        )

    def drive(self, seed: int, path: int, samples: int, integrals: int) -> Matrix | None:
        """Forces of tables and sines (coordinates, samples), N; of other noise they are not
        kept."""
        of_sines = super().drive(seed, path, samples, integrals)
        if of_sines is None:
            return None
        (force,) = self._forces_of(self.free_response(seed, path, 1, 0), integrals)
        return np.asarray(self.model.mass @ self.modes.shapes @ force[:samples].T + of_sines)

    def _forces_of(self, free: NDArray[np.float64], integrals: int = 0) -> NDArray[np.float64]:
        """Modal forces (paths, samples, modes) that move a free response, integrated over time:
        bin by bin (omega^2 - w^2 + i w B) q."""
        modes = self.modes
        bins = scipy.fft.rfft(free[:, : modes.size, 0::2].transpose(2, 0, 1), axis=1)
        w = self._bin_frequency * np.arange(1, bins.shape[1])[:, None]
        forces = np.zeros_like(bins)
        if not integrals:
            forces[:, 0] = modes.squares * bins[:, 0]
        forces[:, 1:] = (modes.squares - w**2) * bins[:, 1:]
        forces[:, 1:] += 1j * w * np.einsum("pbm,km->pbk", bins[:, 1:], modes.damping)
        if modes.branches is not None:
            rows, rates = modes.branches.rows, modes.branches.forces(w[:, 0].astype(float))
            forces[:, 1:] += 1j * w * (((bins[:, 1:] @ rows.T) * rates) @ rows)
        forces[:, 1:] /= (1j * w) ** integrals
        return np.asarray(scipy.fft.irfft(forces, self.samples, axis=1))

    @cached_property
    def _root(self) -> Matrix:
        """A square root of the covariance of the signals alone: the synthesised response is added
        to displacements and velocities, which begin at zero."""
        first, covariance = self.modes.moving, np.zeros_like(self.law.covariance)
        covariance[first:, first:] = self.law.covariance[first:, first:]
        root: Matrix = square_root(covariance, INDEPENDENT)
        return root

    @cached_property
    def _half_kick(self) -> tuple[Matrix, Matrix]:
        """Decay and noise of half a kick for the moments; here the decay is 1, as the kernel has
        applied it."""
        return np.eye(self.modes.size), self._kick(self.step / 2.0)[1]

    @property
    def scale(self) -> float:
        """Frequency in rad/s by which velocities are divided to be synthesised together with
        displacements."""
        return max(self.modes.fastest, 2.0 * math.pi / self.block_length)

    @cached_property
    def amplitudes(self) -> Waves:
        """B of each synthesised bin, (bins, modes, tables), the last quarter scaled up."""
        count = self.samples // 2
        found, velocities = [], np.zeros(self.modes.size)
        if not self.modes.tables:
            return np.zeros((count - 1, self.modes.size, 0), complex)
        for table, force in self.modes.tables:
            matrices = np.diag(self.modes.squares), self.modes.dynamic
            found.append(bin_amplitudes(table, force, *matrices, self.block_length, count)[0])
            whole = covariance([(table, force)], *matrices)
            velocities += np.diag(whole)[self.modes.size : 2 * self.modes.size]
        return folded(np.stack(found, axis=2), velocities, self.block_length)

    @property
    def _all_amplitudes(self) -> Waves:
        """`amplitudes` of the modes, then those of the modulations that are tabulated noise, each
        by its own table: (bins, modes and modulations, tables)."""
        own, sampled = self.amplitudes, self.model.sampled_modulations
        bins, modes, tables = own.shape
        found = np.zeros((bins, modes + len(sampled), tables + len(sampled)), complex)
        found[:, :modes, :tables] = own
        for k, table in enumerate(sampled):
            variances = bin_variances(table, self.block_length, bins + 1)
            found[:, modes + k, tables + k] = np.sqrt(variances)
        return found

    def streams(self, seed: int, first_path: int, paths: int) -> NDArray[np.uint64]:
        """Random streams (2, paths) of kicks and states, the last of each path: no block reaches
        them."""
        return streams_of_block(seed, first_path, paths, MOST_BLOCKS - 1)

    def free_response(
        self, seed: int, first_path: int, paths: int, number: int
    ) -> NDArray[np.float64]:
        """Modal displacements and velocities over `scale`, in turn, without stops, of block
        `number` of each path, and behind them the modulations that are tabulated noise: (samples,
        modes and modulations, 2 paths)."""
        streams = streams_of_block(seed, first_path, paths, number)
        free = synthesised(
            self._all_amplitudes, streams, self.samples, self.block_length, self.scale
        )
        moved = free[:, : self.modes.size]
        if self.model.level is not None:
            gains = levels_of_block(
                self.model.level, seed, first_path, paths, number,
                samples=self.samples, step=self.step, before=self.burn_in_steps + 1,
            )  # fmt: skip
            moved[:] = self._modulated(moved, gains)
        if self.model.drawn:
            moved += self._shaken_by_drawn(seed, first_path, paths, number)
        response: NDArray[np.float64] = free.view(np.float64)
        return response

    def _shaken_by_drawn(self, seed: int, first_path: int, paths: int, number: int) -> Waves:
        """The response q + i q' / scale (samples, modes, paths) to what is drawn for a whole
        record."""
        total = np.zeros((self.samples // 2 + 1, self.modes.size, paths), complex)
        for order, (force, (_, direction)) in enumerate(
            zip(self._drawn_forces, self.model.drawn, strict=True)
        ):
            bins = force.bins((seed, order), first_path, paths, number)
            total += (self.modes.shapes.T @ direction)[:, None] * bins[:, None, :]
        return self._response_to(total)

    @cached_property
    def _drawn_forces(self) -> list[BlockForce]:
        """What draws the forces of a block."""
        return [force_of(each, self.samples, self.step) for each, _ in self.model.drawn]

    def _modulated(self, free: Waves, gains: Matrix) -> Waves:
        """A response q + i q' / scale (samples, modes, paths) whose excitation is larger by
        `gains`."""
        bins = scipy.fft.rfft(free.real, axis=0)
        for first, last in self._parts(len(bins)):
            bins[first:last] = self._stiffness(first, last) @ bins[first:last]
        return self._response_to(
            scipy.fft.rfft(gains[:, None, :] * scipy.fft.irfft(bins, self.samples, axis=0), axis=0)
        )

    def _response_to(self, bins: Waves) -> Waves:
        """The response q + i q' / scale (samples, modes, paths) to modal forces, from their
        transform (bins, modes, paths), which is replaced."""
        held = self.modes.squares > 0.0  # a loose mode has no place of its own
        bins[0, held] /= self.modes.squares[held, None]
        bins[0, ~held] = bins[-1] = 0.0
        for first, last in self._parts(len(bins)):
            bins[first:last] = np.linalg.solve(self._stiffness(first, last), bins[first:last])
        w = self._bin_frequency * np.arange(len(bins))
        place, speed = (
            scipy.fft.irfft(each, self.samples, axis=0)
            for each in (bins, (1j / self.scale * w)[:, None, None] * bins)
        )
        return np.asarray(place + 1j * speed)

    def _parts(self, bins: int) -> list[tuple[int, int]]:
        """First and last bins of parts, from 1 on, whose stiffnesses are made at once."""
        firsts = range(1, bins, max(1, MOST_STIFFNESSES // self.modes.size**2))
        return list(zip(firsts, [*firsts[1:], bins], strict=True))

    @property
    def _bin_frequency(self) -> float:
        """Distance of two bins, rad/s."""
        return 2.0 * math.pi / self.block_length

    def _stiffness(self, first: int, last: int) -> Waves:
        """Dynamic stiffness of the modes in the bins first, first + 1, ... before `last`."""
        w = self._bin_frequency * np.arange(first, last)[:, None, None]
        squares = np.diag(self.modes.squares)
        damping = damping_at(self.modes.dynamic, w[:, 0, 0].astype(float))
        return np.asarray(squares - w**2 * np.eye(len(squares)) + 1j * w * damping)


def _has_moments(pair: Pair | None) -> bool:
    """Whether the moments of a displacement are followed: those of the gap of one coordinate are
    those of the coordinate."""
    return pair is None or pair.relative


def streams_of_block(seed: int, first_path: int, paths: int, number: int) -> NDArray[np.uint64]:
    """The random stream `number` of each path, independent of the streams of other paths."""
    streams = np.empty((2, paths), np.uint64)
    seed_streams(seed, first_path * MOST_BLOCKS + number, streams, MOST_BLOCKS)
    return streams


def seconds_of_plan(model: Model) -> float:
    """Seconds that the plan of several coordinates under tables takes, roughly; 0 for others."""
    if len(model.coordinates) == 1:
        return 0.0
    n = len(model.coordinates)
    lines = sum(len(table.frequency_hz) + LINES_OF_A_MODE * n for table, _ in model.tables)
    seconds = lines * (LINE_SECONDS + PAIR_SECONDS * n**2)
    return seconds if model.pairs else seconds / RENEWALS


def plan_modal_tables(
    model: Model, threshold: float | Mapping[str, float] | None, duration: float | None,
    scales: Scales = scales_of, settling: Settling = slowest_of,
) -> ModalTablesPlan:  # fmt: skip
    """Choose sampling and lengths for a structure of any kind with tabulated noise, by the `scales`
    of its motion.

    Raises
    ------
    NotApplicable
        Where a mode has no damping of its own, there is no stationary state, or times lie too far
        apart.
    """
    # Gaussian noise of their density stands for what is drawn in the choice of steps and lengths
    planned = model.with_tables_of_drawn
    known = basis(planned, threshold, duration, scales, settling) | {"model": model}
    warm_up = 2.0 * WARM_UP_RELAXATIONS * known["law"].slowest
    length, samples = _of_block(planned, known, warm_up)
    # a level does not repeat with the block, of which the warm-up is the end
    longest = length - (warm_up if model.level is not None else 0.0)
    blocks = 1 if duration is None else math.ceil(duration / longest)
    if blocks >= MOST_BLOCKS // 2:
        raise NotApplicable(
            "simulate",
            f"a path of {duration:.3g} s needs more than {MOST_BLOCKS // 2} blocks of "
            f"{length:.3g} s; give a shorter duration and more paths",
        )
    plan = ModalTablesPlan(**known, samples=samples, block_length=length, blocks=blocks)
    plan = replace(
        plan,
        step=length / samples,
        burn_in=warm_up,
        duration=longest if duration is None else duration,
    )
    check_stiffness(plan)
    return plan


SHORTER = (1.0, 0.5, 0.25)
"""Lengths of a block, relative to the usual one, where that would have too many samples. Variances
of bins are exact at any length; between shorter blocks less of the motion is remembered."""


def _of_block(model: Model, known: dict[str, Any], warm_up: float) -> tuple[float, int]:
    """Length, s, and number of samples of a block."""
    modes, usual = model.modal, _resonance_length(model.modal)
    rate, on_stops = 1.0 / _interval(model, known), _on_stops(model, known)
    for share in SHORTER:
        length = _block_length(modes, max(share * usual, 2.0 * warm_up))
        try:
            return length, _samples(modes, length, rate, on_stops)
        except NotApplicable:
            if share == SHORTER[-1]:
                raise
    raise AssertionError


def _interval(model: Model, known: dict[str, Any]) -> float:
    """Longest time between samples, s: a limit each by the steps of states, a period, the way to a
    stop."""
    fastest = model.modal.fastest / (2.0 * math.pi)
    if fastest == 0.0:
        # a loose mass follows the whole band
        tables = [*(table for table, _ in model.tables), *model.sampled_modulations]
        fastest = max(float(table.frequency_hz[-1]) for table in tables)
    limits: list[float] = [known["step"], 1.0 / fastest / SAMPLES_PER_PERIOD]
    limits += [
        1.0 / float(table.frequency_hz[-1]) / SAMPLES_OF_MODULATION
        for table in model.sampled_modulations
    ]
    for pair, scale in zip(model.pairs, known["pairs"], strict=True):
        if pair.play is not None:
            limits.append(GAP_PER_SAMPLE * scale.way(pair.play) / scale.speed)
    return min(limits)


def _resonance_length(modes: ModalForm) -> float:
    """Length of a block in s whose bins resolve every resonance; NotApplicable for one without
    damping."""
    found = [0.0]
    for value in eigenvalues(np.diag(modes.squares), modes.dynamic):
        if abs(value) <= UNSTABLE * modes.frequency:
            continue  # a loose mass has no resonance
        if -value.real <= UNSTABLE * modes.frequency:
            raise NotApplicable(
                "simulate",
                f"tabulated noise needs damping > 0 in every mode, got none at "
                f"{abs(value) / (2.0 * math.pi):.3g} Hz; give the spring its damper (a thousandth "
                "of critical damping is enough), or take filtered noise",
            )
        found.append(BLOCK_RELAXATIONS * max(-1.0 / value.real, 1.0 / abs(value)))
    return max(found)


def _block_length(modes: ModalForm, shortest: float) -> float:
    """Length of a block in s whose bins are narrow enough for the tables: the velocity variances
    computed from the middles of the bins must agree with the integrals."""
    stiffness = np.diag(modes.squares)
    length = shortest or max(1.0 / float(table.frequency_hz[0]) for table, _ in modes.tables)
    for _ in range(MOST_DOUBLINGS):
        error = 0.0
        for table, force in modes.tables:
            highest = max(modes.frequency / math.pi, 2.0 * float(table.frequency_hz[0]))
            count = math.ceil(min(highest * length, MOST_SAMPLES / 2)) + 2
            waves, exact = bin_amplitudes(table, force, stiffness, modes.dynamic, length, count)
            omega2 = (2.0 * np.pi / length * np.arange(1, count)) ** 2
            found = omega2[:, None] * np.abs(waves) ** 2
            total = np.maximum(exact.sum(axis=0), np.finfo(float).tiny)
            error = max(error, float(np.max(np.abs(np.sum(found - exact, axis=0)) / total)))
        if error <= BIN_ERROR:
            return length
        length *= 2.0
    raise NotApplicable(
        "simulate", "the table reaches down to frequencies too far below the resonances"
    )


def _on_stops(model: Model, known: dict[str, Any]) -> list[float]:
    """Frequency (rad/s) of the reduced mass of a pair on each stop onto which a load presses it;
    infinite on a rigid one."""
    return [
        rate_of_contact(pair, stop, scale)
        for pair, scale in zip(model.pairs, known["pairs"], strict=True)
        for stop in pair.stops
        if scale.pressing > 0.0
    ]


def _samples(modes: ModalForm, length: float, rate: float, on_stops: Sequence[float]) -> int:
    """Number of samples of a block: at least at `rate`, and so many that no coordinate or gap has
    more than LARGEST_LOSS of its velocity variance above half the sampling rate. Where they can be
    made, there are so many that the whole noise shakes a mass on a stop."""
    rows: Vector = np.vstack([modes.shapes, modes.gaps])
    cut = 0.0
    if modes.tables:
        frequency, left = beyond(modes.tables, np.diag(modes.squares), modes.dynamic, rows)
        share = left / np.maximum(left[0], np.finfo(float).tiny)
        enough = np.flatnonzero(np.all(share <= LARGEST_LOSS, axis=1))
        cut = float(frequency[enough[0]] if len(enough) else frequency[-1])
    needed = max(rate, 2.0 * cut) * length
    if modes.tables:
        tables, most = [table for table, _ in modes.tables], MOST_SAMPLES / modes.size / length
        needed = max(needed, rate_on_stops(tables, on_stops, most) * length)
    if needed * modes.size > MOST_SAMPLES:
        raise NotApplicable(
            "simulate",
            f"a block needs {needed:.2g} samples of {modes.size} modes, at most "
            f"{MOST_SAMPLES // modes.size} are made: the fastest motion (table, mode, or flight "
            "between the stops) and the slowest (decay of a resonance) are too far apart; take "
            "fewer modes (structure.modes), a table that ends sooner, or more damping",
        )
    return _even_fast_length(needed + 2.0)
