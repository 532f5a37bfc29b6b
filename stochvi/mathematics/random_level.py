"""The random level of noise of varying level: its distribution, what a mount feels of it, and
the probability that a hazard which follows it strikes.

The noise is A(t) g(t), with a stationary Gaussian g and an independent level A of mean square 1.
The level in decibels is normal: A = exp(s (u - s)) with a standard normal Ornstein-Uhlenbeck
process u of the correlation exp(-t / tau). The kurtosis of the noise is 3 E A^4 = 3 exp(4 s^2).

Conditioned on the level the noise is Gaussian. A mount of the bandwidth b (1/s) averages the
squared level over its memory, V(t) = b int_0^inf exp(-b r) A^2(t - r) dr, so that its response has
the kurtosis

    3 E V^2 = 3 sum_n (4 s^2)^n / n! b / (b + n / tau)

which is that of the noise where the level is slow. A hazard lambda(u) strikes within T with the
probability 1 - <1, exp(T (L - lambda)) 1> (M. Kac 1949), with the generator L of u. Its
eigenfunctions are Hermite polynomials, with the rates -n / tau.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector

NODES = 96
"""Number of levels at which a hazard is known: Gauss-Hermite nodes, which reach to 13 standard
deviations."""

AT_ONCE, SURE = 300.0, 50.0
"""Hazard times the correlation time of the level, and times the mission, above both of which a
hazard counts as the larger bound: a visit of such a level is struck at once. Without a bound
rounding errors would grow with the hazard."""

TERMS = 60
"""Terms of the series of a kurtosis: the next one is below 1e-16 up to a kurtosis of 100."""


@dataclass(frozen=True)
class RandomLevel:
    """Noise whose level in decibels is a normal Ornstein-Uhlenbeck process.

    Parameters
    ----------
    kurtosis
        Kurtosis of the noise, above 3.
    time
        Correlation time of its level in decibels, s.

    Examples
    --------
    >>> level = RandomLevel(kurtosis=5.0, time=10.0)
    >>> round(level.spread_db, 2), round(3.0 * level.moment(4.0), 12)
    (3.1, 5.0)
    """

    kurtosis: float
    time: float

    @property
    def spread(self) -> float:
        """Standard deviation of the logarithm of the level."""
        return 0.5 * math.sqrt(math.log(self.kurtosis / 3.0))

    @property
    def spread_db(self) -> float:
        """Standard deviation of the level, dB."""
        return 20.0 / math.log(10.0) * self.spread

    def gain(self, normal: Vector) -> Vector:
        """The level at values of the standard normal process."""
        return np.asarray(np.exp(self.spread * (normal - self.spread)))

    def moment(self, power: float) -> float:
        """E A^power."""
        return math.exp(power * self.spread**2 * (0.5 * power - 1.0))

    @property
    def normals(self) -> Vector:
        """(NODES,): values of the normal process at which a hazard is known."""
        return _hermite()[0]

    @property
    def weights(self) -> Vector:
        """(NODES,): their probabilities."""
        return _hermite()[1]

    @cached_property
    def gains(self) -> Vector:
        """(NODES,): the levels there."""
        return self.gain(self.normals)

    def felt(self, bandwidth: float) -> RandomLevel:
        """What the response of a mount feels of the level: its kurtosis, and the time of its level.

        Parameters
        ----------
        bandwidth
            The rate b, 1/s, at which the energy of the mount decays, 2 zeta omega.
        """
        terms = np.arange(1, TERMS + 1)
        logs = terms * math.log(4.0 * self.spread**2) - np.cumsum(np.log(terms))
        excess = float(np.sum(np.exp(logs) * bandwidth / (bandwidth + terms / self.time)))
        # averaging leaves the integral of the correlation of the squared level as it is
        return RandomLevel(3.0 + 3.0 * excess, self.time * (self.kurtosis / 3.0 - 1.0) / excess)

    def mean(self, values: Vector) -> float:
        """The average over the level of values at `gains`."""
        return float(self.weights @ values)

    def probability(self, rates: Vector, mission: float) -> float:
        """The probability that a hazard strikes in a mission.

        Parameters
        ----------
        rates
            Its rates at `gains`, 1/s.
        mission
            Duration, s, from the stationary state on.
        """
        basis = _hermite()[2]
        held = np.minimum(rates, max(AT_ONCE / self.time, SURE / mission))
        generator = (basis * held) @ basis.T
        generator[np.diag_indices(NODES)] += np.arange(NODES) / self.time
        values, vectors = np.linalg.eigh(generator)
        return float(np.sum(vectors[0] ** 2 * -np.expm1(-np.maximum(values, 0.0) * mission)))


@lru_cache(maxsize=1)
def _hermite() -> tuple[Vector, Vector, Matrix]:
    """Nodes and weights of the standard normal distribution, and the orthonormal polynomials times
    the roots of the weights (degrees, nodes): an orthogonal matrix, from the Jacobi matrix."""
    off = np.sqrt(np.arange(1.0, NODES))
    nodes, vectors = np.linalg.eigh(np.diag(off, 1) + np.diag(off, -1))
    basis = vectors * np.where(vectors[0] < 0.0, -1.0, 1.0)
    return nodes, basis[0] ** 2, basis
