"""Steps and stationary distributions of linear systems, against integrals over time."""

import numpy as np
import pytest
from scipy.linalg import expm

from stochvi.mathematics.quadrature import gauss_panels
from stochvi.mathematics.state_space import (
    square_root,
    stationary_covariance,
    step_covariance,
    transition,
)

GENERATOR = np.array([[0.0, 1.0, 0.0], [-4.0, -0.6, 1.5], [0.0, 0.0, -2.0]])
"""An oscillator that noise with a memory of its own drives: not symmetric in any way."""

NOISE = np.array([[0.0, 0.0, 0.0], [0.0, 0.7, 0.2], [0.0, 0.2, 0.9]])


def brought_in(step: float) -> np.ndarray:
    """int_0^h exp(A s) N exp(A' s) ds by Gauss's rule on short panels."""
    times, weights = gauss_panels(np.linspace(0.0, step, 60), 12)
    return sum(
        weight * expm(GENERATOR * time) @ NOISE @ expm(GENERATOR.T * time)
        for time, weight in zip(times, weights, strict=True)
    )


@pytest.mark.parametrize("step", [1e-3, 0.1, 1.0, 7.0])
def test_the_noise_of_a_step_is_an_integral_over_it(step: float) -> None:
    """Short steps at once, long ones by doubling."""
    expected = brought_in(step)
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    found = step_covariance(GENERATOR, NOISE, step)
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=1e-9)


def test_two_steps_are_one_of_both_lengths() -> None:
    short, rest = transition(GENERATOR, 0.3), step_covariance(GENERATOR, NOISE, 0.5)
    whole = short @ rest @ short.T + step_covariance(GENERATOR, NOISE, 0.3)
    np.testing.assert_allclose(step_covariance(GENERATOR, NOISE, 0.8), whole, atol=1e-13)


def test_the_stationary_law_is_that_of_a_step_without_end() -> None:
    found = stationary_covariance(GENERATOR, NOISE)
    np.testing.assert_allclose(found, step_covariance(GENERATOR, NOISE, 200.0), atol=1e-12)
    flow = GENERATOR @ found
    np.testing.assert_allclose(flow + flow.T + NOISE, 0.0, atol=1e-12)


def test_a_root_of_a_covariance_gives_it_back_with_as_few_columns_as_it_has_noises() -> None:
    columns = np.array([[2.0, 0.3], [-1.0, 1e-4], [0.5, 0.2], [0.0, 0.0]])
    covariance = columns @ columns.T
    root = square_root(covariance, 1e-12)
    assert root.shape == (4, 2)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-14)


def test_rounding_does_not_choose_the_root_of_independent_states() -> None:
    exact = square_root(np.diag([4.0, 9.0]), 1e-12)
    for error in (1e-16, -1e-16):
        rounded = np.array([[4.0 * (1.0 + error), 6.0 * error], [6.0 * error, 9.0]])
        np.testing.assert_allclose(square_root(rounded, 1e-12), exact, atol=1e-14)
