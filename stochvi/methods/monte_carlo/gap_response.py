"""Motion of the gaps of a linear structure under Gaussian noise, without impacts and sines.

The response is a sum over bins of frequency, as in `modal_tables`; white and filtered noise become
tables, so that all of it is synthesised, and no step is taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import ifft, irfft

from stochvi.mathematics.arrays import Matrix, Vector, Waves
from stochvi.mathematics.frequency_response import (
    Tables,
    beyond,
    bin_amplitudes,
    eigenvalues,
    gains,
)
from stochvi.mathematics.spectra import Table
from stochvi.mathematics.units import density_from_intensity
from stochvi.methods.monte_carlo.kernels.modes import fill_modal_spectrum
from stochvi.methods.monte_carlo.modal_tables import _block_length, _streams
from stochvi.methods.monte_carlo.tabulated import (
    BLOCK_RELAXATIONS,
    BLOCK_SAMPLES,
    FOLD_FROM,
    LARGEST_BLOCK,
    LARGEST_LOSS,
    LOWEST_FREQUENCY,
    MOST_SAMPLES,
    SAMPLES_PER_PERIOD,
    WHITE_LOSS,
    _even_fast_length,
    _filtered,
)
from stochvi.model.free_motion import free_motion
from stochvi.model.modal import ModalForm
from stochvi.model.model import Model
from stochvi.results.errors import NotApplicable
from stochvi.scenes.excitations.pulses import Pulses

FINER = 8
"""How much finer the motion after a shock is sampled for its frequencies."""

CARRIES = 0.01
"""Share of the velocity variance of a gap from which a mode counts among those that move it."""


@dataclass(frozen=True, kw_only=True)
class GapResponse:
    """Synthesis of the gaps of a structure without stops, from their mean positions (SI units).

    Parameters
    ----------
    modes
        The structure, with one row of `gaps` for each gap.
    tables
        One-sided densities of all noises, with the modal forces per unit of what they describe.
    velocities
        (gaps,): exact velocity variances, m^2/s^2.
    relaxation
        Time constant of the slowest mode, s.
    fastest
        Frequency of the fastest mode that moves a gap, rad/s.
    samples, block_length
        Number of samples of a record, which repeats itself, and its length, s.
    """

    modes: ModalForm
    tables: Tables
    velocities: Vector
    relaxation: float
    fastest: float
    samples: int
    block_length: float

    @property
    def gaps(self) -> int:
        """Number of gaps."""
        return len(self.modes.gaps)

    @property
    def step(self) -> float:
        """Sampling interval, s."""
        return self.block_length / self.samples

    def block(self, gaps: int) -> int:
        """Number of paths that are synthesised together where each has so many gaps: a power of two
        with a few megabytes of samples."""
        fitting = max(1, min(LARGEST_BLOCK, BLOCK_SAMPLES // (self.samples * gaps)))
        return 1 << (fitting.bit_length() - 1)

    def with_step(self, step: float) -> GapResponse:
        """The same records at a chosen sampling interval, s."""
        return replace(self, samples=_even_fast_length(self.block_length / step))

    def with_block(self, length: float) -> GapResponse:
        """Records of a chosen length, s, at about the same sampling interval."""
        return replace(self, block_length=length).with_step(self.step)

    @cached_property
    def amplitudes(self) -> Waves:
        """Complex amplitudes of each bin, (bins, gaps, tables); the last quarter is scaled up, so
        that the velocity variance beyond the bins is not lost."""
        count = self.samples // 2
        matrices = np.diag(self.modes.squares), self.modes.damping
        found = [
            bin_amplitudes(table, force, *matrices, self.block_length, count)[0]
            for table, force in self.tables
        ]
        waves: Waves = np.einsum("tbm,gm->bgt", np.array(found), self.modes.gaps)
        omega2 = (2.0 * np.pi / self.block_length * np.arange(1, count)) ** 2
        velocities = omega2[:, None] * np.sum(np.abs(waves) ** 2, axis=2)
        missing = self.velocities - velocities.sum(axis=0)
        last = int(FOLD_FROM * (count - 1))
        top = velocities[last:].sum(axis=0)
        grown = np.divide(missing, top, out=np.zeros_like(top), where=(top > 0.0) & (missing > 0.0))
        waves[last:] *= np.sqrt(1.0 + grown)[:, None]
        return waves

    def records(
        self, seed: int, first_path: int, paths: int, chosen: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """(paths, samples, 2 gaps): each of the chosen gaps (m) and its rate (m/s), in turn."""
        waves, scale = self.amplitudes[:, chosen], self.fastest
        relative = 2.0 * np.pi / self.block_length / scale * np.arange(1, len(waves) + 1)
        spectrum = np.empty((self.samples, len(chosen), paths), complex)
        streams = _streams(seed, first_path, paths, 0)
        real, imaginary = np.ascontiguousarray(waves.real), np.ascontiguousarray(waves.imag)
        fill_modal_spectrum(streams, real, imaginary, relative, spectrum.view(np.float64))
        free = ifft(spectrum, axis=0, norm="forward", overwrite_x=True)
        found = np.empty((paths, self.samples, 2 * len(chosen)))
        found[:, :, 0::2] = free.real.transpose(2, 0, 1)
        found[:, :, 1::2] = scale * free.imag.transpose(2, 0, 1)
        return found

    def correlations(self, lags: int) -> NDArray[np.float64]:
        """Correlations of the records: E[y_j(-t) y_k(0)], and the first and second derivative of
        E[y_j(t) y_k(0)] there, at t of 0 ... `lags` samples: (3, lags + 1, gaps j, gaps k)."""
        waves = self.amplitudes
        turn = 2j * np.pi / self.block_length * np.arange(1, len(waves) + 1)[:, None]
        before = -np.arange(lags + 1)
        found = np.empty((3, lags + 1, self.gaps, self.gaps))
        spectrum = np.empty((self.samples, self.gaps), complex)
        for gap in range(self.gaps):
            cross = np.einsum("bjt,bt->bj", waves, waves[:, gap].conj())
            for order in range(3):
                spectrum[:] = 0.0
                spectrum[1 : len(waves) + 1] = turn**order * cross
                found[order, :, :, gap] = ifft(spectrum, axis=0, norm="forward").real[before]
        return found

    def shock_responses(self, rows: Matrix, force: Vector, pulses: Pulses) -> Vector:
        """Displacements rows . q and their velocities (rows, samples, 2) after a shock of size 1
        from rest, at the sampling interval; `force` (modes,) is that of a unit on the modes."""
        assert pulses.shock is not None
        fine = FINER * self.samples
        f = np.arange(fine // 2 + 1) / self.block_length
        moved = gains(f, np.diag(self.modes.squares), self.modes.damping, force) @ rows.T
        moved *= (pulses.size * pulses.shock.transform(2.0 * np.pi * f))[:, None]
        found = [
            irfft((2j * np.pi * f[:, None]) ** order * moved, fine, axis=0)[::FINER]
            for order in (0, 1)
        ]
        return np.asarray(np.stack(found, axis=-1) * fine / self.block_length).swapaxes(0, 1)


def plan_gaps(model: Model, directions: Matrix) -> GapResponse:
    """Choose sampling and lengths for the gaps `directions` . q (gaps, n) of a structure.

    Raises
    ------
    NotApplicable
        Where the motion without stops is not a stationary Gaussian process, or where its times lie
        too far apart.
    """
    modes = model.modal._replace(gaps=directions @ model.modal.shapes)
    law = free_motion(model, with_sines=True).law
    n = modes.size
    moving = law.covariance[n : 2 * n, n : 2 * n]
    velocities = np.einsum("gm,mk,gk->g", modes.gaps, moving, modes.gaps)
    shares = modes.gaps**2 * np.diag(moving)
    carrying = np.any(shares >= CARRIES * velocities[:, None], axis=0)
    fastest = math.sqrt(float(np.max(modes.squares[carrying])))
    damped = eigenvalues(np.diag(modes.squares), modes.damping)
    relaxation = float(np.max(-1.0 / damped.real))
    tables = with_tables(model).modal.tables
    modes = modes._replace(tables=tables)
    length = _block_length(modes, BLOCK_RELAXATIONS * max(relaxation, 1.0 / fastest))
    rate = SAMPLES_PER_PERIOD * fastest / (2.0 * math.pi)
    frequency, left = beyond(tables, np.diag(modes.squares), modes.damping, modes.gaps)
    enough = np.flatnonzero(np.all(left <= LARGEST_LOSS * left[0], axis=1))
    cut = float(frequency[enough[0]] if len(enough) else frequency[-1])
    needed = max(rate, 2.0 * cut) * length
    if needed * len(modes.gaps) > MOST_SAMPLES:
        raise NotApplicable(
            "first_crossings",
            [
                f"a record of {len(modes.gaps)} gaps needs {needed:.2g} samples, at most "
                f"{MOST_SAMPLES // len(modes.gaps)} are made: the fastest motion and the slowest "
                "decay are too far apart"
            ],
        )
    return GapResponse(
        modes=modes,
        tables=tables,
        velocities=velocities,
        relaxation=relaxation,
        fastest=fastest,
        samples=_even_fast_length(needed + 2.0),
        block_length=length,
    )


def with_tables(model: Model) -> Model:
    """The model with every noise as a density: white noise up to where hardly any of its velocity
    variance is left, filtered noise as far as its filter lets it. Sines stay."""
    modes = model.modal
    tables = list(model.tables)
    natural = np.sqrt(modes.squares[modes.squares > 0.0])
    slowest, fastest = float(np.min(natural)), float(np.max(natural))
    for signal in model.without_sines().signals:
        tables.append((_filtered(signal, slowest), signal.direction))
    widest = float(np.max(np.diag(modes.damping)))
    highest = max(
        widest / (math.pi**2 * WHITE_LOSS), SAMPLES_PER_PERIOD * fastest / (2.0 * math.pi)
    )
    for intensity, direction in model.whites:
        flat = Table(
            frequency_hz=np.array([LOWEST_FREQUENCY * slowest / (2.0 * math.pi), highest]),
            density=np.full(2, density_from_intensity(intensity)),
        )
        tables.append((flat, direction))
    return replace(model, whites=(), signals=model.sines, tables=tuple(tables))


def shaken_by_tables(model: Model) -> Model:
    """The model `with_tables`; one mass stands on a base that they shake, so that its absolute
    acceleration is known: what spring, damper and stops give it."""
    tables, one = with_tables(model), len(model.coordinates) == 1
    return tables.shaken_by_base() if one and not tables.base_alone_moves else tables
