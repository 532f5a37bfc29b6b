"""Response of several modes to a table, against a plain sum over frequencies and against time."""

import math

import numpy as np
import pytest

from stochvi.mathematics.frequency_response import beyond, bin_amplitudes, covariance, gains
from stochvi.mathematics.spectra import Filter, Table
from stochvi.mathematics.state_space import stationary_covariance

STIFFNESS = np.diag([30.0, 200.0])
DAMPING = np.array([[0.8, -0.3], [-0.3, 2.0]])
FORCE = np.array([1.0, -0.6])
TABLE = Table(frequency_hz=np.array([0.3, 1.0, 6.0]), density=np.array([0.5, 2.0, 0.1]))


def brute_gains(f: np.ndarray) -> np.ndarray:
    """(frequencies, 2) by the inverse of a matrix of two rows."""
    w = 2.0 * np.pi * f
    a, b = 30.0 - w**2 + 0.8j * w, -0.3j * w
    d = 200.0 - w**2 + 2.0j * w
    det = a * d - b * b
    return np.stack([(d * FORCE[0] - b * FORCE[1]) / det, (a * FORCE[1] - b * FORCE[0]) / det], 1)


def test_gains_solve_the_equation_of_motion() -> None:
    f = np.array([0.1, 0.9, 2.2, 5.0])
    np.testing.assert_allclose(gains(f, STIFFNESS, DAMPING, FORCE), brute_gains(f), rtol=1e-12)


def test_covariances_are_sums_over_frequencies() -> None:
    f = np.concatenate([np.linspace(0.3, 1.0, 50_001), np.linspace(1.0, 6.0, 200_001)])
    q = brute_gains(f)
    states = np.hstack([q, 2j * np.pi * f[:, None] * q])
    products = (states[:, :, None] * states[:, None, :].conj()).real * TABLE(f)[:, None, None]
    expected = np.trapezoid(products, f, axis=0)
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    found = covariance([(TABLE, FORCE)], STIFFNESS, DAMPING)
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=1e-6)


def test_a_wide_flat_table_is_white_noise() -> None:
    """One-sided 2 S0 per hertz. The table leaves out what lies far above the modes, where
    v = force / (i w), and far below them, where x = force / stiffness."""
    flat = Table(frequency_hz=np.array([1e-6, 1e4]), density=np.array([0.8, 0.8]))
    generator = np.block([[np.zeros((2, 2)), np.eye(2)], [-STIFFNESS, -DAMPING]])
    noise = np.zeros((4, 4))
    noise[2:, 2:] = 0.4 * np.outer(FORCE, FORCE)
    expected = stationary_covariance(generator, noise)
    found = covariance([(flat, FORCE)], STIFFNESS, DAMPING)
    still = FORCE / np.diag(STIFFNESS)
    below = 0.8e-6 * np.outer(still, still)
    np.testing.assert_allclose(found[:2, :2] + below, expected[:2, :2], rtol=1e-6)
    left = 0.8 * np.outer(FORCE, FORCE) / (4.0 * np.pi**2 * 1e4)
    np.testing.assert_allclose(found[2:, 2:] + left, expected[2:, 2:], rtol=1e-6)


def test_what_lies_above_a_frequency_falls_from_the_whole_to_nothing() -> None:
    rows = np.array([[1.0, 0.0], [1.0, -1.0]])
    f, above = beyond([(TABLE, FORCE)], STIFFNESS, DAMPING, rows)
    whole = covariance([(TABLE, FORCE)], STIFFNESS, DAMPING)[2:, 2:]
    np.testing.assert_allclose(above[0], [row @ whole @ row for row in rows], rtol=1e-12)
    assert (np.diff(f) >= 0.0).all() and (np.diff(above, axis=0) <= 0.0).all()
    assert f[-1] == pytest.approx(6.0, rel=0.01)


def test_bins_hold_the_variances_of_the_table() -> None:
    """Amplitudes squared are what the bins hold together, low frequencies and edges included."""
    amplitudes, velocities = bin_amplitudes(TABLE, FORCE, STIFFNESS, DAMPING, 40.0, 400)
    whole = covariance([(TABLE, FORCE)], STIFFNESS, DAMPING)
    np.testing.assert_allclose((np.abs(amplitudes) ** 2).sum(axis=0), np.diag(whole)[:2], rtol=1e-6)
    np.testing.assert_allclose(velocities.sum(axis=0), np.diag(whole)[2:], rtol=1e-6)


@pytest.mark.parametrize(("omega", "b"), [(1.0, 0.1), (3.0, 0.5), (1.0, 5.0), (2.0, 0.01)], ids=str)
def test_moments_of_filtered_noise_are_those_of_its_states(omega: float, b: float) -> None:
    """x'' + b x' + W^2 x = f and the filter as one system of four states."""
    noise = Filter(omega=2.0, damping_rate=0.3, intensity=0.7)
    generator = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-(omega**2), -b, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, -4.0, -0.3],
        ]
    )
    states = stationary_covariance(generator, np.diag([0.0, 0.0, 0.0, 0.7 * 2.0**4]))
    found = noise.response_moments(omega, b)
    assert found == pytest.approx((states[0, 0], states[1, 1]), rel=1e-9)
    # the density of the filter alone, one-sided per hertz
    f = np.linspace(0.0, 40.0, 400_001)
    assert np.trapezoid(noise(f), f) == pytest.approx(states[2, 2], rel=1e-4)
    assert math.isinf(noise.response_moments(omega, 0.0)[0])
