"""Noise with fast peaks: a steady kurtosis above 3 at a given density.

A Gaussian signal u of unit variance is made peaked by a monotone cubic without memory (S. R.
Winterstein, J. Eng. Mech. 114 (1988) 1772), and a linear filter L gives it its density back:

    x = L [u + h He_3(u)],    He_3(u) = u^3 - 3 u

With the correlation rho of u that of He_3(u) is 6 rho^3 (Mehler's formula). So the filter that
leaves the density exactly as it was is known: |L|^2 = S / (S + 6 h^2 S_3), where rho^3 has the
density S_3. No signal of a bounded band comes from a cubic alone, as rho^3 reaches to three times
the band. The filter takes off a part of the kurtosis, so that h is found by samples of x.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.fft import irfft, rfft
from numpy.typing import NDArray

from stochvi.mathematics.arrays import Matrix, Vector, Waves
from stochvi.mathematics.frequency_response import bin_variances
from stochvi.mathematics.spectra import Table

MOST_KURTOSIS = 20.0
"""Largest kurtosis of noise with fast peaks."""

MOST_CUBIC = 1.0 / 3.0
"""Largest h, at which the cubic is still monotone."""

PILOT_BINS, PILOT_RECORDS, PILOT_SEED = 2**14, 32, 20
"""Bins and number of the records from which h is found, and their seed: they leave the kurtosis
uncertain by 0.3 % at 5 and 1 % at 8."""

PARTS = 32
"""Parts of a record whose averages tell the weight of the control variate."""

SAMPLES_PER_PERIOD = 4.0
"""Samples in the shortest period: at fewer, frequencies of the cube would be folded into the
band."""

ENOUGH = 1e-3
"""Error of h at which its search ends."""


class Hermite(NamedTuple):
    """Monotone cubic of a Gaussian variable of unit variance that has a chosen kurtosis,

        x = k (g + h (g^3 - 3 g)),    k = 1 / sqrt(1 + 6 h^2)

    (S. R. Winterstein, J. Eng. Mech. 114 (1988) 1772; h solved exactly for the kurtosis).

    Examples
    --------
    >>> law = Hermite.of(5.0)
    >>> round(law.inverse(law(4.0)), 9), Hermite.of(3.0)(4.0)
    (4.0, 4.0)
    """

    h: float

    @classmethod
    def of(cls, kurtosis: float) -> Hermite:
        """The cubic for a kurtosis of 3 to 20 or so."""
        from scipy.optimize import brentq  # which takes long to import

        if kurtosis <= 3.0:
            return cls(0.0)
        return cls(float(brentq(lambda h: cls(h).kurtosis - kurtosis, 0.0, MOST_CUBIC)))

    @property
    def kurtosis(self) -> float:
        """Kurtosis of x: E x^4 of H1 + h H3 is 3 + 24 h + 252 h^2 + 1296 h^3 + 3348 h^4."""
        h = self.h
        fourth = 3.0 + 24.0 * h + 252.0 * h**2 + 1296.0 * h**3 + 3348.0 * h**4
        return fourth / (1.0 + 6.0 * h**2) ** 2

    def __call__(self, g: Any) -> Any:
        """x for a Gaussian g."""
        return (g + self.h * (g**3 - 3.0 * g)) / math.sqrt(1.0 + 6.0 * self.h**2)

    def inverse(self, x: float) -> float:
        """g for x >= 0."""
        from scipy.optimize import brentq

        return float(brentq(lambda g: self(g) - x, 0.0, 3.0 + 2.0 * x))


class UnreachableKurtosis(ValueError):
    """A density does not let noise have the kurtosis that is asked for."""


@dataclass(frozen=True, eq=False)
class FastPeaks:
    """Noise of a density with a steady kurtosis, by fast peaks.

    Parameters
    ----------
    table
        Its density.
    kurtosis
        Its kurtosis, above 3.

    Examples
    --------
    >>> flat = Table(frequency_hz=np.array([10.0, 100.0]), density=np.ones(2))
    >>> peaks = FastPeaks(flat, 5.0)
    >>> bins = peaks.over(20.0).bins(np.random.default_rng(1), 50)
    >>> bins.shape
    (2001, 50)
    >>> record = irfft(bins, 8004, axis=0)
    >>> bool(abs(np.mean(record**4) / np.mean(record**2) ** 2 - 5.0) < 0.3)
    True
    """

    table: Table
    kurtosis: float

    mean = 0.0
    """Mean of the noise."""

    @property
    def cubic(self) -> float:
        """The weight h of the cubic.

        Raises
        ------
        UnreachableKurtosis
            If no monotone cubic gives noise of this density the kurtosis.
        """
        table = self.table
        return _cubic(table.frequency_hz.tobytes(), table.density.tobytes(), self.kurtosis)

    def over(self, length: float) -> PeakedRecords:
        """Records of a length, s, that repeat."""
        return PeakedRecords(self.table, length, self.cubic)


@dataclass(frozen=True, eq=False)
class PeakedRecords:
    """Records of noise with fast peaks that repeat after a length, s.

    Parameters
    ----------
    cubic
        The weight h of the cubic; 0 for Gaussian noise.
    """

    table: Table
    length: float
    cubic: float

    @cached_property
    def count(self) -> int:
        """Number of bins, up to the end of the density."""
        return math.ceil(float(self.table.frequency_hz[-1]) * self.length) + 1

    @cached_property
    def samples(self) -> int:
        """Number of samples at which the cubic is taken."""
        from scipy.fft import next_fast_len  # which takes long to import

        return 2 * int(next_fast_len(math.ceil(SAMPLES_PER_PERIOD * self.count / 2.0) + 1))

    @cached_property
    def variances(self) -> Vector:
        """(count,) variance of each bin from the second on; the mean has none."""
        found = np.zeros(self.count)
        found[1:] = bin_variances(self.table, self.length, self.count)
        return found

    @cached_property
    def filter(self) -> Vector:
        """(count,) what the transform of u + h He_3(u) is multiplied by."""
        return self.filter_of(self.cubic)

    def filter_of(self, cubic: float) -> Vector:
        """`filter` for another weight h."""
        grown = self._shares + cubic**2 * self._shares_of_cube
        kept = np.divide(self.variances, grown, out=np.zeros(self.count), where=self._shares > 0.0)
        return np.asarray(np.sqrt(kept))

    @cached_property
    def _shares(self) -> Vector:
        """(count,) variance of u in each bin."""
        return np.asarray(self.variances / self.variances.sum())

    @cached_property
    def _shares_of_cube(self) -> Vector:
        """(count,) variance of He_3(u) in each bin."""
        correlation = irfft(0.5 * self.samples * self._shares, self.samples)
        cubes = 2.0 / self.samples * rfft(6.0 * correlation**3)[: self.count].real
        return np.asarray(np.maximum(cubes, 0.0))

    def gaussian(self, random: np.random.Generator, records: int) -> Matrix:
        """Gaussian records u (samples, records)."""
        return self._gaussian_of(random.standard_normal((2, self.count, records)))

    def bins(self, random: np.random.Generator, records: int) -> Waves:
        """Records x by their transforms (count, records), as `rfft` of `samples` samples has."""
        return self.bins_of(random.standard_normal((2, self.count, records)))

    def bins_of(self, normals: NDArray[np.float64]) -> Waves:
        """The same records from standard normal numbers (2, count, records)."""
        u = self._gaussian_of(normals)
        raw = rfft(u + self.cubic * (u**3 - 3.0 * u), axis=0)[: self.count]
        return np.asarray(self.filter[:, None] * raw)

    def _gaussian_of(self, normals: NDArray[np.float64]) -> Matrix:
        real, imaginary = normals
        size = 0.5 * self.samples * np.sqrt(self._shares)
        return np.asarray(irfft(size[:, None] * (real - 1j * imaginary), self.samples, axis=0))


class _Pilot:
    """Kurtosis of noise of a density over the weight h of its cubic, from one set of records."""

    def __init__(self, table: Table) -> None:
        length = PILOT_BINS / float(table.frequency_hz[-1])
        self.records = PeakedRecords(table, length, 0.0)
        self.u = self.records.gaussian(np.random.default_rng(PILOT_SEED), PILOT_RECORDS)
        self.cube = self.u**3 - 3.0 * self.u
        self.bins = [rfft(each, axis=0)[: self.records.count] for each in (self.u, self.cube)]

    def kurtosis(self, h: float) -> float:
        """The kurtosis, by the known one before the filter as a control variate."""
        kept = self.records.filter_of(h)[:, None]
        after = irfft(kept * (self.bins[0] + h * self.bins[1]), self.records.samples, axis=0)
        before = self.u + h * self.cube
        scales = 1.0 + 6.0 * h**2, float(self.records.variances.sum())
        known, found = (
            np.concatenate([part.mean(axis=0) for part in np.array_split((each**2) ** 2, PARTS)])
            / scale**2
            for each, scale in zip((before, after), scales, strict=True)
        )
        spread = np.cov(known, found)
        weight = spread[0, 1] / spread[0, 0]
        return float(found.mean() - weight * (known.mean() - Hermite(h).kurtosis))


@lru_cache(maxsize=64)
def _cubic(frequency: bytes, density: bytes, kurtosis: float) -> float:
    """The weight h that gives noise of a density the kurtosis."""
    from scipy.optimize import brentq

    table = Table(frequency_hz=np.frombuffer(frequency), density=np.frombuffer(density))
    pilot = _Pilot(table)
    most = pilot.kurtosis(MOST_CUBIC)
    if most < kurtosis:
        raise UnreachableKurtosis(
            f"kurtosis must be at most {most:.3g} for noise of this density, got {kurtosis:g}; "
            "give a wider band, or level_time for noise of varying level"
        )
    tolerance = ENOUGH * Hermite.of(kurtosis).h
    return float(brentq(lambda h: pilot.kurtosis(h) - kurtosis, 0.0, MOST_CUBIC, xtol=tolerance))
