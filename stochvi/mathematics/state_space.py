"""Linear systems driven by white noise, s' = A s + noise: exact steps and stationary covariance."""

from __future__ import annotations

import numpy as np
import scipy

from stochvi.mathematics.arrays import Matrix

DOUBLINGS_FROM = 0.5
"""Largest norm of A h for which a step is computed directly; longer ones are found by doubling."""


def transition(generator: Matrix, step: float) -> Matrix:
    """exp(A h), (n, n).

    >>> transition(np.array([[0.0, 1.0], [0.0, 0.0]]), 2.0)
    array([[1., 2.],
           [0., 1.]])
    """
    exponential: Matrix = scipy.linalg.expm(generator * step)
    return exponential


def step_covariance(generator: Matrix, noise: Matrix, step: float) -> Matrix:
    """Covariance that white noise brings in over a step, (n, n).

    Q(h) = int_0^h exp(A s) N exp(A' s) ds, from one matrix exponential (C. F. Van Loan, IEEE
    Trans. Autom. Control 23 (1978) 395) over a short step, and Q(2h) = Q(h) + exp(A h) Q(h)
    exp(A' h). The matrix exponential contains exp(-A h), which grows with h, and is therefore
    taken over the short step only.

    Parameters
    ----------
    generator, noise
        A and the intensity matrix N, E w w' = N delta.

    Examples
    --------
    >>> step_covariance(np.array([[-0.5]]), np.array([[1.0]]), 100.0)
    array([[1.]])
    """
    size = len(generator)
    norm = float(np.linalg.norm(generator, 1)) * step
    doublings = max(0, int(np.ceil(np.log2(norm / DOUBLINGS_FROM)))) if norm > 0.0 else 0
    short = step / 2.0**doublings
    block = np.zeros((2 * size, 2 * size))
    scale = float(np.max(np.abs(noise))) or 1.0  # its size depends on its unit
    block[:size, :size], block[:size, size:] = -generator, noise / scale
    block[size:, size:] = generator.T
    grown = scipy.linalg.expm(block * short)
    forward = grown[size:, size:].T
    covariance = scale * (forward @ grown[:size, size:])
    for _ in range(doublings):
        covariance = covariance + forward @ covariance @ forward.T
        forward = forward @ forward
    return np.asarray((covariance + covariance.T) / 2.0, float)


def stationary_covariance(generator: Matrix, noise: Matrix) -> Matrix:
    """Solution of A P + P A' + N = 0 for a stable A, (n, n).

    >>> oscillator = np.array([[0.0, 1.0], [-1.0, -0.1]])
    >>> stationary_covariance(oscillator, np.diag([0.0, 0.2])).round(12) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    solution = scipy.linalg.solve_continuous_lyapunov(generator, -noise)
    return np.asarray((solution + solution.T) / 2.0, float)


def square_root(covariance: Matrix, tolerance: float) -> Matrix:
    """Columns L with L L' equal to a covariance, one for each independent noise.

    Eigenvalues of the correlations below `tolerance` times the largest one are left out, and
    correlations below it: rounding must not choose the axes of independent states.

    >>> square_root(np.diag([4.0, 0.0]), 1e-12)
    array([[2.],
           [0.]])
    """
    own = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size = np.where(own > 0.0, own, 1.0)
    correlations = covariance / np.outer(size, size)
    np.fill_diagonal(correlations, own > 0.0)
    correlations[np.abs(correlations) < tolerance] = 0.0
    values, vectors = np.linalg.eigh(correlations)
    kept = values > tolerance * max(float(values[-1]), 0.0)
    signs = np.sign(vectors[np.abs(vectors).argmax(axis=0), np.arange(len(vectors))])
    columns: Matrix = size[:, None] * (vectors * signs * np.sqrt(np.maximum(values, 0.0)))[:, kept]
    return columns[:, ::-1]
