"""Response of a linear structure of several modes to tabulated noise, by frequency.

Modal coordinates, q'' + B q' + K q = p f with f of a one-sided density G per hertz, so that

    H(w) = (K - w^2 + i w B)^-1 p,    E q q' = int Re(H H*) G df        (n modes, w = 2 pi f)

Correlated sources are expressed by independent ones whose forces p depend on frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from stochvi.mathematics.arrays import Matrix, Vector, Waves
from stochvi.mathematics.quadrature import gauss_legendre, gauss_panels
from stochvi.mathematics.spectra import Table


@dataclass(frozen=True, eq=False)
class InputMatrix:
    """Modal forces per unit of a source, as a function of frequency.

    Parameters
    ----------
    rows
        Forces (n, k) per unit of each of the k quantities that the source drives.
    shares
        Function from frequencies (Hz) to complex (frequencies, k): the quantities per unit of the
        source.
    breaks
        Frequencies (Hz) at which `shares` is not smooth.
    """

    rows: Matrix
    shares: Callable[[Vector], Waves]
    breaks: Vector

    def __call__(self, frequency_hz: Vector) -> Waves:
        """Forces (frequencies, n) at the given frequencies."""
        return np.asarray(self.shares(frequency_hz) @ self.rows.T)

    def __rmatmul__(self, matrix: Matrix) -> InputMatrix:
        """The same source with its forces multiplied by a matrix from the left."""
        return InputMatrix(matrix @ self.rows, self.shares, self.breaks)

    __array_ufunc__ = None  # so that numpy leaves matrix @ steering to __rmatmul__


Force = Vector | InputMatrix
"""Forces (n,) per unit of a source: one vector, or a function of frequency."""

Tables = Sequence[tuple[Table, Force]]
"""Each density, with the modal forces per unit of the quantity that the density describes."""

NODES = 6
"""Number of Gauss-Legendre nodes on each panel; panels narrow geometrically towards resonances."""

AT_ONCE = 2**14
"""Number of frequencies whose matrices are held in memory together: 100 MB for 20 modes."""

NARROWEST = 1e-9
"""Smallest width of a resonance, relative to its frequency, that panels resolve."""


def gains(frequency_hz: Vector, stiffness: Matrix, damping: Matrix, force: Force) -> Waves:
    """Frequency responses of the displacements to an excitation, complex (frequencies, n).

    >>> still = gains(np.array([0.0]), np.diag([4.0]), np.diag([0.1]), np.array([2.0]))
    >>> still.real.tolist()
    [[0.5]]
    """
    return _gains_of_all(frequency_hz, stiffness, damping, [force])[:, :, 0]


def _gains_of_all(
    frequency_hz: Vector, stiffness: Matrix, damping: Matrix, forces: Sequence[Force]
) -> Waves:
    """`gains` of several excitations, (frequencies, n, excitations)."""
    if len(frequency_hz) > AT_ONCE:  # a budget may end between two parts
        parts = [
            frequency_hz[first : first + AT_ONCE] for first in range(0, len(frequency_hz), AT_ONCE)
        ]
        return np.concatenate([_gains_of_all(each, stiffness, damping, forces) for each in parts])
    w = 2.0 * np.pi * frequency_hz[:, None, None]
    dynamic = stiffness - w**2 * np.eye(len(stiffness)) + 1j * w * damping
    shape = (len(frequency_hz), len(stiffness))
    pushed = [np.broadcast_to(_at(force, frequency_hz), shape) for force in forces]
    return np.asarray(np.linalg.solve(dynamic, np.stack(pushed, axis=-1)), dtype=np.complex128)


def _at(force: Force, frequency_hz: Vector) -> Waves:
    """Forces of a source at the frequencies, (frequencies, n) or (n,)."""
    if isinstance(force, InputMatrix):
        return force(frequency_hz)
    return force.astype(complex)


def quadrature(tables: Tables, stiffness: Matrix, damping: Matrix) -> tuple[Vector, Vector]:
    """Nodes (Hz) and weights over all tables, in panels that narrow towards every resonance."""
    edges = [table.frequency_hz for table, _ in tables]
    edges += [force.breaks for _, force in tables if isinstance(force, InputMatrix)]
    low = float(min(table.frequency_hz[0] for table, _ in tables))
    high = float(max(table.frequency_hz[-1] for table, _ in tables))
    edges.append(np.geomspace(low, high, 2 + 2 * math.ceil(math.log2(high / low))))
    for value in eigenvalues(stiffness, damping):
        resonance = abs(value.imag) / (2.0 * math.pi)
        width = max(abs(value.real) / (2.0 * math.pi), NARROWEST * abs(value), 1e-300)
        reach = max(abs(high - resonance), abs(low - resonance), width)
        offsets = width * 2.0 ** np.arange(-1.0, math.ceil(math.log2(reach / width)) + 1.0)
        edges += [np.array([resonance]), resonance + offsets, resonance - offsets]
    cuts = np.unique(np.concatenate(edges))
    cuts = cuts[(cuts >= low) & (cuts <= high)]
    return gauss_panels(cuts, NODES)


def eigenvalues(stiffness: Matrix, damping: Matrix) -> Waves:
    """Eigenvalues of the free motion q'' + B q' + K q = 0, one of each conjugate pair."""
    n = len(stiffness)
    companion = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping]])
    found = np.linalg.eigvals(companion).astype(complex)
    kept: Waves = found[found.imag >= 0.0]
    return kept


