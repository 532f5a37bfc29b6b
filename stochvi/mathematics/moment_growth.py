"""Growth of the moments of linear systems whose coefficients are random or periodic.

    x' = (A + sum_j xi_j(t) B_j) x

Its moments of one order p, E x^(p), follow the same kind of equation with the Kronecker sums of A
and B_j. A modulation xi is a function of a process of its own: of a phase that turns, or of a
filter that noise drives. Moments times the functions of a basis of that process follow a constant
matrix, whose rightmost eigenvalue is the rate of growth. White noise has no process: in the sense
of Stratonovich it adds S B^2 / 2 to the matrix.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from stochvi.mathematics.arrays import Matrix

FIRST_ORDER, LARGEST_SIZE = 6, 1000
"""First order of the bases, and the largest size of a matrix whose eigenvalues are sought."""

AT_ENDS = 1e-6
"""Share of an eigenvector at the ends of a basis, from which on it is one of the cut."""

SETTLED = 1e-7
"""Change of the growth between an order and a half more, relative to the norm of A, up to which it
has converged."""


class WhiteChange(NamedTuple):
    """White noise, E xi(t) xi(t + tau) = intensity delta(tau), in the sense of Stratonovich.

    Parameters
    ----------
    matrix, intensity : B, and S, s.
    """

    matrix: Matrix
    intensity: float


class SineChange(NamedTuple):
    """A sine of an amplitude and a frequency omega (rad/s), with a random phase."""

    matrix: Matrix
    amplitude: float
    omega: float

    def operators(self, order: int) -> tuple[Matrix, Matrix]:
        """Generator and xi on the functions exp(i k phase), k = -order .. order."""
        turns = np.arange(-order, order + 1)
        near = np.eye(len(turns), k=1) + np.eye(len(turns), k=-1)
        return np.diag(1j * self.omega * turns), 0.5 * self.amplitude * near


class FilteredChange(NamedTuple):
    """White noise of an intensity through a resonance, xi'' + b xi' + w^2 xi = w^2 noise.

    Parameters
    ----------
    matrix, omega, damping_rate, intensity : B, w, rad/s, b, 1/s, and S, s.
    """

    matrix: Matrix
    omega: float
    damping_rate: float
    intensity: float

    def operators(self, order: int) -> tuple[Matrix, Matrix]:
        """Generator and xi on products of normed Hermite polynomials of xi and xi' / w, up to a
        degree."""
        index = {(i, d - i): k for k, (d, i) in enumerate(
            (d, i) for d in range(order + 1) for i in range(d + 1))}  # fmt: skip
        lower_u, lower_w = np.zeros((2, len(index), len(index)))
        for (i, j), k in index.items():
            if i:
                lower_u[index[i - 1, j], k] = np.sqrt(i)
            if j:
                lower_w[index[i, j - 1], k] = np.sqrt(j)
        turning = lower_w.T @ lower_u - lower_u.T @ lower_w
        generator = self.omega * turning - self.damping_rate * lower_w.T @ lower_w
        size = np.sqrt(self.omega**2 * self.intensity / (2.0 * self.damping_rate))
        return generator, size * (lower_u + lower_u.T)


Change = WhiteChange | SineChange | FilteredChange
"""A coefficient that changes."""


def moment_growth(system: Matrix, changes: Sequence[Change], power: int) -> float | None:
    """Rate at which the moments of an order grow in the long run, 1/s.

    Parameters
    ----------
    system
        A (n, n), 1/s.
    changes
        xi_j and B_j of what changes.
    power
        The order of the moments: 1 for means, 2 for mean squares.

    Returns
    -------
    float or None
        The rate; below 0 where the moments decay. None where no basis of a bearable size suffices.

    Examples
    --------
    White noise on the spring of x'' + b x' + w^2 (1 + xi) x = 0: mean squares neither grow nor
    decay at w^2 S = 2 b.

    >>> system, spring = np.array([[0.0, 1.0], [-4.0, -0.2]]), np.array([[0.0, 0.0], [-4.0, 0.0]])
    >>> abs(moment_growth(system, [WhiteChange(spring, 0.1)], 2)) < 1e-12
    True
    """
    order, before, white = FIRST_ORDER, math.inf, all(isinstance(c, WhiteChange) for c in changes)
    while True:
        found = _growth(system, changes, power, order)
        if found is None or white or abs(found - before) <= SETTLED * np.linalg.norm(system, 2):
            return found
        order, before = order + order // 2, found


def _growth(system: Matrix, changes: Sequence[Change], power: int, order: int) -> float | None:
    """The rightmost eigenvalue with bases of one order; None if the matrix is too large.

    A sine has all turns, of which the basis is a part. What lives at its ends is left out: it is of
    the cut, and of no motion.
    """
    moments = _lifted(system, power)
    coloured = [each for each in changes if not isinstance(each, WhiteChange)]
    for each in changes:
        if isinstance(each, WhiteChange):
            lifted = _lifted(each.matrix, power)
            moments = moments + 0.5 * each.intensity * lifted @ lifted
    bases = [each.operators(order) for each in coloured]
    units = [np.eye(len(generator)) for generator, _ in bases]
    if len(moments) * math.prod(len(unit) for unit in units) > LARGEST_SIZE:
        return None
    total, ends = _product(*units, moments), np.zeros(1, bool)
    for number, (each, (generator, size)) in enumerate(zip(coloured, bases, strict=True)):
        for own, last in (
            (generator.T, np.eye(len(moments))), (size.T, _lifted(each.matrix, power))
        ):  # fmt: skip
            factors = [*units[:number], own, *units[number + 1 :], last]
            total = total + _product(*factors)
        cut = np.zeros(len(generator), bool)
        if isinstance(each, SineChange):
            cut[[0, 1, -2, -1]] = True
        ends = (ends[:, None] | cut).ravel()
    values, vectors = np.linalg.eig(total)
    weights = np.abs(vectors) ** 2
    inside = weights[np.repeat(ends, len(moments))].sum(axis=0) <= AT_ENDS * weights.sum(axis=0)
    return float(np.max(values.real[inside], initial=-math.inf))


def _product(*factors: Matrix) -> Matrix:
    """The Kronecker product of all factors."""
    found: Matrix = np.eye(1)
    for factor in factors:
        found = np.asarray(np.kron(found, factor))
    return found


def _lifted(matrix: Matrix, power: int) -> Matrix:
    """The matrix for all products of `power` of the variables."""
    products = list(combinations_with_replacement(range(len(matrix)), power))
    index = {product: number for number, product in enumerate(products)}
    found = np.zeros((len(products), len(products)))
    for row, product in enumerate(products):
        for k, factor in enumerate(product):
            for j in np.flatnonzero(matrix[factor]):
                other = tuple(sorted((*product[:k], int(j), *product[k + 1 :])))
                found[row, index[other]] += matrix[factor, j]
    return found
