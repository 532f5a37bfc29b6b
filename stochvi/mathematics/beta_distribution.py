"""The beta distribution on [0, 1] of a given mean and standard deviation: moments, and rules that
stand for it."""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh_tridiagonal
from scipy.special import betaincinv, gammaln, ndtri, psi

from stochvi.mathematics.arrays import Matrix, Vector
from stochvi.mathematics.quadrature import gauss_panels

CELL_NODES = 8
"""Number of Gauss-Legendre nodes in each cell of probability."""

CONCENTRATED = 1e8
"""alpha + beta beyond which the distribution counts as normal: its skewness is below 1e-4."""


class BetaDistribution(NamedTuple):
    """The distribution with the density r^(alpha - 1) (1 - r)^(beta - 1) / B(alpha, beta).

    alpha = mean k and beta = (1 - mean) k with k = mean (1 - mean) / std^2 - 1, which needs
    0 < std < sqrt(mean (1 - mean)).

    >>> law = BetaDistribution(0.7, 0.1)
    >>> round(law.alpha, 9), round(law.beta, 9)
    (14.0, 6.0)
    """

    mean: float
    std: float

    @property
    def concentration(self) -> float:
        """alpha + beta."""
        return self.mean * (1.0 - self.mean) / self.std**2 - 1.0

    @property
    def alpha(self) -> float:
        """Exponent of r, plus 1."""
        return self.mean * self.concentration

    @property
    def beta(self) -> float:
        """Exponent of 1 - r, plus 1."""
        return (1.0 - self.mean) * self.concentration

    @property
    def mean_logarithm(self) -> float:
        """E ln r."""
        if self.concentration > CONCENTRATED:
            return math.log(self.mean) - 0.5 * (self.std / self.mean) ** 2
        return float(psi(self.alpha) - psi(self.alpha + self.beta))

    def moment(self, power: float) -> float:
        """E r^power for any real power; infinite up to -alpha.

        >>> law = BetaDistribution(0.7, 0.1)
        >>> round(law.moment(2.0), 12), law.moment(-14.0)
        (0.5, inf)
        """
        a, b = self.alpha, self.beta
        if a + power <= 0.0:
            return math.inf
        if self.concentration > CONCENTRATED:
            share = 0.5 * power * (power - 1.0) * (self.std / self.mean) ** 2
            return float(self.mean**power * (1.0 + share))
        return math.exp(gammaln(a + power) + gammaln(a + b) - gammaln(a) - gammaln(a + b + power))

    def rule(self, count: int) -> tuple[Vector, Vector]:
        """Nodes and weights of Gauss's rule, exact for polynomials of degree 2 count - 1."""
        return _rule(self, count)

    def cells(self, count: int) -> tuple[Vector, Vector]:
        """Middles and widths of uniform distributions whose equal mixture stands for this one.

        Each has the mean and, within [0, 1], the variance of one of `count` cells of equal
        probability. Mean and variance of the mixture are exact. Ends of a cell may lie in the next.
        """
        return _cells(self, count)


@cache
def _rule(law: BetaDistribution, count: int) -> tuple[Vector, Vector]:
    """Gauss's rule from the recurrence of Jacobi polynomials (Golub and Welsch 1969)."""
    p, q, n = law.beta - 1.0, law.alpha - 1.0, np.arange(1.0, count)
    size = 2.0 * n + p + q
    first = (q - p) / (p + q + 2.0)
    diagonal = np.append(first, (q - p) * (q + p) / (size * (size + 2.0)))
    square = 4.0 * n * (n + p) * (n + q) / (size**2 * (size + 1.0))
    # (n + p + q) / (size - 1) is 1 for n = 1, where p + q may be -1
    square[1:] *= (n[1:] + p + q) / (size[1:] - 1.0)
    nodes, vectors = eigh_tridiagonal(diagonal, np.sqrt(square))
    return np.clip((1.0 + nodes) / 2.0, 0.0, 1.0), vectors[0] ** 2


@cache
def _cells(law: BetaDistribution, count: int) -> tuple[Vector, Vector]:
    u, weights = gauss_panels(np.linspace(0.0, 1.0, count + 1), CELL_NODES)
    normal = law.concentration > CONCENTRATED
    quantiles = law.mean + law.std * ndtri(u) if normal else betaincinv(law.alpha, law.beta, u)
    r: Matrix = quantiles.reshape(count, CELL_NODES)
    share = weights.reshape(count, CELL_NODES) * count
    middles = np.sum(share * r, axis=1)
    variances = np.sum(share * (r - middles[:, None]) ** 2, axis=1)
    room = 2.0 * np.minimum(middles, 1.0 - middles)
    widths = np.minimum(np.sqrt(12.0 * variances), room)
    # what quadrature and the ends of the range leave, in one shift and one stretch
    mean = middles.mean()
    spread = math.sqrt(float(np.mean((middles - mean) ** 2 + widths**2 / 12.0)))
    stretch = law.std / spread
    return np.clip(law.mean + stretch * (middles - mean), 0.0, 1.0), stretch * widths