def covariance(tables: Tables, stiffness: Matrix, damping: Matrix) -> Matrix:
    """Stationary covariance of displacements and velocities, (2n, 2n).

    Examples
    --------
    >>> wide = Table(frequency_hz=np.array([1e-4, 1e4]), density=np.array([0.4, 0.4]))
    >>> found = covariance([(wide, np.array([1.0]))], np.diag([1.0]), np.diag([0.1]))
    >>> found.round(3) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    n = len(stiffness)
    total = np.zeros((2 * n, 2 * n))
    if not tables:
        return total
    nodes, weights = quadrature(tables, stiffness, damping)
    for first in range(0, len(nodes), AT_ONCE):
        f, weight = nodes[first : first + AT_ONCE], weights[first : first + AT_ONCE]
        solved = _gains_of_all(f, stiffness, damping, [force for _, force in tables])
        for number, (table, _) in enumerate(tables):
            moved = np.sqrt(table(f) * weight)[:, None] * solved[:, :, number]
            both = np.hstack([moved, 2j * np.pi * f[:, None] * moved])
            # einsum rather than a product of matrices: no thread of BLAS changes its digits
            for part in (both.real, both.imag):
                total += np.einsum("fi,fj->ij", part, part)
    return total


def beyond(
    tables: Tables, stiffness: Matrix, damping: Matrix, rows: Matrix
) -> tuple[Vector, Matrix]:
    """Frequencies (Hz), and the part of the velocity variance of each `rows` . q that comes from
    each frequency and above, (frequencies, rows)."""
    nodes, parts = [], []
    for table, force in tables:
        f, weight = quadrature([(table, force)], stiffness, damping)
        velocity = 2.0 * np.pi * f[:, None] * (gains(f, stiffness, damping, force) @ rows.T)
        nodes.append(f)
        parts.append((table(f) * weight)[:, None] * np.abs(velocity) ** 2)
    order = np.argsort(np.concatenate(nodes))
    shares = np.concatenate(parts)[order]
    return np.concatenate(nodes)[order], np.cumsum(shares[::-1], axis=0)[::-1]


NODES_OF_BIN = 3
"""Number of Gauss-Legendre nodes in a bin, or in each part of a bin that a breakpoint cuts."""


def bin_variances(table: Table, length: float, count: int) -> Vector:
    """Variances of the noise itself in the bins k = 1 ... count - 1, as `bin_amplitudes` has them:
    the integral of the density over each bin, and in the first that of all below."""
    nodes, weights = gauss_legendre(NODES_OF_BIN)
    edges = (np.arange(count) + 0.5) / length
    cuts = np.unique(np.concatenate([edges, table.frequency_hz]))
    cuts = cuts[(cuts >= table.frequency_hz[0]) & (cuts <= min(edges[-1], table.frequency_hz[-1]))]
    half, middle = np.diff(cuts) / 2.0, (cuts[1:] + cuts[:-1]) / 2.0
    owner = np.clip(np.searchsorted(edges, middle) - 1, 0, count - 2)
    parts = half * np.sum(weights[:, None] * table(middle + half * nodes[:, None]), axis=0)
    return np.asarray(np.bincount(owner, parts, count - 1), float)


def bin_amplitudes(
    table: Table, force: Force, stiffness: Matrix, damping: Matrix, length: float, count: int
) -> tuple[Waves, Matrix]:
    """Amplitudes B of the bins k = 1 ... count - 1, and the contributions of each bin to E q'^2.

    Both are (count - 1, n). Bin k reaches from (k - 1/2) / length to (k + 1/2) / length. |B|^2 is
    the integral of |H|^2 G over the bin, so that a table that ends within a bin loses nothing. The
    phases, which relate the modes to each other, are those of H in the middle of the bin. The
    density below the first bin is added to it.
    """
    nodes, weights = gauss_legendre(NODES_OF_BIN)
    edges = (np.arange(count) + 0.5) / length
    low, high = float(table.frequency_hz[0]), float(table.frequency_hz[-1])
    breaks = [force.breaks] if isinstance(force, InputMatrix) else []
    cuts = np.unique(np.concatenate([edges, table.frequency_hz, *breaks]))
    cuts = cuts[(cuts >= low) & (cuts <= min(edges[-1], high))]
    squares, velocities = np.zeros((2, count - 1, len(stiffness)))
    half, middle = np.diff(cuts) / 2.0, (cuts[1:] + cuts[:-1]) / 2.0
    owner = np.clip(np.searchsorted(edges, middle) - 1, 0, count - 2)
    for node, weight in zip(nodes, weights, strict=True):
        f = middle + half * node
        share = (half * weight * table(f))[:, None]
        share = share * np.abs(gains(f, stiffness, damping, force)) ** 2
        np.add.at(squares, owner, share)
        np.add.at(velocities, owner, (2.0 * np.pi * f[:, None]) ** 2 * share)
    turned = gains(np.arange(1, count) / length, stiffness, damping, force)
    size = np.abs(turned)
    phase = np.divide(turned, size, out=np.ones_like(turned), where=size > 0.0)
    return phase * np.sqrt(squares), velocities
